//! All hits of a ray, in order, each crossing of a surface once.

use alloc::vec::Vec;

use crate::exact::{ExactRay, Meeting, cross};
use crate::ray::{Culling, Hit, QueryOptions, Ray};
use crate::traverse::Triangles;
use crate::tree::KdTreeView;
use crate::triangle::Triangle;

/// A place where a ray crosses a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Crossing {
    /// Where, and in which triangle.
    pub hit: Hit,
    /// Whether the ray comes from the front: the side from which the corners run counter-clockwise.
    pub front: bool,
}

/// The crossings of a batch of rays.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct AllHits {
    /// Where the crossings of each ray begin, and behind the last one their number: one entry more
    /// than there are rays.
    pub starts: Vec<usize>,
    /// The crossings of all rays, one ray after the other, each ray's by (exact distance, triangle).
    pub crossings: Vec<Crossing>,
}

impl AllHits {
    /// The crossings of rays, one ray after the other: the reference.
    pub fn one_by_one(
        tree: &KdTreeView<'_>,
        triangles: &(impl Triangles + ?Sized),
        rays: &[Ray],
        options: &QueryOptions,
    ) -> AllHits {
        let mut all = AllHits { starts: Vec::with_capacity(rays.len() + 1), crossings: Vec::new() };
        all.starts.push(0);
        for ray in rays {
            all_hits(tree, triangles, ray, options, &mut all.crossings);
            all.starts.push(all.crossings.len());
        }
        all
    }

    /// The crossings of a ray of the batch, the nearest first.
    pub fn of(&self, ray: usize) -> &[Crossing] {
        &self.crossings[self.starts[ray]..self.starts[ray + 1]]
    }
}

/// The crossings of one ray between its limits, in order of (exact distance, triangle), added to `out`.
/// They are exact whatever accuracy the options name: see [`crate::exact`]. A ray through an edge or a
/// vertex crosses the surface there once, or not at all where the surface turns back.
///
/// `tree` must be valid (see [`crate::validate`]).
pub fn all_hits(
    tree: &KdTreeView<'_>,
    triangles: &(impl Triangles + ?Sized),
    ray: &Ray,
    options: &QueryOptions,
    out: &mut Vec<Crossing>,
) {
    let mut collector = Collector::default();
    crate::exact::visit(tree, triangles, ray, options, &mut (), |ray, corners, triangle| {
        collector.test(ray, corners, triangle, options.culling);
        f64::INFINITY
    });
    collector.finish(out);
}

/// Collects the crossings of one ray from the triangles of the leaves it passes.
#[derive(Clone, Debug, Default)]
pub struct Collector {
    found: Vec<(Meeting, u32)>,
}

impl Collector {
    /// Tests a triangle (snapped corners), which may come more than once.
    #[inline]
    pub fn test(&mut self, ray: &ExactRay, corners: &Triangle, triangle: u32, culling: Culling) {
        if let Some(met) = cross(ray, corners, culling)
            && met.is_within_limits()
        {
            self.found.push((met, triangle));
        }
    }

    /// Adds what was found to `out`, each triangle once and in order, and is ready for another ray.
    pub fn finish(&mut self, out: &mut Vec<Crossing>) {
        self.found.sort_unstable_by_key(|&(_, triangle)| triangle);
        self.found.dedup_by_key(|&mut (_, triangle)| triangle);
        // Stable: equal distances stay in order of their triangles.
        self.found.sort_by(|(a, _), (b, _)| a.compare_t(b));
        let crossing = |(met, triangle): (Meeting, u32)| Crossing {
            hit: met.hit(triangle),
            front: met.is_front(),
        };
        out.extend(self.found.drain(..).map(crossing));
    }
}
