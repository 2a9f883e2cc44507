//! The bytes that each kernel of a build must move at the least.
//!
//! Counted while the CPU runs the schedule: the live elements of every buffer that a kernel reads or
//! writes, once each. Lists that are appended to count what is new. Left out is what only some
//! elements need: triangles for clipping, references that `split_median` looks at.

use std::collections::HashMap;

use serde::Serialize;
use splitplane::core::build::schedule;
use splitplane::core::build::schedule::Executor;
use splitplane::core::kernel::{Access, Buffer, Counter, Kernel, TreeBuilder};
use splitplane::gpu::KernelTime;
use splitplane::{BuildError, Mesh, Preset};
use splitplane_cpu::buffers::Buffers;
use splitplane_cpu::{CpuExecutor, InstructionSet};

use crate::Failure;

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
    let mut counting = Counting {
        executor,
        input: input as u64,
        bytes: [None; Kernel::ALL.len()],
        written: HashMap::new(),
    };
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
    input: u64,
    /// `None` for kernels that did not run.
    bytes: [Option<u64>; Kernel::ALL.len()],
    /// How long appended lists were when they were written last.
    written: HashMap<Buffer, u64>,
}

impl Counting<'_> {
    fn count(&mut self, kernel: Kernel) {
        let live = |buffer: Buffer| -> u64 {
            buffer.live().map_or(0, |counter| self.executor.counters()[counter].into())
        };
        let mut bytes = 0;
        for binding in kernel.bindings() {
            let buffer = binding.buffer;
            let size = buffer.element_size() as u64;
            bytes += match (kernel, buffer) {
                (_, Buffer::Input) => self.input,
                (Kernel::ClassifyReferences | Kernel::ScatterReferences, Buffer::Triangles)
                | (Kernel::SplitMedian, Buffer::References) => 0,
                (Kernel::EmitTop, Buffer::Nodes) => size * live(Buffer::TopNodes),
                (Kernel::EmitSmall, Buffer::Nodes) => {
                    size * live(Buffer::Nodes).saturating_sub(live(Buffer::TopNodes))
                }
                (
                    _,
                    Buffer::SmallRoots
                    | Buffer::SmallReferences
                    | Buffer::TopNodes
                    | Buffer::LevelStarts,
                ) if binding.access != Access::Read => {
                    let length = live(buffer);
                    let before = self.written.insert(buffer, length).unwrap_or(0);
                    size * length.saturating_sub(before)
                }
                // A part of each element is written, or it is read first.
                _ if matches!(binding.access, Access::ReadWrite | Access::Scatter) => {
                    2 * size * live(buffer)
                }
                _ => size * live(buffer),
            };
        }
        *self.bytes[kernel as usize].get_or_insert(0) += bytes;
    }
}

impl Executor<TreeBuilder> for Counting<'_> {
    type Error = BuildError;

    fn dispatch(&mut self, kernel: Kernel) -> Result<(), BuildError> {
        self.executor.dispatch(kernel)?;
        self.count(kernel);
        Ok(())
    }

    fn swap(&mut self, a: Buffer, b: Buffer) -> Result<(), BuildError> {
        self.executor.swap(a, b)
    }

    fn pending(&mut self, counter: Counter, rounds: u32) -> Result<bool, BuildError> {
        self.executor.pending(counter, rounds)
    }
}
