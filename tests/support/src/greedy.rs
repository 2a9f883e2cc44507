//! Greedy builders that look at every plane: one that states what preset `best` must build, and the
//! textbook's.

use splitplane_core::aabb::Aabb;
use splitplane_core::config::{BuildConfig, Sweep};
use splitplane_core::mesh::Mesh;
use splitplane_core::tree::KdTree;
use splitplane_core::tree::node::{Axis, KdNode};
use splitplane_core::triangle::{Triangle, prepare};

/// Bounds of a triangle's parts in a cell, within old bounds, left and right of a plane; `None` where it
/// has none.
pub type Clip = dyn Fn(&Triangle, &Aabb, &Aabb, usize, f32) -> [Option<Aabb>; 2];

/// A reference: a triangle and the bounds of its part of the cell.
#[derive(Clone, Copy)]
struct Part {
    triangle: u32,
    bounds: Aabb,
}

/// A plane and what it costs.
#[derive(Clone, Copy)]
struct Plane {
    /// What planes are compared by: children cost less than leaves of their blocks where they have more
    /// than four.
    cost: f64,
    /// The cost with leaves for children.
    leaves: f64,
    axis: usize,
    position: f32,
    planar_right: bool,
    left: u64,
    right: u64,
}

/// The faces of a node's references on one axis, each list in order.
struct Faces {
    lows: Vec<f32>,
    highs: Vec<f32>,
    /// Where references without extent lie.
    planar: Vec<f32>,
}

impl Faces {
    fn of(parts: &[Part], axis: usize) -> Faces {
        let sorted = |of: &dyn Fn(f32, f32) -> Option<f32>| {
            let mut list: Vec<f32> = parts
                .iter()
                .filter_map(|part| of(part.bounds.lo[axis], part.bounds.hi[axis]))
                .collect();
            list.sort_unstable_by(f32::total_cmp);
            list
        };
        Faces {
            lows: sorted(&|lo, _| Some(lo)),
            highs: sorted(&|_, hi| Some(hi)),
            planar: sorted(&|lo, hi| (lo == hi).then_some(lo)),
        }
    }

    /// How many references start before a plane, are planar in it, and end behind it.
    fn sides(&self, plane: f32) -> [u64; 3] {
        let below = |list: &[f32]| list.partition_point(|&face| face < plane);
        let up_to = |list: &[f32]| list.partition_point(|&face| face <= plane);
        let planar = up_to(&self.planar) - below(&self.planar);
        let right = self.highs.len() - up_to(&self.highs);
        [below(&self.lows), planar, right].map(|n| n as u64)
    }
}

/// A finished subtree.
enum Tree {
    Leaf(Vec<u32>),
    Split(usize, f32, Box<[Tree; 2]>),
}

/// The tree of preset `best`, by counting the references on either side of every plane. With `clip` absent,
/// bounds are cut at planes.
pub fn every_plane(mesh: &Mesh<'_>, config: &BuildConfig, clip: Option<&Clip>) -> KdTree {
    let (triangles, parts, bounds) = input(mesh);
    let budget = u64::from(config.reference_cap(parts.len() as u32));
    let sweep = config.sweep().expect("the offline builder");
    let builder = EveryPlane { config, sweep, clip, triangles };
    let (tree, _) = builder.build(parts, bounds, 0, 0, budget);
    finish(&tree, bounds, mesh, config)
}

/// The expected cost of a child of this many blocks.
fn expected(blocks: f64) -> f64 {
    let root = (blocks / 4.0).sqrt();
    if blocks <= 4.0 { blocks } else { 4.0 * (root * root.sqrt()) }
}

struct EveryPlane<'a> {
    config: &'a BuildConfig,
    sweep: &'a Sweep,
    clip: Option<&'a Clip>,
    triangles: Vec<Triangle>,
}

