//! The references of a tile that a plane crosses, cut: [`splitplane_core::triangle::clip`] for 16 at once.

use splitplane_core::aabb::{max, min};
use splitplane_core::arithmetic::Arithmetic;
use splitplane_core::triangle::{
    GREATEST_CLIPPED, LEAST_CLIPPED, OUTWARD, OUTWARD_LEAST, Triangle,
};

use super::columns::{Columns, Row};
use super::lanes::WIDTH;

/// References divided at a time: their cuts stay in cache.
pub(crate) const TILE: usize = 1024;
/// Room for whole stores behind them.
const ROOM: usize = TILE + WIDTH;

/// What is left on either side of the references of a tile that the plane crosses, one behind the other.
#[derive(Debug)]
pub(crate) struct Cut {
    /// Axis of the plane.
    pub axis: usize,
    /// Its position.
    pub plane: f32,
    /// Faces by side of the plane, by other axis (the next one, the one after it), lower and upper.
    pub faces: [[[[f32; ROOM]; 2]; 2]; 2],
    /// By side: all bits of a byte where something is left there, else none.
    pub kept: [[u8; ROOM]; 2],
    /// Which references: indices of the columns.
    crossing: [u32; ROOM],
}

/// 16 triangles and what their references hold of them on the two other axes.
struct Batch {
    /// By corner and axis: the plane's, the next, the one after it.
    corners: [[[f32; WIDTH]; 3]; 3],
    /// Lower and upper faces by other axis.
    faces: [[[f32; WIDTH]; 2]; 2],
}

impl Cut {
    /// Nothing cut yet.
    pub fn new() -> Cut {
        Cut {
            axis: 0,
            plane: 0.0,
            faces: [[[[0.0; ROOM]; 2]; 2]; 2],
            kept: [[0; ROOM]; 2],
            crossing: [0; ROOM],
        }
    }

    /// Cuts what the plane crosses among `count` references from `first`, at most [`TILE`]. Without
    /// triangles bounds are cut alone.
    #[inline(always)]
    pub fn tile<A: Arithmetic>(
        &mut self,
        columns: &Columns,
        first: usize,
        count: usize,
        triangles: Option<&[Triangle]>,
    ) {
        let (lo, hi) =
            (columns.face(self.axis, first, count), columns.face(3 + self.axis, first, count));
        let mut crossing = 0;
        for (i, (&lo, &hi)) in lo.iter().zip(hi).enumerate() {
            self.crossing[crossing & (TILE - 1)] = i as u32;
            crossing += usize::from((lo < self.plane) & (self.plane < hi));
        }
        let mut batch = Batch { corners: [[[0.0; WIDTH]; 3]; 3], faces: [[[0.0; WIDTH]; 2]; 2] };
        let axes = [self.axis, (self.axis + 1) % 3, (self.axis + 2) % 3];
        let names = columns.triangles(first, count);
        for start in (0..crossing).step_by(WIDTH) {
            let live = (crossing - start).min(WIDTH);
            for (other, &axis) in axes[1..].iter().enumerate() {
                for end in 0..2 {
                    let face = columns.face(3 * end + axis, first, count);
                    for lane in 0..live {
                        batch.faces[other][end][lane] =
                            face[self.crossing[start + lane] as usize];
                    }
                }
            }
            let Some(triangles) = triangles else {
                for side in 0..2 {
                    for other in 0..2 {
                        for end in 0..2 {
                            self.faces[side][other][end][start..start + WIDTH]
                                .copy_from_slice(&batch.faces[other][end]);
                        }
                    }
                    self.kept[side][start..start + WIDTH].fill(u8::MAX);
                }
                continue;
            };
            for lane in 0..live {
                let triangle = &triangles[names[self.crossing[start + lane] as usize] as usize];
                for corner in 0..3 {
                    for (k, &axis) in axes.iter().enumerate() {
                        batch.corners[corner][k][lane] = triangle[corner][axis];
                    }
                }
            }
            self.batch::<A>(&batch, start);
        }
    }

