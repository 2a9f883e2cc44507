//! The binary tree from which the tree over instances is made, and which of its nodes become children of one wide node.

use alloc::vec::Vec;

use super::super::top_tree::WIDTH;
use super::super::world_box::WorldBox;
use super::LEVELS;
use crate::aabb::{Aabb, max, min};

/// Bins of one axis, for few items and for many. What finding a border costs is in proportion to the bins.
const FEW_BINS: usize = 8;
const MANY_BINS: usize = 16;
/// Numbers from here to twice this are whole, and their last bits say which: 2^23.
const WHOLE: f32 = 8_388_608.0;
/// Items that are few.
const FEW: usize = 32;
/// No node.
const NONE: u32 = u32::MAX;

/// Bounds, four numbers side by side: of the last, the lower is 0 and the upper what the box is widened by.
#[derive(Clone, Copy, Debug)]
pub(super) struct Bounds {
    lo: [f32; 4],
    hi: [f32; 4],
}

impl Bounds {
    const EMPTY: Bounds = Bounds {
        lo: [f32::INFINITY, f32::INFINITY, f32::INFINITY, 0.0],
        hi: [f32::NEG_INFINITY, f32::NEG_INFINITY, f32::NEG_INFINITY, 0.0],
    };

    fn add(&mut self, other: &Bounds) {
        for axis in 0..4 {
            self.lo[axis] = min(self.lo[axis], other.lo[axis]);
            self.hi[axis] = max(self.hi[axis], other.hi[axis]);
        }
    }

    /// Half the area, in `f64`, where no finite box's overflows.
    fn half_area(&self) -> f64 {
        let extent = |axis: usize| f64::from(self.hi[axis]) - f64::from(self.lo[axis]);
        let (x, y, z) = (extent(0), extent(1), extent(2));
        x * y + y * z + z * x
    }

    pub(super) fn world_box(&self) -> WorldBox {
        let three = |row: &[f32; 4]| [row[0], row[1], row[2]];
        let bounds = Aabb { lo: three(&self.lo), hi: three(&self.hi) };
        WorldBox { bounds, reach: self.hi[3] }
    }

    fn add_point(&mut self, point: &[f32; 4]) {
        for axis in 0..4 {
            self.lo[axis] = min(self.lo[axis], point[axis]);
            self.hi[axis] = max(self.hi[axis], point[axis]);
        }
    }

    /// Half the middle, whose differences cannot overflow.
    fn centre(&self) -> [f32; 4] {
        let mut centre = [0.0; 4];
        for axis in 0..4 {
            centre[axis] = 0.25 * self.lo[axis] + 0.25 * self.hi[axis];
        }
        centre
    }
}

/// An instance, to be put in the tree.
#[derive(Clone, Copy, Debug)]
pub(super) struct Item {
    pub(super) instance: u32,
    bounds: Bounds,
}

impl Item {
    pub(super) fn new(instance: u32, world_box: &WorldBox) -> Item {
        let ([a, b, c], [d, e, f]) = (world_box.bounds.lo, world_box.bounds.hi);
        Item { instance, bounds: Bounds { lo: [a, b, c, 0.0], hi: [d, e, f, world_box.reach] } }
    }

    pub(super) fn world_box(&self) -> WorldBox {
        self.bounds.world_box()
    }
}

/// A node of the binary tree: a range of items, and two nodes, or none where the items fit one wide node.
#[derive(Clone, Copy, Debug)]
pub(super) struct Binary {
    pub(super) bounds: Bounds,
    first: u32,
    count: u32,
    /// Both children.
    below: [u32; 2],
    /// The least cost of what is below as at most so many children of a wide node, less one: the sum of half the areas of the nodes
    /// that this takes.
    costs: [f64; WIDTH],
    /// How many of those the first child has for it; 0 where it is one node.
    shares: [u8; WIDTH],
}

/// A child of a wide node.
pub(super) enum Child {
    /// An item, by its place.
    Instance(u32),
    /// A binary node, of which a wide node is to be made.
    Node(u32),
}