impl EveryPlane<'_> {
    fn blocks(&self, n: u64) -> f64 {
        n.div_ceil(u64::from(self.config.block_width)) as f64
    }

    /// The cost of a plane, planar references on the better side.
    fn plane(
        &self,
        faces: &Faces,
        cell: &Aabb,
        axis: usize,
        position: f32,
        expected: &dyn Fn(f64) -> f64,
    ) -> Plane {
        let [left, planar, right] = faces.sides(position);
        let on_left = self.cost(cell, axis, position, left + planar, right, expected);
        let on_right = self.cost(cell, axis, position, left, right + planar, expected);
        let planar_right = on_right < on_left;
        let (left, right) =
            if planar_right { (left, right + planar) } else { (left + planar, right) };
        let cost = if planar_right { on_right } else { on_left };
        let leaves = self.cost(cell, axis, position, left, right, &|blocks| blocks);
        Plane { cost, leaves, axis, position, planar_right, left, right }
    }

    /// K_T A + K_I (f(ceil(nL / W)) A_L + f(ceil(nR / W)) A_R), less for an empty side, where `child` is f.
    fn cost(
        &self,
        cell: &Aabb,
        axis: usize,
        position: f32,
        left: u64,
        right: u64,
        child: &dyn Fn(f64) -> f64,
    ) -> f64 {
        let e = extents(cell);
        let (y, z) = (e[(axis + 1) % 3], e[(axis + 2) % 3]);
        let side = |length: f64| {
            if y + z == 0.0 { length + y * z } else { length * (y + z) + y * z }
        };
        let low = side(f64::from(position) - f64::from(cell.lo[axis]));
        let high = side(f64::from(cell.hi[axis]) - f64::from(position));
        let step = f64::from(self.config.traversal_cost) * half_area(cell);
        let tests = child(self.blocks(left)) * low + child(self.blocks(right)) * high;
        let cost = step + f64::from(self.config.intersection_cost) * tests;
        let kept = f64::from(256 - self.sweep.empty_bonus) / 256.0;
        if left.min(right) == 0 { cost * kept } else { cost }
    }

    fn build(
        &self,
        parts: Vec<Part>,
        cell: Aabb,
        depth: u32,
        bad: u32,
        budget: u64,
    ) -> (Tree, f64) {
        let n = parts.len() as u64;
        let area = half_area(&cell);
        let leaf = f64::from(self.config.intersection_cost) * (self.blocks(n) * area);
        let as_leaf = || {
            let mut all: Vec<u32> = parts.iter().map(|part| part.triangle).collect();
            all.sort_unstable();
            (Tree::Leaf(all), leaf)
        };
        let longest = extents(&cell).into_iter().fold(0.0, f64::max);
        if n == 0 || depth >= self.config.max_depth || longest < 2f64.powi(-116) {
            return as_leaf();
        }
        let mut best: Option<Plane> = None;
        // The best with leaves for children: taken where the first does not pay.
        let mut cheapest: Option<Plane> = None;
        for axis in 0..3 {
            let faces = Faces::of(&parts, axis);
            for &position in faces.lows.iter().chain(&faces.highs) {
                if !(cell.lo[axis] < position && position < cell.hi[axis]) {
                    continue;
                }
                let plane = self.plane(&faces, &cell, axis, position, &expected);
                let key = |plane: &Plane| (plane.cost, plane.axis, plane.position);
                if best.as_ref().is_none_or(|best| key(&plane) < key(best)) {
                    best = Some(plane);
                }
                let plane = self.plane(&faces, &cell, axis, position, &|blocks| blocks);
                if cheapest.as_ref().is_none_or(|best| key(&plane) < key(best)) {
                    cheapest = Some(plane);
                }
            }
        }
        let best = best.filter(|best| best.leaves < leaf).or(cheapest);
        let Some(best) = best else { return as_leaf() };
        let pays = best.leaves < leaf;
        let one_block = n <= u64::from(self.config.block_width);
        if !pays && (one_block || bad >= self.sweep.bad_splits) {
            return as_leaf();
        }
        if best.left + best.right > budget {
            return as_leaf();
        }
        let sides = self.distribute(&parts, &cell, &best);
        let [left, right] = [&sides[0], &sides[1]].map(|side| side.len() as u64);
        let (mut low, mut high) = (cell, cell);
        low.hi[best.axis] = best.position;
        high.lo[best.axis] = best.position;
        let share = budget * left / (left + right);
        let bad = if pays { 0 } else { bad + 1 };
        let [low_parts, high_parts] = sides;
        let (low, low_cost) = self.build(low_parts, low, depth + 1, bad, share);
        let (high, high_cost) = self.build(high_parts, high, depth + 1, bad, budget - share);
        let cost = f64::from(self.config.traversal_cost) * area + low_cost + high_cost;
        if cost >= leaf {
            return as_leaf();
        }
        (Tree::Split(best.axis, best.position, Box::new([low, high])), cost)
    }

    fn distribute(&self, parts: &[Part], cell: &Aabb, plane: &Plane) -> [Vec<Part>; 2] {
        let (axis, position) = (plane.axis, plane.position);
        let mut sides = [Vec::new(), Vec::new()];
        for part in parts {
            let (lo, hi) = (part.bounds.lo[axis], part.bounds.hi[axis]);
            if lo == position && hi == position {
                sides[usize::from(plane.planar_right)].push(*part);
            } else if hi <= position {
                sides[0].push(*part);
            } else if lo >= position {
                sides[1].push(*part);
            } else {
                let mut cut = [part.bounds, part.bounds];
                cut[0].hi[axis] = position;
                cut[1].lo[axis] = position;
                let mut bounds = cut.map(Some);
                if let Some(clip) = self.clip {
                    let corners = &self.triangles[part.triangle as usize];
                    let clipped = clip(corners, cell, &part.bounds, axis, position);
                    if clipped.iter().any(Option::is_some) {
                        bounds = clipped;
                    }
                }
                for (side, bounds) in sides.iter_mut().zip(bounds) {
                    side.extend(bounds.map(|bounds| Part { bounds, ..*part }));
                }
            }
        }
        sides
    }
}