    /// Cuts 16: the operations of [`splitplane_core::triangle::clip`] in their order, without branches.
    #[inline(always)]
    fn batch<A: Arithmetic>(&mut self, batch: &Batch, start: usize) {
        let plane = self.plane;
        let mut faces = [[[[0.0f32; WIDTH]; 2]; 2]; 2];
        let mut kept = [[0u8; WIDTH]; 2];
        for lane in 0..WIDTH {
            let at = |corner: usize, k: usize| batch.corners[corner % 3][k][lane];
            let mut reach = 0.0;
            for corner in 0..3 {
                for k in 0..3 {
                    reach = max(reach, at(corner, k).abs());
                }
            }
            // Whether the bounds stay what they are.
            let mut stay = reach > GREATEST_CLIPPED;
            let mut least = [[f32::MAX; 2]; 2];
            let mut most = [[-f32::MAX; 2]; 2];
            for corner in 0..3 {
                let (p, q) = (at(corner, 0), at(corner + 1, 0));
                let inside = [p <= plane, p >= plane];
                for side in 0..2 {
                    for other in 0..2 {
                        let x = at(corner, 1 + other);
                        let (low, high) = if inside[side] { (x, x) } else { (f32::MAX, -f32::MAX) };
                        least[side][other] = min(least[side][other], low);
                        most[side][other] = max(most[side][other], high);
                    }
                }
                let crosses = ((p < plane) & (plane < q)) | ((q < plane) & (plane < p));
                let rising = p < q;
                let (low, high) = if rising { (p, q) } else { (q, p) };
                let across = A::snapped_difference(high, low);
                stay |= crosses & (across < LEAST_CLIPPED);
                let ratio = A::quotient(A::snapped_difference(plane, low), across);
                for other in 0..2 {
                    let (p, q) = (at(corner, 1 + other), at(corner + 1, 1 + other));
                    let (low, high) = if rising { (p, q) } else { (q, p) };
                    let along = A::snapped_difference(high, low);
                    let point = A::snapped_sum(low, A::snapped_product(ratio, along));
                    let reach = max(low.abs(), high.abs());
                    let error = A::snapped_sum(A::snapped_product(reach, OUTWARD), OUTWARD_LEAST);
                    let below = A::snapped_difference(point, error);
                    let above = A::snapped_sum(point, error);
                    let (below, above) =
                        if crosses { (below, above) } else { (f32::MAX, -f32::MAX) };
                    for side in 0..2 {
                        least[side][other] = min(least[side][other], below);
                        most[side][other] = max(most[side][other], above);
                    }
                }
            }
            for side in 0..2 {
                let mut empty = false;
                for other in 0..2 {
                    let [lo, hi] = [batch.faces[other][0][lane], batch.faces[other][1][lane]];
                    let low = if stay { lo } else { max(lo, least[side][other]) };
                    let high = if stay { hi } else { min(hi, most[side][other]) };
                    faces[side][other][0][lane] = low;
                    faces[side][other][1][lane] = high;
                    empty |= low > high;
                }
                kept[side][lane] = if empty { 0 } else { u8::MAX };
            }
        }
        for side in 0..2 {
            for other in 0..2 {
                for end in 0..2 {
                    self.faces[side][other][end][start..start + WIDTH]
                        .copy_from_slice(&faces[side][other][end]);
                }
            }
            self.kept[side][start..start + WIDTH].copy_from_slice(&kept[side]);
        }
    }

    /// Both parts of the crossing reference of this number, and whether there is anything in them.
    #[inline(always)]
    pub fn parts(&self, reference: &Row, number: usize) -> [(Row, bool); 2] {
        let others = [(self.axis + 1) % 3, (self.axis + 2) % 3];
        let mut parts = [(*reference, true); 2];
        parts[0].0.faces[3 + self.axis] = self.plane;
        parts[1].0.faces[self.axis] = self.plane;
        for (side, (part, kept)) in parts.iter_mut().enumerate() {
            for (other, axis) in others.into_iter().enumerate() {
                for end in 0..2 {
                    part.faces[3 * end + axis] = self.faces[side][other][end][number];
                }
            }
            *kept = self.kept[side][number] != 0;
        }
        parts
    }
}
