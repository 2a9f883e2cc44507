//! The seam between the window and whatever makes its pictures.

use splitplane::backend::{BackendKind, OpenError};
use splitplane::picture::PictureError;
use splitplane::scene::{AnimationError, Camera};
use splitplane::tracer::TracerError;
use splitplane_core::aabb::Aabb;
use splitplane_core::config::Preset;
use splitplane_core::error::{BuildError, DeviceError, QueryError};
use splitplane_core::mesh::MeshError;
use splitplane_core::ray::Accuracy;
use splitplane_core::tree::KdTree;
use splitplane_render::RenderError;
use splitplane_wgpu::GpuError;
use std::sync::atomic::{AtomicBool, Ordering};
use thiserror::Error;

/// What the viewer shows: makes frames on request. Lives on a thread of its own, so a frame may take
/// its time.
pub trait FrameSource: Send {
    /// Gets ready on the window's device, and says what can be asked for and where to look from.
    /// Called once, before anything else.
    ///
    /// # Errors
    /// What was chosen cannot be had.
    fn open(&mut self, target: &FrameDevice, first: &FirstFrame) -> Result<Opening, FrameError>;

    /// Starts on the picture that was asked for. It may return before the picture is there: then the next one may be
    /// submitted, and [`FrameSource::finish`] gives both, in order. No more than two are under way.
    ///
    /// # Errors
    /// [`FrameError::Superseded`] when [`FrameTarget::superseded`] became true meanwhile; else
    /// whatever failed. The source stays usable after every error but the loss of the device, and so does what was
    /// submitted before.
    fn submit(
        &mut self,
        request: &FrameRequest,
        target: &FrameTarget<'_>,
    ) -> Result<(), FrameError>;

    /// Whether [`FrameSource::finish`] would return at once. Never waits.
    fn is_done(&mut self) -> bool;

    /// Waits for the first picture that was submitted and not finished.
    ///
    /// # Errors
    /// Whatever failed; nothing was submitted.
    fn finish(&mut self) -> Result<FrameReport, FrameError>;

    /// The tree of the last frame that was submitted, where [`FrameRequest::tree`] asked for it.
    fn tree(&self) -> Option<&KdTree>;
}

/// The device of the window. Clones are the same device.
#[derive(Clone, Debug)]
pub struct FrameDevice {
    /// The device; what belongs to it may be used by the source and the window alike.
    pub device: wgpu::Device,
    /// Its queue.
    pub queue: wgpu::Queue,
}

/// What is chosen before there is a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FirstFrame {
    /// Who does the work; `Auto` lets the source choose.
    pub backend: BackendKind,
    /// How the tree is built.
    pub preset: Preset,
    /// Width of the picture over its height.
    pub aspect: f64,
}

/// What a source can do, and its scene.
#[derive(Clone, Debug)]
pub struct Opening {
    /// The scene's name, for the title of the window.
    pub scene: String,
    /// The box around the scene.
    pub bounds: Aabb,
    /// From where to look at first.
    pub camera: Camera,
    /// How far from the eye the point lies that the camera turns about.
    pub distance: f64,
    /// The backend that [`FirstFrame::backend`] became.
    pub backend: BackendKind,
    /// Why it is this one.
    pub reason: String,
    /// What may be asked for; nothing else is offered to the user.
    pub abilities: Abilities,
}

/// What may be asked of a source.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Abilities {
    /// Backends to choose from.
    pub backends: Vec<BackendKind>,
    /// Presets to choose from.
    pub presets: Vec<Preset>,
    /// Triangle tests to choose from.
    pub accuracies: Vec<Accuracy>,
    /// Views to choose from.
    pub views: Vec<DebugView>,
    /// Greatest [`FrameRequest::depth`]; 0 when paths are never followed past the first surface.
    pub max_depth: u32,
    /// Greatest [`FrameRequest::samples`]; 1 when their number cannot be chosen.
    pub max_samples: u32,
    /// Length of the scene's animation in seconds; `None` for a scene that stands still.
    pub seconds: Option<f64>,
}

/// One frame, as asked for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FrameRequest {
    /// Pixels from left to right.
    pub width: u32,
    /// Pixels from top to bottom.
    pub height: u32,
    /// From where to look.
    pub camera: Camera,
    /// Who does the work; never `Auto`.
    pub backend: BackendKind,
    /// How the tree is built.
    pub preset: Preset,
    /// Which triangle test.
    pub accuracy: Accuracy,
    /// How often a path may be mirrored or refracted.
    pub depth: u32,
    /// Camera rays a pixel.
    pub samples: u32,
    /// What the picture shows.
    pub view: DebugView,
    /// Seconds into the scene's animation.
    pub time: f64,
    /// Whether the tree is to come to host memory, for its counts and its boxes. A device then sends it.
    pub tree: bool,
}

/// Where a frame goes.
#[derive(Clone, Copy, Debug)]
pub struct FrameTarget<'a> {
    /// The device of the window.
    pub device: &'a wgpu::Device,
    /// Its queue.
    pub queue: &'a wgpu::Queue,
    /// One word a pixel, row by row from the top left: red in its lowest byte, then green, blue and
    /// alpha, encoded as displays take them. `STORAGE | COPY_DST | COPY_SRC`.
    pub pixels: &'a wgpu::Buffer,
    superseded: &'a AtomicBool,
}

