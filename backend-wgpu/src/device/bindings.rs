//! Bind groups, and their layouts, from a kernel set's table.

use std::marker::PhantomData;

use splitplane_core::kernel::{Access, KernelSet, Slot};
use wgpu::{BindGroup, BindGroupEntry, BindGroupLayout, BindGroupLayoutEntry, BufferBinding};

use super::kernel_set::{Bound, DeviceSet};
use crate::device::gpu::Gpu;
use crate::error::GpuError;

/// The layout of a kernel's only bind group, with these bindings; where it is `counted`, with a storage buffer behind
/// them.
pub(super) fn layout<K: DeviceSet>(
    gpu: &Gpu,
    kernel: K::Kernel,
    bound: &[Bound<K>],
    counted: bool,
) -> BindGroupLayout {
    let kind = |&Bound { binding, slot, .. }: &Bound<K>| match slot {
        Slot::Uniform(uniform) => {
            (binding, wgpu::BufferBindingType::Uniform, K::is_list_of_blocks(uniform))
        }
        Slot::Storage(storage) => {
            let read_only = storage.access == Access::Read;
            (binding, wgpu::BufferBindingType::Storage { read_only }, false)
        }
    };
    let last = wgpu::BufferBindingType::Storage { read_only: false };
    let behind = counted.then_some((bound.len() as u32, last, false));
    let entry = |(binding, ty, has_dynamic_offset)| BindGroupLayoutEntry {
        binding,
        visibility: wgpu::ShaderStages::COMPUTE,
        ty: wgpu::BindingType::Buffer { ty, has_dynamic_offset, min_binding_size: None },
        count: None,
    };
    let kinds = bound.iter().map(kind).chain(behind);
    let entries: Vec<BindGroupLayoutEntry> = kinds.map(entry).collect();
    gpu.device().create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
        label: Some(K::kernel(kernel).name),
        entries: &entries,
    })
}

/// What a kernel binds, each binding as `find` has it, and behind them what it is counted in.
///
/// # Errors
/// [`GpuError::Refused`] for a slot that `find` lacks.
pub(crate) fn bind<'a, K: DeviceSet>(
    gpu: &Gpu,
    layout: &BindGroupLayout,
    kernel: K::Kernel,
    bound: &[Bound<K>],
    counted: Option<&wgpu::Buffer>,
    find: impl Fn(&Bound<K>) -> Option<BufferBinding<'a>>,
) -> Result<BindGroup, GpuError> {
    let entry = |bound: &Bound<K>| match find(bound) {
        Some(buffer) => {
            let (binding, resource) = (bound.binding, wgpu::BindingResource::Buffer(buffer));
            Ok(BindGroupEntry { binding, resource })
        }
        // A schedule for different work from what the executor was made for.
        None => {
            let what = match bound.slot {
                Slot::Uniform(uniform) => format!("{uniform:?}"),
                Slot::Storage(storage) => format!("{:?}", storage.buffer),
            };
            Err(GpuError::Refused(format!("{kernel:?} needs {what}, which is not there")))
        }
    };
    let entries: Result<Vec<BindGroupEntry<'_>>, GpuError> = bound.iter().map(entry).collect();
    let mut entries = entries?;
    let binding = bound.len() as u32;
    entries
        .extend(counted.map(|held| BindGroupEntry { binding, resource: held.as_entire_binding() }));
    Ok(gpu.device().create_bind_group(&wgpu::BindGroupDescriptor {
        label: Some(K::kernel(kernel).name),
        layout,
        entries: &entries,
    }))
}

/// The bind groups of a set's kernels that were made so far: while the lists of this round and the
/// next are in their original places, and while they have changed places, each for every view of long lists, and for a kernel's
/// own shader apart from the others where it binds other buffers. They hold as long as the buffers do.
#[derive(Debug)]
pub struct BindGroups<K> {
    /// By kernel, then four for each view.
    groups: Vec<Vec<Option<BindGroup>>>,
    set: PhantomData<K>,
}

impl<K: KernelSet> Default for BindGroups<K> {
    fn default() -> BindGroups<K> {
        BindGroups { groups: vec![Vec::new(); K::KERNELS.len()], set: PhantomData }
    }
}

impl<K: KernelSet> BindGroups<K> {
    /// Forgets all of them: a buffer is another.
    pub fn clear(&mut self) {
        self.groups.fill(Vec::new());
    }

    /// Forgets those of a kernel.
    pub fn forget(&mut self, kernel: K::Kernel) {
        self.groups[K::kernel_index(kernel)].clear();
    }

    /// The place of one of a kernel's bind groups: `own` for that of its own shader where this binds other buffers.
    pub(super) fn place(
        &mut self,
        kernel: K::Kernel,
        swapped: bool,
        view: u32,
        own: bool,
    ) -> &mut Option<BindGroup> {
        let groups = &mut self.groups[K::kernel_index(kernel)];
        let index = 4 * view as usize + 2 * usize::from(own) + usize::from(swapped);
        if groups.len() <= index {
            groups.resize(index + 1, None);
        }
        &mut groups[index]
    }
}
