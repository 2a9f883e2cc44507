//! What kernels do, counted while they run: rounds of loops, operations, loads, barriers; and what a build moves and
//! asks of the device. Figures of the work, not of a device: they are the same on any adapter.

pub(crate) mod build;
pub(crate) mod device;
pub(crate) mod rays;
pub(crate) mod rewrite;
pub(crate) mod table;
pub(crate) mod tally;

#[cfg(test)]
mod tests;
