//! The compiled kernels of the tree builder: each when it is first used.

use std::sync::OnceLock;

use splitplane_core::kernel::{Access, Kernel};

use crate::error::GpuError;
use crate::gpu::Gpu;

/// A kernel ready for dispatch.
#[derive(Debug)]
pub(crate) struct Compiled {
    pub pipeline: wgpu::ComputePipeline,
    pub layout: wgpu::BindGroupLayout,
}

/// All kernels, compiled as they are used.
#[derive(Debug, Default)]
pub(crate) struct Kernels {
    compiled: [OnceLock<Compiled>; Kernel::ALL.len()],
    /// Replaces the text of one kernel: tests plant faults by it.
    replaced: Option<(Kernel, String)>,
}

impl Kernels {
    /// Kernels of which one has another text.
    pub fn with_replaced(kernel: Kernel, source: String) -> Kernels {
        Kernels { replaced: Some((kernel, source)), ..Kernels::default() }
    }

    /// A kernel, compiled if it was not yet.
    ///
    /// # Errors
    /// The device refuses it.
    pub fn get(&self, gpu: &Gpu, kernel: Kernel) -> Result<&Compiled, GpuError> {
        let slot = &self.compiled[kernel as usize];
        if let Some(compiled) = slot.get() {
            return Ok(compiled);
        }
        let compiled = compile(gpu, kernel, &self.source(kernel))?;
        // Another thread may have been faster: then its result stays.
        Ok(slot.get_or_init(|| compiled))
    }

    fn source(&self, kernel: Kernel) -> String {
        match &self.replaced {
            Some((replaced, source)) if *replaced == kernel => source.clone(),
            _ => splitplane_shaders::KERNELS[kernel as usize].source(),
        }
    }
}

/// Binding 0 is the parameters, 1 the counters, then what the kernel names.
fn compile(gpu: &Gpu, kernel: Kernel, source: &str) -> Result<Compiled, GpuError> {
    let storage = |binding: u32, read_only: bool| wgpu::BindGroupLayoutEntry {
        binding,
        visibility: wgpu::ShaderStages::COMPUTE,
        ty: wgpu::BindingType::Buffer {
            ty: wgpu::BufferBindingType::Storage { read_only },
            has_dynamic_offset: false,
            min_binding_size: None,
        },
        count: None,
    };
    let mut entries = vec![
        wgpu::BindGroupLayoutEntry {
            binding: 0,
            visibility: wgpu::ShaderStages::COMPUTE,
            ty: wgpu::BindingType::Buffer {
                ty: wgpu::BufferBindingType::Uniform,
                has_dynamic_offset: true,
                min_binding_size: None,
            },
            count: None,
        },
        storage(1, !kernel.writes_counters()),
    ];
    for (index, binding) in kernel.storage_bindings().enumerate() {
        entries.push(storage(2 + index as u32, binding.access == Access::Read));
    }
    let device = gpu.device();
    let layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
        label: Some(kernel.name()),
        entries: &entries,
    });
    let pipeline = gpu.pipeline_with_layout(kernel.name(), source, &layout)?;
    Ok(Compiled { pipeline, layout })
}
