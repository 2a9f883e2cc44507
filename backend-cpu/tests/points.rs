//! Point trees against brute force: by the stated operations, bit for bit, and in `f64`, within the stated bound.

use std::ops::ControlFlow;
use std::sync::atomic::{AtomicU64, Ordering};

use splitplane_core::error::QueryError;
use splitplane_core::points::build::{self, PointBuildError, PointOptions};
use splitplane_core::points::distance::ERROR;
use splitplane_core::points::nearest::{self, NearestOptions, Neighbour};
use splitplane_core::points::tree::{Axes, BLOCK, PointTree};
use splitplane_core::watch::Progress;
use splitplane_cpu::{CpuPointTree, InstructionSet, KeptBytes};
use splitplane_test_support::clouds::{clouds, queries};
use splitplane_test_support::near::{neighbours, unit};
use splitplane_test_support::random::Random;

const KS: [usize; 5] = [1, 2, 8, 50, 400];

/// The squared distances in `f64`, in order; beyond its range infinite.
fn true_distances<const N: usize>(points: &[[f32; N]], query: [f32; N]) -> Vec<f64> {
    let finite = points.iter().filter(|point| point.iter().all(|x| x.is_finite()));
    let mut all: Vec<f64> = finite
        .map(|point| {
            (0..N).map(|axis| (f64::from(query[axis]) - f64::from(point[axis])).powi(2)).sum()
        })
        .collect();
    all.sort_by(f64::total_cmp);
    all
}

type Answer<'a, const N: usize> = &'a dyn Fn([f32; N], usize) -> Vec<Neighbour>;

/// What is wrong with answers, if anything.
fn judge<const N: usize>(
    points: &[[f32; N]],
    queries: &[[f32; N]],
    answer: Answer<'_, N>,
) -> Result<(), String> {
    for &query in queries {
        let (all, truth) =
            (neighbours(points, query, f32::INFINITY), true_distances(points, query));
        let unit = unit(points);
        for k in KS {
            let found = answer(query, k);
            let expected = &all[..k.min(all.len())];
            if found != expected {
                return Err(format!("{query:?} k {k}: {found:?}, not {expected:?}"));
            }
            for (found, truth) in found.iter().zip(&truth) {
                let squared = found.distance_squared;
                // Coordinates below 2^-126, in units too, count as 0: this much is lost besides.
                let lost = (unit.max(f64::from(f32::MIN_POSITIVE)) * 1e-18).powi(2) * 8.0;
                let near = (squared - truth).abs()
                    <= ERROR * truth + lost + truth.sqrt() * 1e-37 * unit.max(1.0);
                let overflows = squared.is_infinite() && *truth > unit * unit * 1e37;
                if !(near || overflows) {
                    return Err(format!("{query:?}: {squared:e} is not {truth:e}"));
                }
            }
        }
    }
    Ok(())
}

fn options(k: usize) -> NearestOptions<'static> {
    NearestOptions { k, ..NearestOptions::default() }
}

fn by_backend<const N: usize>(
    tree: &CpuPointTree<N>,
    queries: &[[f32; N]],
    k: usize,
) -> Vec<Neighbour> {
    let mut found = vec![Neighbour { distance_squared: -1.0, point: 7 }; queries.len() * k];
    tree.nearest(queries, &mut found, &options(k)).unwrap();
    found
}

fn hold<const N: usize>() {
    for (name, points) in clouds::<N>() {
        let queries = queries(&points, &mut Random::new(5));
        for axes in [Axes::Widest, Axes::Cycle] {
            let build_options = PointOptions { axes, ..PointOptions::default() };
            let reference = build::build(&points, &build_options).unwrap();
            let by_reference = |query, k| nearest::nearest(&reference, query, &options(k)).unwrap();
            judge(&points, &queries, &by_reference).unwrap_or_else(|e| panic!("{name}: {e}"));
            validate(&reference);
            let dropped = points.iter().filter(|p| !p.iter().all(|x| x.is_finite())).count();
            assert_eq!(reference.report().dropped as usize, dropped, "{name}");
            for set in InstructionSet::available() {
                let tree = CpuPointTree::build(&points, &build_options).unwrap();
                assert_eq!(tree.tree(), &reference, "{name}");
                assert_eq!(tree.tree().digest(), reference.digest(), "{name}");
                let tree = tree.with_instruction_set(set);
                for k in KS {
                    let found = by_backend(&tree, &queries, k);
                    for (&query, found) in queries.iter().zip(found.chunks(k)) {
                        let mut expected = by_reference(query, k);
                        expected.resize(k, Neighbour::NONE);
                        assert_eq!(found, expected, "{name} {set:?} {query:?}");
                    }
                }
            }
        }
    }
}

