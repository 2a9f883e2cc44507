//! Light that is followed beyond direct light: path tracing (Kajiya 1986) with samples of the lights at every point, weighted against
//! what the path finds by itself (power heuristic, Veach 1997), and an end by chance (Russian roulette, Arvo and Kirk 1990).
//!
//! Light samples of a point: lights without a size, shining triangles, the environment, in this order. Random numbers are those of
//! pixel, sample, wave and use; so a kernel that asks again gets the same.

use crate::bsdf::{Bsdf, Scattered};
use crate::environment;
use crate::layout::{Path, Surface};
use crate::lighting::{shining_point, solid_angle};
use crate::plane::start;
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

/// The share of one of two ways to find the same light (power heuristic): of the one with the density `own`.
fn share(own: f32, other: f32) -> f32 {
    if other <= 0.0 {
        return 1.0;
    }
    let ratio = other / own;
    1.0 / (1.0 + ratio * ratio)
}

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
        let own = if path.density > 0.0 { share(path.density, path.sky_density) } else { 1.0 };
        let light = mul(path.weight, environment::radiance(frame, ray.direction));
        return Surface { light: scaled(light, own), ..Surface::default() };
    }
    let Met { mut surface, at, described, weights, from_front, plane } =
        meet(scene, world, ray, (hit, instance));
    let material = scene.material(surface.material);
    surface.incoming = packed(negated(ray.direction));
    if material.kind == DIELECTRIC {
        let index = material.refractive_index;
        surface.scattering[2] = if from_front { 1.0 / index } else { index };
    } else {
        let texture = scene.texture_colour(material.texture, described, weights);
        surface.scattering = mul(material.diffuse, texture);
    }
    if greatest(material.emission) > 0.0 {
        let mut own = 1.0;
        // No ray is aimed at a shape.
        if path.density > 0.0 && frame.area_samples > 0 && described != NONE {
            let cosine = dot(surface.geometric_normal, ray.direction).abs();
            let area = (length(plane.scaled_normal) * 0.5, plane.power);
            let other =
                frame.area_samples as f32 * scene.emitter_probability(at.triangle, at.instance);
            own = share(path.density * solid_angle(area, hit.t, cosine), other);
        }
        surface.light = scaled(mul(path.weight, material.emission), own);
    }
    let bsdf = Bsdf::of(scene, &surface);
    if bsdf.scatters() {
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
    // What the path may find by itself after its last bounce, nothing finds.
    let last = wave >= frame.depth;
    let (sent, density) = bsdf.evaluate(drawn.direction);
    let other = if last || drawn.density <= 0.0 { 0.0 } else { density * drawn.unit };
    let sent = scaled(sent, share(drawn.density, other));
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
    if sample >= frame.lights + frame.area_samples {
        let local = hemisphere(numbers(Use::Sky as u32));
        let direction = normalized(Basis::around(surface.normal).to_world(local));
        let density = sky_density(surface, direction);
        if density <= 0.0 {
            return None;
        }
        let light = scaled(environment::radiance(frame, direction), 1.0 / density);
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
    let angle =
        solid_angle((area.scaled_area, area.power), length(towards), -dot(normal, direction));
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
fn sky_density(surface: &Surface, direction: Vector) -> f32 {
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
    let Scattered { direction, weight, density, side } =
        bsdf.scatter(ray.direction, choice, numbers)?;
    let weight = survivors(mul(path.weight, weight), wave, chance)?;
    let next = Path {
        weight,
        density,
        sky_density: if frame.sky_samples > 0 { sky_density(surface, direction) } else { 0.0 },
        ..*path
    };
    Some((Ray::new(start(surface, side), direction), next))
}

/// What a path weighs that chance lets go on: those that do carry the light of those that do not.
fn survivors(weight: Vector, wave: u32, chance: f32) -> Option<Vector> {
    let most = greatest(weight);
    if most <= 0.0 || !most.is_finite() {
        return None;
    }
    if wave < SURE_BOUNCES || most >= 1.0 {
        return Some(weight);
    }
    (chance < most).then(|| scaled(weight, 1.0 / most))
}
