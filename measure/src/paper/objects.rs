//! Two objects in their boxes, a line that meets one of them, and the boxes within (the survey's Figures 5 and 6).
//!
//! The objects are what a tree tells apart: the triangles below two siblings that share none. Their boxes are those of the
//! triangles, and [`Aabb::ray_interval`] says which of them the line meets.

use super::space::{Paint, Panel, Path, Solid, Space};
use serde::Serialize;
use splitplane::scene::Scene;
use splitplane_core::aabb::Aabb;
use splitplane_core::ray::Ray;
use splitplane_core::tree::KdTreeView;
use splitplane_core::tree::node::{KdNode, NodeKind};
use std::collections::HashSet;

/// Triangles of an object, at least and at most: one can be seen and told from others.
const TRIANGLES: [usize; 2] = [8, 600];
/// Longest side over shortest side of a box that is drawn.
const SLIMMEST: f32 = 12.0;

/// A box of triangles.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ObjectBox {
    /// 0 for the box of both objects, 1 for an object, 2 for a part of one.
    pub level: u32,
    /// The lower corner.
    pub lo: [f32; 3],
    /// The upper corner.
    pub hi: [f32; 3],
    /// Triangles in it.
    pub triangles: usize,
    /// Which.
    #[serde(skip)]
    members: Vec<u32>,
    /// From where to where on the line, in units of its direction; none where the line passes it.
    pub interval: Option<(f32, f32)>,
}

/// Two objects, their boxes and a line.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Objects {
    /// The scene.
    pub scene: String,
    /// The node whose children they are.
    pub node: usize,
    /// Where the line begins.
    pub origin: [f32; 3],
    /// Where it goes.
    pub direction: [f32; 3],
    /// The box of both, then each object with its parts.
    pub boxes: Vec<ObjectBox>,
    /// The triangles of both.
    #[serde(skip)]
    triangles: Vec<[[f32; 3]; 3]>,
}

/// A node and the triangles under its children.
struct Siblings {
    node: usize,
    left: Vec<u32>,
    right: Vec<u32>,
}

/// The siblings that make a picture: of those of which the line passes a part of the object that it meets, else of all, those with
/// most triangles. None in scenes that have no two such objects.
pub fn find(tree: &KdTreeView<'_>, scene: &Scene) -> Option<Objects> {
    let mut best: Option<((bool, usize), Siblings)> = None;
    below(tree, 0, &mut |siblings| {
        let boxes = [&siblings.left, &siblings.right].map(|set| box_of(scene, set));
        if !boxes.iter().all(is_stout) {
            return;
        }
        let Some(ray) = line(&boxes) else { return };
        let second = right_child(tree, siblings.node);
        let parts = second.map_or(Vec::new(), |second| parts(tree, second));
        let passes = parts.iter().any(|part| box_of(scene, part).ray_interval(&ray).is_none());
        let score = (passes, siblings.left.len().min(siblings.right.len()));
        if best.as_ref().is_none_or(|best| best.0 < score) {
            best = Some((score, siblings));
        }
    });
    let (_, Siblings { node, left, right }) = best?;
    let boxes = [box_of(scene, &left), box_of(scene, &right)];
    let ray = line(&boxes)?;
    let both: Vec<u32> = left.iter().chain(&right).copied().collect();
    let described = |level, set: &[u32]| {
        let bounds = box_of(scene, set);
        let interval = bounds.ray_interval(&ray);
        let (lo, hi, members) = (bounds.lo, bounds.hi, set.to_vec());
        ObjectBox { level, lo, hi, triangles: set.len(), members, interval }
    };
    let mut out = vec![described(0, &both)];
    for (set, child) in [(left, node + 1), (right, right_child(tree, node)?)] {
        out.push(described(1, &set));
        out.extend(parts(tree, child).iter().map(|set| described(2, set)));
    }
    let triangles = both.iter().filter_map(|&triangle| scene.corners(triangle)).collect();
    let (origin, direction) = (ray.origin, ray.direction);
    Some(Objects { scene: scene.name.clone(), node, origin, direction, boxes: out, triangles })
}

/// The triangles under each child of a node that has some.
fn parts(tree: &KdTreeView<'_>, node: usize) -> Vec<Vec<u32>> {
    let children = right_child(tree, node).map(|right| [node + 1, right]);
    let sets = children.into_iter().flatten().filter_map(|part| below(tree, part, &mut |_| {}));
    sets.filter(|set| !set.is_empty()).collect()
}

