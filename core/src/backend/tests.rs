//! The default functions, as backends of embedders get them.

use alloc::vec::Vec;
use core::ops::ControlFlow;
use core::sync::atomic::AtomicU64;
use core::sync::atomic::Ordering::Relaxed;

use super::*;
use crate::aabb::Aabb;
use crate::config::Preset;
use crate::query::inside::{Location, Rule};
use crate::query::intersect::{Limits, SceneScale};
use crate::query::traverse;
use crate::ray::{Accuracy, Culling};
use crate::tree::node::KdNode;
use crate::triangle::Triangle;
use crate::watch::Progress;

/// The corners of a tetrahedron, wound so that fronts are outside.
const CORNERS: [[f32; 3]; 4] = [[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [0.0, 4.0, 0.0], [0.0, 0.0, 4.0]];
const FACES: [[u32; 3]; 4] = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]];
const TRIANGLES: [Triangle; 4] = {
    let mut triangles = [[[0.0; 3]; 3]; 4];
    let mut i = 0;
    while i < 12 {
        triangles[i / 3][i % 3] = CORNERS[FACES[i / 3][i % 3] as usize];
        i += 1;
    }
    triangles
};

fn mesh() -> Mesh<'static> {
    Mesh::indexed(&CORNERS, &FACES).expect("a mesh")
}

/// A backend with one leaf that implements only what it must.
struct OneLeaf;

struct Leaf {
    tree: KdTree,
    summary: BuildSummary,
    scale: SceneScale,
}

impl OneLeaf {
    fn leaf(options: &BuildOptions<'_>) -> Leaf {
        let bounds = Aabb::of_points(&CORNERS);
        let limits = TRIANGLES.iter().fold(Limits::NONE, |all, t| all.union(Limits::of(t)));
        let tree = KdTree {
            nodes: Vec::from([KdNode::leaf(0, 4)]),
            references: Vec::from([0, 1, 2, 3]),
            bounds,
            triangles: 4,
            config: options.config,
        };
        let (summary, scale) = (BuildSummary::default(), SceneScale::new(bounds, &limits));
        Leaf { tree, summary, scale }
    }
}

impl Backend for OneLeaf {
    fn describe(&self) -> BackendInfo {
        BackendInfo { name: "one leaf".into(), threads: Some(1), ..BackendInfo::default() }
    }

    fn build(
        &self,
        _: &Mesh<'_>,
        options: &BuildOptions<'_>,
    ) -> Result<Box<dyn Accelerator>, BuildError> {
        Ok(Box::new(OneLeaf::leaf(options)))
    }

    fn load(
        &self,
        _: &Mesh<'_>,
        _: KdTree,
        _: &LoadOptions<'_>,
    ) -> Result<Box<dyn Accelerator>, BuildError> {
        Ok(Box::new(OneLeaf::leaf(&BuildOptions::default())))
    }
}

impl Accelerator for Leaf {
    fn tree(&self) -> &KdTree {
        &self.tree
    }

    fn summary(&self) -> &BuildSummary {
        &self.summary
    }

    fn query_bytes(&self) -> u64 {
        0
    }

    fn all_hits(&self, rays: &[Ray], options: &AllHitsOptions<'_>) -> Result<AllHits, QueryError> {
        AllHits::one_by_one(&self.tree.view(), &TRIANGLES[..], rays, options)
    }

    fn closest_hit(&self, ray: &Ray, options: &QueryOptions<'_>) -> Option<Hit> {
        traverse::closest_hit(&self.tree.view(), &TRIANGLES[..], &self.scale, ray, options)
    }

    fn any_hit(&self, ray: &Ray, options: &QueryOptions<'_>) -> bool {
        traverse::any_hit(&self.tree.view(), &TRIANGLES[..], &self.scale, ray, options)
    }
}

/// Adds up the reported progress, weighted by the number of earlier calls, and cancels the work at
/// one of its calls.
struct Recorder {
    count: AtomicU64,
    sum: AtomicU64,
    total: u64,
    last: u64,
}

impl Recorder {
    fn until(last: u64, total: u64) -> Recorder {
        Recorder { count: AtomicU64::new(0), sum: AtomicU64::new(0), total, last }
    }
}

