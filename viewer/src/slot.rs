//! A place for a backend: empty, opened, or with a scene.

use splitplane::tracer::{RenderBackend, Tracer, TracerError};
use splitplane_core::backend::BuildOptions;
use splitplane_core::mesh::Mesh;
use splitplane_render::Appearance;

/// A backend on its way to a scene. It is opened and tested before there is one.
#[derive(Debug, Default)]
pub(super) enum Slot {
    /// No backend was opened yet, or the one that was could not load its first scene.
    #[default]
    Empty,
    /// A backend without a scene.
    Opened(RenderBackend),
    /// A backend with a scene.
    Loaded(Box<Tracer>),
}

impl Slot {
    /// Whether a backend was opened.
    pub(super) fn is_open(&self) -> bool {
        !matches!(self, Slot::Empty)
    }

    /// The tracer, where a scene was loaded.
    pub(super) fn tracer(&self) -> Option<&Tracer> {
        match self {
            Slot::Loaded(tracer) => Some(tracer),
            Slot::Empty | Slot::Opened(_) => None,
        }
    }

    /// As [`Slot::tracer`], to work with.
    pub(super) fn tracer_mut(&mut self) -> Option<&mut Tracer> {
        match self {
            Slot::Loaded(tracer) => Some(tracer),
            Slot::Empty | Slot::Opened(_) => None,
        }
    }

    /// Loads the first scene. Does nothing without a backend, or with a scene.
    pub(super) fn load(
        &mut self,
        mesh: &Mesh<'_>,
        appearance: &Appearance<'_>,
        options: &BuildOptions<'_>,
    ) -> Result<(), TracerError> {
        *self = match std::mem::take(self) {
            Slot::Opened(backend) => {
                Slot::Loaded(Box::new(Tracer::load(backend, mesh, appearance, options)?))
            }
            other => other,
        };
        Ok(())
    }
}
