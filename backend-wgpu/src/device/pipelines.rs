//! The compiled kernels of any set: each when it is first used.

use std::borrow::Cow;
use std::sync::{Mutex, MutexGuard, PoisonError};

use splitplane_core::kernel::{KernelSet, Slot};
use splitplane_shaders::Part;

use super::bindings::layout;
use super::kernel_set::{Bound, DeviceSet, Text};
use crate::device::gpu::Gpu;
use crate::error::GpuError;

/// A kernel ready for dispatch.
#[derive(Clone, Debug)]
pub struct Compiled {
    /// The pipeline.
    pub pipeline: wgpu::ComputePipeline,
    /// The layout of its bind group.
    pub layout: wgpu::BindGroupLayout,
}

/// A kernel in one variant.
#[derive(Debug)]
struct Held {
    set: &'static str,
    kernel: &'static str,
    parts: Cow<'static, [Part]>,
    /// The numbers of its bindings.
    bindings: Vec<u32>,
    compiled: Compiled,
}

impl Held {
    fn is_of<K: KernelSet>(&self, kernel: K::Kernel) -> bool {
        (self.set, self.kernel) == (K::NAME, K::kernel(kernel).name)
    }

    fn is_made_of(&self, parts: &[Part], bindings: &[u32]) -> bool {
        self.bindings == bindings
            && self.parts.iter().map(|part| part.name).eq(parts.iter().map(|part| part.name))
    }
}

/// Which of the shaders of a kernel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Which {
    /// Its own: [`DeviceSet::text`].
    Own,
    /// [`DeviceSet::retry`].
    Retry,
    /// [`DeviceSet::settle`].
    Settle,
}

/// Another text in place of a kernel's own.
#[derive(Debug)]
struct Replaced {
    set: &'static str,
    kernel: &'static str,
    which: Which,
    source: String,
}

/// A change to the text of every kernel, and a buffer that the changed kernels bind behind their own: for tools that
/// count what kernels do. The device must allow one more storage buffer in a stage than WebGPU promises.
#[doc(hidden)]
#[derive(Clone, Debug)]
pub struct Instrument {
    /// Gives the text to compile, from the kernel's own and the number of the additional binding.
    pub rewrite: fn(&str, u32) -> Result<String, String>,
    /// Bound there, for reading and writing.
    pub buffer: wgpu::Buffer,
}

/// Compiled kernels of any number of sets, identified by set, kernel and the parts of the text.
#[derive(Debug, Default)]
pub struct Pipelines {
    held: Mutex<Vec<Held>>,
    /// Tests plant faults by it.
    replaced: Mutex<Option<Replaced>>,
    instrument: Option<Instrument>,
}

