//! CPU and GPU executors side by side: equal live buffers after every dispatch, the finished tree among
//! them, with WebGPU's default limits requested.

use crate::common::{self, poison};
use splitplane_core::build::lockstep::{Difference, Lockstep, LockstepError};
use splitplane_core::build::reference::kernels::is_of_middle_stage;
use splitplane_core::build::schedule;
use splitplane_core::config::{BuildConfig, Planes, Preset};
use splitplane_core::kernel::Kernel;
use splitplane_core::mesh::Mesh;
use splitplane_cpu::buffers::Buffers;
use splitplane_cpu::{CpuBackend, CpuExecutor, InstructionSet};
use splitplane_test_support::configs::by_every_staged_builder;
use splitplane_test_support::scenes::{self, Scene};
use splitplane_wgpu::{Gpu, WgpuBackend, WgpuExecutor};

/// Runs both executors in step, without the middle stage and with it; the number of dispatches that were compared.
fn in_step(
    backend: &WgpuBackend,
    mesh: &Mesh<'_>,
    config: &BuildConfig,
) -> Result<u32, Difference> {
    let plain = in_step_with(backend, mesh, config, false)?;
    match config.preset().planes() {
        Some(Planes::Median) => Ok(plain + in_step_with(backend, mesh, config, true)?),
        _ => Ok(plain),
    }
}

fn in_step_with(
    backend: &WgpuBackend,
    mesh: &Mesh<'_>,
    config: &BuildConfig,
    middle: bool,
) -> Result<u32, Difference> {
    let set = InstructionSet::detect();
    let cpu: CpuExecutor<'_> =
        CpuExecutor::new(*mesh, *config, set, Buffers::default(), None).expect("memory");
    let cpu = if middle { cpu.with_middle_stage() } else { cpu };
    let run = |gpu: WgpuExecutor<'_>| {
        let mut lockstep = Lockstep::new(cpu, gpu);
        schedule::build(&mut lockstep, config.preset().planes().expect("a schedule"))
            .map(|()| lockstep.dispatches())
    };
    let ran = match middle {
        true => backend.with_middle_executor(mesh, config, run),
        false => backend.with_executor(mesh, config, run),
    };
    match ran.expect("a device that holds the scene") {
        Ok(dispatches) => Ok(dispatches),
        Err(LockstepError::Differs(difference)) => Err(difference),
        Err(other) => panic!("{config:?}: {other}"),
    }
}

fn check(backend: &WgpuBackend, scene: &Scene, config: &BuildConfig) {
    if let Err(difference) = in_step(backend, &scene.mesh(), config) {
        panic!("{}: {difference}", scene.name);
    }
}

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn awkward_scenes() {
    let backend = WgpuBackend::new(Gpu::clone(&common::gpu())).expect("a backend");
    for scene in scenes::awkward() {
        for config in by_every_staged_builder(BuildConfig::default()) {
            check(&backend, &scene, &config);
        }
    }
}

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn other_configurations() {
    let backend = WgpuBackend::new(Gpu::clone(&common::gpu())).expect("a backend");
    let default = BuildConfig::default();
    let configs = [
        BuildConfig { traversal_cost: 3, intersection_cost: 2, block_width: 1, ..default },
        BuildConfig { block_width: 7, ..default }
            .with_stages(|stages| stages.small_node_limit = 17),
        BuildConfig { block_width: 1, ..default }.with_stages(|stages| stages.small_node_limit = 1),
        default.with_stages(|stages| stages.empty_cutoff = 1),
        default.with_stages(|stages| stages.empty_cutoff = 255),
        BuildConfig { max_depth: 5, ..default },
        BuildConfig { max_depth: 96, ..default },
        BuildConfig { max_depth: 1, ..default },
        BuildConfig { references_per_triangle: 1, ..default },
        BuildConfig { references_per_triangle: 2, ..default }
            .with_stages(|stages| stages.nodes_per_triangle = 1),
        BuildConfig { clip: false, ..default },
        BuildConfig { clip: false, block_width: 1, ..default }
            .with_stages(|stages| stages.small_node_limit = 9),
    ];
    let configs = configs.into_iter().flat_map(by_every_staged_builder);
    let balanced = Preset::Balanced.config();
    let bins = [2, 3, 7, 63, 64].map(|bins| balanced.with_bins(bins));
    let scenes = [scenes::soup(3000, 0.5, 5), scenes::fan(2500), scenes::nested_spheres()];
    for config in configs.chain(bins) {
        for scene in &scenes {
            check(&backend, scene, &config);
        }
    }
}

