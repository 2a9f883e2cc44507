//! Triangles that are much larger than the leaves that name them have a place of their own in the query layout. The
//! answers are those of a tree of one leaf, and of whole numbers, bit for bit, on every path of every instruction set.

use crate::common::bits;
use rayon::prelude::*;
use splitplane_core::backend::{Accelerator, BuildOptions, QueryLayout};
use splitplane_core::config::Preset;
use splitplane_core::mesh::Mesh;
use splitplane_core::query::traverse::exact;
use splitplane_core::ray::{Accuracy, Culling, Hit, QueryOptions, Ray};
use splitplane_core::triangle::Triangle;
use splitplane_cpu::{CpuBackend, InstructionSet};
use splitplane_test_support::aim::{self, Kind};
use splitplane_test_support::random::Random;
use splitplane_test_support::surfaces::OneLeaf;

/// Half the extent of the soup.
const HALF: f64 = 20.0;

/// Triangles of about unit size.
fn soup(count: usize, random: &mut Random) -> Vec<Triangle> {
    (0..count)
        .map(|_| {
            let at = [(); 3].map(|()| random.between(-HALF, HALF));
            [(); 3].map(|()| [0, 1, 2].map(|k| (at[k] + random.between(-0.5, 0.5)) as f32))
        })
        .collect()
}

/// Two triangles of a ground through the soup.
fn ground(size: f32) -> [Triangle; 2] {
    let [a, b, c, d] =
        [[-size, 0.3, -size], [size, 0.3, -size], [size, 0.3, size], [-size, 0.3, size]];
    [[a, b, c], [a, c, d]]
}

/// The twelve triangles of a box around everything.
fn sky(size: f32) -> Vec<Triangle> {
    let corner = |i: usize| [0, 1, 2].map(|k| if i >> k & 1 == 0 { -size } else { size });
    let faces =
        [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]];
    faces.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).map(|t| t.map(corner)).collect()
}

/// Triangles, the large ones among the others, and rays: at both, along the ground, and from far away.
fn scenes() -> Vec<(String, Vec<Triangle>, Vec<Ray>)> {
    let mut random = Random::new(41);
    let mut all = Vec::new();
    for size in [1e5, 1e9] {
        for (name, large) in [
            ("ground", ground(size).to_vec()),
            ("sky and ground", [&sky(size)[..], &ground(0.9 * size)].concat()),
            // More than have a place of their own.
            ("two skies", [sky(size), sky(0.5 * size)].concat()),
        ] {
            let small = soup(1500, &mut random);
            let mut triangles = small.clone();
            for (i, corners) in large.into_iter().enumerate() {
                triangles.insert(61 * i, corners);
            }
            // Degenerate ones, which no leaf names, as large as all.
            triangles.push([[-size; 3], [size; 3], [-size; 3]]);
            triangles.push([[size, 0.0, 0.0]; 3]);
            let whole = Mesh::soup(&triangles).expect("a mesh");
            let mesh = Mesh::soup(&small).expect("a mesh");
            let mut rays = Vec::new();
            for kind in Kind::ALL {
                rays.extend(aim::rays(&mesh, kind, 200, 7));
                rays.extend(aim::rays(&whole, kind, 100, 8));
            }
            for _ in 0..300 {
                let mut point =
                    |y: f64| [random.between(-HALF, HALF), y, random.between(-HALF, HALF)];
                let (from, to) = (point(0.3), point(0.3 + 1e-6));
                rays.push(aim::aimed(from.map(|x| x as f32), to));
                rays.push(aim::aimed(point(f64::from(size)).map(|x| x as f32), point(-HALF)));
            }
            // Neighbours, which go as packets.
            for x in 0..32 {
                rays.extend((0..32).map(|y| {
                    let to = [f64::from(x) - 16.0, f64::from(y) - 16.0, 0.0];
                    aim::aimed([0.1, 0.2, 60.0], to)
                }));
            }
            all.push((format!("{name} of {size:e}"), triangles, rays));
        }
    }
    all
}

/// What is asked, and the closest hits that are the answer.
type Question = (QueryOptions<'static>, Vec<Hit>);

fn questions(name: &str, triangles: &[Triangle], rays: &[Ray]) -> Vec<Question> {
    let one_leaf = OneLeaf::new(&Mesh::soup(triangles).expect("a mesh"));
    let tree = one_leaf.tree.view();
    let is_large = |hit: &&Hit| {
        let corners = triangles.get(hit.triangle as usize);
        corners.is_some_and(|corners| corners[0][0].abs() > 1e3)
    };
    let asked = [
        (Accuracy::Watertight, Culling::None, None),
        (Accuracy::Watertight, Culling::Back, Some(0)),
        (Accuracy::Exact, Culling::None, None),
        (Accuracy::Exact, Culling::Front, Some(61)),
    ];
    asked
        .into_iter()
        .map(|(accuracy, culling, ignore)| {
            let options = QueryOptions { accuracy, culling, ignore, ..QueryOptions::default() };
            let exactly = |ray| exact::closest_hit(&tree, triangles, ray, &options);
            let expected = match accuracy {
                Accuracy::Exact => {
                    rays.iter().map(|ray| exactly(ray).unwrap_or(Hit::MISS)).collect()
                }
                _ => one_leaf.closest(rays, &options),
            };
            let found = expected.iter().filter(|hit| hit.is_hit()).count();
            let large = expected.iter().filter(is_large).count();
            assert!(large > 300 && found > large + 300, "{name}: {large} of {found}");
            (options, expected)
        })
        .collect()
}

#[test]
fn large_triangles_change_no_answer() {
    scenes().into_par_iter().for_each(|(name, triangles, rays)| {
        let mesh = Mesh::soup(&triangles).expect("a mesh");
        let questions = questions(&name, &triangles, &rays);
        let layouts = [QueryLayout::Fast, QueryLayout::Compact];
        for (layout, preset) in layouts.into_iter().flat_map(|l| Preset::ALL.map(|p| (l, p))) {
            for set in InstructionSet::available() {
                let build = BuildOptions { layout, ..preset.config().into() };
                let backend = CpuBackend::with_instruction_set(set);
                let tree = backend.build_accelerator(&mesh, &build).expect("a tree");
                for (options, expected) in &questions {
                    let what = format!("{name}, {set:?}, {layout:?}, {preset:?}, {options:?}");
                    let (mut hits, mut any) =
                        (vec![Hit::MISS; rays.len()], vec![false; rays.len()]);
                    let is_hit: Vec<bool> = expected.iter().map(Hit::is_hit).collect();
                    tree.closest_hits(&rays, &mut hits, options).expect("equal lengths");
                    assert!(bits(&hits) == bits(expected), "{what}: batch");
                    tree.closest_hits_singly(&rays, &mut hits, options).expect("equal lengths");
                    assert!(bits(&hits) == bits(expected), "{what}: singly");
                    tree.any_hits(&rays, &mut any, options).expect("equal lengths");
                    assert!(any == is_hit, "{what}: any");
                    tree.any_hits_singly(&rays, &mut any, options).expect("equal lengths");
                    assert!(any == is_hit, "{what}: any singly");
                }
            }
        }
    });
}
