//! Built-in scenes that move.

use super::{AnimationError, Change};
use crate::Scene;
use crate::builtin::{self, carousel};
use std::ffi::OsStr;

/// The frames of a built-in scene.
#[derive(Debug)]
pub(super) struct Builtin(carousel::Motion);

/// Opens `builtin:NAME[:SIZE]`.
pub(super) fn open(scene: &OsStr) -> Result<(Scene, Builtin), AnimationError> {
    let moving = match scene.to_str().and_then(|scene| scene.strip_prefix("builtin:")) {
        Some(name) => builtin::moving(name)?,
        None => None,
    };
    let (scene, motion) =
        moving.ok_or_else(|| AnimationError::NoFrames(scene.to_string_lossy().into_owned()))?;
    Ok((scene, Builtin(motion)))
}

impl Builtin {
    pub(super) fn frames(&self) -> usize {
        carousel::FRAMES
    }

    pub(super) fn set(
        &mut self,
        frame: usize,
        scene: &mut Scene,
    ) -> Result<Change, AnimationError> {
        let (expected, found) = (self.0.vertices(), scene.positions.len());
        if expected != found {
            return Err(AnimationError::AnotherScene { expected, found });
        }
        self.0.set(frame, scene);
        Ok(Change::Positions)
    }

    pub(super) fn time(&self, frame: usize) -> Option<f64> {
        (frame < carousel::FRAMES).then_some(frame as f64 * carousel::SECONDS_PER_FRAME)
    }
}