/// Costs of large nodes go beyond 32 bits, in every word of their products; bins of coordinates at the
/// ends of the range of floats.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn binned_costs_and_places_at_their_limits() {
    let backend = WgpuBackend::new(Gpu::clone(&common::gpu())).expect("a backend");
    let balanced = Preset::Balanced.config();
    let dear = BuildConfig {
        traversal_cost: 1,
        intersection_cost: 683,
        block_width: 1,
        max_depth: 12,
        ..balanced
    }
    .with_stages(|stages| stages.small_node_limit = 1);
    check(&backend, &scenes::soup(12_000, 0.3, 6), &dear);
    for scale in [1e-36, 1e-33, 1e30, 3e37, 1.5e38] {
        let scene = scenes::soup(700, 0.2, 7);
        let positions = scene.positions.iter().map(|p| p.map(|x| (2.0 * x - 1.0) * scale));
        let scene = Scene { positions: positions.collect(), ..scene };
        for bins in [2, 3, 64] {
            check(&backend, &scene, &balanced.with_bins(bins));
        }
    }
}

/// A configuration that wants many nodes and allows few: 4,096 more than triangles.
fn capped(config: BuildConfig) -> BuildConfig {
    BuildConfig { block_width: 1, ..config }.with_stages(|stages| {
        stages.small_node_limit = 2;
        stages.nodes_per_triangle = 1;
    })
}

/// Caps that bind in the middle of a level, among more nodes than one workgroup takes at once.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn caps_that_bind() {
    let backend = WgpuBackend::new(Gpu::clone(&common::gpu())).expect("a backend");
    let config = capped(BuildConfig { references_per_triangle: 1, ..BuildConfig::default() });
    for config in by_every_staged_builder(config) {
        check(&backend, &scenes::soup(20_000, 0.02, 3), &config);
        check(&backend, &scenes::soup(12_000, 0.4, 4), &config);
    }
}

