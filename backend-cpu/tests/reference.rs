//! The CPU backend held to the reference builder: equal buffers after every dispatch, and equal trees.

use std::ops::ControlFlow;
use std::sync::atomic::AtomicU64;
use std::sync::atomic::Ordering::Relaxed;

use splitplane_core::arithmetic::{Arithmetic, Hostile, Strict};
use splitplane_core::backend::BuildOptions;
use splitplane_core::build::lockstep::{Difference, Inspect, Lockstep, LockstepError};
use splitplane_core::build::reference::kernels::is_of_middle_stage;
use splitplane_core::build::reference::{Budget, ReferenceExecutor};
use splitplane_core::build::{reference, schedule};
use splitplane_core::config::{BuildConfig, Preset};
use splitplane_core::error::BuildError;
use splitplane_core::kernel::{Counter, Kernel, TreeBuilder};
use splitplane_core::mesh::Mesh;
use splitplane_core::report::BuildSummary;
use splitplane_core::watch::{Progress, Stage, Watch};
use splitplane_cpu::buffers::Buffers;
use splitplane_cpu::{CpuBackend, CpuExecutor, InstructionSet};
use splitplane_test_support::configs::by_every_staged_builder;
use splitplane_test_support::configs::with_builder_of;
use splitplane_test_support::extremes;
use splitplane_test_support::random::Random;
use splitplane_test_support::scenes::{self, Scene};
use splitplane_test_support::wrong_kernel::{FAULTS, WrongKernel};

fn reference_of<'a, A: Arithmetic>(
    mesh: &Mesh<'a>,
    config: &BuildConfig,
) -> ReferenceExecutor<'a, A> {
    ReferenceExecutor::in_arithmetic(*mesh, *config, Budget::default())
        .expect("a valid configuration")
}

/// Runs an executor in step with the CPU's; the number of dispatches that were compared.
fn in_step(
    mesh: &Mesh<'_>,
    config: &BuildConfig,
    middle: bool,
    second: impl Inspect<TreeBuilder, Error = BuildError>,
) -> Result<u32, Difference> {
    let set = InstructionSet::detect();
    let cpu: CpuExecutor<'_> =
        CpuExecutor::new(*mesh, *config, set, Buffers::default(), None).expect("no limit");
    let cpu = if middle { cpu.with_middle_stage() } else { cpu };
    let mut lockstep = Lockstep::new(cpu, second);
    match schedule::build(&mut lockstep, config.preset().planes().expect("a schedule")) {
        Ok(()) => Ok(lockstep.dispatches()),
        Err(LockstepError::Differs(difference)) => Err(difference),
        Err(other) => panic!("{config:?}: {other}"),
    }
}

fn check(scene: &Scene, config: &BuildConfig) {
    let mesh = scene.mesh();
    let reference = || reference_of::<Strict>(&mesh, config);
    let plain = in_step(&mesh, config, false, reference());
    let middle = in_step(&mesh, config, true, reference().with_middle_stage());
    for compared in [plain, middle] {
        if let Err(difference) = compared {
            panic!("{}, {config:?}: {difference}", scene.name);
        }
    }
}

#[test]
fn awkward_scenes_in_step() {
    for scene in scenes::awkward().into_iter().chain(extremes::scenes()) {
        for config in by_every_staged_builder(BuildConfig::default()) {
            check(&scene, &config);
        }
    }
}

#[test]
fn other_configurations_in_step() {
    let default = BuildConfig::default();
    let configs = [
        BuildConfig { traversal_cost: 3, intersection_cost: 2, block_width: 1, ..default },
        BuildConfig { block_width: 7, ..default }
            .with_stages(|stages| stages.small_node_limit = 17),
        BuildConfig { block_width: 1, ..default }.with_stages(|stages| stages.small_node_limit = 1),
        default.with_stages(|stages| stages.empty_cutoff = 1),
        default.with_stages(|stages| stages.empty_cutoff = 255),
        BuildConfig { max_depth: 96, ..default },
        BuildConfig { clip: false, ..default },
        BuildConfig { clip: false, block_width: 1, ..default }
            .with_stages(|stages| stages.small_node_limit = 9),
    ];
    let bins = [2, 7, 64].map(|bins| Preset::Balanced.config().with_bins(bins));
    let scenes = [scenes::soup(3000, 0.5, 5), scenes::fan(2500), scenes::nested_spheres()];
    for config in configs.into_iter().flat_map(by_every_staged_builder).chain(bins) {
        for scene in &scenes {
            check(scene, &config);
        }
    }
}

