//! What backends of others get who leave the watched functions as they are.

use core::ops::ControlFlow;
use core::sync::atomic::{AtomicU64, Ordering::Relaxed};

use super::*;
use crate::aabb::Aabb;
use crate::inside::{Location, Rule};
use crate::intersect::{Limits, SceneScale};
use crate::node::KdNode;
use crate::traverse;
use crate::triangle::Triangle;

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

/// A backend with one leaf that has only what it must.
struct OneLeaf;

struct Leaf {
    tree: KdTree,
    summary: BuildSummary,
    scale: SceneScale,
}

impl OneLeaf {
    fn leaf(options: &BuildOptions) -> Leaf {
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
        BackendInfo { name: "one leaf".into(), adapter: None, threads: Some(1), detail: "".into() }
    }

    fn build(
        &self,
        _: &Mesh<'_>,
        options: &BuildOptions,
    ) -> Result<Box<dyn Accelerator>, BuildError> {
        Ok(Box::new(OneLeaf::leaf(options)))
    }

    fn load(
        &self,
        _: &Mesh<'_>,
        _: KdTree,
        options: &BuildOptions,
    ) -> Result<Box<dyn Accelerator>, BuildError> {
        Ok(Box::new(OneLeaf::leaf(options)))
    }
}

impl Leaf {
    /// As a device reports: every thousandth ray of what it was handed flagged, and some counts.
    fn report(rays: &[Ray]) -> QueryReport {
        let flagged: Vec<usize> = (0..rays.len()).step_by(1000).collect();
        QueryReport { undecided: 2 + flagged.len() as u64, flagged, unfinished: 3 }
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

    fn closest_hits(
        &self,
        rays: &[Ray],
        hits: &mut [Hit],
        options: &QueryOptions,
    ) -> Result<QueryReport, QueryError> {
        for (ray, hit) in rays.iter().zip(hits) {
            *hit = self.closest_hit(ray, options).unwrap_or(Hit::MISS);
        }
        Ok(Leaf::report(rays))
    }

    fn any_hits(
        &self,
        rays: &[Ray],
        occluded: &mut [bool],
        options: &QueryOptions,
    ) -> Result<QueryReport, QueryError> {
        for (ray, occluded) in rays.iter().zip(occluded) {
            *occluded = self.any_hit(ray, options);
        }
        Ok(Leaf::report(rays))
    }

    fn all_hits(&self, rays: &[Ray], options: &QueryOptions) -> Result<AllHits, QueryError> {
        AllHits::one_by_one_watched(&self.tree.view(), &TRIANGLES[..], rays, options, &())
    }

    fn closest_hit(&self, ray: &Ray, options: &QueryOptions) -> Option<Hit> {
        traverse::closest_hit(&self.tree.view(), &TRIANGLES[..], &self.scale, ray, options)
    }

    fn any_hit(&self, ray: &Ray, options: &QueryOptions) -> bool {
        traverse::any_hit(&self.tree.view(), &TRIANGLES[..], &self.scale, ray, options)
    }
}

/// Adds up what it is told, weighted by how often it was told before, and ends the work at one of its looks.
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
    let report =
        leaf.closest_hits_watched(&rays, &mut hits, &options, &recorder).expect("equal lengths");
    let [once, twice, done] = [SLICE as u64, 2 * SLICE as u64, COUNT as u64];
    assert_eq!(recorder.sum.into_inner(), 2 * once + 3 * twice + 4 * done);
    for (ray, hit) in rays.iter().zip(&hits) {
        assert_eq!(*hit, leaf.closest_hit(ray, &options).unwrap_or(Hit::MISS));
    }
    assert!(hits.iter().any(Hit::is_hit) && !hits.iter().all(Hit::is_hit));
    let flagged: Vec<usize> = [0, SLICE, 2 * SLICE]
        .into_iter()
        .flat_map(|first| (first..COUNT.min(first + SLICE)).step_by(1000))
        .collect();
    let expected = QueryReport { undecided: 6 + flagged.len() as u64, flagged, unfinished: 9 };
    assert_eq!(report, expected);

