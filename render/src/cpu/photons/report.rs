//! What became of the photons of a frame.

use crate::vector::Vector;

/// Where the power of photons went: sums of red, green and blue, in the unit of [`PhotonReport`].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct PhotonEnergy {
    /// What left the lights, towards what is shown.
    pub emitted: [f64; 3],
    /// What met nothing.
    pub escaped: [f64; 3],
    /// What surfaces kept; where normals for shading differ from those of triangles, less what these add.
    pub absorbed: [f64; 3],
    /// What photons still had after the last bounce.
    pub cut: [f64; 3],
    /// What chance took from photons that it ended, less what it gave to those that went on: nothing but noise.
    pub chance: [f64; 3],
}

impl PhotonEnergy {
    pub(super) fn add_all(&mut self, other: &PhotonEnergy) {
        add_to(&mut self.emitted, other.emitted);
        add_to(&mut self.escaped, other.escaped);
        add_to(&mut self.absorbed, other.absorbed);
        add_to(&mut self.cut, other.cut);
        add_to(&mut self.chance, other.chance);
    }
}

/// Adds a colour to a sum.
pub(super) fn add_to(sums: &mut [f64; 3], colour: [f64; 3]) {
    for (sum, part) in sums.iter_mut().zip(colour) {
        *sum += part;
    }
}

/// The power of a photon, for sums.
pub(super) fn of(power: Vector) -> [f64; 3] {
    power.map(f64::from)
}

/// What became of the photons of a frame, all passes together.
///
/// Powers are in units of radiance times area, the area in units of 4^[`PhotonReport::exponent`], and each pass counts whole.
/// What was emitted is the sum of the other four.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct PhotonReport {
    /// Photons that left the lights.
    pub photons: u64,
    /// Their rays, one for each bounce.
    pub rays: u64,
    /// Photons stored that met mirrors and clear bodies only.
    pub caustics: u64,
    /// Photons stored that other surfaces had scattered.
    pub global: u64,
    /// The unit of lengths is two to this.
    pub exponent: i32,
    /// Where the power went.
    pub energy: PhotonEnergy,
}
