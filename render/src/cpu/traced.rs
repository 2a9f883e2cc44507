//! What answers the rays of a frame: the tree of one mesh, or a scene of instances.

use crate::scene_data::instances::InstanceTable;
use core::sync::atomic::AtomicU64;
use core::sync::atomic::Ordering::Relaxed;
use rayon::prelude::*;
use splitplane_core::aabb::Aabb;
use splitplane_core::backend::Accelerator;
use splitplane_core::backend::scene::SceneAccelerator;
use splitplane_core::error::QueryError;
use splitplane_core::ray::{Hit, QueryOptions, Ray, Undecided};
use splitplane_core::report::QueryReport;
use splitplane_core::scene::{SceneHit, SceneOptions};

#[derive(Clone, Copy)]
pub(crate) enum Traced<'a> {
    /// And what the CPU did for a device.
    Mesh(&'a dyn Accelerator, Option<&'a ByCpu>),
    Scene(&'a dyn SceneAccelerator, &'a InstanceTable, &'a ByCpu),
}

/// Rays that the CPU had a part in, where a device traces.
#[derive(Debug, Default)]
pub(crate) struct ByCpu {
    /// Those for which it found the instances that they enter.
    pub(crate) placed: AtomicU64,
    /// Those that it traced, since the device left them undecided or unfinished.
    pub(crate) redone: AtomicU64,
}

impl ByCpu {
    fn note(&self, report: &QueryReport) {
        self.redone.fetch_add(report.answered_by_cpu, Relaxed);
    }
}

/// The settings of a frame's rays for a mesh: a picture needs all answers, so nothing is left undecided.
fn of_mesh<'a>(options: &QueryOptions<'a>) -> QueryOptions<'a> {
    QueryOptions { undecided: Undecided::default(), ..*options }
}

/// The settings of a frame's rays for a scene.
pub(super) fn of_scene<'a>(options: &QueryOptions<'a>) -> SceneOptions<'a> {
    SceneOptions {
        accuracy: options.accuracy,
        culling: options.culling,
        watch: options.watch,
        ..SceneOptions::default()
    }
}

impl Traced<'_> {
    /// A box around all that is shown.
    pub(crate) fn bounds(self) -> Aabb {
        match self {
            Traced::Mesh(accelerator, _) => accelerator.tree().bounds,
            Traced::Scene(scene, table, _) => {
                let mut all = Aabb::EMPTY;
                for (name, placement) in scene.scene().placements() {
                    if let Some(shown) = table.shown(name.0) {
                        all = all.union(&shown.box_in_world(&placement.bounds));
                    }
                }
                all
            }
        }
    }

    /// The closest hits; of a scene also their instances, in as many words.
    pub(crate) fn closest_hits(
        self,
        rays: &[Ray],
        hits: &mut [Hit],
        (scene_hits, instances): (&mut Vec<SceneHit>, &mut Vec<u32>),
        options: &QueryOptions<'_>,
    ) -> Result<(), QueryError> {
        instances.clear();
        match self {
            Traced::Mesh(accelerator, by_cpu) => {
                let report = accelerator.closest_hits(rays, hits, &of_mesh(options))?;
                by_cpu.inspect(|by_cpu| by_cpu.note(&report));
            }
            Traced::Scene(scene, _, by_cpu) => {
                scene_hits.clear();
                scene_hits.resize(rays.len(), SceneHit::MISS);
                let report = scene.closest_hits(rays, scene_hits, &of_scene(options))?;
                by_cpu.placed.fetch_add(report.placed_by_cpu, Relaxed);
                instances.resize(rays.len(), 0);
                let to = hits.par_iter_mut().zip(instances.par_iter_mut());
                to.zip(&*scene_hits).with_min_len(4096).for_each(|((hit, instance), met)| {
                    let SceneHit { t, u, v, triangle, .. } = *met;
                    (*hit, *instance) = (Hit { t, triangle, u, v }, met.instance);
                });
            }
        }
        Ok(())
    }

    pub(crate) fn any_hits(
        self,
        rays: &[Ray],
        occluded: &mut [bool],
        options: &QueryOptions<'_>,
    ) -> Result<(), QueryError> {
        match self {
            Traced::Mesh(accelerator, by_cpu) => {
                let report = accelerator.any_hits(rays, occluded, &of_mesh(options))?;
                by_cpu.inspect(|by_cpu| by_cpu.note(&report));
            }
            Traced::Scene(scene, _, by_cpu) => {
                let report = scene.any_hits(rays, occluded, &of_scene(options))?;
                by_cpu.placed.fetch_add(report.placed_by_cpu, Relaxed);
            }
        }
        Ok(())
    }
}
