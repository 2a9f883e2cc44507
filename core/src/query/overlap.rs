//! The triangles of a mesh that meet a box, a ball, a capsule, a convex set or a triangle.
//!
//! All sets are closed, and what meets is decided exactly for coordinates as snapped (below 2^-126 as 0), those of volumes too: so an answer
//! depends neither on the tree nor on the machine. Triangles without area count as the segments or points that they are; those that
//! a build drops do not count.
//!
//! *Why no tree changes the answer.* A point that a volume shares with a triangle lies in the cell of a leaf that has the triangle. A cell is passed over
//! only where [`Region::may_meet`] says that the volume has no point in it, which it computes in `f64` with room for its roundings.

use alloc::vec::Vec;
use core::cell::Cell;

use crate::aabb::Aabb;
use crate::arithmetic::snap;
use crate::cancel::go_on_tracing;
use crate::error::{QueryError, check_bytes, refused};
use crate::exact::overlap::{meets_ball, meets_box, meets_capsule, meets_planes, meets_triangle};
use crate::query::traverse::Triangles;
use crate::report::QueryReport;
use crate::tree::KdTreeView;
use crate::tree::node::NodeKind;
use crate::triangle::Triangle;
use crate::watch::Watch;

pub use crate::exact::overlap::Plane;

/// What triangles may meet. One with a NaN, a negative radius, or an empty box meets nothing; so does one with an infinite coordinate, sides of boxes
/// and radii aside.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum Volume<'a> {
    /// A box; sides may be infinite.
    Box(Aabb),
    /// All points within a distance of one.
    Ball {
        /// The point.
        centre: [f32; 3],
        /// The distance, at least 0.
        radius: f32,
    },
    /// All points within a distance of a segment.
    Capsule {
        /// One end of the segment.
        from: [f32; 3],
        /// The other end.
        to: [f32; 3],
        /// The distance, at least 0.
        radius: f32,
    },
    /// What is in all of these halves of space, such as a frustum: all of space for none.
    Planes(&'a [Plane]),
    /// A triangle, of another mesh for example.
    Triangle(Triangle),
}

/// Settings of a query for overlaps.
#[derive(Clone, Copy, Debug, Default)]
pub struct OverlapOptions<'a> {
    /// One triangle to ignore, by its index in the caller's mesh.
    pub ignore: Option<u32>,
    /// Most bytes that the answer and its parts may take; `None` for no limit.
    pub max_memory: Option<u64>,
    /// Receives the number of volumes that are done, and may cancel the batch; `None` for no watch.
    pub watch: Option<&'a dyn Watch>,
}

/// The triangles that each volume of a batch meets.
#[derive(Clone, Debug, PartialEq)]
pub struct Overlaps {
    /// Where the triangles of each volume begin, followed by the number of all: one entry more than there are volumes.
    pub starts: Vec<usize>,
    /// The triangles of all volumes, volume by volume, by index in the caller's mesh, in ascending order.
    pub triangles: Vec<u32>,
    /// Which backend answered.
    pub report: QueryReport,
}

impl Default for Overlaps {
    fn default() -> Overlaps {
        Overlaps { starts: Vec::from([0]), triangles: Vec::new(), report: QueryReport::default() }
    }
}

impl Overlaps {
    /// The triangles that a volume of the batch meets, in ascending order.
    pub fn of(&self, volume: usize) -> &[u32] {
        &self.triangles[self.starts[volume]..self.starts[volume + 1]]
    }

    /// How many volumes there are.
    pub fn volumes(&self) -> usize {
        self.starts.len() - 1
    }

    /// Bytes that both lists hold, spare capacity included.
    pub fn bytes(&self) -> u64 {
        let starts = self.starts.capacity() * size_of::<usize>();
        (starts + self.triangles.capacity() * size_of::<u32>()) as u64
    }

    /// Appends the answer to one more volume: triangles in any order, some more than once.
    ///
    /// # Errors
    /// More memory than `max_memory` allows, or than the system has.
    pub fn push(&mut self, mut found: Vec<u32>, max_memory: Option<u64>) -> Result<(), QueryError> {
        found.sort_unstable();
        found.dedup();
        let needed =
            self.bytes() + (found.capacity() * size_of::<u32>() + size_of::<usize>()) as u64;
        check_bytes(needed, max_memory)?;
        self.triangles.try_reserve(found.len()).map_err(|_| refused(needed))?;
        self.starts.try_reserve(1).map_err(|_| refused(needed))?;
        self.triangles.extend(found);
        self.starts.push(self.triangles.len());
        Ok(())
    }

