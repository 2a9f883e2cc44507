//! Where the GPU backend joins the facade: an opened device becomes a backend.

use super::Engine;
use splitplane_wgpu::{Gpu, GpuError, Parity, WgpuBackend};

/// The backend over an opened device, and what its self-test found.
pub(super) fn connect(gpu: Gpu) -> Result<(Engine, Parity), GpuError> {
    let backend = WgpuBackend::new(gpu)?;
    let parity = backend.parity().cloned().expect("`new` has tested it");
    Ok((Engine::Wgpu(backend), parity))
}
