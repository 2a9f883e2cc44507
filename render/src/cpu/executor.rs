//! Runs the kernels of a frame through rayon.

use super::buffers::Buffers;
use super::kernels as k;
use super::kernels::shadow_hits_through_glass::Met;
use super::photons::{Maps, PhotonReport, PointTrees, Tracing, trace};
use super::traced::{Traced, of_scene};
use crate::error::RenderError;
use crate::frame::FrameInput;
use crate::kernel::{Buffer, Counter, Kernel, RayTracer};
use crate::layout::{Counters, Frame};
use crate::plan::Plan;
use crate::scene_words::SceneWords;
use crate::world::{Instances, OneMesh};
use rayon::prelude::*;
use splitplane_core::backend::Accelerator;
use splitplane_core::build::lockstep::Inspect;
use splitplane_core::build::schedule::Executor;
use splitplane_core::mesh::Mesh;
use splitplane_core::query::intersect::{Limits, SceneScale};
use splitplane_core::triangle::prepare;
use splitplane_cpu::clock::Stopwatch;
use splitplane_float_state::standard;
use std::time::Duration;

/// Calls a kernel with what is shown: one mesh, for which nothing is looked up, or the instances of a scene.
macro_rules! in_world {
    ($traced:expr, $mesh:expr, $world:ident => $call:expr) => {
        match $traced {
            Traced::Mesh(..) => {
                let $world = OneMesh($mesh);
                $call
            }
            Traced::Scene(_, table, _) => {
                let $world = Instances { mesh: $mesh, table };
                $call
            }
        }
    };
}

/// One frame on the CPU.
pub struct CpuExecutor<'a> {
    input: FrameInput<'a>,
    traced: Traced<'a>,
    plan: Plan,
    frame: Frame,
    buffers: &'a mut Buffers,
    /// The reference traversal that counts costs; created when first needed.
    scale: Option<SceneScale>,
    /// `None` where there is no clock.
    tracing: Option<Duration>,
    /// The photons of this pass, and what became of those of all.
    maps: Option<Maps>,
    photons: PhotonReport,
    /// What builds the trees of photons.
    trees: &'a PointTrees,
}

/// Those of a frame whose photons stay on the cores of this machine.
static HOST_TREES: PointTrees = PointTrees::Cpu;

impl core::fmt::Debug for CpuExecutor<'_> {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_struct("CpuExecutor")
            .field("plan", &self.plan)
            .field("counters", &self.buffers.counters)
            .finish_non_exhaustive()
    }
}

impl<'a> CpuExecutor<'a> {
    /// A new executor. `accelerator` must be built over the mesh of `input`.
    ///
    /// # Errors
    /// An appearance of another mesh.
    pub fn new(
        input: FrameInput<'a>,
        accelerator: &'a dyn Accelerator,
        plan: Plan,
        buffers: &'a mut Buffers,
    ) -> Result<CpuExecutor<'a>, RenderError> {
        CpuExecutor::of(input, (Traced::Mesh(accelerator, None), &HOST_TREES), plan, buffers)
    }

    /// A new executor of what is traced, and of what builds the trees of photons: its triangles must be those of `input`.
    pub(super) fn of(
        input: FrameInput<'a>,
        (traced, trees): (Traced<'a>, &'a PointTrees),
        plan: Plan,
        buffers: &'a mut Buffers,
    ) -> Result<CpuExecutor<'a>, RenderError> {
        let (described, triangles) = (input.scene.triangles(), input.mesh.len() as u32);
        if described != triangles {
            return Err(RenderError::WrongMesh { described, triangles });
        }
        buffers.prepare(&plan);
        let frame = plan.frame(input.scene, &input.camera, &input.query);
        let tracing = Stopwatch::start().elapsed().map(|_| Duration::ZERO);
        let (scale, maps, photons) = (None, None, PhotonReport::default());
        Ok(CpuExecutor {
            input,
            traced,
            plan,
            frame,
            buffers,
            scale,
            tracing,
            maps,
            photons,
            trees,
        })
    }

    /// Begins another pass of the frame, over other samples of each pixel and other photons. The sums of counters go on.
    pub(super) fn begin_pass(&mut self, pass: u32) -> Result<(), RenderError> {
        if pass > 0 {
            self.plan = self.plan.repeated();
        }
        self.frame.first_sequence = pass * self.frame.samples;
        self.buffers.counters[Counter::PixelsLeft] = self.plan.pixels().len() as u32;
        if self.plan.photons() == 0 {
            return Ok(());
        }
        // Those of the pass before make room.
        self.maps = None;
        let FrameInput { mesh, scene: data, query, .. } = self.input;
        let environment = data.environment();
        let scene = SceneWords { words: data.words(), frame: &self.frame, environment };
        let (traced, plan, trees) = (self.traced, &self.plan, self.trees);
        let bounds = traced.bounds();
        let stopwatch = Stopwatch::start();
        self.maps = in_world!(traced, mesh, world => {
            let tracing = Tracing { scene, world, bounds, traced, plan, query, trees };
            trace(&tracing, pass, &mut self.photons)?
        });
        self.add_tracing(stopwatch);
        Ok(())
    }

    /// What became of photons so far; `None` where none were wanted.
    pub(super) fn photons(&self) -> Option<PhotonReport> {
        (self.plan.photons() > 0).then_some(self.photons)
    }

    /// The current counters.
    pub fn counters(&self) -> &Counters {
        &self.buffers.counters
    }

    /// Time spent in queries so far; `None` where there is no clock.
    pub fn tracing(&self) -> Option<Duration> {
        self.tracing
    }

    fn add_tracing(&mut self, stopwatch: Stopwatch) {
        self.tracing = self.tracing.zip(stopwatch.elapsed()).map(|(sum, more)| sum + more);
    }

    /// Live elements of a buffer.
    fn live_elements(&self, buffer: Buffer) -> usize {
        buffer.live().map_or(0, |counter| self.buffers.counters[counter] as usize)
    }
}

