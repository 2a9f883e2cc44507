//! The binary tree from which the tree over instances is made, and which of its nodes become children of one wide node.

use alloc::vec::Vec;

use super::super::top_tree::WIDTH;
use super::super::world_box::WorldBox;
use super::LEVELS;
use crate::aabb::{Aabb, max, min};

/// Bins of one axis.
const BINS: usize = 16;
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

    /// Half the middle, whose differences cannot overflow.
    fn centre(&self, axis: usize) -> f32 {
        0.25 * self.lo[axis] + 0.25 * self.hi[axis]
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
    let mut all = Bounds::EMPTY;
    items.iter().for_each(|item| all.add(&item.bounds));
    nodes.push(Binary::new(all, 0, items.len()));
    let mut next = 0;
    let mut levels: Vec<u8> = Vec::new();
    levels.try_reserve(items.len() / 4 + 1).ok()?;
    levels.push(1);
    // Nodes come after their parents.
    while next < nodes.len() {
        let (node, level) = (nodes[next], usize::from(levels[next]));
        if node.count as usize > WIDTH {
            let own = &mut items[node.first as usize..][..node.count as usize];
            let by_cost = level + (usize::BITS - own.len().leading_zeros()) as usize <= LEVELS;
            let (length, halves) = split(own, by_cost);
            nodes.try_reserve(2).ok()?;
            levels.try_reserve(2).ok()?;
            nodes[next].below = [nodes.len() as u32, nodes.len() as u32 + 1];
            let first = node.first as usize;
            nodes.push(Binary::new(halves[0], first, length));
            nodes.push(Binary::new(halves[1], first + length, node.count as usize - length));
            levels.extend([level as u8 + 1; 2]);
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

/// Puts items of the first half before those of the second. Returns how many the first has, at least one and not all, and the bounds
/// of both.
fn split(items: &mut [Item], by_cost: bool) -> (usize, [Bounds; 2]) {
    let mut lo = [f32::INFINITY; 3];
    let mut hi = [f32::NEG_INFINITY; 3];
    for item in &*items {
        for axis in 0..3 {
            let centre = item.bounds.centre(axis);
            (lo[axis], hi[axis]) = (min(lo[axis], centre), max(hi[axis], centre));
        }
    }
    let extent = [hi[0] - lo[0], hi[1] - lo[1], hi[2] - lo[2]];
    let scale = extent.map(|extent| if extent > 0.0 { BINS as f32 / extent } else { 0.0 });
    let bin = |item: &Item, axis: usize| {
        (((item.bounds.centre(axis) - lo[axis]) * scale[axis]) as usize).min(BINS - 1)
    };
    if by_cost {
        let mut bins = [[(Bounds::EMPTY, 0usize); BINS]; 3];
        for item in &*items {
            for (axis, bins) in bins.iter_mut().enumerate() {
                let (bounds, count) = &mut bins[bin(item, axis)];
                bounds.add(&item.bounds);
                *count += 1;
            }
        }
        let mut best: Option<(f64, usize, usize, [Bounds; 2])> = None;
        for (axis, bins) in bins.iter().enumerate() {
            if extent[axis] > 0.0
                && let Some((cost, border, halves)) = best_border(bins)
                && best.is_none_or(|(least, ..)| cost < least)
            {
                best = Some((cost, axis, border, halves));
            }
        }
        if let Some((_, axis, border, halves)) = best {
            let mut first = 0;
            for place in 0..items.len() {
                if bin(&items[place], axis) < border {
                    items.swap(first, place);
                    first += 1;
                }
            }
            return (first, halves);
        }
    }
    // Centres that are all equal, or a tree that would be too deep: half of them, along the longest axis.
    let axis = (1..3).fold(0, |most, axis| if extent[axis] > extent[most] { axis } else { most });
    let half = items.len() / 2;
    items.select_nth_unstable_by(half, |a, b| {
        let centres = a.bounds.centre(axis).total_cmp(&b.bounds.centre(axis));
        centres.then(a.instance.cmp(&b.instance))
    });
    let mut halves = [Bounds::EMPTY; 2];
    for (place, item) in items.iter().enumerate() {
        halves[usize::from(place >= half)].add(&item.bounds);
    }
    (half, halves)
}

/// The best border of bins by SAH, its cost, and the bounds on both sides; `None` where all centres are in one bin.
fn best_border(bins: &[(Bounds, usize); BINS]) -> Option<(f64, usize, [Bounds; 2])> {
    let mut above = [(Bounds::EMPTY, 0usize); BINS];
    let mut whole = (Bounds::EMPTY, 0);
    for bin in (1..BINS).rev() {
        whole.0.add(&bins[bin].0);
        whole.1 += bins[bin].1;
        above[bin] = whole;
    }
    let mut best: Option<(f64, usize, [Bounds; 2])> = None;
    let (mut bounds, mut count) = (Bounds::EMPTY, 0);
    for border in 1..BINS {
        bounds.add(&bins[border - 1].0);
        count += bins[border - 1].1;
        let (others, rest) = &above[border];
        if bins[border - 1].1 == 0 || *rest == 0 {
            continue;
        }
        let cost = bounds.half_area() * count as f64 + others.half_area() * *rest as f64;
        if best.is_none_or(|(least, ..)| cost < least) {
            best = Some((cost, border, [bounds, *others]));
        }
    }
    best
}
