//! Blocks share corners or have them written out, by the mesh. The answers are those of a tree of one leaf, of whole numbers and of brute
//! force, bit for bit, on every path of every instruction set.

use crate::common::bits;
use rayon::prelude::*;
use splitplane_core::aabb::Aabb;
use splitplane_core::backend::{Accelerator, Backend, BuildOptions, QueryLayout};
use splitplane_core::config::Preset;
use splitplane_core::mesh::Mesh;
use splitplane_core::query::all_hits::AllHitsOptions;
use splitplane_core::query::cast::{Cast, CastOptions, Impact};
use splitplane_core::query::closest_point::{ClosestPoint, ClosestPointOptions};
use splitplane_core::query::inside::LocateOptions;
use splitplane_core::query::overlap::{OverlapOptions, Volume};
use splitplane_core::query::traverse::exact;
use splitplane_core::ray::{Accuracy, Culling, Hit, QueryOptions, Ray, Rays};
use splitplane_core::scene::{Instance, Scene, SceneHit, SceneOptions, translation};
use splitplane_core::triangle::Triangle;
use splitplane_cpu::testing::writes_corners_out;
use splitplane_cpu::{CpuAccelerator, CpuBackend, InstructionSet};
use splitplane_test_support::aim::{self, Kind};
use splitplane_test_support::near;
use splitplane_test_support::objects;
use splitplane_test_support::random::Random;
use splitplane_test_support::scenes;
use splitplane_test_support::surfaces::OneLeaf;

/// Whether blocks for a set may have their corners written out.
fn writes_out(set: InstructionSet) -> bool {
    matches!(set, InstructionSet::Avx2 | InstructionSet::Neon)
}

/// Triangles of a surface, each moved along a direction of its own, a little: none shares a corner with another.
fn exploded(triangles: &[Triangle], seed: u64) -> Vec<Triangle> {
    let mut random = Random::new(seed);
    triangles
        .iter()
        .map(|corners| {
            let away = random.point(0.02);
            corners.map(|corner| [0, 1, 2].map(|k| corner[k] + away[k]))
        })
        .collect()
}

fn sphere() -> Vec<Triangle> {
    scenes::sphere(16, [0.0; 3], 1.0).triangles()
}

/// Slivers and needles apart, and among them what no leaf names: triangles without area and with what is no number.
fn degenerate() -> Vec<Triangle> {
    let mut random = Random::new(9);
    let mut all = scenes::needles(120).triangles();
    all.extend((0..400).map(|_| {
        let (at, along) = (random.point(1.0), random.point(0.4));
        let off = random.point(1e-5);
        let to = [0, 1, 2].map(|k| at[k] + along[k]);
        [at, to, [0, 1, 2].map(|k| to[k] + off[k])]
    }));
    for place in 0..40 {
        let at = random.point(1.0);
        all.insert(11 * place, [at, at, random.point(1.0)]);
        all.insert(11 * place + 5, [[f32::NAN, 0.0, 1.0], at, [f32::INFINITY; 3]]);
    }
    all
}

/// A mesh, and whether sets of eight lanes write its corners out.
struct Sample {
    name: String,
    triangles: Vec<Triangle>,
    written: bool,
}

fn samples() -> Vec<Sample> {
    let sample = |name: &str, triangles: Vec<Triangle>, written| {
        let name = name.to_owned();
        Sample { name, triangles, written }
    };
    let soup = |count| scenes::soup(count, 0.2, 5).triangles();
    let beside = |mut triangles: Vec<Triangle>| {
        triangles.as_flattened_mut().iter_mut().for_each(|corner| corner[0] += 3.0);
        triangles
    };
    let mut all = vec![
        sample("sphere", sphere(), false),
        sample("exploded sphere", exploded(&sphere(), 1), true),
        sample("soup", soup(900), true),
        sample("degenerate", degenerate(), true),
        // Parts that share corners and parts that do not: blocks of one mesh are all alike.
        sample("half and half", [sphere(), beside(exploded(&sphere(), 2))].concat(), false),
        sample("hardly a pair", [beside(soup(2_000)), sphere()[..20].to_vec()].concat(), true),
        // Blocks of large triangles, of both kinds.
        sample("giants", scenes::giants().triangles(), true),
    ];
    for count in [1, 7, 8, 9, 31, 400] {
        let triangles = soup(count);
        all.push(sample(&format!("soup of {count}"), triangles, count == 400));
    }
    all
}

