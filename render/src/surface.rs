//! The place that a ray meets: point, normals, material, and which rays it asks for. Its twins are
//! `shade_surface.wgsl`, `smooth_normals.wgsl`, `dielectrics.wgsl`, `bounce.wgsl` and
//! `refraction.wgsl`.

use crate::environment;
use crate::fresnel::{incidence, part, reflected, refracted};
use crate::layout::{Frame, Path, Surface};
use crate::lighting::may_be_lit;
use crate::plane::{Plane, start};
use crate::scene_data::{DIELECTRIC, NONE, RoundPlace};
use crate::scene_words::{MaterialWords, SceneWords, weighted};
use crate::vector::{Vector, add, dot, greatest, mul, negated, normalized, scaled};
use crate::world::{Spot, World};
use splitplane_core::ray::{Hit, Ray};

/// Clear surfaces that a shadow ray passes; behind more of them it is dark.
pub(crate) const MOST_CLEAR_LAYERS: u32 = 16;

/// The next float: both ends of a ray are closed, so a shadow ray that starts there leaves out the clear surface that it has
/// just passed. `t` is not negative.
pub(crate) fn after(t: f32) -> f32 {
    f32::from_bits(t.to_bits() + 1)
}

/// Where a ray met a triangle.
pub(crate) struct Met {
    /// Point, normals, offset and material.
    pub(crate) surface: Surface,
    pub(crate) at: Spot,
    /// The number by which the appearance knows the triangle; [`NONE`] for a shape.
    pub(crate) described: u32,
    /// Of its corners.
    pub(crate) weights: [f32; 3],
    /// Whether the ray met the front, which is the outside of a body.
    pub(crate) from_front: bool,
    /// Its plane; that of a shape has its area as a light has it, and no edges.
    pub(crate) plane: Plane,
}

/// The point that a ray met; `hit` is one.
pub(crate) fn meet(
    scene: &SceneWords<'_>,
    world: impl World,
    ray: &Ray,
    (hit, instance): (&Hit, u32),
) -> Met {
    let at = Spot { triangle: hit.triangle, instance };
    if let Some(place) = world.round(ray, (hit, instance)) {
        return meet_shape(world.material(scene, at), at, ray, &place);
    }
    let (corners, plane) = world.plane(at);
    let weights = [(1.0 - hit.u) - hit.v, hit.u, hit.v];
    let [along_u, along_v] = [scaled(plane.edges[0], hit.u), scaled(plane.edges[1], hit.v)];
    let point = add(corners[0], add(along_u, along_v));
    let mut geometric_normal = normalized(plane.scaled_normal);
    // From the front the corners run counter-clockwise.
    let facing = dot(geometric_normal, ray.direction) < 0.0;
    if geometric_normal == [0.0; 3] {
        // Seen exactly from its edge, a triangle without area has no side of its own.
        geometric_normal = negated(ray.direction);
    } else if !facing {
        geometric_normal = negated(geometric_normal);
    }
    let described = world.described(at);
    let surface = Surface {
        point,
        offset: plane.offset,
        geometric_normal,
        material: world.material(scene, at),
        normal: smooth_normal(
            scene,
            described,
            weights,
            geometric_normal,
            ray.direction,
            |normal| world.normal(normal, instance),
        ),
        ..Surface::default()
    };
    // A reflected body keeps its inside.
    let from_front = facing != world.mirrored(instance);
    Met { surface, at, described, weights, from_front, plane }
}

/// The point of a shape that a ray met. Its texture is white.
fn meet_shape(material: u32, at: Spot, ray: &Ray, place: &RoundPlace) -> Met {
    let facing = dot(place.normal, ray.direction) < 0.0;
    let normal = match place.normal {
        [0.0, 0.0, 0.0] => negated(ray.direction),
        normal if facing => normal,
        normal => negated(normal),
    };
    let (point, offset) = (place.point, place.offset);
    let (scaled_normal, power) = (scaled(normal, 2.0 * place.scaled_area), place.power);
    let (geometric_normal, plane) = (normal, Plane { scaled_normal, power, ..Plane::NONE });
    let surface =
        Surface { point, offset, geometric_normal, material, normal, ..Surface::default() };
    Met { surface, at, described: NONE, weights: [0.0; 3], from_front: facing, plane }
}

/// The light of a ray that met nothing.
pub(crate) fn missed(scene: &SceneWords<'_>, ray: &Ray, path: &Path) -> Surface {
    let light = mul(path.weight, environment::radiance(scene, ray.direction));
    Surface { light, ..Surface::default() }
}

/// The point that a path's ray met, and what follows from it; and whether lights may light it. Of these it names those from
/// sample `first` on.
pub(crate) fn shade(
    scene: &SceneWords<'_>,
    world: impl World,
    (ray, path): (&Ray, &Path),
    (hit, instance): (&Hit, u32),
    (wave, first): (u32, u32),
) -> (Surface, bool) {
    if !hit.is_hit() {
        return (missed(scene, ray, path), false);
    }
    let Met { mut surface, described, weights, from_front, .. } =
        meet(scene, world, ray, (hit, instance));
    let place = Place { described, weights, from_front };
    let scatters = shade_met(&mut surface, scene, &place, ray.direction, path, wave);
    if scatters {
        surface.lights = may_be_lit(scene, world, &surface, path, (wave, first));
    }
    (surface, scatters)
}

/// The place on a triangle where a ray met it: [`Met`] without the surface.
pub(crate) struct Place {
    pub(crate) described: u32,
    pub(crate) weights: [f32; 3],
    pub(crate) from_front: bool,
}

