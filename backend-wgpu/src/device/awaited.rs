//! Work of other crates on a device, awaited without blocking.

use std::sync::Arc;

use super::deferred::Mark;
use super::gpu::Gpu;
use super::patience::Patience;
use super::wait::{Bell, Wait};
use crate::error::GpuError;

/// A piece of work on a device whose end is awaited without blocking: what the device refuses from its begin on counts as
/// its own, which a browser tells later than it happens.
#[derive(Debug)]
pub struct Awaited {
    gpu: Arc<Gpu>,
    from: Mark,
    patience: Patience,
}

impl Awaited {
    /// Begins a piece of work.
    pub fn begin(gpu: Arc<Gpu>) -> Awaited {
        let (from, patience) = (gpu.mark(), Patience::new(gpu.timeout()));
        Awaited { gpu, from, patience }
    }

    /// The device may take its time-out again: more was submitted.
    pub fn renew(&mut self) {
        self.patience = Patience::new(self.gpu.timeout());
    }

    /// Gives way to others for some milliseconds.
    ///
    /// # Errors
    /// What was refused since the work began; a lost device; one that takes longer than its time-out.
    pub async fn pause(&mut self) -> Result<(), GpuError> {
        self.gpu.settled(self.from)?;
        self.gpu.check()?;
        if self.patience.is_over() {
            return Err(self.patience.exceeded());
        }
        // Nothing rings: the next tick ends it.
        Wait::Yielding.pause(std::time::Duration::ZERO, &Bell::default()).await
    }

    /// Gives way to others once, however fast the device is.
    ///
    /// # Errors
    /// A lost device.
    pub async fn give_way(&self) -> Result<(), GpuError> {
        self.gpu.check()?;
        let rung = Bell::default();
        rung.ring();
        Wait::Yielding.pause(std::time::Duration::ZERO, &rung).await
    }

    /// Waits until it is known how all that was done since the work began went.
    ///
    /// # Errors
    /// As for [`Awaited::pause`].
    pub async fn settle(&self) -> Result<(), GpuError> {
        self.gpu.settle(Wait::Yielding, self.from).await
    }

    /// The error of work that failed: what was refused before, or the loss of the device, where that is why.
    pub async fn cause<E: From<GpuError>>(&self, error: E) -> E {
        let error = match self.settle().await {
            Err(refused) => refused.into(),
            Ok(()) => error,
        };
        self.gpu.cause(error).await
    }
}
