//! Trees of points on a device: the reference's answers bit for bit, on clouds that trees trip over and in 1 to 4 dimensions; faults
//! planted in each kernel are found; limits, cancellation and a lost device end in the errors meant for them.

use std::sync::Arc;
use std::sync::atomic::AtomicU64;

use crate::common::{self, Limit, own_gpu, poison, queries as kept, source_of};
use splitplane_core::error::{DeviceError, QueryError};
use splitplane_core::kernel::PointQueryKernel as K;
use splitplane_core::points::build::{PointBuildError, PointOptions, build};
use splitplane_core::points::lists::NeighbourLists;
use splitplane_core::points::nearest::{NearestOptions, Neighbour, nearest, within};
use splitplane_core::points::tree::{Axes, PointTree};
use splitplane_test_support::clouds::{clouds, queries};
use splitplane_test_support::random::Random;
use splitplane_wgpu::{Queries, WgpuPointTree};

/// One, a few in the memory of a workgroup, and more.
const KS: [usize; 4] = [1, 2, 16, 21];

fn tree<const N: usize>(points: &[[f32; N]], axes: Axes) -> PointTree<N> {
    build(points, &PointOptions { axes, ..PointOptions::default() }).expect("a tree")
}

fn options(k: usize) -> NearestOptions<'static> {
    NearestOptions { k, ..NearestOptions::default() }
}

/// What the reference answers, in the form of a batch.
fn expected<const N: usize>(
    tree: &PointTree<N>,
    queries: &[[f32; N]],
    options: &NearestOptions<'_>,
) -> Vec<Neighbour> {
    let mut all = Vec::new();
    for &query in queries {
        let mut own = nearest(tree, query, options).expect("an answer");
        own.resize(options.k, Neighbour::NONE);
        all.extend(own);
    }
    all
}

/// Bits, so that equal means equal.
fn bits(found: &[Neighbour]) -> Vec<(u64, u32)> {
    found.iter().map(|one| (one.distance_squared.to_bits(), one.point)).collect()
}

/// The first difference between a device and the reference.
fn differs<const N: usize>(
    device: &WgpuPointTree<N>,
    queries: &[[f32; N]],
    options: &NearestOptions<'_>,
) -> Option<String> {
    let stale = Neighbour { distance_squared: -1.0, point: 7 };
    let mut found = vec![stale; queries.len() * options.k];
    device.nearest(queries, &mut found, options).expect("answers");
    let expected = expected(device.tree(), queries, options);
    let place = bits(&found).iter().zip(bits(&expected)).position(|(a, b)| *a != b)?;
    let query = queries[place / options.k];
    Some(format!("{query:?}: {:?}, not {:?}", found[place], expected[place]))
}

/// The same for points within a radius.
fn lists_differ<const N: usize>(
    device: &WgpuPointTree<N>,
    queries: &[[f32; N]],
    options: &NearestOptions<'_>,
) -> Option<String> {
    let lists = device.within_each(queries, options).expect("answers");
    assert_eq!(lists.queries(), queries.len());
    for (place, &query) in queries.iter().enumerate() {
        let expected = within(device.tree(), query, options).expect("an answer");
        if bits(lists.of(place)) != bits(&expected) {
            return Some(format!(
                "{query:?}: {} points, not {}",
                lists.of(place).len(),
                expected.len()
            ));
        }
    }
    None
}

fn hold<const N: usize>() {
    for (i, (name, points)) in clouds::<N>().into_iter().enumerate() {
        let queries = queries(&points, &mut Random::new(5));
        let axes = [Axes::Widest, Axes::Cycle][i % 2];
        let device = WgpuPointTree::of(kept(), tree(&points, axes), None).expect("an upload");
        for k in KS {
            assert_eq!(differs(&device, &queries, &options(k)), None, "{name}, k = {k}");
        }
        // To a radius at which some points are, and others are not.
        let far = nearest(device.tree(), queries[0], &options(points.len() / 3 + 1)).unwrap();
        let reach = far.last().map_or(1.0, |one| one.distance_squared.sqrt() as f32);
        let near = NearestOptions { max_distance: reach, ..options(5) };
        assert_eq!(differs(&device, &queries, &near), None, "{name}, near");
        assert_eq!(lists_differ(&device, &queries, &near), None, "{name}, lists");
        let odd = |point: u32| point % 2 == 1;
        let filtered = NearestOptions { filter: Some(&odd), ..near };
        assert_eq!(differs(&device, &queries, &filtered), None, "{name}, odd");
        assert_eq!(lists_differ(&device, &queries, &filtered), None, "{name}, odd lists");
    }
}

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn one_and_two_dimensions_hold() {
    hold::<1>();
    hold::<2>();
}

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn three_dimensions_hold() {
    hold::<3>();
}

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn four_dimensions_hold() {
    hold::<4>();
}

