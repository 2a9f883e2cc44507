//! Groups of a leaf's triangles that become blocks of their own.
//!
//! A builder fills leaves up to the width of a test, since by its measure a block costs the same however many triangles it has, and
//! a leaf is as large as its cell. What a ray meets is the box around a block's triangles. Where a leaf has two triangles of the
//! ground and six of a sphere that rests on it, that box is mostly air, and every ray that leaves the ground starts in it. As two
//! blocks they have two boxes, one of them flat, which a ray that starts above it does not meet. So a leaf is divided where that
//! makes its blocks cost much less by this measure:
//!
//! - a random line meets a box in proportion to its surface (MacDonald and Booth 1990);
//! - a ray that starts on a triangle also starts in the box of its block, unless that is flat. As many rays start on surfaces as
//!   pass through, and each has as much surface as half of the box of each triangle's part in the cell.
//!
//! Triangles that no plane separates can be in different blocks too, so this is not for the builders to do. Decisions depend on
//! the leaf and the width of blocks alone. It added 10 to 16 % to a build by `best` and a third to one by `fast`, so only trees
//! of `best` are divided ([`Builder::Sweep`]); since all divisions of a leaf are made in one pass, builds by `best` take 5 % less.

use core::array;

use splitplane_core::aabb::{Aabb, min};
use splitplane_core::config::{BuildConfig, Builder};
use splitplane_core::triangle::Triangle;

use super::cells::part;

/// Not in a browser, which loads all code before the first ray: this is one part in a hundred of it.
pub(crate) const DIVIDED: bool = !cfg!(target_family = "wasm");
/// Leaves of more triangles are divided in the order of their references.
pub(crate) const MOST: usize = 64;
/// More blocks must cost less than this part of what fewer do: each takes a place in a wide node, a header, and corners that
/// blocks no longer share. From 0.6 to 0.75 rays are as fast, but for more bytes.
const MORE_BLOCKS: f32 = 0.6;
/// A leaf of one block without flat triangles is looked at only if the boxes of its triangles have less than so many times the
/// surface of the box of all. A patch of a surface has about twice as much as its own box: two parts of that kind cost less than
/// [`MORE_BLOCKS`] only below 0.86.
const DENSE: f32 = 1.0;

/// A box as the least of x, y and z and of their negatives, so that a box around two is the lesser of each number. At
/// [`SURFACE`] that of a triangle has half its surface, which is asked for again and again; what groups have there says nothing.
type Extremes = [f32; 8];
const NOTHING: Extremes = [f32::INFINITY; 8];
const SURFACE: usize = 3;

/// The triangles of a leaf in groups; one task's, for all its leaves.
#[derive(Debug)]
pub(crate) struct LeafGroups {
    /// Triangles of a block.
    lanes: usize,
    /// A power of two that brings extents near one.
    scale: f32,
    /// Triangles, group by group.
    triangles: [u32; MOST],
    /// The parts of their boxes in the cell.
    boxes: [Extremes; MOST],
    /// Both as they were before a division.
    before: ([u32; MOST], [Extremes; MOST]),
    /// Where groups end.
    ends: [usize; MOST],
    groups: usize,
}

/// A number of triangles and what they are in.
#[derive(Clone, Copy)]
struct Group {
    bounds: Extremes,
    /// Of the triangles' boxes, the half areas together.
    surface: f32,
    count: usize,
}

/// Divisions in two that are tried.
#[derive(Clone, Copy)]
enum Division {
    /// By which side of the middle of the group's box along an axis the middle of a triangle's box lies.
    Middle(usize),
    /// Those with half the surface of the largest, or more, apart.
    Large(f32),
}

impl LeafGroups {
    /// Whether leaves of such a tree are divided.
    pub(crate) fn are_worth_their_time(config: &BuildConfig) -> bool {
        DIVIDED && matches!(config.builder, Builder::Sweep(_))
    }

    /// No groups yet, for blocks of `lanes`. `scale` is a power of two that brings extents near one.
    pub(crate) fn new(lanes: usize, scale: f32) -> LeafGroups {
        let (triangles, boxes) = ([0; MOST], [NOTHING; MOST]);
        let (before, ends) = ((triangles, boxes), [0; MOST]);
        LeafGroups { lanes, scale, triangles, boxes, before, ends, groups: 0 }
    }

