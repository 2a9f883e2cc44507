//! What the user has chosen and what there is to show: everything the window knows besides its
//! device.

use super::resolution::{Resolution, reduced};
use super::rig::Rig;
use super::source::{DebugView, FrameError, FrameRequest, Opening};
use super::worker::{Frame, Job};
use splitplane::backend::BackendKind;
use splitplane_core::config::Preset;
use splitplane_core::ray::Accuracy;
use std::time::{Duration, Instant};

/// The camera counts as still when it has not moved for so long.
pub(super) const SETTLES: Duration = Duration::from_millis(150);

/// What the user chooses.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Choices {
    pub(super) backend: BackendKind,
    pub(super) preset: Preset,
    pub(super) accuracy: Accuracy,
    pub(super) depth: u32,
    pub(super) samples: u32,
    pub(super) view: DebugView,
    /// Whether the boxes of the tree are shown, and those of which depth.
    pub(super) boxes: bool,
    pub(super) level: u32,
}

/// A source that is open, and the camera on its scene.
#[derive(Clone, Debug)]
pub(super) struct Scene {
    pub(super) opening: Opening,
    pub(super) rig: Rig,
}

/// All of it.
#[derive(Debug)]
pub(super) struct State {
    pub(super) choices: Choices,
    /// `None` until the source is open.
    pub(super) scene: Option<Scene>,
    pub(super) frame: Option<Frame>,
    /// Time of the last build.
    pub(super) build_ms: Option<f64>,
    /// What failed last, until something else succeeds.
    pub(super) error: Option<String>,
    pub(super) shows_panel: bool,
    pub(super) shows_keys: bool,
    pub(super) playing: bool,
    pub(super) time: f64,
    resolution: Resolution,
    moved: Option<Instant>,
    /// What was asked of the thread last, and not refused.
    asked: Option<Job>,
}

impl State {
    pub(super) fn new(choices: Choices) -> State {
        State {
            choices,
            scene: None,
            frame: None,
            build_ms: None,
            error: None,
            shows_panel: true,
            shows_keys: false,
            playing: false,
            time: 0.0,
            resolution: Resolution::new(),
            moved: None,
            asked: None,
        }
    }

    /// The source is open: its abilities bound the choices from now on.
    pub(super) fn open(&mut self, opening: Opening) {
        self.choices.backend = opening.backend;
        let can = &opening.abilities;
        if !can.views.contains(&self.choices.view) {
            self.choices.view = can.views.first().copied().unwrap_or_default();
        }
        self.choices.depth = self.choices.depth.min(can.max_depth);
        self.choices.samples = self.choices.samples.clamp(1, can.max_samples.max(1));
        let rig = Rig::new(opening.camera, opening.distance, &opening.bounds);
        self.scene = Some(Scene { opening, rig });
    }

    /// A frame is there.
    pub(super) fn show(&mut self, frame: Frame) {
        self.resolution.learn(frame.report.trace_ms, frame.job.step);
        if frame.report.build_ms.is_some() {
            self.build_ms = frame.report.build_ms;
        }
        if let Some(shape) = &frame.report.tree.shape {
            self.choices.level = self.choices.level.min(shape.max_depth);
        }
        self.frame = Some(frame);
    }

    /// A job failed: its choices are taken back where there is a frame to go back to.
    pub(super) fn fail(&mut self, error: &FrameError) {
        self.error = Some(error.to_string());
        if let Some(frame) = &self.frame {
            let (choices, last) = (&mut self.choices, &frame.job.request);
            (choices.backend, choices.preset) = (last.backend, last.preset);
            (choices.accuracy, choices.view) = (last.accuracy, last.view);
            (choices.depth, choices.samples) = (last.depth, last.samples);
        }
    }

    /// Lets the animation go on by some seconds, from its start again after its end.
    pub(super) fn advance(&mut self, seconds: f64) {
        let length = self.scene.as_ref().and_then(|scene| scene.opening.abilities.seconds);
        if let Some(length) = length.filter(|length| self.playing && *length > 0.0) {
            self.time = (self.time + seconds).rem_euclid(length);
        }
    }

    /// The camera was moved just now.
    pub(super) fn touch(&mut self) {
        self.moved = Some(Instant::now());
    }

    /// How long until the camera counts as still; `None` when it does.
    pub(super) fn settles_in(&self) -> Option<Duration> {
        let passed = self.moved?.elapsed();
        SETTLES.checked_sub(passed).filter(|rest| !rest.is_zero())
    }

