//! The compact layout gives the hits of the default one bit for bit, on every path of every instruction
//! set, and takes the memory it promises.

use core::ops::ControlFlow;
use std::sync::Mutex;

use crate::common::bits;
use splitplane_core::backend::{Accelerator, Backend, BuildOptions, QueryLayout};
use splitplane_core::config::{BuildConfig, Preset};
use splitplane_core::error::BuildError;
use splitplane_core::mesh::Mesh;
use splitplane_core::query::all_hits::AllHitsOptions;
use splitplane_core::query::inside::LocateOptions;
use splitplane_core::ray::{Accuracy, Culling, Hit, QueryOptions, Ray};
use splitplane_core::watch::{Progress, Stage, Watch};
use splitplane_cpu::{CpuAccelerator, CpuBackend, InstructionSet};
use splitplane_test_support::aim::{self, Kind};
use splitplane_test_support::random::Random;
use splitplane_test_support::scenes::{self, Scene};
use splitplane_test_support::watch::goes_on;

fn options(config: BuildConfig, layout: QueryLayout) -> BuildOptions<'static> {
    BuildOptions { config, layout, ..BuildOptions::default() }
}

fn build(mesh: &Mesh<'_>, set: InstructionSet, options: &BuildOptions<'_>) -> CpuAccelerator {
    CpuBackend::with_instruction_set(set).build_accelerator(mesh, options).expect("a tree")
}

/// Everything that two accelerators say of some rays and of points on them; how many rays hit.
fn compare(
    one: &CpuAccelerator,
    other: &CpuAccelerator,
    rays: &[Ray],
    few: usize,
    what: &str,
) -> usize {
    assert!(one.tree() == other.tree(), "{what}");
    let mut found = 0;
    for (accuracy, culling, ignore) in [
        (Accuracy::Watertight, Culling::None, None),
        (Accuracy::Watertight, Culling::Back, Some(2)),
        (Accuracy::Fast, Culling::Front, None),
        (Accuracy::Exact, Culling::None, Some(1)),
        (Accuracy::Exact, Culling::Back, None),
    ] {
        let options = QueryOptions { accuracy, culling, ignore, ..QueryOptions::default() };
        let what = format!("{what}, {options:?}");
        let [a, b] = [one, other].map(|tree| {
            let (mut hits, mut singly) = (vec![Hit::MISS; rays.len()], vec![Hit::MISS; few]);
            tree.closest_hits(rays, &mut hits, &options).expect("equal lengths");
            tree.closest_hits_singly(&rays[..few], &mut singly, &options).expect("equal lengths");
            (bits(&hits), bits(&singly))
        });
        let differs = a.0.iter().zip(&b.0).position(|(a, b)| a != b);
        if let Some(at) = differs {
            let hit = |bits: [u32; 4]| {
                (f32::from_bits(bits[0]), bits[1], f32::from_bits(bits[2]), f32::from_bits(bits[3]))
            };
            panic!("{what}: batch, ray {:?}: {:?} {:?}", rays[at], hit(a.0[at]), hit(b.0[at]));
        }
        assert!(a.1 == b.1 && a.1[..] == a.0[..few], "{what}: singly");
        found += a.0.iter().filter(|hit| hit[1] != Hit::MISS.triangle).count();
        let [a, b] = [one, other].map(|tree| {
            let (mut any, mut singly) = (vec![false; rays.len()], vec![false; few]);
            tree.any_hits(rays, &mut any, &options).expect("equal lengths");
            tree.any_hits_singly(&rays[..few], &mut singly, &options).expect("equal lengths");
            (any, singly)
        });
        assert!(a == b, "{what}: any");
        let QueryOptions { culling, ignore, .. } = options;
        let crossings = AllHitsOptions { culling, ignore, ..AllHitsOptions::default() };
        let [a, b] = [one, other].map(|tree| tree.all_hits(&rays[..few], &crossings));
        assert!(a == b, "{what}: all hits");
    }
    let points: Vec<_> = rays[..few]
        .iter()
        .map(|ray| [0, 1, 2].map(|k| ray.origin[k] + 0.5 * ray.direction[k]))
        .collect();
    let [a, b] = [one, other].map(|tree| {
        tree.locate(&points, &LocateOptions::default()).map(|located| located.windings)
    });
    assert!(a == b, "{what}: inside");
    found
}

