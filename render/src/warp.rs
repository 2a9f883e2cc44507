//! Directions from pairs of random numbers, by `+ - * /` and square roots in a stated order: a device has the same bits.

use crate::vector::{Vector, add, dot, scaled};

pub(crate) const PI: f32 = core::f32::consts::PI;
pub(crate) const ONE_OVER_PI: f32 = core::f32::consts::FRAC_1_PI;

/// Sine and cosine of `x` times 45 degrees, `x` from -1 to 1: Taylor's polynomials to the ninth and tenth power, which err by less
/// than 3e-8 there, and by what four or five roundings add.
fn sin_cos(x: f32) -> [f32; 2] {
    let angle = x * (PI / 4.0);
    let square = angle * angle;
    let horner = |parts: [f32; 5]| {
        let [a, b, c, d, e] = parts;
        a + square * (b + square * (c + square * (d + square * e)))
    };
    let sine = angle * horner([1.0, -1.0 / 6.0, 1.0 / 120.0, -1.0 / 5040.0, 1.0 / 362_880.0]);
    let cosine = horner([1.0, -0.5, 1.0 / 24.0, -1.0 / 720.0, 1.0 / 40_320.0]);
    [sine, cosine]
}

/// Sine and cosine of so many full turns, within 2e-7.
pub(crate) fn turn(turns: f64) -> [f32; 2] {
    let eighths = turns * 8.0;
    let quadrant = (eighths * 0.5).round();
    let [sine, cosine] = sin_cos((eighths - 2.0 * quadrant) as f32);
    match (quadrant as i64).rem_euclid(4) {
        0 => [sine, cosine],
        1 => [cosine, -sine],
        2 => [-sine, -cosine],
        _ => [-cosine, sine],
    }
}

/// A point of the unit disk, evenly; squares become slices of rings (Shirley and Chiu 1997).
pub(crate) fn disk([u, v]: [f32; 2]) -> [f32; 2] {
    let (a, b) = (2.0 * u - 1.0, 2.0 * v - 1.0);
    if a == 0.0 && b == 0.0 {
        return [0.0; 2];
    }
    if a.abs() > b.abs() {
        let [sine, cosine] = sin_cos(b / a);
        [a * cosine, a * sine]
    } else {
        let [sine, cosine] = sin_cos(a / b);
        [b * sine, b * cosine]
    }
}

/// The root of what is left of 1 after two squares.
fn rest(x: f32, y: f32) -> f32 {
    let left = (1.0 - x * x) - y * y;
    if left > 0.0 { left.sqrt() } else { 0.0 }
}

/// A direction of the hemisphere around z, with the density cosine / pi (Malley).
pub(crate) fn hemisphere(numbers: [f32; 2]) -> Vector {
    let [x, y] = disk(numbers);
    [x, y, rest(x, y)]
}

/// A direction within a cone around z, evenly: Lambert's map of a disk on a cap, which keeps areas. `depth` is 1 less the cosine of the
/// cone's half angle, 2 for all directions; the density is 1 / (2 pi depth).
pub(crate) fn cap(numbers: [f32; 2], depth: f32) -> Vector {
    let [x, y] = disk(numbers);
    let z = 1.0 - (x * x + y * y) * depth;
    let factor = (depth * (1.0 + z)).sqrt();
    [x * factor, y * factor, z]
}

#[cfg(test)]
/// A direction, evenly, with the density 1 / (4 pi).
pub(crate) fn sphere(numbers: [f32; 2]) -> Vector {
    cap(numbers, 2.0)
}

/// Three directions at right angles, the third given (Duff et al. 2017).
#[derive(Clone, Copy)]
pub(crate) struct Basis {
    x: Vector,
    y: Vector,
    z: Vector,
}

impl Basis {
    /// Around a direction of length 1.
    pub(crate) fn around(z: Vector) -> Basis {
        let sign = if z[2] >= 0.0 { 1.0 } else { -1.0 };
        let a = -1.0 / (sign + z[2]);
        let b = (z[0] * z[1]) * a;
        Basis {
            x: [1.0 + (sign * a) * (z[0] * z[0]), sign * b, -sign * z[0]],
            y: [b, sign + a * (z[1] * z[1]), -z[1]],
            z,
        }
    }

    pub(crate) fn to_world(self, v: Vector) -> Vector {
        add(add(scaled(self.x, v[0]), scaled(self.y, v[1])), scaled(self.z, v[2]))
    }

