//! Triangles that are much larger than the leaves that name them, such as the ground under everything.
//!
//! The point of a hit may be off by a part of the triangle's size, so the boxes of leaves are widened by as much
//! ([`splitplane_core::query::intersect::widened`]). For a ground of a thousand kilometres that is four metres: smaller leaves
//! that name it would all overlap. So the few largest triangles become children of the root of the wide tree, and leaves
//! are widened for their other triangles only. Leaves without other triangles vanish. The kd-tree itself stays as it is:
//! its leaves still name the large triangles, and a ray may test one twice.

use splitplane_core::aabb::Aabb;
use splitplane_core::query::intersect::{SIZE_SLACK, longest_extent};
use splitplane_core::tree::KdTreeView;
use splitplane_core::tree::node::NodeKind;
use splitplane_core::triangle::{Triangle, prepare};

use super::cells::halves;
use crate::cancel::ProgressMeter;
use crate::parallel::{Parallel, ParallelSlice};
use crate::span;

/// Most of them: rays test them in whatever leaf they start, so where there are more they stay in their leaves.
const MOST: usize = 64;
/// So few cost rays next to nothing.
const FEW: usize = 16;
/// How many times as long as a leaf is a triangle that widens the leaf by a 64th of its length. Such triangles are large
/// where they are few.
const TIMES_FEW: f32 = 1.0 / (64.0 * SIZE_SLACK);
/// The same for an eighth of the length, for up to [`MOST`] triangles.
const TIMES_MANY: f32 = 1.0 / (8.0 * SIZE_SLACK);
/// Number of leaves sampled to estimate the usual extent.
const SAMPLES: usize = 63;

/// The triangles of a tree that are much larger than its leaves.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Large {
    count: usize,
    triangles: [u32; MOST],
    /// Their bounds.
    pub bounds: Aabb,
    /// Bounds of all other triangles.
    pub others: Aabb,
    /// The unit of the first of their blocks, and how many there are; none in the compact layout.
    pub blocks: [u32; 2],
}

impl Large {
    /// None of some triangles with these bounds.
    pub(crate) const fn none(others: Aabb) -> Large {
        let (triangles, bounds) = ([0; MOST], Aabb::EMPTY);
        Large { count: 0, triangles, bounds, others, blocks: [0; 2] }
    }

    /// Those of a tree over snapped triangles, if there are some and they are few. After cancellation the result is
    /// incomplete and must not be used.
    pub(crate) fn of(
        tree: &KdTreeView<'_>,
        triangles: &[Triangle],
        meter: &ProgressMeter<'_>,
    ) -> Large {
        let leaf = typical_leaf(tree);
        for (times, most) in [(TIMES_FEW, FEW), (TIMES_MANY, MOST)] {
            // No triangle is longer than all together.
            if longest_extent(&tree.bounds) <= leaf * times {
                break;
            }
            let large = Large::longer(leaf * times, triangles, meter);
            if large.count <= most {
                return large;
            }
        }
        Large::none(tree.bounds)
    }

    /// Triangles that are longer than a limit, and bounds of all others.
    fn longer(limit: f32, triangles: &[Triangle], meter: &ProgressMeter<'_>) -> Large {
        let _loop = span::pieces_of(1);
        let of_chunk = |(chunk, triangles): (usize, &[Triangle])| {
            let _piece = span::piece();
            let mut large = Large::none(Aabb::EMPTY);
            if meter.record_work(triangles.len() as u64) {
                return large;
            }
            for (corners, index) in triangles.iter().zip(4096 * chunk as u32..) {
                let bounds = Aabb::of_points(corners);
                if !prepare(corners).kept {
                    // Named by no leaf.
                } else if longest_extent(&bounds) > limit {
                    large.push(index);
                    large.bounds = large.bounds.union(&bounds);
                } else {
                    large.others = large.others.union(&bounds);
                }
            }
            large
        };
        let join = |all: &mut Large, some: Large| {
            (0..some.count).for_each(|i| all.push(some.triangles.get(i).map_or(0, |&t| t)));
            all.bounds = all.bounds.union(&some.bounds);
            all.others = all.others.union(&some.others);
        };
        let chunks = triangles.par_chunks(4096).enumerate();
        let mut large = chunks.reduce(Large::none(Aabb::EMPTY), of_chunk, join);
        // Chunks are joined as they end.
        let listed = large.count.min(MOST);
        large.triangles[..listed].sort_unstable();
        large
    }

    /// One more, which is only counted where there is no place for it.
    fn push(&mut self, triangle: u32) {
        if let Some(place) = self.triangles.get_mut(self.count) {
            *place = triangle;
        }
        self.count += 1;
    }