/// Rays of all kinds, with and without limits.
fn rays(mesh: &Mesh<'_>, count: usize, seed: u64) -> Vec<Ray> {
    let mut rays = Vec::new();
    for kind in Kind::ALL {
        let some = aim::rays(mesh, kind, count, seed);
        rays.extend(aim::odd(&some, seed));
        rays.extend(aim::invalid(&some[..count.min(4)], seed));
        rays.extend(some);
    }
    // So that the few that take longer are of all kinds.
    Random::new(seed).shuffle(&mut rays);
    rays
}

#[test]
fn awkward_scenes_give_the_same_hits() {
    let mut found = 0;
    for (seed, scene) in scenes::awkward().iter().enumerate() {
        let mesh = scene.mesh();
        // Where rays meet thousands of triangles at once, few of them say as much.
        let many = matches!(scene.name.as_str(), "identical triangles" | "fan" | "spike");
        let rays = rays(&mesh, if many { 2 } else { 16 }, seed as u64);
        let few = rays.len().min(if many { 4 } else { 40 });
        for set in InstructionSet::available() {
            let [fast, compact] = [QueryLayout::Fast, QueryLayout::Compact]
                .map(|layout| build(&mesh, set, &options(BuildConfig::default(), layout)));
            assert_eq!(
                [fast.layout(), compact.layout()],
                [QueryLayout::Fast, QueryLayout::Compact]
            );
            found += compare(&fast, &compact, &rays, few, &format!("{}, {set:?}", scene.name));
        }
    }
    assert!(found > 15_000, "{found}");
}

/// A mesh whose triangles share vertices by index. Some are degenerate, some vertices are used by none;
/// some are no numbers, and some are snapped.
fn random_mesh(random: &mut Random) -> Scene {
    let vertices = 1 + random.below(200);
    let mut positions: Vec<[f32; 3]> = (0..vertices)
        .map(|_| [(); 3].map(|()| (random.below(9) as f64 / 4.0 + 0.3 * random.unit()) as f32))
        .collect();
    if random.below(3) == 0 {
        positions[random.below(vertices)] = [-0.0, 1e-40, 1.0];
        positions[random.below(vertices)][1] = f32::NAN;
    }
    let count = random.below(600);
    let near = |random: &mut Random, first: usize| (first + random.below(6)) % vertices;
    let indices: Vec<[u32; 3]> = (0..count)
        .map(|_| {
            let first = random.below(vertices);
            [first, near(random, first), near(random, first)].map(|vertex| vertex as u32)
        })
        .collect();
    if random.below(2) == 0 {
        let corners = indices.iter().flatten().map(|&vertex| positions[vertex as usize]);
        return Scene { name: "soup".into(), positions: corners.collect(), indices: None };
    }
    Scene { name: "indexed".into(), positions, indices: Some(indices) }
}

#[test]
fn random_meshes_give_the_same_hits() {
    let sets = InstructionSet::available();
    let presets = [Preset::Fast, Preset::Balanced, Preset::Best];
    let mut found = 0;
    for seed in 0..60 {
        let mut random = Random::new(seed);
        let scene = random_mesh(&mut random);
        let mesh = scene.mesh();
        let config = BuildConfig {
            // Leaves of many triangles too.
            max_depth: random.pick(&[2, 8, 50]),
            ..random.pick(&presets).config()
        };
        let rays = rays(&mesh, 8, seed);
        let set = random.pick(&sets);
        let [fast, compact] = [QueryLayout::Fast, QueryLayout::Compact]
            .map(|layout| build(&mesh, set, &options(config, layout)));
        let few = rays.len().min(32);
        found += compare(&fast, &compact, &rays, few, &format!("seed {seed}, {set:?}"));
    }
    assert!(found > 10_000, "{found}");
}

