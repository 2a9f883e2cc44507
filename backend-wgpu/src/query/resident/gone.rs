//! Buffers of scenes that updates replaced, as long as a device may have them.

use super::reserved::Buffers;
use crate::device::gpu::Gpu;
use crate::error::GpuError;

/// Bytes of buffers that were replaced. A device has their memory until it is done with what was sent to them, however long ago the host dropped them.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Gone(u64);

impl Gone {
    pub(super) fn bytes(&self) -> u64 {
        self.0
    }

    /// Adds those of the old buffers that are none of the new ones.
    pub(super) fn add(&mut self, old: &Buffers, new: Option<&Buffers>) {
        let stays = |own: &wgpu::Buffer| new.is_some_and(|new| new.contains(own));
        let gone = old.iter().filter(|own| !stays(own)).map(wgpu::Buffer::size);
        self.0 = gone.fold(self.0, u64::saturating_add);
    }

    /// What is found with the bytes that the device may still have. Where they make a difference it waits until they are freed, so that what is found does not
    /// depend on how far the device is.
    ///
    /// # Errors
    /// What the device says while it is waited for.
    pub(super) fn decide<T: PartialEq>(
        &mut self,
        gpu: &Gpu,
        find: impl Fn(u64) -> T,
    ) -> Result<T, GpuError> {
        let found = find(self.0);
        if self.0 == 0 || found == find(0) {
            return Ok(found);
        }
        self.wait(gpu)?;
        Ok(find(self.0))
    }

    /// Waits until the device is done with them. In a browser nothing can wait, and nothing tells what the device has: they do not count there.
    ///
    /// # Errors
    /// What the device says.
    pub(super) fn wait(&mut self, gpu: &Gpu) -> Result<(), GpuError> {
        if self.0 == 0 {
            return Ok(());
        }
        // What was written to them goes with this submission.
        gpu.submit([])?;
        match gpu.wait() {
            Ok(()) => self.0 = 0,
            Err(GpuError::CannotBlock) => {
                if gpu.poll()? {
                    self.0 = 0;
                }
            }
            Err(error) => return Err(error),
        }
        Ok(())
    }
}
