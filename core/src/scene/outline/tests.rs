use alloc::vec::Vec;

use super::*;
use crate::config::BuildConfig;
use crate::random;
use crate::tree::node::{Axis, KdNode};
use crate::triangle::Triangle;

/// Numbers between 0 and 1.
struct Numbers(u64);

impl Numbers {
    fn next(&mut self) -> f32 {
        self.0 += 1;
        (random::hash(20, &[self.0]) >> 40) as f32 / (1u64 << 24) as f32
    }

    /// A few triangles, small ones and some that go through many cells.
    fn triangles(&mut self, count: usize) -> Vec<Triangle> {
        let one = |at: usize| {
            let size = if at.is_multiple_of(10) { 0.7 } else { 0.05 };
            let from = [(); 3].map(|()| self.next());
            [(); 3].map(|()| from.map(|x| x + size * self.next()))
        };
        (0..count).map(one).collect()
    }
}

/// A tree that is divided by chance down to some level.
struct Divided<'a> {
    boxes: &'a [Aabb],
    nodes: Vec<KdNode>,
    references: Vec<u32>,
}

impl Divided<'_> {
    fn divide(&mut self, cell: &Aabb, levels: usize, numbers: &mut Numbers) {
        if levels == 0 {
            let first = self.references.len();
            let meets = |own: &Aabb| !own.intersection(cell).is_empty();
            let own = self.boxes.iter().enumerate().filter(|(_, own)| meets(own));
            self.references.extend(own.map(|(triangle, _)| triangle as u32));
            let count = self.references.len() - first;
            self.nodes.push(KdNode::leaf(first as u32, count as u32));
            return;
        }
        let axis = Axis::from_index((numbers.next() * 2.999) as u32);
        let (lo, hi) = (cell.lo[axis.index()], cell.hi[axis.index()]);
        let split = lo + (0.1 + 0.8 * numbers.next()) * (hi - lo);
        let (mut below, mut above) = (*cell, *cell);
        below.hi[axis.index()] = split;
        above.lo[axis.index()] = split;
        let own = self.nodes.len();
        self.nodes.push(KdNode::leaf(0, 0));
        self.divide(&below, levels - 1, numbers);
        self.nodes[own] = KdNode::interior(axis, split, self.nodes.len() as u32);
        self.divide(&above, levels - 1, numbers);
    }
}

/// Lower and upper ends of the outline's boxes, each smaller by a part of its extent.
fn boxes(of: &Outline, smaller: f64) -> [[[f64; 2]; 3]; CELLS] {
    let ends = |place: usize, axis: usize| {
        let (middle, half) = (of.middle[axis][place], of.half[axis][place] * (1.0 - smaller));
        [middle - half, middle + half]
    };
    core::array::from_fn(|place| [0, 1, 2].map(|axis| ends(place, axis)))
}

/// All of every triangle is in the outline's boxes, which are within cells, and smaller than these; boxes that are smaller by a hundredth lose points.
#[test]
fn an_outline_holds_all_triangles() {
    let mut numbers = Numbers(0);
    let (mut points, mut lost, mut of_cells, mut of_boxes) = (0, 0, 0.0, 0.0);
    for round in 0..300 {
        let triangles = numbers.triangles(1 + round % 40);
        let each: Vec<Aabb> = triangles.iter().map(|one| Aabb::of_points(one)).collect();
        let bounds = each.iter().fold(Aabb::EMPTY, |all, own| all.union(own));
        let mut tree = Divided { boxes: &each, nodes: Vec::new(), references: Vec::new() };
        tree.divide(&bounds, round % 6, &mut numbers);
        let (nodes, references) = (&tree.nodes[..], &tree.references[..]);
        let (triangles_of, config) = (triangles.len() as u32, BuildConfig::default());
        let view = KdTreeView { nodes, references, bounds, triangles: triangles_of, config };
        let mut own = OutlineCells::of(&view);
        for one in &each {
            own.add(one);
        }
        let outline = own.outline().expect("triangles");
        of_cells += cells(&view).map(|cell| area(&cell)).sum::<f64>();
        let held = own.held.iter().filter(|held| !held.is_empty());
        of_boxes += held.map(area).sum::<f64>();
        for (place, held) in own.held.iter().enumerate().filter(|(_, held)| !held.is_empty()) {
            for axis in 0..3 {
                assert!(own.lo[axis][place] <= held.lo[axis]);
                assert!(held.hi[axis] <= own.hi[axis][place]);
            }
        }
        let whole = boxes(&outline, -1e-12);
        let smaller = boxes(&outline, 0.01);
        for triangle in &triangles {
            for corner in 0..9 {
                let (mut u, mut v) = (f64::from(numbers.next()), f64::from(numbers.next()));
                if corner < 3 {
                    (u, v) = (f64::from(corner & 1), f64::from(corner >> 1));
                } else if u + v > 1.0 {
                    (u, v) = (1.0 - u, 1.0 - v);
                }
                let at = [0, 1, 2].map(|axis| {
                    let [a, b, c] = triangle.map(|corner| f64::from(corner[axis]));
                    (1.0 - u - v) * a + (u * b + v * c)
                });
                let is_in = |part: &[[f64; 2]; 3]| {
                    (0..3).all(|axis| part[axis][0] <= at[axis] && at[axis] <= part[axis][1])
                };
                assert!(whole.iter().any(is_in), "{at:?} {triangle:?}");
                points += 1;
                lost += usize::from(!smaller.iter().any(is_in));
            }
        }
    }
    assert!(of_boxes < 0.8 * of_cells, "{of_boxes} {of_cells}");
    assert!(points > 10_000 && lost > 1000, "{points} {lost}");
}

/// No triangles, no outline; and a tree of one leaf has that of its bounds.
#[test]
fn trees_of_one_leaf_have_an_outline() {
    let config = BuildConfig::default();
    let bounds = Aabb { lo: [0.0, -1.0, 2.0], hi: [1.0, 3.0, 4.0] };
    let nodes = &[KdNode::leaf(0, 1)];
    let view = KdTreeView { nodes, references: &[0], bounds, triangles: 1, config };
    let mut cells = OutlineCells::of(&view);
    assert_eq!(cells.outline(), None);
    cells.add(&bounds);
    let outline = cells.outline().expect("a triangle");
    assert_eq!(outline.middle, [[0.5; CELLS], [1.0; CELLS], [3.0; CELLS]]);
    assert_eq!(outline.half, [[0.5; CELLS], [2.0; CELLS], [1.0; CELLS]]);
    assert_eq!(outline.reach, [1.0, 3.0, 4.0]);
}
