//! Every path over every instruction set gives the hits of core's reference loop, bit for bit.

use splitplane_core::arithmetic::{Hostile, Strict};
use splitplane_core::backend::{Accelerator, BuildOptions};
use splitplane_core::build::schedule;
use splitplane_core::config::{BuildConfig, Preset};
use splitplane_core::kernel::Buffer;
use splitplane_core::mesh::Mesh;
use splitplane_core::query::traverse;
use splitplane_core::ray::{Accuracy, Culling, Hit, QueryOptions, Ray};
use splitplane_core::triangle::Triangle;
use splitplane_cpu::buffers::Buffers;
use splitplane_cpu::{CpuBackend, CpuExecutor, InstructionSet};
use splitplane_test_support::random::Random;
use splitplane_test_support::{aim, scenes};

/// Rays of all kinds: through the scene, along axes, at corners, from far away, bounded, invalid.
fn rays(triangles: &[Triangle], count: usize, random: &mut Random) -> Vec<Ray> {
    (0..count)
        .map(|i| {
            let origin = random.point(if i % 5 == 0 { 1e5 } else { 6.0 });
            let target = triangles[i * 31 % triangles.len()][i % 3];
            let mut direction = match i % 3 {
                0 => [0, 1, 2].map(|k| target[k] - origin[k]),
                1 => random.point(1.0),
                _ => [0, 1, 2].map(|k| if k == i % 9 / 3 { 1.0 } else { 0.0 }),
            };
            if i % 97 == 0 {
                direction[i % 3] = f32::NAN;
            }
            let ray = Ray::new(origin, direction);
            match i % 4 {
                0 => ray.with_limits(random.signed(), random.signed() * 10.0),
                _ => ray,
            }
        })
        .collect()
}

#[test]
fn every_path_equals_the_reference() {
    let mut random = Random::new(1);
    let mut hit_something = 0;
    for (count, width, scale) in
        [(1, 16, 1.0), (40, 16, 1.0), (3000, 16, 1.0), (3000, 1, 1.0), (500, 16, 1e20)]
    {
        let scene = scenes::medley(count, 0.4, (count as u64) * u64::from(width));
        let mut rays = rays(&scene.triangles(), 700, &mut random);
        // With half of the directions `t` is about 1, and limits count.
        for (i, ray) in rays.iter_mut().enumerate() {
            ray.origin = ray.origin.map(|x| x * scale);
            if i % 2 == 0 {
                ray.direction = ray.direction.map(|x| x * scale);
            }
        }
        let scene = scenes::scaled(&scene, scale, "scaled");
        let mesh = scene.mesh();
        rays.extend(aim::pictures(&mesh, 6, [32, 24], 1));
        let config = BuildConfig { block_width: width, ..BuildConfig::default() };
        for set in InstructionSet::available() {
            let backend = CpuBackend::with_instruction_set(set);
            let built = backend.build_accelerator(&mesh, &BuildOptions::from(config)).unwrap();
            let tree = built.tree().view();
            for (accuracy, culling, ignore) in [
                (Accuracy::Watertight, Culling::None, None),
                (Accuracy::Watertight, Culling::Back, Some(7)),
                (Accuracy::Fast, Culling::Front, None),
            ] {
                let options = QueryOptions { accuracy, culling, ignore, ..Default::default() };
                let expected: Vec<Hit> = rays
                    .iter()
                    .map(|ray| {
                        let scene = built.scene_scale();
                        let hit = traverse::closest_hit(&tree, &mesh, scene, ray, &options);
                        hit.unwrap_or(Hit::MISS)
                    })
                    .collect();
                hit_something += expected.iter().filter(|hit| hit.is_hit()).count();
                let mut hits = vec![Hit::MISS; rays.len()];
                built.closest_hits(&rays, &mut hits, &options).unwrap();
                assert_eq!(hits, expected, "{set:?} {options:?} batch");
                built.closest_hits_singly(&rays, &mut hits, &options).unwrap();
                assert_eq!(hits, expected, "{set:?} {options:?} singly");
                let any: Vec<bool> = expected.iter().map(Hit::is_hit).collect();
                let mut found = vec![false; rays.len()];
                built.any_hits(&rays, &mut found, &options).unwrap();
                assert_eq!(found, any, "{set:?} {options:?} any");
                built.any_hits_singly(&rays, &mut found, &options).unwrap();
                assert_eq!(found, any, "{set:?} {options:?} any singly");
            }
        }
    }
    assert!(hit_something > 5000, "{hit_something}");
}

