//! The part of a ray that lies in a box: the slab method (Kay and Kajiya 1986).

use crate::aabb::Aabb;
use crate::ray::Ray;

/// Ends of an interval are computed in `f64` from exact coordinates, by a subtraction and a division. So they
/// are off by two roundings, 2^-52 of their size, and moved outwards by twice that.
const OUTWARDS: f64 = 1.0 / (1u64 << 51) as f64;

impl Aabb {
    /// Where a ray is inside the box: from which `t` to which, within the ray's own limits and both included.
    /// `None` where it misses the box, and for a ray that hits nothing or a box that holds nothing.
    ///
    /// Components of the direction below the least normal number, 2^-126, count as 0. Otherwise the interval is never too
    /// short: a ray that meets the box in exact arithmetic, be it in a corner, along an edge or within a face, is never `None`, and its
    /// interval holds the exact one. It is too long by at most two units in the last place of each end. A ray that misses the box by less than a part in 2^50 of
    /// the distance may count as meeting it.
    ///
    /// Traversal does not call this: [`query::traverse`](crate::query::traverse) has each node's interval from its parent's.
    ///
    /// ```
    /// use splitplane_core::{aabb::Aabb, ray::Ray};
    ///
    /// let bounds = Aabb { lo: [1.0, 0.0, 0.0], hi: [3.0, 1.0, 1.0] };
    /// let ray = Ray::new([0.0, 0.5, 0.5], [1.0, 0.0, 0.0]);
    /// let (enter, exit) = bounds.ray_interval(&ray).expect("it meets the box");
    /// assert!((0.999_999..=1.0).contains(&enter) && (3.0..3.000_001).contains(&exit));
    /// assert_eq!(bounds.ray_interval(&ray.with_limits(4.0, 5.0)), None);
    /// ```
    pub fn ray_interval(&self, ray: &Ray) -> Option<(f32, f32)> {
        let (mut enter, mut exit) = (f64::from(ray.t_min), f64::from(ray.t_max));
        let numbers = ray.origin.iter().chain(&ray.direction);
        let mut moves = false;
        if numbers.into_iter().any(|x| !x.is_finite()) || self.is_empty() {
            return None;
        }
        for axis in 0..3 {
            let [lo, hi, origin, direction] =
                [self.lo[axis], self.hi[axis], ray.origin[axis], ray.direction[axis]];
            // As for triangles, components below the least normal number count as 0.
            if direction.abs() < f32::MIN_POSITIVE {
                if !(lo <= origin && origin <= hi) {
                    return None;
                }
                continue;
            }
            moves = true;
            let [lo, hi, origin, direction] = [lo, hi, origin, direction].map(f64::from);
            let ends = [(lo - origin) / direction, (hi - origin) / direction];
            let [near, far] = if direction > 0.0 { ends } else { [ends[1], ends[0]] };
            // A NaN of the box affects no comparison, so it is checked for.
            if near.is_nan() || far.is_nan() {
                return None;
            }
            // Not beyond the limits, nor beyond what another axis allows: `enter` and `exit` are let out already.
            enter = if near > enter { (near - near.abs() * OUTWARDS).max(enter) } else { enter };
            exit = if far < exit { (far + far.abs() * OUTWARDS).min(exit) } else { exit };
        }
        // Not `enter > exit`: a limit may be NaN.
        (moves && enter <= exit).then(|| (below(enter), above(exit)))
    }
}

/// The greatest `f32` that is not above.
fn below(x: f64) -> f32 {
    let near = x as f32;
    if f64::from(near) > x { near.next_down() } else { near }
}