/// The data of the mesh for the reference traversal.
fn scene_scale(mesh: Mesh<'_>, accelerator: &dyn Accelerator) -> SceneScale {
    let limits = (0..mesh.len())
        .into_par_iter()
        .with_min_len(4096)
        .map(|i| standard(|| prepare(&mesh.triangle(i))))
        .filter(|triangle| triangle.kept)
        .map(|triangle| standard(|| Limits::of(&triangle.corners)))
        .reduce(|| Limits::NONE, Limits::union);
    SceneScale::new(accelerator.tree().bounds, &limits)
}

impl Executor<RayTracer> for CpuExecutor<'_> {
    type Error = RenderError;

    fn dispatch(&mut self, kernel: Kernel) -> Result<(), RenderError> {
        let FrameInput { mesh, scene: data, query, .. } = self.input;
        let frame = &self.frame;
        let environment = data.environment();
        let scene = SceneWords { words: data.words(), frame, environment };
        let counters = self.buffers.counters;
        let paths = counters[Counter::Paths] as usize;
        let chunks = counters[Counter::PathChunks] as usize;
        let shadows = counters[Counter::ShadowRays] as usize;
        let wave = counters[Counter::Wave];
        let b = &mut *self.buffers;
        match kernel {
            Kernel::BeginSlice => k::begin_slice::run(frame, &mut b.counters),
            Kernel::BeginWave => k::begin_wave::run(&mut b.counters),
            Kernel::CameraRays => {
                let first = counters[Counter::FirstPixel];
                k::camera_rays::run(frame, first, &mut b.rays[..paths], &mut b.paths[..paths]);
            }
            Kernel::ClosestHits => {
                let stopwatch = Stopwatch::start();
                let (rays, hits) = (&b.rays[..paths], &mut b.hits[..paths]);
                let met = (&mut b.scene_hits, &mut b.hit_instances);
                self.traced.closest_hits(rays, hits, met, &query)?;
                self.add_tracing(stopwatch);
            }
            Kernel::Shade => {
                in_world!(self.traced, mesh, world => {
                    let input = k::shade::Input {
                        scene,
                        world,
                        wave,
                        rays: &b.rays[..paths],
                        paths: &b.paths[..paths],
                        hits: &b.hits[..paths],
                        instances: &b.hit_instances,
                    };
                    k::shade::run(&input, &mut b.surfaces[..paths], &mut b.spawned[..chunks]);
                });
                if let Some(maps) = &self.maps {
                    let surfaces = &mut b.surfaces[..paths];
                    maps.light(frame, &b.paths[..paths], surfaces, query.watch)?;
                }
            }
            Kernel::ScanSpawned => {
                k::scan_spawned::run(frame, &mut b.spawned[..chunks], &mut b.counters);
            }
            Kernel::ShadowRays => {
                in_world!(self.traced, mesh, world => {
                    let input = k::shadow_rays::Input {
                        scene,
                        world,
                        wave,
                        paths: &b.paths[..paths],
                        surfaces: &b.surfaces[..paths],
                        spawned: &b.spawned[..chunks],
                    };
                    let (rays, lights) = (&mut b.shadow_rays, &mut b.shadow_light);
                    k::shadow_rays::run(&input, &mut rays[..shadows], &mut lights[..shadows]);
                });
            }
            Kernel::ShadowHits => {
                let stopwatch = Stopwatch::start();
                let (rays, lights) = (&b.shadow_rays[..shadows], &mut b.shadow_light[..shadows]);
                k::shadow_hits::run(self.traced, &query, rays, lights, &mut b.occluded)?;
                self.add_tracing(stopwatch);
            }
            Kernel::ShadowHitsThroughGlass => {
                let stopwatch = Stopwatch::start();
                let traced = self.traced;
                let asked = (&b.shadow_rays[..shadows], &b.spawned[..chunks]);
                let (lights, met) = (
                    &mut b.shadow_light[..shadows],
                    Met {
                        rays: &mut b.through_rays,
                        numbers: &mut b.through_numbers,
                        hits: &mut b.through_hits,
                        scene_hits: &mut b.scene_hits,
                        instances: &mut b.through_instances,
                    },
                );
                in_world!(traced, mesh, world => k::shadow_hits_through_glass::run(
                    traced, &query, &scene, world, asked, lights, met
                ))?;
                self.add_tracing(stopwatch);
            }
            Kernel::Accumulate => {
                let casts = self.plan.casts_shadows();
                let input = k::accumulate::Input {
                    frame,
                    paths: &b.paths[..paths],
                    surfaces: &b.surfaces[..paths],
                    spawned: if casts { &b.spawned[..chunks] } else { &[] },
                    lights: &b.shadow_light[..shadows],
                };
                k::accumulate::run(&input, &mut b.radiance);
            }
            Kernel::NextPaths => {
                let input = k::next_paths::Input {
                    scene,
                    wave,
                    rays: &b.rays[..paths],
                    paths: &b.paths[..paths],
                    surfaces: &b.surfaces[..paths],
                    spawned: &b.spawned[..chunks],
                };
                let next = counters[Counter::NextPaths] as usize;
                let (rays, paths) = (&mut b.next_rays[..next], &mut b.next_paths[..next]);
                k::next_paths::run(&input, rays, paths);
            }
            Kernel::FirstHits => {
                let (rays, hits) = (&b.rays[..paths], &b.hits[..paths]);
                let (paths, met) = (&b.paths[..paths], (hits, &b.hit_instances[..]));
                in_world!(self.traced, mesh, world => {
                    k::first_hits::run(world, rays, paths, met, &mut b.first_hits);
                });
            }
            Kernel::FirstCosts => {
                let accelerator = match self.traced {
                    Traced::Mesh(accelerator, _) => accelerator,
                    Traced::Scene(scene, ..) => {
                        let pixels = &mut b.first_costs[counters[Counter::FirstPixel] as usize..];
                        let firsts = b.rays[..paths].par_iter().step_by(frame.samples as usize);
                        k::first_costs::run_scene(scene.scene(), &of_scene(&query), firsts, pixels);
                        return Ok(());
                    }
                };
                let scale = *self.scale.get_or_insert_with(|| scene_scale(mesh, accelerator));
                let input = k::first_costs::Input {
                    tree: accelerator.tree().view(),
                    mesh,
                    scale,
                    options: query,
                    samples: frame.samples,
                    first_pixel: counters[Counter::FirstPixel],
                    rays: &b.rays[..paths],
                };
                k::first_costs::run(&input, &mut b.first_costs);
            }
            Kernel::Resolve => k::resolve::run(&scene, &b.radiance, &mut b.pixels),
        }
        Ok(())
    }

    fn swap(&mut self, a: Buffer, b: Buffer) -> Result<(), RenderError> {
        let buffers = &mut *self.buffers;
        match (a, b) {
            (Buffer::Rays, Buffer::NextRays) => {
                core::mem::swap(&mut buffers.rays, &mut buffers.next_rays);
            }
            (Buffer::Paths, Buffer::NextPaths) => {
                core::mem::swap(&mut buffers.paths, &mut buffers.next_paths);
            }
            _ => unreachable!("the schedule exchanges no other lists"),
        }
        Ok(())
    }

    fn pending(&mut self, counter: Counter, _rounds: u32) -> Result<bool, RenderError> {
        // A void frame need not be finished.
        let void = self.buffers.counters[Counter::Overflow] != 0;
        Ok(!void && self.buffers.counters[counter] > 0)
    }
}

