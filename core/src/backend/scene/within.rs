//! Progress of a geometry's batch as part of a scene's.

use core::ops::ControlFlow;

use crate::watch::{Progress, Watch};

/// Turns the progress of a geometry's batch into that of the scene's.
pub(super) struct Within<'a> {
    pub(super) watch: &'a dyn Watch,
    pub(super) done: u64,
    pub(super) total: u64,
}

impl Watch for Within<'_> {
    fn progress(&self, progress: &Progress) -> ControlFlow<()> {
        self.watch.progress(&Progress { done: self.done, total: self.total, ..*progress })
    }
}