    pub(crate) fn to_local(self, v: Vector) -> Vector {
        [dot(self.x, v), dot(self.y, v), dot(self.z, v)]
    }
}

/// Packs a direction of length 1 in two halves of 16 bits, by an octahedron folded flat (Meyer et al. 2010): it comes back within 1e-4.
pub(crate) fn packed(v: Vector) -> u32 {
    let sum = (v[0].abs() + v[1].abs()) + v[2].abs();
    let (mut x, mut y) = (v[0] / sum, v[1] / sum);
    if v[2] < 0.0 {
        (x, y) = (folded(x, y), folded(y, x));
    }
    let half = |x: f32| (x * 32_767.0 + 32_768.0) as u32;
    half(x) | (half(y) << 16)
}

/// See [`packed`]; the result has length 1 but for its rounding.
pub(crate) fn unpacked(word: u32) -> Vector {
    let part = |half: u32| (half as f32 - 32_767.5) / 32_767.0;
    let (x, y) = (part(word & 0xffff), part(word >> 16));
    let z = (1.0 - x.abs()) - y.abs();
    let v = if z < 0.0 { [folded(x, y), folded(y, x), z] } else { [x, y, z] };
    crate::vector::normalized(v)
}

fn folded(x: f32, y: f32) -> f32 {
    let part = 1.0 - y.abs();
    if x >= 0.0 { part } else { -part }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::pair;
    use crate::vector::{cross, length, sub};

    #[test]
    fn sines_and_cosines_are_near_those_of_the_platform() {
        for i in -1000..=1000 {
            let x = i as f32 / 1000.0;
            let angle = f64::from(x) * std::f64::consts::FRAC_PI_4;
            let [sine, cosine] = sin_cos(x);
            assert!((f64::from(sine) - angle.sin()).abs() < 2e-7, "{x}");
            assert!((f64::from(cosine) - angle.cos()).abs() < 2e-7, "{x}");
        }
    }

    #[test]
    fn turns_go_around() {
        for i in -3000..=3000 {
            let turns = f64::from(i) / 1000.0;
            let (want, [sine, cosine]) = ((turns * std::f64::consts::TAU).sin_cos(), turn(turns));
            assert!((f64::from(sine) - want.0).abs() < 2e-7, "{turns}");
            assert!((f64::from(cosine) - want.1).abs() < 2e-7, "{turns}");
        }
        assert_eq!([turn(0.0), turn(0.25), turn(0.5)], [[0.0, 1.0], [1.0, 0.0], [0.0, -1.0]]);
    }

    /// Moments of the distributions: of a cosine hemisphere z has the mean 2/3 and the mean square 1/2; of a sphere 0 and 1/3.
    #[test]
    fn directions_are_distributed_as_said() {
        let n = 1 << 16;
        let mut moments = [0.0f64; 6];
        for i in 0..n {
            let numbers = pair([1, 2, 3], i);
            let [x, y] = disk(numbers);
            let (up, any) = (hemisphere(numbers), sphere(numbers));
            assert!((length(up) - 1.0).abs() < 1e-6 && (length(any) - 1.0).abs() < 1e-6);
            let values =
                [x * x + y * y, up[2], up[2] * up[2], any[2], any[2] * any[2], any[0] * any[0]];
            for (moment, value) in moments.iter_mut().zip(values) {
                *moment += f64::from(value) / f64::from(n);
            }
        }
        for (got, want) in moments.into_iter().zip([0.5, 2.0 / 3.0, 0.5, 0.0, 1.0 / 3.0, 1.0 / 3.0])
        {
            assert!((got - want).abs() < 1e-3, "{moments:?}");
        }
    }

    #[test]
    fn bases_are_orthonormal_and_directions_come_back_from_words() {
        for i in 0..4096 {
            let z = sphere(pair([5, 5, 5], i));
            let basis = Basis::around(z);
            assert!(length(sub(cross(basis.x, basis.y), z)) < 1e-5);
            let v = sphere(pair([6, 6, 6], i));
            assert!(length(sub(basis.to_world(basis.to_local(v)), v)) < 1e-5);
            assert!(length(sub(unpacked(packed(v)), v)) < 1e-4);
        }
        for v in [[0.0, 0.0, 1.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0], [0.0, -1.0, 0.0]] {
            assert!(length(sub(unpacked(packed(v)), v)) < 1e-4, "{v:?}");
        }
    }
}