/// Each cap by itself and all together, in the middle of a level. That a cap binds shows in the tree.
#[test]
fn caps_that_bind_in_step() {
    let free = BuildConfig { block_width: 1, ..BuildConfig::default() }
        .with_stages(|stages| stages.small_node_limit = 2);
    let caps: [(&str, BuildConfig); 6] = [
        ("nodes", free.with_stages(|stages| stages.nodes_per_triangle = 1)),
        ("references", BuildConfig { references_per_triangle: 1, ..free }),
        (
            "both",
            BuildConfig { references_per_triangle: 1, ..free }
                .with_stages(|stages| stages.nodes_per_triangle = 1),
        ),
        ("no depth", BuildConfig { max_depth: 1, ..free }),
        ("little depth", BuildConfig { max_depth: 5, ..free }),
        (
            "depth among cuts",
            BuildConfig { max_depth: 9, ..free }.with_stages(|stages| stages.empty_cutoff = 1),
        ),
    ];
    // 4,096 more nodes or references than triangles are allowed: enough triangles to want more.
    let scenes = [
        scenes::soup(20_000, 0.02, 3),
        scenes::soup(12_000, 0.4, 4),
        scenes::identical(6_000).joined(&scenes::soup(6_000, 0.2, 5), "a crowd and a soup"),
    ];
    for (cap, config) in caps {
        let mut binds = 0;
        for config in by_every_staged_builder(config) {
            let free = with_builder_of(config.preset(), free);
            for scene in &scenes {
                check(scene, &config);
                let [capped, uncapped] = [config, free].map(|config| built(scene, config).0);
                binds += u32::from(capped.nodes.len() < uncapped.nodes.len());
            }
        }
        assert!(binds > 0, "{cap}");
    }
}

/// The tree by the reference builder.
fn built(scene: &Scene, config: BuildConfig) -> (splitplane_core::tree::KdTree, BuildSummary) {
    reference::build(&scene.mesh(), &config.into())
        .unwrap_or_else(|error| panic!("{}, {config:?}: {error}", scene.name))
}

/// Builds by both builders. The CPU's is the one with tasks, which does not run the schedule
/// itself.
fn equal(scene: &Scene, config: BuildConfig) {
    let (tree, summary) = built(scene, config);
    let (expected, its_summary) =
        CpuBackend::new().build_tree(&scene.mesh(), &config.into()).expect("no limit");
    assert_eq!(tree.digest(), expected.digest(), "{}, {config:?}", scene.name);
    assert!(tree == expected, "{}, {config:?}", scene.name);
    let peak_bytes = its_summary.peak_bytes;
    let mut summary = summary;
    summary.peak_bytes = peak_bytes;
    assert_eq!(summary, its_summary, "{}", scene.name);
}

#[test]
fn the_same_trees_as_the_cpu() {
    for scene in scenes::awkward().into_iter().chain(extremes::scenes()) {
        for config in by_every_staged_builder(BuildConfig::default()) {
            equal(&scene, config);
        }
    }
}