    /// Appends the answers to more volumes.
    ///
    /// # Errors
    /// More memory than `max_memory` allows, or than the system has.
    pub fn append(&mut self, more: Overlaps, max_memory: Option<u64>) -> Result<(), QueryError> {
        let (needed, volumes) = (self.bytes() + more.bytes(), self.volumes());
        check_bytes(needed, max_memory)?;
        self.starts.try_reserve(more.starts.len()).map_err(|_| refused(needed))?;
        self.triangles.try_reserve(more.triangles.len()).map_err(|_| refused(needed))?;
        self.report.append(more.report, volumes)?;
        let first = self.triangles.len();
        self.starts.extend(more.starts.iter().skip(1).map(|start| first + start));
        self.triangles.extend(more.triangles);
        Ok(())
    }
}

/// A volume with snapped coordinates, and what cells are compared with.
#[derive(Clone, Debug)]
pub struct Region {
    volume: Snapped,
    /// A box around all of it, in `f64`.
    bounds: [[f64; 3]; 2],
}

#[derive(Clone, Debug)]
enum Snapped {
    All,
    Box(Aabb),
    Ball([f32; 3], f32),
    Capsule([[f32; 3]; 2], f32),
    Planes(Vec<Plane>),
    Triangle(Triangle),
}

/// A part by which sides are moved outwards: far more than roundings.
const ROOM: f64 = 1e-12;

impl Region {
    /// `None` for a volume that meets nothing.
    ///
    /// # Errors
    /// No memory for a copy of the planes.
    pub fn new(volume: &Volume<'_>) -> Result<Option<Region>, QueryError> {
        let finite = |point: &[f32; 3]| point.iter().all(|x| x.is_finite());
        let everywhere = [[f64::NEG_INFINITY; 3], [f64::INFINITY; 3]];
        let around = |from: [f32; 3], to: [f32; 3], radius: f32| {
            let mut bounds = everywhere;
            for axis in 0..3 {
                let (a, b, r) = (f64::from(from[axis]), f64::from(to[axis]), f64::from(radius));
                let room = ROOM * (a.abs() + b.abs() + r);
                bounds[0][axis] = a.min(b) - r - room;
                bounds[1][axis] = a.max(b) + r + room;
            }
            bounds
        };
        let (volume, bounds) = match *volume {
            Volume::Box(bounds) => {
                let snapped = |side: [f32; 3]| side.map(|x| snap(x).clamp(-f32::MAX, f32::MAX));
                let bounds = Aabb { lo: snapped(bounds.lo), hi: snapped(bounds.hi) };
                let ordered = (0..3).all(|axis| bounds.lo[axis] <= bounds.hi[axis]);
                if !ordered {
                    return Ok(None);
                }
                (Snapped::Box(bounds), [bounds.lo, bounds.hi].map(|side| side.map(f64::from)))
            }
            Volume::Ball { centre, radius } => {
                if !finite(&centre) || radius.is_nan() || radius < 0.0 {
                    return Ok(None);
                }
                if radius.is_infinite() {
                    return Ok(Some(Region { volume: Snapped::All, bounds: everywhere }));
                }
                let (centre, radius) = (centre.map(snap), snap(radius));
                (Snapped::Ball(centre, radius), around(centre, centre, radius))
            }
            Volume::Capsule { from, to, radius } => {
                if !finite(&from) || !finite(&to) || radius.is_nan() || radius < 0.0 {
                    return Ok(None);
                }
                if radius.is_infinite() {
                    return Ok(Some(Region { volume: Snapped::All, bounds: everywhere }));
                }
                let (ends, radius) = ([from, to].map(|end| end.map(snap)), snap(radius));
                (Snapped::Capsule(ends, radius), around(ends[0], ends[1], radius))
            }
            Volume::Planes(planes) => {
                let good = |plane: &Plane| finite(&plane.normal) && plane.offset.is_finite();
                if !planes.iter().all(good) {
                    return Ok(None);
                }
                let mut own = Vec::new();
                let bytes = size_of_val(planes) as u64;
                own.try_reserve_exact(planes.len()).map_err(|_| refused(bytes))?;
                own.extend(planes.iter().map(|plane| Plane {
                    normal: plane.normal.map(snap),
                    offset: snap(plane.offset),
                }));
                (Snapped::Planes(own), everywhere)
            }
            Volume::Triangle(corners) => {
                if !corners.iter().all(finite) {
                    return Ok(None);
                }
                let corners = corners.map(|corner| corner.map(snap));
                let Aabb { lo, hi } = Aabb::of_points(&corners);
                (Snapped::Triangle(corners), [lo, hi].map(|side| side.map(f64::from)))
            }
        };
        Ok(Some(Region { volume, bounds }))
    }

    /// Lower and upper corner of a box around the volume; infinite where it has no end, or where its sides are not known.
    pub fn bounds(&self) -> [[f64; 3]; 2] {
        self.bounds
    }

    /// What it takes to look at a cell or a triangle, in planes.
    #[doc(hidden)]
    pub fn work(&self) -> u64 {
        match &self.volume {
            Snapped::Planes(planes) => 1 + planes.len() as u64,
            _ => 1,
        }
    }

