//! Light from the density of photons: the power of those nearest to a point, over the area of the disk that holds them.
//!
//! *The disk* reaches to the k-th nearest photon, or as far as [`REACH`] allows, and that photon is left out: where photons lie evenly, the
//! mean of what the others bring over that disk is then what it should be. It shrinks from pass to pass (Knaus and Zwicker 2011): only
//! photons within the part [`shrink`] of its radius count, over the smaller disk. So the error of uneven light goes to zero with the number of
//! passes, and so does the noise of their mean, since disks shrink more slowly than passes are made.
//!
//! *The order of sums* is that of (distance, number of the photon); so a picture depends on nothing but seed and settings.

use super::bounce::Photon;
use crate::layout::{Frame, Surface};
use crate::planted::{Fault, is_planted};
use crate::vector::{Vector, add, dot, scaled};
use crate::warp::{ONE_OVER_PI, unpacked};
use splitplane_core::points::nearest::Neighbour;

/// The greatest radius of a disk, as a part of that of the ball around all that is shown.
pub(super) const REACH: f32 = 1.0 / 16.0;

/// How slowly disks shrink: 1 for not at all, 0 for as fast as would leave noise as it is.
const ALPHA: f32 = 2.0 / 3.0;

/// Least cosine of the normals of a photon's triangle and that of the point that it lights.
const SAME_SIDE: f32 = 0.5;

/// The part of the radius of the first pass that disks have in a pass, from 0: the root of the product of `(i + ALPHA) / (i + 1)`
/// for all passes before, i from 1.
pub(super) fn shrink(pass: u32) -> f32 {
    let mut square = 1.0f32;
    for i in 1..=pass {
        square *= (i as f32 + ALPHA) / (i as f32 + 1.0);
    }
    square.sqrt()
}

/// The disks of a pass.
#[derive(Clone, Copy, Debug)]
pub(super) struct Disks {
    /// Where no photon is looked for.
    pub(super) reach: f32,
    /// [`shrink`].
    pub(super) part: f32,
    /// The unit of lengths is two to this.
    pub(super) power: i32,
}

/// The irradiance of a surface by the photons that were found near it, `found` in order, over pi.
pub(super) fn irradiance(
    frame: &Frame,
    surface: &Surface,
    photons: &[Photon],
    found: &[Neighbour],
    disks: Disks,
) -> Vector {
    let count = found.iter().take_while(|neighbour| neighbour.is_some()).count();
    let (radius, count) = match found.last() {
        // Beyond the reach it does not matter where the k-th is.
        Some(last) if last.is_some() => (last.distance_squared.sqrt(), count - 1),
        _ => (f64::from(disks.reach), count),
    };
    let radius = radius * f64::from(disks.part);
    let mut sum = [0.0; 3];
    for neighbour in &found[..count] {
        if neighbour.distance_squared > radius * radius {
            break;
        }
        let photon = &photons[neighbour.point as usize];
        if dot(unpacked(photon.normal), surface.geometric_normal) > SAME_SIDE {
            sum = add(sum, photon.power);
        }
    }
    let inverse = (two_to(disks.power) / radius) as f32;
    let area = if is_planted(frame, Fault::SquareDisks) { 0.25 } else { ONE_OVER_PI };
    let light = scaled(scaled(scaled(sum, inverse), inverse), area * ONE_OVER_PI);
    // All photons in one point have no density.
    if light.iter().all(|part| part.is_finite()) { light } else { [0.0; 3] }
}

/// Two to a power that is an exponent of an `f32`.
fn two_to(power: i32) -> f64 {
    f64::from_bits(((power + 1023) as u64) << 52)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn disks_shrink_to_nothing_and_passes_gain_on_them() {
        assert_eq!(shrink(0), 1.0);
        let squares = [10u32, 100, 1000, 10_000].map(|pass| shrink(pass).powi(2));
        for (few, many) in squares.iter().zip(&squares[1..]) {
            // A third of a power of ten for each.
            assert!((many / few - 0.464).abs() < 0.02, "{squares:?}");
        }
    }

    /// Over photons that lie evenly the estimate has the right mean, whatever the disk is bounded by.
    #[test]
    fn the_mean_over_even_photons_is_right() {
        let frame = Frame::default();
        let surface = Surface { geometric_normal: [0.0, 0.0, 1.0], ..Surface::default() };
        let normal = crate::warp::packed([0.0, 0.0, 1.0]);
        for (k, part) in [(8, 1.0), (16, 1.0), (16, 0.6), (400, 1.0)] {
            let (mut sum, tries) = (0.0, 2000u32);
            for try_ in 0..tries {
                // 100 photons of power 1/100 in the square from -1 to 1: an irradiance of 1/4.
                let photons = [Photon { power: [0.01; 3], normal }; 100];
                let mut found: Vec<Neighbour> = (0..100)
                    .map(|i| {
                        let key = crate::random::key(try_, 0, 0, 7);
                        let [x, y] = crate::random::pair([key[0], i, 9], 0)
                            .map(|u| 2.0 * f64::from(u) - 1.0);
                        Neighbour { distance_squared: x * x + y * y, point: i }
                    })
                    .filter(|neighbour| neighbour.distance_squared < 1.0)
                    .collect();
                found.sort_by(|a, b| a.distance_squared.total_cmp(&b.distance_squared));
                found.resize(k, Neighbour::NONE);
                let disks = Disks { reach: 1.0, part, power: 0 };
                let [light, ..] = irradiance(&frame, &surface, &photons, &found, disks);
                sum += f64::from(light) * std::f64::consts::PI / f64::from(tries);
            }
            assert!((sum - 0.25).abs() < 0.006, "{k} {part}: {sum}");
        }
    }
}
