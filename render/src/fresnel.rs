//! What a clear surface reflects and where it refracts to. Twin of `fresnel.wgsl`.

use crate::vector::{Vector, add, dot, scaled};

/// How light is divided at the boundary of two clear bodies.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Parting {
    /// Part that is reflected, 1 for total internal reflection.
    pub(crate) reflectance: f32,
    /// Cosine of the refracted ray to the normal; 0 when there is none.
    pub(crate) cosine: f32,
}

/// Fresnel's equations for unpolarised light. `cosine` is that of the incoming ray to the normal, 0 to
/// 1; `ratio` is the refractive index on its side over the one behind.
pub(crate) fn part(cosine: f32, ratio: f32) -> Parting {
    let sine_squared = (ratio * ratio) * (1.0 - cosine * cosine);
    if sine_squared >= 1.0 {
        return Parting { reflectance: 1.0, cosine: 0.0 };
    }
    let refracted = (1.0 - sine_squared).sqrt();
    let across = ratio * cosine;
    let along = ratio * refracted;
    // Perpendicular to the plane of incidence, and in it.
    let perpendicular = quotient_or_one(across - refracted, across + refracted);
    let parallel = quotient_or_one(cosine - along, cosine + along);
    let reflectance = (perpendicular * perpendicular + parallel * parallel) * 0.5;
    Parting { reflectance, cosine: refracted }
}

/// Both parts are 0 for a ray along the surface, which is reflected whole.
fn quotient_or_one(a: f32, b: f32) -> f32 {
    if b > 0.0 { a / b } else { 1.0 }
}

/// The mirrored direction; `cosine` is that of the reversed direction to the normal.
pub(crate) fn reflected(direction: Vector, normal: Vector, cosine: f32) -> Vector {
    add(direction, scaled(normal, 2.0 * cosine))
}

/// The refracted direction.
pub(crate) fn refracted(
    direction: Vector,
    normal: Vector,
    cosine: f32,
    ratio: f32,
    refracted_cosine: f32,
) -> Vector {
    let along_normal = ratio * cosine - refracted_cosine;
    add(scaled(direction, ratio), scaled(normal, along_normal))
}

/// Cosine between a ray's reversed direction and a normal on its side, within 0 to 1.
pub(crate) fn incidence(direction: Vector, normal: Vector) -> f32 {
    let cosine = -dot(direction, normal);
    let cosine = if cosine > 0.0 { cosine } else { 0.0 };
    if cosine < 1.0 { cosine } else { 1.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vector::normalized;

    #[test]
    fn head_on_glass_reflects_four_percent_from_both_sides() {
        for ratio in [1.0 / 1.5, 1.5] {
            assert!((part(1.0, ratio).reflectance - 0.04).abs() < 1e-6);
        }
        assert_eq!(part(0.6, 1.0).reflectance, 0.0);
        assert_eq!(part(0.0, 1.0).reflectance, 1.0);
    }

    /// At Brewster's angle, tan = n2/n1, nothing of the parallel part is reflected.
    #[test]
    fn brewsters_angle() {
        let n = 1.5f64;
        let (cosine, sine) = ((1.0 / (1.0 + n * n)).sqrt(), n / (1.0 + n * n).sqrt());
        let refracted = (1.0 - sine * sine / (n * n)).sqrt();
        let perpendicular = ((cosine - n * refracted) / (cosine + n * refracted)).powi(2);
        let expected = 0.5 * perpendicular;
        let got = f64::from(part(cosine as f32, 1.0 / 1.5).reflectance);
        assert!((got - expected).abs() < 1e-6, "{got} {expected}");
    }

    /// Stokes: the reflectance is the same along the path and back; beyond the critical angle it is 1.
    #[test]
    fn paths_are_reversible_and_the_critical_angle_is_kept() {
        for i in 1..100 {
            let cosine = i as f32 * 0.01;
            let there = part(cosine, 1.0 / 1.5);
            let back = part(there.cosine, 1.5);
            assert!((there.reflectance - back.reflectance).abs() < 1e-4, "{cosine}");
            assert!((back.cosine - cosine).abs() < 1e-4, "{cosine}");
            assert!((0.0..=1.0).contains(&there.reflectance));
        }
        let critical = (1.0f32 - 1.0 / (1.5 * 1.5)).sqrt();
        assert_eq!(part(critical - 1e-3, 1.5).reflectance, 1.0);
        assert!(part(critical + 1e-3, 1.5).reflectance < 1.0);
    }

    /// Snell: the sines are in the ratio of the indices, and all three directions lie in a plane.
    #[test]
    fn refraction_follows_snell() {
        let normal = [0.0, 1.0, 0.0];
        let direction = normalized([0.6, -0.8, 0.1]);
        let cosine = incidence(direction, normal);
        let parting = part(cosine, 1.0 / 1.5);
        let out = refracted(direction, normal, cosine, 1.0 / 1.5, parting.cosine);
        assert!((out[0] * 1.5 - direction[0]).abs() < 1e-6);
        assert!((out[2] * 1.5 - direction[2]).abs() < 1e-6);
        assert!((dot(out, out) - 1.0).abs() < 1e-6 && out[1] < 0.0);
    }

    /// A mirror of a mirror gives the direction back.
    #[test]
    fn mirrors_undo_one_another() {
        let normal = normalized([0.2, 1.0, -0.3]);
        let direction = normalized([0.6, -0.8, 0.1]);
        let once = reflected(direction, normal, -dot(direction, normal));
        let twice = reflected(once, normal, -dot(once, normal));
        for (a, b) in twice.into_iter().zip(direction) {
            assert!((a - b).abs() < 1e-6);
        }
    }
}