    /// False where the volume certainly has no point in a box, whose sides are finite.
    pub fn may_meet(&self, cell: &Aabb) -> bool {
        self.may_meet_box([cell.lo, cell.hi].map(|side| side.map(f64::from)))
    }

    /// The same for a box in `f64`.
    pub fn may_meet_box(&self, [lo, hi]: [[f64; 3]; 2]) -> bool {
        for axis in 0..3 {
            if lo[axis] > self.bounds[1][axis] || hi[axis] < self.bounds[0][axis] {
                return false;
            }
        }
        match &self.volume {
            Snapped::Ball(centre, radius) => {
                let centre = centre.map(f64::from);
                let radius = f64::from(*radius);
                let mut squared = 0.0;
                for axis in 0..3 {
                    let out = (lo[axis] - centre[axis]).max(centre[axis] - hi[axis]).max(0.0);
                    squared += out * out;
                }
                squared <= radius * radius * (1.0 + ROOM)
            }
            // By the ball around the box.
            Snapped::Capsule([from, to], radius) => {
                let middle = [0, 1, 2].map(|axis| 0.5 * (lo[axis] + hi[axis]));
                let reach = squared_length([0, 1, 2].map(|axis| 0.5 * (hi[axis] - lo[axis])));
                let reach = crate::arithmetic::sqrt(reach) + f64::from(*radius);
                let (from, to) = (from.map(f64::from), to.map(f64::from));
                let far = squared_distance(middle, from, to);
                // Coordinates may be much greater than distances.
                let size =
                    middle.iter().chain(&from).chain(&to).fold(0.0f64, |m, x| m.max(x.abs()));
                let reach = reach * (1.0 + ROOM) + size * ROOM;
                far <= reach * reach * (1.0 + ROOM)
            }
            Snapped::Planes(planes) => planes.iter().all(|plane| {
                let offset = f64::from(plane.offset);
                let (mut least, mut size) = (-offset, offset.abs());
                for axis in 0..3 {
                    let normal = f64::from(plane.normal[axis]);
                    let side = if normal > 0.0 { lo[axis] } else { hi[axis] };
                    least += normal * side;
                    size += (normal * side).abs();
                }
                least <= size * ROOM
            }),
            Snapped::All | Snapped::Box(_) | Snapped::Triangle(_) => true,
        }
    }

    /// Whether a triangle with snapped corners meets the volume, exactly.
    pub fn meets(&self, corners: &Triangle) -> bool {
        match &self.volume {
            Snapped::All => true,
            Snapped::Box(bounds) => meets_box(corners, bounds),
            Snapped::Ball(centre, radius) => meets_ball(corners, centre, *radius),
            Snapped::Capsule([from, to], radius) => meets_capsule(corners, from, to, *radius),
            Snapped::Planes(planes) => meets_planes(corners, planes),
            Snapped::Triangle(own) => meets_triangle(corners, own),
        }
    }
}

fn squared_length(v: [f64; 3]) -> f64 {
    (v[0] * v[0] + v[1] * v[1]) + v[2] * v[2]
}

/// The squared distance of a point to a segment, about.
fn squared_distance(point: [f64; 3], from: [f64; 3], to: [f64; 3]) -> f64 {
    let edge = [0, 1, 2].map(|axis| to[axis] - from[axis]);
    let out = [0, 1, 2].map(|axis| point[axis] - from[axis]);
    let length = squared_length(edge);
    let along = (edge[0] * out[0] + edge[1] * out[1]) + edge[2] * out[2];
    let along = if length > 0.0 { (along / length).clamp(0.0, 1.0) } else { 0.0 };
    squared_length([0, 1, 2].map(|axis| out[axis] - along * edge[axis]))
}

/// Gives `visit` the triangles of all leaves whose cells interest it, until it returns false; a triangle may come again.
///
/// `tree` must be valid (see [`tree::validate`](crate::tree::validate)).
///
/// # Errors
/// No memory for the nodes that wait.
pub fn visit_cells(
    tree: &KdTreeView<'_>,
    mut is_of_interest: impl FnMut(&Aabb) -> bool,
    mut visit: impl FnMut(&[u32]) -> Result<bool, QueryError>,
) -> Result<(), QueryError> {
    if tree.bounds.is_empty() || !is_of_interest(&tree.bounds) {
        return Ok(());
    }
    let mut waiting = Vec::new();
    let mut next = Some((0u32, tree.bounds));
    while let Some((node, cell)) = next {
        match tree.nodes[node as usize].kind() {
            NodeKind::Leaf { first, count } => {
                if !visit(tree.leaf(first, count))? {
                    return Ok(());
                }
            }
            NodeKind::Interior { axis, split, right } => {
                let (mut below, mut above) = (cell, cell);
                below.hi[axis.index()] = split;
                above.lo[axis.index()] = split;
                let held = (waiting.len() * size_of::<(u32, Aabb)>()) as u64;
                waiting.try_reserve(2).map_err(|_| refused(held))?;
                for child in [(right, above), (node + 1, below)] {
                    if is_of_interest(&child.1) {
                        waiting.push(child);
                    }
                }
            }
        }
        next = waiting.pop();
    }
    Ok(())
}

