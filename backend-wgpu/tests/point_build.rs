//! Trees of points that the device builds: the kernels in step with their serial reference, byte for byte; the trees are those of the
//! serial builder; faults in each kernel are seen at the first dispatch that has them; limits, cancellation and a lost device end in the
//! errors meant for them.

use std::sync::Arc;
use std::sync::atomic::AtomicU64;

use crate::common::{self, Limit, own_gpu, poison, queries as kept, source_of};
use splitplane_core::build::lockstep::{Lockstep, LockstepError};
use splitplane_core::build::points::{Reference, build as run_schedule, large_levels};
use splitplane_core::error::DeviceError;
use splitplane_core::kernel::PointKernel as K;
use splitplane_core::layout::PointBuild;
use splitplane_core::points::build::{self, PointBuildError, PointOptions};
use splitplane_core::points::nearest::{NearestOptions, Neighbour, nearest};
use splitplane_core::points::tree::{Axes, PointTree};
use splitplane_test_support::clouds::clouds;
use splitplane_test_support::random::Random;
use splitplane_wgpu::{Queries, WgpuPointTree};

const AXES: [Axes; 2] = [Axes::Widest, Axes::Cycle];

fn options(axes: Axes) -> PointOptions<'static> {
    PointOptions { axes, ..PointOptions::default() }
}

/// Whether nodes, points and indices of the schedule's reference are those of a tree.
fn is_same<const N: usize>(reference: &Reference<'_>, tree: &PointTree<N>) -> bool {
    let (nodes, points, indices) = reference.tree();
    let bits = |x: &f32| x.to_bits();
    let own = points.iter().flat_map(|point| point[..N].iter().map(bits));
    let padding = points.iter().all(|point| point[N..].iter().all(|x| x.to_bits() == 0));
    nodes == tree.nodes()
        && indices == tree.indices()
        && padding
        && own.eq(tree.points().iter().flatten().map(bits))
}

/// Clouds of the sizes at which levels and chunks begin and end.
fn sizes<const N: usize>() -> Vec<(&'static str, Vec<[f32; N]>)> {
    let mut random = Random::new(70 + N as u64);
    [33, 1007, 1024, 1025, 2048, 2049, 3090, 5200]
        .map(|count| {
            let few = |random: &mut Random| random.below(700) as f32 * 0.01 - 3.0;
            let cloud = (0..count).map(|_| [(); N].map(|()| few(&mut random))).collect();
            ("of a size", cloud)
        })
        .into()
}

/// The schedule, run by its reference alone.
#[test]
fn the_schedule_makes_the_trees_of_the_serial_builder() {
    fn hold<const N: usize>() {
        let mut levels = 0;
        for (name, points) in clouds::<N>().into_iter().chain(sizes::<N>()) {
            for axes in AXES {
                let tree = build::build(&points, &options(axes)).expect("a tree");
                let inputs = PointBuild {
                    given: points.len() as u32,
                    dimensions: N as u32,
                    widest: u32::from(axes == Axes::Widest),
                    zero: 0,
                };
                let mut reference = Reference::new(points.as_flattened(), inputs);
                match run_schedule(&mut reference, axes) {
                    Ok(()) => {}
                    Err(never) => match never {},
                }
                assert!(is_same(&reference, &tree), "{name} of {N}, {axes:?}");
                levels = levels.max(large_levels(tree.len()));
            }
        }
        assert!(levels >= 3, "{levels}");
    }
    hold::<1>();
    hold::<2>();
    hold::<3>();
    hold::<4>();
}

/// The first difference between the kernels on a device and their reference, and whether the reference made the tree of the serial builder.
fn in_step<const N: usize>(
    queries: &Queries,
    points: &[[f32; N]],
    axes: Axes,
) -> (Option<String>, bool) {
    let tree = build::build(points, &options(axes)).expect("a tree");
    let done = queries.with_point_executor(points, axes, |device, inputs| {
        let reference = Reference::new(points.as_flattened(), inputs);
        let mut lockstep = Lockstep::new(reference, device);
        let difference = match run_schedule(&mut lockstep, axes) {
            Ok(()) => None,
            Err(LockstepError::Differs(difference)) => Some(difference.to_string()),
            Err(LockstepError::First(never)) => match never {},
            Err(LockstepError::Second(error)) => panic!("{error}"),
        };
        (difference, is_same(&lockstep.into_inner().0, &tree))
    });
    done.expect("a device that holds the points")
}

