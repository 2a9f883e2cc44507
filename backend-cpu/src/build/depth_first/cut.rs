//! The references of a tile that a plane crosses, cut: [`splitplane_core::triangle::clip`] for 16 at once.

use splitplane_core::aabb::{max, min};
use splitplane_core::arithmetic::Arithmetic;
use splitplane_core::triangle::{
    GREATEST_CLIPPED, LEAST_CLIPPED, OUTWARD, OUTWARD_LEAST, Triangle,
};

use crate::simd::WIDTH;
use crate::simd::columns::Columns;
use crate::simd::references::{CutParts, ReferenceOps, TILE_ROOM, TilePlaces};

/// The references of a tile that a plane crosses, and their parts on either side.
#[derive(Debug)]
pub(crate) struct Cut {
    /// The parts.
    pub parts: CutParts,
    /// Which references: indices of the columns.
    crossing: TilePlaces,
}

/// 16 triangles and what their references hold of them on the two other axes.
struct TriangleBatch {
    /// By corner and axis: the plane's, the next, the one after it.
    corners: [[[f32; WIDTH]; 3]; 3],
    /// Lower and upper faces by other axis.
    faces: [[[f32; WIDTH]; 2]; 2],
}

/// What is known of the parts of 16 triangles.
struct PartBounds {
    /// Greatest magnitude of a coordinate.
    reach: [f32; WIDTH],
    /// Not 0 where an edge that crosses the plane extends too little across it.
    short: [u32; WIDTH],
    /// Bounds by side of the plane and other axis.
    least: [[[f32; WIDTH]; 2]; 2],
    most: [[[f32; WIDTH]; 2]; 2],
}

impl PartBounds {
    const EMPTY: PartBounds = PartBounds {
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
/// least and greatest, its error included. Where the edge does not cross, an interval that widens no bounds.
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
    pub(super) fn new() -> Cut {
        Cut { parts: CutParts::NONE, crossing: [0; TILE_ROOM] }
    }

    /// Cuts the references that the plane crosses, among `count` references from `first` (at most
    /// [`simd::references::TILE`](crate::simd::references::TILE)). Without triangles only their bounds are cut.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(super) fn tile<A: Arithmetic, S: ReferenceOps>(
        &mut self,
        columns: &Columns,
        first: usize,
        count: usize,
        triangles: Option<&[Triangle]>,
    ) {
        let (lo, hi) = (
            columns.face(self.parts.axis, first, count),
            columns.face(3 + self.parts.axis, first, count),
        );
        let crossing = S::crossing(lo, hi, self.parts.plane, &mut self.crossing);
        let mut batch =
            TriangleBatch { corners: [[[0.0; WIDTH]; 3]; 3], faces: [[[0.0; WIDTH]; 2]; 2] };
        let axes = [self.parts.axis, (self.parts.axis + 1) % 3, (self.parts.axis + 2) % 3];
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
                            self.parts.faces[side][other][end][start..start + WIDTH]
                                .copy_from_slice(&batch.faces[other][end]);
                        }
                    }
                    self.parts.kept[side][start..start + WIDTH].fill(u8::MAX);
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
    fn batch<A: Arithmetic>(&mut self, batch: &TriangleBatch, start: usize) {
        let [a, b, c] = &batch.corners;
        let mut parts = PartBounds::EMPTY;
        for corner in [a, b, c] {
            for lane in 0..WIDTH {
                let reach = max(corner[0][lane].abs(), corner[1][lane].abs());
                parts.reach[lane] = max(parts.reach[lane], max(reach, corner[2][lane].abs()));
            }
        }
        parts.edge::<A>(a, b, self.parts.plane);
        parts.edge::<A>(b, c, self.parts.plane);
        parts.edge::<A>(c, a, self.parts.plane);
        for side in 0..2 {
            let mut empty = [0u32; WIDTH];
            for other in 0..2 {
                let [lo, hi] = &batch.faces[other];
                let [low, high] = &mut self.parts.faces[side][other];
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
            for (kept, empty) in self.parts.kept[side][start..start + WIDTH].iter_mut().zip(empty) {
                *kept = if empty == 0 { u8::MAX } else { 0 };
            }
        }
    }
}

#[cfg(all(test, target_arch = "x86_64"))]
mod tests {
    use super::*;
    use crate::simd::InstructionSet;
    use crate::simd::columns::ReferenceRow;
    use crate::simd::every_set::for_every_set;
    use crate::simd::references::TILE;
    use splitplane_core::arithmetic::Strict;
    use splitplane_core::build::split::{goes_left, goes_right};
    use splitplane_test_support::random::Random;

    /// Numbers of a coarse grid, so that faces coincide and references are planar.
    struct Numbers(Random);

    impl Numbers {
        fn next(&mut self) -> f32 {
            self.0.below(256) as f32 / 16.0
        }
    }

