//! Copies of a mesh on a grid, by the rule of the harness that `scripts/measure_peers.sh` starts, for both contestants.

use std::sync::Arc;
use std::time::Duration;

use splitplane_core::aabb::Aabb;
use splitplane_core::backend::scene::SceneAccelerator;
use splitplane_core::backend::{Backend, BuildOptions};
use splitplane_core::mesh::Mesh;
use splitplane_core::ray::Ray;
use splitplane_core::scene::{
    GeometryId, Instance, Scene, SceneBuildError, SceneError, SceneHit, SceneOptions, Transform,
};
use splitplane_cpu::CpuBackend;

use crate::rays::{Random, Vector, add, dot, scaled, sub, wide};
use crate::turns::{Answers, Contestant, cpu_time};

const SEED: u64 = 44;

/// `N` from `grid:N`.
///
/// # Errors
/// Another text, or no copies.
pub(crate) fn recipe(text: &str) -> Result<usize, String> {
    let count = text.strip_prefix("grid:").and_then(|count| count.parse().ok());
    count.filter(|&count| count > 0).ok_or_else(|| format!("{text}: should be grid:N"))
}

/// So many places on a cubic grid as wide as the mesh's diagonal is long, filled along x, z, y; each moved by up to a quarter of a
/// cell, turned about y and scaled by 0.5 to 1.5 about the middle of the mesh.
pub(crate) fn grid(bounds: &Aabb, count: usize) -> Vec<Transform> {
    let (lo, hi) = (wide(bounds.lo), wide(bounds.hi));
    let (centre, size) = (scaled(add(lo, hi), 0.5), sub(hi, lo));
    let cell = dot(size, size).sqrt();
    let side = (1..).find(|side: &usize| side.pow(3) >= count).unwrap_or(1);
    let place = |number: usize| {
        let mut random = Random::new(SEED, number as u64);
        let at = [number % side, number / side / side, number / side % side];
        let middle = 0.5 * (side - 1) as f64;
        let to = at.map(|x| (x as f64 - middle + 0.25 * random.signed()) * cell);
        let (x, y) = loop {
            let (x, y) = random.in_disk();
            if x * x + y * y > 1e-4 {
                break (x, y);
            }
        };
        let length = (x * x + y * y).sqrt();
        let scale = 1.0 + 0.5 * random.signed();
        let (c, s) = (scale * x / length, scale * y / length);
        let rows = [[c, 0.0, s], [0.0, scale, 0.0], [-s, 0.0, c]];
        let shift = sub(add(centre, to), rows.map(|row| dot(row, centre)));
        std::array::from_fn(|i| {
            let [x, y, z] = rows[i];
            [x, y, z, shift[i]].map(|number| number as f32)
        })
    };
    (0..count).map(place).collect()
}

/// Where a transform puts a point.
pub(crate) fn in_world(transform: &Transform, [x, y, z]: Vector) -> Vector {
    transform.map(|row| {
        let [a, b, c, d] = row.map(f64::from);
        a * x + b * y + c * z + d
    })
}

/// The box of the corners of the mesh's box, where the transforms put them.
pub(crate) fn bounds(mesh: &Aabb, places: &[Transform]) -> Aabb {
    let mut all = Aabb::EMPTY;
    for transform in places {
        for corner in 0..8 {
            let end = |axis: usize| if corner >> axis & 1 == 1 { mesh.hi } else { mesh.lo };
            let at = in_world(transform, [0, 1, 2].map(|axis| f64::from(end(axis)[axis])));
            let [lo, hi] = [f32::next_down, f32::next_up].map(|round| at.map(|x| round(x as f32)));
            all = all.union(&Aabb { lo, hi });
        }
    }
    all
}

/// A scene of the mesh at these places.
///
/// # Errors
/// What the scene refuses.
pub(crate) fn scene(mesh: &Mesh<'_>, places: &[Transform]) -> Result<Scene, SceneError> {
    let mut scene = Scene::new();
    scene.add_mesh(mesh)?;
    attach(&mut scene, places)?;
    Ok(scene)
}