fn rays(mesh: &Mesh<'_>) -> Vec<Ray> {
    let mut all: Vec<Ray> =
        Kind::ALL.iter().flat_map(|&kind| aim::rays(mesh, kind, 130, 3)).collect();
    // Wide ones, with limits and with zeros; and neighbours, which go as packets.
    all.extend(aim::odd(&all[..300], 4));
    for (from, size) in [(0.5, 0.03), (-0.5, 0.09)] {
        all.extend((0..24 * 24).map(|i| {
            let to = [0, 1].map(|k| (f64::from([i % 24, i / 24][k]) - 12.0) * size);
            aim::aimed([from, 0.25, 9.0], [to[0] + 0.4, to[1] + 0.4, 0.0])
        }));
    }
    all
}

fn built(triangles: &[Triangle], set: InstructionSet, build: &BuildOptions<'_>) -> CpuAccelerator {
    let mesh = Mesh::soup(triangles).expect("a mesh");
    CpuBackend::with_instruction_set(set).build_accelerator(&mesh, build).expect("a tree")
}

/// The closest hits, by a tree of one leaf.
fn expected(triangles: &[Triangle], rays: &[Ray], options: &QueryOptions<'_>) -> Vec<Hit> {
    let one_leaf = OneLeaf::new(&Mesh::soup(triangles).expect("a mesh"));
    if options.accuracy != Accuracy::Exact {
        return one_leaf.closest(rays, options);
    }
    let tree = one_leaf.tree.view();
    let hit = |ray| exact::closest_hit(&tree, triangles, ray, options).unwrap_or(Hit::MISS);
    rays.iter().map(hit).collect()
}

/// The first way of asking that gives other hits than these.
fn fault(
    tree: &CpuAccelerator,
    rays: &[Ray],
    options: &QueryOptions<'_>,
    expected: &[Hit],
) -> Option<&'static str> {
    let is_hit: Vec<bool> = expected.iter().map(Hit::is_hit).collect();
    let (mut hits, mut any) = (vec![Hit::MISS; rays.len()], vec![false; rays.len()]);
    tree.closest_hits(rays, &mut hits, options).expect("equal lengths");
    if bits(&hits) != bits(expected) {
        return Some("batch");
    }
    tree.closest_hits_singly(rays, &mut hits, options).expect("equal lengths");
    if bits(&hits) != bits(expected) {
        return Some("singly");
    }
    tree.any_hits(rays, &mut any, options).expect("equal lengths");
    if any != is_hit {
        return Some("any");
    }
    tree.any_hits_singly(rays, &mut any, options).expect("equal lengths");
    if any != is_hit {
        return Some("any singly");
    }
    for (ray, hit) in rays.iter().zip(expected) {
        if bits(&[tree.closest_hit(ray, options).unwrap_or(Hit::MISS)]) != bits(&[*hit]) {
            return Some("one ray");
        }
        if tree.any_hit(ray, options) != hit.is_hit() {
            return Some("any of one ray");
        }
    }
    // One after the other, so that no two rays are a packet.
    for (ray, hit) in rays.iter().zip(expected).step_by(7) {
        tree.closest_hits(&[*ray], &mut hits[..1], options).expect("equal lengths");
        if bits(&hits[..1]) != bits(&[*hit]) {
            return Some("batch of one");
        }
    }
    None
}

#[test]
fn rays_hit_what_they_hit_in_one_leaf() {
    let asked = [
        (Accuracy::Watertight, Culling::None, None),
        (Accuracy::Watertight, Culling::Back, Some(3)),
        (Accuracy::Fast, Culling::None, None),
        (Accuracy::Fast, Culling::Front, Some(5)),
        (Accuracy::Exact, Culling::None, None),
        (Accuracy::Exact, Culling::Front, Some(0)),
    ];
    let found: usize = samples()
        .into_par_iter()
        .map(|Sample { name, triangles, written }| {
            let rays = rays(&Mesh::soup(&triangles).expect("a mesh"));
            let mut found = 0;
            for (accuracy, culling, ignore) in asked {
                let options = QueryOptions { accuracy, culling, ignore, ..QueryOptions::default() };
                let expected = expected(&triangles, &rays, &options);
                found += expected.iter().filter(|hit| hit.is_hit()).count();
                for preset in [Preset::Fast, Preset::Best] {
                    for set in InstructionSet::available() {
                        let tree = built(&triangles, set, &preset.config().into());
                        let what = format!("{name}, {preset:?}, {set:?}, {options:?}");
                        let expected_kind = written && writes_out(set);
                        assert_eq!(writes_corners_out(&tree), expected_kind, "{what}");
                        assert_eq!(fault(&tree, &rays, &options, &expected), None, "{what}");
                    }
                }
            }
            found
        })
        .sum();
    assert!(found > 40_000, "{found}");
}

