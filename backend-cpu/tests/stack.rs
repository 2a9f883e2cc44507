//! Everything that the CPU does runs on threads with little stack: 512 KiB, a quarter of what threads have
//! by default, since a host calls from wherever it is. A build that does not optimise needs most, as it gives
//! each value a place of its own: `cargo test --profile dev -p splitplane-cpu --test stack`. With 384 KiB it is seen to
//! overflow there.

use splitplane_core::backend::{Accelerator, Backend, BuildOptions, QueryLayout};
use splitplane_core::config::{BuildConfig, MAX_DEPTH, Preset};
use splitplane_core::query::all_hits::AllHitsOptions;
use splitplane_core::query::inside::LocateOptions;
use splitplane_core::query::traverse;
use splitplane_core::query::traverse::exact;
use splitplane_core::ray::{Accuracy, Culling, Hit, QueryOptions, Ray};
use splitplane_core::tree::stats::TreeStats;
use splitplane_core::tree::validate::validate;
use splitplane_cpu::{CpuAccelerator, CpuBackend, InstructionSet};
use splitplane_test_support::aim::{self, Kind};
use splitplane_test_support::scenes::{self, Scene};
use splitplane_test_support::watch::goes_on;

/// Bytes of a thread's stack.
const STACK: usize = 512 << 10;

/// Neighbours, which are traced as packets, and rays of all kinds, which are not.
fn rays(scene: &Scene) -> Vec<Ray> {
    let mesh = scene.mesh();
    let mut rays = aim::pictures(&mesh, 1, [8, 8], 5);
    for kind in Kind::ALL {
        let some = aim::rays(&mesh, kind, 6, 5);
        rays.extend(aim::odd(&some, 5));
        rays.extend(aim::invalid(&some[..2], 5));
        rays.extend(some);
    }
    rays
}

/// Core's answer.
fn reference(scene: &Scene, built: &CpuAccelerator, ray: &Ray, options: &QueryOptions<'_>) -> Hit {
    let (tree, mesh) = (built.tree().view(), scene.mesh());
    let hit = match options.accuracy {
        Accuracy::Exact => exact::closest_hit(&tree, &mesh, ray, options),
        _ => traverse::closest_hit(&tree, &mesh, built.scene_scale(), ray, options),
    };
    hit.unwrap_or(Hit::MISS)
}

/// Asks in every way; how many rays hit something. Some answers are held against the reference.
fn ask(scene: &Scene, built: &CpuAccelerator, rays: &[Ray]) -> usize {
    let mut found = 0;
    for accuracy in [Accuracy::Fast, Accuracy::Watertight, Accuracy::Exact] {
        let culling = if accuracy == Accuracy::Fast { Culling::Back } else { Culling::None };
        let options = QueryOptions { accuracy, culling, ..QueryOptions::default() };
        let what = (&scene.name, built.instruction_set(), built.layout(), accuracy);
        let mut hits = vec![Hit::MISS; rays.len()];
        let watched = QueryOptions { watch: Some(&goes_on), ..options };
        built.closest_hits(rays, &mut hits, &watched).expect("equal lengths");
        let mut any = vec![false; rays.len()];
        built.any_hits(rays, &mut any, &options).expect("equal lengths");
        for (i, (ray, hit)) in rays.iter().zip(&hits).enumerate() {
            assert_eq!(any[i], hit.is_hit(), "{what:?} {ray:?}");
            if i % 5 == 0 {
                assert_eq!(reference(scene, built, ray, &options), *hit, "{what:?} {ray:?}");
                let single = built.closest_hit(ray, &options).unwrap_or(Hit::MISS);
                assert_eq!(single, *hit, "{what:?} {ray:?}");
                assert_eq!(built.any_hit(ray, &options), hit.is_hit(), "{what:?} {ray:?}");
            }
        }
        found += any.iter().filter(|&&any| any).count();
    }
    let few: Vec<Ray> = rays.iter().step_by(9).copied().collect();
    let all = built.all_hits(&few, &AllHitsOptions::default()).expect("no limit");
    assert_eq!(all.rays(), few.len());
    let points: Vec<_> = few.iter().map(|ray| ray.origin).collect();
    assert_eq!(
        built.locate(&points, &LocateOptions::default()).expect("no limit").windings.len(),
        points.len()
    );
    found
}

/// On the threads of a pool, which take one another's work on top of their own.
fn on_little_stack<T: Send>(work: impl FnOnce() -> T + Send) -> T {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(2).stack_size(STACK);
    pool.build().expect("threads").install(work)
}

/// Builds, rebuilds, loads and asks, in both layouts; the depth of the tree.
fn check(scene: &Scene, set: InstructionSet, config: BuildConfig, rays: &[Ray]) -> u32 {
    let (mesh, backend) = (scene.mesh(), CpuBackend::with_instruction_set(set));
    let layout = |layout| BuildOptions { config, layout, ..BuildOptions::default() };
    let (fast, compact) = (layout(QueryLayout::Fast), layout(QueryLayout::Compact));
    let mut built = backend.build_accelerator(&mesh, &fast).expect("a tree");
    validate(&built.tree().view()).expect("a valid tree");
    let found = ask(scene, &built, rays);
    // A third at least, of three accuracies.
    assert!(found > rays.len(), "{found} of {} rays", rays.len());
    let loaded =
        backend.load(&mesh, built.tree().clone(), &compact.for_loading()).expect("its tree");
    assert_eq!(loaded.tree().digest(), built.tree().digest());
    backend.rebuild_accelerator(&mut built, &mesh, &compact).expect("a tree");
    assert_eq!(ask(scene, &built, rays), found);
    TreeStats::of(&built.tree().view()).max_depth
}

#[test]
fn everything_runs_on_little_stack() {
    for scene in [scenes::soup(3_000, 0.05, 8), scenes::converging(2_000, 50, 9)] {
        let rays = rays(&scene);
        for set in InstructionSet::available() {
            for preset in Preset::ALL {
                on_little_stack(|| check(&scene, set, preset.config(), &rays));
            }
        }
    }
}

/// Trees as deep as they may be, of many triangles on almost every level, so that what is divided among
/// threads is so too.
#[test]
fn the_deepest_trees_need_no_more() {
    let scene = scenes::converging(9_000, 70, 9);
    let rays: Vec<Ray> = rays(&scene).into_iter().step_by(3).collect();
    for preset in Preset::ALL {
        let config = BuildConfig { max_depth: MAX_DEPTH, ..preset.config() };
        let depth = on_little_stack(|| check(&scene, InstructionSet::detect(), config, &rays));
        assert_eq!(depth, MAX_DEPTH, "{preset:?}");
    }
}