fn uniform(count: usize, seed: u64) -> Vec<[f32; 3]> {
    let mut random = Random::new(seed);
    (0..count).map(|_| random.point(1.0)).collect()
}

/// Whatever the memory of workgroups holds at first.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn memory_of_workgroups_may_hold_anything() {
    let points = uniform(900, 3);
    let queries = uniform(70, 4);
    let near = NearestOptions { max_distance: 0.4, ..options(1) };
    for (kernel, k) in [(K::NearestPoint, 1), (K::NearestPoints, 9), (K::NearestPointsMany, 30)] {
        for word in poison::WORDS {
            let source =
                poison::poisoned(&source_of(kernel.name()), word).expect("memory of workgroups");
            let own = Queries::new(common::gpu());
            own.replace_point_kernel(kernel, Some(source));
            let device =
                WgpuPointTree::of(Arc::new(own), tree(&points, Axes::Widest), None).unwrap();
            assert_eq!(differs(&device, &queries, &options(k)), None, "{kernel:?}");
        }
    }
    let source =
        poison::poisoned(&source_of(K::ListWithin.name()), 1).expect("memory of workgroups");
    let own = Queries::new(common::gpu());
    own.replace_point_kernel(K::ListWithin, Some(source));
    let device = WgpuPointTree::of(Arc::new(own), tree(&points, Axes::Widest), None).unwrap();
    assert_eq!(lists_differ(&device, &queries, &near), None);
}

/// Each fault in a kernel changes an answer, or leaves what the host must answer.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn planted_faults_are_found() {
    let faults = [
        (K::NearestPoint, "bound <= stop.x", "bound > stop.x"),
        (K::NearestPoint, "snapped_product(d.z, d.z)", "snapped_product(d.z, d.y)"),
        (K::NearestPoint, "a.y < b.y", "a.y > b.y"),
        (K::NearestPoint, "select(right, block, left_first)", "select(block, right, left_first)"),
        (
            K::NearestPoints,
            "with_along(gaps, axis, bitcast<f32>(level_words",
            "with_along(gaps, 0u, bitcast<f32>(level_words",
        ),
        (K::NearestPoint, "MARK_ONE_PLACE) != 0u", "MARK_ONE_PLACE) == 0u"),
        (K::NearestPoint, "most(most(below, above), 0.0)", "most(below, above)"),
        (
            K::NearestPoint,
            "least_index(second, lowest, blocks) < stop.y",
            "least_index(second, lowest, blocks) > stop.y",
        ),
        (
            K::NearestPoint,
            "block = select(middle - (1u << level), middle, is_right)",
            "block = middle",
        ),
        (
            K::NearestPoint,
            "min(point_batch.points, first + POINT_BLOCK)",
            "first + POINT_BLOCK - 1u",
        ),
        (K::NearestPoints, "is_before(greater, other)", "is_before(other, greater)"),
        (K::NearestPoints, "if !is_before(key, greater)", "if is_before(key, greater)"),
        // Not another place: what is there may be right, left behind by an earlier batch.
        (
            K::NearestPoints,
            "heap_keys[at * LANES + own_lane] = key",
            "heap_keys[at * LANES + own_lane] = vec2<u32>(key.x, key.y ^ 1u)",
        ),
        (K::NearestPointsMany, "own_query * point_batch.room + at", "own_query + at"),
        (K::NearestPointsMany, "vec2<u32>(bits, indices[place])", "vec2<u32>(bits, place)"),
        (K::CountWithin, "own_count += 1u;", "own_count += 2u;"),
        (K::CountWithin, "bits <= stop.x", "bits < stop.x"),
        (K::ListWithin, "own_start + own_count", "own_start"),
        (
            K::ListWithin,
            "(allowed[place / 32u] >> (place % 32u))",
            "(allowed[place / 32u] >> (place % 31u))",
        ),
    ];
    // Of few places, so that there are ties; some points lie at just the radius.
    let mut random = Random::new(9);
    let mut points: Vec<[f32; 3]> =
        (0..1405).map(|_| [(); 3].map(|()| random.below(9) as f32 * 0.25)).collect();
    points.extend(uniform(400, 8));
    let mut queries = uniform(60, 7);
    queries.extend_from_slice(&points[..60]);
    let odd = |point: u32| point % 3 != 1;
    let near = NearestOptions { max_distance: 0.5, filter: Some(&odd), ..options(1) };
    let mut unseen = Vec::new();
    for (kernel, from, to) in faults {
        let source = source_of(kernel.name());
        assert!(source.contains(from), "{from}: the text is not there");
        let own = Queries::new(common::gpu());
        own.replace_point_kernel(kernel, Some(source.replacen(from, to, 1)));
        let device = WgpuPointTree::of(Arc::new(own), tree(&points, Axes::Widest), None).unwrap();
        let found = match kernel {
            K::NearestPoint => differs(&device, &queries, &options(1)),
            K::NearestPoints => differs(&device, &queries, &options(11)),
            K::NearestPointsMany => differs(&device, &queries, &options(20)),
            // Lists that are not what was counted are left to the host.
            K::CountWithin | K::ListWithin => {
                let lists = device.within_each(&queries, &near).expect("answers");
                let left = lists.report.answered_by_cpu > 0;
                lists_differ(&device, &queries, &near).or(left.then(|| "left to the host".into()))
            }
        };
        if found.is_none() {
            unseen.push((kernel, from));
        }
    }
    assert!(unseen.is_empty(), "{unseen:#?}");
}