/// A fault in any kernel is seen, at the first dispatch of that kernel.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn planted_faults_are_named() {
    use Kernel as K;
    let fast = BuildConfig::default();
    let balanced = Preset::Balanced.config();
    let whole = BuildConfig { clip: false, ..fast };
    let plants = [
        (K::TriangleBounds, "magnitude < vec3<u32>(0x800000u)", "magnitude < vec3<u32>(1u)"),
        (K::ScanTriangles, "select(0u, 1u, kept > 0u)", "2u"),
        (K::GatherReferences, "Reference(bounds.lo, triangle", "Reference(bounds.lo, chunk"),
        (K::SplitMedian, "sides.x | sides.y | sides.z", "0u"),
        (K::SplitMedian, "min(CHUNK, node.count - offset)", "node.count - offset"),
        (K::SplitMedian, "node.source + chunk, node.side", "node.source + chunk, 0u"),
        (K::AllocateChildren, "first_chunk += chunks_of(count)", "first_chunk += 1u"),
        (K::ClassifyReferences, "lo < position || hi <= position", "lo < position"),
        (K::ClassifyReferences, "DECISION_COUNTS + lane", "DECISION_COUNTS + 1u - lane"),
        (K::ClassifyReferences, "count << (16u * lane)", "count"),
        (K::ScatterReferences, "ratio, along", "ratio, along * 1.0001"),
        (K::BuildMiddle, "own.level + levels", "own.level"),
        (K::BuildMiddle, "ordered_bits(bounds.lo.x)", "ordered_bits(bounds.lo.y)"),
        (K::BuildMiddle, "mark(RIGHTS, again / 32u, bit);", "mark(LEFTS, again / 32u, bit);"),
        (K::ScanMiddle, "first_reference = place.y", "first_reference = place.x"),
        (K::PlaceMiddle, "small.padding = 0u", "small.padding = 1u"),
        (K::MeasureMiddle, "root.nodes - root.leaves", "root.nodes"),
        (K::EmitMiddle, "<< 2u) | node.kind", "<< 2u) | 0u"),
        (K::BuildSmall, "allocated.x + 2u <= SMALL_ROOT_NODES", "allocated.x < 3u"),
        (K::BuildSmall, "select(NOTHING, 0u, leaf_cost == whole)", "0u"),
        (K::SubtreeSizes, "pair_word(index,", "pair_word(index / 2u,"),
        (K::SubtreeSizes, "top_sizes[index] = vec2<u32>(0u)", "top_sizes[index] = vec2<u32>(1u)"),
        (K::PreorderAddresses, "[COUNTER_NODES] = size.x", "[COUNTER_NODES] = size.y"),
        (K::PreorderAddresses, "counters[COUNTER_LEAF_REFERENCES] = size.y;", ""),
        (K::EmitTop, "<< 2u) | node.kind", "<< 2u) | 0u"),
        (
            K::EmitSmall,
            "put_half(mask.y, first + countOneBits(mask.x), true)",
            "put_half(mask.y, first, true)",
        ),
    ]
    .map(|(kernel, text, fault)| (kernel, text, fault, fast));
    let of_balanced = [
        (K::NodeBounds, "node.source + chunk, node.side", "node.source + chunk, 0u"),
        (K::NodeBounds, "Chunk(index, node.first", "Chunk(index + 1u, node.first"),
        (K::BinReferences, "whole > 0u", "false"),
        (K::BinReferences, "range.x], 0x10001u", "range.x], 1u"),
        (
            K::SplitBinned,
            "expected_split_cost(area, areas, left, right)",
            "expected_split_cost(area, areas, left, left)",
        ),
        (K::SplitBinned, "border.cost.x == atomicLoad(&best_low)", "true"),
        (K::SplitBinned, "sides.x | sides.y | sides.z", "0u"),
    ]
    .map(|(kernel, text, fault)| (kernel, text, fault, balanced));
    let by_one = BuildConfig { block_width: 1, ..balanced };
    let halves = balanced.with_bins(2);
    let of_others = [
        (K::SplitBinned, "low.y + a.y * b", "low.y", by_one),
        (K::SplitBinned, "bin < parameters.bins", "bin + 1u < parameters.bins", halves),
        (K::ClassifyReferences, "right && parameters.clip == 1u", "right", whole),
        (K::ScatterReferences, "if parameters.clip == 1u", "if true", whole),
    ];
    let plants = plants.into_iter().chain(of_balanced).chain(of_others);
    let mut missing = Kernel::ALL.to_vec();
    // Subnormal coordinates, planar triangles, empty space and many levels, so that each fault shows.
    let scene = scenes::zeros_and_subnormals()
        .joined(&scenes::grid_boxes(4), "boxes")
        .joined(&scenes::soup(3000, 0.4, 9), "faults");
    // Bounds that are flat on an axis; triangles that no plane separates.
    let (flat, same) = (scenes::coplanar(1, 500), scenes::identical(500));
    // For caps that bind: on references of large triangles, and on nodes alone.
    let (large, many) = (scenes::soup(12_000, 0.4, 4), scenes::soup(20_000, 0.02, 3));
    let of_flat = (K::BinReferences, "if !axes[axis].divisible", "if false", balanced);
    let of_same = (K::SplitBinned, "node.inseparable == 1u", "false", balanced);
    // Triangles small enough for the middle stage to finish. Only with it does one workgroup say where chunks of children begin.
    let small = scenes::soup(12_000, 0.03, 9);
    let plants = plants.map(|plant| {
        match is_of_middle_stage(plant.0) || plant.1.starts_with("first_chunk") {
            true => (plant, &small),
            false => (plant, &scene),
        }
    });
    let plants = plants.chain([(of_flat, &flat), (of_same, &same)]);
    let references = capped(BuildConfig { references_per_triangle: 1, ..fast });
    let nodes = capped(fast);
    let of_caps = [
        ("sum <= parameters.reference_cap", "sum < 8u", references, &many),
        (
            "saturating_sum(alive, references) > parameters.reference_cap",
            "false",
            references,
            &large,
        ),
        ("top_count + MOST_EMITTED * present > parameters.node_cap", "false", nodes, &many),
    ];
    let of_caps = of_caps
        .map(|(text, fault, config, scene)| ((K::AllocateChildren, text, fault, config), scene));
    let plants = plants.chain(of_caps);
    // One for all: to compile a kernel takes longer than to run it.
    let backend = WgpuBackend::without_selftest(Gpu::clone(&common::gpu()));
    let mut missed = Vec::new();
    for ((kernel, text, fault, config), scene) in plants {
        missing.retain(|without| *without != kernel);
        let source = splitplane_shaders::KERNELS[kernel as usize].source();
        let planted = source.replace(text, fault);
        assert!(planted != source, "{kernel:?}: the text to change is gone");
        backend.replace_kernel(kernel, Some(planted));
        match in_step(&backend, &scene.mesh(), &config) {
            Ok(_) => missed.push(format!("{kernel:?}, {fault}: the fault was not seen")),
            Err(difference) if difference.kernel == format!("{kernel:?}") => {}
            Err(difference) => missed.push(format!("{kernel:?}, {fault}: {difference}")),
        }
        backend.replace_kernel(kernel, None);
    }
    assert!(missed.is_empty(), "{missed:#?}");
    assert!(missing.is_empty(), "no fault is planted in {missing:?}");
}