/// Random meshes under random configurations: few coordinates, so that planes and triangles coincide,
/// or many; indices that repeat; coordinates that are no numbers.
#[test]
fn random_meshes_give_the_same_trees_as_the_cpu() {
    let mut random = Random::new(2008);
    let mut large = 0;
    for round in 0..150 {
        let vertices = 1 + random.below(400);
        let steps = [2, 5, 40, 1 << 20][random.below(4)];
        let scale = [1.0, 1e-3, 1e20, 1e-37, 2e38][random.below(5)];
        let mut positions: Vec<[f32; 3]> = Vec::new();
        for _ in 0..vertices {
            positions.push([0; 3].map(|_| scale * random.below(steps) as f32 / steps as f32));
        }
        for bad in [f32::NAN, f32::INFINITY, -0.0, 1e-40] {
            let at = random.below(4 * vertices);
            if at < vertices {
                positions[at][random.below(3)] = bad;
            }
        }
        let indices = (0..random.below(3000))
            .map(|_| [0; 3].map(|_| random.below(vertices) as u32))
            .collect();
        let small_node_limit = 1 + random.below(64) as u32;
        let mut config = BuildConfig {
            traversal_cost: 1 + random.below(5) as u32,
            intersection_cost: 1 + random.below(5) as u32,
            block_width: 1 + random.below(16) as u32,
            max_depth: 1 + random.below(96) as u32,
            references_per_triangle: 1 + random.below(8) as u32,
            clip: random.below(4) > 0,
            ..random.pick(&[Preset::Fast, Preset::Balanced]).config()
        }
        .with_stages(|stages| {
            stages.small_node_limit = small_node_limit;
            stages.empty_cutoff = 1 + random.below(255) as u32;
            stages.nodes_per_triangle = 1 + random.below(4) as u32;
        });
        if let Some(bins) = config.bins_mut() {
            *bins = 2 + random.below(63) as u32;
        }
        let scene = Scene { name: format!("round {round}"), positions, indices: Some(indices) };
        equal(&scene, config);
        large += u32::from(built(&scene, config).1.large_levels > 3);
    }
    assert!(large > 50, "{large} with several levels");
}

/// The specification decides by guarded operations alone.
#[test]
fn the_hostile_arithmetic_gives_the_same_trees() {
    for scene in scenes::awkward().into_iter().filter(|scene| scene.mesh().len() <= 5_000) {
        for config in by_every_staged_builder(BuildConfig::default()) {
            let mesh = scene.mesh();
            let mut hostile = reference_of::<Hostile>(&mesh, &config);
            schedule::build(&mut hostile, config.preset().planes().expect("a schedule"))
                .expect("no limit");
            assert!(hostile.into_tree() == built(&scene, config).0, "{}", scene.name);
        }
    }
}

/// A fault in any kernel is seen, at the first dispatch of that kernel.
#[test]
fn planted_faults_are_named() {
    let mut missing = Kernel::ALL.to_vec();
    let scene = scenes::zeros_and_subnormals()
        .joined(&scenes::grid_boxes(4), "boxes")
        .joined(&scenes::soup(3000, 0.4, 9), "faults");
    // Triangles small enough for the middle stage to finish.
    let small = scenes::soup(12_000, 0.03, 9);
    for &(kernel, what, fault) in FAULTS {
        let mesh = if is_of_middle_stage(kernel) { small.mesh() } else { scene.mesh() };
        missing.retain(|without| *without != kernel);
        let mut seen = 0;
        for config in by_every_staged_builder(BuildConfig::default()) {
            let middle = is_of_middle_stage(kernel);
            let reference: ReferenceExecutor<'_> = reference_of(&mesh, &config);
            let reference = if middle { reference.with_middle_stage() } else { reference };
            match in_step(&mesh, &config, middle, WrongKernel::new(reference, kernel, fault)) {
                Err(difference) => {
                    assert_eq!(difference.kernel, format!("{kernel:?}"), "{what}: {difference}");
                    seen += 1;
                }
                // Planes are found by one kernel or the other; those of bins have no middle stage.
                Ok(_) => assert!(
                    middle
                        || matches!(
                            kernel,
                            Kernel::SplitMedian
                                | Kernel::NodeBounds
                                | Kernel::BinReferences
                                | Kernel::SplitBinned
                        )
                ),
            }
        }
        assert!(seen > 0, "{kernel:?} {what}: the fault was not seen");
    }
    assert!(missing.is_empty(), "no fault is planted in {missing:?}");
}

#[test]
fn what_the_schedule_does_not_build_is_refused() {
    let scene = scenes::one();
    let refused = |config: BuildConfig| reference::build(&scene.mesh(), &config.into()).err();
    let best = refused(Preset::Best.config()).expect("an error");
    assert_eq!(best, BuildError::PresetNotOnDevice { preset: Preset::Best });
    assert!(best.to_string().contains("take that backend, or another preset"), "{best}");
    let invalid = refused(BuildConfig { block_width: 0, ..BuildConfig::default() });
    assert!(matches!(invalid, Some(BuildError::Config(_))), "{invalid:?}");
}

