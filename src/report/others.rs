//! Times of other builders on the rays of a report, taken by another program and read from its file.

use super::ReportError;
use super::scene::SceneReport;
use crate::from_file::{self, quoted, quoted_reason};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// The one version of the file's format.
pub const FORMAT: u32 = 1;

/// Greatest file that is read, in bytes; a scene takes a few hundred.
const MOST: u64 = 16 << 20;

/// What a file says.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Others {
    /// [`FORMAT`].
    pub format: u32,
    /// Who built, as a table names it: a structure, and the crate with its version.
    pub builder: String,
    /// Threads.
    pub threads: usize,
    /// Runs of which the medians are given.
    pub repeat: usize,
    /// The scenes.
    pub scenes: Vec<OtherScene>,
}

/// Times of a scene in milliseconds.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct OtherScene {
    /// The scene's name in a report.
    pub scene: String,
    /// Its triangles.
    pub triangles: usize,
    /// Rays traced: the camera's, and those towards lights.
    pub camera_rays: usize,
    /// See `camera_rays`.
    pub shadow_rays: usize,
    /// The name of the rays, see [`super::rays::FrameRays::digest`].
    pub rays: String,
    /// Building the structure, which happens once.
    pub build_ms: f64,
    /// What every frame takes before rays can be traced.
    pub update_ms: f64,
    /// Tracing the rays.
    pub rays_ms: f64,
    /// Camera rays whose nearest hit is at another distance than the kd-tree's, by more than a part in
    /// a thousand.
    pub different: usize,
}

impl Others {
    /// Reads a file.
    ///
    /// # Errors
    /// [`ReportError::Others`]: it cannot be read, is no such file, or has a time that is none.
    pub fn read(path: &Path) -> Result<Others, ReportError> {
        let failed = |reason: String| ReportError::Others { path: path.to_owned(), reason };
        let text = from_file::read(path, MOST)
            .map_err(|error| failed(format!("cannot be read: {error}")))?;
        let others: Others = serde_json::from_slice(&text).map_err(|error| {
            // What it says may quote the file.
            let why = quoted_reason(&error.to_string());
            failed(format!("is no file of times by splitplane-dbvh: {why}"))
        })?;
        if others.format != FORMAT {
            return Err(failed(format!(
                "is of format {}, but this version reads {FORMAT}; measure again",
                others.format
            )));
        }
        let time = |ms: f64| ms.is_finite() && ms > 0.0;
        for scene in &others.scenes {
            if ![scene.build_ms, scene.update_ms, scene.rays_ms].into_iter().all(time) {
                return Err(failed(format!("a time of `{}` is not above 0", quoted(&scene.scene))));
            }
        }
        Ok(others)
    }

    /// Checks that every scene of the report that the file names has the report's rays, and that it
    /// names one at least.
    ///
    /// # Errors
    /// [`ReportError::Others`]: other rays, or none of the scenes.
    pub fn check(&self, path: &Path, scenes: &[SceneReport]) -> Result<(), ReportError> {
        let failed = |reason: String| ReportError::Others { path: path.to_owned(), reason };
        let mut known = 0;
        for scene in scenes {
            if self.of(scene).is_some() {
                known += 1;
            } else if let Some(other) = self.scenes.iter().find(|o| o.scene == scene.name) {
                return Err(failed(format!(
                    "`{}` was measured on rays {}, not on those of this report, {}; give both the \
                     same scenes, lights and size",
                    quoted(&scene.name),
                    quoted(&other.rays),
                    scene.rays
                )));
            }
        }
        match known {
            0 => Err(failed("has none of the scenes of this report".into())),
            _ => Ok(()),
        }
    }

    /// The times of a scene, by its name and that of its rays.
    pub fn of(&self, scene: &SceneReport) -> Option<&OtherScene> {
        self.scenes.iter().find(|other| other.scene == scene.name && other.rays == scene.rays)
    }
}