/// The least `f32` that is not below.
fn above(x: f64) -> f32 {
    let near = x as f32;
    if f64::from(near) < x { near.next_up() } else { near }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A fraction of whole numbers, its denominator above 0.
    #[derive(Clone, Copy, Debug)]
    struct Fraction(i64, i64);

    impl Fraction {
        fn of(n: i64, d: i64) -> Fraction {
            if d < 0 { Fraction(-n, -d) } else { Fraction(n, d) }
        }

        fn less(self, other: Fraction) -> bool {
            i128::from(self.0) * i128::from(other.1) < i128::from(other.0) * i128::from(self.1)
        }

        fn float(self) -> f64 {
            self.0 as f64 / self.1 as f64
        }
    }

    /// The exact interval of whole numbers, without limits above.
    fn exact(lo: [i64; 3], hi: [i64; 3], o: [i64; 3], d: [i64; 3]) -> Option<(Fraction, Fraction)> {
        let (mut enter, mut exit) = (Fraction(0, 1), Fraction(1 << 40, 1));
        for axis in 0..3 {
            if d[axis] == 0 {
                if o[axis] < lo[axis] || hi[axis] < o[axis] {
                    return None;
                }
                continue;
            }
            let ends = [lo[axis], hi[axis]].map(|end| Fraction::of(end - o[axis], d[axis]));
            let [near, far] = if ends[1].less(ends[0]) { [ends[1], ends[0]] } else { ends };
            enter = if enter.less(near) { near } else { enter };
            exit = if far.less(exit) { far } else { exit };
        }
        (!exit.less(enter)).then_some((enter, exit))
    }

    /// Ends are moved outwards, but not beyond the ray's own limits.
    #[test]
    fn intervals_keep_to_the_limits() {
        let bounds = Aabb { lo: [1.0, 0.0, 0.0], hi: [3.0, 1.0, 1.0] };
        let nudge = f32::EPSILON * f32::EPSILON;
        let ray = Ray::new([-nudge, 0.5, 0.5], [1.0, 0.0, 0.0]).with_limits(1.0, 2.0);
        assert_eq!(bounds.ray_interval(&ray), Some((1.0, 2.0)));
        let ray = Ray::new([nudge, 0.5, 0.5], [1.0, 0.0, 0.0]).with_limits(0.0, 3.0);
        assert_eq!(bounds.ray_interval(&ray).map(|(_, exit)| exit), Some(3.0));
    }

    /// Against fractions: small whole numbers, of which many rays run in faces, along edges and through corners.
    #[test]
    fn intervals_hold_the_exact_ones_and_little_more() {
        let mut state = 1u64;
        let mut next = |count: u64| {
            state = state.wrapping_mul(0x5851_f42d_4c95_7f2d).wrapping_add(0x1405_7b7e_f767_814f);
            ((state >> 33) % count) as i64
        };
        let (mut met, mut touched) = (0, 0);
        for _ in 0..300_000 {
            let mut point = |most: u64| [0; 3].map(|_| next(2 * most + 1) - most as i64);
            let (a, b, o, d) = (point(4), point(4), point(6), point(3));
            let lo: [i64; 3] = core::array::from_fn(|i| a[i].min(b[i]));
            let hi: [i64; 3] = core::array::from_fn(|i| a[i].max(b[i]));
            let float = |x: [i64; 3]| x.map(|x| x as f32);
            let bounds = Aabb { lo: float(lo), hi: float(hi) };
            let ray = Ray::new(float(o), float(d)).with_limits(0.0, (1u64 << 40) as f32);
            let found = bounds.ray_interval(&ray);
            match exact(lo, hi, o, d).filter(|_| d != [0; 3]) {
                None => assert_eq!(found, None, "{bounds:?} {ray:?}"),
                Some((enter, exit)) => {
                    let (first, last) = found.unwrap_or_else(|| panic!("{bounds:?} {ray:?}"));
                    met += 1;
                    touched += u32::from(!enter.less(exit));
                    let (enter, exit) = (enter.float(), exit.float());
                    assert!(f64::from(first) <= enter && exit <= f64::from(last));
                    assert!(f64::from(first.next_up().next_up()) >= enter, "{first} {enter}");
                    assert!(f64::from(last.next_down().next_down()) <= exit, "{last} {exit}");
                }
            }
        }
        assert!(met > 20_000 && touched > 2_000, "{met} {touched}");
    }

    /// A ray that meets a box in one point of an edge, at 2^60 + 96. One end rounds up, the other down.
    #[test]
    fn ends_that_round_apart_still_meet() {
        let far = (1u64 << 60) as f32;
        let bounds = Aabb { lo: [288.0, -1000.0, 0.0], hi: [1000.0, 96.0, 1.0] };
        let ray = Ray::new([-3.0 * far, -far, 0.5], [3.0, 1.0, 0.0]);
        let (enter, exit) = bounds.ray_interval(&ray).expect("it meets the edge");
        assert!(enter <= far && far < exit);
    }

    #[test]
    fn the_ends_of_the_floats() {
        let unit = Aabb { lo: [0.0; 3], hi: [1.0; 3] };
        let along = |x: f32, d: f32| Ray::new([x, 0.5, 0.5], [d, 0.0, -0.0]);
        // In a face, from the plane of a face, and from outside it, whatever the sign of the zeros.
        assert!(unit.ray_interval(&Ray::new([-1.0, 0.0, 1.0], [1.0, -0.0, 0.0])).is_some());
        assert_eq!(unit.ray_interval(&Ray::new([-1.0, -1e-30, 1.0], [1.0, -0.0, 0.0])), None);
        let (enter, exit) = unit.ray_interval(&along(0.0, 1.0)).unwrap();
        assert!(enter == 0.0 && (1.0..1.000_001).contains(&exit));
        // Behind, and from the end on.
        assert_eq!(unit.ray_interval(&along(2.0, 1.0)), None);
        assert!(unit.ray_interval(&along(1.0, 1.0)).is_some());
        let limited = |lo, hi| unit.ray_interval(&along(-1.0, 1.0).with_limits(lo, hi));
        assert_eq!(limited(0.0, 0.5), None);
        assert!(limited(0.0, 1.0).is_some() && limited(2.0, f32::INFINITY).is_some());
        assert_eq!(limited(2.5, f32::INFINITY), None);
        assert_eq!(
            (limited(3.0, 1.0), limited(f32::NAN, 9.0), limited(0.0, f32::NAN)),
            (None, None, None)
        );
        // Components that count as 0, and rays that hit nothing.
        let subnormal = f32::from_bits(1);
        assert_eq!(unit.ray_interval(&along(0.5, subnormal)), None, "it does not move");
        let slow = Ray::new([-1.0, 0.5, 0.5], [1.0, subnormal, 0.0]);
        assert!(unit.ray_interval(&slow).is_some());
        for bad in [f32::NAN, f32::INFINITY] {
            assert_eq!(unit.ray_interval(&along(bad, 1.0)), None);
            assert_eq!(unit.ray_interval(&along(0.5, bad)), None);
        }
        assert_eq!(Aabb::EMPTY.ray_interval(&along(0.5, 1.0)), None);
        let broken = Aabb { lo: [f32::NAN, 0.0, 0.0], hi: [1.0; 3] };
        assert_eq!(broken.ray_interval(&along(-1.0, 1.0)), None);
        // Boxes as wide as floats go, and rays as slow.
        let all = Aabb { lo: [-f32::MAX; 3], hi: [f32::MAX; 3] };
        let (enter, exit) = all.ray_interval(&along(0.0, f32::MIN_POSITIVE)).unwrap();
        assert_eq!((enter, exit), (0.0, f32::INFINITY));
        let thin = Aabb { lo: [1e-45, 0.0, 0.0], hi: [1e-45, 1.0, 1.0] };
        assert!(thin.ray_interval(&Ray::new([3e38, 0.5, 0.5], [-3e38, 0.0, 0.0])).is_some());
    }
}
