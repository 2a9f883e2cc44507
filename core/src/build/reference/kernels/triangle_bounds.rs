use super::triangles_of;
use crate::aabb::Aabb;
use crate::layout::{ChunkBounds, Sides};
use crate::mesh::Mesh;
use crate::triangle::{Triangle, prepare};

/// Snaps the triangles of an input chunk and decides which are kept, see [`prepare`].
///
/// Writes the chunk's part of `Triangles`, corners of dropped triangles included. Writes the
/// chunk's `ChunkCounts`, triangles kept on the left and triangles snapped on the right, and its
/// `ChunkBounds`: the bounds of the triangles kept on the left, nothing on the right.
pub fn triangle_bounds(
    chunk: usize,
    mesh: &Mesh<'_>,
    triangles: &mut [Triangle],
) -> (Sides, ChunkBounds) {
    let mut counts = Sides::default();
    let mut bounds = Aabb::EMPTY;
    for (index, corners) in triangles_of(chunk, mesh.len()).zip(triangles) {
        let prepared = prepare(&mesh.triangle(index));
        *corners = prepared.corners;
        counts.right += u32::from(prepared.snapped);
        if prepared.kept {
            counts.left += 1;
            bounds = bounds.union(&Aabb::of_points(&prepared.corners));
        }
    }
    (counts, ChunkBounds { sides: [bounds, Aabb::EMPTY] })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// One triangle is kept, one snapped and kept, one dropped.
    #[test]
    fn counts_and_bounds() {
        let good = [[0.0, 0.0, 1.0], [1.0, 0.0, 1.0], [0.0, 1.0, 1.0]];
        let tiny = [[1e-40, 0.0, 2.0], [1.0, 0.0, 2.0], [0.0, 1.0, 2.0]];
        let bad = [[f32::NAN, 0.0, 9.0], [1.0, 0.0, 9.0], [0.0, 1.0, 9.0]];
        let soup = [good, tiny, bad];
        let mut triangles = [[[7.0; 3]; 3]; 3];
        let (counts, bounds) = triangle_bounds(0, &Mesh::soup(&soup).unwrap(), &mut triangles);
        assert_eq!(counts, Sides { left: 2, right: 1 });
        let held = Aabb { lo: [0.0, 0.0, 1.0], hi: [1.0, 1.0, 2.0] };
        assert_eq!(bounds.sides, [held, Aabb::EMPTY]);
        assert_eq!((triangles[0], triangles[1][0]), (good, [0.0, 0.0, 2.0]));
    }
}
