//! The unit in which a query measures on a device.

use splitplane_core::aabb::Aabb;

/// Exponents of units that a device may have: differences of coordinates neither overflow nor lose more than a quarter of a rounding to what is
/// below the least normal number.
const EXPONENTS: std::ops::RangeInclusive<i32> = -100..=120;

/// From farther away than this many sizes of a scene, a device cannot tell enough of its triangles apart: the host finds an answer sooner.
const FARTHEST: f64 = 16.0;

/// A unit for a query at a point: a power of two, such that nothing within `bounds` or `reach` of the point is 1 away along an axis, and something
/// is at least a half; by what lengths are multiplied. `None` where a device cannot measure in it, the scene is far away, or all is at the point itself.
pub(super) fn unit_at(point: [f32; 3], bounds: &Aabb, reach: f32) -> Option<f32> {
    let mut farthest = f64::from(reach);
    for axis in 0..3 {
        let at = f64::from(point[axis]);
        farthest =
            farthest.max(f64::from(bounds.hi[axis]) - at).max(at - f64::from(bounds.lo[axis]));
    }
    let extents = (0..3).map(|axis| f64::from(bounds.hi[axis]) - f64::from(bounds.lo[axis]));
    let extent = extents.fold(0.0, f64::max);
    // Of a normal number.
    let exponent = (farthest.to_bits() >> 52) as i32 - 1023;
    let may = farthest.is_finite() && EXPONENTS.contains(&exponent);
    (may && farthest <= FARTHEST * extent)
        .then(|| f32::from_bits(((127 - (exponent + 1)) as u32) << 23))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_unit_makes_the_farthest_a_half_at_least() {
        let bounds = |far: f32| Aabb { lo: [0.0; 3], hi: [far, 0.0, 0.0] };
        for far in [1e-30f32, 0.3, 1.0, 1.5, 7.0, 1e30] {
            let unit = unit_at([0.0; 3], &bounds(far), 0.0).expect("in range");
            assert!((0.5..1.0).contains(&(far * unit)), "{far} {unit}");
        }
        assert_eq!(unit_at([-9.0, 0.0, 0.0], &bounds(1.0), 0.0), Some(1.0 / 16.0));
        assert_eq!(unit_at([-1e3, 0.0, 0.0], &bounds(1.0), 0.0), None);
        assert_eq!(unit_at([0.0; 3], &bounds(1.0), 4.0), Some(0.125));
        for far in [0.0, 1e-31, 3e36, f32::MAX] {
            assert_eq!(unit_at([0.0; 3], &bounds(far), 0.0), None, "{far}");
        }
        assert_eq!(unit_at([f32::NAN; 3], &bounds(f32::INFINITY), 0.0), None);
    }
}