/// Rows of six numbers, which are prepared by other code.
#[test]
fn rows_hit_what_records_hit() {
    let triangles = exploded(&sphere(), 1);
    let rays = rays(&Mesh::soup(&triangles).expect("a mesh"));
    let row = |ray: &Ray| {
        let ([a, b, c], [x, y, z]) = (ray.origin, ray.direction);
        [a, b, c, x, y, z]
    };
    let rows: Vec<[f32; 6]> = rays.iter().map(row).collect();
    let given = Rays::Rows { rows: &rows, t_min: 0.0, t_max: f32::INFINITY };
    let records: Vec<Ray> = (0..rows.len()).map(|place| given.ray(place)).collect();
    for set in InstructionSet::available() {
        let tree = built(&triangles, set, &BuildOptions::default());
        for accuracy in Accuracy::ALL {
            let options = QueryOptions { accuracy, ..QueryOptions::default() };
            let expected = expected(&triangles, &records, &options);
            let mut hits = vec![Hit::MISS; rows.len()];
            tree.closest_hits_of(given, &mut hits, &options).expect("equal lengths");
            assert!(bits(&hits) == bits(&expected), "{set:?} {accuracy:?}");
        }
    }
}

#[test]
fn closest_points_are_those_of_brute_force() {
    let mut found = 0;
    for Sample { name, triangles, .. } in samples() {
        let mesh = Mesh::soup(&triangles).expect("a mesh");
        let mut random = Random::new(6);
        let mut points: Vec<[f32; 3]> = (0..60).map(|_| random.point(2.0)).collect();
        points.extend(triangles.iter().step_by(triangles.len() / 30 + 1).map(|t| t[1]));
        let near = ClosestPointOptions { max_distance: 0.3, ignore: Some(2), ..Default::default() };
        for options in [ClosestPointOptions::default(), near] {
            let expected: Vec<ClosestPoint> =
                points.iter().map(|&point| near::closest_point(&mesh, point, &options)).collect();
            for set in InstructionSet::available() {
                let tree = built(&triangles, set, &BuildOptions::default());
                let mut closest = vec![ClosestPoint::NONE; points.len()];
                tree.closest_points(&points, &mut closest, &options).expect("equal lengths");
                for (own, expected) in closest.iter().zip(&expected) {
                    let same = own.distance_squared.to_bits()
                        == expected.distance_squared.to_bits()
                        && own.point.map(f32::to_bits) == expected.point.map(f32::to_bits)
                        && own.triangle == expected.triangle;
                    assert!(same, "{name} {set:?}: {own:?} in place of {expected:?}");
                    found += usize::from(own.is_some());
                }
            }
        }
    }
    assert!(found > 2_000, "{found}");
}