/// A thread that panicked leaves the lists consistent: they only grow by whole entries.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Pipelines {
    /// Kernels that are changed in this way.
    #[doc(hidden)]
    pub fn instrumented(instrument: Instrument) -> Pipelines {
        Pipelines { instrument: Some(instrument), ..Pipelines::default() }
    }

    /// What kernels bind behind their own.
    pub(crate) fn counted(&self) -> Option<&wgpu::Buffer> {
        self.instrument.as_ref().map(|instrument| &instrument.buffer)
    }

    /// Gives one kernel another text from now on, or its own again: for tests that plant faults.
    #[doc(hidden)]
    pub fn replace<K: KernelSet>(&self, kernel: K::Kernel, source: Option<String>) {
        self.replace_text::<K>(kernel, Which::Own, source);
    }

    /// The same for what finishes the kernel's work: see [`DeviceSet::retry`].
    #[doc(hidden)]
    pub fn replace_retry<K: KernelSet>(&self, kernel: K::Kernel, source: Option<String>) {
        self.replace_text::<K>(kernel, Which::Retry, source);
    }

    /// The same for what follows both: see [`DeviceSet::settle`].
    #[doc(hidden)]
    pub fn replace_settle<K: KernelSet>(&self, kernel: K::Kernel, source: Option<String>) {
        self.replace_text::<K>(kernel, Which::Settle, source);
    }

    fn replace_text<K: KernelSet>(&self, kernel: K::Kernel, which: Which, source: Option<String>) {
        lock(&self.held).retain(|held| !held.is_of::<K>(kernel));
        let (set, kernel) = (K::NAME, K::kernel(kernel).name);
        *lock(&self.replaced) = source.map(|source| Replaced { set, kernel, which, source });
    }

    /// A kernel, compiled if it was not yet.
    ///
    /// # Errors
    /// The device refuses it, or its driver exceeds a limit.
    pub fn get<K: DeviceSet>(
        &self,
        gpu: &Gpu,
        kernel: K::Kernel,
        variant: &K::Variant,
    ) -> Result<Compiled, GpuError> {
        self.of_text::<K>(gpu, kernel, K::text(kernel, variant), variant, Which::Own)
    }

    /// What finishes what a kernel leaves to it: see [`DeviceSet::retry`].
    ///
    /// # Errors
    /// As for [`Pipelines::get`].
    pub fn get_retry<K: DeviceSet>(
        &self,
        gpu: &Gpu,
        kernel: K::Kernel,
        variant: &K::Variant,
    ) -> Result<Option<Compiled>, GpuError> {
        let text = K::retry(kernel, variant);
        text.map(|text| self.of_text::<K>(gpu, kernel, text, variant, Which::Retry)).transpose()
    }

    /// What follows both: see [`DeviceSet::settle`].
    ///
    /// # Errors
    /// As for [`Pipelines::get`].
    pub fn get_settle<K: DeviceSet>(
        &self,
        gpu: &Gpu,
        kernel: K::Kernel,
        variant: &K::Variant,
    ) -> Result<Option<Compiled>, GpuError> {
        let text = K::settle(kernel, variant);
        text.map(|text| self.of_text::<K>(gpu, kernel, text, variant, Which::Settle)).transpose()
    }

    fn of_text<K: DeviceSet>(
        &self,
        gpu: &Gpu,
        kernel: K::Kernel,
        Text { name, parts }: Text,
        variant: &K::Variant,
        which: Which,
    ) -> Result<Compiled, GpuError> {
        let parts = gpu.parts(parts);
        let bound = K::bindings(kernel, variant);
        let bindings: Vec<u32> = bound.iter().map(|bound| bound.binding).collect();
        let same = |held: &&Held| held.is_of::<K>(kernel) && held.is_made_of(&parts, &bindings);
        // Variants of a kernel with the same numbers bind the same.
        let mut known = None;
        for held in lock(&self.held).iter().filter(|held| held.is_of::<K>(kernel)) {
            if held.is_made_of(&parts, &bindings) {
                return Ok(held.compiled.clone());
            }
            if held.bindings == bindings {
                known = Some(held.compiled.layout.clone());
            }
        }
        let counted = self.counted().is_some();
        let layout = known.unwrap_or_else(|| layout::<K>(gpu, kernel, &bound, counted));
        let source = match &*lock(&self.replaced) {
            Some(replaced)
                if (replaced.set, replaced.kernel, replaced.which)
                    == (K::NAME, K::kernel(kernel).name, which) =>
            {
                replaced.source.clone()
            }
            _ => splitplane_shaders::join(&parts),
        };
        let source = continued(name, source, &bound)?;
        let source = match &self.instrument {
            Some(instrument) => (instrument.rewrite)(&source, bound.len() as u32)
                .map_err(|reason| GpuError::Shader { shader: name.to_owned(), reason })?,
            None => source,
        };
        let pipeline = gpu.pipeline_with_layout(name, &source, &layout)?;
        let mut held = lock(&self.held);
        // Another thread may have been faster: then its result stays.
        if let Some(held) = held.iter().find(same) {
            return Ok(held.compiled.clone());
        }
        let compiled = Compiled { pipeline, layout };
        let (set, kernel) = (K::NAME, K::kernel(kernel).name);
        held.push(Held { set, kernel, parts, bindings, compiled: compiled.clone() });
        Ok(compiled)
    }

    /// Kernels of all sets and variants that were compiled so far.
    pub fn count(&self) -> usize {
        lock(&self.held).len()
    }
}

/// A text whose lists go on in second bindings where these bindings say so.
pub(crate) fn continued<K: KernelSet>(
    shader: &str,
    source: String,
    bound: &[Bound<K>],
) -> Result<String, GpuError> {
    let mut source = source;
    for Bound { binding, slot, .. } in bound.iter().filter(|bound| bound.part > 0) {
        if let Slot::Storage(storage) = slot {
            let name = K::buffer(storage.buffer).name;
            let continued = splitplane_shaders::continue_lists(&source, &[name], *binding);
            source = continued.ok_or_else(|| GpuError::Shader {
                shader: shader.to_owned(),
                reason: format!("{name} is not declared as a list"),
            })?;
        }
    }
    Ok(source)
}
