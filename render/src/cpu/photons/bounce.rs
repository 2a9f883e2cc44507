//! What happens to a photon where it arrives.

use super::report::{PhotonEnergy, add_to, of};
use crate::bsdf::{Bsdf, Scattered};
use crate::layout::Path;
use crate::lobes::Lobes;
use crate::paths::described;
use crate::plane::start;
use crate::planted::{Fault, is_planted};
use crate::random::{pair, photon_key};
use crate::scene_words::SceneWords;
use crate::surface::meet;
use crate::vector::{Vector, dot, greatest, mul, negated, scaled, sub};
use crate::warp::packed;
use crate::world::World;
use splitplane_core::ray::{Hit, Ray};

/// Values of [`Path::history`] of photons.
const STRAIGHT: u32 = 0;
const BENT: u32 = 1;
const SCATTERED: u32 = 2;

/// Uses of random numbers at a bounce.
const CHOICE: u32 = 0;
const DIRECTION: u32 = 1;

/// A photon in a map, without its place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Photon {
    pub(crate) power: Vector,
    /// The triangle's normal on the side that it came to, in two halves of 16 bits.
    pub(crate) normal: u32,
}

/// Which map a photon belongs to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Map {
    /// It met mirrors and clear bodies only.
    Caustics = 0,
    /// A surface scattered it evenly before.
    Global = 1,
}

/// What comes of a photon.
#[derive(Default)]
pub(crate) struct Arrival {
    pub(crate) stored: Option<(Map, Vector, Photon)>,
    pub(crate) next: Option<(Ray, Path)>,
}

/// Where a photon arrives: it is stored where the surface scatters evenly, unless it comes straight from a light, and goes on in one direction, or not.
pub(crate) fn arrive(
    scene: &SceneWords<'_>,
    world: impl World,
    (ray, path): (&Ray, &Path),
    (hit, instance): (&Hit, u32),
    (wave, depth): (u32, u32),
    energy: &mut PhotonEnergy,
) -> Arrival {
    let power = path.weight;
    if !hit.is_hit() {
        add_to(&mut energy.escaped, of(power));
        return Arrival::default();
    }
    let met = meet(scene, world, ray, (hit, instance));
    let (surface, _) = described(scene, &met, ray);
    let bsdf = Bsdf::of(scene, &surface).of_light();
    let towards = negated(ray.direction);
    // Photons come by the cosine to the triangle, while surfaces are lit by that to the normal for shading (Veach 1997, section 5.3).
    let turned = dot(surface.normal, towards) / dot(surface.geometric_normal, towards);
    let map = if path.history == BENT { Map::Caustics } else { Map::Global };
    let arrived = scaled(power, turned);
    let is_stored = path.history != STRAIGHT && greatest(bsdf.diffuse) > 0.0;
    let stored = (is_stored && arrived.iter().all(|part| part.is_finite())).then(|| {
        let photon = Photon { power: arrived, normal: packed(surface.geometric_normal) };
        (map, surface.point, photon)
    });
    if wave >= depth {
        add_to(&mut energy.cut, of(power));
        return Arrival { stored, next: None };
    }
    let numbers =
        |used: u32| pair(photon_key(path.sequence, wave + 1, used, scene.frame.seed), path.pixel);
    let [choice, chance] = numbers(CHOICE);
    let lobes = Lobes::of_photon(bsdf, [SCATTERED, path.history.max(BENT)]);
    let drawn = lobes.draw(ray.direction, choice, numbers(DIRECTION));
    let next = drawn.and_then(|(Scattered { direction, weight, side, .. }, history)| {
        let geometric = dot(surface.geometric_normal, direction).abs();
        let left = geometric / dot(surface.normal, direction).abs();
        let weight = mul(power, scaled(weight, turned * left));
        let most = greatest(weight);
        let path = Path { weight, history, ..*path };
        let ray = Ray::new(start(&surface, side), direction);
        (most > 0.0 && most.is_finite()).then_some((ray, path))
    });
    let sent = next.map_or([0.0; 3], |(_, path)| path.weight);
    add_to(&mut energy.absorbed, of(sub(power, sent)));
    let next = next.and_then(|(ray, path)| {
        let weight = survivors(scene, power, sent, chance);
        add_to(&mut energy.chance, of(sub(sent, weight.unwrap_or_default())));
        Some((ray, Path { weight: weight?, ..path }))
    });
    Arrival { stored, next }
}

/// The power of a photon that goes on with less than it had: chance ends some, and those that do not end carry theirs, so that photons have
/// about the same.
fn survivors(scene: &SceneWords<'_>, before: Vector, after: Vector, chance: f32) -> Option<Vector> {
    let part = greatest(after) / greatest(before);
    if part >= 1.0 {
        return Some(after);
    }
    let carried = if is_planted(scene.frame, Fault::PhotonsAsTheyAre) { 1.0 } else { part };
    (chance < part).then(|| scaled(after, 1.0 / carried))
}
