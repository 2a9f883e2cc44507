//! Scenes of many objects: batches compared with all instances asked one after the other.
//!
//! That is what every path through a scene is held to ([`BuiltScene::answer_by_all`]): it uses neither the tree over instances nor their
//! boxes. Each geometry's own answers are for [`check`](crate::check).

use rayon::prelude::*;
use splitplane_core::backend::scene::{BuiltScene, SceneAccelerator};
use splitplane_core::error::QueryError;
use splitplane_core::random::{hash, unit};
use splitplane_core::ray::Ray;
use splitplane_core::scene::{InstanceId, Placement, SceneHit, SceneOptions};

/// Rays of a batch.
const BATCH: u64 = 1 << 12;
/// Instances that are asked, all rays together.
const ASKED: u64 = 20_000_000;
const SEED: u64 = 2003;

/// What a check of a scene found.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct ObjectsReport {
    /// Rays that were compared.
    pub rays: u64,
    /// Rays that hit something.
    pub hits: u64,
    /// Rays whose closest hit differs, or whose answer of any hit contradicts it.
    pub different: u64,
    /// The first of them, in words that allow to repeat it.
    pub first: Option<String>,
}

/// Compares the answers to `rays` rays, or to as many as can be asked of all instances in a while: 20 million instances are asked in
/// all. Half of the rays come from outside, half from one object to another. `progress` is called with the number of
/// rays of every batch.
///
/// # Errors
/// The scene refuses the rays.
pub fn check_objects(
    scene: &dyn SceneAccelerator,
    rays: u64,
    options: &SceneOptions<'_>,
    progress: &dyn Fn(u64),
) -> Result<ObjectsReport, QueryError> {
    let mut report = ObjectsReport::default();
    let built = scene.scene();
    let generator = Generator::new(built);
    let count = rays_of(rays, generator.places.len());
    for first in (0..count).step_by(BATCH as usize) {
        let numbers = first..count.min(first + BATCH);
        let rays: Vec<Ray> = numbers.into_par_iter().map(|number| generator.ray(number)).collect();
        let mut hits = vec![SceneHit::MISS; rays.len()];
        scene.closest_hits(&rays, &mut hits, options)?;
        let mut any = vec![false; rays.len()];
        scene.any_hits(&rays, &mut any, options)?;
        let all: Vec<SceneHit> =
            rays.par_iter().map(|ray| built.answer_by_all(ray, options)).collect();
        for (number, (ray, hit)) in rays.iter().zip(&hits).enumerate() {
            report.rays += 1;
            report.hits += u64::from(all[number].is_hit());
            if bits(hit) != bits(&all[number]) || any[number] != all[number].is_hit() {
                report.different += 1;
                report.first.get_or_insert_with(|| {
                    let (right, any) = (all[number], any[number]);
                    format!("{ray:?}: {hit:?} and {any} where all instances give {right:?}")
                });
            }
        }
        progress(rays.len() as u64);
    }
    Ok(report)
}

/// How many rays [`check_objects`] compares where so many are asked for.
pub fn rays_of(rays: u64, instances: usize) -> u64 {
    match instances as u64 {
        0 => 0,
        instances => rays.min((ASKED / instances).max(16)),
    }
}

fn bits(hit: &SceneHit) -> [u32; 6] {
    let SceneHit { t, u, v, triangle, geometry, instance } = *hit;
    [t.to_bits(), u.to_bits(), v.to_bits(), triangle, geometry, instance]
}

/// The rays of a check, each a function of its number.
struct Generator<'a> {
    scene: &'a BuiltScene,
    places: Vec<(InstanceId, &'a Placement)>,
    centre: [f64; 3],
    radius: f64,
}