fn attach(scene: &mut Scene, places: &[Transform]) -> Result<(), SceneError> {
    for &transform in places {
        scene.add_instance(Instance::new(GeometryId(0), transform))?;
    }
    Ok(())
}

/// The CPU time that an update takes which finds a built mesh and all instances new.
///
/// # Errors
/// What the scene or the backend refuses.
pub(crate) fn placing(
    backend: &CpuBackend,
    mesh: &Mesh<'_>,
    places: &[Transform],
    options: &BuildOptions<'_>,
    pool: &rayon::ThreadPool,
) -> Result<Duration, Box<dyn std::error::Error>> {
    let mut scene = scene(mesh, &[])?;
    let mut built = pool.install(|| backend.build_scene(&scene, options))?;
    attach(&mut scene, places)?;
    let before = cpu_time();
    pool.install(|| backend.update_scene(&mut built, &scene, options))?;
    Ok(cpu_time() - before)
}

/// A scene of ours.
///
/// # Errors
/// What the backend refuses.
pub(crate) fn ours<'a>(
    name: String,
    backend: &CpuBackend,
    scene: &Scene,
    (options, single): (&BuildOptions<'_>, bool),
    pool: &'a rayon::ThreadPool,
) -> Result<(Contestant<'a>, Arc<dyn SceneAccelerator>), SceneBuildError> {
    let built: Arc<dyn SceneAccelerator> =
        pool.install(|| backend.build_scene(scene, options)).map(Arc::from)?;
    let (one, other) = (Arc::clone(&built), Arc::clone(&built));
    let asked = SceneOptions::default();
    let closest = move |rays: &[Ray], found: &mut Answers| {
        if single {
            for (found, ray) in found.iter_mut().zip(rays) {
                let hit = one.closest_hit(ray, &asked).unwrap_or(SceneHit::MISS);
                *found = (hit.t, hit.triangle);
            }
            return;
        }
        let mut hits = vec![SceneHit::MISS; rays.len()];
        pool.install(|| one.closest_hits(rays, &mut hits, &asked)).expect("as many hits as rays");
        for (found, hit) in found.iter_mut().zip(&hits) {
            *found = (hit.t, hit.triangle);
        }
    };
    let any = move |rays: &[Ray], found: &mut [bool]| {
        if single {
            for (found, ray) in found.iter_mut().zip(rays) {
                *found = other.any_hit(ray, &asked);
            }
            return;
        }
        pool.install(|| other.any_hits(rays, found, &asked)).expect("as many answers as rays");
    };
    let ready = Box::new(|_: &[Ray]| ());
    Ok((Contestant { name, ready, closest: Box::new(closest), any: Box::new(any) }, built))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn recipes_are_told() {
        assert_eq!(recipe("grid:8"), Ok(8));
        assert!(recipe("grid:0").is_err() && recipe("ring:8").is_err());
    }

    /// Cells are as wide as the diagonal: so a turned box stays in its own by less than its size.
    #[test]
    fn places_are_on_a_grid() {
        let mesh = Aabb { lo: [1.0, 0.0, 0.0], hi: [3.0, 2.0, 1.0] };
        let places = grid(&mesh, 27);
        for (number, place) in places.iter().enumerate() {
            let middle = in_world(place, [2.0, 1.0, 0.5]);
            let cell = [number % 3, number / 9, number / 3 % 3].map(|x| (x as f64 - 1.0) * 3.0);
            let off = sub(sub(middle, [2.0, 1.0, 0.5]), cell);
            assert!(off.iter().all(|x| x.abs() <= 0.7501), "{number}: {off:?}");
        }
        let all = bounds(&mesh, &places);
        assert!((0..3).all(|axis| all.hi[axis] - all.lo[axis] > 6.0));
    }
}
