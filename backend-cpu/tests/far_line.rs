//! Triangles on a line far out, where two neighbouring floats are further apart than all the triangles are wide: boxes that are widened there are beyond
//! all numbers when they are measured by the size of the scene.

use splitplane_core::backend::{Accelerator, BuildOptions, QueryLayout};
use splitplane_core::config::{BuildConfig, Preset};
use splitplane_core::mesh::Mesh;
use splitplane_core::ray::{Hit, QueryOptions, Ray};
use splitplane_core::triangle::Triangle;
use splitplane_cpu::{CpuBackend, InstructionSet};
use splitplane_test_support::random::Random;
use splitplane_test_support::surfaces::OneLeaf;

/// Triangles along x, of `width`, at a distance of `far` on other axes, on which they are flat or as thick as one float.
fn line(count: usize, width: f64, far: f32, is_thick: bool) -> Vec<Triangle> {
    let mut random = Random::new(5);
    let above = if is_thick { far.next_up() } else { far };
    (0..count)
        .map(|_| {
            let x = random.between(-5.0, 6.0) * width;
            [(far, -far), (above, -far), (far, -above)]
                .map(|(y, z)| [(x + random.between(0.0, 0.3) * width) as f32, y, z])
        })
        .collect()
}

#[test]
fn triangles_on_a_line_far_out_are_built_and_hit() {
    let mut random = Random::new(6);
    let (mut met, mut built) = (0, 0);
    for (width, far, is_thick) in [
        (1.0, 4.5e33, false),
        (1.0, 4.5e33, true),
        (1e-30, 2.6e33, false),
        (1e-30, 1e5, true),
        (1e-38, 3e38, false),
        (1.0, 1e25, true),
    ] {
        let triangles = line(300, width, far, is_thick);
        let mesh = Mesh::soup(&triangles).expect("a mesh");
        let rays: Vec<Ray> = (0..200)
            .map(|number| {
                let [a, b, c] = triangles[number];
                let weights = [random.unit(), random.unit(), random.unit()];
                let sum: f64 = weights.iter().sum();
                let target = [0, 1, 2].map(|k| {
                    let corners = [a[k], b[k], c[k]].map(f64::from);
                    corners.iter().zip(weights).map(|(x, w)| x * w / sum).sum::<f64>() as f32
                });
                match number % 2 {
                    0 => Ray::new([target[0], 0.0, 0.0], [0.0, target[1], target[2]]),
                    _ => Ray::new([0.0, target[1], target[2]], [target[0], 0.0, 0.0]),
                }
            })
            .collect();
        let options = QueryOptions::default();
        let expected = OneLeaf::new(&mesh).closest(&rays, &options);
        met += expected.iter().filter(|hit| hit.is_hit()).count();
        let narrow = BuildConfig { block_width: 1, ..Preset::Fast.config() };
        let configs = Preset::ALL.map(|preset| preset.config()).into_iter().chain([narrow]);
        for config in configs {
            for (set, layout) in InstructionSet::available()
                .into_iter()
                .flat_map(|set| [QueryLayout::Fast, QueryLayout::Compact].map(|l| (set, l)))
            {
                let what = format!("{width:e} {far:e} {is_thick}, {set:?}, {layout:?}, {config:?}");
                let build = BuildOptions { layout, ..config.into() };
                let tree = CpuBackend::with_instruction_set(set)
                    .build_accelerator(&mesh, &build)
                    .expect("a tree");
                let mut hits = vec![Hit::MISS; rays.len()];
                tree.closest_hits(&rays, &mut hits, &options).expect("equal lengths");
                let bits = |hits: &[Hit]| -> Vec<[u32; 4]> { bytemuck::cast_slice(hits).to_vec() };
                assert!(bits(&hits) == bits(&expected), "{what}");
                built += 1;
            }
        }
    }
    assert!(met > 100 && built > 50, "{met} {built}");
}