    /// Puts a leaf's triangles into groups, and says whether there are several. Otherwise they stay together, in the order of
    /// references.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) fn several(
        &mut self,
        references: &[u32],
        triangles: &[Triangle],
        cell: &Aabb,
    ) -> bool {
        let (count, scale) = (references.len(), self.scale);
        if !(2..=MOST).contains(&count) {
            return false;
        }
        let one_block = count <= self.lanes;
        let enough = DENSE * area(&extremes(cell, scale));
        let (mut all, mut flat) = (Group::NONE, false);
        for (own, &triangle) in self.boxes.iter_mut().zip(references) {
            let bounds = Aabb::of_points(&triangles[triangle as usize]);
            *own = extremes(&part(cell, &bounds), scale);
            own[SURFACE] = area(own);
            flat |= flat_axes(own) != 0;
            all.add(own);
            // The cell is no smaller than the box of all.
            if one_block && !flat && all.surface > enough {
                return false;
            }
        }
        let sparse = all.surface < DENSE * area(&all.bounds);
        if one_block && !sparse && (!flat || flat_axes(&all.bounds) != 0) {
            return false;
        }
        self.triangles[..count].copy_from_slice(references);
        self.groups = 0;
        self.divide(0, all);
        self.groups > 1
    }

    /// The triangles of each group.
    pub(crate) fn groups(&self) -> impl Iterator<Item = &[u32]> {
        let starts = [0].into_iter().chain(self.ends);
        starts.zip(&self.ends[..self.groups]).map(|(start, &end)| &self.triangles[start..end])
    }

    /// Divides the triangles from `start` on, which these are, as long as that pays.
    fn divide(&mut self, start: usize, all: Group) {
        let end = start + all.count;
        let whole = all.cost(self.lanes);
        let mut best = f32::INFINITY;
        let mut found = None;
        for (division, parts) in divisions(&all, &self.boxes[start..end]) {
            let (cost, limit) = self.compare(&parts, &all);
            if cost < limit * whole && cost < best {
                best = cost;
                found = Some((division, parts));
            }
        }
        let parts = match found {
            Some((division, parts)) => {
                self.arrange(start, &all, &parts, |own| division.is_first(&all, own));
                Some(parts)
            }
            // Several blocks in the order of references are no better than in that of places along an axis.
            None if all.count > self.lanes => self.cut(start, &all),
            None => None,
        };
        match parts {
            Some([one, other]) => {
                self.divide(start, one);
                self.divide(start + one.count, other);
            }
            None => {
                self.ends[self.groups] = end;
                self.groups += 1;
            }
        }
    }

    /// What two groups cost, and of which part of the cost of the whole they must cost less.
    #[cfg_attr(not(unoptimised), inline(always))]
    fn compare(&self, parts: &[Group; 2], all: &Group) -> (f32, f32) {
        let [one, other] = parts;
        if one.count == 0 || other.count == 0 {
            return (f32::INFINITY, 0.0);
        }
        let blocks = |group: &Group| group.count.div_ceil(self.lanes);
        let more = blocks(one) + blocks(other) > blocks(all);
        (one.cost(self.lanes) + other.cost(self.lanes), if more { MORE_BLOCKS } else { 1.0 })
    }

    /// Keeps some triangles and boxes as they are.
    fn remember(&mut self, start: usize, count: usize) {
        let own = start..start + count;
        self.before.0[own.clone()].copy_from_slice(&self.triangles[own.clone()]);
        self.before.1[own.clone()].copy_from_slice(&self.boxes[own]);
    }

    /// Brings triangles from `start` on that are first, as many as one of the parts has, before the others.
    fn arrange(
        &mut self,
        start: usize,
        all: &Group,
        parts: &[Group; 2],
        first: impl Fn(&Extremes) -> bool,
    ) {
        self.remember(start, all.count);
        let mut next = [start, start + parts[0].count];
        for from in start..start + all.count {
            let own = self.before.1[from];
            let to = &mut next[usize::from(!first(&own))];
            (self.boxes[*to], self.triangles[*to]) = (own, self.before.0[from]);
            *to += 1;
        }
    }

    /// Divides more triangles than a block has into as many full blocks as half of them makes and the others, along the longest
    /// axis. `None` where that gains nothing.
    fn cut(&mut self, start: usize, all: &Group) -> Option<[Group; 2]> {
        let length = |axis: usize| -all.bounds[axis] - all.bounds[axis + 4];
        let axis = if length(0) >= length(1) { 0 } else { 1 };
        let axis = if length(axis) >= length(2) { axis } else { 2 };
        let mut places: [usize; MOST] = array::from_fn(|place| place);
        let places = &mut places[..all.count];
        let boxes = &self.boxes[start..];
        let along = |place: usize| middle(&boxes[place])[axis];
        places.sort_unstable_by(|&a, &b| along(a).total_cmp(&along(b)).then(a.cmp(&b)));
        let first = all.count.div_ceil(self.lanes) / 2 * self.lanes;
        let mut parts = [Group::NONE; 2];
        for (rank, &place) in places.iter().enumerate() {
            parts[usize::from(rank >= first)].add(&boxes[place]);
        }
        let (cost, limit) = self.compare(&parts, all);
        // Not so either where extents overflow.
        let gains = cost < limit * all.cost(self.lanes);
        if !gains {
            return None;
        }
        self.remember(start, all.count);
        for (to, &from) in (start..).zip(&*places) {
            self.triangles[to] = self.before.0[start + from];
            self.boxes[to] = self.before.1[start + from];
        }
        Some(parts)
    }
}

