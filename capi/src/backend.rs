//! Backends by name.

use std::ffi::c_char;
use std::sync::Arc;

use library::backend::Engine;
use library::{Backend as LibraryBackend, BackendKind, OpenOptions, Preset};

use crate::buffer::{check, check_offer, text, write};
use crate::entry::entry;
use crate::handle::{Backend, free, get, insert};
use crate::status::{Failure, Status};

/// A backend, and why it is this one.
pub struct Opened {
    pub(crate) engine: Arc<Engine>,
    reason: String,
}

impl Opened {
    pub(crate) fn backend(&self) -> &dyn LibraryBackend {
        self.engine.as_backend()
    }

    pub(crate) fn is_cpu(&self) -> bool {
        matches!(*self.engine, Engine::Cpu(_))
    }
}

/// Opens a backend: `cpu`, `wgpu` (a GPU, software included) or `auto` (a GPU that gives the CPU's answers bit for bit, else the CPU). `adapter` names a GPU by a part of its name; NULL for
/// any. To open a GPU takes long, since it is tested; keep the backend.
///
/// Trees and scenes keep what they need of it: it may be freed while they live. It keeps memory of builds for the next one.
///
/// Threads: any; one backend may serve several at a time.
///
/// # Safety
/// Texts end with a 0, and `backend` has room for a handle.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn splitplane_backend_open(
    name: *const c_char,
    adapter: *const c_char,
    backend: *mut Backend,
) -> Status {
    entry(|| {
        check(backend, "backend")?;
        // SAFETY: as the caller says.
        let name = unsafe { text(name, "name")? };
        let adapter = match adapter.is_null() {
            true => None,
            // SAFETY: as the caller says.
            false => Some(unsafe { text(adapter, "adapter")? }.to_owned()),
        };
        let kind: BackendKind =
            name.parse().map_err(|error: library::backend::UnknownBackend| {
                Failure::new(Status::Option, error.to_string())
            })?;
        let options = OpenOptions { adapter, preset: Preset::Fast, ..OpenOptions::default() };
        let found = kind.open_engine(&options)?;
        let handle = insert(Opened { engine: Arc::new(found.engine), reason: found.reason })?;
        // SAFETY: there is room.
        unsafe { write(backend, handle, "backend") }
    })
}

/// Writes what a backend is, and why it is this one, as a text that ends with a 0. `needed`, which may be NULL, gets the bytes that it takes; `SPLITPLANE_STATUS_CAPACITY` where
/// there is less room. With `text` NULL and capacity 0 only `needed` is written.
///
/// Threads: any.
///
/// # Safety
/// `text` has room for `capacity` bytes.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn splitplane_backend_describe(
    backend: Backend,
    text: *mut c_char,
    capacity: usize,
    needed: *mut usize,
) -> Status {
    entry(|| {
        let opened = get(backend)?;
        let info = opened.backend().describe();
        let adapter = info.adapter.map_or(String::new(), |adapter| format!(" on {adapter}"));
        let threads = info.threads.map_or(String::new(), |count| format!(", {count} threads"));
        let (name, detail, reason) = (info.name, info.detail, &opened.reason);
        let said = format!("{name}{adapter}{threads}, {detail}; {reason}\0");
        // SAFETY: as the caller says.
        unsafe { hand_over(said.as_bytes(), text.cast(), capacity, needed) }
    })
}

/// Gives the caller bytes, in two calls: how many, and the bytes.
///
/// # Safety
/// `room` has room for `capacity` bytes, and `needed` is null or has some for a number.
pub(crate) unsafe fn hand_over(
    bytes: &[u8],
    room: *mut u8,
    capacity: usize,
    needed: *mut usize,
) -> Result<(), Failure> {
    check_offer(needed, "needed")?;
    if !needed.is_null() {
        // SAFETY: there is room.
        unsafe { write(needed, bytes.len(), "needed")? };
    }
    if room.is_null() && capacity == 0 {
        return check(needed, "needed");
    }
    check(room, "the room for the answer")?;
    if capacity < bytes.len() {
        let text = format!("there is room for {capacity} bytes, and {} are needed", bytes.len());
        return Err(Failure::new(Status::Capacity, text));
    }
    // SAFETY: there is room for them, and it is not memory of ours.
    unsafe { std::ptr::copy_nonoverlapping(bytes.as_ptr(), room, bytes.len()) };
    Ok(())
}

/// Frees a backend. 0 is no mistake.
///
/// Threads: any; calls that use it go on.
#[unsafe(no_mangle)]
pub extern "C" fn splitplane_backend_free(backend: Backend) -> Status {
    entry(|| free(backend))
}