/// What the middle stage finishes, in step on scenes that it does finish: small triangles, levels of many nodes, nodes that
/// are swept, sides that are clipped and not.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn the_middle_stage_in_step() {
    let backend = WgpuBackend::without_selftest(Gpu::clone(&common::gpu()));
    let default = BuildConfig::default();
    let small = scenes::soup(12_000, 0.03, 9);
    for scene in [&small, &small.joined(&scenes::identical(300), "swept")] {
        for config in [
            default,
            BuildConfig { clip: false, block_width: 1, ..default },
            default.with_stages(|stages| stages.small_node_limit = 20),
        ] {
            check(&backend, scene, &config);
        }
    }
}

/// Builds of the device with the middle stage, and where it cannot finish: the trees are the CPU's, and a build of which the stage
/// was void is not tried with it again.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn builds_with_the_middle_stage() {
    let backend = WgpuBackend::without_selftest(Gpu::clone(&common::gpu()));
    let small = scenes::soup(12_000, 0.03, 9);
    for (scene, repeats) in [(&small, [0, 0]), (&scenes::identical(5_000), [1, 0])] {
        let mesh = scene.mesh();
        let options = BuildConfig::default().into();
        let (expected, summary) = CpuBackend::new().build_tree(&mesh, &options).expect("a tree");
        for repeats in repeats {
            let built = backend.build_on_device(&mesh, &options).expect("a tree");
            let tree = built.tree.read(backend.gpu()).expect("a tree in host memory");
            assert!(tree == expected, "{}", scene.name);
            assert_eq!(built.summary.large_levels, summary.large_levels, "{}", scene.name);
            assert_eq!(built.effort.repeats, repeats, "{}", scene.name);
        }
    }
}

/// No kernel reads memory of its workgroup that it has not written: that memory is not cleared.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn memory_of_workgroups_may_hold_anything() {
    let scene = scenes::grid_boxes(4)
        .joined(&scenes::soup(500, 0.4, 9), "poisoned")
        .joined(&scenes::identical(100), "poisoned");
    let mut seen = 0;
    for (index, kernel) in Kernel::ALL.into_iter().enumerate() {
        let source = splitplane_shaders::KERNELS[index].source();
        for source in poison::WORDS.iter().filter_map(|&word| poison::poisoned(&source, word)) {
            let backend =
                WgpuBackend::with_replaced_kernel(Gpu::clone(&common::gpu()), kernel, source);
            for config in by_every_staged_builder(BuildConfig::default()) {
                check(&backend, &scene, &config);
            }
            seen += 1;
        }
    }
    assert!(seen >= 20, "{seen}");
}