/// What the layout promises: sides of planes, order in blocks.
fn validate<const N: usize>(tree: &PointTree<N>) {
    for block in tree.indices().chunks(BLOCK) {
        assert!(block.is_sorted_by(|a, b| a < b));
    }
    let mut waiting = vec![(tree.height(), 0)];
    while let Some((height, first)) = waiting.pop() {
        if height == 0 {
            continue;
        }
        let middle = first + (1 << (height - 1));
        waiting.push((height - 1, first));
        let Some(node) = tree.nodes().get(middle - 1) else { continue };
        waiting.push((height - 1, middle));
        let last = tree.len().min((first + (1 << height)) * BLOCK);
        let along = |place: usize| tree.points()[place][node.axis as usize];
        assert!((first * BLOCK..middle * BLOCK).all(|place| along(place) <= node.plane));
        assert!((middle * BLOCK..last).all(|place| along(place) >= node.plane));
    }
}

#[test]
fn one_dimension() {
    hold::<1>();
}

#[test]
fn two_dimensions() {
    hold::<2>();
}

#[test]
fn three_dimensions() {
    hold::<3>();
}

#[test]
fn four_dimensions() {
    hold::<4>();
}

/// Faults that `judge` must notice: a tie the other way, a lost point, a distance that is one float off, a cell
/// that is passed over though it may hold ties.
#[test]
fn faults_are_noticed() {
    let mut random = Random::new(3);
    let points: Vec<[f32; 3]> =
        (0..400).map(|_| [(); 3].map(|()| random.below(6) as f32)).collect();
    let queries = queries(&points, &mut random);
    let tree = build::build(&points, &PointOptions::default()).unwrap();
    let right = |query, k| nearest::nearest(&tree, query, &options(k)).unwrap();
    assert_eq!(judge(&points, &queries, &right), Ok(()));
    let faults: [(&str, Answer<'_, 3>); 4] = [
        ("a tie the other way", &|query, k| {
            let mut found = right(query, k + 1);
            let last = found.len() - 1;
            if found[last].distance_squared == found[last - 1].distance_squared {
                found.swap(last, last - 1);
            }
            found.truncate(k);
            found
        }),
        ("a lost point", &|query, k| {
            let lost = |point| point != 77;
            let options = NearestOptions { filter: Some(&lost), ..options(k) };
            nearest::nearest(&tree, query, &options).unwrap()
        }),
        ("one float off", &|query, k| {
            let mut found = right(query, k);
            for record in &mut found {
                record.distance_squared = f64::from((record.distance_squared as f32).next_up());
            }
            found
        }),
        ("ties beyond a plane", &|query, k| {
            let mut found: Vec<Neighbour> = Vec::new();
            let unit = tree.unit();
            nearest::walk(&tree, query, u64::MAX >> 1, |key| {
                // Strictly nearer ones only, in the order of the walk.
                let record = Neighbour::of(unit, key);
                let nearer = |other: &Neighbour| record.distance_squared < other.distance_squared;
                let place = found.iter().position(nearer).unwrap_or(found.len());
                found.insert(place, record);
                found.truncate(k);
                u64::MAX >> 1
            });
            found
        }),
    ];
    for (name, answer) in faults {
        assert!(judge(&points, &queries, answer).is_err(), "{name}");
    }
}

#[test]
fn radius_and_filter() {
    let mut random = Random::new(8);
    let points: Vec<[f32; 3]> = (0..3000).map(|_| random.point(1.0)).collect();
    let tree = CpuPointTree::build(&points, &PointOptions::default()).unwrap();
    let odd = |point: u32| point % 2 == 1;
    for radius in [0.0, 0.05, 0.3, 10.0, f32::INFINITY, f32::NAN, -1.0] {
        let by_parity: &(dyn Fn(u32) -> bool + Sync) = &odd;
        for filter in [None, Some(by_parity)] {
            for query in queries(&points, &mut random).into_iter().take(40) {
                let all = neighbours(&points, query, f32::INFINITY);
                let reach = (f64::from(radius) * f64::from(radius)) as f32;
                let expected: Vec<Neighbour> = all
                    .into_iter()
                    .filter(|n| radius >= 0.0 && n.distance_squared <= f64::from(reach))
                    .filter(|n| filter.is_none_or(|filter| filter(n.point)))
                    .collect();
                let options = NearestOptions { k: 3, max_distance: radius, filter, ..options(3) };
                assert_eq!(tree.within(query, &options).unwrap(), expected, "{radius} {query:?}");
                assert_eq!(nearest::within(tree.tree(), query, &options).unwrap(), expected);
                let mut three = [Neighbour::NONE; 3];
                tree.nearest(&[query], &mut three, &options).unwrap();
                let mut first = expected;
                first.resize(first.len().max(3), Neighbour::NONE);
                assert_eq!(three, first[..3], "{radius} {query:?}");
            }
        }
    }
}

/// Queries that are answered side by side have each their own end, and none where nothing is near.
#[test]
fn batches_within_a_radius() {
    let mut random = Random::new(9);
    let points: Vec<[f32; 3]> = (0..5000).map(|_| random.point(1.0)).collect();
    let tree = CpuPointTree::build(&points, &PointOptions::default()).unwrap();
    let mut queries = queries(&points, &mut random);
    queries[3] = [f32::NAN; 3];
    for set in InstructionSet::available() {
        let tree = CpuPointTree::of(tree.tree().clone(), None).unwrap().with_instruction_set(set);
        for k in [1, 3, 8, 9] {
            for max_distance in [0.0, 0.05, 0.3, f32::INFINITY, f32::NAN] {
                let options = NearestOptions { max_distance, ..options(k) };
                let mut found = vec![Neighbour::NONE; k * queries.len()];
                tree.nearest(&queries, &mut found, &options).unwrap();
                for (&query, found) in queries.iter().zip(found.chunks(k)) {
                    let mut expected = nearest::nearest(tree.tree(), query, &options).unwrap();
                    expected.resize(k, Neighbour::NONE);
                    assert_eq!(found, expected, "{set:?} {k} {max_distance} {query:?}");
                }
            }
        }
    }
}

#[test]
fn threads_make_no_difference() {
    let mut random = Random::new(21);
    let points: Vec<[f32; 3]> = (0..60_000).map(|_| random.point(3.0)).collect();
    let queries: Vec<[f32; 3]> = (0..5000).map(|_| random.point(4.0)).collect();
    let results: Vec<_> = [1, 2, 5]
        .into_iter()
        .map(|threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| {
                let tree = CpuPointTree::build(&points, &PointOptions::default()).unwrap();
                (tree.tree().digest(), by_backend(&tree, &queries, 9))
            })
        })
        .collect();
    assert!(results.windows(2).all(|two| two[0] == two[1]));
    let reference = build::build(&points, &PointOptions::default()).unwrap();
    assert_eq!(results[0].0, reference.digest());
}