/// The triangles that a volume meets, in any order and some more than once; with `any` one of them at most. The watch is called while a volume of many planes is
/// looked at.
///
/// # Errors
/// More memory than the options allow or than the system has, and a watch that cancels the work.
pub fn overlapping(
    tree: &KdTreeView<'_>,
    triangles: &(impl Triangles + ?Sized),
    volume: &Volume<'_>,
    any: bool,
    options: &OverlapOptions<'_>,
) -> Result<Vec<u32>, QueryError> {
    overlapping_within(tree, triangles, volume, any, options, [0, 1])
}

fn overlapping_within(
    tree: &KdTreeView<'_>,
    triangles: &(impl Triangles + ?Sized),
    volume: &Volume<'_>,
    any: bool,
    options: &OverlapOptions<'_>,
    [done, total]: [u64; 2],
) -> Result<Vec<u32>, QueryError> {
    let mut found = Vec::new();
    let Some(region) = Region::new(volume)? else { return Ok(found) };
    let patience = Patience::new(options.watch, [done, total]);
    visit_cells(
        tree,
        |cell| {
            patience.record(region.work());
            region.may_meet(cell)
        },
        |leaf| {
            for &triangle in leaf {
                patience.record(region.work());
                patience.check()?;
                if options.ignore != Some(triangle) && region.meets(&triangles.corners(triangle)) {
                    add(&mut found, triangle, options.max_memory)?;
                    if any {
                        return Ok(false);
                    }
                }
            }
            Ok(true)
        },
    )?;
    Ok(found)
}

/// Calls a watch after so much work, in planes.
const WORK_BETWEEN_CHECKS: u64 = 1 << 16;

/// Work within one volume, for a watch.
#[doc(hidden)]
#[derive(Debug)]
pub struct Patience<'a> {
    watch: Option<&'a dyn Watch>,
    volumes: [u64; 2],
    work: Cell<u64>,
}

impl<'a> Patience<'a> {
    /// Of a batch with so many volumes that are done, and so many in all.
    pub fn new(watch: Option<&'a dyn Watch>, volumes: [u64; 2]) -> Patience<'a> {
        Patience { watch, volumes, work: Cell::new(0) }
    }

    /// Adds to the work.
    pub fn record(&self, work: u64) {
        self.work.set(self.work.get().saturating_add(work));
    }

    /// Calls the watch if there was much work since the last call.
    ///
    /// # Errors
    /// A watch that cancels the work.
    pub fn check(&self) -> Result<(), QueryError> {
        if self.work.get() < WORK_BETWEEN_CHECKS {
            return Ok(());
        }
        self.work.set(0);
        go_on_tracing(self.watch, self.volumes[0], self.volumes[1])
    }
}

/// Adds a triangle within a limit of memory. Those found more than once are counted once where memory would run out.
///
/// # Errors
/// More memory than allowed, or than the system has.
pub fn add(found: &mut Vec<u32>, triangle: u32, max_memory: Option<u64>) -> Result<(), QueryError> {
    if found.len() == found.capacity() {
        found.sort_unstable();
        found.dedup();
        let more = (found.len() / 2).max(16);
        if found.capacity() - found.len() < more {
            let needed = ((found.len() + more) * size_of::<u32>()) as u64;
            check_bytes(needed, max_memory)?;
            found.try_reserve_exact(more).map_err(|_| refused(needed))?;
        }
    }
    found.push(triangle);
    Ok(())
}

/// The overlaps of a batch, one volume at a time: the reference, which backends on devices use too. `watch` is called before each volume.
///
/// # Errors
/// More memory than the options allow or than the system has, and a watch that cancels the batch.
pub fn one_by_one(
    tree: &KdTreeView<'_>,
    triangles: &(impl Triangles + ?Sized),
    volumes: &[Volume<'_>],
    options: &OverlapOptions<'_>,
) -> Result<Overlaps, QueryError> {
    let total = volumes.len() as u64;
    let mut all = Overlaps::default();
    for (done, volume) in volumes.iter().enumerate() {
        go_on_tracing(options.watch, done as u64, total)?;
        let volumes = [done as u64, total];
        let found = overlapping_within(tree, triangles, volume, false, options, volumes)?;
        all.push(found, options.max_memory)?;
    }
    go_on_tracing(options.watch, total, total)?;
    Ok(all)
}