impl Watch for Recorder {
    fn progress(&self, progress: &Progress) -> ControlFlow<()> {
        assert_eq!(progress.total, self.total);
        let looks = self.count.fetch_add(1, Relaxed) + 1;
        self.sum.fetch_add(progress.done * looks, Relaxed);
        if looks == self.last { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    }
}

/// Rays up and down beside and through the tetrahedron.
fn rays(count: usize) -> Vec<Ray> {
    let ray = |i: usize| {
        let (x, y) = ((i % 7) as f32 - 0.5, (i / 7 % 5) as f32 - 0.25);
        Ray::new([x, y, -1.0], [0.0, 0.0, 1.0])
    };
    (0..count).map(ray).collect()
}

#[test]
fn batches_are_answered_in_slices() {
    const COUNT: usize = 2 * SLICE + 77;
    let (leaf, options) = (OneLeaf::leaf(&BuildOptions::default()), QueryOptions::default());
    let rays = rays(COUNT);
    let mut hits = alloc::vec![Hit::MISS; COUNT];
    let recorder = Recorder::until(u64::MAX, COUNT as u64);
    let watched = QueryOptions { watch: Some(&recorder), ..options };
    let report = leaf.closest_hits(&rays, &mut hits, &watched).expect("equal lengths");
    let [once, twice, done] = [SLICE as u64, 2 * SLICE as u64, COUNT as u64];
    assert_eq!(recorder.sum.load(Relaxed), 2 * once + 3 * twice + 4 * done);
    for (ray, hit) in rays.iter().zip(&hits) {
        assert_eq!(*hit, leaf.closest_hit(ray, &options).unwrap_or(Hit::MISS));
    }
    assert!(hits.iter().any(Hit::is_hit) && !hits.iter().all(Hit::is_hit));
    assert_eq!(report, QueryReport::default());

    let mut any = alloc::vec![false; COUNT];
    leaf.any_hits(&rays, &mut any, &options).expect("equal lengths");
    assert!(any.iter().zip(&hits).all(|(any, hit)| *any == hit.is_hit()));
    for (last, done) in [(1, 0), (2, SLICE), (3, 2 * SLICE), (4, COUNT)] {
        let cancelled = Err(QueryError::Cancelled { done: done as u64, total: COUNT as u64 });
        for closest in [true, false] {
            let recorder = Recorder::until(last, COUNT as u64);
            let watched = QueryOptions { watch: Some(&recorder), ..options };
            let ended = match closest {
                true => leaf.closest_hits(&rays, &mut hits, &watched),
                false => leaf.any_hits(&rays, &mut any, &watched),
            };
            assert_eq!(ended, cancelled);
        }
    }
    let mismatch = Err(QueryError::LengthMismatch { rays: COUNT, results: COUNT - 1 });
    assert_eq!(leaf.closest_hits(&rays, &mut hits[1..], &options), mismatch);
}

/// By the default: rows are asked for as records, in parts of which the watch sees nothing.
#[test]
fn rows_are_answered_as_their_records() {
    const COUNT: usize = part::RECORDS + SLICE + 77;
    let (leaf, options) = (OneLeaf::leaf(&BuildOptions::default()), QueryOptions::default());
    let records: Vec<Ray> = rays(COUNT).iter().map(|ray| ray.with_limits(0.5, 1.5)).collect();
    let row = |ray: &Ray| {
        let ([a, b, c], [x, y, z]) = (ray.origin, ray.direction);
        [a, b, c, x, y, z]
    };
    let rows: Vec<[f32; 6]> = records.iter().map(row).collect();
    let given = Rays::Rows { rows: &rows, t_min: 0.5, t_max: 1.5 };
    assert_eq!((given.len(), given.is_empty(), given.part(0..0).is_empty()), (COUNT, false, true));
    let (mut own, mut expected) = (alloc::vec![Hit::MISS; COUNT], alloc::vec![Hit::MISS; COUNT]);
    let recorder = Recorder::until(u64::MAX, COUNT as u64);
    let watched = QueryOptions { watch: Some(&recorder), ..options };
    let report = leaf.closest_hits_of(given, &mut own, &watched).expect("equal lengths");
    assert_eq!(report, QueryReport::default());
    // Four slices of the first part begin and it ends; then two of the second, and its end.
    let slice = SLICE as u64;
    let sum = slice * (2 + 2 * 3 + 3 * 4 + 4 * 5 + 4 * 6 + 5 * 7) + 8 * COUNT as u64;
    assert_eq!(recorder.sum.load(Relaxed), sum);
    leaf.closest_hits(&records, &mut expected, &options).expect("equal lengths");
    assert_eq!(own, expected);
    assert!(own.iter().any(Hit::is_hit) && !own.iter().all(Hit::is_hit));
    let (mut own, mut any) = (alloc::vec![false; COUNT], alloc::vec![false; COUNT]);
    leaf.any_hits_of(given, &mut own, &options).expect("equal lengths");
    leaf.any_hits_of(Rays::from(&records[..]), &mut any, &options).expect("equal lengths");
    assert!(own.iter().zip(&expected).all(|(any, hit)| *any == hit.is_hit()) && own == any);

    let recorder = Recorder::until(7, COUNT as u64);
    let watched = QueryOptions { watch: Some(&recorder), ..options };
    let ended = leaf.any_hits_of(given, &mut own, &watched);
    let done = (part::RECORDS + SLICE) as u64;
    assert_eq!(ended, Err(QueryError::Cancelled { done, total: COUNT as u64 }));
    let mismatch = Err(QueryError::LengthMismatch { rays: COUNT, results: COUNT - 1 });
    assert_eq!(leaf.any_hits_of(given, &mut own[1..], &options), mismatch);
}

#[test]
fn reports_on_parts_add_up() {
    let part = |flagged: &[usize]| QueryReport {
        undecided: 2 + flagged.len() as u64,
        flagged: flagged.to_vec(),
        unfinished: 3,
        answered_by_cpu: 5,
    };
    let mut all = QueryReport::default();
    all.append(part(&[0, 7]), 0).expect("memory");
    all.append(part(&[1]), 100).expect("memory");
    let expected = QueryReport {
        undecided: 7,
        flagged: [0, 7, 101].to_vec(),
        unfinished: 6,
        answered_by_cpu: 10,
    };
    assert_eq!(all, expected);
}

#[test]
fn all_hits_keep_their_limit_and_their_watch() {
    const COUNT: usize = 2 * 64 + 5;
    let (leaf, options) = (OneLeaf::leaf(&BuildOptions::default()), AllHitsOptions::default());
    let rays = rays(COUNT);
    let recorder = Recorder::until(u64::MAX, COUNT as u64);
    let watched = AllHitsOptions { watch: Some(&recorder), ..options };
    let all = leaf.all_hits(&rays, &watched).expect("memory");
    // Few crossings per ray: the watch is called between every 64 rays, and where lists grow.
    assert!(recorder.count.load(Relaxed) >= 4);
    let expected = leaf.all_hits(&rays, &options).expect("memory");
    assert_eq!((&all.starts, &all.crossings), (&expected.starts, &expected.crossings));
    assert!(!all.crossings.is_empty());
    let recorder = Recorder::until(1, COUNT as u64);
    let watched = AllHitsOptions { watch: Some(&recorder), ..options };
    let cancelled = QueryError::Cancelled { done: 0, total: COUNT as u64 };
    assert_eq!(leaf.all_hits(&rays, &watched), Err(cancelled));

    let limited =
        |limit| leaf.all_hits(&rays, &AllHitsOptions { max_memory: Some(limit), ..options });
    let enough = 4 * expected.bytes();
    assert!(limited(enough).is_ok());
    let mut refused = 0;
    for limit in (0..enough).step_by(enough as usize / 64) {
        match limited(limit) {
            Ok(all) => assert!(all.bytes() <= limit, "{limit}"),
            Err(QueryError::OutOfMemory { needed, limit: said }) => {
                assert!(said == limit && needed > limit, "{needed} {said} {limit}");
                refused += 1;
            }
            Err(error) => panic!("{error}"),
        }
    }
    assert!(refused > 10, "{refused}");
}

#[test]
fn points_are_located_by_hits_alone() {
    let leaf = OneLeaf::leaf(&BuildOptions::default());
    let points =
        [[0.5, 0.5, 0.5], [3.0, 3.0, 3.0], [0.0, 1.0, 1.0], [-1.0, 0.5, 0.5], [4.0, 0.0, 0.0]];
    let located = leaf.locate(&points, &LocateOptions::default()).expect("memory");
    assert_eq!(located.windings, [Some(1), Some(0), None, Some(0), None]);
    assert_eq!(located.location(0, Rule::NonZero), Location::Inside);
    assert_eq!(located.report, QueryReport::default());
    let recorder = Recorder::until(9, points.len() as u64);
    let watched = LocateOptions { watch: Some(&recorder), ..LocateOptions::default() };
    let ended = leaf.locate(&points, &watched);
    assert!(matches!(ended, Err(QueryError::Cancelled { total: 5, .. })), "{ended:?}");
    let limited = LocateOptions { max_memory: Some(3), ..LocateOptions::default() };
    let lacking = leaf.locate(&points, &limited);
    assert!(matches!(lacking, Err(QueryError::OutOfMemory { limit: 3, .. })), "{lacking:?}");
}

#[test]
fn a_rebuild_replaces_what_was_there() {
    let (mesh, options) = (mesh(), BuildOptions::default());
    let mut built = OneLeaf.build(&mesh, &options).expect("a tree");
    let before: *const dyn Accelerator = &*built;
    let other = BuildOptions { config: Preset::Best.into(), ..options };
    OneLeaf.rebuild(&mut built, &mesh, &other).expect("a tree");
    assert!(!core::ptr::addr_eq(before, &*built));
    assert_eq!(built.tree().config, other.config);
}

#[test]
fn options_for_one_thing_keep_what_it_needs() {
    let watch = |_: &Progress| ControlFlow::Continue(());
    let config = Preset::Best.config();
    assert_eq!(BuildOptions::from(config).config, config);
    let (max_memory, layout) = (Some(77), QueryLayout::Compact);
    let build = BuildOptions { config, max_memory, layout, watch: Some(&watch) };
    let load = build.for_loading();
    assert_eq!((load.max_memory, load.layout), (max_memory, layout));
    assert!(load.watch.is_some());
    let unwatched = build.unwatched();
    assert_eq!((unwatched.config, unwatched.max_memory), (config, max_memory));
    assert!(unwatched.layout == layout && unwatched.watch.is_none());

    let (culling, ignore) = (Culling::Front, Some(3));
    let all = AllHitsOptions { culling, ignore, max_memory, watch: Some(&watch) };
    let query = all.query();
    assert_eq!((query.culling, query.ignore), (culling, ignore));
    // All hits are exact ones.
    assert!(query.accuracy == Accuracy::Exact && query.watch.is_some());
}

/// Answers as a leaf does, and holds the questions to what places of points need.
struct Asked {
    leaf: Leaf,
    room: u64,
}

impl Accelerator for Asked {
    fn tree(&self) -> &KdTree {
        self.leaf.tree()
    }