    /// What should be shown in a picture of so many pixels, where that is not what was asked for
    /// last.
    pub(super) fn wants(&mut self, [width, height]: [u32; 2]) -> Option<Job> {
        let scene = self.scene.as_ref()?;
        let choices = &self.choices;
        let whole = FrameRequest {
            width,
            height,
            camera: scene.rig.camera(),
            backend: choices.backend,
            preset: choices.preset,
            accuracy: choices.accuracy,
            depth: choices.depth,
            samples: choices.samples,
            view: choices.view,
            time: self.time,
            // While vertices move it need not come from the device for its counts.
            tree: choices.boxes || !self.playing,
        };
        let coarse = self.resolution.step();
        // Where a whole picture takes long, a coarse one of the same is shown before.
        let is_new = coarse > 1 && !self.shows(&whole);
        let fleeting = self.playing || self.settles_in().is_some() || is_new;
        let step = if fleeting { coarse } else { 1 };
        let request =
            FrameRequest { width: reduced(width, step), height: reduced(height, step), ..whole };
        let job = Job { request, level: choices.boxes.then_some(choices.level), step, fleeting };
        // A picture that was made in haste, and turned out whole, need not be made again.
        let same = |asked: Job| (asked.request, asked.level) == (job.request, job.level);
        if self.asked.is_some_and(same) {
            return None;
        }
        self.asked = Some(job);
        Some(job)
    }

    /// Whether the window shows this already, if perhaps coarser.
    fn shows(&self, whole: &FrameRequest) -> bool {
        self.frame.as_ref().is_some_and(|frame| {
            let step = frame.job.step;
            let (width, height) = (reduced(whole.width, step), reduced(whole.height, step));
            FrameRequest { width, height, ..*whole } == frame.job.request
        })
    }

    /// True while a frame is on its way.
    pub(super) fn waits(&self) -> bool {
        let shown = self.frame.as_ref().map(|frame| (frame.job.request, frame.job.level));
        self.error.is_none() && shown != self.asked.map(|asked| (asked.request, asked.level))
            || self.scene.is_none()
    }

    /// True when the picture shown is the one that was asked for, as fine as it gets.
    pub(super) fn is_finished(&self) -> bool {
        self.scene.is_some() && !self.waits() && self.asked.is_some_and(|asked| asked.step == 1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::source::Abilities;
    use splitplane::scene::Camera;
    use splitplane_core::aabb::Aabb;

    fn state() -> State {
        let mut state = State::new(Choices {
            backend: BackendKind::Auto,
            preset: Preset::Fast,
            accuracy: Accuracy::Watertight,
            depth: 9,
            samples: 9,
            view: DebugView::Nodes,
            boxes: false,
            level: 3,
        });
        state.open(Opening {
            scene: "a scene".into(),
            bounds: Aabb { lo: [0.0; 3], hi: [1.0; 3] },
            camera: Camera::new([0.0, 0.0, 5.0], [0.0; 3], [0.0, 1.0, 0.0], 40.0).unwrap(),
            distance: 5.0,
            backend: BackendKind::Cpu,
            reason: String::new(),
            abilities: Abilities {
                backends: vec![BackendKind::Cpu],
                views: vec![DebugView::Shaded, DebugView::Depth],
                max_samples: 1,
                ..Abilities::default()
            },
        });
        state
    }

    #[test]
    fn choices_are_bounded_by_what_the_source_can_do() {
        let choices = state().choices;
        assert_eq!((choices.backend, choices.view), (BackendKind::Cpu, DebugView::Shaded));
        assert_eq!((choices.depth, choices.samples), (0, 1));
    }

    /// As the thread would, without a picture: a frame that took so long.
    fn made(state: &mut State, trace_ms: f64) {
        let job = state.asked.unwrap();
        state.resolution.learn(trace_ms, job.step);
    }

    #[test]
    fn a_picture_that_is_made_fast_is_asked_for_once() {
        let mut state = state();
        let first = state.wants([640, 480]).unwrap();
        assert!(first.fleeting && first.step > 1 && first.request.width < 640, "{first:?}");
        assert_eq!(state.wants([640, 480]), None);
        made(&mut state, 0.1);
        let job = state.wants([640, 480]).unwrap();
        assert_eq!((job.step, job.fleeting, job.request.width), (1, false, 640));
        assert_eq!(state.wants([640, 480]), None);
        assert!(state.wants([320, 480]).is_some());
        state.choices.boxes = true;
        assert_eq!(state.wants([320, 480]).unwrap().level, Some(3));
    }

    #[test]
    fn animations_start_again() {
        let mut state = state();
        state.playing = true;
        state.advance(1.0);
        assert_eq!(state.time, 0.0, "this scene stands still");
        if let Some(scene) = &mut state.scene {
            scene.opening.abilities.seconds = Some(2.0);
        }
        state.advance(1.5);
        assert_eq!(state.time, 1.5);
        state.advance(1.0);
        assert_eq!(state.time, 0.5);
        let job = state.wants([640, 480]).unwrap();
        assert!(job.fleeting && job.request.time == 0.5);
        state.playing = false;
        state.advance(1.0);
        assert_eq!(state.time, 0.5);
    }

    #[test]
    fn a_slow_one_is_coarse_while_the_camera_moves() {
        let mut state = state();
        assert!(state.wants([640, 480]).is_some());
        made(&mut state, 1000.0);
        if let Some(scene) = &mut state.scene {
            scene.rig.turn(0.1, 0.0);
        }
        state.touch();
        let job = state.wants([640, 480]).unwrap();
        assert!(job.fleeting && job.step == 8 && job.request.width == 80, "{job:?}");
        assert_eq!(state.wants([640, 480]), None);
    }
}
