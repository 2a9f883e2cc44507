//! Threads keep the memory of rays under way between batches; nothing of one tree may reach the next.

use splitplane_core::aabb::Aabb;
use splitplane_core::backend::{Accelerator, Backend, BuildOptions, QueryLayout};
use splitplane_core::config::BuildConfig;
use splitplane_core::mesh::Mesh;
use splitplane_core::ray::{Accuracy, Hit, QueryOptions, Ray, Rays};
use splitplane_core::tree::KdTree;
use splitplane_core::tree::node::KdNode;
use splitplane_core::triangle::Triangle;
use splitplane_cpu::{CpuBackend, InstructionSet};
use splitplane_test_support::random::Random;

/// Small triangles all over a cube.
fn soup(count: u32) -> Vec<Triangle> {
    let mut random = Random::new(count.into());
    (0..count)
        .map(|_| {
            let [a, b, c] = [random.point(1.0), random.point(0.1), random.point(0.1)];
            [a, [0, 1, 2].map(|k| a[k] + b[k]), [0, 1, 2].map(|k| a[k] + c[k])]
        })
        .collect()
}

/// After a batch over a large tree, what threads keep names nodes beyond the end of a small one.
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
        // With 10 rays, fewer are under way than the capacity allows.
        for (triangles, count) in [(&scenes[0], 400), (&scenes[1], 10), (&scenes[0], 400)] {
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

/// Rays in pairs side by side and all about, so that packets and single rays take turns.
fn rays(count: usize) -> Vec<Ray> {
    (0..count)
        .map(|i| {
            let a = (i / 24) as f32 * 1.7;
            let b = (i % 24) as f32 * if i / 24 % 2 == 0 { 0.01 } else { 0.9 };
            let origin = [3.0 * a.cos(), 2.0 * a.sin(), 2.5];
            let ray = Ray::new(origin, [-a.cos() + 0.3 * b.sin(), -0.4 * a.sin() + 0.2 * b, -0.8]);
            if i % 11 == 3 { ray.with_limits(1.0, 3.0) } else { ray }
        })
        .collect()
}

/// However a batch is cut, and whichever thread traces it.
#[test]
fn batches_of_all_lengths_give_what_single_rays_give() {
    let triangles = soup(3_000);
    let mesh = Mesh::soup(&triangles).unwrap();
    let rays = rays(9_000);
    for set in InstructionSet::available() {
        let backend = CpuBackend::with_instruction_set(set);
        let tree = backend.build_accelerator(&mesh, &BuildOptions::default()).unwrap();
        let options = QueryOptions::default();
        let single: Vec<Hit> =
            rays.iter().map(|ray| tree.closest_hit(ray, &options).unwrap_or(Hit::MISS)).collect();
        assert!(single.iter().filter(|hit| hit.is_hit()).count() > 1_000);
        for threads in [1, 2, 4] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let lengths = (0..=40).chain([4_095, 4_096, 4_097, 9_000]);
            for (turn, count) in lengths.enumerate() {
                let first = turn * 131 % (rays.len() - count + 1);
                let (some, expected) = (&rays[first..][..count], &single[first..][..count]);
                let mut hits = vec![Hit::MISS; count];
                let mut any = vec![false; count];
                pool.install(|| {
                    tree.closest_hits(some, &mut hits, &options).unwrap();
                    tree.any_hits(some, &mut any, &options).unwrap();
                });
                assert_eq!(hits, expected, "{set:?}, {threads} threads, {count} rays");
                assert!(any.iter().zip(expected).all(|(&any, hit)| any == hit.is_hit()));
            }
        }
    }
}