/// The least limit that suffices is what the build says it took; one byte less is refused.
#[test]
fn the_limit_of_memory_binds_where_the_summary_says() {
    let scene = scenes::soup(3_000, 0.2, 8);
    for config in by_every_staged_builder(BuildConfig::default()) {
        let (tree, summary) = built(&scene, config);
        let under = |limit| {
            let options = BuildOptions { max_memory: Some(limit), ..config.into() };
            reference::build(&scene.mesh(), &options)
        };
        assert_eq!(under(summary.peak_bytes), Ok((tree, summary)));
        let limit = summary.peak_bytes - 1;
        for limit in [limit, limit / 2, limit / 50, 0] {
            let refused = under(limit).expect_err("too little memory");
            assert!(
                matches!(refused, BuildError::OutOfMemory { needed, limit: l } if l == limit && needed > l),
                "{refused}"
            );
        }
    }
}

/// Continues this many times, and remembers the last progress that it received.
struct Ends {
    left: AtomicU64,
    calls: AtomicU64,
    last: std::sync::Mutex<Option<Progress>>,
}

impl Ends {
    fn after(calls: u64) -> Ends {
        Ends { left: calls.into(), calls: 0.into(), last: None.into() }
    }
}

impl Watch for Ends {
    fn progress(&self, progress: &Progress) -> ControlFlow<()> {
        let mut last = self.last.lock().expect("no panic");
        if let Some(before) = *last {
            let order = |stage| {
                [Stage::Start, Stage::LargeNodes, Stage::SmallNodes, Stage::Output]
                    .iter()
                    .position(|&s| s == stage)
            };
            let stages = order(before.stage).cmp(&order(progress.stage));
            assert!(stages.is_lt() || stages.is_eq() && before.done <= progress.done);
        }
        assert!(progress.total == 0 || progress.done <= progress.total, "{progress:?}");
        *last = Some(*progress);
        self.calls.fetch_add(1, Relaxed);
        match self.left.fetch_sub(1, Relaxed) {
            0 => panic!("asked after the end"),
            1 => ControlFlow::Break(()),
            _ => ControlFlow::Continue(()),
        }
    }
}

/// A watch may end the build at any of its calls, and is not called after that.
#[test]
fn a_watch_ends_the_build() {
    // A crowd in which the sampled sweep takes most of the time.
    let scene = scenes::identical(3_000).joined(&scenes::soup(5_000, 0.1, 6), "watched");
    for config in by_every_staged_builder(BuildConfig::default()) {
        let watch = Ends::after(u64::MAX);
        let watched =
            reference::build(&scene.mesh(), &BuildOptions { watch: Some(&watch), ..config.into() });
        assert_eq!(watched, Ok(built(&scene, config)));
        let calls = watch.calls.load(Relaxed);
        let end = watch.last.lock().unwrap().expect("it was told");
        assert_eq!((end.stage, end.done), (Stage::Output, end.total));
        assert!(calls > 60, "{calls} calls");
        for call in (1..=calls).step_by(7) {
            let watch = Ends::after(call);
            let ended = reference::build(
                &scene.mesh(),
                &BuildOptions { watch: Some(&watch), ..config.into() },
            );
            let progress = watch.last.lock().unwrap().expect("it was told");
            assert_eq!(ended, Err(BuildError::Cancelled { progress }), "call {call}");
        }
    }
}

/// The executor leaves the counters that the summary gives.
#[test]
fn counters_of_a_finished_build() {
    let scene = scenes::bad_vertices();
    let mesh = scene.mesh();
    let config = BuildConfig::default();
    let mut executor = reference_of::<Strict>(&mesh, &config);
    schedule::build(&mut executor, config.preset().planes().expect("a schedule"))
        .expect("no limit");
    let count = |counter| executor.buffers().count(counter);
    assert!(count(Counter::Dropped) > 0);
    assert_eq!(count(Counter::Triangles), mesh.len());
    let nodes = count(Counter::Nodes);
    assert_eq!(executor.into_tree().nodes.len(), nodes);
}