/// A batch that is answered in many slices, by a device that answers all of it.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn the_device_answers_ordinary_batches_alone() {
    let device = WgpuPointTree::of(kept(), tree(&uniform(20_000, 1), Axes::Widest), None).unwrap();
    let queries = uniform(20_000, 2);
    let options = options(3);
    let mut found = vec![Neighbour::NONE; 3 * queries.len()];
    let report = device.nearest(&queries, &mut found, &options).expect("answers");
    assert_eq!((report.answered_by_cpu, report.unfinished), (0, 0));
    assert_eq!(bits(&found), bits(&expected(device.tree(), &queries, &options)));
    let near = NearestOptions { max_distance: 0.1, ..options };
    let lists = device.within_each(&queries[..2000], &near).expect("answers");
    assert_eq!(lists.report.answered_by_cpu, 0);
    assert_eq!(lists_differ(&device, &queries[..2000], &near), None);
}

/// Points in one place, and all points for queries that are far away, are at one distance. No walk visits all of them: llvmpipe ends those that do.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn points_at_one_distance_are_not_all_visited() {
    let mut points = uniform(120_000, 3);
    for (i, point) in points.iter_mut().enumerate() {
        if i % 6 != 0 {
            *point = [0.25, 0.5, -0.125];
        }
    }
    let mut queries = uniform(20, 4);
    queries.extend([[0.25, 0.5, -0.125], [0.25, 0.5, -0.1], [0.2, 0.6, -0.2]]);
    queries.extend([[1e9; 3], [-1e9, 0.0, 0.0], [0.0, 1e12, 3.0]]);
    let device = WgpuPointTree::of(kept(), tree(&points, Axes::Widest), None).unwrap();
    for k in [1, 16, 21] {
        let mut found = vec![Neighbour::NONE; k * queries.len()];
        let report = device.nearest(&queries, &mut found, &options(k)).expect("answers");
        assert_eq!((report.answered_by_cpu, report.unfinished), (0, 0), "k = {k}");
        assert_eq!(bits(&found), bits(&expected(device.tree(), &queries, &options(k))), "k = {k}");
    }
}

