//! Light that is followed beyond direct light: path tracing (Kajiya 1986) with samples of the lights at every point, weighted against
//! what the path finds by itself (power heuristic, Veach 1997), and an end by chance (Russian roulette, Arvo and Kirk 1990).
//!
//! Light samples of a point: lights without a size, shining triangles, the environment, in this order. Random numbers are those of
//! pixel, sample, wave and use; so a kernel that asks again gets the same.

use crate::bsdf::{Bsdf, Scattered};
use crate::environment;
use crate::environment_map::MapSample;
use crate::layout::{Frame, Path, Surface};
use crate::lighting::{shining_point, solid_angle};
use crate::lobes::{FROM_EYE, LAST, Lobes, PATHS, ends, is_caustic, share};
use crate::plane::start;
use crate::planted::{Fault, is_planted};
use crate::random::{Use, key, pair, words};
use crate::scene_data::{DIELECTRIC, DIRECTIONAL, NONE};
use crate::scene_words::SceneWords;
use crate::surface::{Met, meet};
use crate::vector::{Vector, add, dot, greatest, length, mul, negated, normalized, scaled, sub};
use crate::warp::{Basis, ONE_OVER_PI, hemisphere, packed};
use crate::world::World;
use splitplane_core::ray::{Hit, Ray};

/// Bounces before chance may end a path.
const SURE_BOUNCES: u32 = 2;

/// What the ray of a path met: the light that comes from there by itself, which lights are worth a ray, whether the path goes on.
pub(crate) fn shade(
    scene: &SceneWords<'_>,
    world: impl World,
    (ray, path): (&Ray, &Path),
    (hit, instance): (&Hit, u32),
    wave: u32,
) -> Surface {
    let frame = scene.frame;
    if !hit.is_hit() {
        if is_caustic(frame, path) {
            return Surface::default();
        }
        let own =
            if path.density > 0.0 { share(frame, path.density, path.sky_density) } else { 1.0 };
        let light = mul(path.weight, environment::radiance(scene, ray.direction));
        return Surface { light: scaled(light, own), ..Surface::default() };
    }
    let met = meet(scene, world, ray, (hit, instance));
    let (mut surface, emission) = described(scene, &met, ray);
    let Met { at, plane, .. } = met;
    let area = (length(plane.scaled_normal) * 0.5, plane.power);
    // Shapes of the user's own are not sampled and send no photons, so that where these are looked up they are seen, but light nothing.
    let is_own_shape = met.described == NONE && area.0 == 0.0;
    let counts = match is_own_shape {
        true => path.history == FROM_EYE,
        false => !is_caustic(frame, path),
    };
    if greatest(emission) > 0.0 && counts {
        let mut own = 1.0;
        let sampled = path.density > 0.0 && frame.area_samples > 0 && !is_own_shape;
        if sampled && !is_planted(frame, Fault::EmissionWhole) {
            let cosine = dot(surface.geometric_normal, ray.direction).abs();
            let other =
                frame.area_samples as f32 * scene.emitter_probability(at.triangle, at.instance);
            own = share(frame, path.density * solid_angle(area, hit.t, cosine), other);
        }
        surface.light = scaled(mul(path.weight, emission), own);
    }
    if path.history == LAST {
        return surface;
    }
    let bsdf = Bsdf::of(scene, &surface);
    if frame.transport != PATHS && greatest(bsdf.diffuse) > 0.0 {
        surface.flags |= Surface::CAUSTICS;
        if ends(frame, path) {
            surface.flags |= Surface::GLOBAL;
        }
    }
    if Lobes::of(frame, path, bsdf).scatter() {
        for sample in 0..frame.lights + frame.area_samples + frame.sky_samples {
            if connect(scene, world, &surface, path, wave, sample).is_some() {
                surface.lights |= 1 << sample;
            }
        }
    }
    if scatter(scene, ray, path, &surface, wave).is_some() {
        surface.flags |= Surface::REFLECTS;
    }
    surface
}

/// The surface that was met, with what it scatters, for light beyond direct light, and what it sends out by itself.
pub(crate) fn described(scene: &SceneWords<'_>, met: &Met, ray: &Ray) -> (Surface, Vector) {
    let mut surface = met.surface;
    let material = scene.material(surface.material);
    surface.incoming = packed(negated(ray.direction));
    if material.kind == DIELECTRIC {
        let index = material.refractive_index;
        surface.scattering[2] = if met.from_front { 1.0 / index } else { index };
    } else {
        let texture = scene.texture_colour(material.texture, met.described, met.weights);
        surface.scattering = mul(material.diffuse, texture);
    }
    (surface, material.emission)
}

/// A place on a light.
struct Sample {
    /// From the surface, of length 1.
    direction: Vector,
    /// Where the ray ends; `None` for a direction.
    end: Option<Vector>,
    /// Radiance or irradiance over the density of the sample.
    light: Vector,
    /// The density by solid angle times `unit`; 0 for a light without a size, which no path finds by itself.
    density: f32,
    unit: f32,
}