/// The tree over at least one item, which are put in its order; the root first, and its costs decided. `None` without memory.
pub(super) fn build(items: &mut [Item]) -> Option<Vec<Binary>> {
    let mut nodes: Vec<Binary> = Vec::new();
    nodes.try_reserve(items.len() / 4 + 1).ok()?;
    let mut all = Part::EMPTY;
    items.iter().for_each(|item| all.add(item));
    nodes.push(Binary::new(all.bounds, 0, items.len()));
    let mut next = 0;
    // What is known of each node besides.
    let mut levels: Vec<(u8, Bounds)> = Vec::new();
    levels.try_reserve(items.len() / 4 + 1).ok()?;
    levels.push((1, all.centres));
    // Nodes come after their parents.
    while next < nodes.len() {
        let (node, (level, centres)) = (nodes[next], levels[next]);
        if node.count as usize > WIDTH {
            let own = &mut items[node.first as usize..][..node.count as usize];
            let halvings = (usize::BITS - own.len().leading_zeros()) as usize;
            let by_cost = usize::from(level) + halvings <= LEVELS;
            let (length, [one, other]) = if own.len() <= FEW {
                split::<FEW_BINS>(own, &centres, by_cost)
            } else {
                split::<MANY_BINS>(own, &centres, by_cost)
            };
            nodes.try_reserve(2).ok()?;
            levels.try_reserve(2).ok()?;
            nodes[next].below = [nodes.len() as u32, nodes.len() as u32 + 1];
            let first = node.first as usize;
            nodes.push(Binary::new(one.bounds, first, length));
            nodes.push(Binary::new(other.bounds, first + length, node.count as usize - length));
            levels.extend([(level + 1, one.centres), (level + 1, other.centres)]);
        }
        next += 1;
    }
    for node in (0..nodes.len()).rev() {
        decide(&mut nodes, node);
    }
    Some(nodes)
}

impl Binary {
    fn new(bounds: Bounds, first: usize, count: usize) -> Binary {
        let (first, count) = (first as u32, count as u32);
        Binary { bounds, first, count, below: [NONE; 2], costs: [0.0; WIDTH], shares: [0; WIDTH] }
    }
}

/// Finds the least costs of a node whose children's are known.
fn decide(nodes: &mut [Binary], node: usize) {
    let Binary { bounds, count, below, .. } = nodes[node];
    let area = bounds.half_area();
    let (mut costs, mut shares) = ([0.0; WIDTH], [0; WIDTH]);
    if below[0] == NONE {
        // Items need no node where there is a place for each; one alone never does.
        for most in 1..=WIDTH {
            costs[most - 1] = if count as usize <= most { 0.0 } else { area };
        }
    } else {
        let [one, other] = below.map(|child| nodes[child as usize].costs);
        let mut split = [(f64::INFINITY, 0); WIDTH];
        for most in 2..=WIDTH {
            for share in 1..most {
                let cost = one[share - 1] + other[most - share - 1];
                if cost < split[most - 1].0 {
                    split[most - 1] = (cost, share as u8);
                }
            }
        }
        let whole = area + split[WIDTH - 1].0;
        costs[0] = whole;
        for most in 2..=WIDTH {
            let (cost, share) = split[most - 1];
            (costs[most - 1], shares[most - 1]) =
                if cost < whole { (cost, share) } else { (whole, 0) };
        }
        // How a node of its own divides its places.
        shares[0] = split[WIDTH - 1].1;
    }
    (nodes[node].costs, nodes[node].shares) = (costs, shares);
}

/// Shows the children of the wide node that is made of a binary node: at least one, at most [`WIDTH`].
pub(super) fn children(nodes: &[Binary], node: u32, mut show: impl FnMut(Child)) {
    let Binary { first, count, below: [one, other], shares, .. } = nodes[node as usize];
    if one == NONE {
        (first..first + count).for_each(|item| show(Child::Instance(item)));
        return;
    }
    // A node with the places that it has.
    let mut left = [(0, 0); WIDTH];
    (left[0], left[1]) = ((other, WIDTH - usize::from(shares[0])), (one, usize::from(shares[0])));
    let mut top = 2;
    while top > 0 {
        top -= 1;
        let (node, most) = left[top];
        let Binary { first, count, below: [one, other], shares, .. } = nodes[node as usize];
        if one == NONE && count as usize <= most {
            (first..first + count).for_each(|item| show(Child::Instance(item)));
        } else if most > 1 && shares[most - 1] > 0 {
            let share = usize::from(shares[most - 1]);
            (left[top], left[top + 1]) = ((other, most - share), (one, share));
            top += 2;
        } else {
            show(Child::Node(node));
        }
    }
}

/// Some items: their bounds, and those of their centres.
#[derive(Clone, Copy, Debug)]
struct Part {
    bounds: Bounds,
    centres: Bounds,
}

impl Part {
    const EMPTY: Part = Part { bounds: Bounds::EMPTY, centres: Bounds::EMPTY };

    #[inline(always)]
    fn add(&mut self, item: &Item) {
        self.bounds.add(&item.bounds);
        self.centres.add_point(&item.bounds.centre());
    }
}

/// Bins along the axes, from the lowest centre to the highest.
struct Grid<const BINS: usize> {
    lo: [f32; 4],
    /// Bins per unit; 0 where all centres are one.
    scale: [f32; 4],
}

