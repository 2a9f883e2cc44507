//! The compiled kernels of the ray tracer: each when a frame first needs it, with no more in it than the
//! scene needs.

use crate::kernel::Kernel;
use crate::plan::Plan;
use splitplane_core::kernel::Access;
use splitplane_core::ray::Accuracy;
use splitplane_shaders::{RenderFeatures, TriangleTest};
use splitplane_wgpu::{DeviceTree, Gpu, GpuError};
use wgpu::{BindGroupLayout, BindGroupLayoutEntry, ComputePipeline, ShaderStages};

/// A kernel's pipeline in one form.
#[derive(Debug)]
struct Compiled {
    kernel: Kernel,
    /// The names of the parts it is joined from.
    parts: Vec<&'static str>,
    pipeline: ComputePipeline,
}

/// All kernels, compiled as they are needed.
#[derive(Debug, Default)]
pub(super) struct Pipelines {
    compiled: Vec<Compiled>,
    layouts: [Option<BindGroupLayout>; Kernel::ALL.len()],
    /// Replaces the text of one kernel: tests plant faults by it.
    replaced: Option<(Kernel, String)>,
}

/// What shaders must be able to do for a plan.
pub(super) fn features(plan: &Plan, accuracy: Accuracy) -> RenderFeatures {
    let needs = plan.needs();
    RenderFeatures {
        textures: needs.textures,
        smooth_normals: needs.smooth_normals,
        area_lights: plan.area_samples() > 0,
        dielectrics: needs.dielectrics,
        test: match accuracy {
            Accuracy::Fast => TriangleTest::MoellerTrumbore,
            // Frames of accuracy `exact` are refused before.
            _ => TriangleTest::Watertight,
        },
    }
}

impl Pipelines {
    /// Gives a kernel another text from now on, or its own again.
    pub(super) fn replace(&mut self, kernel: Kernel, source: Option<String>) {
        self.compiled.retain(|held| held.kernel != kernel);
        self.replaced = source.map(|source| (kernel, source));
    }

    /// The layout of a kernel's bindings: the frame, the counters, what the kernel names, and the tree
    /// where it traces.
    pub(super) fn layout(&mut self, gpu: &Gpu, kernel: Kernel) -> &BindGroupLayout {
        self.layouts[kernel as usize].get_or_insert_with(|| layout(gpu, kernel))
    }

    /// A kernel for a plan, compiled if it was not yet.
    ///
    /// # Errors
    /// The device refuses it.
    pub(super) fn get(
        &mut self,
        gpu: &Gpu,
        kernel: Kernel,
        features: &RenderFeatures,
    ) -> Result<ComputePipeline, GpuError> {
        // The table holds every kernel; a test of the shaders holds it to that.
        let parts = splitplane_shaders::render_parts(kernel.name(), features).unwrap_or_default();
        let names = parts.iter().map(|part| part.name);
        let held = self
            .compiled
            .iter()
            .find(|held| held.kernel == kernel && held.parts.iter().copied().eq(names.clone()));
        if let Some(held) = held {
            return Ok(held.pipeline.clone());
        }
        let source = match &self.replaced {
            Some((replaced, source)) if *replaced == kernel => source.clone(),
            _ => splitplane_shaders::join(&parts),
        };
        let parts = names.collect();
        let layout = self.layout(gpu, kernel);
        let pipeline = gpu.pipeline_with_layout(kernel.name(), &source, layout)?;
        self.compiled.push(Compiled { kernel, parts, pipeline: pipeline.clone() });
        Ok(pipeline)
    }

    /// Pipelines compiled so far.
    pub(super) fn count(&self) -> usize {
        self.compiled.len()
    }
}

fn layout(gpu: &Gpu, kernel: Kernel) -> BindGroupLayout {
    let buffer = |binding: u32, ty: wgpu::BufferBindingType| BindGroupLayoutEntry {
        binding,
        visibility: ShaderStages::COMPUTE,
        ty: wgpu::BindingType::Buffer { ty, has_dynamic_offset: false, min_binding_size: None },
        count: None,
    };
    let storage = |read_only: bool| wgpu::BufferBindingType::Storage { read_only };
    let mut entries = vec![
        buffer(0, wgpu::BufferBindingType::Uniform),
        buffer(1, storage(!kernel.writes_counters())),
    ];
    for (binding, &(_, access)) in (2..).zip(kernel.bindings()) {
        entries.push(buffer(binding, storage(access == Access::Read)));
    }
    if kernel.traces() {
        let first = entries.len() as u32;
        entries.extend(DeviceTree::bind_group_layout_entries(first, ShaderStages::COMPUTE));
    }
    gpu.device().create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
        label: Some(kernel.name()),
        entries: &entries,
    })
}