    /// Their indices.
    #[inline]
    pub(crate) fn triangles(&self) -> &[u32] {
        &self.triangles[..self.count]
    }

    /// Whether there are any.
    pub(crate) fn is_empty(&self) -> bool {
        self.count == 0
    }

    /// Bounds of those of some triangles that are not large, given by index and corners.
    pub(crate) fn bounds_of_others(
        &self,
        triangles: impl Iterator<Item = (u32, Triangle)>,
    ) -> Aabb {
        let others = triangles.filter(|(index, _)| !self.triangles().contains(index));
        others.fold(Aabb::EMPTY, |all, (_, corners)| all.union(&Aabb::of_points(&corners)))
    }
}

/// The median of some leaves' longest extents; infinite where all that were looked at are empty.
fn typical_leaf(tree: &KdTreeView<'_>) -> f32 {
    let mut extents = [f32::INFINITY; SAMPLES];
    for (sample, extent) in extents.iter_mut().enumerate() {
        let target =
            (tree.nodes.len() as u64 * (2 * sample as u64 + 1) / (2 * SAMPLES as u64)) as u32;
        let (mut node, mut cell) = (0, tree.bounds);
        while let Some(at) = tree.nodes.get(node as usize) {
            match at.kind() {
                NodeKind::Interior { axis, split, right } => {
                    let (left_cell, right_cell) = halves(&cell, axis as usize, split);
                    (node, cell) =
                        if target < right { (node + 1, left_cell) } else { (right, right_cell) };
                }
                NodeKind::Leaf { count, .. } => {
                    if count > 0 {
                        *extent = longest_extent(&cell);
                    }
                    break;
                }
            }
        }
    }
    extents.sort_unstable_by(f32::total_cmp);
    let seen = extents.iter().filter(|extent| extent.is_finite()).count();
    extents[seen / 2]
}

#[cfg(test)]
mod tests {
    use splitplane_core::backend::{Accelerator, BuildOptions};
    use splitplane_core::mesh::Mesh;
    use splitplane_test_support::scenes;

    use super::*;
    use crate::CpuBackend;
    use crate::cancel::UNWATCHED;

    /// The large ones of a soup with some more triangles in front.
    fn large(more: &[Triangle]) -> Large {
        let soup = scenes::soup(2000, 0.01, 3).triangles();
        let all = [more, &soup].concat();
        let mesh = Mesh::soup(&all).expect("a mesh");
        let backend = CpuBackend::new();
        let built = backend.build_accelerator(&mesh, &BuildOptions::default()).expect("a tree");
        let large = Large::of(&built.tree().view(), &all, &UNWATCHED);
        if large.is_empty() {
            assert_eq!((large.others, large.bounds), (built.tree().bounds, Aabb::EMPTY));
        } else {
            let others = (0..).zip(all.iter().copied()).filter(|(_, t)| prepare(t).kept);
            assert_eq!(large.others, large.bounds_of_others(others));
            assert!(large.others.contains(&Aabb::of_points(soup.as_flattened())));
            assert!(longest_extent(&large.others) < 3.0);
        }
        large
    }

    #[test]
    fn the_largest_few_are_apart() {
        let triangle = |size: f32| [[-size, 0.0, 0.0], [size, 0.0, 0.1], [0.0, size, 0.2]];
        let far = triangle(1e5);
        assert!(large(&[]).is_empty());
        assert!(large(&[triangle(1.0)]).is_empty(), "as long as the soup");
        assert_eq!(large(&[triangle(1.0), far]).triangles(), [1]);
        // In no leaf.
        let dropped = [[1e5; 3], [1e5; 3], [1e5; 3]];
        assert_eq!(large(&[dropped, far]).triangles(), [1]);
        let most = large(&[far; MOST]);
        assert_eq!(most.triangles(), (0..MOST as u32).collect::<Vec<_>>());
        assert_eq!(most.bounds, Aabb::of_points(&far));
        assert!(large(&[far; MOST + 1]).is_empty(), "too many");
        // Large where they are few.
        let longer = triangle(1200.0);
        assert_eq!(large(&[longer; FEW]).triangles().len(), FEW);
        assert!(large(&[longer; FEW + 1]).is_empty());
        // Without any others nothing is larger than its leaf.
        let mesh = [far; 3];
        let mesh = Mesh::soup(&mesh).expect("a mesh");
        let built = CpuBackend::new().build_accelerator(&mesh, &BuildOptions::default());
        let built = built.expect("a tree");
        assert!(Large::of(&built.tree().view(), &[far; 3], &UNWATCHED).is_empty());
    }
}
