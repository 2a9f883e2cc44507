//! Normals of smooth surfaces.

use super::Scene;
use glam::DVec3;
#[cfg(feature = "animation")]
use std::collections::HashMap;

/// A direction at length 1, rounded once; as it is where it has none.
#[cfg(feature = "obj")]
pub(super) fn unit(direction: [f64; 3]) -> [f32; 3] {
    let wide = DVec3::from_array(direction);
    wide.try_normalize().map_or(direction.map(|x| x as f32), |unit| unit.as_vec3().to_array())
}

/// Removes the corners' indices of normals and texture coordinates that cannot be used, and counts those.
#[cfg(feature = "obj")]
pub(super) fn leave_out_unusable(scene: &mut Scene) {
    let Scene { indices, normals, normal_indices, texcoords, texcoord_indices, notes, .. } = scene;
    let unusable = |normal: &[f32; 3]| {
        let wide = DVec3::from_array(normal.map(f64::from));
        !(wide.is_finite() && wide != DVec3::ZERO)
    };
    notes.unusable_normals = leave_out(normals, normal_indices, unusable, indices.len());
    let unusable = |texcoord: &[f32; 2]| !texcoord.iter().all(|x| x.is_finite());
    notes.unusable_texcoords = leave_out(texcoords, texcoord_indices, unusable, indices.len());
}

/// Brings the corners' indices to one entry per triangle, if there are any, and removes those of
/// values that cannot be used. Returns how many such values there are.
#[cfg(feature = "obj")]
fn leave_out<T>(
    values: &[T],
    corners: &mut Vec<[u32; 3]>,
    unusable: impl Fn(&T) -> bool,
    triangles: usize,
) -> u64 {
    if !corners.is_empty() {
        corners.resize(triangles, [Scene::NONE; 3]);
    }
    let count = values.iter().filter(|value| unusable(value)).count() as u64;
    if count > 0 {
        for corner in corners.as_flattened_mut() {
            if values.get(*corner as usize).is_some_and(&unusable) {
                *corner = Scene::NONE;
            }
        }
    }
    count
}

/// Makes normals that are named at several vertices into one for each, so that [`smooth`] joins only
/// triangles around a vertex, and of these only those that shared a normal before: sharp edges stay.
#[cfg(feature = "animation")]
pub(super) fn separate(scene: &mut Scene) {
    let mut normals = Vec::with_capacity(scene.normals.len());
    let mut places: HashMap<[u32; 2], u32> = HashMap::new();
    for (corners, named) in scene.indices.iter().zip(&mut scene.normal_indices) {
        for (&vertex, normal) in corners.iter().zip(named) {
            let Some(&direction) = scene.normals.get(*normal as usize) else { continue };
            *normal = *places.entry([vertex, *normal]).or_insert_with(|| {
                normals.push(direction);
                normals.len() as u32 - 1
            });
        }
    }
    scene.normals = normals;
}

/// Gives every normal that a triangle from `first` on names the mean of those triangles' own
/// normals, each weighted by its triangle's area. `sums` is memory to work in. A normal whose
/// triangles have no area keeps its value.
pub(super) fn smooth(scene: &mut Scene, first: usize, sums: &mut Vec<DVec3>) {
    sums.clear();
    sums.resize(scene.normals.len(), DVec3::ZERO);
    let triangles = scene.indices.iter().zip(&scene.normal_indices).skip(first);
    for (corners, normals) in triangles {
        let position = |vertex: u32| scene.positions.get(vertex as usize).copied();
        let [Some(a), Some(b), Some(c)] = corners.map(position) else { continue };
        let [a, b, c] = [a, b, c].map(|p| DVec3::from_array(p.map(f64::from)));
        // Twice the area long.
        let across = (b - a).cross(c - a);
        for &normal in normals {
            if let Some(sum) = sums.get_mut(normal as usize) {
                *sum += across;
            }
        }
    }
    for (normal, sum) in scene.normals.iter_mut().zip(sums) {
        if let Some(unit) = sum.try_normalize() {
            *normal = unit.as_vec3().to_array();
        }
    }
}
