//! The boxes of a tree's nodes at one depth, as lines of a picture.

use splitplane::core::aabb::Aabb;
use splitplane::core::tree::KdTreeView;
use splitplane::core::tree::node::NodeKind;
use splitplane::render::{Pinhole, Size};

/// Most boxes that are drawn: the largest ones.
pub(super) const MOST: usize = 1500;
/// What is nearer to the eye than this part of the first point's distance is cut off.
const NEAR: f64 = 1e-6;

/// The boxes at one depth.
pub(super) struct Level {
    depth: u32,
    total: usize,
    boxes: Vec<(Aabb, f32)>,
}

fn area(cell: &Aabb) -> f64 {
    let [x, y, z] = [0, 1, 2].map(|axis| f64::from(cell.hi[axis]) - f64::from(cell.lo[axis]));
    x * y + y * z + z * x
}

/// In units of the camera: how far ahead, and that times the column and the row of the pixel.
type Seen = [f64; 3];

fn cross(a: Seen, b: Seen) -> Seen {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

fn dot(a: Seen, b: Seen) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Cuts a line to what is inside a half space, given by how far inside both ends are.
fn cut([a, b]: [Seen; 2], inside: impl Fn(Seen) -> f64) -> Option<[Seen; 2]> {
    let (of_a, of_b) = (inside(a), inside(b));
    let between = |part: f64| [0, 1, 2].map(|k: usize| a[k] + (b[k] - a[k]) * part);
    match (of_a >= 0.0, of_b >= 0.0) {
        (true, true) => Some([a, b]),
        (false, false) => None,
        (true, false) => Some([a, between(of_a / (of_a - of_b))]),
        (false, true) => Some([between(of_a / (of_a - of_b)), b]),
    }
}

impl Level {
    /// The boxes of all nodes that are so many levels below the root; the largest, where there are too many.
    pub(super) fn of(tree: &KdTreeView<'_>, depth: u32) -> Level {
        let mut boxes = Vec::new();
        tree.walk(|_, kind, cell, own| {
            if own == depth && !cell.is_empty() {
                let content = match kind {
                    NodeKind::Interior { .. } => 0.0,
                    NodeKind::Leaf { count: 0, .. } => 2.0,
                    NodeKind::Leaf { .. } => 1.0,
                };
                boxes.push((*cell, content));
            }
        });
        let total = boxes.len();
        if total > MOST {
            boxes.sort_by(|(a, _), (b, _)| area(b).total_cmp(&area(a)));
            boxes.truncate(MOST);
        }
        Level { depth, total, boxes }
    }

    pub(super) fn depth(&self) -> u32 {
        self.depth
    }

    /// The number of boxes, and five floats for each edge that is seen: both ends in pixels, and what is in the box.
    pub(super) fn edges(&self, camera: &Pinhole, size: Size) -> Vec<f32> {
        let wide = |v: [f32; 3]| v.map(f64::from);
        let (eye, corner) = (wide(camera.eye), wide(camera.corner));
        let (across, down) = (wide(camera.step_x), wide(camera.step_y));
        let determinant = dot(corner, cross(across, down));
        let rows = [cross(across, down), cross(down, corner), cross(corner, across)];
        let seen = |point: [f32; 3]| {
            let point = wide(point);
            let from = [0, 1, 2].map(|k| point[k] - eye[k]);
            rows.map(|row| dot(from, row) / determinant)
        };
        let (width, height) = (f64::from(size.width()), f64::from(size.height()));
        let mut all = vec![self.total as f32];
        for (cell, content) in &self.boxes {
            let corners = [0, 1, 2, 3, 4, 5, 6, 7].map(|index: usize| {
                let bit = |axis: usize| index >> axis & 1 == 1;
                seen([0, 1, 2].map(|axis| if bit(axis) { cell.hi[axis] } else { cell.lo[axis] }))
            });
            let far = corners.iter().map(|corner| corner[0].abs()).fold(0.0, f64::max);
            for from in 0..8 {
                for axis in 0..3 {
                    if from >> axis & 1 == 1 {
                        continue;
                    }
                    let edge = [corners[from], corners[from | 1 << axis]];
                    // In front of the eye, then within the picture on all four sides.
                    let cut_off = cut(edge, |[ahead, ..]| ahead - NEAR * far)
                        .and_then(|edge| cut(edge, |[_, x, _]| x))
                        .and_then(|edge| cut(edge, |[ahead, x, _]| width * ahead - x))
                        .and_then(|edge| cut(edge, |[_, _, y]| y))
                        .and_then(|edge| cut(edge, |[ahead, _, y]| height * ahead - y));
                    let Some(edge) = cut_off else { continue };
                    for [ahead, x, y] in edge {
                        all.extend([x / ahead, y / ahead].map(|place| place as f32));
                    }
                    all.push(*content);
                }
            }
        }
        all
    }
}