    fn summary(&self) -> &BuildSummary {
        self.leaf.summary()
    }

    fn query_bytes(&self) -> u64 {
        0
    }

    fn all_hits(&self, rays: &[Ray], options: &AllHitsOptions<'_>) -> Result<AllHits, QueryError> {
        assert!(options.watch.is_some());
        assert_eq!((options.max_memory, options.culling), (Some(self.room), Culling::None));
        let mut all = self.leaf.all_hits(rays, options)?;
        all.report.answered_by_cpu = rays.len() as u64;
        Ok(all)
    }

    fn closest_hit(&self, ray: &Ray, options: &QueryOptions<'_>) -> Option<Hit> {
        self.leaf.closest_hit(ray, options)
    }

    fn any_hit(&self, ray: &Ray, options: &QueryOptions<'_>) -> bool {
        assert_eq!((options.accuracy, options.culling), (Accuracy::Exact, Culling::None));
        self.leaf.any_hit(ray, options)
    }
}

/// Every question is exact, watched, and has the memory that the answer leaves; progress counts points.
#[test]
fn points_are_located_within_their_limits() {
    let points =
        [[0.5, 0.5, 0.5], [3.0, 3.0, 3.0], [0.0, 1.0, 1.0], [-1.0, 0.5, 0.5], [4.0, 0.0, 0.0]];
    let limit = 10_000;
    let room = limit - size_of_val(&[None::<i32>; 5]) as u64;
    let asked = Asked { leaf: OneLeaf::leaf(&BuildOptions::default()), room };
    let (last, calls) = (AtomicU64::new(0), AtomicU64::new(0));
    let watch = |progress: &Progress| {
        let before = last.swap(progress.done, Relaxed);
        assert!(before <= progress.done && progress.done <= before + 1 && progress.total == 5);
        calls.fetch_add(1, Relaxed);
        ControlFlow::Continue(())
    };
    let options = LocateOptions { max_memory: Some(limit), watch: Some(&watch) };
    let located = asked.locate(&points, &options).expect("memory");
    assert_eq!(located.windings, [Some(1), Some(0), None, Some(0), None]);
    // Of the points on the surface no one asked for crossings.
    assert_eq!(located.report.answered_by_cpu, 3);
    assert_eq!(last.load(Relaxed), 5);
    // At each point and at the end.
    assert!(calls.load(Relaxed) >= 6);
    // A watch that hears nothing but of questions is asked by them, too: each can end the work.
    for stop in 1..=calls.load(Relaxed) {
        let recorder = Recorder::until(stop, 5);
        let watched = LocateOptions { watch: Some(&recorder), ..options };
        let ended = asked.locate(&points, &watched);
        assert!(matches!(ended, Err(QueryError::Cancelled { total: 5, .. })), "{ended:?}");
        assert_eq!(recorder.count.load(Relaxed), stop);
    }
}