impl<const BINS: usize> Grid<BINS> {
    fn new(centres: &Bounds) -> Grid<BINS> {
        let mut scale = [0.0; 4];
        for (axis, scale) in scale.iter_mut().enumerate().take(3) {
            let extent = centres.hi[axis] - centres.lo[axis];
            *scale = if extent > 0.0 { BINS as f32 / extent } else { 0.0 };
        }
        Grid { lo: centres.lo, scale }
    }

    /// The bins of a centre along the axes; the fourth means nothing.
    #[inline(always)]
    fn bins(&self, centre: &[f32; 4]) -> [u32; 4] {
        let mut bins = [0; 4];
        for axis in 0..4 {
            bins[axis] = self.bin(centre, axis);
        }
        bins
    }

    /// By a sum whose last bits are the number, rounded: conversions take several instructions for each axis, this a few for all.
    #[inline(always)]
    fn bin(&self, centre: &[f32; 4], axis: usize) -> u32 {
        let at = (centre[axis] - self.lo[axis]) * self.scale[axis] - 0.5;
        // What is not a number, an extent next to 0 times its reciprocal, is in the first.
        let at = if at > 0.0 { at } else { 0.0 };
        let last = (BINS - 1) as f32;
        let at = if at < last { at } else { last };
        (at + WHOLE).to_bits() & (BINS as u32 * 2 - 1)
    }
}

/// Puts items of the first half before those of the second; `centres` are the bounds of their centres. Returns how many the first
/// has, at least one and not all, and both halves.
fn split<const BINS: usize>(
    items: &mut [Item],
    centres: &Bounds,
    by_cost: bool,
) -> (usize, [Part; 2]) {
    let grid = Grid::<BINS>::new(centres);
    if by_cost {
        // Apart, so that fewer bounds lie across cache lines.
        let mut bins = [[Bounds::EMPTY; BINS]; 3];
        let mut counts = [[0u32; BINS]; 3];
        for item in &*items {
            let own = grid.bins(&item.bounds.centre());
            for axis in 0..3 {
                let bin = own[axis] as usize % BINS;
                bins[axis][bin].add(&item.bounds);
                counts[axis][bin] += 1;
            }
        }
        let mut best: Option<(f64, usize, usize)> = None;
        for axis in 0..3 {
            if grid.scale[axis] > 0.0
                && let Some((cost, border)) = best_border(&bins[axis], &counts[axis])
                && best.is_none_or(|(least, ..)| cost < least)
            {
                best = Some((cost, axis, border));
            }
        }
        if let Some((_, axis, border)) = best {
            let mut halves = [Part::EMPTY; 2];
            let mut first = 0;
            for place in 0..items.len() {
                let item = items[place];
                let is_above = grid.bin(&item.bounds.centre(), axis) as usize >= border;
                // Always exchanged, since a processor cannot tell which way a branch would go: what is here already is above too.
                items[place] = items[first];
                items[first] = item;
                first += usize::from(!is_above);
                halves[usize::from(is_above)].add(&item);
            }
            return (first, halves);
        }
    }
    // Centres that are all equal, or a tree that would be too deep: half of them, along the longest axis.
    let extent = |axis: usize| centres.hi[axis] - centres.lo[axis];
    let axis = (1..3).fold(0, |most, axis| if extent(axis) > extent(most) { axis } else { most });
    let half = items.len() / 2;
    items.select_nth_unstable_by(half, |a, b| {
        let centres = a.bounds.centre()[axis].total_cmp(&b.bounds.centre()[axis]);
        centres.then(a.instance.cmp(&b.instance))
    });
    let mut halves = [Part::EMPTY; 2];
    for (place, item) in items.iter().enumerate() {
        halves[usize::from(place >= half)].add(item);
    }
    (half, halves)
}

/// The best border of bins by SAH, and its cost; `None` where all centres are in one bin.
fn best_border<const BINS: usize>(
    bins: &[Bounds; BINS],
    counts: &[u32; BINS],
) -> Option<(f64, usize)> {
    // What is above each border: its cost, 0 where there is nothing.
    let mut above = [0.0; BINS];
    let (mut bounds, mut count) = (Bounds::EMPTY, 0);
    for border in (1..BINS).rev() {
        bounds.add(&bins[border]);
        count += counts[border];
        above[border] = if count == 0 { 0.0 } else { bounds.half_area() * f64::from(count) };
    }
    let total = count + counts[0];
    let mut best: Option<(f64, usize)> = None;
    let (mut bounds, mut count) = (Bounds::EMPTY, 0);
    for border in 1..BINS {
        let more = counts[border - 1];
        bounds.add(&bins[border - 1]);
        count += more;
        if more == 0 || count == total {
            continue;
        }
        let cost = bounds.half_area() * f64::from(count) + above[border];
        if best.is_none_or(|(least, _)| cost < least) {
            best = Some((cost, border));
        }
    }
    best
}