/// Trees that no build makes, but files may bring: a leaf without triangles in bounds that are not
/// empty, and bounds far wider than the triangles.
#[test]
fn odd_trees_are_traced_like_others() {
    let triangles = soup(9);
    let nothing: [Triangle; 0] = [];
    let config = BuildConfig::default();
    let most = f32::MAX;
    let bounds = |x: f32| Aabb { lo: [-x; 3], hi: [x; 3] };
    let rays: Vec<Ray> = (0..64)
        .map(|i| {
            let mut direction = [[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, 1.0]][i % 3];
            if i % 2 == 0 {
                direction[(i + 1) % 3] = 0.3;
            }
            let corner = triangles[i % 9][0];
            Ray::new([0, 1, 2].map(|k| corner[k] - 2.0 * direction[k] + 0.01), direction)
        })
        .collect();
    for set in InstructionSet::available() {
        let backend = CpuBackend::with_instruction_set(set);
        for layout in [QueryLayout::Fast, QueryLayout::Compact] {
            let options = BuildOptions { layout, ..BuildOptions::from(config) };
            let root = |count: u32, bounds: Aabb| KdTree {
                nodes: vec![KdNode::leaf(0, count)],
                references: (0..count).collect(),
                bounds,
                triangles: count,
                config,
            };
            let mesh = Mesh::soup(&nothing).unwrap();
            let empty = backend.load(&mesh, root(0, bounds(1.0)), &options.for_loading()).unwrap();
            let mesh = Mesh::soup(&triangles).unwrap();
            let tight = backend.load(&mesh, root(9, bounds(3.0)), &options.for_loading()).unwrap();
            let wide = backend.load(&mesh, root(9, bounds(most)), &options.for_loading()).unwrap();
            let query = QueryOptions::default();
            let trace = |tree: &dyn Accelerator| {
                let mut hits = vec![Hit::MISS; rays.len()];
                tree.closest_hits(&rays, &mut hits, &query).unwrap();
                for (ray, hit) in rays.iter().zip(&hits) {
                    assert_eq!(tree.closest_hit(ray, &query).unwrap_or(Hit::MISS), *hit);
                }
                hits
            };
            assert!(trace(empty.as_ref()).iter().all(|hit| !hit.is_hit()));
            let (tight, wide) = (trace(tight.as_ref()), trace(wide.as_ref()));
            assert!(tight.iter().any(Hit::is_hit));
            let found = |hits: &[Hit]| hits.iter().map(|hit| hit.triangle).collect::<Vec<_>>();
            assert_eq!(found(&tight), found(&wide), "{set:?} {layout:?}");
        }
    }
}

/// Rows of six numbers: the same bits as their records, for batches of all lengths, layouts and accuracies.
#[test]
fn rows_give_what_their_records_give() {
    let triangles = soup(2_000);
    let mesh = Mesh::soup(&triangles).unwrap();
    let mut rows: Vec<[f32; 6]> = rays(9_001)
        .iter()
        .map(|Ray { origin: [a, b, c], direction: [x, y, z], .. }| [*a, *b, *c, *x, *y, *z])
        .collect();
    // Some that vectors leave to other code, and some that hit nothing.
    for (place, row) in rows.iter_mut().enumerate() {
        match place % 97 {
            5 => *row = row.map(|number| number * 1e9),
            17 => row[3..].iter_mut().for_each(|number| *number *= 1e-39),
            31 => row[place % 6] = f32::NAN,
            47 => row[3..].fill(0.0),
            _ => {}
        }
    }
    for set in InstructionSet::available() {
        let backend = CpuBackend::with_instruction_set(set);
        for layout in [QueryLayout::Fast, QueryLayout::Compact] {
            let options = BuildOptions { layout, ..BuildOptions::default() };
            let tree = backend.build_accelerator(&mesh, &options).unwrap();
            for accuracy in Accuracy::ALL {
                let options = QueryOptions { accuracy, ..QueryOptions::default() };
                let limits = [(0.0, f32::INFINITY), (1.0, 3.0)];
                for ((t_min, t_max), count) in limits.into_iter().zip([rows.len(), 4_127]) {
                    let given = Rays::Rows { rows: &rows, t_min, t_max }.part(0..count);
                    let records: Vec<Ray> = (0..count).map(|place| given.ray(place)).collect();
                    let (mut own, mut expected) = (vec![Hit::MISS; count], vec![Hit::MISS; count]);
                    tree.closest_hits_of(given, &mut own, &options).unwrap();
                    tree.closest_hits(&records, &mut expected, &options).unwrap();
                    assert!(own == expected, "{set:?} {layout:?} {accuracy:?} {count}");
                    let hits = expected.iter().filter(|hit| hit.is_hit()).count();
                    assert!(hits > 200 && hits < count - 200, "{hits} of {count}");
                    let (mut own, mut expected) = (vec![false; count], vec![true; count]);
                    tree.any_hits_of(given, &mut own, &options).unwrap();
                    tree.any_hits(&records, &mut expected, &options).unwrap();
                    assert!(own == expected, "{set:?} {layout:?} {accuracy:?} {count}");
                }
            }
        }
    }
}
