//! Vectors of three floats. Every operation is one of `+ - * /` or a square root, in a fixed order, so
//! that a device that rounds each of them gives the same bits. Twin of `vector.wgsl`.

/// Three components: a point, a direction or a colour.
pub(crate) type Vector = [f32; 3];

#[inline]
pub(crate) fn add(a: Vector, b: Vector) -> Vector {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

#[inline]
pub(crate) fn sub(a: Vector, b: Vector) -> Vector {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

/// Component by component.
#[inline]
pub(crate) fn mul(a: Vector, b: Vector) -> Vector {
    [a[0] * b[0], a[1] * b[1], a[2] * b[2]]
}

#[inline]
pub(crate) fn scaled(a: Vector, factor: f32) -> Vector {
    [a[0] * factor, a[1] * factor, a[2] * factor]
}

#[inline]
pub(crate) fn negated(a: Vector) -> Vector {
    [-a[0], -a[1], -a[2]]
}

#[inline]
pub(crate) fn dot(a: Vector, b: Vector) -> f32 {
    (a[0] * b[0] + a[1] * b[1]) + a[2] * b[2]
}

#[inline]
pub(crate) fn cross(a: Vector, b: Vector) -> Vector {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// `a + (b - a) * part`.
#[inline]
pub(crate) fn mix(a: Vector, b: Vector, part: f32) -> Vector {
    add(a, scaled(sub(b, a), part))
}

/// The greatest component.
#[inline]
pub(crate) fn greatest(a: Vector) -> f32 {
    let most = if a[1] > a[0] { a[1] } else { a[0] };
    if a[2] > most { a[2] } else { most }
}

/// The greatest magnitude of a component.
#[inline]
pub(crate) fn reach(a: Vector) -> f32 {
    greatest(a.map(f32::abs))
}

/// floor(log2 |x|) of a normal number, -127 for zero and subnormals.
#[inline]
pub(crate) fn exponent(x: f32) -> i32 {
    ((x.to_bits() >> 23) & 0xff) as i32 - 127
}

/// The power of two with this exponent, clamped to -126..=127.
#[inline]
pub(crate) fn power_of_two(power: i32) -> f32 {
    f32::from_bits(((power.clamp(-126, 127) + 127) as u32) << 23)
}

/// The vector of length 1 in its direction; zero for zero. Squares neither overflow nor vanish: the
/// components are first brought near 1 by a power of two, which is exact.
#[inline]
pub(crate) fn normalized(a: Vector) -> Vector {
    let near_one = scaled(a, power_of_two(-exponent(reach(a))));
    let squared = dot(near_one, near_one);
    // The root and its inverse in any case, so that nothing branches.
    let inverse = 1.0 / squared.sqrt();
    near_one.map(|part| if squared > 0.0 { part * inverse } else { 0.0 })
}

/// The length, with the same care.
#[inline]
pub(crate) fn length(a: Vector) -> f32 {
    let power = exponent(reach(a));
    let near_one = scaled(a, power_of_two(-power));
    dot(near_one, near_one).sqrt() * power_of_two(power)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lengths_of_any_size() {
        for size in [1.0f32, 1e-30, 1e30] {
            let v = [2.0 * size, 3.0 * size, 6.0 * size];
            assert!((length(v) / size - 7.0).abs() < 1e-5, "{size}");
            let unit = normalized(v);
            assert!((dot(unit, unit) - 1.0).abs() < 1e-6, "{size}");
        }
        assert_eq!(normalized([0.0; 3]), [0.0; 3]);
        assert_eq!(length([0.0; 3]), 0.0);
    }
}