impl Generator<'_> {
    fn new(scene: &BuiltScene) -> Generator<'_> {
        let places: Vec<_> = scene.placements().collect();
        let (mut lo, mut hi) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
        for (_, placement) in &places {
            let Some(own) = placement.world_box else { continue };
            for axis in 0..3 {
                let ends = [own.bounds.lo[axis], own.bounds.hi[axis]].map(f64::from);
                // A box that is everywhere says nothing of where the scene is.
                if ends.iter().all(|end| end.is_finite()) {
                    lo[axis] = lo[axis].min(ends[0]);
                    hi[axis] = hi[axis].max(ends[1]);
                }
            }
        }
        let known = (0..3).all(|axis| lo[axis] <= hi[axis]);
        let (lo, hi) = if known { (lo, hi) } else { ([-1.0; 3], [1.0; 3]) };
        let centre = [0, 1, 2].map(|k| 0.5 * lo[k] + 0.5 * hi[k]);
        let radius = [0, 1, 2].map(|k| (hi[k] - centre[k]).powi(2)).iter().sum::<f64>().sqrt();
        Generator { scene, places, centre, radius }
    }

    /// There is an instance.
    fn ray(&self, number: u64) -> Ray {
        let to = self.point(number, 0);
        let from = if number.is_multiple_of(2) {
            let z = 2.0 * unit(SEED, &[number, 20]) - 1.0;
            let turn = core::f64::consts::TAU * unit(SEED, &[number, 21]);
            let across = (1.0 - z * z).max(0.0).sqrt();
            let out = [across * turn.cos(), across * turn.sin(), z];
            [0, 1, 2].map(|k| self.centre[k] + 1.5 * self.radius * out[k])
        } else {
            self.point(number, 1)
        };
        let (origin, to) = (from.map(|x| x as f32), to.map(|x| x as f32));
        Ray::new(origin, [0, 1, 2].map(|k| to[k] - origin[k]))
    }

    /// A point of a triangle of some instance, or in the box of its shapes.
    fn point(&self, number: u64, end: u64) -> [f64; 3] {
        let draw = |k: u64| unit(SEED, &[number, end, k]);
        let pick = |k: u64, of: u64| hash(SEED, &[number, end, k]) % of;
        let (_, placement) = self.places[pick(0, self.places.len() as u64) as usize];
        let geometry = self.scene.geometry(placement.instance.geometry);
        let mesh = geometry.map(|own| own.mesh().mesh());
        let local = match mesh.filter(|mesh| !mesh.is_empty()) {
            Some(mesh) => {
                let corners = mesh.triangle(pick(1, mesh.len() as u64) as usize);
                let (mut u, mut v) = (draw(2), draw(3));
                if u + v > 1.0 {
                    (u, v) = (1.0 - u, 1.0 - v);
                }
                let [a, b, c] = corners.map(|corner| corner.map(f64::from));
                [0, 1, 2].map(|k| (1.0 - u - v) * a[k] + u * b[k] + v * c[k])
            }
            None => {
                let [lo, hi] = [placement.bounds.lo, placement.bounds.hi].map(|x| x.map(f64::from));
                [0, 1, 2].map(|k| lo[k] + draw(2 + k as u64) * (hi[k] - lo[k]))
            }
        };
        placement.instance.transform.map(|row| {
            let [a, b, c, d] = row.map(f64::from);
            ((a * local[0] + b * local[1]) + c * local[2]) + d
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use splitplane_core::backend::BuildOptions;
    use splitplane_core::backend::scene::{BuildGeometry, UpdateReport};
    use splitplane_core::scene::{Scene, SceneBuildError, SceneReport};

    /// A scene that answers one ray of each batch wrongly: its closest hit, or whether there is one.
    struct Wrong(BuiltScene, bool);

    impl SceneAccelerator for Wrong {
        fn scene(&self) -> &BuiltScene {
            &self.0
        }

        fn update_by(
            &mut self,
            scene: &Scene,
            options: &BuildOptions<'_>,
            build: &mut BuildGeometry<'_>,
        ) -> Result<UpdateReport, SceneBuildError> {
            self.0.update(scene, options, build)
        }

        fn closest_hits(
            &self,
            rays: &[Ray],
            hits: &mut [SceneHit],
            options: &SceneOptions<'_>,
        ) -> Result<SceneReport, QueryError> {
            let report = self.0.answer_in_waves(rays, hits, options)?;
            if let Some(hit) = hits.iter_mut().find(|hit| hit.is_hit()).filter(|_| !self.1) {
                hit.t = hit.t.next_up();
            }
            Ok(report)
        }

        fn any_hits(
            &self,
            rays: &[Ray],
            occluded: &mut [bool],
            options: &SceneOptions<'_>,
        ) -> Result<SceneReport, QueryError> {
            let report = self.0.answer_in_waves(rays, occluded, options)?;
            if self.1 {
                occluded[0] = !occluded[0];
            }
            Ok(report)
        }
    }

    fn scene() -> BuiltScene {
        use splitplane_core::scene::shape::{Shapes, Sphere};
        use splitplane_core::scene::{Instance, translation};
        let mut scene = Scene::new();
        let ball = Sphere { centre: [0.0; 3], radius: 1.0 };
        let geometry = scene.add_shapes(Shapes::Spheres(vec![ball])).unwrap();
        for at in 0..5 {
            let place = translation([2.5 * at as f32, (at % 2) as f32, 0.0]);
            scene.add_instance(Instance::new(geometry, place)).unwrap();
        }
        let build = &mut |_: &splitplane_core::mesh::Mesh<'_>, _: &BuildOptions<'_>| unreachable!();
        BuiltScene::build(&scene, &BuildOptions::default(), build).unwrap()
    }

    #[test]
    fn one_wrong_answer_is_found() {
        for any in [false, true] {
            let wrong = Wrong(scene(), any);
            let report = check_objects(&wrong, 500, &SceneOptions::default(), &|_| ()).unwrap();
            assert_eq!((report.rays, report.different), (500, 1), "{report:?}");
            assert!(report.first.is_some() && report.hits > 100, "{report:?}");
        }
    }

    #[test]
    fn right_answers_pass() {
        use splitplane_core::backend::scene::HostScene;
        let mut host = HostScene::default();
        assert_eq!(check_objects(&host, 9, &SceneOptions::default(), &|_| ()).unwrap().rays, 0);
        let mut description = Scene::new();
        let build = &mut |_: &splitplane_core::mesh::Mesh<'_>, _: &BuildOptions<'_>| unreachable!();
        host.update_by(&description, &BuildOptions::default(), build).unwrap();
        use splitplane_core::scene::shape::{Capsule, Shapes};
        use splitplane_core::scene::{IDENTITY, Instance};
        let capsule = Capsule { ends: [[0.0; 3], [1.0, 2.0, 0.0]], radius: 0.5 };
        let geometry = description.add_shapes(Shapes::Capsules(vec![capsule])).unwrap();
        description.add_instance(Instance::new(geometry, IDENTITY)).unwrap();
        host.update_by(&description, &BuildOptions::default(), build).unwrap();
        let report = check_objects(&host, 300, &SceneOptions::default(), &|_| ()).unwrap();
        assert_eq!((report.rays, report.different), (300, 0), "{report:?}");
        assert!(report.hits > 50);
    }

    #[test]
    fn rays_are_as_many_as_can_be_asked() {
        assert_eq!(rays_of(100, 0), 0);
        assert_eq!(rays_of(100, 7), 100);
        assert_eq!(rays_of(1_000_000, 1000), 20_000);
        assert_eq!(rays_of(1_000_000, 1 << 28), 16);
    }
}
