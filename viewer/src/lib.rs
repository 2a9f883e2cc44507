//! An interactive window on a scene: orbit and fly, choose backend, preset and accuracy, look at
//! depth, normals, triangles, costs and the boxes of the tree.
//!
//! The pictures come from a [`FrameSource`] on a thread of its own: [`TracedSource`] for a mesh, [`ObjectsSource`] for a scene of many objects.

#![forbid(unsafe_code)]

mod area;
mod blit;
mod boxes;
mod error;
mod objects;
mod paint;
mod panel;
mod projection;
mod resolution;
mod rig;
mod screen;
mod slot;
mod source;
mod state;
mod traced;
mod window;
mod worker;

pub use error::ViewerError;
pub use objects::ObjectsSource;
pub use source::{
    Abilities, DebugView, FirstFrame, FrameDevice, FrameError, FrameReport, FrameRequest,
    FrameSource, FrameTarget, Opening, TreeReport, TreeShape,
};
pub use traced::TracedSource;

use image::RgbaImage;
use splitplane::backend::BackendKind;
use splitplane_core::config::Preset;
use splitplane_core::ray::Accuracy;
use state::Choices;
use window::{App, Event};
use winit::error::EventLoopError;
use winit::event_loop::EventLoop;

/// What the viewer starts with.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    /// Width and height of the window in pixels.
    pub size: [u32; 2],
    /// The GPU that draws the window, by part of its name or by its index.
    pub adapter: Option<String>,
    /// Who makes the pictures.
    pub backend: BackendKind,
    /// How the tree is built.
    pub preset: Preset,
    /// Which triangle test.
    pub accuracy: Accuracy,
    /// What the picture shows.
    pub view: DebugView,
    /// The depth of the boxes of the tree to show; `None` to show none.
    pub level: Option<u32>,
    /// How often a path may be mirrored or refracted.
    pub depth: u32,
    /// Camera rays a pixel.
    pub samples: u32,
    /// End after so many frames with a finished picture; `None` to wait for the user.
    pub frames: Option<u32>,
    /// Take a picture of the window when `frames` have been shown.
    pub screenshot: bool,
}

impl Settings {
    fn choices(&self) -> Choices {
        Choices {
            backend: self.backend,
            preset: self.preset,
            accuracy: self.accuracy,
            depth: self.depth,
            samples: self.samples,
            view: self.view,
            boxes: self.level.is_some(),
            // Deep enough to tell something, few enough to be seen.
            level: self.level.unwrap_or(6),
        }
    }
}

/// What is left when the window is closed.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Ended {
    /// The report of the last frame; `None` when there was none.
    pub report: Option<FrameReport>,
    /// The window as it was last shown, when [`Settings::screenshot`] asked for it.
    pub screenshot: Option<RgbaImage>,
}

/// Opens a window and shows what the source makes, until the user closes it. To be called on the
/// main thread, and once a process: displays ask for that.
///
/// # Errors
/// There is no display, no adapter that can draw on it, or no first frame; the device is lost.
pub fn run(source: Box<dyn FrameSource>, settings: Settings) -> Result<Ended, ViewerError> {
    let built = EventLoop::<Event>::with_user_event().build();
    let event_loop = built.map_err(|error| ViewerError::NoDisplay(reason(&error)))?;
    let mut app = App::new(settings, source, event_loop.create_proxy());
    let ran = event_loop.run_app(&mut app);
    ran.map_err(|error| ViewerError::Window(error.to_string()))?;
    app.outcome
}

/// What winit says, without the place in its source text.
fn reason(error: &EventLoopError) -> String {
    let text = error.to_string();
    let place = text.strip_prefix("os error at ").and_then(|rest| rest.split_once(": "));
    place.map_or(text.as_str(), |(_, reason)| reason).trim_end_matches('.').to_owned()
}
