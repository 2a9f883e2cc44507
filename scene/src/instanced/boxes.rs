//! A stand-in for a scene of instances: the box of each as twelve triangles.

use super::InstancedScene;
use crate::{Material, Scene};
use splitplane_core::aabb::Aabb;

/// Most boxes.
const MOST: usize = 1 << 15;

pub(super) fn of(scene: &InstancedScene) -> Scene {
    let parts = &scene.parts;
    let bounds: Vec<Aabb> = scene
        .geometries
        .iter()
        .map(|geometry| {
            if let Some(solids) = &geometry.solids {
                let shapes = solids.kind.shapes();
                let all = (0..shapes.len() as u32).filter_map(|number| shapes.bounds(number));
                return all.fold(Aabb::EMPTY, |bounds, own| bounds.union(&own));
            }
            let vertices = geometry.vertices.start as usize..geometry.vertices.end as usize;
            let all = parts.positions.get(vertices).unwrap_or_default().iter();
            let finite = all.filter(|point| point.iter().all(|x| x.is_finite()));
            finite.fold(Aabb::EMPTY, |bounds, point| bounds.union(&Aabb::of_points(&[*point; 3])))
        })
        .collect();
    let mut shown = Scene { name: scene.name.clone(), ..Scene::default() };
    shown.camera = parts.camera;
    shown.lights.clone_from(&parts.lights);
    shown.materials = vec![Material::clay()];
    // More would not change where to look from.
    let stride = scene.instances.len().div_ceil(MOST).max(1);
    for placed in scene.instances.iter().step_by(stride) {
        let Some(own) = bounds.get(placed.geometry as usize).filter(|own| own.lo[0] <= own.hi[0])
        else {
            continue;
        };
        let first = shown.positions.len() as u32;
        for corner in 0..8 {
            let local: [f64; 3] = std::array::from_fn(|k| {
                f64::from(if corner >> k & 1 == 0 { own.lo[k] } else { own.hi[k] })
            });
            shown.positions.push(placed.transform.map(|row| {
                let [a, b, c, d] = row.map(f64::from);
                (((a * local[0] + b * local[1]) + c * local[2]) + d) as f32
            }));
        }
        for [a, b, c, d] in
            [[4, 5, 7, 6], [1, 0, 2, 3], [5, 1, 3, 7], [0, 4, 6, 2], [6, 7, 3, 2], [0, 1, 5, 4]]
        {
            shown.indices.push([a, b, c].map(|i: u32| first + i));
            shown.indices.push([a, c, d].map(|i: u32| first + i));
        }
    }
    shown.material_of = vec![0; shown.indices.len()];
    if shines(scene) {
        shown.materials.push(Material::clay().with_emission([1.0; 3]));
        if let Some(first) = shown.material_of.first_mut() {
            *first = 1;
        }
    }
    shown
}

/// Whether a triangle of an instance shines.
pub(super) fn shines(scene: &InstancedScene) -> bool {
    let parts = &scene.parts;
    let shining: Vec<bool> = parts.materials.iter().map(|material| material.shines()).collect();
    if !shining.contains(&true) {
        return false;
    }
    let is_shining = |material: &u32| shining.get(*material as usize).copied().unwrap_or(false);
    let own: Vec<bool> = scene
        .geometries
        .iter()
        .map(|geometry| {
            if let Some(solids) = &geometry.solids {
                return is_shining(&solids.material);
            }
            let range = geometry.triangles.start as usize..geometry.triangles.end as usize;
            parts.material_of.get(range).unwrap_or_default().iter().any(is_shining)
        })
        .collect();
    scene.instances.iter().any(|placed| match &placed.material {
        Some(material) => is_shining(material),
        None => own.get(placed.geometry as usize).copied().unwrap_or(false),
    })
}