fn right_child(tree: &KdTreeView<'_>, node: usize) -> Option<usize> {
    match tree.nodes.get(node).map(KdNode::kind)? {
        NodeKind::Interior { right, .. } => Some(right as usize),
        NodeKind::Leaf { .. } => None,
    }
}

/// The triangles under a node, each once and in order; none of a node that has too many. Siblings that share none are
/// shown to `found`.
fn below(tree: &KdTreeView<'_>, node: usize, found: &mut dyn FnMut(Siblings)) -> Option<Vec<u32>> {
    let most = 2 * TRIANGLES[1];
    match tree.nodes.get(node).map(KdNode::kind)? {
        NodeKind::Leaf { first, count } => {
            let mut set = tree.leaf(first, count).to_vec();
            set.sort_unstable();
            (set.len() <= most).then_some(set)
        }
        NodeKind::Interior { right, .. } => {
            let left = below(tree, node + 1, found);
            let right = below(tree, right as usize, found);
            let (left, right) = (left?, right?);
            let mut both = [&left[..], &right[..]].concat();
            both.sort_unstable();
            both.dedup();
            let apart = both.len() == left.len() + right.len();
            let fits = |set: &Vec<u32>| (TRIANGLES[0]..=TRIANGLES[1]).contains(&set.len());
            if apart && fits(&left) && fits(&right) {
                found(Siblings { node, left, right });
            }
            (both.len() <= most).then_some(both)
        }
    }
}

fn box_of(scene: &Scene, set: &[u32]) -> Aabb {
    let corners = set.iter().filter_map(|&triangle| scene.corners(triangle));
    corners.fold(Aabb::EMPTY, |all, corners| all.union(&Aabb::of_points(&corners)))
}

fn is_stout(bounds: &Aabb) -> bool {
    let sides = [0, 1, 2].map(|axis| bounds.hi[axis] - bounds.lo[axis]);
    let [least, most] =
        [f32::min, f32::max].map(|end| sides.into_iter().reduce(end).unwrap_or(0.0));
    least > 0.0 && most <= SLIMMEST * least
}

/// The axis on which there is a gap between two boxes, the widest where there are several.
fn between([a, b]: &[Aabb; 2]) -> Option<usize> {
    let gap = |axis: usize| (b.lo[axis] - a.hi[axis]).max(a.lo[axis] - b.hi[axis]);
    let widest = (0..3).max_by(|&i, &j| gap(i).total_cmp(&gap(j)))?;
    (gap(widest) > 0.0).then_some(widest)
}

/// A line through two opposite faces of the second box, askew, that passes the first.
fn line(boxes: &[Aabb; 2]) -> Option<Ray> {
    let gap = between(boxes)?;
    let [other, own] = boxes;
    let middle = |axis: usize| 0.5 * own.lo[axis] + 0.5 * own.hi[axis];
    let side = |axis: usize| own.hi[axis] - own.lo[axis];
    // Along z or x, so that it can be seen going in and coming out.
    let along = if gap == 2 { 0 } else { 2 };
    let askew: [f32; 3] = std::array::from_fn(|axis| match axis {
        _ if axis == along => -side(axis),
        1 => -0.3 * side(axis),
        // Not towards the other.
        _ => 0.0,
    });
    let origin = std::array::from_fn(|axis| middle(axis) - askew[axis]);
    let ray = Ray::new(origin, askew);
    (own.ray_interval(&ray).is_some() && other.ray_interval(&ray).is_none()).then_some(ray)
}

impl Objects {
    /// Boxes of a level.
    pub fn level(&self, level: u32) -> impl Iterator<Item = &ObjectBox> {
        self.boxes.iter().filter(move |own| own.level == level)
    }

    /// Triangles of the boxes of a level: all of them, and those in boxes that the line meets, each once.
    pub fn triangles(&self, level: u32) -> [usize; 2] {
        let count = |all: bool| {
            let boxes = self.level(level).filter(|own| all || own.interval.is_some());
            boxes.flat_map(|own| &own.members).collect::<HashSet<_>>().len()
        };
        [count(true), count(false)]
    }

    /// Figure 5: two boxes and a line that meets one of them.
    pub fn figure_5(&self) -> Space {
        let solids =
            self.level(1).map(|own| own.solid(if own.interval.is_some() { 0.16 } else { 0.08 }));
        let title = "Two objects in their boxes, and a line";
        let note = "orange: the box that the line meets, and the line, whole where it is inside; grey: the box it passes";
        self.space(title, self.sorted(solids.collect()), note.into())
    }