    /// What a node of these references becomes: the left rows, then the right ones.
    fn divided<S: ReferenceOps>(
        references: &[ReferenceRow],
        triangles: Option<&[Triangle]>,
        axis: usize,
        plane: f32,
    ) -> [Vec<ReferenceRow>; 2] {
        let count = references.len();
        let right_first = count + WIDTH;
        let mut columns = Columns::default();
        columns.lengthen(right_first + count + TILE + WIDTH).expect("memory");
        for (i, row) in references.iter().enumerate() {
            columns.set(i, row);
        }
        let mut cut = Box::new(Cut::new());
        (cut.parts.axis, cut.parts.plane) = (axis, plane);
        let mut sides = [0; 2];
        for tile in (0..count).step_by(TILE) {
            let rows = TILE.min(count - tile);
            cut.tile::<Strict, S>(&columns, tile, rows, triangles);
            let to = right_first + sides[1];
            let more = S::divide(&mut columns, &cut.parts, tile, rows, sides[0], to);
            sides = [sides[0] + more[0], sides[1] + more[1]];
        }
        let rows = |first: usize, count: usize| (first..first + count).map(|i| columns.get(i));
        [rows(0, sides[0]).collect(), rows(right_first, sides[1]).collect()]
    }

    /// The same by core's functions, one reference after the other.
    fn by_core(
        references: &[ReferenceRow],
        triangles: Option<&[Triangle]>,
        axis: usize,
        plane: f32,
    ) -> [Vec<ReferenceRow>; 2] {
        use splitplane_core::aabb::Aabb;
        let mut sides = [vec![], vec![]];
        for row in references {
            let [lx, ly, lz, hx, hy, hz] = row.faces;
            let bounds = Aabb { lo: [lx, ly, lz], hi: [hx, hy, hz] };
            let mut parts = [bounds; 2];
            let mut goes = [
                goes_left(bounds.lo[axis], bounds.hi[axis], plane),
                goes_right(bounds.hi[axis], plane),
            ];
            if goes == [true; 2] {
                parts[0].hi[axis] = plane;
                parts[1].lo[axis] = plane;
                if let Some(triangles) = triangles {
                    let corners = &triangles[row.triangle as usize];
                    parts =
                        splitplane_core::triangle::clip::<Strict>(corners, &bounds, axis, plane);
                    goes = parts.map(|part| !part.is_empty());
                }
            }
            for side in 0..2 {
                if goes[side] {
                    let Aabb { lo: [lx, ly, lz], hi: [hx, hy, hz] } = parts[side];
                    let faces = [lx, ly, lz, hx, hy, hz];
                    sides[side].push(ReferenceRow { faces, triangle: row.triangle });
                }
            }
        }
        sides
    }

    for_every_set! {
        fn divide_by<S>(
            references: &[ReferenceRow],
            triangles: Option<&[Triangle]>,
            axis: usize,
            plane: f32,
        ) -> [Vec<ReferenceRow>; 2] {
            divided::<S>(references, triangles, axis, plane)
        }
    }

    /// References of triangles of all kinds, some of them clipped before, divided at ordinary and extreme
    /// scales by planes that cross many, few and none.
    #[test]
    fn divided_as_core_divides() {
        let mut numbers = Numbers(Random::new(5));
        let mut lost = 0;
        for scale in [1.0f32, 1e-36, 1e-30, 1e30, 2e37] {
            for count in [1, 15, 16, 17, 100, 1023, 1024, 1025, 2100] {
                let triangles: Vec<Triangle> = (0..count)
                    .map(|_| {
                        let centre = [(); 3].map(|()| numbers.next() * 2.0 - 16.0);
                        let size = if numbers.next() < 1.0 { 1.0 } else { 0.1 };
                        [(); 3]
                            .map(|()| centre.map(|x| (x + size * (numbers.next() - 8.0)) * scale))
                    })
                    .collect();
                let mut references: Vec<ReferenceRow> = (0u32..)
                    .zip(&triangles)
                    .map(|(triangle, corners)| {
                        let bounds = splitplane_core::aabb::Aabb::of_points(corners);
                        let ([lx, ly, lz], [hx, hy, hz]) = (bounds.lo, bounds.hi);
                        ReferenceRow { faces: [lx, ly, lz, hx, hy, hz], triangle }
                    })
                    .collect();
                for turn in 0..6 {
                    let (axis, clip) = (turn % 3, turn < 4 || count % 2 == 0);
                    let plane = match turn {
                        0 => references[count / 2].faces[axis],
                        1 => references[count / 3].faces[3 + axis],
                        _ => (numbers.next() - 8.0) * scale,
                    };
                    let corners = clip.then_some(&triangles[..]);
                    let expected = by_core(&references, corners, axis, plane);
                    for set in InstructionSet::available() {
                        let found = divide_by(set, &references, corners, axis, plane);
                        assert_eq!(found, expected, "{set:?} {scale} {count} {turn}");
                    }
                    let sides = expected.iter().map(Vec::len).sum::<usize>();
                    lost += references.len().saturating_sub(sides);
                    // On with the larger part, whose bounds are no longer those of the triangles.
                    let [left, right] = expected;
                    references = if left.len() > right.len() { left } else { right };
                    if references.is_empty() {
                        break;
                    }
                    let middle = references.len() / 2;
                    if turn > 2 {
                        // Bounds that hold more than the triangle, which clipping finds out.
                        references[middle].faces[3] += scale;
                    }
                }
            }
        }
        // A reference may go nowhere; it seldom does.
        assert!(lost < 100, "{lost}");
    }
}