    let mut any = alloc::vec![false; COUNT];
    let report = leaf.any_hits_watched(&rays, &mut any, &options, &()).expect("equal lengths");
    assert!(any.iter().zip(&hits).all(|(any, hit)| *any == hit.is_hit()));
    assert_eq!(report, expected);
    for (last, done) in [(1, 0), (2, SLICE), (3, 2 * SLICE), (4, COUNT)] {
        let cancelled = Err(QueryError::Cancelled { done: done as u64, total: COUNT as u64 });
        let recorder = || Recorder::until(last, COUNT as u64);
        assert_eq!(leaf.closest_hits_watched(&rays, &mut hits, &options, &recorder()), cancelled);
        assert_eq!(leaf.any_hits_watched(&rays, &mut any, &options, &recorder()), cancelled);
    }
    let mismatch = Err(QueryError::LengthMismatch { rays: COUNT, results: COUNT - 1 });
    assert_eq!(leaf.closest_hits_watched(&rays, &mut hits[1..], &options, &()), mismatch);
}

#[test]
fn all_hits_are_answered_in_slices() {
    const COUNT: usize = 2 * 4096 + 5;
    let (leaf, options) = (OneLeaf::leaf(&BuildOptions::default()), QueryOptions::default());
    let rays = rays(COUNT);
    let recorder = Recorder::until(u64::MAX, COUNT as u64);
    let all = leaf.all_hits_watched(&rays, &options, &recorder).expect("memory");
    assert_eq!(recorder.sum.into_inner(), 2 * 4096 + 3 * 8192 + 4 * COUNT as u64);
    let expected = leaf.all_hits(&rays, &options).expect("memory");
    assert_eq!((&all.starts, &all.crossings), (&expected.starts, &expected.crossings));
    assert!(!all.crossings.is_empty());
    let cancelled = QueryError::Cancelled { done: 4096, total: COUNT as u64 };
    assert_eq!(
        leaf.all_hits_watched(&rays, &options, &Recorder::until(2, COUNT as u64)),
        Err(cancelled)
    );

    // A limit is one of all slices together.
    let limited = |limit| {
        let options = QueryOptions { max_memory: Some(limit), ..options };
        leaf.all_hits_watched(&rays, &options, &())
    };
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
    let located = leaf.locate(&points).expect("memory");
    assert_eq!(located.windings, [Some(1), Some(0), None, Some(0), None]);
    assert_eq!(located.location(0, Rule::NonZero), Location::Inside);
    assert_eq!(leaf.answered_by_cpu(), 0);
    let total = points.len() as u64;
    let ended = leaf.locate_watched(&points, None, &Recorder::until(9, total));
    assert!(matches!(ended, Err(QueryError::Cancelled { total: 5, .. })), "{ended:?}");
    let lacking = leaf.locate_watched(&points, Some(3), &());
    assert!(matches!(lacking, Err(QueryError::OutOfMemory { limit: 3, .. })), "{lacking:?}");
}

#[test]
fn builds_and_loads_ask_before_and_after() {
    let (mesh, options) = (mesh(), BuildOptions::default());
    let whole = Recorder::until(3, 4);
    let Ok(built) = OneLeaf.build_watched(&mesh, &options, &whole) else { panic!("no tree") };
    let tree = built.tree().clone();
    assert_eq!(whole.sum.into_inner(), 2 * 4);
    let whole = Recorder::until(3, 4);
    assert!(OneLeaf.load_watched(&mesh, tree.clone(), &options, &whole).is_ok());
    assert_eq!(whole.sum.into_inner(), 2 * 4);
    for (last, stage, done) in [(1, Stage::Start, 0), (2, Stage::Layout, 4)] {
        let recorder = || Recorder::until(last, 4);
        let cancelled = BuildError::Cancelled { progress: Progress { stage, done, total: 4 } };
        let built = OneLeaf.build_watched(&mesh, &options, &recorder());
        assert_eq!(built.err(), Some(cancelled.clone()));
        let loaded = OneLeaf.load_watched(&mesh, tree.clone(), &options, &recorder());
        assert_eq!(loaded.err(), Some(cancelled));
    }
}
