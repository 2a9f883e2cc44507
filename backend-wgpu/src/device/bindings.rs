//! Bind groups, and their layouts, from a kernel set's table.

use std::marker::PhantomData;

use splitplane_core::kernel::{Access, KernelSet, Slot};
use wgpu::{BindGroup, BindGroupEntry, BindGroupLayout, BindGroupLayoutEntry, BufferBinding};

use super::kernel_set::DeviceSet;
use crate::device::gpu::Gpu;
use crate::error::GpuError;

/// The layout of a kernel's only bind group; where it is `counted`, with a storage buffer behind what the table has.
pub(super) fn layout<K: DeviceSet>(gpu: &Gpu, kernel: K::Kernel, counted: bool) -> BindGroupLayout {
    let kinds = K::slots(kernel).map(|slot| match slot {
        Slot::Uniform(uniform) => (wgpu::BufferBindingType::Uniform, K::is_list_of_blocks(uniform)),
        Slot::Storage(storage) => {
            let read_only = storage.access == Access::Read;
            (wgpu::BufferBindingType::Storage { read_only }, false)
        }
    });
    let behind = counted.then_some((wgpu::BufferBindingType::Storage { read_only: false }, false));
    let entry = |(binding, (ty, has_dynamic_offset))| BindGroupLayoutEntry {
        binding,
        visibility: wgpu::ShaderStages::COMPUTE,
        ty: wgpu::BindingType::Buffer { ty, has_dynamic_offset, min_binding_size: None },
        count: None,
    };
    let entries: Vec<BindGroupLayoutEntry> = (0..).zip(kinds.chain(behind)).map(entry).collect();
    gpu.device().create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
        label: Some(K::kernel(kernel).name),
        entries: &entries,
    })
}

/// What a kernel binds, each slot as `find` has it, and behind them what it is counted in.
///
/// # Errors
/// [`GpuError::Refused`] for a slot that `find` lacks.
pub(crate) fn bind<'a, K: DeviceSet>(
    gpu: &Gpu,
    layout: &BindGroupLayout,
    kernel: K::Kernel,
    counted: Option<&wgpu::Buffer>,
    find: impl Fn(Slot<K>) -> Option<BufferBinding<'a>>,
) -> Result<BindGroup, GpuError> {
    let entry = |(binding, slot): (u32, Slot<K>)| match find(slot) {
        Some(buffer) => {
            Ok(BindGroupEntry { binding, resource: wgpu::BindingResource::Buffer(buffer) })
        }
        // A schedule for different work from what the executor was made for.
        None => {
            let what = match slot {
                Slot::Uniform(uniform) => format!("{uniform:?}"),
                Slot::Storage(storage) => format!("{:?}", storage.buffer),
            };
            Err(GpuError::Refused(format!("{kernel:?} needs {what}, which is not there")))
        }
    };
    let entries: Result<Vec<BindGroupEntry<'_>>, GpuError> =
        (0..).zip(K::slots(kernel)).map(entry).collect();
    let mut entries = entries?;
    let binding = entries.len() as u32;
    entries
        .extend(counted.map(|held| BindGroupEntry { binding, resource: held.as_entire_binding() }));
    Ok(gpu.device().create_bind_group(&wgpu::BindGroupDescriptor {
        label: Some(K::kernel(kernel).name),
        layout,
        entries: &entries,
    }))
}

/// The bind groups of a set's kernels that were made so far: while the lists of this round and the
/// next are in their original places, and while they have changed places. They hold as long as the
/// buffers do.
#[derive(Debug)]
pub struct BindGroups<K> {
    /// By kernel.
    groups: Vec<[Option<BindGroup>; 2]>,
    set: PhantomData<K>,
}

impl<K: KernelSet> Default for BindGroups<K> {
    fn default() -> BindGroups<K> {
        BindGroups { groups: vec![[None, None]; K::KERNELS.len()], set: PhantomData }
    }
}

impl<K: KernelSet> BindGroups<K> {
    /// Forgets all of them: a buffer is another.
    pub fn clear(&mut self) {
        self.groups.fill([None, None]);
    }

    /// Forgets those of a kernel.
    pub fn forget(&mut self, kernel: K::Kernel) {
        self.groups[K::kernel_index(kernel)] = [None, None];
    }

    /// The index of a kernel's bind groups.
    pub(super) fn place(&mut self, kernel: K::Kernel, swapped: bool) -> &mut Option<BindGroup> {
        &mut self.groups[K::kernel_index(kernel)][usize::from(swapped)]
    }
}
