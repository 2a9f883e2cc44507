//! Catches errors that wgpu reports beside the call.

use crate::device::gpu::Gpu;
use crate::error::GpuError;

/// Runs `work`; a validation error or a lack of memory that wgpu reports meanwhile becomes an
/// error. Without this a refused submission would go unnoticed, and results of an earlier one would
/// be read. A browser tells errors later: see [`Gpu::guard`].
#[cfg(not(target_family = "wasm"))]
pub(crate) fn checked<T>(
    gpu: &Gpu,
    what: &str,
    work: impl FnOnce() -> Result<T, GpuError>,
) -> Result<T, GpuError> {
    let memory = gpu.device().push_error_scope(wgpu::ErrorFilter::OutOfMemory);
    let internal = gpu.device().push_error_scope(wgpu::ErrorFilter::Internal);
    let validation = gpu.device().push_error_scope(wgpu::ErrorFilter::Validation);
    let out = work();
    let errors = [validation, internal, memory].map(|scope| pollster::block_on(scope.pop()));
    match errors.into_iter().flatten().next() {
        None => out,
        // The error of `work` itself is closer to the cause.
        Some(error) => Err(out.err().unwrap_or_else(|| match error {
            wgpu::Error::OutOfMemory { .. } => {
                GpuError::OutOfMemory { what: what.to_string(), needed: 0 }
            }
            other => GpuError::Refused(format!("{what}: {other}")),
        })),
    }
}

/// The same in a browser.
#[cfg(target_family = "wasm")]
pub(crate) fn checked<T>(
    gpu: &Gpu,
    what: &str,
    work: impl FnOnce() -> Result<T, GpuError>,
) -> Result<T, GpuError> {
    let what = what.to_owned();
    gpu.guard_as(work, move |error| match error {
        GpuError::OutOfMemory { .. } => GpuError::OutOfMemory { what, needed: 0 },
        GpuError::Refused(reason) => GpuError::Refused(format!("{what}: {reason}")),
        other => other,
    })?
}
