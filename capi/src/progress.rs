//! The progress function of the caller's, as a watch of the library's.

use std::ffi::{c_char, c_void};
use std::ops::ControlFlow;

use library::{Progress, Stage, Watch};

use crate::options::ProgressFunction;

/// The progress function of a call, for a part of it.
#[derive(Clone, Copy)]
pub(crate) struct Caller {
    function: unsafe extern "C" fn(*mut c_void, *const c_char, u64, u64) -> i32,
    user: *mut c_void,
    /// Items before this part.
    first: u64,
    /// Items of the whole; `None` where the part is all.
    total: Option<u64>,
}

// SAFETY: the function may be called from any thread, as its documentation says.
unsafe impl Send for Caller {}
// SAFETY: as above.
unsafe impl Sync for Caller {}

impl Caller {
    /// The same for a part of a batch.
    pub(crate) fn part(self, first: usize, total: usize) -> Caller {
        Caller { first: first as u64, total: Some(total as u64), ..self }
    }
}

/// A stage's name with an end.
pub(crate) fn stage_name(stage: Stage) -> &'static std::ffi::CStr {
    match stage {
        Stage::Start => c"triangle bounds",
        Stage::LargeNodes => c"large-node stage",
        Stage::SmallNodes => c"small-node stage",
        Stage::Output => c"output stage",
        Stage::Offline => c"offline builder",
        Stage::Layout => c"query layout",
        Stage::Device => c"device",
        Stage::Rays => c"rays",
        Stage::Geometries => c"geometries",
        Stage::Points => c"point tree",
        _ => c"work",
    }
}

impl Watch for Caller {
    fn progress(&self, progress: &Progress) -> ControlFlow<()> {
        let (done, total) = match (progress.stage, self.total) {
            (Stage::Rays, Some(total)) => (progress.done + self.first, total),
            _ => (progress.done, progress.total),
        };
        let name = stage_name(progress.stage).as_ptr();
        // SAFETY: the caller of the entry vouches for the function.
        match unsafe { (self.function)(self.user, name, done, total) } {
            0 => ControlFlow::Continue(()),
            _ => ControlFlow::Break(()),
        }
    }
}

/// The function of settings, if there is one.
pub(crate) fn caller(progress: ProgressFunction, user: *mut c_void) -> Option<Caller> {
    progress.map(|function| Caller { function, user, first: 0, total: None })
}

/// As the library takes it.
pub(crate) fn watch(caller: &Option<Caller>) -> Option<&dyn Watch> {
    caller.as_ref().map(|caller| -> &dyn Watch { caller })
}
