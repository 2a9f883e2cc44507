//! Builds the tree over instances: splits by binned SAH (Wald 2007), eight ways at a time.

use alloc::vec::Vec;

use super::top_tree::{INSTANCE, NO_PARENT, Place, TopNode, TopTree, WIDTH, centre};
use super::world_box::WorldBox;
use crate::aabb::Aabb;

/// Bins of one axis.
const BINS: usize = 16;
/// Levels below which boxes are halved by number, whatever that costs, so that stacks stay small.
pub(super) const SAH_LEVELS: usize = 14;

/// An instance, to be put in the tree.
#[derive(Clone, Copy, Debug)]
struct Item {
    instance: u32,
    world_box: WorldBox,
    centre: [f32; 3],
}

/// Bytes that a build over this many instances holds at once, of which the greatest name is below `names`.
pub fn top_tree_bytes(instances: usize, names: usize) -> u64 {
    let nodes = most_nodes(instances);
    (nodes * (size_of::<TopNode>() + size_of::<Place>())
        + names * size_of::<Place>()
        + instances * size_of::<Item>()) as u64
}

/// A node has at least two children, or is the root.
fn most_nodes(instances: usize) -> usize {
    instances.max(1)
}

impl TopTree {
    /// Builds the tree over these instances, by their names, which are below `names`. The same boxes give the same tree.
    /// `None` where the system has no memory for it.
    pub fn build(
        names: usize,
        boxes: impl ExactSizeIterator<Item = (u32, WorldBox)>,
    ) -> Option<TopTree> {
        let mut items = Vec::new();
        items.try_reserve_exact(boxes.len()).ok()?;
        items.extend(boxes.map(|(instance, world_box)| Item {
            instance,
            world_box,
            centre: [0, 1, 2].map(|axis| centre(&world_box.bounds, axis)),
        }));
        let mut tree = TopTree::default();
        tree.places.try_reserve_exact(names).ok()?;
        tree.places.resize(names, Place::NOWHERE);
        if items.is_empty() {
            return Some(tree);
        }
        // Depth first; a node takes its place before its children.
        let mut left: Vec<(usize, usize, Place, usize)> = Vec::new();
        left.try_reserve(64 * WIDTH).ok()?;
        left.push((0, items.len(), Place { node: NO_PARENT, slot: 0 }, 1));
        while let Some((first, end, above, level)) = left.pop() {
            tree.nodes.try_reserve(1).ok()?;
            tree.parents.try_reserve(1).ok()?;
            left.try_reserve(WIDTH).ok()?;
            tree.depth = tree.depth.max(level);
            let node = tree.nodes.len() as u32;
            let mut own = TopNode::EMPTY;
            let (parts, count) = parts(&mut items[first..end], level);
            let mut start = first;
            for (slot, &(length, ref world_box)) in parts[..count].iter().enumerate() {
                own.set_child_box(slot, world_box);
                tree.cost += world_box.half_area();
                let place = Place { node, slot: slot as u32 };
                if length == 1 {
                    let instance = items[start].instance;
                    own.children[slot] = INSTANCE | instance;
                    tree.places[instance as usize] = place;
                } else {
                    // Set when the child is made.
                    own.children[slot] = 0;
                    left.push((start, start + length, place, level + 1));
                }
                start += length;
            }
            if let Some(parent) = tree.nodes.get_mut(above.node as usize) {
                parent.children[above.slot as usize] = node;
            }
            tree.nodes.push(own);
            tree.parents.push(above);
        }
        tree.cost_when_built = tree.cost;
        Some(tree)
    }
}

