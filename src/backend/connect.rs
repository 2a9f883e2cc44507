//! Where the GPU backend joins the facade: an opened device becomes a backend.

use splitplane_core::backend::Backend;
use splitplane_wgpu::{Gpu, GpuError, Parity};

/// The backend over an opened device, and what its self-test found.
pub(super) fn connect(gpu: Gpu) -> Result<(Box<dyn Backend>, Parity), GpuError> {
    let adapter = &gpu.info().name;
    Err(GpuError::Refused(format!("this version builds no trees on `{adapter}`")))
}