/// A kernel that reads what it has not written is found.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn memory_that_is_read_before_it_is_written_is_seen() {
    let scene = scenes::soup(3000, 0.4, 9);
    for (kernel, text) in [
        (Kernel::AllocateChildren, "        atomicStore(&unfinished, 0u);\n"),
        (Kernel::ClassifyReferences, "        atomicStore(&ballot_words[lane], 0u);\n"),
    ] {
        let source = splitplane_shaders::KERNELS[kernel as usize].source();
        assert!(source.contains(text), "{kernel:?}: the text is not there");
        let source = source.replace(text, "");
        let seen = poison::WORDS.iter().any(|&word| {
            let source = poison::poisoned(&source, word).expect("memory of a workgroup");
            let backend =
                WgpuBackend::with_replaced_kernel(Gpu::clone(&common::gpu()), kernel, source);
            in_step(&backend, &scene.mesh(), &BuildConfig::default()).is_err()
        });
        assert!(seen, "{kernel:?}");
    }
}

/// Sums over the top tree are made by invocations of which none waits for another: in step on deep trees and on such as have more
/// nodes than a dispatch has invocations. Faults in how they are made, and in the counts of the tree, are seen.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn sizes_and_counts_of_the_top_tree() {
    // Leaves of single triangles: without a middle stage the top tree has tens of thousands of nodes.
    let balanced = BuildConfig { block_width: 1, ..Preset::Balanced.config() };
    let balanced = balanced.with_stages(|stages| stages.small_node_limit = 4);
    let many = scenes::soup(12_000, 0.03, 9);
    let deep = scenes::octaves();
    let backend = WgpuBackend::without_selftest(Gpu::clone(&common::gpu()));
    for scene in [&many, &deep] {
        for config in [balanced, BuildConfig::default()] {
            check(&backend, scene, &config);
        }
    }
    for (kernel, name, text, fault) in [
        (Kernel::SubtreeSizes, "subtree_sizes", "(before & ARRIVED) == 0u", "false"),
        (Kernel::SubtreeSizes, "subtree_sizes", "size.y, 1u, 0u", "size.y, 1u, 1u"),
        (Kernel::SubtreeSizes, "subtree_sizes", "size + (before ^ ARRIVED)", "size"),
        (Kernel::SubtreeSizes, "subtree_sizes", "size.x, 0u, 1u", "size.x, 0u, 0u"),
        (
            Kernel::SubtreeSizes,
            "subtree_sizes",
            "var size = vec2<u32>(1u",
            "var size = vec2<u32>(2u",
        ),
        (Kernel::PreorderAddresses, "preorder_addresses", "address.x += 1u", "address.x += 2u"),
        (Kernel::PreorderAddresses, "preorder_addresses", "(node & 1u)", "1u"),
    ] {
        let source = splitplane_shaders::kernel_retry(name).expect("a retry").source();
        let planted = source.replace(text, fault);
        assert!(planted != source, "{text}: the text to change is gone");
        let backend = WgpuBackend::with_replaced_retry(Gpu::clone(&common::gpu()), kernel, planted);
        let difference = in_step(&backend, &many.mesh(), &balanced).expect_err(text);
        assert_eq!(difference.kernel, format!("{kernel:?}"), "{text}: {difference}");
    }
}

/// Subtrees that are not kept are built again, whatever the memory of workgroups holds, and a fault in that is seen.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn subtrees_that_are_built_again() {
    let scene = scenes::soup(1000, 0.9, 9);
    // Triangles so dear that nearly every leaf has one, and subtrees have more nodes than are kept.
    let config = BuildConfig { intersection_cost: 10, ..Preset::Narrow.config() };
    let retry = splitplane_shaders::kernel_retry("emit_small").expect("a retry").source();
    let by = |source| {
        let gpu = Gpu::clone(&common::gpu());
        let backend = WgpuBackend::with_replaced_retry(gpu, Kernel::EmitSmall, source);
        in_step(&backend, &scene.mesh(), &config).is_ok()
    };
    for word in poison::WORDS {
        assert!(by(poison::poisoned(&retry, word).expect("memory of a workgroup")), "{word}");
    }
    let right = "leaf_references[address.y + index] = triangle;";
    let faulty = retry.replace(right, "leaf_references[address.y + index] = triangle ^ 1u;");
    assert_ne!(faulty, retry, "the text to change is gone");
    assert!(!by(faulty), "a fault went unseen");
}

