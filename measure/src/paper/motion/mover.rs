//! How a scene is put into its frames: by its own motion, or by a twist.

use crate::paper::ReportError;
use crate::paper::scene::Placed;
use splitplane::scene::{Animation, Scene, SceneOptions};
use std::ffi::OsStr;
use std::path::Path;

/// The turn of the last frame's top against its bottom, for scenes that bring no motion.
const TWIST: f64 = std::f64::consts::PI;

/// Puts a scene into its frames.
pub(super) enum Mover {
    /// The scene's own motion.
    Own(Box<(Animation, Scene)>),
    /// A twist of these positions about the vertical through their middle.
    Twist(Vec<[f32; 3]>),
}

impl Mover {
    pub(super) fn of(
        spec: &OsStr,
        frames: Option<&Path>,
        scene: &Scene,
    ) -> Result<Mover, ReportError> {
        let options = SceneOptions::default();
        if frames.is_some() {
            let (own, animation) = Animation::open(spec, frames, &options)?;
            return Ok(Mover::Own(Box::new((animation, own))));
        }
        let builtin = spec.to_str().is_some_and(|spec| spec.starts_with("builtin:"));
        let own = builtin.then(|| Animation::open(spec, None, &options).ok());
        Ok(match own.flatten() {
            Some((own, animation)) => Mover::Own(Box::new((animation, own))),
            None => Mover::Twist(scene.positions.clone()),
        })
    }

    pub(super) fn words(&self) -> String {
        match self {
            Mover::Own(_) => "moved by its own frames".into(),
            Mover::Twist(_) => {
                "twisted about the vertical for want of frames, the top by up to half a turn against the bottom".into()
            }
        }
    }

    /// Moves a scene to one of this many frames, and its camera where the frame has one.
    pub(super) fn set(
        &mut self,
        frame: usize,
        frames: usize,
        placed: &mut Placed,
    ) -> Result<(), ReportError> {
        let scene = &mut placed.scene;
        match self {
            Mover::Own(own) => {
                let (animation, moving) = own.as_mut();
                // Evenly over the motion, which may be a circle.
                animation.set(frame * animation.frames() / frames, moving)?;
                scene.positions.clone_from(&moving.positions);
                scene.normals.clone_from(&moving.normals);
                placed.camera = moving.camera.unwrap_or(placed.camera);
            }
            Mover::Twist(positions) => {
                let part = frame as f64 / (frames.max(2) - 1) as f64;
                twist(positions, TWIST * part, &mut scene.positions);
            }
        }
        Ok(())
    }
}

/// Turns every position about the vertical through the middle of all: not at the bottom, by `angle` at the top.
pub fn twist(positions: &[[f32; 3]], angle: f64, out: &mut Vec<[f32; 3]>) {
    let finite = |p: &&[f32; 3]| p.iter().all(|x| x.is_finite());
    let (mut lo, mut hi) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
    for position in positions.iter().filter(finite) {
        for axis in 0..3 {
            lo[axis] = lo[axis].min(f64::from(position[axis]));
            hi[axis] = hi[axis].max(f64::from(position[axis]));
        }
    }
    let middle = [0, 2].map(|axis| 0.5 * (lo[axis] + hi[axis]));
    let height = (hi[1] - lo[1]).max(f64::MIN_POSITIVE);
    out.clear();
    out.extend(positions.iter().map(|position| {
        let [x, y, z] = position.map(f64::from);
        let (sin, cos) = (angle * (y - lo[1]) / height).sin_cos();
        let (x, z) = (x - middle[0], z - middle[1]);
        let turned = [middle[0] + cos * x - sin * z, middle[1] + sin * x + cos * z];
        [turned[0] as f32, position[1], turned[1] as f32]
    }));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_twist_turns_the_top_and_leaves_the_bottom() {
        let positions = [[0.0, 0.0, 0.0], [2.0, 0.0, 2.0], [2.0, 4.0, 1.0], [2.0, 2.0, 1.0]];
        let mut out = Vec::new();
        twist(&positions, std::f64::consts::PI, &mut out);
        let expected = [[0.0, 0.0, 0.0], [2.0, 0.0, 2.0], [0.0, 4.0, 1.0], [1.0, 2.0, 2.0]];
        for (found, expected) in out.iter().zip(expected) {
            for axis in 0..3 {
                assert!((found[axis] - expected[axis]).abs() < 1e-6, "{found:?} {expected:?}");
            }
        }
    }
}
