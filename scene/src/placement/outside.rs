//! The three-quarter view of an object.

use crate::{Camera, Light, Scene};
use glam::DVec3;
use splitplane_core::aabb::Aabb;

/// From the object to the camera.
const TOWARDS_EYE: DVec3 = DVec3::new(0.55, 0.42, 0.72);
const FOV: f64 = 35.0;
/// Part of the picture left free around the object.
const MARGIN: f64 = 1.08;

pub(super) fn camera(scene: &Scene, aspect: f64) -> Camera {
    let towards = TOWARDS_EYE.normalize();
    let right = DVec3::Y.cross(towards).normalize();
    let up = towards.cross(right);
    let axes = [right, up, towards];
    let mut points = framed_points(scene);
    if points.is_empty() {
        points.push(DVec3::ZERO);
    }
    // The middle of what the camera sees, in the camera's axes.
    let project = |p: DVec3| DVec3::from_array(axes.map(|axis| p.dot(axis)));
    let flat: Vec<DVec3> = points.into_iter().map(project).collect();
    let lo = flat.iter().copied().fold(DVec3::INFINITY, DVec3::min);
    let hi = flat.iter().copied().fold(DVec3::NEG_INFINITY, DVec3::max);
    let middle = 0.5 * lo + 0.5 * hi;
    // The least distance from which every point is in the picture.
    let tan = (0.5 * FOV.to_radians()).tan() / MARGIN;
    let distance = flat
        .iter()
        .map(|&point| (point - middle, (point - middle).abs()))
        .map(|(point, size)| point.z + (size.x / (tan * aspect)).max(size.y / tan))
        .fold(0.0, f64::max);
    // A scene without extent still needs an eye that is not where it looks.
    let least = middle.abs().max_element().max(1e-30) * 1e-5;
    let distance = distance.max(least);
    let centre = right * middle.x + up * middle.y + towards * middle.z;
    let eye = centre + towards * distance;
    at(eye, centre)
}

/// Lights around the point that the camera looks at: the first above and to its left, the others at
/// equal angles from there.
pub(super) fn lights(camera: &Camera, count: usize) -> Vec<Light> {
    let [eye, centre] =
        [camera.eye(), camera.look_at()].map(|p| DVec3::from_array(p.map(f64::from)));
    let distance = (eye - centre).length();
    let towards = TOWARDS_EYE.normalize();
    let right = DVec3::Y.cross(towards).normalize();
    let up = towards.cross(right);
    let first = (towards * 0.6 - right * 0.9 + up * 0.9) * 1.5 * distance;
    (0..count)
        .map(|number| {
            let (sin, cos) = (std::f64::consts::TAU * number as f64 / count as f64).sin_cos();
            let turned =
                DVec3::new(cos * first.x + sin * first.z, first.y, cos * first.z - sin * first.x);
            // A scene near the end of the range of f32 has its lights there.
            let end = DVec3::splat(f64::from(f32::MAX));
            let position = (centre + turned).clamp(-end, end).as_vec3().to_array();
            Light::point_for(position, camera.look_at(), super::share(number, count))
        })
        .collect()
}

/// Positions near the end of the range of f32 leave no space for an eye outside; then any camera
/// does.
fn at(eye: DVec3, centre: DVec3) -> Camera {
    let [eye, at] = [eye, centre].map(|p| p.as_vec3().to_array());
    let up = [0.0, 1.0, 0.0];
    Camera::new(eye, at, up, FOV as f32)
        .or_else(|_| Camera::new([0.0, 0.0, 1.0], [0.0; 3], up, FOV as f32))
        .unwrap_or_else(|_| unreachable!("constants that make a camera"))
}

/// The corners to put in the picture: those of all triangles, without the few that are as large as
/// the scene itself. A ground plane would else shrink what stands on it to a speck.
fn framed_points(scene: &Scene) -> Vec<DVec3> {
    let all = scene.bounds();
    let limit = 0.3 * all.half_extent(all.longest_axis());
    let box_of = |corners: &[[f32; 3]; 3]| Aabb::of_points(corners);
    // Triangles with a NaN or an infinity are in no bounds.
    let whole = |corners: &[[f32; 3]; 3]| all.contains(&box_of(corners));
    let small = |corners: &[[f32; 3]; 3]| {
        let own = box_of(corners);
        own.half_extent(own.longest_axis()) < limit
    };
    let total = scene.triangles().filter(whole).count();
    let kept = scene.triangles().filter(whole).filter(small).count();
    let leave_out = kept * 10 >= total * 9;
    let chosen = scene.triangles().filter(whole).filter(|corners| !leave_out || small(corners));
    chosen.flatten().map(|point| DVec3::from_array(point.map(f64::from))).collect()
}