/// What a device cannot answer, the host does, and says so.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn the_host_answers_what_the_device_cannot() {
    let device = WgpuPointTree::of(kept(), tree(&uniform(3000, 1), Axes::Cycle), None).unwrap();
    let mut queries = uniform(20, 2);
    queries.push([f32::MAX; 3]);
    queries.push([f32::NAN, 0.0, 0.0]);
    let counted = |options: &NearestOptions<'_>| {
        let mut found = vec![Neighbour::NONE; options.k * queries.len()];
        let report = device.nearest(&queries, &mut found, options).expect("answers");
        assert_eq!(bits(&found), bits(&expected(device.tree(), &queries, options)));
        report.answered_by_cpu
    };
    assert_eq!(counted(&options(2)), 1);
    assert_eq!(counted(&options(1025)), queries.len() as u64);
    let odd = |point: u32| point % 2 == 1;
    // A filter of 3,000 points for 22 queries.
    assert_eq!(counted(&NearestOptions { filter: Some(&odd), ..options(2) }), queries.len() as u64);
    assert_eq!(counted(&NearestOptions { max_distance: f32::NAN, ..options(2) }), 0);
    // Points on a sphere, all as far from its centre: no loop of llvmpipe runs so long.
    let ring = |i: u32| {
        let angle = f64::from(i) * 1e-4;
        [angle.cos() as f32, angle.sin() as f32, 0.0]
    };
    let ring: Vec<[f32; 3]> = (0..60_000).map(ring).collect();
    let device = WgpuPointTree::of(kept(), tree(&ring, Axes::Widest), None).unwrap();
    let mut found = vec![Neighbour::NONE; 40_000];
    let report = device.nearest(&[[0.0; 3]], &mut found[..900], &options(900)).expect("answers");
    assert_eq!(bits(&found[..900]), bits(&expected(device.tree(), &[[0.0; 3]], &options(900))));
    assert_eq!(report.unfinished > 0, common::is_llvmpipe(), "{report:?}");
    let lists =
        device.within_each(&[[0.0; 3]], &NearestOptions { max_distance: 2.0, ..options(1) });
    assert_eq!(lists.expect("answers").of(0).len(), 60_000);
}

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn batches_can_be_cancelled_and_limited() {
    let device = WgpuPointTree::of(kept(), tree(&uniform(2000, 1), Axes::Widest), None).unwrap();
    let queries = uniform(3000, 2);
    let mut found = vec![Neighbour::NONE; queries.len()];
    for calls in [1, 2, 3] {
        let watch = Limit(AtomicU64::new(calls));
        let options = NearestOptions { watch: Some(&watch), max_distance: 0.2, ..options(1) };
        let ended = device.nearest(&queries, &mut found, &options);
        assert!(matches!(ended, Err(QueryError::Cancelled { total: 3000, .. })), "{ended:?}");
        let watch = Limit(AtomicU64::new(calls));
        let ended =
            device.within_each(&queries, &NearestOptions { watch: Some(&watch), ..options });
        assert!(matches!(ended, Err(QueryError::Cancelled { total: 3000, .. })), "{ended:?}");
    }
    let refused = |result: Result<(), QueryError>| {
        assert!(matches!(result, Err(QueryError::OutOfMemory { .. })), "{result:?}");
    };
    let limited = |most| NearestOptions { max_memory: Some(most), max_distance: 0.2, ..options(1) };
    refused(device.nearest(&queries, &mut found, &limited(20)).map(|_| ()));
    device.nearest(&queries, &mut found, &limited(3200)).expect("slices of a hundred queries");
    assert_eq!(bits(&found), bits(&expected(device.tree(), &queries, &limited(1 << 20))));
    let all: NeighbourLists = device.within_each(&queries, &limited(1 << 30)).expect("lists");
    let held = 16 * all.found.len() as u64 + 8 * all.starts.len() as u64;
    refused(device.within_each(&queries, &limited(held - 1)).map(|_| ()));
    let again = device.within_each(&queries, &limited(2 * held)).expect("lists");
    assert_eq!((again.starts, bits(&again.found)), (all.starts, bits(&all.found)));
    let short = device.nearest(&queries, &mut found[1..], &options(1));
    assert_eq!(short, Err(QueryError::LengthMismatch { rays: 3000, results: 2999 }));
    let needed = device.bytes();
    let again = WgpuPointTree::of(kept(), device.tree().clone(), Some(needed - 1));
    let limit = needed - 1;
    assert_eq!(again.err(), Some(PointBuildError::OutOfMemory { needed, limit }));
    assert!(WgpuPointTree::of(kept(), device.tree().clone(), Some(needed)).is_ok());
}

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn a_lost_device_is_an_error_and_single_queries_are_answered() {
    let gpu = own_gpu();
    let raw = gpu.device().clone();
    let queries = Arc::new(Queries::new(Arc::new(gpu)));
    let device =
        WgpuPointTree::of(queries.clone(), tree(&uniform(500, 1), Axes::Widest), None).unwrap();
    let asked = uniform(100, 2);
    let mut found = vec![Neighbour::NONE; 100];
    device.nearest(&asked, &mut found, &options(1)).expect("answers");
    raw.destroy();
    let lost = device.nearest(&asked, &mut found, &options(1)).map(|_| ());
    assert!(matches!(lost, Err(QueryError::Device(DeviceError::Lost { .. }))), "{lost:?}");
    let near = NearestOptions { max_distance: 0.3, ..options(1) };
    let lost = device.within_each(&asked, &near).map(|_| ());
    assert!(matches!(lost, Err(QueryError::Device(DeviceError::Lost { .. }))), "{lost:?}");
    let expected = within(device.tree(), asked[0], &near).expect("an answer");
    assert_eq!(device.within(asked[0], &near).map(|found| bits(&found)), Ok(bits(&expected)));
    let upload = WgpuPointTree::of(queries, tree(&uniform(500, 1), Axes::Widest), None).err();
    assert!(
        matches!(upload, Some(PointBuildError::Device(DeviceError::Lost { .. }))),
        "{upload:?}"
    );
}
