//! The builder: at each node the points are divided by selection, with whole numbers and compares alone.

use crate::arithmetic::Strict;
use crate::error::DeviceError;
use crate::points::distance::Unit;
use crate::points::tree::{
    Axes, BLOCK, PointNode, PointReport, PointTree, Record, from_ordered, height,
};
use crate::watch::Watch;
use alloc::string::String;
use alloc::vec::Vec;
use thiserror::Error;

/// The most points of a tree.
pub const MOST_POINTS: usize = 1 << 30;

/// Settings of a build.
#[derive(Clone, Copy, Debug, Default)]
pub struct PointOptions<'a> {
    /// How axes are chosen.
    pub axes: Axes,
    /// The most bytes that the build may hold beside the caller's points; `None` for no limit.
    pub max_memory: Option<u64>,
    /// Receives the number of points whose subtrees are finished, and may cancel the build.
    pub watch: Option<&'a dyn Watch>,
}

/// Why points were not built.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum PointBuildError {
    /// Trees have 1 to 4 dimensions.
    #[error("a point tree has 1 to 4 dimensions, not {dimensions}")]
    Dimensions {
        /// What was asked for.
        dimensions: usize,
    },
    /// More points than a tree may have.
    #[error("{points} points were given, more than the {MOST_POINTS} that a tree may have")]
    TooManyPoints {
        /// Points given.
        points: usize,
    },
    /// More memory than allowed, or than the system has.
    #[error("the build needs {needed} bytes, more than the {limit} that it may have")]
    OutOfMemory {
        /// Bytes needed.
        needed: u64,
        /// The limit; where the system refused, as many as are `needed`.
        limit: u64,
    },
    /// The watch cancelled the build.
    #[error("cancelled after {done} of {total} points")]
    Cancelled {
        /// Points in finished subtrees.
        done: u64,
        /// Points of the tree.
        total: u64,
    },
    /// A device does not compute as the CPU does, so its tree and answers would be others.
    #[error(
        "the device is not bitwise equal to the CPU ({difference}), so its trees of points would be others; build \
         them on the CPU"
    )]
    NotBitwise {
        /// The first difference that the device's self-test found.
        difference: String,
    },
    /// A device failed, or cannot do what was asked.
    #[error(transparent)]
    Device(#[from] DeviceError),
}

/// What a build must know of its points before it moves any.
#[derive(Clone, Copy, Debug)]
pub struct Survey {
    /// What the tree will measure in.
    pub unit: Unit,
    /// Points given, and how many of them are left out.
    pub report: PointReport,
}

impl Survey {
    /// Looks at all points.
    ///
    /// # Errors
    /// [`PointBuildError::Dimensions`] and [`PointBuildError::TooManyPoints`].
    pub fn of<const N: usize>(points: &[[f32; N]]) -> Result<Survey, PointBuildError> {
        if N == 0 || N > 4 {
            return Err(PointBuildError::Dimensions { dimensions: N });
        }
        if points.len() > MOST_POINTS {
            return Err(PointBuildError::TooManyPoints { points: points.len() });
        }
        let mut dropped = 0;
        let mut greatest = greatest_bits(points.as_flattened());
        if greatest >= INFINITE {
            greatest = 0;
            for point in points {
                let most = greatest_bits(point);
                dropped += u32::from(most >= INFINITE);
                greatest = greatest.max(if most < INFINITE { most } else { 0 });
            }
        }
        let report = PointReport { points: points.len() as u32, dropped };
        Ok(Survey { unit: Unit::of(f32::from_bits(greatest)), report })
    }

    /// Points that are kept.
    pub fn kept(&self) -> usize {
        (self.report.points - self.report.dropped) as usize
    }

    /// The tree of nodes, and of points (in the tree's unit) and their indices in the order of the tree.
    ///
    /// # Panics
    /// Where there are not as many as there are to be.
    pub fn finish<const N: usize>(
        self,
        axes: Axes,
        nodes: Vec<PointNode>,
        points: Vec<[f32; N]>,
        indices: Vec<u32>,
    ) -> PointTree<N> {
        let kept = self.kept();
        assert_eq!([points.len(), indices.len()], [kept; 2]);
        assert_eq!(nodes.len(), kept.div_ceil(BLOCK).saturating_sub(1));
        let Survey { unit, report } = self;
        PointTree::new(axes, unit, report, nodes, points, indices)
    }
}