/// Divides items among the children of a node, and puts them in that order: how many each child gets, and their box.
fn parts(items: &mut [Item], level: usize) -> ([(usize, WorldBox); WIDTH], usize) {
    let nothing = WorldBox { bounds: Aabb::EMPTY, reach: 0.0 };
    let mut all = [(0, nothing); WIDTH];
    all[0] = (items.len(), box_of(items));
    let mut count = 1;
    while count < WIDTH {
        // The one that costs most; the first of equals.
        let mut most: Option<(usize, f64)> = None;
        for (part, (length, world_box)) in all[..count].iter().enumerate() {
            let cost = world_box.half_area() * *length as f64;
            if *length > 1 && most.is_none_or(|(_, greatest)| cost > greatest) {
                most = Some((part, cost));
            }
        }
        let Some((part, _)) = most else { break };
        let start: usize = all[..part].iter().map(|(length, _)| length).sum();
        let length = all[part].0;
        let own = &mut items[start..start + length];
        let first = split(own, level);
        let (one, other) = own.split_at(first);
        let halves = [(first, box_of(one)), (length - first, box_of(other))];
        all.copy_within(part + 1..count, part + 2);
        all[part..part + 2].copy_from_slice(&halves);
        count += 1;
    }
    (all, count)
}

fn box_of(items: &[Item]) -> WorldBox {
    let nothing = WorldBox { bounds: Aabb::EMPTY, reach: 0.0 };
    items.iter().fold(nothing, |all, item| all.union(&item.world_box))
}

/// Puts items of the first half before those of the second. Returns how many the first has: at least one, and not all.
fn split(items: &mut [Item], level: usize) -> usize {
    let mut centres = Aabb::EMPTY;
    for item in &*items {
        centres = centres.union(&Aabb { lo: item.centre, hi: item.centre });
    }
    let mut best: Option<(f64, usize, usize)> = None;
    if level <= SAH_LEVELS {
        for axis in 0..3 {
            if let Some((cost, border)) = best_border(items, &centres, axis)
                && best.is_none_or(|(least, ..)| cost < least)
            {
                best = Some((cost, axis, border));
            }
        }
    }
    if let Some((_, axis, border)) = best {
        let bin = Bins::new(&centres, axis);
        let mut first = 0;
        for i in 0..items.len() {
            if bin.of(&items[i]) < border {
                items.swap(first, i);
                first += 1;
            }
        }
        return first;
    }
    // Centres that are all equal, or a tree that would be too deep: half of them, along the longest axis.
    let axis = centres.longest_axis();
    let half = items.len() / 2;
    items.select_nth_unstable_by(half, |a, b| {
        a.centre[axis].total_cmp(&b.centre[axis]).then(a.instance.cmp(&b.instance))
    });
    half
}

/// Bins of equal width along an axis.
struct Bins {
    axis: usize,
    lo: f64,
    per_unit: f64,
}

impl Bins {
    fn new(centres: &Aabb, axis: usize) -> Bins {
        let lo = f64::from(centres.lo[axis]);
        let extent = f64::from(centres.hi[axis]) - lo;
        Bins { axis, lo, per_unit: if extent > 0.0 { BINS as f64 / extent } else { 0.0 } }
    }

    fn of(&self, item: &Item) -> usize {
        let bin = (f64::from(item.centre[self.axis]) - self.lo) * self.per_unit;
        (bin as usize).min(BINS - 1)
    }
}

/// The best border of bins by SAH, and its cost; `None` where all centres are in one bin.
fn best_border(items: &[Item], centres: &Aabb, axis: usize) -> Option<(f64, usize)> {
    let bins = Bins::new(centres, axis);
    let nothing = WorldBox { bounds: Aabb::EMPTY, reach: 0.0 };
    let mut all = [(0usize, nothing); BINS];
    for item in items {
        let bin = &mut all[bins.of(item)];
        *bin = (bin.0 + 1, bin.1.union(&item.world_box));
    }
    let mut above = [(0usize, 0.0f64); BINS];
    let (mut count, mut whole) = (0, nothing);
    for bin in (1..BINS).rev() {
        (count, whole) = (count + all[bin].0, whole.union(&all[bin].1));
        above[bin] = (count, whole.half_area());
    }
    let mut best: Option<(f64, usize)> = None;
    let (mut count, mut whole) = (0, nothing);
    for border in 1..BINS {
        (count, whole) = (count + all[border - 1].0, whole.union(&all[border - 1].1));
        let (others, area) = above[border];
        if count == 0 || others == 0 {
            continue;
        }
        let cost = whole.half_area() * count as f64 + area * others as f64;
        if best.is_none_or(|(least, _)| cost < least) {
            best = Some((cost, border));
        }
    }
    best
}
