//! Boxes and lines in space, as figures show them: from a corner, in the isometric view.

use splitplane_core::aabb::Aabb;

/// Colours of figures in space.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Paint {
    /// The first child's first child, in the survey's Figure 9.
    Red,
    /// The first child's second child.
    Blue,
    /// The second child's first child.
    Yellow,
    /// The second child's second child.
    Green,
    /// What stands out.
    Orange,
    /// What stands back.
    Grey,
}

/// A box.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Solid {
    /// Where it is.
    pub bounds: Aabb,
    /// Its colour.
    pub paint: Paint,
    /// How opaque its three faces towards the viewer are, 0 for a frame of edges to 1.
    pub opacity: f64,
}

/// A line from point to point.
#[derive(Clone, Debug, PartialEq)]
pub struct Path {
    /// Its points.
    pub points: Vec<[f32; 3]>,
    /// Its colour.
    pub paint: Paint,
    /// Whether it is of dashes.
    pub dashed: bool,
}

/// Words at a point.
#[derive(Clone, Debug, PartialEq)]
pub struct Label {
    /// The point.
    pub at: [f32; 3],
    /// The words.
    pub words: String,
}

/// One view. Boxes are drawn in their order, from the back to the front, then lines, then words.
#[derive(Clone, Debug, PartialEq)]
pub struct Panel {
    /// What it shows.
    pub title: String,
    /// The boxes.
    pub solids: Vec<Solid>,
    /// The lines.
    pub paths: Vec<Path>,
    /// The words.
    pub labels: Vec<Label>,
}

/// A figure of one view, or of two side by side.
#[derive(Clone, Debug, PartialEq)]
pub struct Space {
    /// The views.
    pub panels: Vec<Panel>,
    /// A line below them.
    pub note: String,
}

/// Where a point is drawn: how far to the right and up. The viewer stands where all coordinates are great; y is up, x
/// runs down to the right, z down to the left.
pub fn isometric(point: [f32; 3]) -> [f64; 2] {
    let [x, y, z] = point.map(f64::from);
    [0.75f64.sqrt() * (x - z), y - 0.5 * (x + z)]
}

/// The eight corners of a box; the bits of a corner's number say which axes are at their upper end.
pub fn corners(bounds: &Aabb) -> [[f32; 3]; 8] {
    std::array::from_fn(|corner| {
        std::array::from_fn(
            |axis| {
                if corner >> axis & 1 == 1 { bounds.hi[axis] } else { bounds.lo[axis] }
            },
        )
    })
}

/// The faces towards the viewer, each as a closed path of four corners.
pub const SEEN_FACES: [[usize; 4]; 3] = [[1, 3, 7, 5], [2, 3, 7, 6], [4, 5, 7, 6]];
/// The edges that these faces hide.
pub const HIDDEN_EDGES: [[usize; 2]; 3] = [[0, 1], [0, 2], [0, 4]];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn axes_are_a_third_of_a_turn_apart_and_equally_long() {
        let ends = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]].map(isometric);
        for (i, a) in ends.iter().enumerate() {
            assert!((a[0].hypot(a[1]) - 1.0).abs() < 1e-12, "{a:?}");
            let b = ends[(i + 1) % 3];
            assert!((a[0] * b[0] + a[1] * b[1] + 0.5).abs() < 1e-12, "{a:?} {b:?}");
        }
        // Towards the viewer nothing moves.
        assert!(isometric([1.0; 3]).iter().all(|x| x.abs() < 1e-12));
    }

    #[test]
    fn faces_are_those_of_the_upper_ends() {
        for (axis, face) in SEEN_FACES.iter().enumerate() {
            assert!(face.iter().all(|corner| corner >> axis & 1 == 1), "{face:?}");
            // Neighbours of a path differ in one axis.
            for i in 0..4 {
                assert_eq!((face[i] ^ face[(i + 1) % 4]).count_ones(), 1, "{face:?}");
            }
        }
    }
}
