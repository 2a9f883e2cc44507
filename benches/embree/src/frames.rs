//! A frame in turns with Embree's tree and rays: ours builds, traces, shades and makes the picture; Embree builds and traces the same numbers of rays.

use splitplane_core::backend::{Accelerator, Backend, BuildOptions};
use splitplane_core::config::Preset;
use splitplane_core::mesh::Mesh;
use splitplane_core::ray::{Hit, QueryOptions, Ray};
use splitplane_cpu::{CpuBackend, InstructionSet};
use splitplane_render::cpu::CpuRenderer;
use splitplane_render::{FrameInput, Light, Outputs, RenderSettings, SceneData, Size};
use splitplane_scene::{Camera, Placement, Scene};

use crate::callgrind;
use crate::embree::Embree;
use crate::turns::{cpu_time, median};
use crate::{Options, Problem};

/// Pixels on a side.
const SIDE: u32 = 1024;

/// Prints Embree's median time for tree, camera rays and shadow rays, ours for the tree and for the frame, the part of the frame that is
/// spent in queries, by the clock, and a sum of the picture's bits. Shadow rays that paths beyond the first wave ask for cost Embree what those of the first do.
///
/// # Errors
/// Where someone does not build or trace.
pub(crate) fn measure(
    scene: &mut Scene,
    options: &Options,
    (set, isa): (InstructionSet, Option<&str>),
    pool: &rayon::ThreadPool,
) -> Result<(), Problem> {
    if let [ex, ey, ez, ax, ay, az] = options.camera[..] {
        let up = [0.0, 1.0, 0.0];
        scene.camera = Some(Camera::new([ex, ey, ez], [ax, ay, az], up, options.fov)?);
    }
    let backend = CpuBackend::with_instruction_set(set);
    let asked = BuildOptions::from(Preset::Fast.config());
    let positions = scene.positions.clone();
    let indices = scene.indices.clone();
    let mesh = Mesh::indexed(&positions, &indices)?;
    let mut tree = pool.install(|| backend.build(&mesh, &asked))?;
    let mut placed = Placement::of_with(scene, &*tree, 1.0, options.lights)?;
    if !options.light.is_empty() {
        let at = placed.camera.look_at();
        let shared = 1.0 / (options.light.len() / 3) as f32;
        let irradiance = Light::DAYLIGHT.map(|part| part * shared);
        let (places, _) = options.light.as_chunks::<3>();
        placed.lights =
            places.iter().map(|&at_light| Light::point_for(at_light, at, irradiance)).collect();
    }
    scene.lights = placed.lights.clone();
    let settings = RenderSettings {
        samples: 1,
        depth: options.depth,
        headlight: 0.0,
        ..RenderSettings::default()
    };
    let data = SceneData::new(&mesh, &scene.appearance())?;
    let size = Size::new(SIDE, SIDE)?;
    let mut renderer = CpuRenderer::new();
    let input = FrameInput {
        mesh,
        scene: &data,
        camera: placed.camera.pinhole(size),
        size,
        settings: &settings,
        outputs: Outputs { radiance: true, ..Outputs::PIXELS },
        query: QueryOptions::default(),
    };
    if options.count {
        let mut frame = || {
            pool.install(|| renderer.render(&*tree, &input)).map(drop).expect("a frame as planned");
        };
        callgrind::count(&format!("{} frame", scene.name), || (), &mut frame);
        return Ok(());
    }
    let camera = placed.camera.rays(SIDE, SIDE);
    let shadow = shadow_rays(&mesh, &*tree, &camera, &placed.lights)?;
    let mut found = vec![(0.0, 0); camera.len()];
    let mut hit = vec![false; shadow.len()];
    let (mut embree, mut ours): ([Vec<f64>; 3], [Vec<f64>; 2]) = Default::default();
    let (mut traced, mut ratios) = (Vec::new(), Vec::new());
    let mut stats = pool.install(|| renderer.render(&*tree, &input))?;
    for _ in 0..options.rounds.max(1) {
        let other = Embree::build(&options.library, (isa, 1), &positions, &indices)?;
        let (closest, any) = (
            timed(|| other.closest(&camera, &mut found)).0,
            timed(|| other.any(&shadow, &mut hit)).0,
        );
        let rays = stats.paths as f64 * (closest / camera.len() as f64)
            + stats.shadow_rays as f64 * (any / shadow.len().max(1) as f64);
        for (all, one) in embree.iter_mut().zip([other.build.cpu, closest, any]) {
            all.push(one);
        }
        let (build, built) = timed(|| pool.install(|| backend.rebuild(&mut tree, &mesh, &asked)));
        built?;
        let start = std::time::Instant::now();
        let (frame, made) = timed(|| pool.install(|| renderer.render(&*tree, &input)));
        let whole = start.elapsed();
        stats = made?;
        if let Some(tracing) = stats.tracing {
            traced.push(tracing.as_secs_f64() / whole.as_secs_f64());
        }
        ours[0].push(build);
        ours[1].push(frame);
        ratios.push((build + frame) / (other.build.cpu + rays));
    }
    let ms = |times: &[f64]| 1e3 * median(times.iter().copied());
    println!(
        "  frame of {} paths and {} shadow rays, {} lights: Embree's tree {:.1} ms, {} camera rays {:.1} ms, {} shadow rays {:.1} ms; \
         our tree {:.1} ms, frame {:.1} ms, {:.0} % of it in queries; ratio {:.2}; bits {:016x}",
        stats.paths,
        stats.shadow_rays,
        placed.lights.len(),
        ms(&embree[0]),
        camera.len(),
        ms(&embree[1]),
        shadow.len(),
        ms(&embree[2]),
        ms(&ours[0]),
        ms(&ours[1]),
        100.0 * median(traced.iter().copied()),
        median(ratios.iter().copied()),
        digest(renderer.radiance())
    );
    Ok(())
}

