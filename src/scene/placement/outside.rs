//! The three-quarter view of an object.

use super::{Placement, View};
use crate::scene::{Camera, Scene};
use glam::DVec3;
use splitplane_core::aabb::Aabb;

/// From the object to the camera.
const TOWARDS_EYE: DVec3 = DVec3::new(0.55, 0.42, 0.72);
const FOV: f64 = 35.0;
/// Part of the picture left free around the object.
const MARGIN: f64 = 1.08;

pub(super) fn place(scene: &Scene, aspect: f64) -> Placement {
    let bounds = framed_bounds(scene);
    let lo = DVec3::from_array(bounds.lo.map(f64::from));
    let hi = DVec3::from_array(bounds.hi.map(f64::from));
    let centre = 0.5 * lo + 0.5 * hi;
    let towards = TOWARDS_EYE.normalize();
    let right = DVec3::Y.cross(towards).normalize();
    let up = towards.cross(right);
    // The least distance from which all eight corners are in the picture.
    let tan = (0.5 * FOV.to_radians()).tan() / MARGIN;
    let distance = (0..8)
        .map(|i| {
            let corner = DVec3::new(
                if i & 1 == 0 { lo.x } else { hi.x },
                if i & 2 == 0 { lo.y } else { hi.y },
                if i & 4 == 0 { lo.z } else { hi.z },
            ) - centre;
            let side = corner.dot(right).abs() / (tan * aspect);
            corner.dot(towards) + side.max(corner.dot(up).abs() / tan)
        })
        .fold(0.0, f64::max);
    // A scene without extent still needs an eye that is not where it looks.
    let least = centre.abs().max_element().max(1e-30) * 1e-5;
    let distance = distance.max(least);
    let eye = centre + towards * distance;
    let light = centre + (towards * 0.7 - right * 0.75 + up * 0.9) * 1.5 * distance;
    Placement {
        camera: camera(eye, centre),
        light: light.as_vec3().to_array(),
        view: View::Outside,
    }
}

/// Positions near the end of the range of f32 leave no room for an eye outside; then any camera
/// does.
fn camera(eye: DVec3, centre: DVec3) -> Camera {
    let [eye, at] = [eye, centre].map(|p| p.as_vec3().to_array());
    let up = [0.0, 1.0, 0.0];
    Camera::new(eye, at, up, FOV as f32)
        .or_else(|_| Camera::new([0.0, 0.0, 1.0], [0.0; 3], up, FOV as f32))
        .unwrap_or_else(|_| unreachable!("constants that make a camera"))
}

/// The bounds to put in the picture: those of all triangles, without the few that are as large as
/// the scene itself. A ground plane would else shrink what stands on it to a speck.
fn framed_bounds(scene: &Scene) -> Aabb {
    let all = scene.bounds();
    if all.is_empty() {
        return Aabb { lo: [-1.0; 3], hi: [1.0; 3] };
    }
    let limit = 0.3 * all.half_extent(all.longest_axis());
    let (mut rest, mut kept, mut total) = (Aabb::EMPTY, 0usize, 0usize);
    for corners in scene.triangles() {
        let own = Aabb::of_points(&corners);
        total += 1;
        if all.contains(&own) && own.half_extent(own.longest_axis()) < limit {
            rest = rest.union(&own);
            kept += 1;
        }
    }
    if kept * 10 >= total * 9 { rest } else { all }
}
