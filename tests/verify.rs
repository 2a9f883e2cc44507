//! The check against the reference passes sound answers, and each kind of wrong answer fails it.

use splitplane::scene::Scene;
use splitplane::verify::{Report, check};
use splitplane::{
    Accelerator, AllHits, AllHitsOptions, Backend, BuildOptions, BuildSummary, CpuBackend, Hit,
    KdTree, Mesh, QueryError, QueryOptions, QueryReport, Ray,
};

/// Answers of a sound accelerator, changed.
struct Damaged<F> {
    sound: Box<dyn Accelerator>,
    change: F,
}

impl<F: Fn(&Ray, Hit) -> Hit + Send + Sync> Accelerator for Damaged<F> {
    fn tree(&self) -> &KdTree {
        self.sound.tree()
    }
    fn summary(&self) -> &BuildSummary {
        self.sound.summary()
    }
    fn query_bytes(&self) -> u64 {
        self.sound.query_bytes()
    }
    fn closest_hits(
        &self,
        rays: &[Ray],
        hits: &mut [Hit],
        options: &QueryOptions<'_>,
    ) -> Result<QueryReport, QueryError> {
        self.sound.closest_hits(rays, hits, options)?;
        for (ray, hit) in rays.iter().zip(hits) {
            *hit = (self.change)(ray, *hit);
        }
        Ok(QueryReport::default())
    }
    fn any_hits(
        &self,
        rays: &[Ray],
        occluded: &mut [bool],
        options: &QueryOptions<'_>,
    ) -> Result<QueryReport, QueryError> {
        let mut hits = vec![Hit::MISS; rays.len()];
        self.closest_hits(rays, &mut hits, options)?;
        for (occluded, hit) in occluded.iter_mut().zip(hits) {
            *occluded = hit.is_hit();
        }
        Ok(QueryReport::default())
    }
    fn all_hits(&self, rays: &[Ray], options: &AllHitsOptions<'_>) -> Result<AllHits, QueryError> {
        self.sound.all_hits(rays, options)
    }
    fn closest_hit(&self, ray: &Ray, options: &QueryOptions<'_>) -> Option<Hit> {
        (self.change)(ray, self.sound.closest_hit(ray, options).unwrap_or(Hit::MISS)).some()
    }
    fn any_hit(&self, ray: &Ray, options: &QueryOptions<'_>) -> bool {
        self.closest_hit(ray, options).is_some()
    }
}

/// The report on a city whose answers were changed.
fn report(change: impl Fn(&Ray, Hit) -> Hit + Send + Sync) -> Report {
    let scene = Scene::open("builtin:city:2000").unwrap();
    let mesh: Mesh<'_> = scene.mesh().unwrap();
    let sound = CpuBackend::new().build(&mesh, &BuildOptions::default()).unwrap();
    check(&Damaged { sound, change }, &mesh, 4000, &QueryOptions::default(), &|_| ()).unwrap()
}

#[test]
fn sound_answers_pass() {
    let report = report(|_, hit| hit);
    assert_eq!(report.rays, 12_000);
    assert!(report.passed(), "{report:?}");
    assert!(report.spot_checks > 0);
}

#[test]
fn a_lost_triangle_is_noticed() {
    let report = report(|_, hit| if hit.triangle % 97 == 5 { Hit::MISS } else { hit });
    assert!(report.misses > 0 && report.unexplained > 0, "{report:?}");
}

#[test]
fn a_wrong_distance_is_noticed() {
    let report = report(|_, hit| Hit { t: hit.t * 1.001, ..hit });
    assert!(report.unexplained > 1000, "{report:?}");
}

#[test]
fn a_wrong_triangle_is_noticed() {
    let report = report(|_, hit| match hit.some() {
        Some(hit) => Hit { triangle: hit.triangle ^ 64, ..hit },
        None => Hit::MISS,
    });
    assert!(report.unexplained > 1000, "{report:?}");
}

#[test]
fn an_invented_hit_is_noticed() {
    let invented = Hit { t: 0.5, triangle: 3, u: 0.25, v: 0.25 };
    let report = report(|_, hit| if hit.is_hit() { hit } else { invented });
    assert!(report.phantoms > 0 && report.unexplained > 0, "{report:?}");
}

#[test]
fn a_triangle_that_does_not_exist_is_noticed() {
    let report = report(|_, hit| Hit { triangle: hit.triangle.min(Hit::UNDECIDED - 1), ..hit });
    assert!(report.phantoms > 1000 && report.unexplained > 1000, "{report:?}");
}

/// On a closed surface seen from within, nothing may be lost, however the ray is aimed.
#[test]
fn a_closed_sphere_has_no_holes() {
    let whole = Scene::open("builtin:spheres").unwrap();
    let first = whole.material_of.iter().position(|&m| m != 0).unwrap();
    let sphere: Vec<[u32; 3]> = whole.indices[first..first + 4 * 36 * 35].to_vec();
    let mesh = Mesh::indexed(&whole.positions, &sphere).unwrap();
    let accelerator = CpuBackend::new().build(&mesh, &BuildOptions::default()).unwrap();
    let options = QueryOptions::default();
    let report = check(accelerator.as_ref(), &mesh, 20_000, &options, &|_| ()).unwrap();
    assert!(report.passed(), "{report:?}");
}
