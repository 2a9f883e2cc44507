//! Greedy builders that look at every plane: one that states what preset `best` must build, and the
//! textbook's.

use splitplane_core::aabb::Aabb;
use splitplane_core::config::BuildConfig;
use splitplane_core::mesh::Mesh;
use splitplane_core::node::{Axis, KdNode};
use splitplane_core::tree::KdTree;
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
    cost: f64,
    axis: usize,
    position: f32,
    planar_right: bool,
    left: u64,
    right: u64,
}

/// A finished subtree.
enum Tree {
    Leaf(Vec<u32>),
    Split(usize, f32, Box<[Tree; 2]>),
}

/// The tree of preset `best`, by counting every reference for every plane. Quadratic; with `clip` absent,
/// bounds are cut at planes.
pub fn every_plane(mesh: &Mesh<'_>, config: &BuildConfig, clip: Option<&Clip>) -> KdTree {
    let (triangles, parts, bounds) = input(mesh);
    let budget = u64::from(config.reference_cap(parts.len() as u32));
    let builder = EveryPlane { config, clip, triangles };
    let (tree, _) = builder.build(parts, bounds, 0, 0, budget);
    finish(&tree, bounds, mesh, config)
}

struct EveryPlane<'a> {
    config: &'a BuildConfig,
    clip: Option<&'a Clip>,
    triangles: Vec<Triangle>,
}

impl EveryPlane<'_> {
    fn blocks(&self, n: u64) -> f64 {
        n.div_ceil(u64::from(self.config.block_width)) as f64
    }

    /// The cost of a plane, planar references on the better side.
    fn plane(&self, parts: &[Part], cell: &Aabb, axis: usize, position: f32) -> Plane {
        let count = |test: &dyn Fn(f32, f32) -> bool| {
            let meets = |part: &&Part| test(part.bounds.lo[axis], part.bounds.hi[axis]);
            parts.iter().filter(meets).count() as u64
        };
        let left = count(&|lo, _| lo < position);
        let right = count(&|_, hi| hi > position);
        let planar = count(&|lo, hi| lo == position && hi == position);
        let on_left = self.cost(cell, axis, position, left + planar, right);
        let on_right = self.cost(cell, axis, position, left, right + planar);
        if on_right < on_left {
            let right = right + planar;
            Plane { cost: on_right, axis, position, planar_right: true, left, right }
        } else {
            let left = left + planar;
            Plane { cost: on_left, axis, position, planar_right: false, left, right }
        }
    }

    /// K_T A + K_I (ceil(nL / W) A_L + ceil(nR / W) A_R), less for an empty side.
    fn cost(&self, cell: &Aabb, axis: usize, position: f32, left: u64, right: u64) -> f64 {
        let e = extents(cell);
        let (y, z) = (e[(axis + 1) % 3], e[(axis + 2) % 3]);
        let side = |length: f64| {
            if y + z == 0.0 { length + y * z } else { length * (y + z) + y * z }
        };
        let low = side(f64::from(position) - f64::from(cell.lo[axis]));
        let high = side(f64::from(cell.hi[axis]) - f64::from(position));
        let step = f64::from(self.config.traversal_cost) * half_area(cell);
        let tests = self.blocks(left) * low + self.blocks(right) * high;
        let cost = step + f64::from(self.config.intersection_cost) * tests;
        let kept = f64::from(256 - self.config.empty_bonus) / 256.0;
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
        for axis in 0..3 {
            for part in &parts {
                for position in [part.bounds.lo[axis], part.bounds.hi[axis]] {
                    if !(cell.lo[axis] < position && position < cell.hi[axis]) {
                        continue;
                    }
                    let plane = self.plane(&parts, &cell, axis, position);
                    let key = |plane: &Plane| (plane.cost, plane.axis, plane.position);
                    if best.as_ref().is_none_or(|best| key(&plane) < key(best)) {
                        best = Some(plane);
                    }
                }
            }
        }
        let Some(best) = best else { return as_leaf() };
        let pays = best.cost < leaf;
        let one_block = n <= u64::from(self.config.block_width);
        if !pays && (one_block || bad >= self.config.bad_splits) {
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
    // Too small a cell is a leaf whoever builds.
    let longest = extents(&cell).into_iter().fold(0.0, f64::max);
    if depth < config.max_depth && n > 0 && longest >= 2f64.powi(-116) {
        for axis in 0..3 {
            let mut lows: Vec<f32> = parts.iter().map(|part| part.bounds.lo[axis]).collect();
            let mut highs: Vec<f32> = parts.iter().map(|part| part.bounds.hi[axis]).collect();
            lows.sort_unstable_by(f32::total_cmp);
            highs.sort_unstable_by(f32::total_cmp);
            let mut planes: Vec<f32> = lows.iter().chain(&highs).copied().collect();
            planes.sort_unstable_by(f32::total_cmp);
            planes.dedup();
            let mut planar: Vec<f32> = parts
                .iter()
                .filter(|part| part.bounds.lo[axis] == part.bounds.hi[axis])
                .map(|part| part.bounds.lo[axis])
                .collect();
            planar.sort_unstable_by(f32::total_cmp);
            let (mut begun, mut over, mut flat) = (0, 0, 0);
            for plane in planes {
                while begun < n && lows[begun] < plane {
                    begun += 1;
                }
                while over < n && highs[over] <= plane {
                    over += 1;
                }
                if !(cell.lo[axis] < plane && plane < cell.hi[axis]) {
                    continue;
                }
                while flat < planar.len() && planar[flat] < plane {
                    flat += 1;
                }
                let in_plane = planar[flat..].iter().take_while(|&&place| place == plane).count();
                let (mut low, mut high) = (cell, cell);
                low.hi[axis] = plane;
                high.lo[axis] = plane;
                let tests = (begun + in_plane) as f64 * half_area(&low)
                    + (n - over) as f64 * half_area(&high);
                let cost = traversal * whole + test * tests;
                if cost < best.0 {
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