#[test]
fn a_compact_layout_takes_at_most_45_bytes_a_triangle() {
    let scene = scenes::sphere(120, [0.0; 3], 1.0);
    let mesh = scene.mesh();
    let soup: Vec<_> = (0..mesh.len()).map(|i| mesh.triangle(i)).collect();
    let soup = Mesh::soup(&soup).expect("a mesh");
    assert!(mesh.len() > 20_000);
    for set in InstructionSet::available() {
        for preset in [Preset::Fast, Preset::Balanced, Preset::Best] {
            let [fast, compact] = [QueryLayout::Fast, QueryLayout::Compact]
                .map(|layout| build(&mesh, set, &options(preset.config(), layout)));
            let of = |tree: &CpuAccelerator| tree.query_bytes() as f64 / mesh.len() as f64;
            let what = format!("{set:?}, {preset:?}: {} and {}", of(&fast), of(&compact));
            println!("{what}");
            assert!(of(&compact) <= 45.0 && 2.0 * of(&compact) < of(&fast), "{what}");
            // 18 bytes a triangle are the mesh; of a soup 36.
            let apart = options(preset.config(), QueryLayout::Compact);
            let apart = build(&soup, set, &apart);
            let more = (apart.query_bytes() - compact.query_bytes()) as f64 / mesh.len() as f64;
            assert!((17.9..18.1).contains(&more), "{what}: {more}");
        }
    }
}

#[test]
fn the_compact_layout_keeps_to_a_limit() {
    // What threads hold in addition depends on how work is distributed.
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a pool");
    pool.install(keeps_to_a_limit);
}

fn keeps_to_a_limit() {
    let scene = scenes::sphere(40, [0.0; 3], 1.0);
    let mesh = scene.mesh();
    for preset in [Preset::Fast, Preset::Best] {
        let free = options(preset.config(), QueryLayout::Compact);
        let mut built = build(&mesh, InstructionSet::detect(), &free);
        let peak = built.summary().peak_bytes;
        let tree = size_of_val(&built.tree().nodes[..]) + size_of_val(&built.tree().references[..]);
        assert!(peak >= built.query_bytes() + tree as u64);
        let limited = |limit| BuildOptions { max_memory: Some(limit), ..free };
        let exactly = CpuBackend::new().build_accelerator(&mesh, &limited(peak)).expect("enough");
        assert_eq!(exactly.summary().peak_bytes, peak);
        let refused = |error: BuildError| assert!(matches!(error, BuildError::OutOfMemory { .. }));
        refused(CpuBackend::new().build_accelerator(&mesh, &limited(peak - 1)).unwrap_err());
        refused(
            CpuBackend::new()
                .rebuild_accelerator(&mut built, &mesh, &limited(peak - 1))
                .unwrap_err(),
        );
        let loaded = CpuBackend::new()
            .load(&mesh, built.tree().clone(), &free.for_loading())
            .expect("its mesh");
        let needed = loaded.summary().peak_bytes;
        assert!(needed >= loaded.query_bytes());
        let tree = built.tree().clone();
        refused(
            CpuBackend::new()
                .load(&mesh, tree, &limited(needed - 1).for_loading())
                .map(drop)
                .unwrap_err(),
        );
        // Both accelerators at once.
        let under = |limit| BuildOptions { watch: Some(&goes_on), ..limited(limit) };
        let watched = CpuBackend::new().rebuild_accelerator(&mut built, &mesh, &under(peak));
        refused(watched.unwrap_err());
        let both = peak + built.query_bytes() + tree_bytes(&built);
        let watched = CpuBackend::new().rebuild_accelerator(&mut built, &mesh, &under(both));
        watched.expect("enough");
    }
}

fn tree_bytes(built: &CpuAccelerator) -> u64 {
    (size_of_val(&built.tree().nodes[..]) + size_of_val(&built.tree().references[..])) as u64
}

#[test]
fn rebuilt_and_loaded_ones_are_like_new() {
    let large = scenes::sphere(30, [0.0; 3], 1.0);
    let [soup, none] = [scenes::soup(700, 0.1, 3), scenes::none()];
    let scenes = [large, scenes::giants(), soup, none, scenes::giants(), scenes::nested_spheres()];
    let backend = CpuBackend::new();
    let set = InstructionSet::detect();
    let first = options(BuildConfig::default(), QueryLayout::Fast);
    let mut built = build(&scenes[0].mesh(), set, &first);
    for (round, scene) in scenes.iter().cycle().take(9).enumerate() {
        let mesh = scene.mesh();
        let rays = rays(&mesh, 10, round as u64);
        let few = rays.len().min(20);
        // Compact twice in a row, and the other layout in between.
        let layout = if round % 3 == 2 { QueryLayout::Fast } else { QueryLayout::Compact };
        let options = options(BuildConfig::default(), layout);
        let new = build(&mesh, set, &options);
        if round % 2 == 0 {
            backend.rebuild_accelerator(&mut built, &mesh, &options).expect("a tree");
        } else {
            let watched = BuildOptions { watch: Some(&goes_on), ..options };
            backend.rebuild_accelerator(&mut built, &mesh, &watched).expect("a tree");
        }
        assert_eq!((built.layout(), built.query_bytes()), (layout, new.query_bytes()));
        compare(&built, &new, &rays, few, &format!("round {round}"));
        let loaded =
            backend.load(&mesh, new.tree().clone(), &options.for_loading()).expect("its mesh");
        assert_eq!(loaded.query_bytes(), new.query_bytes());
        let mut hits = [vec![Hit::MISS; rays.len()], vec![Hit::MISS; rays.len()]];
        let both: [&dyn Accelerator; 2] = [&new, loaded.as_ref()];
        for (tree, hits) in both.into_iter().zip(&mut hits) {
            tree.closest_hits(&rays, hits, &QueryOptions::default()).expect("equal lengths");
        }
        assert!(bits(&hits[0]) == bits(&hits[1]));
    }
}