/// Whether a build keeps a point: all coordinates are finite.
#[inline]
pub fn is_kept<const N: usize>(point: &[f32; N]) -> bool {
    greatest_bits(point) < INFINITE
}

/// A tree that is being built: the records are divided until they stand in the order of the tree.
#[derive(Debug)]
pub struct PointBuild<const N: usize> {
    axes: Axes,
    survey: Survey,
    /// The points that are kept.
    pub records: Vec<Record<N>>,
    /// The nodes of the tree.
    pub nodes: Vec<PointNode>,
}

impl<const N: usize> PointBuild<N> {
    /// Checks points and options, and gathers the points that are kept.
    ///
    /// # Errors
    /// All of [`PointBuildError`] but a cancellation.
    pub fn new(
        points: &[[f32; N]],
        options: &PointOptions<'_>,
    ) -> Result<PointBuild<N>, PointBuildError> {
        let survey = Survey::of(points)?;
        let (unit, kept) = (survey.unit, survey.kept());
        let needed = bytes::<N>(kept);
        if let Some(limit) = options.max_memory.filter(|&limit| needed > limit) {
            return Err(PointBuildError::OutOfMemory { needed, limit });
        }
        let mut records = reserved(kept, needed)?;
        let record = |(index, point): (usize, &[f32; N])| {
            let mut units = *point;
            for axis in 0..N {
                units[axis] = unit.scaled::<Strict>(point[axis]);
            }
            Record::new(units, index as u32)
        };
        let all = points.iter().enumerate();
        if kept == points.len() {
            records.extend(all.map(record));
        } else {
            records.extend(all.filter(|(_, point)| is_kept(point)).map(record));
        }
        let inner = kept.div_ceil(BLOCK).saturating_sub(1);
        let mut nodes = reserved(inner, needed)?;
        nodes.resize(inner, PointNode { plane: 0.0, axis: 0 });
        Ok(PointBuild { axes: options.axes, survey, records, nodes })
    }

    /// The work on all points.
    pub fn root(&mut self) -> Subtree<'_, N> {
        let height = height(self.records.len());
        Subtree {
            axes: self.axes,
            height,
            level: 0,
            records: &mut self.records,
            nodes: &mut self.nodes,
        }
    }

    /// The tree, from records in its order.
    ///
    /// # Errors
    /// No memory.
    pub fn finish(self) -> Result<PointTree<N>, PointBuildError> {
        let PointBuild { axes, survey, records, nodes } = self;
        let needed = bytes::<N>(records.len());
        let mut points = reserved(records.len(), needed)?;
        let mut indices = reserved(records.len(), needed)?;
        points.extend(records.iter().map(Record::coordinates));
        indices.extend(records.iter().map(|record| record.point));
        Ok(survey.finish(axes, nodes, points, indices))
    }
}

/// Magnitudes from here on are not finite.
const INFINITE: u32 = f32::INFINITY.to_bits();

/// The greatest magnitude of coordinates, as the bits of a float, which are in the order of magnitudes.
#[inline(always)]
fn greatest_bits(coordinates: &[f32]) -> u32 {
    // Compared with signs, which none has: vectors of SSE2 can do that.
    let mut most = 0;
    for x in coordinates {
        most = most.max((x.to_bits() & 0x7fff_ffff).cast_signed());
    }
    most.cast_unsigned()
}

/// Bytes of a build: records, and the tree with points, indices and nodes.
fn bytes<const N: usize>(points: usize) -> u64 {
    let nodes = points.div_ceil(BLOCK) * size_of::<PointNode>();
    PointTree::<N>::summary_bytes(points)
        + (points * (size_of::<Record<N>>() + size_of::<[f32; N]>() + size_of::<u32>()) + nodes)
            as u64
}

fn reserved<T>(count: usize, needed: u64) -> Result<Vec<T>, PointBuildError> {
    let mut items = Vec::new();
    let refused = |_| PointBuildError::OutOfMemory { needed, limit: needed };
    items.try_reserve_exact(count).map_err(refused)?;
    Ok(items)
}

/// A subtree that is to be built: its points and its nodes.
#[derive(Debug)]
pub struct Subtree<'a, const N: usize> {
    axes: Axes,
    height: u32,
    level: u32,
    records: &'a mut [Record<N>],
    nodes: &'a mut [PointNode],
}