impl Inspect<RayTracer> for CpuExecutor<'_> {
    fn live(&mut self, buffer: Buffer) -> Result<Vec<u8>, RenderError> {
        fn bytes<T: bytemuck::NoUninit>(elements: &[T]) -> Vec<u8> {
            bytemuck::cast_slice(elements).to_vec()
        }
        let n = self.live_elements(buffer);
        let b = &*self.buffers;
        Ok(match buffer {
            Buffer::Rays => bytes(&b.rays[..n]),
            Buffer::Paths => bytes(&b.paths[..n]),
            Buffer::NextRays => bytes(&b.next_rays[..n]),
            Buffer::NextPaths => bytes(&b.next_paths[..n]),
            Buffer::Hits => bytes(&b.hits[..n]),
            Buffer::Surfaces => bytes(&b.surfaces[..n]),
            Buffer::Spawned => bytes(&b.spawned[..n]),
            Buffer::ShadowRays => bytes(&b.as_devices_have(&b.shadow_rays[..n])),
            Buffer::ShadowLight => bytes(&b.as_devices_have(&b.shadow_light[..n])),
            Buffer::Radiance => bytes(&b.radiance),
            Buffer::FirstHits => bytes(&b.first_hits),
            Buffer::FirstCosts => bytes(&b.first_costs),
            Buffer::Pixels => bytes(&b.pixels),
            Buffer::Counters => bytemuck::bytes_of(&b.counters).to_vec(),
            // The tree's, the scene's, and what no kernel here uses.
            Buffer::Nodes
            | Buffer::LeafReferences
            | Buffer::CompressedNodes
            | Buffer::CompressedReferences
            | Buffer::Triangles
            | Buffer::Scene
            | Buffer::Deferred => Vec::new(),
        })
    }
}
