//! The references of a tile that a plane crosses, cut: [`splitplane_core::triangle::clip`] for 16 at once.

use splitplane_core::aabb::{max, min};
use splitplane_core::arithmetic::Arithmetic;
use splitplane_core::triangle::{
    GREATEST_CLIPPED, LEAST_CLIPPED, OUTWARD, OUTWARD_LEAST, Triangle,
};

use super::columns::{Columns, Row};
use super::lanes::{Lanes, Places, WIDTH};

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
    crossing: Places,
}

/// 16 triangles and what their references hold of them on the two other axes.
struct Batch {
    /// By corner and axis: the plane's, the next, the one after it.
    corners: [[[f32; WIDTH]; 3]; 3],
    /// Lower and upper faces by other axis.
    faces: [[[f32; WIDTH]; 2]; 2],
}

/// What is known of the parts of 16 triangles.
struct Parts {
    /// Greatest magnitude of a coordinate.
    reach: [f32; WIDTH],
    /// Not 0 where an edge that crosses the plane extends too little across it.
    short: [u32; WIDTH],
    /// Bounds by side of the plane and other axis.
    least: [[[f32; WIDTH]; 2]; 2],
    most: [[[f32; WIDTH]; 2]; 2],
}

impl Parts {
    const EMPTY: Parts = Parts {
        reach: [0.0; WIDTH],
        short: [0; WIDTH],
        least: [[[f32::MAX; WIDTH]; 2]; 2],
        most: [[[-f32::MAX; WIDTH]; 2]; 2],
    };

    /// Adds the corner p and where the edge to q crosses the plane. One loop without loops or branches
    /// inside, so that vector instructions serve.
    #[cfg_attr(not(unoptimised), inline(always))]
    fn edge<A: Arithmetic>(&mut self, p: &[[f32; WIDTH]; 3], q: &[[f32; WIDTH]; 3], plane: f32) {
        let [[least_0, least_1], [least_2, least_3]] = &mut self.least;
        let [[most_0, most_1], [most_2, most_3]] = &mut self.most;
        for lane in 0..WIDTH {
            let (from, to) = (p[0][lane], q[0][lane]);
            // A corner in the plane belongs to both sides.
            let (left, right) = (from <= plane, from >= plane);
            let crosses = ((from < plane) & (plane < to)) | ((to < plane) & (plane < from));
            // From the lower end in both triangles of an edge, so that both compute the same point.
            let rising = from < to;
            let (low, high) = if rising { (from, to) } else { (to, from) };
            let across = A::snapped_difference(high, low);
            self.short[lane] |= u32::from(crosses & (across < LEAST_CLIPPED));
            let ratio = A::quotient(A::snapped_difference(plane, low), across);
            let (x, y) = (p[1][lane], p[2][lane]);
            let [x_below, x_above] = crossing::<A>(rising, crosses, ratio, x, q[1][lane]);
            let [y_below, y_above] = crossing::<A>(rising, crosses, ratio, y, q[2][lane]);
            least_0[lane] = min(min(least_0[lane], if left { x } else { f32::MAX }), x_below);
            least_1[lane] = min(min(least_1[lane], if left { y } else { f32::MAX }), y_below);
            least_2[lane] = min(min(least_2[lane], if right { x } else { f32::MAX }), x_below);
            least_3[lane] = min(min(least_3[lane], if right { y } else { f32::MAX }), y_below);
            most_0[lane] = max(max(most_0[lane], if left { x } else { -f32::MAX }), x_above);
            most_1[lane] = max(max(most_1[lane], if left { y } else { -f32::MAX }), y_above);
            most_2[lane] = max(max(most_2[lane], if right { x } else { -f32::MAX }), x_above);
            most_3[lane] = max(max(most_3[lane], if right { y } else { -f32::MAX }), y_above);
        }
    }
}

/// Where an edge from p to q, on another axis, crosses the plane at this part of its length from the lower end:
/// least and greatest, its error included. What widens no bounds where it does not cross.
#[cfg_attr(not(unoptimised), inline(always))]
fn crossing<A: Arithmetic>(rising: bool, crosses: bool, ratio: f32, p: f32, q: f32) -> [f32; 2] {
    let (low, high) = if rising { (p, q) } else { (q, p) };
    let along = A::snapped_difference(high, low);
    let point = A::snapped_sum(low, A::snapped_product(ratio, along));
    let reach = max(low.abs(), high.abs());
    let error = A::snapped_sum(A::snapped_product(reach, OUTWARD), OUTWARD_LEAST);
    let below = A::snapped_difference(point, error);
    let above = A::snapped_sum(point, error);
    if crosses { [below, above] } else { [f32::MAX, -f32::MAX] }
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
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn tile<A: Arithmetic, L: Lanes>(
        &mut self,
        columns: &Columns,
        first: usize,
        count: usize,
        triangles: Option<&[Triangle]>,
    ) {
        let (lo, hi) =
            (columns.face(self.axis, first, count), columns.face(3 + self.axis, first, count));
        let crossing = L::crossing(lo, hi, self.plane, &mut self.crossing);
        let mut batch = Batch { corners: [[[0.0; WIDTH]; 3]; 3], faces: [[[0.0; WIDTH]; 2]; 2] };
        let axes = [self.axis, (self.axis + 1) % 3, (self.axis + 2) % 3];
        let names = columns.triangles(first, count);
        for start in (0..crossing).step_by(WIDTH) {
            let live = (crossing - start).min(WIDTH);
            for (other, &axis) in axes[1..].iter().enumerate() {
                for end in 0..2 {
                    let face = columns.face(3 * end + axis, first, count);
                    for lane in 0..live {
                        batch.faces[other][end][lane] = face[self.crossing[start + lane] as usize];
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
    #[cfg_attr(not(unoptimised), inline(always))]
    fn batch<A: Arithmetic>(&mut self, batch: &Batch, start: usize) {
        let [a, b, c] = &batch.corners;
        let mut parts = Parts::EMPTY;
        for corner in [a, b, c] {
            for lane in 0..WIDTH {
                let reach = max(corner[0][lane].abs(), corner[1][lane].abs());
                parts.reach[lane] = max(parts.reach[lane], max(reach, corner[2][lane].abs()));
            }
        }
        parts.edge::<A>(a, b, self.plane);
        parts.edge::<A>(b, c, self.plane);
        parts.edge::<A>(c, a, self.plane);
        for side in 0..2 {
            let mut empty = [0u32; WIDTH];
            for other in 0..2 {
                let [lo, hi] = &batch.faces[other];
                let [low, high] = &mut self.faces[side][other];
                let low = &mut low[start..start + WIDTH];
                let high = &mut high[start..start + WIDTH];
                let (least, most) = (&parts.least[side][other], &parts.most[side][other]);
                for lane in 0..WIDTH {
                    // Whether the bounds stay what they are.
                    let stay = (parts.reach[lane] > GREATEST_CLIPPED) | (parts.short[lane] != 0);
                    let inner = [max(lo[lane], least[lane]), min(hi[lane], most[lane])];
                    let [l, h] = if stay { [lo[lane], hi[lane]] } else { inner };
                    low[lane] = l;
                    high[lane] = h;
                    empty[lane] |= u32::from(l > h);
                }
            }
            for (kept, empty) in self.kept[side][start..start + WIDTH].iter_mut().zip(empty) {
                *kept = if empty == 0 { u8::MAX } else { 0 };
            }
        }
    }

    /// Both parts of the crossing reference of this number, and whether there is anything in them.
    #[cfg_attr(not(unoptimised), inline(always))]
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
