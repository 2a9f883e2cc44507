//! Counts a build: every dispatch by itself.

use splitplane::core::build::schedule::{self, Executor};
use splitplane::core::kernel::{Buffer, Counter as Count, Kernel, KernelSet, TreeBuilder};
use splitplane::gpu::{Effort, GpuError, WgpuBackend, WgpuExecutor};
use splitplane::{BuildError, BuildOptions, Mesh, Preset};
use splitplane_shaders::Shader;

use super::device::Counter;
use super::rewrite;
use super::tally::{Counted, Tally};
use crate::Failure;
use crate::moved::Ledger;

/// A build that was counted.
#[derive(Clone, Debug)]
pub(crate) struct CountedBuild {
    pub triangles: u64,
    /// Of each kernel that ran, in the order of the table.
    pub kernels: Vec<Counted>,
    /// What a second build of the same scene asks of the device.
    pub rebuild: Effort,
}

impl CountedBuild {
    /// All kernels together.
    pub(crate) fn all(&self) -> Tally {
        let mut all = Tally::default();
        self.kernels.iter().for_each(|kernel| all += kernel.all());
        all
    }
}

/// Counts a build by a preset.
pub(crate) fn count(
    counter: &Counter,
    mesh: &Mesh<'_>,
    preset: Preset,
) -> Result<CountedBuild, Failure> {
    let planes = preset.planes().ok_or(BuildError::PresetNotOnDevice { preset })?;
    let config = preset.config();
    let (positions, indices) = mesh.arrays();
    let input = size_of_val(positions) + indices.map_or(0, size_of_val);
    let run = |inner: WgpuExecutor<'_>| -> Result<Vec<Vec<Tally>>, Failure> {
        let mut counting = Counting {
            inner,
            counter,
            ledger: Ledger::new(input as u64),
            dispatches: vec![Vec::new(); Kernel::ALL.len()],
        };
        schedule::build(&mut counting, planes)?;
        if counting.inner.counters()?[Count::Overflow] != 0 {
            return Err("a list outgrew what a first build estimates".into());
        }
        Ok(counting.dispatches)
    };
    let estimated = counter.backend.with_estimated_executor(mesh, &config, run)?;
    let dispatches = match estimated {
        Ok(dispatches) => dispatches,
        // Then with room for anything, and larger grids.
        Err(_) => counter.backend.with_executor(mesh, &config, run)??,
    };
    let mut kernels = Vec::new();
    for (&kernel, dispatches) in Kernel::ALL.iter().zip(dispatches) {
        if dispatches.is_empty() {
            continue;
        }
        let text = working_text(kernel);
        kernels.push(Counted {
            kernel: kernel.name(),
            text: text.name,
            lanes: rewrite::lanes(&text.source()).unwrap_or(64),
            dispatches,
        });
    }
    let rebuild = rebuild(counter, mesh, preset)?;
    Ok(CountedBuild { triangles: mesh.len() as u64, kernels, rebuild })
}

/// The text that does a kernel's work. Its own only prepares or counts where another, which follows it, does the rest: what both do is
/// counted together, and taken for the work of that.
fn working_text(kernel: Kernel) -> &'static Shader {
    let prepares = matches!(kernel, Kernel::SubtreeSizes | Kernel::PreorderAddresses);
    let follows = splitplane_shaders::kernel_retry(kernel.name()).filter(|_| prepares);
    follows.unwrap_or(&splitplane_shaders::KERNELS[TreeBuilder::kernel_index(kernel)])
}

/// What a build asks of the device when its buffers are there and its levels are known. Kernels do not count here.
fn rebuild(counter: &Counter, mesh: &Mesh<'_>, preset: Preset) -> Result<Effort, Failure> {
    let backend = WgpuBackend::without_selftest(counter.backend.gpu().clone());
    let options = BuildOptions::from(preset.config());
    let first = backend.build_on_device(mesh, &options)?;
    backend.recycle(first.tree);
    Ok(backend.build_on_device(mesh, &options)?.effort)
}

struct Counting<'a, 'b> {
    inner: WgpuExecutor<'a>,
    counter: &'b Counter,
    ledger: Ledger,
    /// By kernel.
    dispatches: Vec<Vec<Tally>>,
}

impl Executor<TreeBuilder> for Counting<'_, '_> {
    type Error = GpuError;

    fn dispatch(&mut self, kernel: Kernel) -> Result<(), GpuError> {
        self.counter.clear();
        self.inner.dispatch(kernel)?;
        // Submits, and waits.
        let counters = self.inner.counters()?;
        let mut tally = Tally::of_words(&self.counter.read()?);
        let moved = self.ledger.dispatch(kernel, &counters);
        tally.read += moved.read;
        tally.written += moved.written;
        self.dispatches[TreeBuilder::kernel_index(kernel)].push(tally);
        Ok(())
    }

    fn swap(&mut self, a: Buffer, b: Buffer) -> Result<(), GpuError> {
        self.ledger.swap(a, b);
        self.inner.swap(a, b)
    }

    fn pending(&mut self, counter: Count, rounds: u32) -> Result<bool, GpuError> {
        self.inner.pending(counter, rounds)
    }
}