/// What follows from the point that a path's ray met, but for lights; whether they may light it.
pub(crate) fn shade_met(
    surface: &mut Surface,
    scene: &SceneWords<'_>,
    place: &Place,
    direction: Vector,
    path: &Path,
    wave: u32,
) -> bool {
    let frame = scene.frame;
    let material = scene.material(surface.material);
    let last = wave >= frame.depth;
    if material.kind == DIELECTRIC {
        shade_dielectric(surface, frame, &material, direction, path, place.from_front, last);
        return false;
    }
    let texture = scene.texture_colour(material.texture, place.described, place.weights);
    surface.scattering = mul(material.diffuse, texture);
    shade_opaque(surface, scene, &material, direction, path, last);
    greatest(surface.scattering) > 0.0
}

/// The normal between those of the corners, on the side of the triangle that the ray came from; the
/// triangle's own where there is none, or where it would face away from the ray.
fn smooth_normal(
    scene: &SceneWords<'_>,
    triangle: u32,
    weights: [f32; 3],
    geometric_normal: Vector,
    direction: Vector,
    in_world: impl Fn(Vector) -> Vector,
) -> Vector {
    if !scene.has_normals() {
        return geometric_normal;
    }
    let corners = [0, 1, 2].map(|corner| scene.normal(triangle, corner));
    let mut normal = normalized(in_world(weighted(corners, weights)));
    if dot(normal, geometric_normal) < 0.0 {
        normal = negated(normal);
    }
    if dot(normal, direction) < 0.0 { normal } else { geometric_normal }
}

fn shade_opaque(
    surface: &mut Surface,
    scene: &SceneWords<'_>,
    material: &MaterialWords,
    direction: Vector,
    path: &Path,
    last: bool,
) {
    let frame = scene.frame;
    // Rays are aimed at a map.
    let mut received = match scene.environment {
        Some(_) => [0.0; 3],
        None => scaled(environment::irradiance(frame, surface.normal), frame.ambient),
    };
    let headlight = frame.headlight * incidence(direction, surface.normal);
    received = add(received, [headlight; 3]);
    let sent = add(material.emission, mul(surface.scattering, received));
    surface.light = mul(path.weight, sent);
    if last || !worthwhile(frame, mul(path.weight, material.second)) {
        return;
    }
    surface.flags = Surface::REFLECTS;
    let cosine = incidence(direction, surface.normal);
    if dot(reflected(direction, surface.normal, cosine), surface.geometric_normal) <= 0.0 {
        // The mirrored ray would go into the surface: the flat mirror does not.
        surface.normal = surface.geometric_normal;
    }
}

fn shade_dielectric(
    surface: &mut Surface,
    frame: &Frame,
    material: &MaterialWords,
    direction: Vector,
    path: &Path,
    from_front: bool,
    last: bool,
) {
    surface.light = mul(path.weight, material.emission);
    let index = material.refractive_index;
    let ratio = if from_front { 1.0 / index } else { index };
    let mut cosine = incidence(direction, surface.normal);
    let mut parting = part(cosine, ratio);
    let out = refracted(direction, surface.normal, cosine, ratio, parting.cosine);
    let mirrored = reflected(direction, surface.normal, cosine);
    let above = dot(mirrored, surface.geometric_normal) > 0.0;
    let below = parting.reflectance >= 1.0 || dot(out, surface.geometric_normal) < 0.0;
    if !(above && below) {
        surface.normal = surface.geometric_normal;
        cosine = incidence(direction, surface.normal);
        parting = part(cosine, ratio);
    }
    surface.scattering = [parting.reflectance, parting.cosine, ratio];
    if last {
        return;
    }
    if worthwhile(frame, scaled(path.weight, parting.reflectance)) {
        surface.flags |= Surface::REFLECTS;
    }
    let through = scaled(mul(path.weight, material.second), 1.0 - parting.reflectance);
    if worthwhile(frame, through) {
        surface.flags |= Surface::REFRACTS;
    }
}

/// Whether a path of this weight continues.
fn worthwhile(frame: &Frame, weight: Vector) -> bool {
    greatest(weight) >= frame.minimum_weight
}

/// The reflected ray and its path.
pub(crate) fn reflect(
    scene: &SceneWords<'_>,
    ray: &Ray,
    path: &Path,
    surface: &Surface,
) -> (Ray, Path) {
    let weight = if scene.material_kind(surface.material) == DIELECTRIC {
        scaled(path.weight, surface.scattering[0])
    } else {
        mul(path.weight, scene.second_colour(surface.material))
    };
    let cosine = incidence(ray.direction, surface.normal);
    let direction = normalized(reflected(ray.direction, surface.normal, cosine));
    (Ray::new(start(surface, 1.0), direction), Path { weight, ..*path })
}

/// The refracted ray and its path.
pub(crate) fn refract(
    scene: &SceneWords<'_>,
    ray: &Ray,
    path: &Path,
    surface: &Surface,
) -> (Ray, Path) {
    let [reflectance, refracted_cosine, ratio] = surface.scattering;
    let tint = scene.second_colour(surface.material);
    let weight = scaled(mul(path.weight, tint), 1.0 - reflectance);
    let cosine = incidence(ray.direction, surface.normal);
    let out = refracted(ray.direction, surface.normal, cosine, ratio, refracted_cosine);
    (Ray::new(start(surface, -1.0), normalized(out)), Path { weight, ..*path })
}
