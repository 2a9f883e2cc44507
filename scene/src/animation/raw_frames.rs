//! Frames as numbers in one file: raw, described by another, or an array of NumPy.

use super::{AnimationError, Change};
use crate::from_file::{self, ReadError, quoted, quoted_reason};
use crate::npy::{Header, NpyError};
use crate::{Camera, CameraError, Scene, normals};
use glam::DVec3;
use serde::Deserialize;
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

/// Greatest description that is read, in bytes; cameras of a hundred thousand frames.
const MOST: u64 = 64 << 20;
/// Bytes of a vertex of raw frames.
const VERTEX: u64 = 12;
/// The angle that cameras without one see.
const FOV_DEGREES: f64 = 40.0;

/// What a .json says of the .bin beside it. It may say more.
#[derive(Debug, Deserialize)]
struct Description {
    vertices: u64,
    frames: u64,
    times_s: Option<Vec<f64>>,
    camera_per_frame: Option<Vec<Pose>>,
    fov_y_deg: Option<f64>,
}

#[derive(Debug, Deserialize)]
struct Pose {
    eye: [f64; 3],
    dir: [f64; 3],
    up: [f64; 3],
}

/// An open file of frames.
#[derive(Debug)]
pub(super) struct RawFrames {
    path: PathBuf,
    file: File,
    /// Where the first frame starts.
    start: u64,
    /// Bytes of a number: 4 or 8.
    width: usize,
    frames: usize,
    vertices: usize,
    times: Option<Vec<f64>>,
    cameras: Option<Vec<Camera>>,
    bytes: Vec<u8>,
    sums: Vec<DVec3>,
}

impl RawFrames {
    /// Opens the frames of a scene; its normals become one for every corner that may differ from
    /// its neighbours.
    pub(super) fn open(path: &Path, scene: &mut Scene) -> Result<RawFrames, AnimationError> {
        let is = |ending: &str| path.extension().is_some_and(|e| e.eq_ignore_ascii_case(ending));
        if is("npy") {
            return RawFrames::open_array(path, scene);
        }
        if !is("bin") && !is("json") {
            // Nothing there is the better answer for a name of nothing.
            return Err(match path.try_exists() {
                Ok(true) => AnimationError::NotFrames(path.to_owned()),
                Ok(false) => AnimationError::unreadable(path, &std::io::ErrorKind::NotFound.into()),
                Err(error) => AnimationError::unreadable(path, &error),
            });
        }
        let [bin, json] = ["bin", "json"].map(|ending| path.with_extension(ending));
        let about = describe(&json)?;
        let bad =
            |why: &str| AnimationError::BadDescription { file: json.clone(), why: why.into() };
        let count = |list: Option<usize>| list.is_none_or(|count| count as u64 == about.frames);
        if about.frames == 0 || about.vertices == 0 {
            return Err(bad("it has no frames, or no vertices"));
        }
        if !count(about.times_s.as_ref().map(Vec::len)) {
            return Err(bad("`times_s` has not one number for every frame"));
        }
        if !count(about.camera_per_frame.as_ref().map(Vec::len)) {
            return Err(bad("`camera_per_frame` has not one camera for every frame"));
        }
        if about.vertices != scene.positions.len() as u64 {
            return Err(AnimationError::VertexCount {
                file: json,
                frame: about.vertices,
                name: quoted(&scene.name),
                scene: scene.positions.len(),
            });
        }
        let expected = about.vertices.checked_mul(VERTEX).and_then(|n| n.checked_mul(about.frames));
        let expected = expected.ok_or_else(|| bad("so many vertices fit in no file"))?;
        let (file, length) =
            from_file::open_regular(&bin).map_err(|error| AnimationError::unread(&bin, error))?;
        if length != expected {
            return Err(AnimationError::WrongSize {
                file: bin,
                frames: about.frames,
                vertices: about.vertices,
                expected,
                found: length,
            });
        }
        let fov = about.fov_y_deg.unwrap_or(FOV_DEGREES);
        let cameras = about.camera_per_frame.map(|poses| {
            let camera = |(frame, pose): (usize, &Pose)| {
                pose.camera(fov).map_err(|error| AnimationError::Camera {
                    file: json.clone(),
                    frame,
                    error,
                })
            };
            poses.iter().enumerate().map(camera).collect::<Result<Vec<Camera>, _>>()
        });
        let cameras = cameras.transpose()?;
        normals::separate(scene);
        Ok(RawFrames {
            path: bin,
            file,
            start: 0,
            width: 4,
            // As many bytes are in a file, so both fit.
            frames: about.frames as usize,
            vertices: about.vertices as usize,
            times: about.times_s,
            cameras,
            bytes: Vec::new(),
            sums: Vec::new(),
        })
    }

