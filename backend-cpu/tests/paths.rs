//! Every path over every instruction set gives the hits of core's reference loop, bit for bit.

use splitplane_core::arithmetic::{Hostile, Strict};
use splitplane_core::backend::{Accelerator, BuildOptions};
use splitplane_core::config::{BuildConfig, Preset};
use splitplane_core::kernel::Buffer;
use splitplane_core::mesh::Mesh;
use splitplane_core::ray::{Accuracy, Culling, Hit, QueryOptions, Ray};
use splitplane_core::schedule;
use splitplane_core::traverse;
use splitplane_core::triangle::Triangle;
use splitplane_cpu::buffers::Buffers;
use splitplane_cpu::{CpuBackend, CpuExecutor, InstructionSet};

/// PCG-like numbers in `[-1, 1)`.
struct Numbers(u32);

impl Numbers {
    fn next(&mut self) -> f32 {
        self.0 = self.0.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
        (self.0 >> 8) as f32 / 8_388_608.0 - 1.0
    }

    fn point(&mut self, spread: f32) -> [f32; 3] {
        [self.next() * spread, self.next() * spread, self.next() * spread]
    }
}

/// Small triangles, a few large ones, some duplicates, some flat along an axis.
fn soup(count: usize, numbers: &mut Numbers) -> Vec<Triangle> {
    let mut triangles: Vec<Triangle> = (0..count)
        .map(|i| {
            let centre = numbers.point(5.0);
            let size = if i % 50 == 0 { 8.0 } else { 0.4 };
            let mut corners = [(); 3].map(|()| {
                let offset = numbers.point(size);
                [0, 1, 2].map(|k| centre[k] + offset[k])
            });
            if i % 7 == 0 {
                for corner in &mut corners {
                    corner[i % 3] = centre[i % 3];
                }
            }
            corners
        })
        .collect();
    for i in 0..count / 20 {
        triangles.push(triangles[i * 3]);
    }
    triangles
}

/// Rays of all kinds: through the scene, along axes, at corners, from far away, bounded, invalid.
fn rays(triangles: &[Triangle], count: usize, numbers: &mut Numbers) -> Vec<Ray> {
    (0..count)
        .map(|i| {
            let origin = numbers.point(if i % 5 == 0 { 1e5 } else { 6.0 });
            let target = triangles[i * 31 % triangles.len()][i % 3];
            let mut direction = match i % 3 {
                0 => [0, 1, 2].map(|k| target[k] - origin[k]),
                1 => numbers.point(1.0),
                _ => [0, 1, 2].map(|k| if k == i % 9 / 3 { 1.0 } else { 0.0 }),
            };
            if i % 97 == 0 {
                direction[i % 3] = f32::NAN;
            }
            let ray = Ray::new(origin, direction);
            match i % 4 {
                0 => ray.with_limits(numbers.next(), numbers.next() * 10.0),
                _ => ray,
            }
        })
        .collect()
}

/// Rays through a grid of pixels, and from where they meet a sphere to one light: coherent, so that
/// they are traced as packets.
fn coherent_rays(numbers: &mut Numbers) -> Vec<Ray> {
    let mut rays = Vec::new();
    for view in 0..6 {
        let eye = numbers.point(9.0);
        let towards =
            [0, 1, 2].map(|k| if k == view % 3 { -eye[k] } else { numbers.next() - eye[k] });
        for pixel in 0..24 * 32 {
            let (x, y) = ((pixel % 32) as f32 / 80.0 - 0.2, (pixel / 32) as f32 / 80.0 - 0.15);
            let mut direction = towards.map(|d| d / 9.0);
            direction[(view + 1) % 3] += x;
            direction[(view + 2) % 3] += y;
            let ray = Ray::new(eye, direction);
            rays.push(if view == 5 { ray.with_limits(0.3, 1.2) } else { ray });
            let start = [0, 1, 2].map(|k| eye[k] + 0.7 * direction[k] * 9.0);
            rays.push(Ray::segment(start, [4.0, 5.0, 3.0]));
        }
    }
    // Neighbours of one kind side by side.
    let (views, shadows): (Vec<_>, Vec<_>) = rays.iter().enumerate().partition(|(i, _)| i % 2 == 0);
    views.into_iter().chain(shadows).map(|(_, ray)| *ray).collect()
}

#[test]
fn every_path_equals_the_reference() {
    let mut numbers = Numbers(1);
    let mut hit_something = 0;
    for (count, width, scale) in
        [(1, 16, 1.0), (40, 16, 1.0), (3000, 16, 1.0), (3000, 1, 1.0), (500, 16, 1e20)]
    {
        let triangles: Vec<Triangle> = soup(count, &mut numbers)
            .iter()
            .map(|t| t.map(|corner| corner.map(|x| x * scale)))
            .collect();
        let mut rays = rays(&triangles, 700, &mut numbers);
        rays.extend(coherent_rays(&mut numbers));
        for ray in &mut rays {
            ray.origin = ray.origin.map(|x| x * scale);
        }
        let mesh = Mesh::soup(&triangles).unwrap();
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
    let triangles = soup(5000, &mut Numbers(9));
    let mesh = Mesh::soup(&triangles).unwrap();
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
    let mut numbers = Numbers(5);
    let mut hits = 0;
    for scale in [1.0f32, 1e-30, 1e-36, 1e-37, 1e30, 3e37] {
        let mut triangles = soup(2000, &mut numbers);
        for corner in triangles.as_flattened_mut() {
            *corner = corner.map(|x| x * scale);
        }
        let mesh = Mesh::soup(&triangles).unwrap();
        let backend = CpuBackend::new();
        let build = |config| backend.build_accelerator(&mesh, &BuildOptions::from(config)).unwrap();
        for preset in [Preset::Balanced, Preset::Fast] {
            let config = BuildConfig::preset(preset);
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
        let mut rays = rays(&triangles, 2000, &mut numbers);
        for ray in &mut rays {
            ray.origin = ray.origin.map(|x| x * scale);
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
