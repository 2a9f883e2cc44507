//! Scenes of any backend: the host finds the instances, the geometries' batches answer.

use super::accelerator::SceneAccelerator;
use super::block::{Block, BlockScratch, SceneAnswer};
use super::built::{BuildGeometry, BuiltScene};
use super::update::UpdateReport;
use super::within::Within;
use crate::backend::BuildOptions;
use crate::cancel::go_on_tracing;
use crate::error::QueryError;
use crate::ray::Ray;
use crate::scene::{ScalarWalker, Scene, SceneBuildError, SceneHit, SceneOptions, SceneReport};
use crate::watch::Watch;

/// Rays of a block at most: devices want many at a time.
const BLOCK: usize = 1 << 16;
/// Bytes of a block's stacks at most.
const STACKS: usize = 1 << 25;

/// A scene whose batches go, geometry by geometry, to the accelerators of a backend. The host finds which instances each ray
/// enters, on the calling thread; the report counts the rays. What every backend does that has nothing better.
#[derive(Default)]
pub struct HostScene {
    built: BuiltScene,
}

impl HostScene {
    /// Builds a scene.
    ///
    /// # Errors
    /// As for [`BuiltScene::build`].
    pub fn build(
        scene: &Scene,
        options: &BuildOptions<'_>,
        build: &mut BuildGeometry<'_>,
    ) -> Result<HostScene, SceneBuildError> {
        Ok(HostScene { built: BuiltScene::build(scene, options, build)? })
    }
}

impl BuiltScene {
    /// Answers a batch in waves: the calling thread finds which instances each ray enters, the geometries' accelerators answer.
    ///
    /// # Errors
    /// As for [`SceneAccelerator::closest_hits`].
    pub fn answer_in_waves<T: SceneAnswer>(
        &self,
        rays: &[Ray],
        answers: &mut [T],
        options: &SceneOptions<'_>,
    ) -> Result<SceneReport, QueryError> {
        check(rays.len(), answers.len())?;
        let (mut report, mut scratch) = (SceneReport::default(), BlockScratch::default());
        let size = (STACKS / self.stack_bytes().max(1)).clamp(64, BLOCK);
        let (mut done, total) = (0, rays.len() as u64);
        for (rays, answers) in rays.chunks(size).zip(answers.chunks_mut(size)) {
            let within = options.watch.map(|watch| Within { watch, done, total });
            let watch: Option<&dyn Watch> = match &within {
                Some(watch) => Some(watch),
                None => None,
            };
            let block = Block { scene: self, rays, options, watch, singly_below: 0 };
            let mut go_on = || go_on_tracing(options.watch, done, total);
            let part = block.answer(&mut ScalarWalker, &mut scratch, answers, &mut go_on);
            report.add(part.map_err(|error| match error {
                QueryError::Cancelled { .. } => QueryError::Cancelled { done, total },
                error => error,
            })?)?;
            done += rays.len() as u64;
        }
        report.placed_by_cpu = total;
        go_on_tracing(options.watch, done, total)?;
        Ok(report)
    }
}

/// Rays and answers are as many.
fn check(rays: usize, results: usize) -> Result<(), QueryError> {
    if rays == results { Ok(()) } else { Err(QueryError::LengthMismatch { rays, results }) }
}

impl SceneAccelerator for HostScene {
    fn scene(&self) -> &BuiltScene {
        &self.built
    }

    fn placed_by_cpu(&self) -> Option<&str> {
        Some("the backend has no scenes of its own")
    }

    fn update_by(
        &mut self,
        scene: &Scene,
        options: &BuildOptions<'_>,
        build: &mut BuildGeometry<'_>,
    ) -> Result<UpdateReport, SceneBuildError> {
        self.built.update(scene, options, build)
    }

    fn closest_hits(
        &self,
        rays: &[Ray],
        hits: &mut [SceneHit],
        options: &SceneOptions<'_>,
    ) -> Result<SceneReport, QueryError> {
        self.built.answer_in_waves(rays, hits, options)
    }

    fn any_hits(
        &self,
        rays: &[Ray],
        occluded: &mut [bool],
        options: &SceneOptions<'_>,
    ) -> Result<SceneReport, QueryError> {
        self.built.answer_in_waves(rays, occluded, options)
    }
}
