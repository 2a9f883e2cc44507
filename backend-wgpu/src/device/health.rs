//! Whether a device still works, and what went wrong on it outside any error scope.

use std::any::Any;
use std::cell::Cell;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::{Arc, Mutex, PoisonError};

use crate::error::GpuError;

/// The known errors of a device; shared with its callbacks.
#[derive(Debug, Default)]
pub(crate) struct Health {
    lost: Mutex<Option<String>>,
    uncaptured: Mutex<Option<GpuError>>,
}

impl Health {
    /// Makes the device report losses and uncaptured errors here. Replaces whatever was set before,
    /// so it is for own devices only.
    pub(crate) fn watch(self: &Arc<Health>, device: &wgpu::Device) {
        let health = Arc::clone(self);
        device.set_device_lost_callback(move |reason, message| {
            let message = message.trim();
            health.lose(match reason {
                wgpu::DeviceLostReason::Destroyed => "it was destroyed",
                wgpu::DeviceLostReason::Unknown if message.is_empty() => "the driver says no more",
                wgpu::DeviceLostReason::Unknown => message,
            });
        });
        let health = Arc::clone(self);
        device.on_uncaptured_error(Arc::new(move |error| {
            let mut first = health.uncaptured.lock().unwrap_or_else(PoisonError::into_inner);
            first.get_or_insert(GpuError::from_wgpu(error));
        }));
    }

    /// Notes that the device is gone; the first reason stays.
    fn lose(&self, reason: &str) {
        let mut lost = self.lost.lock().unwrap_or_else(PoisonError::into_inner);
        lost.get_or_insert_with(|| reason.to_owned());
    }

    /// An error if the device is gone. Asks the device too, since a host may keep the report of the
    /// loss for itself, and since wgpu reports a destroyed device only when its work is done.
    pub(crate) fn check_lost(&self, device: &wgpu::Device) -> Result<(), GpuError> {
        let known = || self.lost.lock().unwrap_or_else(PoisonError::into_inner).clone();
        if known().is_none() && !answers(device) {
            self.lose("it no longer accepts commands");
        }
        known().map_or(Ok(()), |reason| Err(GpuError::Lost { reason }))
    }

    /// The first error since the last call that no error scope caught.
    pub(crate) fn take_uncaptured(&self) -> Result<(), GpuError> {
        let mut first = self.uncaptured.lock().unwrap_or_else(PoisonError::into_inner);
        first.take().map_or(Ok(()), Err)
    }

    /// Polls. wgpu panics when the driver reports the loss of the device while it waits; that
    /// becomes an error here.
    pub(crate) fn poll(
        &self,
        device: &wgpu::Device,
        poll: wgpu::PollType,
    ) -> Result<Result<wgpu::PollStatus, wgpu::PollError>, GpuError> {
        let outer = POLLS.replace(true);
        let polled = catch_unwind(AssertUnwindSafe(|| device.poll(poll)));
        POLLS.set(outer);
        polled.or_else(|panic| match self.check_lost(device) {
            Err(lost) => Err(lost),
            // A wait ran out of time while another thread found that all is done; wgpu treats that
            // as a contradiction.
            Ok(()) if says(&*panic, "If the queue is empty") => {
                Ok(Ok(wgpu::PollStatus::QueueEmpty))
            }
            // Not the device: a callback of the host, or a bug in wgpu. The hook printed nothing.
            Ok(()) => match panic.downcast::<String>() {
                Ok(message) => panic!("{message}"),
                Err(panic) => match panic.downcast::<&'static str>() {
                    Ok(message) => panic!("{message}"),
                    Err(panic) => resume_unwind(panic),
                },
            },
        })
    }
}

/// Whether a panic's message begins like this.
fn says(panic: &(dyn Any + Send), start: &str) -> bool {
    let message = panic.downcast_ref::<String>().map(String::as_str);
    message.or(panic.downcast_ref::<&str>().copied()).is_some_and(|text| text.starts_with(start))
}

thread_local! {
    static POLLS: Cell<bool> = const { Cell::new(false) };
}

/// True while this thread waits for a device: a panic now is caught and becomes
/// [`GpuError::Lost`], or is raised again if the device is not lost. A panic hook that ends the
/// process, or prints, should do nothing then.
pub fn panic_is_caught() -> bool {
    POLLS.get()
}

/// A browser maps buffers of lost devices too, and tells the loss by the callback alone.
#[cfg(target_family = "wasm")]
fn answers(_device: &wgpu::Device) -> bool {
    true
}

/// Whether a device can still create objects. wgpu reports nothing for commands to a lost device,
/// but it allocates no buffer on one. This needs no callback.
#[cfg(not(target_family = "wasm"))]
fn answers(device: &wgpu::Device) -> bool {
    let validation = device.push_error_scope(wgpu::ErrorFilter::Validation);
    let memory = device.push_error_scope(wgpu::ErrorFilter::OutOfMemory);
    let buffer = device.create_buffer(&wgpu::BufferDescriptor {
        label: Some("splitplane: is the device there?"),
        size: 4,
        usage: wgpu::BufferUsages::MAP_WRITE,
        mapped_at_creation: true,
    });
    let mapped = buffer.get_mapped_range(..).is_ok();
    let full = pollster::block_on(memory.pop()).is_some();
    let refused = pollster::block_on(validation.pop()).is_some();
    mapped || full || refused
}