    /// Figure 6: boxes within boxes.
    pub fn figure_6(&self) -> Space {
        let solids =
            self.boxes.iter().map(|own| own.solid(if own.level == 2 { 0.12 } else { 0.0 }));
        let title = "Boxes within boxes: both objects, each of them, their parts";
        let met = self.boxes.iter().filter(|own| own.interval.is_some()).count();
        let note = format!("the line meets {met} of {} boxes (orange)", self.boxes.len());
        self.space(title, self.sorted(solids.collect()), note)
    }

    /// Boxes from the back to the front, by their middles: near enough for boxes that can be seen through.
    fn sorted(&self, mut solids: Vec<Solid>) -> Vec<Solid> {
        let depth = |solid: &Solid| -> f32 {
            (0..3).map(|axis| 0.5 * solid.bounds.lo[axis] + 0.5 * solid.bounds.hi[axis]).sum()
        };
        solids.sort_by(|a, b| depth(a).total_cmp(&depth(b)));
        solids
    }

    fn space(&self, title: &str, solids: Vec<Solid>, note: String) -> Space {
        let outline = |[a, b, c]: &[[f32; 3]; 3]| Path {
            points: vec![*a, *b, *c, *a],
            paint: Paint::Grey,
            dashed: false,
        };
        let mut paths: Vec<Path> = self.triangles.iter().map(outline).collect();
        let at = |t: f32| std::array::from_fn(|axis| self.origin[axis] + t * self.direction[axis]);
        let inside = self.level(1).find_map(|own| own.interval).unwrap_or((0.0, 0.0));
        for (from, to, dashed) in
            [(0.0, inside.0, true), (inside.0, inside.1, false), (inside.1, inside.1 + 0.3, true)]
        {
            paths.push(Path { points: vec![at(from), at(to)], paint: Paint::Orange, dashed });
        }
        let panel = Panel { title: title.into(), solids, paths, labels: Vec::new() };
        Space { panels: vec![panel], note }
    }
}

impl ObjectBox {
    fn solid(&self, opacity: f64) -> Solid {
        let paint = if self.interval.is_some() { Paint::Orange } else { Paint::Grey };
        Solid { bounds: Aabb { lo: self.lo, hi: self.hi }, paint, opacity }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use splitplane_core::backend::BuildOptions;

    #[test]
    fn a_line_meets_one_of_two_objects_and_what_it_meets_is_nested() {
        let scene = Scene::open("builtin:city:3000").unwrap();
        let (tree, _) = splitplane_cpu::CpuBackend::new()
            .build_tree(&scene.mesh().unwrap(), &BuildOptions::default())
            .unwrap();
        let objects = find(&tree.view(), &scene).unwrap();
        let met = |level| objects.level(level).filter(|own| own.interval.is_some()).count();
        assert_eq!((objects.level(0).count(), objects.level(1).count(), met(1)), (1, 2, 1));
        assert_eq!(met(0), 1, "a line that meets an object meets the box of both");
        let [all, within] = objects.triangles(1);
        assert!(all == objects.boxes[0].triangles && within < all && within >= TRIANGLES[0]);
        // No triangle of the object that is passed is met by the line, by the formula of Moeller and Trumbore in f64.
        let passed = objects.level(1).find(|own| own.interval.is_none()).unwrap();
        let vector = |p: [f32; 3]| glam::DVec3::from_array(p.map(f64::from));
        let (origin, direction) = (vector(objects.origin), vector(objects.direction));
        let mut of_passed = 0;
        for corners in &objects.triangles {
            let inside = corners.iter().all(|p| {
                (0..3).all(|axis| passed.lo[axis] <= p[axis] && p[axis] <= passed.hi[axis])
            });
            if !inside {
                continue;
            }
            of_passed += 1;
            let [a, b, c] = corners.map(vector);
            let (e, f) = (b - a, c - a);
            let p = direction.cross(f);
            let u = (origin - a).dot(p) / e.dot(p);
            let v = direction.dot((origin - a).cross(e)) / e.dot(p);
            assert!(!(u >= 0.0 && v >= 0.0 && u + v <= 1.0), "{corners:?}");
        }
        assert_eq!(of_passed, passed.triangles);
    }
}
