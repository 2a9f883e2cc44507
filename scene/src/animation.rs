//! Scenes that move: frames from files, or made here.

mod builtin;
mod error;
mod obj_folder;
mod raw_frames;

pub use crate::npy::NpyError;
pub use error::AnimationError;

use super::{Camera, Scene, SceneOptions};
use obj_folder::ObjFolder;
use raw_frames::RawFrames;
use splitplane_float_state::{Standard, standard};
use std::ffi::OsStr;
use std::path::Path;

/// Frames of a scene, one of which is in memory at a time.
#[derive(Debug)]
pub struct Animation {
    source: Source,
    /// The frame that the scene was last put into.
    current: Option<usize>,
}

#[derive(Debug)]
enum Source {
    Builtin(builtin::Builtin),
    Obj(Box<ObjFolder>),
    Raw(RawFrames),
}

/// What is different in a scene after [`Animation::set`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Change {
    /// Nothing: the scene was in this frame already.
    Nothing,
    /// Vertices moved, and normals with them. Triangles, materials and all the rest are the same.
    Positions,
    /// Anything may be different.
    Everything,
}

impl Animation {
    /// Opens a scene and its frames, and puts the scene into the first one. `scene` is what
    /// [`Scene::open_with`] takes. `frames` is one of
    ///
    /// - a folder of .obj files, in the natural order of their names (`frame10` after `frame9`).
    ///   Each is a scene of its own, of which the triangles, materials and textures are taken;
    ///   camera, lights and name stay those of `scene`. Materials are read again only for a frame
    ///   that names others than the frame before.
    /// - a file of raw frames, `NAME.frames.bin`, or `NAME.frames.json` beside it, which describes
    ///   it. The .bin holds little-endian f32, `[frame][vertex][x y z]`, the vertices in the order of
    ///   `scene`. The .json is an object with the numbers `vertices` and `frames`; it may have
    ///   `times_s`, a number for every frame, and `camera_per_frame`, an object for every frame with
    ///   `eye`, `dir` and `up` of three numbers each, seen with a vertical angle of `fov_y_deg`
    ///   degrees (40 without it). Where the scene has normals, they are made anew for every frame:
    ///   the mean of the triangles around, by area, with the sharp edges that the scene has.
    /// - an array of NumPy, `NAME.npy`, of shape (frames, vertices, 3): little-endian f32, or f64 that is rounded, in C order, the
    ///   vertices in the order of `scene`. Normals are made as for raw frames.
    /// - `None` for a built-in scene that moves.
    ///
    /// # Errors
    /// The scene or its frames cannot be read, or do not fit together.
    pub fn open(
        scene: impl AsRef<OsStr>,
        frames: Option<&Path>,
        options: &SceneOptions,
    ) -> Result<(Scene, Animation), AnimationError> {
        let _state = Standard::set();
        let scene = scene.as_ref();
        let (mut scene, source) = match frames {
            None => {
                let (scene, source) = builtin::open(scene)?;
                (scene, Source::Builtin(source))
            }
            Some(path) if path.is_dir() => {
                let source = ObjFolder::open(path, options)?;
                (Scene::open_with(scene, options)?, Source::Obj(Box::new(source)))
            }
            Some(path) => {
                let mut scene = Scene::open_with(scene, options)?;
                let source = RawFrames::open(path, &mut scene)?;
                (scene, Source::Raw(source))
            }
        };
        let mut animation = Animation { source, current: None };
        animation.set(0, &mut scene)?;
        Ok((scene, animation))
    }

    /// How many frames there are, at least 1.
    pub fn frames(&self) -> usize {
        match &self.source {
            Source::Builtin(source) => source.frames(),
            Source::Obj(source) => source.frames(),
            Source::Raw(source) => source.frames(),
        }
    }

    /// Puts the scene, the one that [`Animation::open`] gave, into the state of a frame, in its own
    /// memory. Frames come in any order and may repeat.
    ///
    /// # Errors
    /// There is no such frame, its file cannot be read any more, or the scene is another one. The
    /// scene is then as it was before, or holds part of the frame's positions.
    pub fn set(&mut self, frame: usize, scene: &mut Scene) -> Result<Change, AnimationError> {
        let _state = Standard::set();
        let frames = self.frames();
        if frame >= frames {
            return Err(AnimationError::NoSuchFrame { frame, frames });
        }
        if self.current == Some(frame) {
            return Ok(Change::Nothing);
        }
        self.current = None;
        let change = match &mut self.source {
            Source::Builtin(source) => source.set(frame, scene)?,
            Source::Obj(source) => source.set(frame, scene)?,
            Source::Raw(source) => source.set(frame, scene)?,
        };
        self.current = Some(frame);
        Ok(change)
    }

    /// The camera of a frame, for an animation whose camera moves.
    pub fn camera(&self, frame: usize) -> Option<Camera> {
        standard(|| match &self.source {
            Source::Raw(source) => source.camera(frame),
            Source::Builtin(_) | Source::Obj(_) => None,
        })
    }

    /// The time of a frame in seconds, where it is known.
    pub fn time(&self, frame: usize) -> Option<f64> {
        standard(|| match &self.source {
            Source::Builtin(source) => source.time(frame),
            Source::Obj(_) => None,
            Source::Raw(source) => source.time(frame),
        })
    }
}