fn hold<const N: usize>() {
    for (i, (name, points)) in clouds::<N>().into_iter().chain(sizes::<N>()).enumerate() {
        let axes = AXES[(i + N) % 2];
        let (difference, same) = in_step(&kept(), &points, axes);
        assert_eq!(difference, None, "{name} of {N}, {} points, {axes:?}", points.len());
        assert!(same, "{name}");
    }
}

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn kernels_are_in_step_in_one_and_two_dimensions() {
    hold::<1>();
    hold::<2>();
}

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn kernels_are_in_step_in_three_and_four_dimensions() {
    hold::<3>();
    hold::<4>();
}

/// Trees that are built without a look at the counters are those of the serial builder, and answer.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn trees_are_those_of_the_serial_builder() {
    fn hold<const N: usize>(points: &[[f32; N]], axes: Axes) {
        let expected = build::build(points, &options(axes)).expect("a tree");
        let built = WgpuPointTree::build(kept(), points, &options(axes)).expect("a tree");
        assert!(built.tree() == &expected, "{} points of {N}", points.len());
        assert_eq!(built.tree().digest(), expected.digest());
        assert_eq!(built.tree().report(), expected.report());
        let Some(&query) = points.first().filter(|point| point.iter().all(|x| x.is_finite()))
        else {
            return;
        };
        let asked = NearestOptions { k: 3, ..NearestOptions::default() };
        let mut found = [Neighbour::NONE; 3];
        built.nearest(&[query], &mut found, &asked).expect("answers");
        let mut wanted = nearest(&expected, query, &asked).expect("an answer");
        wanted.resize(3, Neighbour::NONE);
        assert_eq!(found[..], wanted[..]);
    }
    let mut random = Random::new(3);
    let many: Vec<[f32; 3]> = (0..40_000).map(|_| random.point(1.0)).collect();
    for axes in AXES {
        hold(&many, axes);
        for (_, points) in clouds::<2>() {
            hold(&points, axes);
        }
    }
    for (_, points) in clouds::<4>() {
        hold(&points, Axes::Widest);
    }
}

/// A cloud with few places, some of them not finite.
fn cloud() -> Vec<[f32; 3]> {
    let mut random = Random::new(21);
    let place = |random: &mut Random| random.below(40) as f32 * 0.3 - 5.0;
    let mut all: Vec<[f32; 3]> = (0..3000).map(|_| [(); 3].map(|()| place(&mut random))).collect();
    for i in (0..all.len()).step_by(7) {
        all[i] = random.point(3.0);
    }
    (all[5], all[1777]) = ([0.0, f32::NAN, 1.0], [f32::INFINITY; 3]);
    all
}

/// Whatever the memory of workgroups holds at first.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn memory_of_workgroups_may_hold_anything() {
    let cloud = cloud();
    for kernel in K::ALL {
        let Some(source) = poison::poisoned(&source_of(kernel.name()), poison::WORDS[0]) else {
            continue;
        };
        let queries = Queries::new(common::gpu());
        queries.replace_point_build_kernel(kernel, Some(source));
        assert_eq!(in_step(&queries, &cloud, Axes::Widest).0, None, "{kernel:?}");
    }
}