/// Cancels the work at one of its calls, and remembers the progress that it received.
struct Ends {
    at: usize,
    told: Mutex<Vec<Progress>>,
}

impl Watch for Ends {
    fn progress(&self, progress: &Progress) -> ControlFlow<()> {
        let mut told = self.told.lock().expect("no panics");
        told.push(*progress);
        if told.len() > self.at { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    }
}

#[test]
fn a_watch_sees_layouts_made_and_may_end_them() {
    let scene = scenes::sphere(150, [0.0; 3], 1.0);
    let mesh = scene.mesh();
    let backend = CpuBackend::new();
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a thread");
    for layout in [QueryLayout::Fast, QueryLayout::Compact] {
        let options = options(BuildConfig::default(), layout);
        let watched = |at: usize, into: Option<&mut CpuAccelerator>| {
            let watch = Ends { at, told: Mutex::default() };
            let built = pool.install(|| match into {
                Some(kept) => backend
                    .rebuild_accelerator(
                        kept,
                        &mesh,
                        &BuildOptions { watch: Some(&watch), ..options },
                    )
                    .map(|()| None),
                None => backend
                    .build_accelerator(&mesh, &BuildOptions { watch: Some(&watch), ..options })
                    .map(Some),
            });
            (built, watch.told.into_inner().expect("no panics"))
        };
        let (built, told) = watched(usize::MAX, None);
        let built = built.expect("not ended").expect("an accelerator");
        let first = told.iter().position(|progress| progress.stage == Stage::Layout);
        let first = first.expect("a stage");
        let layout: Vec<_> = told[first..].iter().map(|told| (told.done, told.total)).collect();
        let [nodes, references] =
            [built.tree().nodes.len() as u64, built.tree().references.len() as u64];
        let total = nodes + references;
        assert!(layout.len() > 5 && layout.is_sorted() && layout.last() == Some(&(total, total)));
        assert!(layout.iter().all(|&(_, told)| told == total));
        // Packing is as many steps as there are references, planning one for every second node, and
        // so is writing: this was reported while nodes were written, of which planning was half.
        let (planned, rest) = (references + nodes / 2, layout.len() - 1);
        assert!(layout[..rest].iter().any(|&(done, _)| done > planned), "{layout:?}");
        assert!(layout.iter().filter(|&&(done, _)| 0 < done && done < references).count() > 2);
        let mut kept = build(&mesh, InstructionSet::detect(), &options);
        // A rebuild keeps the lists that the build gave back, so later ones ask less often.
        assert!(watched(usize::MAX, Some(&mut kept)).0.is_ok());
        let (again, told) = watched(usize::MAX, Some(&mut kept));
        assert!(again.is_ok());
        let first = told.iter().position(|progress| progress.stage == Stage::Layout);
        let first = first.expect("a stage");
        assert!(told.len() > first + 5);
        for at in first..told.len() {
            let (ended, again) = watched(at, Some(&mut kept));
            let error = ended.expect_err("ended");
            let BuildError::Cancelled { progress } = error else { panic!("{error}") };
            assert!(progress.stage == Stage::Layout && again.len() == at + 1, "{progress:?}");
            if at % 4 == 0 {
                let rays = rays(&mesh, 8, at as u64);
                compare(&kept, &built, &rays, 8, "what an ended rebuild leaves");
            }
        }
    }
}
