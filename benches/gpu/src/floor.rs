//! The bytes that each kernel of a build must move at the least.
//!
//! Counted while the CPU runs the schedule: see [`crate::moved`].

use serde::Serialize;
use splitplane::core::build::schedule;
use splitplane::core::build::schedule::Executor;
use splitplane::core::kernel::{Buffer, Counter, Kernel, TreeBuilder};
use splitplane::gpu::KernelTime;
use splitplane::{BuildError, Mesh, Preset};
use splitplane_cpu::buffers::Buffers;
use splitplane_cpu::{CpuExecutor, InstructionSet};

use crate::Failure;
use crate::moved::Ledger;

/// A kernel of a build: its time and the least it moves.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct KernelFloor {
    pub kernel: &'static str,
    /// Passes it was timed in; `None` where nothing was timed.
    pub passes: Option<u32>,
    pub ms: Option<f64>,
    pub bytes: u64,
}

/// The kernels that a preset runs, in the order of the schedule.
pub(crate) fn moved(
    mesh: &Mesh<'_>,
    preset: Preset,
    times: &[KernelTime],
) -> Result<Vec<KernelFloor>, Failure> {
    let planes = preset.planes().ok_or(BuildError::PresetNotOnDevice { preset })?;
    let config = preset.config();
    let set = InstructionSet::available().last().copied().unwrap_or(InstructionSet::Portable);
    let executor = CpuExecutor::new(*mesh, config, set, Buffers::default(), None)?;
    let (positions, indices) = mesh.arrays();
    let input = size_of_val(positions) + indices.map_or(0, size_of_val);
    let mut counting =
        Counting { executor, ledger: Ledger::new(input as u64), bytes: [None; Kernel::ALL.len()] };
    schedule::build(&mut counting, planes)?;
    Ok(Kernel::ALL
        .iter()
        .filter_map(|&kernel| {
            let bytes = counting.bytes[kernel as usize]?;
            let time = times.iter().find(|time| time.kernel == kernel);
            Some(KernelFloor {
                kernel: kernel.name(),
                passes: time.map(|time| time.dispatches),
                ms: time.map(|time| time.nanoseconds * 1e-6),
                bytes,
            })
        })
        .collect())
}

struct Counting<'a> {
    executor: CpuExecutor<'a>,
    ledger: Ledger,
    /// `None` for kernels that did not run.
    bytes: [Option<u64>; Kernel::ALL.len()],
}

impl Executor<TreeBuilder> for Counting<'_> {
    type Error = BuildError;

    fn dispatch(&mut self, kernel: Kernel) -> Result<(), BuildError> {
        self.executor.dispatch(kernel)?;
        let moved = self.ledger.dispatch(kernel, self.executor.counters());
        *self.bytes[kernel as usize].get_or_insert(0) += moved.read + moved.written;
        Ok(())
    }

    fn swap(&mut self, a: Buffer, b: Buffer) -> Result<(), BuildError> {
        self.ledger.swap(a, b);
        self.executor.swap(a, b)
    }

    fn pending(&mut self, counter: Counter, rounds: u32) -> Result<bool, BuildError> {
        self.executor.pending(counter, rounds)
    }
}
