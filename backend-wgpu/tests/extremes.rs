//! The extremes suite on a device: the CPU's trees and hits, bit for bit, whatever the magnitudes.
//! What those hits are worth is judged by the exact oracle where the CPU's are.

use std::time::Duration;

use crate::common::{self, bits};
use splitplane_core::backend::{Accelerator, Backend, BuildOptions};
use splitplane_core::config::Preset;
use splitplane_core::ray::{Hit, QueryOptions, Ray};
use splitplane_cpu::CpuBackend;
use splitplane_test_support::aim::Aim;
use splitplane_test_support::extremes;
use splitplane_test_support::scenes::Scene;
use splitplane_wgpu::{Gpu, WgpuBackend};

fn closest(built: &dyn Accelerator, rays: &[Ray]) -> Vec<Hit> {
    let stale = Hit { t: -7.0, triangle: 0xdead, u: 7.0, v: 7.0 };
    let mut hits = vec![stale; rays.len()];
    built.closest_hits(rays, &mut hits, &QueryOptions::default()).expect("hits");
    hits
}

/// Gives how many rays hit.
fn check(backend: &WgpuBackend, scene: &Scene, preset: Preset, each: usize) -> usize {
    let mesh = scene.mesh();
    let name = format!("{}, {}", scene.name, preset.name());
    let options = BuildOptions::from(preset.config());
    let device = backend.build(&mesh, &options).expect("a tree of the device");
    let host = CpuBackend::new().build(&mesh, &options).expect("a tree of the CPU");
    assert_eq!(device.tree().digest(), host.tree().digest(), "{name}");
    assert!(device.tree() == host.tree(), "{name}: one digest, two trees");
    let mut rays = extremes::rays(&mesh, each, 94);
    let view = host.tree().view();
    let mut aim = Aim::new(&mesh, 95);
    rays.extend((0..each).map(|_| aim.in_split_plane(&view)));
    let limited = extremes::with_limits_at(&rays, &closest(&*host, &rays));
    let step = (limited.len() / (4 * each)).max(1);
    rays.extend(limited.iter().step_by(step));
    let expected = closest(&*host, &rays);
    for (i, hit) in closest(&*device, &rays).iter().enumerate() {
        assert_eq!(bits(hit), bits(&expected[i]), "{name}: {:?}", rays[i]);
    }
    let mut occluded = vec![false; rays.len()];
    device.any_hits(&rays, &mut occluded, &QueryOptions::default()).expect("answers");
    for (i, hit) in expected.iter().enumerate() {
        assert_eq!(occluded[i], hit.is_hit(), "{name}, any hit: {:?}", rays[i]);
    }
    expected.iter().filter(|hit| hit.is_hit()).count()
}

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn trees_and_hits_are_the_cpus() {
    let gpu = Gpu::clone(&common::gpu()).with_timeout(Duration::from_secs(900));
    let backend = WgpuBackend::new(gpu).expect("a backend");
    let mut hits = 0;
    for (number, scene) in extremes::scenes().iter().enumerate() {
        let each = if scene.name.contains("identical") { 1 } else { 6 };
        // The two builders in turn: the CPU goes through all.
        let preset = [Preset::Fast, Preset::Balanced][number % 2];
        hits += check(&backend, scene, preset, each);
    }
    assert!(hits > 1_000, "{hits}");
}