/// Questions that walk the tree's own nodes or its cells, against the compact layout, which has no blocks.
#[test]
fn other_questions_have_the_answers_of_the_layout_without_blocks() {
    for Sample { name, triangles, .. } in samples() {
        let rays = &rays(&Mesh::soup(&triangles).expect("a mesh"))[..900];
        let mut random = Random::new(8);
        let finite: Vec<[f32; 3]> = triangles
            .as_flattened()
            .iter()
            .filter(|p| p.iter().all(|x| x.is_finite()))
            .copied()
            .collect();
        // Beside the triangles, wherever they are.
        let mut point = |reach: f32| {
            let (at, off) = (random.pick(&finite), random.point(reach));
            [0, 1, 2].map(|k| at[k] + off[k])
        };
        let points: Vec<[f32; 3]> = (0..80).map(|_| point(0.4)).collect();
        let mut volumes = Vec::new();
        let mut casts = Vec::new();
        for number in 0..40 {
            let [a, b, c] = [point(0.3), point(0.3), point(0.3)];
            volumes.push(Volume::Box(Aabb::of_points(&[a, b])));
            volumes.push(Volume::Ball { centre: a, radius: 0.3 });
            volumes.push(Volume::Capsule { from: a, to: b, radius: 0.1 });
            volumes.push(Volume::Triangle([a, b, c]));
            let to = |from: [f32; 3], to: [f32; 3]| [0, 1, 2].map(|k| to[k] - from[k]);
            let ray = Ray::new(point(3.0), to(a, b));
            let axis = if number % 2 == 0 { [0.0; 3] } else { to(b, c).map(|x| 0.1 * x) };
            casts.push(Cast { ray, axis, radius: 0.05 });
        }
        let ask = |set, layout| {
            let tree = built(&triangles, set, &BuildOptions { layout, ..Default::default() });
            let all = tree.all_hits(rays, &AllHitsOptions::default()).expect("memory");
            let located = tree.locate(&points, &LocateOptions::default()).expect("memory");
            let overlaps = tree.overlaps(&volumes, &OverlapOptions::default()).expect("memory");
            let mut meets = vec![false; volumes.len()];
            tree.overlaps_any(&volumes, &mut meets, &OverlapOptions::default()).expect("memory");
            let mut impacts = vec![Impact::NONE; casts.len()];
            tree.impacts(&casts, &mut impacts, &CastOptions::default()).expect("memory");
            let impacts: Vec<_> = impacts.iter().map(|i| (i.t.to_bits(), i.triangle)).collect();
            let crossings = format!("{:?}", all.crossings);
            let found = [all.crossings.len(), overlaps.triangles.len()];
            let lists = (all.starts, overlaps.starts, overlaps.triangles);
            (found, (crossings, lists, located.windings, meets, impacts))
        };
        for set in InstructionSet::available() {
            let (found, own) = ask(set, QueryLayout::Fast);
            let (_, expected) = ask(set, QueryLayout::Compact);
            assert!(own == expected, "{name} {set:?}");
            assert!(
                triangles.len() < 100 || found.iter().all(|&count| count > 40),
                "{name} {found:?}"
            );
        }
    }
}

/// Objects of both kinds in one scene: rays go from one to the other.
#[test]
fn scenes_of_both_kinds_give_what_all_instances_give() {
    let mut scene = Scene::new();
    let mut random = Random::new(12);
    let kinds =
        [sphere(), exploded(&sphere(), 1), scenes::soup(300, 0.2, 5).triangles(), degenerate()];
    for triangles in kinds {
        let mesh = scene.add_mesh(&Mesh::soup(&triangles).expect("a mesh")).expect("a geometry");
        for place in 0..6 {
            let transform = match place {
                0 => translation(random.point(2.0)),
                _ => objects::transform(objects::Kind::Ordinary, &mut random),
            };
            // Some transforms have no inverse.
            let _ = scene.add_instance(Instance::new(mesh, transform));
        }
    }
    let rays = objects::rays(&scene, 2_500, 13);
    let keeps = |hit: &SceneHit| !hit.triangle.is_multiple_of(3);
    let bits = |hits: &[SceneHit]| bytemuck::cast_slice::<SceneHit, [u32; 6]>(hits).to_vec();
    for accuracy in [Accuracy::Watertight, Accuracy::Exact] {
        for filtered in [false, true] {
            let options = &SceneOptions { accuracy, ..SceneOptions::default() };
            let options =
                if filtered { &SceneOptions { filter: Some(&keeps), ..*options } } else { options };
            for set in InstructionSet::available() {
                let backend = CpuBackend::with_instruction_set(set);
                let tree = backend.build_scene(&scene, &BuildOptions::default()).expect("a scene");
                let compact = BuildOptions { layout: QueryLayout::Compact, ..Default::default() };
                let compact = backend.build_scene(&scene, &compact).expect("a scene");
                let expected: Vec<SceneHit> = match filtered {
                    false => {
                        rays.iter().map(|ray| tree.scene().answer_by_all(ray, options)).collect()
                    }
                    true => {
                        let mut hits = vec![SceneHit::MISS; rays.len()];
                        compact.closest_hits(&rays, &mut hits, options).expect("hits");
                        hits
                    }
                };
                let found = expected.iter().filter(|hit| hit.is_hit()).count();
                assert!(found > 400, "{found}");
                let what = format!("{accuracy:?} {filtered} {set:?}");
                let mut hits = vec![SceneHit::MISS; rays.len()];
                tree.closest_hits(&rays, &mut hits, options).expect("hits");
                assert!(bits(&hits) == bits(&expected), "{what}");
                let mut any = vec![false; rays.len()];
                tree.any_hits(&rays, &mut any, options).expect("hits");
                for ((ray, any), hit) in rays.iter().zip(any).zip(&expected) {
                    assert_eq!(any, hit.is_hit(), "{what} {ray:?}");
                    assert_eq!(tree.any_hit(ray, options), any, "{what} {ray:?}");
                    let one = tree.closest_hit(ray, options).unwrap_or(SceneHit::MISS);
                    assert_eq!(bits(&[one]), bits(&[*hit]), "{what} {ray:?}");
                }
            }
        }
    }
}