#[test]
fn limits_and_cancellation() {
    let mut random = Random::new(4);
    let points: Vec<[f32; 2]> = (0..50_000).map(|_| [random.signed(), random.signed()]).collect();
    let little = PointOptions { max_memory: Some(1000), ..PointOptions::default() };
    for error in [
        CpuPointTree::build(&points, &little).map(|_| ()),
        build::build(&points, &little).map(|_| ()),
    ] {
        assert!(
            matches!(error, Err(PointBuildError::OutOfMemory { limit: 1000, .. })),
            "{error:?}"
        );
    }
    assert_eq!(
        build::build::<5>(&[], &PointOptions::default()),
        Err(PointBuildError::Dimensions { dimensions: 5 })
    );
    let calls = AtomicU64::new(0);
    let third = |_: &Progress| match calls.fetch_add(1, Ordering::Relaxed) {
        2 => ControlFlow::Break(()),
        _ => ControlFlow::Continue(()),
    };
    let watched = PointOptions { watch: Some(&third), ..PointOptions::default() };
    for run in [CpuPointTree::build(&points, &watched).map(|_| ()), {
        calls.store(0, Ordering::Relaxed);
        build::build(&points, &watched).map(|_| ())
    }] {
        assert!(matches!(run, Err(PointBuildError::Cancelled { total: 50_000, .. })), "{run:?}");
    }
    let tree = CpuPointTree::build(&points, &PointOptions::default()).unwrap();
    let mut found = vec![Neighbour::NONE; 2 * points.len()];
    calls.store(0, Ordering::Relaxed);
    let watched = NearestOptions { watch: Some(&third), ..options(2) };
    let error = tree.nearest(&points, &mut found, &watched);
    assert!(matches!(error, Err(QueryError::Cancelled { total: 50_000, .. })), "{error:?}");
    let error = tree.nearest(&points, &mut found, &options(3));
    assert!(matches!(error, Err(QueryError::LengthMismatch { .. })), "{error:?}");
    let little = NearestOptions { max_memory: Some(10), ..options(2) };
    let error = tree.nearest(&points, &mut found, &little);
    assert!(matches!(error, Err(QueryError::OutOfMemory { limit: 10, .. })), "{error:?}");
    let error = tree.within([0.0; 2], &NearestOptions { max_memory: Some(1000), ..options(1) });
    assert!(matches!(error, Err(QueryError::OutOfMemory { limit: 1000, .. })), "{error:?}");
}

