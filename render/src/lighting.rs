//! The light that reaches a surface. Light sample `l` is light `l` without a size; those that
//! follow are samples of the triangles that shine, and then of an environment map. But for maps, a twin of `lighting.wgsl`.

use crate::environment;
use crate::environment_map::MapSample;
use crate::layout::{Path, Surface};
use crate::plane::start;
use crate::random::{Use, key, light_sample, unit, words};
use crate::scene_data::{DIRECTIONAL, RoundPlace};
use crate::scene_words::{SceneWords, weighted};
use crate::vector::{
    Vector, add, dot, greatest, length, mul, negated, normalized, power_of_two, scaled, sub,
};
use crate::world::{Spot, World};
use splitplane_core::ray::Ray;

const ONE_OVER_PI: f32 = core::f32::consts::FRAC_1_PI;

/// A point of a triangle that shines.
pub(crate) struct AreaSample {
    /// The point.
    pub(crate) point: Vector,
    /// Unit normal of the triangle.
    pub(crate) normal: Vector,
    /// Half the cross product's length: the area times 4^power.
    pub(crate) scaled_area: f32,
    pub(crate) power: i32,
    /// How far off the triangle a ray must end, so that it does not meet it.
    pub(crate) offset: f32,
    /// Radiance over the probability of the triangle.
    pub(crate) radiance: Vector,
    /// That probability.
    pub(crate) probability: f32,
}

/// Light samples of a surface.
fn samples(scene: &SceneWords<'_>) -> u32 {
    scene.frame.lights + scene.frame.area_samples + scene.frame.sky_samples
}

/// A sample of an environment map; `None` where nothing comes from there.
fn map_sample(scene: &SceneWords<'_>, path: &Path, wave: u32, sample: u32) -> Option<MapSample> {
    let frame = scene.frame;
    let own = sample - frame.lights - frame.area_samples;
    let key = key(path.pixel, wave, Use::Sky as u32, frame.seed);
    environment::sample(scene, words(key, path.sequence * frame.sky_samples + own))
}

fn area_sample(
    scene: &SceneWords<'_>,
    world: impl World,
    path: &Path,
    wave: u32,
    sample: u32,
) -> AreaSample {
    let frame = scene.frame;
    let index = path.sequence * frame.area_samples + (sample - frame.lights);
    let [x, y, z] = light_sample(path.pixel, wave, frame.seed, index);
    shining_point(scene, world, [unit(x), unit(y)], z)
}

/// A point of the triangle or shape that shines whose share holds the word, evenly over the triangle, or over the shape in its object's space.
pub(crate) fn shining_point(
    scene: &SceneWords<'_>,
    world: impl World,
    [mut u, mut v]: [f32; 2],
    word: u32,
) -> AreaSample {
    let emitter = scene.emitter(word);
    let at = Spot { triangle: emitter.triangle, instance: emitter.instance };
    let material = scene.material(world.material(scene, at));
    let radiance = scaled(material.emission, 1.0 / emitter.probability);
    let probability = emitter.probability;
    if let Some(RoundPlace { point, normal, offset, scaled_area, power }) =
        world.point_of_shape(at, [u, v])
    {
        return AreaSample { point, normal, scaled_area, power, offset, radiance, probability };
    }
    let (corners, plane) = world.plane(at);
    // Evenly over the parallelogram, its far half folded back.
    if u + v > 1.0 {
        (u, v) = (1.0 - u, 1.0 - v);
    }
    AreaSample {
        point: weighted(corners, [(1.0 - u) - v, u, v]),
        normal: normalized(plane.scaled_normal),
        scaled_area: length(plane.scaled_normal) * 0.5,
        power: plane.power,
        offset: plane.offset,
        radiance,
        probability,
    }
}

/// The solid angle of a triangle that shines, seen from `towards` away along the unit `direction`: area times cosine over squared
/// distance, the power of two taken to the distance first.
pub(crate) fn solid_angle((scaled_area, power): (f32, i32), distance: f32, cosine: f32) -> f32 {
    let inverse = 1.0 / (distance * power_of_two(power));
    ((scaled_area * inverse) * inverse) * cosine
}

/// The light samples from `first` on that are on the surface's side: those worth a shadow ray.
pub(crate) fn may_be_lit(
    scene: &SceneWords<'_>,
    world: impl World,
    surface: &Surface,
    path: &Path,
    (wave, first): (u32, u32),
) -> u32 {
    let mut lights = 0;
    for sample in first..samples(scene) {
        let towards = if sample < scene.frame.lights {
            let light = scene.light(sample);
            if light.kind == DIRECTIONAL { light.place } else { sub(light.place, surface.point) }
        } else if sample >= scene.frame.lights + scene.frame.area_samples {
            match map_sample(scene, path, wave, sample) {
                Some(MapSample { direction, radiance, .. }) if greatest(radiance) > 0.0 => {
                    direction
                }
                _ => continue,
            }
        } else {
            sub(area_sample(scene, world, path, wave, sample).point, surface.point)
        };
        let faces = dot(surface.normal, towards) > 0.0;
        if faces && dot(surface.geometric_normal, towards) > 0.0 {
            lights |= 1 << sample;
        }
    }
    lights
}

/// What becomes of the light that a path gets from one direction.
pub(crate) fn albedo(surface: &Surface, path: &Path) -> Vector {
    scaled(mul(path.weight, surface.scattering), ONE_OVER_PI)
}

/// The ray towards a light sample, and the light that the path gets when nothing is in its way.
pub(crate) fn shadow_ray(
    scene: &SceneWords<'_>,
    world: impl World,
    surface: &Surface,
    path: &Path,
    wave: u32,
    sample: u32,
) -> (Ray, Vector) {
    let start = start(surface, 1.0);
    let albedo = albedo(surface, path);
    if sample >= scene.frame.lights + scene.frame.area_samples {
        let Some(MapSample { direction, radiance, density }) =
            map_sample(scene, path, wave, sample)
        else {
            return (Ray::new(start, surface.normal), [0.0; 3]);
        };
        let part = dot(surface.normal, direction) / (density * scene.frame.sky_samples as f32);
        return (Ray::new(start, direction), mul(albedo, scaled(radiance, part)));
    }
    if sample >= scene.frame.lights {
        let area = area_sample(scene, world, path, wave, sample);
        let towards = sub(area.point, surface.point);
        let direction = normalized(towards);
        let mut normal = area.normal;
        if dot(normal, direction) > 0.0 {
            normal = negated(normal);
        }
        let end = add(area.point, scaled(normal, area.offset));
        // The solid angle: area over squared distance, the power of two taken to the distance first.
        let inverse = 1.0 / (length(towards) * power_of_two(area.power));
        let cosines = dot(surface.normal, direction) * -dot(normal, direction);
        let solid_angle = ((area.scaled_area * inverse) * inverse) * cosines;
        let share = solid_angle / scene.frame.area_samples as f32;
        let light = mul(albedo, scaled(area.radiance, share));
        return (Ray::segment(start, end), light);
    }
    let source = scene.light(sample);
    if source.kind == DIRECTIONAL {
        let light = mul(albedo, scaled(source.irradiance, dot(surface.normal, source.place)));
        return (Ray::new(start, source.place), light);
    }
    let towards = sub(source.place, surface.point);
    let falloff = source.distance / length(towards);
    let cosine = dot(surface.normal, normalized(towards));
    let share = (falloff * falloff) * cosine;
    (Ray::segment(start, source.place), mul(albedo, scaled(source.irradiance, share)))
}