impl<'a> FrameTarget<'a> {
    /// A target on a device. `superseded` may be set while a frame is being made.
    pub fn new(
        gpu: &'a FrameDevice,
        pixels: &'a wgpu::Buffer,
        superseded: &'a AtomicBool,
    ) -> FrameTarget<'a> {
        FrameTarget { device: &gpu.device, queue: &gpu.queue, pixels, superseded }
    }

    /// True once nobody wants this frame any more: stop when it is convenient.
    pub fn superseded(&self) -> bool {
        self.superseded.load(Ordering::Relaxed)
    }
}

/// What a picture shows.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum DebugView {
    /// The scene as it looks.
    #[default]
    Shaded,
    /// The distance from the eye, near is bright.
    Depth,
    /// The normal towards the eye; its coordinates as red, green and blue.
    Normals,
    /// A colour for every triangle.
    TriangleIds,
    /// How many nodes each ray steps through.
    Nodes,
    /// How many triangles each ray is tested against.
    Triangles,
}

impl DebugView {
    /// All views.
    pub const ALL: [DebugView; 6] = [
        DebugView::Shaded,
        DebugView::Depth,
        DebugView::Normals,
        DebugView::TriangleIds,
        DebugView::Nodes,
        DebugView::Triangles,
    ];

    /// The view's name on the command line.
    pub const fn name(self) -> &'static str {
        match self {
            DebugView::Shaded => "shaded",
            DebugView::Depth => "depth",
            DebugView::Normals => "normals",
            DebugView::TriangleIds => "triangle-ids",
            DebugView::Nodes => "nodes",
            DebugView::Triangles => "triangles",
        }
    }

    /// The view in words.
    pub const fn title(self) -> &'static str {
        match self {
            DebugView::Shaded => "Shaded",
            DebugView::Depth => "Depth",
            DebugView::Normals => "Normals",
            DebugView::TriangleIds => "Triangle ids",
            DebugView::Nodes => "Cost: nodes",
            DebugView::Triangles => "Cost: triangle tests",
        }
    }
}

/// What a frame took and what it is of.
#[derive(Clone, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct FrameReport {
    /// Time to bring triangles to where they are at [`FrameRequest::time`]; 0 when they stood still.
    pub update_ms: f64,
    /// Time of the build; `None` when the last frame's tree served.
    pub build_ms: Option<f64>,
    /// Time for rays and shading.
    pub trace_ms: f64,
    /// Time for everything, the way to the device included.
    pub total_ms: f64,
    /// Rays traced, of all kinds.
    pub rays: u64,
    /// Triangles of the scene.
    pub triangles: u32,
    /// The tree.
    pub tree: TreeReport,
    /// Who did the work, in words.
    pub backend: String,
    /// What the colours of the view mean, where that differs from frame to frame.
    pub legend: Option<String>,
    /// Bytes that came back from the device since the report before; 0 for frames of the CPU.
    pub bytes_down: u64,
}

/// Counts and cost of a tree.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct TreeReport {
    /// All nodes.
    pub nodes: usize,
    /// References of all leaves.
    pub references: usize,
    /// Bytes that queries read.
    pub bytes: u64,
    /// What is known of a tree in host memory only.
    pub shape: Option<TreeShape>,
}

/// What takes a look at all nodes of a tree.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct TreeShape {
    /// Leaves, the empty ones included.
    pub leaves: usize,
    /// Leaves without triangles.
    pub empty_leaves: usize,
    /// Most levels below the root.
    pub max_depth: u32,
    /// Expected cost of a random ray, in units of K_I.
    pub sah_cost: f64,
}

/// Why there is no frame.
#[derive(Clone, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum FrameError {
    /// Nobody wants the frame any more.
    #[error("the frame was superseded by a later one")]
    Superseded,
    /// The backend cannot be had.
    #[error(transparent)]
    Open(#[from] OpenError),
    /// The scene is no mesh.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// No tree was built.
    #[error(transparent)]
    Build(#[from] BuildError),
    /// The rays were refused.
    #[error(transparent)]
    Query(#[from] QueryError),
    /// The frame cannot be made.
    #[error(transparent)]
    Tracer(TracerError),
    /// The scene cannot be brought to where it is at this time.
    #[error("{0}")]
    Animation(String),
    /// A frame was asked for that was not submitted.
    #[error("no frame was submitted")]
    NothingSubmitted,
    /// A frame was asked for before a scene was loaded.
    #[error("no scene is loaded")]
    NoScene,
    /// A debug view cannot be painted.
    #[error("the view cannot be painted: {0}")]
    View(String),
}

impl From<TracerError> for FrameError {
    fn from(error: TracerError) -> FrameError {
        match error {
            TracerError::Build(error) => FrameError::Build(error),
            TracerError::Render(RenderError::Query(error)) => FrameError::Query(error),
            TracerError::Render(RenderError::Gpu(GpuError::Lost { reason })) => {
                FrameError::Query(DeviceError::Lost { reason }.into())
            }
            error => FrameError::Tracer(error),
        }
    }
}

impl From<AnimationError> for FrameError {
    fn from(error: AnimationError) -> FrameError {
        FrameError::Animation(error.to_string())
    }
}

impl From<PictureError> for FrameError {
    fn from(error: PictureError) -> FrameError {
        FrameError::View(error.to_string())
    }
}

impl FrameError {
    /// True when the device is gone, and the window with it.
    pub fn is_device_loss(&self) -> bool {
        matches!(
            self,
            FrameError::Build(BuildError::Device(DeviceError::Lost { .. }))
                | FrameError::Query(QueryError::Device(DeviceError::Lost { .. }))
                | FrameError::Open(OpenError::DeviceFailed { .. })
        )
    }
}
