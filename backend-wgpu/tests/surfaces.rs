//! Rays along surfaces on the device: its four words are those of the CPU's reference traversal over a tree of one
//! leaf, which tests all triangles.

use std::sync::Arc;

use crate::common;
use splitplane_core::backend::{Accelerator, BuildOptions};
use splitplane_core::config::Preset;
use splitplane_core::ray::{Hit, QueryOptions};
use splitplane_core::triangle::{Triangle, prepare};
use splitplane_cpu::CpuBackend;
use splitplane_test_support::grazing::{Kind, Shape, Surface, Volley};
use splitplane_test_support::surfaces::{
    Asked, OneLeaf, QueryMode, Tally, compare, examine, seed_of, volleys,
};
use splitplane_wgpu::{Queries, WgpuAccelerator};

/// Rays of each kind at a surface, and four times as many from inside.
const EACH: usize = 240;

/// All rays at a surface in one batch for each setting: closest hits and any hit.
fn examine_surface(queries: &Arc<Queries>, surface: &Surface, preset: Preset) -> Tally {
    let mesh = surface.scene.mesh();
    let options = BuildOptions::from(preset.config());
    let built = CpuBackend::new().build_accelerator(&mesh, &options).expect("a tree");
    let (tree, summary) = (built.tree().clone(), *built.summary());
    let triangles: Vec<Triangle> =
        (0..mesh.len()).map(|i| prepare(&mesh.triangle(i)).corners).collect();
    let device = WgpuAccelerator::upload(queries.clone(), tree, triangles.clone(), summary)
        .expect("an upload");
    let one_leaf = OneLeaf::new(&mesh);
    let name = [format!("preset {}", preset.name()), "wgpu".to_owned()];
    let asked = [Asked {
        name: &name,
        accelerator: &device,
        ways: &[QueryMode::Together, QueryMode::AnyTogether],
    }];
    let mut tally = Tally { surfaces: 1, ..Tally::default() };
    // Of rays from inside none may miss; the others go together, whatever else was asked with them.
    let (inside, others): (Vec<Volley>, Vec<Volley>) =
        volleys(surface, EACH).into_iter().partition(Volley::is_held);
    let joined = |volleys: &[Volley], kind: Kind| {
        let rays = volleys.iter().flat_map(|volley| volley.rays.clone()).collect();
        Volley { kind, rays, options: QueryOptions::default() }
    };
    for volley in [joined(&inside, Kind::Inside), joined(&others, Kind::InPlane)] {
        if volley.rays.is_empty() {
            continue;
        }
        let expected = one_leaf.closest(&volley.rays, &volley.options);
        tally.add(examine(surface, &triangles, &volley, &expected, &asked));
        // The check fails where one answer is another.
        let mut wrong = expected.clone();
        let some = wrong.iter().position(Hit::is_hit).expect("a hit");
        wrong[some].u = f32::from_bits(wrong[some].u.to_bits() ^ 1);
        let planted = compare(surface, &volley, &wrong, &asked);
        assert!(planted.closest_hits_agree().is_err(), "{:?}: {planted}", surface.shape);
        wrong[some] = Hit::MISS;
        let planted = compare(surface, &volley, &wrong, &asked);
        assert!(planted.any_hits_agree().is_err(), "{:?}: {planted}", surface.shape);
    }
    tally
}

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn the_device_says_what_one_leaf_says() {
    let queries = Arc::new(Queries::new(common::gpu()));
    let mut total = Tally::default();
    for (number, shape) in Shape::ALL.into_iter().enumerate() {
        // The device builds no trees of preset `best`, but traces them.
        let preset = Preset::ALL[number % Preset::ALL.len()];
        let surface = Surface::new(shape, seed_of(2, number as u64));
        total.add(examine_surface(&queries, &surface, preset));
    }
    assert!(total.rays > 20_000 && total.hits * 2 > total.rays, "{total}");
    for verdict in [total.closest_hits_agree(), total.any_hits_agree(), total.none_is_lost()] {
        verdict.unwrap_or_else(|report| panic!("{report}"));
    }
}
