//! The border: no panic crosses it, and each thread has the message of its last failure.

use std::any::Any;
use std::cell::RefCell;
use std::ffi::{CStr, CString, c_char};
use std::panic::{AssertUnwindSafe, catch_unwind};

use splitplane_float_state::standard;

use crate::status::{Failure, Status};

thread_local! {
    static MESSAGE: RefCell<CString> = RefCell::new(CString::default());
}

/// Does the work of a call, in the default floating-point state: the caller may have called `fesetround`.
pub(crate) fn entry(work: impl FnOnce() -> Result<(), Failure>) -> Status {
    let failure = match catch_unwind(AssertUnwindSafe(|| standard(work))) {
        Ok(Ok(())) => return Status::Ok,
        Ok(Err(failure)) => failure,
        Err(panic) => {
            let failure = Failure::new(Status::Internal, format!("a fault: {}", said(&*panic)));
            // Its own end may panic again.
            std::mem::forget(panic);
            failure
        }
    };
    let Failure { status, text } = failure;
    let text = CString::new(text.replace('\0', " ")).unwrap_or_default();
    // A thread that is ending has no place for it any more.
    let _ = MESSAGE.try_with(|message| message.replace(text));
    status
}

fn said(panic: &(dyn Any + Send)) -> &str {
    let text = panic.downcast_ref::<String>().map(String::as_str);
    text.or_else(|| panic.downcast_ref::<&str>().copied()).unwrap_or("it says nothing")
}

/// Why the last call of this thread failed that did: UTF-8, empty if none has. The text is there until another call of this thread fails.
///
/// Threads: each has its own.
#[unsafe(no_mangle)]
pub extern "C" fn splitplane_last_message() -> *const c_char {
    MESSAGE.try_with(|message| message.borrow().as_ptr()).unwrap_or(c"".as_ptr())
}

/// The version of the library, such as `0.1.0`. `SPLITPLANE_VERSION` is that of the header.
///
/// Threads: any.
#[unsafe(no_mangle)]
pub extern "C" fn splitplane_version() -> *const c_char {
    const VERSION: &CStr =
        match CStr::from_bytes_with_nul(concat!(env!("CARGO_PKG_VERSION"), "\0").as_bytes()) {
            Ok(version) => version,
            Err(_) => c"",
        };
    VERSION.as_ptr()
}
