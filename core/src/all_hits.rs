//! All hits of a ray, in order, each crossing of a surface once.

use alloc::vec::Vec;
use core::cmp::Ordering;

use crate::exact::{ExactRay, Meeting, cross};
use crate::ray::{Hit, QueryOptions, Ray};
use crate::traverse::Triangles;
use crate::tree::KdTreeView;

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
    let mut found: Vec<(Meeting, u32)> = Vec::new();
    crate::exact::visit(
        tree,
        triangles,
        ray,
        options,
        &mut (),
        |ray: &ExactRay, corners, triangle| {
            if let Some(met) = cross(ray, corners, options.culling)
                && met.is_within_limits()
            {
                found.push((met, triangle));
            }
            f64::INFINITY
        },
    );
    // A triangle may be in several leaves.
    found.sort_unstable_by_key(|&(_, triangle)| triangle);
    found.dedup_by_key(|&mut (_, triangle)| triangle);
    found.sort_by(|(a, i), (b, j)| match a.compare_t(b) {
        Ordering::Equal => i.cmp(j),
        order => order,
    });
    out.extend(
        found
            .iter()
            .map(|(met, triangle)| Crossing { hit: met.hit(*triangle), front: met.is_front() }),
    );
}