/// The greedy sweep as textbooks have it (Wald and Havran 2006, without clipping, empty-space bonus and
/// the choice of sides for planar triangles): sorted faces, bounds cut at planes, planar triangles left, a
/// leaf as soon as the least plane costs no less. Costs of `config` with W = 1.
pub fn textbook(mesh: &Mesh<'_>, config: &BuildConfig) -> KdTree {
    let (_, parts, bounds) = input(mesh);
    finish(&textbook_node(config, parts, bounds, 0), bounds, mesh, config)
}

fn textbook_node(config: &BuildConfig, parts: Vec<Part>, cell: Aabb, depth: u32) -> Tree {
    let [traversal, test] = [config.traversal_cost, config.intersection_cost].map(f64::from);
    let n = parts.len();
    let whole = half_area(&cell);
    let mut best = (test * n as f64 * whole, usize::MAX, 0.0f32);
    // Too small a cell is a leaf for every builder.
    let longest = extents(&cell).into_iter().fold(0.0, f64::max);
    if depth < config.max_depth && n > 0 && longest >= 2f64.powi(-116) {
        for axis in 0..3 {
            let faces = Faces::of(&parts, axis);
            for &plane in faces.lows.iter().chain(&faces.highs) {
                if !(cell.lo[axis] < plane && plane < cell.hi[axis]) {
                    continue;
                }
                let [left, planar, right] = faces.sides(plane).map(|n| n as f64);
                let (mut low, mut high) = (cell, cell);
                low.hi[axis] = plane;
                high.lo[axis] = plane;
                let tests = (left + planar) * half_area(&low) + right * half_area(&high);
                let cost = traversal * whole + test * tests;
                let tie = cost == best.0 && axis == best.1 && plane < best.2;
                if cost < best.0 || tie {
                    best = (cost, axis, plane);
                }
            }
        }
    }
    let (_, axis, plane) = best;
    if axis == usize::MAX {
        return Tree::Leaf(parts.iter().map(|part| part.triangle).collect());
    }
    let (mut low, mut high) = (cell, cell);
    low.hi[axis] = plane;
    high.lo[axis] = plane;
    let side = |cell: &Aabb, takes: &dyn Fn(&Aabb) -> bool| -> Vec<Part> {
        let cut = |part: &Part| Part { bounds: part.bounds.intersection(cell), ..*part };
        parts.iter().filter(|part| takes(&part.bounds)).map(cut).collect()
    };
    let left = side(&low, &|b| b.lo[axis] < plane || b.hi[axis] <= plane);
    let right = side(&high, &|b| b.hi[axis] > plane);
    drop(parts);
    let left = textbook_node(config, left, low, depth + 1);
    let right = textbook_node(config, right, high, depth + 1);
    Tree::Split(axis, plane, Box::new([left, right]))
}

/// Snapped triangles, references to those kept, and their bounds.
fn input(mesh: &Mesh<'_>) -> (Vec<Triangle>, Vec<Part>, Aabb) {
    let prepared: Vec<_> = (0..mesh.len()).map(|i| prepare(&mesh.triangle(i))).collect();
    let parts: Vec<Part> = prepared
        .iter()
        .enumerate()
        .filter(|(_, prepared)| prepared.kept)
        .map(|(i, p)| Part { triangle: i as u32, bounds: Aabb::of_points(&p.corners) })
        .collect();
    let bounds = parts.iter().fold(Aabb::EMPTY, |bounds, part| bounds.union(&part.bounds));
    (prepared.iter().map(|prepared| prepared.corners).collect(), parts, bounds)
}

fn extents(cell: &Aabb) -> [f64; 3] {
    [0, 1, 2].map(|k| f64::from(cell.hi[k]) - f64::from(cell.lo[k]))
}

/// Half the surface area, or the length of what has none.
fn half_area(cell: &Aabb) -> f64 {
    let [x, y, z] = extents(cell);
    let area = x * (y + z) + y * z;
    if area > 0.0 { area } else { x.max(0.0) + y.max(0.0) + z.max(0.0) }
}

fn finish(tree: &Tree, bounds: Aabb, mesh: &Mesh<'_>, config: &BuildConfig) -> KdTree {
    fn write(tree: &Tree, nodes: &mut Vec<KdNode>, references: &mut Vec<u32>) {
        match tree {
            Tree::Leaf(list) => {
                nodes.push(KdNode::leaf(references.len() as u32, list.len() as u32));
                references.extend(list);
            }
            Tree::Split(axis, position, children) => {
                let index = nodes.len();
                nodes.push(KdNode::leaf(0, 0));
                write(&children[0], nodes, references);
                let right = nodes.len() as u32;
                nodes[index] = KdNode::interior(Axis::from_index(*axis as u32), *position, right);
                write(&children[1], nodes, references);
            }
        }
    }
    let (mut nodes, mut references) = (Vec::new(), Vec::new());
    write(tree, &mut nodes, &mut references);
    KdTree { nodes, references, bounds, triangles: mesh.len() as u32, config: *config }
}
