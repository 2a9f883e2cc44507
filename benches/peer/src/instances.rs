//! The harness's task `instances`: copies of one mesh, placed by `instances.f32` (object to world, three rows of four) and
//! `instances.u32` (the geometry of each).

use std::path::Path;

use rayon::prelude::*;
use serde_json::{Map, Value, json};
use splitplane_core::backend::scene::SceneAccelerator;
use splitplane_core::backend::{Backend, BuildOptions};
use splitplane_core::mesh::Mesh;
use splitplane_core::ray::Ray;
use splitplane_core::scene::{GeometryId, Instance, Scene, SceneHit, SceneOptions};

use super::{Clock, Plan, SETS, rays_of, read, repeat, write};

/// What is measured, and how.
pub(super) struct Task<'a> {
    pub(super) plan: &'a Plan,
    pub(super) clock: Clock,
    pub(super) pool: &'a rayon::ThreadPool,
    pub(super) backend: &'a dyn Backend,
    pub(super) mesh: Mesh<'a>,
    pub(super) options: BuildOptions<'static>,
    pub(super) reps: usize,
    pub(super) prefix: &'a str,
}

impl Task<'_> {
    pub(super) fn measure(&self, dir: &Path) -> Result<Value, String> {
        let transforms: Vec<[[f32; 4]; 3]> = read(&dir.join("instances.f32"))?;
        let geometries: Vec<u32> = read(&dir.join("instances.u32"))?;
        let text = |error: &dyn std::fmt::Display| error.to_string();
        let scene_of = |count: usize| -> Result<Scene, String> {
            let mut scene = Scene::new();
            scene.add_mesh(&self.mesh).map_err(|error| text(&error))?;
            attach(&mut scene, &geometries[..count], &transforms[..count])?;
            Ok(scene)
        };
        let [mut build_ms, mut attach_ms, mut top_ms] = [const { Vec::new() }; 3];
        let mut built = None;
        let mut top_bytes = 0;
        // The first time warms up and is not counted.
        for rep in 0..=self.reps {
            drop(built.take());
            let mut scene = scene_of(0)?;
            let mut made = None;
            let mesh_s = self.clock.seconds(|| {
                made = Some(self.pool.install(|| self.backend.build_scene(&scene, &self.options)));
            });
            let mut made = made.expect("it was built").map_err(|error| text(&error))?;
            let mut attached = Ok(());
            let attach_s = self.clock.seconds(|| {
                attached = attach(&mut scene, &geometries, &transforms);
            });
            attached?;
            let mut updated = None;
            let top_s = self.clock.seconds(|| {
                let update = || self.backend.update_scene(&mut made, &scene, &self.options);
                updated = Some(self.pool.install(update));
            });
            updated.expect("it was updated").map_err(|error| text(&error))?;
            top_bytes = made.scene().bytes_beside_geometries();
            built = Some(made);
            if rep > 0 {
                build_ms.push((mesh_s + attach_s + top_s) * 1e3);
                attach_ms.push(attach_s * 1e3);
                top_ms.push(top_s * 1e3);
            }
        }
        let built = built.expect("it was built");
        let mut sets = Map::new();
        for set in SETS {
            let rays = rays_of(dir, set)?;
            let (mut hits, mut any) = (vec![SceneHit::MISS; rays.len()], vec![false; rays.len()]);
            self.closest(&built, &rays, &mut hits)?;
            let closest_s = repeat(self.clock, self.reps, || {
                self.closest(&built, &rays, &mut hits).expect("answered before");
            });
            self.occluded(&built, &rays, &mut any)?;
            let any_s = repeat(self.clock, self.reps, || {
                self.occluded(&built, &rays, &mut any).expect("answered before");
            });
            let (prefix, mut records, mut names) = (self.prefix, Vec::new(), Vec::new());
            for hit in &hits {
                records.push([hit.t.to_bits(), hit.triangle]);
                names.push(hit.instance);
            }
            write(&format!("{prefix}.{set}.hits"), bytemuck::cast_slice(&records))?;
            write(&format!("{prefix}.{set}.inst"), bytemuck::cast_slice(&names))?;
            let bytes: Vec<u8> = any.iter().map(|&hit| u8::from(hit)).collect();
            write(&format!("{prefix}.{set}.any"), &bytes)?;
            let figures =
                json!({"rays": rays.len(), "stride": 1, "closest_s": closest_s, "any_s": any_s});
            sets.insert(set.into(), figures);
        }
        Ok(json!({
            "version": env!("CARGO_PKG_VERSION"),
            "clock": self.clock.name(),
            "build_ms": build_ms,
            "attach_ms": attach_ms,
            "top_ms": top_ms,
            "top_bytes": top_bytes,
            "struct_bytes": built.scene().bytes(),
            "sets": sets,
        }))
    }

    fn options(&self) -> SceneOptions<'static> {
        SceneOptions { accuracy: self.plan.options.accuracy, ..SceneOptions::default() }
    }

    fn closest(
        &self,
        built: &dyn SceneAccelerator,
        rays: &[Ray],
        hits: &mut [SceneHit],
    ) -> Result<(), String> {
        let options = &self.options();
        self.pool.install(|| {
            if self.plan.single {
                let chunks = rays.par_chunks(CHUNK).zip(hits.par_chunks_mut(CHUNK));
                chunks.for_each(|(rays, hits)| {
                    for (ray, hit) in rays.iter().zip(hits) {
                        *hit = built.closest_hit(ray, options).unwrap_or(SceneHit::MISS);
                    }
                });
                return Ok(());
            }
            built.closest_hits(rays, hits, options).map(|_| ()).map_err(|error| error.to_string())
        })
    }

    fn occluded(
        &self,
        built: &dyn SceneAccelerator,
        rays: &[Ray],
        any: &mut [bool],
    ) -> Result<(), String> {
        let options = &self.options();
        self.pool.install(|| {
            if self.plan.single {
                let chunks = rays.par_chunks(CHUNK).zip(any.par_chunks_mut(CHUNK));
                chunks.for_each(|(rays, any)| {
                    for (ray, any) in rays.iter().zip(any) {
                        *any = built.any_hit(ray, options);
                    }
                });
                return Ok(());
            }
            built.any_hits(rays, any, options).map(|_| ()).map_err(|error| error.to_string())
        })
    }
}

/// Rays of a task, one after the other.
const CHUNK: usize = 2048;

/// Adds the instances.
fn attach(
    scene: &mut Scene,
    geometries: &[u32],
    transforms: &[[[f32; 4]; 3]],
) -> Result<(), String> {
    for (&geometry, &transform) in geometries.iter().zip(transforms) {
        let instance = Instance::new(GeometryId(geometry), transform);
        scene.add_instance(instance).map_err(|error| error.to_string())?;
    }
    Ok(())
}