    /// Opens an array of shape (frames, vertices, 3).
    fn open_array(path: &Path, scene: &mut Scene) -> Result<RawFrames, AnimationError> {
        let refused = |error| AnimationError::Array { file: path.to_owned(), error };
        let (mut file, length) =
            from_file::open_regular(path).map_err(|error| AnimationError::unread(path, error))?;
        let header = Header::read(&mut file)
            .map_err(|error| AnimationError::unreadable(path, &error))?
            .map_err(refused)?;
        let wrong_shape = || refused(header.wrong_shape("(frames, vertices, 3)"));
        let &[frames, vertices, 3] = &header.sides[..] else { return Err(wrong_shape()) };
        if frames == 0 || vertices == 0 {
            return Err(wrong_shape());
        }
        if vertices != scene.positions.len() as u64 {
            return Err(AnimationError::VertexCount {
                file: path.to_owned(),
                frame: vertices,
                name: quoted(&scene.name),
                scene: scene.positions.len(),
            });
        }
        header.check_length(length.saturating_sub(header.bytes)).map_err(refused)?;
        normals::separate(scene);
        Ok(RawFrames {
            path: path.to_owned(),
            file,
            start: header.bytes,
            width: header.width as usize,
            // As many bytes are in a file.
            frames: usize::try_from(frames).map_err(|_| refused(NpyError::Memory))?,
            vertices: scene.positions.len(),
            times: None,
            cameras: None,
            bytes: Vec::new(),
            sums: Vec::new(),
        })
    }

    pub(super) fn frames(&self) -> usize {
        self.frames
    }

    pub(super) fn set(
        &mut self,
        frame: usize,
        scene: &mut Scene,
    ) -> Result<Change, AnimationError> {
        let (expected, found) = (self.vertices, scene.positions.len());
        if expected != found {
            return Err(AnimationError::AnotherScene { expected, found });
        }
        self.bytes.resize(3 * self.vertices * self.width, 0);
        let start = self.start + frame as u64 * self.bytes.len() as u64;
        self.file
            .seek(SeekFrom::Start(start))
            .and_then(|_| self.file.read_exact(&mut self.bytes))
            .map_err(|error| AnimationError::unreadable(&self.path, &error))?;
        let to = scene.positions.as_flattened_mut().iter_mut();
        if self.width == 4 {
            let (numbers, _) = self.bytes.as_chunks::<4>();
            to.zip(numbers).for_each(|(to, from)| *to = f32::from_le_bytes(*from));
        } else {
            let (numbers, _) = self.bytes.as_chunks::<8>();
            to.zip(numbers).for_each(|(to, from)| *to = f64::from_le_bytes(*from) as f32);
        }
        normals::smooth(scene, 0, &mut self.sums);
        Ok(Change::Positions)
    }

    pub(super) fn camera(&self, frame: usize) -> Option<Camera> {
        self.cameras.as_ref()?.get(frame).copied()
    }

    pub(super) fn time(&self, frame: usize) -> Option<f64> {
        self.times.as_ref()?.get(frame).copied()
    }
}

impl Pose {
    fn camera(&self, fov_degrees: f64) -> Result<Camera, CameraError> {
        let [eye, direction] = [self.eye, self.dir].map(DVec3::from_array);
        if !direction.is_finite() {
            return Err(CameraError::NotFinite);
        }
        let direction = direction.try_normalize().ok_or(CameraError::NoDirection)?;
        // As far off as the eye is from the origin: then rounding to f32 turns the view the least.
        let distance = if eye.length() > 0.0 { eye.length() } else { 1.0 };
        let at = eye + direction * distance;
        let [eye, at] = [eye, at].map(|p| p.as_vec3().to_array());
        Camera::new(eye, at, self.up.map(|x| x as f32), fov_degrees as f32)
    }
}

fn describe(json: &Path) -> Result<Description, AnimationError> {
    let bad = |why: String| AnimationError::BadDescription { file: json.to_owned(), why };
    let bytes = from_file::read(json, MOST).map_err(|error| match error {
        ReadError::TooLong { limit } => bad(format!("it is larger than {limit} bytes")),
        ReadError::NotAFile => bad(error.to_string()),
        error => AnimationError::unread(json, error),
    })?;
    // What it says may quote the file.
    serde_json::from_slice(&bytes).map_err(|error| bad(quoted_reason(&error.to_string())))
}
