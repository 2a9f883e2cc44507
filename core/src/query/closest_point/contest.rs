//! The nearest triangle in real arithmetic.
//!
//! What is certain of a triangle's distance is a range. The upper end is the distance of a computed point that is on the triangle but for its rounding. The
//! lower end: let x be that point as seen from the given one, and c the corner for which x c is least. All of the triangle is on the far side of the plane
//! across x through c, so it is no nearer than x c / |x|. Where ranges overlap, whole numbers decide ([`exact`](crate::exact)).
//!
//! *Errors.* With u and R as in [`closest_point`](super), corners seen from the point err by u R on each axis, x c by 7 u R |x| together with its own roundings, and
//! the quotient by as much again: 15 u R. The upper end errs by 20 u R. Both are within the half of [`slack`](super::slack), 32 u R. In a scene corners err by
//! 6 u S in space before, and the slack is 64 u (R + S).

use core::cmp::Ordering;

use super::{ClosestPoint, Vector, dot, nearest};
use crate::arithmetic::sqrt;
use crate::exact::foot::{Foot, Matrix};
use crate::triangle::Triangle;

/// A triangle that may be the nearest; `key` decides between equal distances.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Contender<K> {
    /// The distance is at least this.
    low: f64,
    /// The distance is at most this.
    high: f64,
    corners: Triangle,
    transform: Option<Matrix>,
    /// Its closest point, once that was needed.
    foot: Option<Foot>,
    key: K,
}

impl<K> Contender<K> {
    /// A triangle, of its object if there is a transform, whose corners are about these as the point sees it; and the point of it that is the closest as computed.
    /// `slack` is twice what the distance may err by.
    pub(crate) fn new(
        point: [f64; 3],
        about: [[f64; 3]; 3],
        slack: f64,
        (corners, transform): (&Triangle, Option<&Matrix>),
        key: K,
    ) -> (Contender<K>, ClosestPoint) {
        let (found, to) = nearest(point, about);
        let (low, high) = range(point, about, to, found.distance_squared, slack);
        let (corners, transform) = (*corners, transform.copied());
        (Contender { low, high, corners, transform, foot: None, key }, found)
    }

    fn foot(&mut self, point: &[f32; 3]) -> Foot {
        let Contender { corners, transform, .. } = self;
        *self.foot.get_or_insert_with(|| Foot::of(point, corners, transform.as_ref()))
    }
}

/// What is certain of a distance.
fn range(point: Vector, corners: [Vector; 3], to: Vector, squared: f64, slack: f64) -> (f64, f64) {
    let (distance, error) = (sqrt(squared), 0.5 * slack);
    let along = corners
        .map(|corner| dot(to, [corner[0] - point[0], corner[1] - point[1], corner[2] - point[2]]));
    let least = along[0].min(along[1]).min(along[2]);
    // Of a square that is nearly nothing, roundings are not known.
    let low = if squared > 1e-280 { (least / distance - error).max(0.0) } else { 0.0 };
    (low, distance + error)
}

/// Who is nearest to a point.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Contest<K> {
    point: [f32; 3],
    limit: f32,
    best: Option<Contender<K>>,
}

impl<K: Ord + Copy> Contest<K> {
    /// At a point of floats, snapped, between triangles within a distance that is at least 0.
    pub(crate) fn new(point: [f32; 3], limit: f32) -> Contest<K> {
        Contest { point, limit, best: None }
    }

    /// Whether this triangle is the nearest one so far.
    pub(crate) fn enter(&mut self, mut new: Contender<K>) -> bool {
        let (point, limit) = (&self.point, f64::from(self.limit));
        if new.low > limit || (new.high > limit && !new.foot(point).is_within(point, self.limit)) {
            return false;
        }
        let is_better = self.best.as_mut().is_none_or(|best| {
            let order = if new.high < best.low {
                Ordering::Less
            } else if new.low > best.high {
                Ordering::Greater
            } else {
                new.foot(point).compare(&best.foot(point), point)
            };
            order.then(new.key.cmp(&best.key)).is_lt()
        });
        if is_better {
            self.best = Some(new);
        }
        is_better
    }

    /// The square of a distance that the nearest triangle so far is certainly within; infinity where there is none.
    pub(crate) fn farthest_squared(&self) -> f64 {
        self.best.map_or(f64::INFINITY, |best| best.high * best.high * (1.0 + 1e-12))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random;

    /// Triangles that are about as far from the origin, by less than `f64` tells apart.
    fn alike(seed: u64) -> [Triangle; 6] {
        let number =
            |what: &[u64]| (random::hash(seed, what) as u32 >> 8) as f32 / 8_388_608.0 - 1.0;
        core::array::from_fn(|i| {
            let turn = i % 3;
            core::array::from_fn(|corner| {
                let own: [f32; 3] =
                    core::array::from_fn(|axis| number(&[corner as u64, axis as u64]));
                // The same triangle with its axes exchanged, now and then a float further along one.
                let mut turned: [f32; 3] = core::array::from_fn(|axis| own[(axis + turn) % 3]);
                if i >= 3 && corner == i - 3 {
                    turned[i % 3] = turned[i % 3].next_up();
                }
                turned
            })
        })
    }

    fn winner(triangles: &[Triangle], slack: f64) -> u32 {
        let mut contest = Contest::new([0.0; 3], f32::INFINITY);
        let mut winner = u32::MAX;
        // The least index comes last, so that ties change who is the best.
        for (index, triangle) in triangles.iter().enumerate().rev() {
            let index = index as u32;
            let about = triangle.map(|corner| corner.map(f64::from));
            let own = Contender::new([0.0; 3], about, slack, (triangle, None), index).0;
            if contest.enter(own) {
                winner = index;
            }
        }
        winner
    }

    fn truly(triangles: &[Triangle]) -> u32 {
        let feet = triangles.iter().map(|own| Foot::of(&[0.0; 3], own, None));
        let best = (0..)
            .zip(feet)
            .reduce(|best, own| if own.1.compare(&best.1, &[0.0; 3]).is_lt() { own } else { best });
        best.map_or(u32::MAX, |best| best.0)
    }

    /// Without the slack the ranges of some do not hold their distances, and the answer is another one.
    #[test]
    fn ranges_need_their_slack() {
        let mut wrong = 0;
        for seed in 0..8_000 {
            let triangles = alike(seed);
            let expected = truly(&triangles);
            assert_eq!(winner(&triangles, 64.0 * f64::EPSILON / 2.0), expected, "{seed}");
            wrong += usize::from(winner(&triangles, 0.0) != expected);
        }
        assert!(wrong > 3, "{wrong}");
    }
}