/// A list of all points is given up while it is made: there is one query, so nothing is between two of them.
#[test]
fn one_long_list_is_cancelled() {
    let mut random = Random::new(5);
    let points: Vec<[f32; 2]> = (0..200_000).map(|_| [random.signed(), random.signed()]).collect();
    let tree = CpuPointTree::build(&points, &PointOptions::default()).unwrap();
    let none: &(dyn Fn(u32) -> bool + Sync) = &|_| false;
    for filter in [None, Some(none)] {
        let (calls, last) = (AtomicU64::new(0), AtomicU64::new(u64::MAX));
        let watch = |_: &Progress| match calls.fetch_add(1, Ordering::Relaxed)
            >= last.load(Ordering::Relaxed)
        {
            true => ControlFlow::Break(()),
            false => ControlFlow::Continue(()),
        };
        let all = NearestOptions { watch: Some(&watch), filter, ..options(1) };
        let found = tree.within_each(&[[0.0; 2]], &all).unwrap().found.len();
        assert_eq!(found, if filter.is_some() { 0 } else { points.len() });
        // 24 blocks of points, besides begin and end.
        assert!(calls.swap(0, Ordering::Relaxed) >= 20);
        last.store(9, Ordering::Relaxed);
        let error = tree.within_each(&[[0.0; 2]], &all);
        assert!(matches!(error, Err(QueryError::Cancelled { done: 0, total: 1 })), "{error:?}");
        assert_eq!(calls.load(Ordering::Relaxed), 10, "nobody is asked again");
    }
}

/// All lists, and why there are no more.
fn lists_under(
    tree: &CpuPointTree<3>,
    queries: &[[f32; 3]],
    max_memory: Option<u64>,
    kept: KeptBytes,
) -> (Vec<Vec<Neighbour>>, Option<QueryError>) {
    let mut lists = Vec::new();
    let options = NearestOptions { max_distance: 0.4, max_memory, ..options(1) };
    let done = tree.for_each_within(queries, &options, kept, |found| {
        lists.push(found.to_vec());
        Ok(())
    });
    (lists, done.err())
}