/// From what camera rays hit to the lights on the same side, path by path.
fn shadow_rays(
    mesh: &Mesh<'_>,
    tree: &dyn Accelerator,
    camera: &[Ray],
    lights: &[Light],
) -> Result<Vec<Ray>, Problem> {
    let mut hits = vec![Hit::MISS; camera.len()];
    tree.closest_hits(camera, &mut hits, &QueryOptions::default())?;
    let mut rays = Vec::new();
    for (ray, hit) in camera.iter().zip(&hits).filter(|(_, hit)| hit.is_hit()) {
        let [a, b, c] = mesh.triangle(hit.triangle as usize);
        let (ab, ac) = (minus(b, a), minus(c, a));
        let normal = [
            ab[1] * ac[2] - ab[2] * ac[1],
            ab[2] * ac[0] - ab[0] * ac[2],
            ab[0] * ac[1] - ab[1] * ac[0],
        ];
        let side = if dot(normal, ray.direction) > 0.0 { -1.0 } else { 1.0 };
        // Back along the ray, by more than the hit's rounding.
        let point = std::array::from_fn(|i| ray.origin[i] + ray.direction[i] * (hit.t * 0.9999));
        for light in lights {
            let (towards, cast) = match light {
                Light::Point { position, .. } => {
                    (minus(*position, point), Ray::segment(point, *position))
                }
                Light::Directional { towards, .. } => (*towards, Ray::new(point, *towards)),
                _ => continue,
            };
            if side * dot(normal, towards) > 0.0 {
                rays.push(cast);
            }
        }
    }
    Ok(rays)
}

fn minus(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    std::array::from_fn(|i| a[i] - b[i])
}

fn dot(a: [f32; 3], b: [f32; 3]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// FNV-1a of the bits.
fn digest(radiance: &[[f32; 4]]) -> u64 {
    radiance.as_flattened().iter().fold(0xcbf2_9ce4_8422_2325, |sum, part| {
        (sum ^ u64::from(part.to_bits())).wrapping_mul(0x100_0000_01b3)
    })
}

fn timed<T>(work: impl FnOnce() -> T) -> (f64, T) {
    let before = cpu_time();
    let done = work();
    ((cpu_time() - before).as_secs_f64(), done)
}