/// Without the middle stage many workgroups write the children whose places one has found: faults in what it tells them, and in what they write, are seen.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn children_that_many_workgroups_write() {
    let kernel = Kernel::AllocateChildren;
    let own = splitplane_shaders::KERNELS[kernel as usize].source();
    let retry = splitplane_shaders::kernel_retry("allocate_children").expect("a retry").source();
    let backend = WgpuBackend::without_selftest(Gpu::clone(&common::gpu()));
    // More nodes in a level than all workgroups take at once, cuts, and nodes that are transferred with cuts and without.
    let scene = scenes::grid_boxes(4).joined(&scenes::soup(6_000, 0.1, 9), "children");
    // Triangles that no plane separates.
    let same = scenes::identical(500);
    let many = BuildConfig { block_width: 1, max_depth: 12, ..Preset::Balanced.config() }
        .with_stages(|stages| stages.small_node_limit = 2);
    let balanced = Preset::Balanced.config();
    let capped = capped(balanced);
    for config in [many, balanced, capped] {
        check(&backend, &scene, &config);
    }
    for (of_retry, text, fault, config) in [
        (
            false,
            "TopNode(place.x, place.z, chunk, 0u)",
            "TopNode(place.z, place.x, chunk, 0u)",
            many,
        ),
        (
            false,
            "TopNode(place.x, place.z, chunk, 0u)",
            "TopNode(place.x, place.z, 0u, 0u)",
            balanced,
        ),
        (false, "decisions[index].first = decision.first;", "", many),
        (false, "decisions[index].counts = decision.counts;", "", capped),
        (true, "emitted_by(decision) == 0u", "false", many),
        (true, "counters[COUNTER_LEVELS] - 1u", "counters[COUNTER_LEVELS]", many),
        (true, "index += 64u * groups.x", "index += 65536u * groups.x", many),
        (true, "here.y += 1u", "here.y += 2u", many),
        (true, "first_chunk += chunks_of(count)", "first_chunk += 1u", balanced),
        (true, "select(0u, 1u, inseparable)", "0u", balanced),
    ] {
        let scene = if text.contains("inseparable") { &same } else { &scene };
        let source = if of_retry { &retry } else { &own };
        let planted = source.replace(text, fault);
        assert!(planted != *source, "{text}: the text to change is gone");
        let gpu = Gpu::clone(&common::gpu());
        let backend = match of_retry {
            true => WgpuBackend::with_replaced_retry(gpu, kernel, planted),
            false => WgpuBackend::with_replaced_kernel(gpu, kernel, planted),
        };
        match in_step(&backend, &scene.mesh(), &config) {
            Ok(_) => panic!("{text}, {fault}: the fault was not seen"),
            Err(difference) => assert_eq!(difference.kernel, format!("{kernel:?}"), "{text}"),
        }
    }
}

/// A schedule for planes that the executor's preset does not find ends in an error.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn a_schedule_for_another_preset_is_refused() {
    let backend = WgpuBackend::without_selftest(Gpu::clone(&common::gpu()));
    let scene = scenes::soup(500, 0.1, 3);
    let build = |mut gpu: WgpuExecutor<'_>| schedule::build(&mut gpu, Planes::Binned);
    let refused = backend.with_executor(&scene.mesh(), &BuildConfig::default(), build);
    let error = refused.expect("buffers").expect_err("a schedule that lacks a buffer");
    assert!(error.to_string().contains("ChunkBins"), "{error}");
}

/// Those of the real scenes that the folder holds.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
#[cfg_attr(no_scenes, ignore = "no scenes folder; set SPLITPLANE_SCENES")]
fn real_scenes() {
    let backend = WgpuBackend::new(Gpu::clone(&common::gpu())).expect("a backend");
    let scenes: Vec<Scene> =
        ["horse", "bunny", "kitchen"].into_iter().filter_map(scenes::real).collect();
    assert!(!scenes.is_empty(), "the scenes folder holds none of the scenes");
    for scene in &scenes {
        for config in by_every_staged_builder(BuildConfig::default()) {
            check(&backend, scene, &config);
        }
    }
}
