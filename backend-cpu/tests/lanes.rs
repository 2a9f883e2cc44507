//! Threads keep their lanes between batches; nothing of one tree may reach the next.

use splitplane_core::backend::{Accelerator, BuildOptions};
use splitplane_core::mesh::Mesh;
use splitplane_core::ray::{Hit, QueryOptions, Ray};
use splitplane_core::triangle::Triangle;
use splitplane_cpu::{CpuBackend, InstructionSet};

/// Small triangles all over a cube.
fn soup(count: u32) -> Vec<Triangle> {
    let mut state = count;
    let mut next = move || {
        state = state.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
        (state >> 8) as f32 / 8_388_608.0 - 1.0
    };
    let corner = |next: &mut dyn FnMut() -> f32| [next(), next(), next()];
    (0..count)
        .map(|_| {
            let [a, b, c] = [corner(&mut next), corner(&mut next), corner(&mut next)];
            [a, [0, 1, 2].map(|k| a[k] + 0.1 * b[k]), [0, 1, 2].map(|k| a[k] + 0.1 * c[k])]
        })
        .collect()
}

/// Idle lanes load a node like the others. After a batch over a large tree, theirs may be beyond the
/// end of a small one; with debug assertions every load is checked.
#[test]
fn a_small_tree_after_a_large_one() {
    let scenes = [soup(20_000), soup(100)];
    let rays: Vec<Ray> = (0..400)
        .map(|i| {
            let a = i as f32 * 0.37;
            Ray::new([3.0 * a.cos(), 2.0 * a.sin(), 2.5], [-a.cos(), -0.4 * a.sin(), -0.8])
        })
        .collect();
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    for set in InstructionSet::available() {
        let backend = CpuBackend::with_instruction_set(set);
        // 40 rays leave lanes idle: 48 are in flight.
        for (triangles, count) in [(&scenes[0], 400), (&scenes[1], 40), (&scenes[0], 400)] {
            let mesh = Mesh::soup(triangles).unwrap();
            let rays = &rays[..count];
            pool.install(|| {
                let tree = backend.build_accelerator(&mesh, &BuildOptions::default()).unwrap();
                let options = QueryOptions::default();
                let mut hits = vec![Hit::MISS; rays.len()];
                tree.closest_hits(rays, &mut hits, &options).unwrap();
                for (ray, hit) in rays.iter().zip(&hits) {
                    assert_eq!(tree.closest_hit(ray, &options).unwrap_or(Hit::MISS), *hit);
                }
            });
        }
    }
}