/// A mesh whose triangles come apart and together again, in kept memory: each time as if it were built for the first time.
#[test]
fn rebuilds_change_from_one_kind_to_the_other() {
    let options = QueryOptions::default();
    let (whole, apart) = (sphere(), exploded(&sphere(), 1));
    let rays = rays(&Mesh::soup(&whole).expect("a mesh"));
    for set in InstructionSet::available() {
        for preset in [Preset::Fast, Preset::Best] {
            let build = BuildOptions::from(preset.config());
            let backend = CpuBackend::with_instruction_set(set);
            let mut tree = built(&whole, set, &build);
            let few = &apart[..9];
            for (triangles, written) in
                [(&apart[..], true), (&whole, false), (&apart, true), (few, false), (&apart, true)]
            {
                let mesh = Mesh::soup(triangles).expect("a mesh");
                backend.rebuild_accelerator(&mut tree, &mesh, &build).expect("a tree");
                let fresh = built(triangles, set, &build);
                let written = written && writes_out(set);
                let kinds = [writes_corners_out(&tree), writes_corners_out(&fresh)];
                assert_eq!(kinds, [written; 2], "{set:?} {preset:?}");
                assert_eq!(tree.query_bytes(), fresh.query_bytes(), "{set:?} {preset:?}");
                let expected = expected(triangles, &rays, &options);
                assert_eq!(fault(&tree, &rays, &options, &expected), None, "{set:?} {preset:?}");
            }
            // The compact layout has no blocks of either kind.
            let compact = BuildOptions { layout: QueryLayout::Compact, ..build };
            let mesh = Mesh::soup(&apart).expect("a mesh");
            backend.rebuild_accelerator(&mut tree, &mesh, &compact).expect("a tree");
            assert!(!writes_corners_out(&tree));
            let expected = expected(&apart, &rays, &options);
            assert_eq!(fault(&tree, &rays, &options, &expected), None, "{set:?} {preset:?}");
        }
    }
}

/// The same in a scene that is brought up to date.
#[test]
fn updates_of_scenes_change_from_one_kind_to_the_other() {
    let (whole, apart) = (sphere(), exploded(&sphere(), 1));
    for set in InstructionSet::available() {
        let backend = CpuBackend::with_instruction_set(set);
        let build = BuildOptions::default();
        let mut scene = Scene::new();
        let mesh = scene.add_mesh(&Mesh::soup(&whole).expect("a mesh")).expect("a geometry");
        for at in [[0.0; 3], [2.5, 0.0, 0.0]] {
            scene.add_instance(Instance::new(mesh, translation(at))).expect("an instance");
        }
        let mut tree = backend.build_scene(&scene, &build).expect("a scene");
        let rays = objects::rays(&scene, 1_500, 14);
        for triangles in [&apart, &whole, &apart] {
            scene.replace_mesh(mesh, &Mesh::soup(triangles).expect("a mesh")).expect("a mesh");
            backend.update_scene(&mut tree, &scene, &build).expect("an update");
            let fresh = backend.build_scene(&scene, &build).expect("a scene");
            let ask = |tree: &dyn splitplane_core::backend::scene::SceneAccelerator| {
                let mut hits = vec![SceneHit::MISS; rays.len()];
                tree.closest_hits(&rays, &mut hits, &SceneOptions::default()).expect("hits");
                hits
            };
            let expected: Vec<SceneHit> = rays
                .iter()
                .map(|ray| fresh.scene().answer_by_all(ray, &SceneOptions::default()))
                .collect();
            assert!(ask(&*tree) == expected && ask(&*fresh) == expected, "{set:?}");
        }
    }
}

/// However many threads make a layout it has the same bytes, and writing corners out makes it smaller.
#[test]
fn threads_do_not_decide_and_what_is_written_out_is_smaller() {
    let triangles = exploded(&scenes::sphere(60, [0.0; 3], 1.0).triangles(), 4);
    for set in InstructionSet::available() {
        let bytes = [1, 2, 5].map(|threads| {
            let pool =
                rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
            let tree = pool.install(|| built(&triangles, set, &BuildOptions::default()));
            assert_eq!(writes_corners_out(&tree), writes_out(set));
            tree.query_bytes()
        });
        assert!(bytes.iter().all(|&own| own == bytes[0]), "{bytes:?}");
    }
}