impl<'a, const N: usize> Subtree<'a, N> {
    /// Points in it.
    pub fn len(&self) -> usize {
        self.records.len()
    }

    /// True where it has no points.
    pub fn is_empty(&self) -> bool {
        self.records.is_empty()
    }

    /// Divides the points among two children, or puts those of a block in order.
    pub fn divide(self) -> Option<[Subtree<'a, N>; 2]> {
        let Subtree { axes, mut height, level, records, nodes } = self;
        if nodes.is_empty() {
            records.sort_unstable_by_key(|record| record.point);
            return None;
        }
        while 1 << (height - 1) > nodes.len() {
            height -= 1;
        }
        let half = 1 << (height - 1);
        let axis = match axes {
            Axes::Cycle => level as usize % N,
            Axes::Widest => widest(records),
        };
        let middle = half * BLOCK;
        let (_, first, _) = records.select_nth_unstable_by_key(middle, |record| record.key(axis));
        let plane = from_ordered(first.bits[axis]);
        let (left, right) = records.split_at_mut(middle);
        let (left_nodes, rest) = nodes.split_at_mut(half - 1);
        let (node, right_nodes) = rest.split_at_mut(1);
        node[0] = PointNode { plane, axis: axis as u32 };
        let (height, level) = (height - 1, level + 1);
        let child = |records, nodes| Subtree { axes, height, level, records, nodes };
        Some([child(left, left_nodes), child(right, right_nodes)])
    }
}

/// The axis along which records reach farthest. Differences of units neither overflow nor, snapped, depend on the device.
fn widest<const N: usize>(records: &[Record<N>]) -> usize {
    let (mut lower, mut upper) = ([u32::MAX; N], [0; N]);
    for record in records {
        for axis in 0..N {
            lower[axis] = lower[axis].min(record.bits[axis]);
            upper[axis] = upper[axis].max(record.bits[axis]);
        }
    }
    let (mut best, mut most) = (0, -1.0);
    for axis in 0..N {
        let extent = crate::arithmetic::snap(from_ordered(upper[axis]) - from_ordered(lower[axis]));
        if extent > most {
            (best, most) = (axis, extent);
        }
    }
    best
}

/// Builds a tree, serially: the definition of its bytes.
///
/// ```
/// use splitplane_core::points::build::{PointOptions, build};
/// use splitplane_core::points::nearest::{NearestOptions, nearest};
///
/// let points = [[0.0, 0.0], [3.0, 4.0], [f32::NAN, 1.0]];
/// let tree = build(&points, &PointOptions::default()).unwrap();
/// assert_eq!(tree.report().dropped, 1);
/// let found = nearest(&tree, [3.0, 3.0], &NearestOptions { k: 2, ..Default::default() }).unwrap();
/// assert_eq!((found[0].point, found[0].distance_squared), (1, 1.0));
/// assert_eq!((found[1].point, found[1].distance_squared), (0, 18.0));
/// ```
///
/// # Errors
/// See [`PointBuildError`].
pub fn build<const N: usize>(
    points: &[[f32; N]],
    options: &PointOptions<'_>,
) -> Result<PointTree<N>, PointBuildError> {
    use crate::watch::{Progress, Stage};
    let mut build = PointBuild::new(points, options)?;
    let total = build.records.len() as u64;
    let (mut done, mut told) = (0, 0);
    let tell = |done| {
        let progress = Progress { stage: Stage::Points, done, total };
        match options.watch.is_some_and(|watch| watch.progress(&progress).is_break()) {
            true => Err(PointBuildError::Cancelled { done, total }),
            false => Ok(()),
        }
    };
    tell(0)?;
    // A child of each level waits, and no tree is higher than 26.
    let mut waiting = Vec::new();
    waiting.try_reserve_exact(40).map_err(|_| PointBuildError::OutOfMemory {
        needed: bytes::<N>(total as usize),
        limit: bytes::<N>(total as usize),
    })?;
    waiting.push(build.root());
    while let Some(subtree) = waiting.pop() {
        let points = subtree.len() as u64;
        match subtree.divide() {
            Some([left, right]) => waiting.extend([right, left]),
            None => done += points,
        }
        if done >= told + 4096 {
            tell(done)?;
            told = done;
        }
    }
    tell(done)?;
    build.finish()
}
