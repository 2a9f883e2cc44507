//! Normals of smooth surfaces.

use super::Scene;
use glam::DVec3;
#[cfg(feature = "animation")]
use std::collections::HashMap;

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