/// The same tree whatever the instruction set of the small-node stage.
#[test]
fn every_instruction_set_builds_the_same_tree() {
    let scene = scenes::medley(5000, 0.4, 9);
    let mesh = scene.mesh();
    for (width, preset) in [1, 3, 16].into_iter().flat_map(|w| Preset::ALL.map(|p| (w, p))) {
        if preset.planes().is_none() {
            continue;
        }
        let config = BuildConfig { block_width: width, ..preset.into() };
        let digests: Vec<_> = InstructionSet::available()
            .into_iter()
            .map(|set| {
                let backend = CpuBackend::with_instruction_set(set);
                backend.build_tree(&mesh, &BuildOptions::from(config)).unwrap().0.digest()
            })
            .collect();
        assert!(digests.windows(2).all(|pair| pair[0] == pair[1]), "{digests:?}");
    }
}

/// A device that fuses, moves free results by a float or two and flushes subnormals changes neither
/// digest nor hits. Random soups at ordinary and at extreme scales, among them coordinates next to the subnormals.
#[test]
fn a_hostile_device_changes_neither_digest_nor_hits() {
    let mut random = Random::new(5);
    let mut hits = 0;
    for (seed, scale) in [1.0f32, 1e-30, 1e-36, 1e-37, 1e30, 3e37].into_iter().enumerate() {
        let mut triangles = scenes::medley(2000, 0.4, seed as u64).triangles();
        for corner in triangles.as_flattened_mut() {
            *corner = corner.map(|x| x * scale);
        }
        let mesh = Mesh::soup(&triangles).unwrap();
        let backend = CpuBackend::new();
        let build = |config| backend.build_accelerator(&mesh, &BuildOptions::from(config)).unwrap();
        for preset in [Preset::Balanced, Preset::Fast] {
            let config = preset.config();
            let strict = build(config);
            let tree = strict.tree();
            for set in InstructionSet::available() {
                let buffers = Buffers::default();
                let mut executor: CpuExecutor<'_, Hostile> =
                    CpuExecutor::new(mesh, config, set, buffers, None).unwrap();
                schedule::build(&mut executor, preset.planes().unwrap()).unwrap();
                let live = |buffer| executor.live(buffer).unwrap().to_vec();
                let nodes: &[u8] = bytemuck::cast_slice(&tree.nodes);
                let references: &[u8] = bytemuck::cast_slice(&tree.references);
                assert_eq!(live(Buffer::Nodes), nodes, "{scale} {preset:?}");
                assert_eq!(live(Buffer::LeafReferences), references, "{scale} {preset:?}");
            }
        }
        let strict = build(BuildConfig::default());
        let mut rays = rays(&triangles, 2000, &mut random);
        // With half of the directions `t` is about 1, and limits count.
        for (i, ray) in rays.iter_mut().enumerate() {
            ray.origin = ray.origin.map(|x| x * scale);
            if i % 2 == 0 {
                ray.direction = ray.direction.map(|x| x * scale);
            }
        }
        let tree = strict.tree().view();
        let scene = strict.scene_scale();
        let options = QueryOptions::default();
        for ray in &rays {
            let trace = |hostile: bool| {
                let query = traverse::Query::Closest;
                if hostile {
                    traverse::trace::<Hostile>(&tree, &mesh, scene, ray, &options, query)
                } else {
                    traverse::trace::<Strict>(&tree, &mesh, scene, ray, &options, query)
                }
            };
            let expected = trace(false);
            assert_eq!(trace(true), expected, "{scale} {ray:?}");
            hits += usize::from(expected.is_hit());
        }
    }
    assert!(hits > 2000, "{hits}");
}