/// Each fault is seen in the kernel that has it.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn planted_faults_are_named() {
    let faults = [
        (K::MeasurePoints, "all && is_finite(bits)", "is_finite(bits)"),
        (K::MeasurePoints, "max(size, bits & 0x7fffffffu)", "max(size, bits)"),
        (K::ScanPoints, "vec2<u32>(own, 0u)).x - own", "vec2<u32>(own, 0u)).x"),
        (K::ScanPoints, "-126, 126) + 127)", "-126, 126) + 126)"),
        (K::ScanPoints, "2u) - 1u) + 1u, blocks", "2u) - 1u), blocks"),
        (K::GatherPoints, "place += 1u;", ""),
        (K::GatherPoints, "-unit_exponent()", "unit_exponent()"),
        (K::PointExtents, "max(most_bits, bits)", "min(most_bits, bits)"),
        (K::PointExtents, "atomicLoad(&upper[2])", "atomicLoad(&upper[3])"),
        (K::ChooseAxes, "extent > greatest", "extent < greatest"),
        (K::ChooseAxes, "POINT_BLOCK << (height - 1u)", "POINT_BLOCK << height"),
        (K::CountDigits, "differs == 0u", "true"),
        (K::PickDigits, "split.known + 8u", "split.known + 7u"),
        (K::PickDigits, "split.rank - before", "split.rank"),
        (K::CountSides, "bits < split.bits", "bits <= split.bits"),
        (K::PlaceSides, "inclusive_scan(lane, own) - own", "inclusive_scan(lane, own)"),
        (K::PlaceSides, "middle_of(node, height) - 1u", "middle_of(node, height)"),
        (K::ScatterPoints, "before.y < split.rank", "before.y <= split.rank"),
        (K::ScatterPoints, "min(before.y, split.rank)", "before.y"),
        (K::NextHeight, "height > SMALL_HEIGHT", "height >= SMALL_HEIGHT"),
        (K::BuildSmallPoints, "order[a] > order[b]", "order[a] < order[b]"),
        (K::BuildSmallPoints, "lane * run + run / 2u", "lane * run"),
        (K::BuildSmallPoints, "sort_runs(lane, POINT_BLOCK);", ""),
        (K::BuildSmallPoints, "size == run || ", ""),
    ];
    let cloud = cloud();
    let mut unseen = Vec::new();
    for (kernel, from, to) in faults {
        let source = source_of(kernel.name());
        assert!(source.contains(from), "{from}: the text is not there");
        let queries = Queries::new(common::gpu());
        queries.replace_point_build_kernel(kernel, Some(source.replacen(from, to, 1)));
        match in_step(&queries, &cloud, Axes::Widest).0 {
            Some(difference) if difference.contains(&format!("{kernel:?}")) => {}
            found => unseen.push((kernel, from, found)),
        }
    }
    // The turn of axes.
    let source = source_of(K::ChooseAxes.name());
    let from = "level += select(0u, 1u, middle < blocks);";
    assert!(source.contains(from));
    let queries = Queries::new(common::gpu());
    queries.replace_point_build_kernel(K::ChooseAxes, Some(source.replacen(from, "", 1)));
    let found = in_step(&queries, &cloud, Axes::Cycle).0;
    assert!(found.is_some_and(|found| found.contains("ChooseAxes")));
    assert!(unseen.is_empty(), "{unseen:#?}");
}

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn builds_can_be_cancelled_and_limited() {
    let cloud = cloud();
    for calls in [1, 2] {
        let watch = Limit(AtomicU64::new(calls));
        let options = PointOptions { watch: Some(&watch), ..options(Axes::Widest) };
        let ended = WgpuPointTree::build(kept(), &cloud, &options).err();
        assert!(matches!(ended, Some(PointBuildError::Cancelled { total: 2998, .. })), "{ended:?}");
    }
    let limited = |most| PointOptions { max_memory: Some(most), ..options(Axes::Widest) };
    let refused = WgpuPointTree::build(kept(), &cloud, &limited(1000)).err();
    let Some(PointBuildError::OutOfMemory { needed, limit: 1000 }) = refused else {
        panic!("{refused:?}");
    };
    assert!(WgpuPointTree::build(kept(), &cloud, &limited(needed - 1)).is_err());
    assert!(WgpuPointTree::build(kept(), &cloud, &limited(needed)).is_ok());
    let five = [[0.0f32; 5]; 3];
    let refused = WgpuPointTree::build(kept(), &five, &options(Axes::Widest)).err();
    assert_eq!(refused, Some(PointBuildError::Dimensions { dimensions: 5 }));
    // More than a binding of 128 MiB holds; none of them is kept on the host before that is known.
    let many = vec![[0.5f32; 1]; 7_000_000];
    let refused = WgpuPointTree::build(kept(), &many, &options(Axes::Widest)).err();
    assert!(
        matches!(refused, Some(PointBuildError::Device(DeviceError::Limit { .. }))),
        "{refused:?}"
    );
}

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn a_lost_device_is_an_error() {
    let gpu = own_gpu();
    let raw = gpu.device().clone();
    let queries = Arc::new(Queries::new(Arc::new(gpu)));
    assert!(WgpuPointTree::build(queries.clone(), &cloud(), &options(Axes::Widest)).is_ok());
    raw.destroy();
    let lost = WgpuPointTree::build(queries, &cloud(), &options(Axes::Widest)).err();
    assert!(matches!(lost, Some(PointBuildError::Device(DeviceError::Lost { .. }))), "{lost:?}");
}