impl Group {
    const NONE: Group = Group { bounds: NOTHING, surface: 0.0, count: 0 };

    /// With one more triangle.
    #[inline]
    fn add(&mut self, own: &Extremes) {
        self.bounds = array::from_fn(|i| min(self.bounds[i], own[i]));
        self.surface += own[SURFACE];
        self.count += 1;
    }

    /// What its blocks cost.
    #[cfg_attr(not(unoptimised), inline(always))]
    fn cost(&self, lanes: usize) -> f32 {
        // A ray that starts on a flat block leaves it at once.
        let starts = if flat_axes(&self.bounds) == 0 { 0.5 * self.surface } else { 0.0 };
        (area(&self.bounds) + starts) * self.count.div_ceil(lanes) as f32
    }
}

impl Division {
    /// Whether a triangle with this box is among the first.
    #[inline]
    fn is_first(self, all: &Group, own: &Extremes) -> bool {
        match self {
            Division::Middle(axis) => middle(own)[axis] < middle(&all.bounds)[axis],
            Division::Large(limit) => own[SURFACE] >= limit,
        }
    }
}

/// What is tried with a group, and the two groups that it makes. All are made in one pass, since most of what is looked at stays
/// whole.
#[inline]
fn divisions(all: &Group, boxes: &[Extremes]) -> [(Division, [Group; 2]); 4] {
    let largest = boxes.iter().map(|own| own[SURFACE]).fold(0.0, |a, b| if b > a { b } else { a });
    let (limit, centre) = (0.5 * largest, middle(&all.bounds));
    let mut parts = [[Group::NONE; 2]; 4];
    for own in boxes {
        let place = middle(own);
        let [x, y, z] = [0, 1, 2].map(|axis| place[axis] < centre[axis]);
        for (two, first) in parts.iter_mut().zip([own[SURFACE] >= limit, x, y, z]) {
            two[usize::from(!first)].add(own);
        }
    }
    let [large, x, y, z] = parts;
    [
        (Division::Large(limit), large),
        (Division::Middle(0), x),
        (Division::Middle(1), y),
        (Division::Middle(2), z),
    ]
}

/// Twice the middle of a box along each axis.
#[inline]
fn middle(bounds: &Extremes) -> [f32; 3] {
    [0, 1, 2].map(|axis| bounds[axis] - bounds[axis + 4])
}

/// A box, scaled.
#[inline]
fn extremes(bounds: &Aabb, scale: f32) -> Extremes {
    let ([a, b, c], [x, y, z]) = (bounds.lo, bounds.hi);
    [a, b, c, 0.0, -x, -y, -z, 0.0].map(|x| x * scale)
}

/// Half the surface of a box.
#[inline]
fn area(bounds: &Extremes) -> f32 {
    let [x, y, z] = [0, 1, 2].map(|axis| -bounds[axis] - bounds[axis + 4]);
    x * y + y * z + z * x
}

/// A bit for each axis along which a box has no length.
#[inline]
fn flat_axes(bounds: &Extremes) -> u32 {
    let flat = |axis: usize| u32::from(bounds[axis] == -bounds[axis + 4]) << axis;
    flat(0) | flat(1) | flat(2)
}

#[cfg(test)]
mod tests;