#[test]
fn lists_are_those_of_each_query_whatever_the_limit_and_the_threads() {
    let mut random = Random::new(31);
    let points: Vec<[f32; 3]> = (0..4000).map(|_| random.point(1.0)).collect();
    let tree = CpuPointTree::build(&points, &PointOptions::default()).unwrap();
    let queries: Vec<[f32; 3]> = (0..3000).map(|_| random.point(1.2)).collect();
    let single = NearestOptions { max_distance: 0.4, ..options(1) };
    let expected: Vec<_> =
        queries.iter().map(|&query| tree.within(query, &single).unwrap()).collect();
    for kept in [KeptBytes { list: 8, neighbour: 12 }, KeptBytes { list: 1, neighbour: 0 }] {
        // What the last list to be finished needs beside those before it, to the byte.
        let (mut held, mut least) = (0, 0);
        for found in &expected {
            let found = found.len() as u64;
            let own = kept.list + kept.neighbour * found;
            least = least.max(held + 24 * found).max(held + own + 16 * found);
            held += own;
        }
        for threads in [1, 2, 5] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| {
                for limit in [None, Some(10 * least), Some(least)] {
                    let (lists, error) = lists_under(&tree, &queries, limit, kept);
                    assert!(error.is_none(), "{error:?}, {threads} threads, {limit:?}");
                    assert_eq!(lists, expected, "{threads} threads, {limit:?}");
                }
                let (lists, error) = lists_under(&tree, &queries, Some(least - 1), kept);
                let lacks = Some(QueryError::OutOfMemory { needed: least, limit: least - 1 });
                assert_eq!(format!("{error:?}"), format!("{lacks:?}"), "{threads} threads");
                assert_eq!(lists, expected[..lists.len()]);
            });
        }
    }
}

#[test]
fn a_watch_ends_lists() {
    let points: Vec<[f32; 3]> = (0..2000).map(|i| [i as f32 * 1e-4, 0.0, 0.0]).collect();
    let tree = CpuPointTree::build(&points, &PointOptions::default()).unwrap();
    let most = AtomicU64::new(0);
    let watch = |progress: &Progress| {
        most.fetch_max(progress.done, Ordering::Relaxed);
        if progress.done >= 1024 { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    };
    let (mut shown, queries) = (0, [[0.0; 3]; 8000]);
    let options = NearestOptions { watch: Some(&watch), ..options(1) };
    let done = tree.for_each_within(&queries, &options, KeptBytes::default(), |found| {
        assert_eq!(found.len(), 2000);
        shown += 1;
        Ok(())
    });
    assert!(matches!(done, Err(QueryError::Cancelled { total: 8000, .. })), "{done:?}");
    assert!(shown < 4000 && most.into_inner() < 4000, "{shown} lists");
}

/// Lists of a batch are those of single queries, in as little memory as they take twice, and end where they should.
#[test]
fn lists_of_a_batch() {
    let mut random = Random::new(31);
    let points: Vec<[f32; 3]> = (0..4000).map(|_| random.point(1.0)).collect();
    let tree = CpuPointTree::build(&points, &PointOptions::default()).unwrap();
    let queries = queries(&points, &mut random);
    let near = NearestOptions { max_distance: 0.2, ..options(1) };
    let lists = tree.within_each(&queries, &near).unwrap();
    assert_eq!(lists.queries(), queries.len());
    for (place, &query) in queries.iter().enumerate() {
        assert_eq!(lists.of(place), tree.within(query, &near).unwrap(), "{query:?}");
    }
    assert!(lists.found.len() > 300, "{}", lists.found.len());
    let held = (16 * lists.found.len() + 8 * lists.starts.len()) as u64;
    let limited = |most| NearestOptions { max_memory: Some(most), ..near };
    assert_eq!(tree.within_each(&queries, &limited(3 * held)).unwrap().found, lists.found);
    let error = tree.within_each(&queries, &limited(held - 1));
    assert!(matches!(error, Err(QueryError::OutOfMemory { .. })), "{error:?}");
    let stop = |_: &Progress| ControlFlow::Break(());
    let error = tree.within_each(&queries, &NearestOptions { watch: Some(&stop), ..near });
    assert!(matches!(error, Err(QueryError::Cancelled { done: 0, .. })), "{error:?}");
}
