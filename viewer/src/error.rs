//! Why the viewer ends before its user wants it to.

use super::source::FrameError;
use splitplane::backend::OpenError;
use thiserror::Error;

/// Why there is no window, or no longer one.
#[derive(Clone, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum ViewerError {
    /// There is nothing to open a window on.
    #[error("there is no display to open a window on ({0})")]
    NoDisplay(String),
    /// The display refuses a window.
    #[error("the display refuses a window: {0}")]
    Window(String),
    /// No adapter can be used, or not the one that was asked for.
    #[error(transparent)]
    Adapter(#[from] OpenError),
    /// Adapters there are, but none that can show pictures in the window.
    #[error("no GPU adapter can show pictures in this window; there are {}", .0.join(", "))]
    NoSurface(Vec<String>),
    /// The device is gone.
    #[error("the device was lost: {0}")]
    DeviceLost(String),
    /// The device or its driver refused something.
    #[error("the device failed: {0}")]
    Device(String),
    /// What the window shows cannot be read back.
    #[error("the screenshot cannot be taken: {0}")]
    Screenshot(String),
    /// The first frame cannot be made, or the device was lost while making one.
    #[error(transparent)]
    Frame(#[from] FrameError),
}