/// The ray towards a light sample, and the light that the path gets when nothing is in its way; `None` where that is none.
pub(crate) fn connect(
    scene: &SceneWords<'_>,
    world: impl World,
    surface: &Surface,
    path: &Path,
    wave: u32,
    sample: u32,
) -> Option<(Ray, Vector)> {
    let frame = scene.frame;
    let bsdf = Bsdf::of(scene, surface);
    let drawn = draw(scene, world, surface, path, wave, sample)?;
    let lobes = Lobes::of(frame, path, bsdf);
    let last = wave >= frame.depth;
    let sent = lobes.answer(frame, drawn.direction, (drawn.density, drawn.unit), last);
    let light = mul(mul(path.weight, sent), drawn.light);
    let most = greatest(light);
    if most.is_nan() || most <= 0.0 {
        return None;
    }
    let above = dot(surface.geometric_normal, drawn.direction) > 0.0;
    let start = start(surface, if above { 1.0 } else { -1.0 });
    let ray = match drawn.end {
        Some(end) => Ray::segment(start, end),
        None => Ray::new(start, drawn.direction),
    };
    Some((ray, light))
}

/// Draws a sample of a light.
fn draw(
    scene: &SceneWords<'_>,
    world: impl World,
    surface: &Surface,
    path: &Path,
    wave: u32,
    sample: u32,
) -> Option<Sample> {
    let frame = scene.frame;
    let numbers = |used: u32| pair(key(path.pixel, wave, used, frame.seed), path.sequence);
    if sample < frame.lights {
        let light = scene.light(sample);
        let [density, unit] = [0.0, 1.0];
        if light.kind == DIRECTIONAL {
            let (direction, light) = (light.place, light.irradiance);
            return Some(Sample { direction, end: None, light, density, unit });
        }
        let towards = sub(light.place, surface.point);
        let direction = normalized(towards);
        let falloff = light.distance / length(towards);
        let end = Some(light.place);
        let light = scaled(light.irradiance, falloff * falloff);
        return Some(Sample { direction, end, light, density, unit });
    }
    if sample >= frame.lights + frame.area_samples && scene.environment.is_some() {
        let key = key(path.pixel, wave, Use::Sky as u32, frame.seed);
        let MapSample { direction, radiance, density } =
            environment::sample(scene, words(key, path.sequence))?;
        let light = scaled(radiance, 1.0 / density);
        return Some(Sample { direction, end: None, light, density, unit: 1.0 });
    }
    if sample >= frame.lights + frame.area_samples {
        let local = hemisphere(numbers(Use::Sky as u32));
        let direction = normalized(Basis::around(surface.normal).to_world(local));
        let density = sky_density(scene, surface, direction);
        if density <= 0.0 {
            return None;
        }
        let light = scaled(environment::radiance(scene, direction), 1.0 / density);
        return Some(Sample { direction, end: None, light, density, unit: 1.0 });
    }
    let first = Use::Area as u32 + 2 * (sample - frame.lights);
    let [word, _] = words(key(path.pixel, wave, first, frame.seed), path.sequence);
    let area = shining_point(scene, world, numbers(first + 1), word);
    let towards = sub(area.point, surface.point);
    let direction = normalized(towards);
    let mut normal = area.normal;
    if dot(normal, direction) > 0.0 {
        normal = negated(normal);
    }
    let cosine = if is_planted(frame, Fault::LightsFace) { 1.0 } else { -dot(normal, direction) };
    let angle = solid_angle((area.scaled_area, area.power), length(towards), cosine);
    let samples = frame.area_samples as f32;
    Some(Sample {
        direction,
        end: Some(add(area.point, scaled(normal, area.offset))),
        light: scaled(area.radiance, angle / samples),
        density: samples * area.probability,
        unit: angle,
    })
}

/// The density with which a sample of the environment has a direction.
fn sky_density(scene: &SceneWords<'_>, surface: &Surface, direction: Vector) -> f32 {
    if let Some(map) = scene.environment {
        return map.density(direction);
    }
    let cosine = dot(surface.normal, direction);
    if cosine > 0.0 { cosine * ONE_OVER_PI } else { 0.0 }
}

/// The ray and path that go on from a surface; `None` where it ends.
pub(crate) fn scatter(
    scene: &SceneWords<'_>,
    ray: &Ray,
    path: &Path,
    surface: &Surface,
    wave: u32,
) -> Option<(Ray, Path)> {
    let frame = scene.frame;
    if wave >= frame.depth {
        return None;
    }
    let numbers = |used: Use| pair(key(path.pixel, wave, used as u32, frame.seed), path.sequence);
    let [choice, chance] = numbers(Use::Choice);
    let numbers = numbers(Use::Direction);
    let bsdf = Bsdf::of(scene, surface);
    let lobes = Lobes::of(frame, path, bsdf);
    let (scattered, history) = lobes.draw(ray.direction, choice, numbers)?;
    let Scattered { direction, weight, density, side } = scattered;
    let weight = survivors(frame, mul(path.weight, weight), wave, chance)?;
    let next = Path {
        weight,
        density,
        history,
        sky_density: match frame.sky_samples {
            0 => 0.0,
            _ => sky_density(scene, surface, direction),
        },
        ..*path
    };
    Some((Ray::new(start(surface, side), direction), next))
}

/// What a path weighs that chance lets go on: those that do carry the light of those that do not.
fn survivors(frame: &Frame, weight: Vector, wave: u32, chance: f32) -> Option<Vector> {
    let most = greatest(weight);
    if most <= 0.0 || !most.is_finite() {
        return None;
    }
    if wave < SURE_BOUNCES || most >= 1.0 {
        return Some(weight);
    }
    let carried = if is_planted(frame, Fault::SurvivorsAsTheyAre) { 1.0 } else { most };
    (chance < most).then(|| scaled(weight, 1.0 / carried))
}
