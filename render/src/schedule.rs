//! The schedule of a frame, stated once: Whitted's recursion as waves of rays. Every executor runs this
//! code.

use crate::kernel::{Buffer, Counter, Kernel, RayTracer};
use crate::plan::Plan;
use splitplane_core::build::schedule::Executor;

/// Renders a frame.
///
/// The executor must hold the scene and the frame's uniform; [`Counter::Pixels`] must be the end of
/// [`Plan::pixels`], [`Counter::PixelsLeft`] their number, every other counter zero, and so must
/// [`Buffer::Radiance`]. Afterwards the buffers of [`Plan::outputs`](Plan) hold the frame, unless
/// [`Counter::Overflow`] is set.
///
/// # Errors
/// The executor's.
pub fn frame<E: Executor<RayTracer>>(executor: &mut E, plan: &Plan) -> Result<(), E::Error> {
    pass(executor, plan)?;
    finish(executor, plan)
}

/// One pass of a frame that has several: its light is added to [`Buffer::Radiance`]. Counters are as for [`frame`], but for the sums.
///
/// # Errors
/// The executor's.
pub fn pass<E: Executor<RayTracer>>(executor: &mut E, plan: &Plan) -> Result<(), E::Error> {
    let mut slice = 0;
    while executor.pending(Counter::PixelsLeft, slice)? {
        executor.dispatch(Kernel::BeginSlice)?;
        executor.dispatch(Kernel::CameraRays)?;
        waves(executor, plan)?;
        slice += 1;
    }
    Ok(())
}

/// What is left to do after the last pass.
///
/// # Errors
/// The executor's.
pub fn finish<E: Executor<RayTracer>>(executor: &mut E, plan: &Plan) -> Result<(), E::Error> {
    if plan.outputs().pixels {
        executor.dispatch(Kernel::Resolve)?;
    }
    Ok(())
}

/// Follows the paths of a slice, all by one bounce at a time.
fn waves<E: Executor<RayTracer>>(executor: &mut E, plan: &Plan) -> Result<(), E::Error> {
    let outputs = plan.outputs();
    let mut wave = 0;
    while executor.pending(Counter::Paths, wave)? {
        if outputs.first_costs && wave == 0 {
            executor.dispatch(Kernel::FirstCosts)?;
        }
        executor.dispatch(Kernel::ClosestHits)?;
        if outputs.first_hits && wave == 0 {
            executor.dispatch(Kernel::FirstHits)?;
        }
        if outputs.shades() {
            shade(executor, plan)?;
        }
        wave += 1;
        if !plan.recursive() {
            break;
        }
        executor.dispatch(Kernel::NextPaths)?;
        executor.dispatch(Kernel::BeginWave)?;
        executor.swap(Buffer::Rays, Buffer::NextRays)?;
        executor.swap(Buffer::Paths, Buffer::NextPaths)?;
    }
    Ok(())
}

/// The light that reaches the eye from what the rays of this wave met.
fn shade<E: Executor<RayTracer>>(executor: &mut E, plan: &Plan) -> Result<(), E::Error> {
    executor.dispatch(Kernel::Shade)?;
    if plan.spawns() {
        executor.dispatch(Kernel::ScanSpawned)?;
    }
    if plan.casts_shadows() {
        executor.dispatch(Kernel::ShadowRays)?;
        executor.dispatch(plan.shadow_kernel())?;
    }
    executor.dispatch(Kernel::Accumulate)
}
