//! The parts of a surface that a path follows one by one where photons bring a part of the light: what scatters evenly, and the mirror or
//! clear body. Path tracing has one part, the whole.
//!
//! No light is counted twice. Let a path have left the eye through mirrors and clear bodies only. Where photons are looked up at its first
//! surface that scatters evenly (`Gather::Maps`), the path ends there, but for the mirror, and for one ray where surfaces shine: it weighs
//! with samples of them as in path tracing, and sees nothing else. Where it goes on (`Gather::Final`), what it finds by one more
//! bounce is direct light and the light of photons; and what it finds in a mirror or clear body after that bounce is a caustic, which photons bring to the first surface.

use crate::bsdf::{Bsdf, Scattered};
use crate::layout::{Frame, Path};
use crate::planted::{Fault, is_planted};
use crate::settings::LightTransport;
use crate::vector::{Vector, add, scaled};

/// Values of [`Path::history`] of paths from the eye.
pub(crate) const FROM_EYE: u32 = 0;
pub(crate) const SCATTERED: u32 = 1;
pub(crate) const BENT: u32 = 2;
/// It has met photons and was scattered once more, to find lights that samples of them find badly: all else counts already.
pub(crate) const LAST: u32 = 3;

/// [`Frame::transport`] of path tracing, and of photons that are looked up at the first surface; the next number is that of final gathering.
pub(crate) const PATHS: u32 = LightTransport::Paths as u32;
const MAPS: u32 = LightTransport::Photons as u32;

/// The share of one of two ways to find the same light (power heuristic): of the one with the density `own`.
pub(crate) fn share(frame: &Frame, own: f32, other: f32) -> f32 {
    if other <= 0.0 || is_planted(frame, Fault::SharesOfOne) {
        return 1.0;
    }
    let ratio = other / own;
    1.0 / (1.0 + ratio * ratio)
}

/// A part of a surface, and the probability that a path follows it.
#[derive(Clone, Copy)]
struct Lobe {
    bsdf: Bsdf,
    probability: f32,
    /// Whether light that it sends comes from lights too, or from photons alone.
    lit: bool,
    /// [`Path::history`] of a path that follows it.
    history: u32,
}

/// The parts of a surface.
pub(crate) struct Lobes([Option<Lobe>; 2]);

/// Whether a path that looks photons up ends where it is scattered evenly.
pub(crate) fn ends(frame: &Frame, path: &Path) -> bool {
    frame.transport == MAPS || path.history != FROM_EYE
}

/// Whether light that a path finds by itself was brought by photons already.
pub(crate) fn is_caustic(frame: &Frame, path: &Path) -> bool {
    path.history == BENT && !is_planted(frame, Fault::CausticsTwice)
}

impl Lobes {
    /// Those of a path from the eye.
    pub(crate) fn of(frame: &Frame, path: &Path, bsdf: Bsdf) -> Lobes {
        if frame.transport == PATHS {
            let whole = Lobe { bsdf, probability: 1.0, lit: true, history: FROM_EYE };
            return Lobes([Some(whole), None]);
        }
        let from_eye = path.history == FROM_EYE;
        let history = if from_eye { FROM_EYE } else { BENT };
        let (even, mirror) = (bsdf.even(), bsdf.mirror());
        let ends = ends(frame, path);
        let shares = if ends && frame.emitters == 0 { [0.0, 1.0] } else { shares(&bsdf) };
        let scattered = if ends { LAST } else { SCATTERED };
        Lobes([
            even.map(|bsdf| Lobe { bsdf, probability: shares[0], lit: true, history: scattered }),
            mirror.map(|bsdf| Lobe { bsdf, probability: shares[1], lit: from_eye, history }),
        ])
    }

    /// Those of a photon.
    pub(crate) fn of_photon(bsdf: Bsdf, histories: [u32; 2]) -> Lobes {
        let [even, mirror] = shares(&bsdf);
        let lobe = |bsdf, probability, history| Lobe { bsdf, probability, lit: false, history };
        Lobes([
            bsdf.even().map(|part| lobe(part, even, histories[0])),
            bsdf.mirror().map(|part| lobe(part, mirror, histories[1])),
        ])
    }

    /// Whether some light comes from directions that a sample of a light may have.
    pub(crate) fn scatter(&self) -> bool {
        self.0.iter().flatten().any(|lobe| lobe.lit && lobe.bsdf.scatters())
    }

    /// What comes back of a sample of a light, times its cosine, and times its share where the path may find the same light by itself. The
    /// sample has the density `own` times `unit`.
    pub(crate) fn answer(
        &self,
        frame: &Frame,
        direction: Vector,
        (own, unit): (f32, f32),
        last: bool,
    ) -> Vector {
        let mut sum = [0.0; 3];
        for (place, lobe) in self.0.iter().flatten().filter(|lobe| lobe.lit).enumerate() {
            let (sent, density) = lobe.bsdf.evaluate(direction);
            let density = density * lobe.probability;
            // What the path may find by itself after its last bounce, nothing finds.
            let other = if last || own <= 0.0 { 0.0 } else { density * unit };
            let sent = scaled(sent, share(frame, own, other));
            sum = if place == 0 { sent } else { add(sum, sent) };
        }
        sum
    }

    /// The direction in which a path goes on, and its history; `None` where it ends.
    pub(crate) fn draw(
        &self,
        incoming: Vector,
        choice: f32,
        numbers: [f32; 2],
    ) -> Option<(Scattered, u32)> {
        let [first, second] = &self.0;
        let part = first.as_ref().map_or(0.0, |lobe| lobe.probability);
        let (lobe, choice) = if choice < part {
            (first.as_ref()?, choice / part)
        } else {
            (second.as_ref()?, (choice - part) / (1.0 - part))
        };
        let scattered = lobe.bsdf.scatter(incoming, choice, numbers)?;
        let weight = scaled(scattered.weight, 1.0 / lobe.probability);
        let density = scattered.density * lobe.probability;
        Some((Scattered { weight, density, ..scattered }, lobe.history))
    }
}

/// The probabilities of what scatters evenly and of the mirror.
fn shares(bsdf: &Bsdf) -> [f32; 2] {
    match (bsdf.even(), bsdf.mirror()) {
        (Some(_), Some(_)) => [1.0 - bsdf.mirror_share, bsdf.mirror_share],
        (Some(_), None) => [1.0, 0.0],
        (None, _) => [0.0, 1.0],
    }
}
