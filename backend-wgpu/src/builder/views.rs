//! Lists that one binding does not hold: which kernels bind both halves, and which see one half at a time.
//!
//! Most kernels have bindings to spare, and a list goes on in a second one. `scatter_references` and the kernels of
//! small roots have not: each of their dispatches sees one half of what it reads, and `scatter_references` one half of
//! one of the two lists that it writes. They are dispatched once for each such view.

use splitplane_core::build::reference::kernels::is_of_middle_stage;
use splitplane_core::kernel::{Buffer, Kernel, Slot, TreeBuilder};
use wgpu::BufferBinding;

use super::capacities::{Capacities, is_long};
use crate::device::halves::{OVERLAP, half};
use crate::device::kernel_set::{Bound, as_declared, with_continued};

/// How the kernels of a build bind the longest lists.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Lists {
    /// Each in one binding.
    Whole,
    /// By halves.
    ByHalves,
}

impl Lists {
    /// As these capacities need it.
    pub(crate) fn of(capacities: &Capacities) -> Lists {
        if capacities.by_halves { Lists::ByHalves } else { Lists::Whole }
    }
}

/// The views of `scatter_references` by the bits of [`Parameters::view`](splitplane_core::layout::Parameters::view).
pub(crate) const SCATTER_VIEWS: u32 = 8;

/// The bits of a view.
const READS_SECOND: u32 = 1;
const WRITES_SECOND: u32 = 2;
const WRITES_SMALL: u32 = 4;

/// How many views the kernels of small roots have.
pub(crate) fn small_views(capacities: &Capacities) -> u32 {
    if capacities.by_halves { 2 } else { 1 }
}

/// What a kernel binds.
pub(super) fn bindings(kernel: Kernel, lists: Lists) -> Vec<Bound<TreeBuilder>> {
    let is_continued = |buffer| match kernel {
        Kernel::ScatterReferences => buffer == Buffer::Triangles,
        // By halves there is no middle stage.
        _ if is_of_middle_stage(kernel) => false,
        _ => is_long(buffer) && buffer != Buffer::SmallReferences,
    };
    match lists {
        Lists::Whole => as_declared::<TreeBuilder>(kernel).collect(),
        Lists::ByHalves => {
            let mut bound = with_continued::<TreeBuilder>(kernel, is_continued);
            if kernel == Kernel::ScatterReferences {
                // What it writes, whichever list it is, is bound as the next level's.
                bound.retain(|bound| !is_of(bound, Buffer::SmallReferences));
            }
            bound
        }
    }
}

fn is_of(bound: &Bound<TreeBuilder>, buffer: Buffer) -> bool {
    matches!(bound.slot, Slot::Storage(storage) if storage.buffer == buffer)
}

/// The list that a binding of a kernel refers to in a view.
pub(super) fn viewed(kernel: Kernel, buffer: Buffer, view: u32) -> Buffer {
    let small = kernel == Kernel::ScatterReferences && view & WRITES_SMALL != 0;
    if small && buffer == Buffer::NextReferences { Buffer::SmallReferences } else { buffer }
}

/// The part of a buffer that a kernel binds in a view.
pub(super) fn part<'a>(
    capacities: &Capacities,
    kernel: Kernel,
    bound: &Bound<TreeBuilder>,
    view: u32,
    held: &'a wgpu::Buffer,
) -> BufferBinding<'a> {
    let whole = held.as_entire_buffer_binding();
    let Slot::Storage(storage) = bound.slot else { return whole };
    if !is_long(storage.buffer) {
        return whole;
    }
    let bytes = capacities.bytes_of(viewed(kernel, storage.buffer, view));
    if !capacities.by_halves {
        // A buffer of an earlier build may be too long to be bound whole.
        return BufferBinding {
            size: wgpu::BufferSize::new(bytes.max(16).min(held.size())),
            ..whole
        };
    }
    let second = |bit: u32| view & bit != 0;
    match (kernel, storage.buffer) {
        (Kernel::ScatterReferences, Buffer::References) => {
            half(held, bytes, second(READS_SECOND), OVERLAP)
        }
        (Kernel::ScatterReferences, Buffer::NextReferences) => {
            half(held, bytes, second(WRITES_SECOND), 0)
        }
        (_, Buffer::SmallReferences) => half(held, bytes, second(READS_SECOND), OVERLAP),
        _ => half(held, bytes, bound.part == 1, 0),
    }
}

#[cfg(test)]
mod tests {
    use splitplane_core::kernel::KernelSet;

    use super::*;
    use crate::device::DeviceSet;
    use crate::device::pipelines::continued;

    /// Storage buffers that a stage of plain WebGPU may have.
    const MOST: usize = 8;

    /// What a kernel's text uses is what is bound, and no more than any device has room for.
    #[test]
    fn every_kernel_by_halves_binds_what_its_text_names() {
        for kernel in Kernel::ALL {
            let bound = bindings(kernel, Lists::ByHalves);
            let text = TreeBuilder::text(kernel, &Lists::ByHalves);
            let source = splitplane_shaders::join(&text.parts);
            let source = continued::<TreeBuilder>(text.name, source, &bound).expect("lists");
            let module = naga::front::wgsl::parse_str(&source)
                .unwrap_or_else(|error| panic!("{}", error.emit_to_string(&source)));
            let mut named: Vec<(u32, String)> = module
                .global_variables
                .iter()
                .filter_map(|(_, v)| Some((v.binding?.binding, v.name.clone()?)))
                .collect();
            named.sort();
            let expected: Vec<(u32, String)> = bound
                .iter()
                .map(|bound| {
                    let name = match bound.slot {
                        Slot::Uniform(uniform) => TreeBuilder::uniform_name(uniform),
                        Slot::Storage(storage) => TreeBuilder::buffer(storage.buffer).name,
                    };
                    let more = if bound.part == 1 { "more_" } else { "" };
                    (bound.binding, format!("{more}{name}"))
                })
                .collect();
            assert_eq!(named, expected, "{kernel:?}");
            let storages = bound.iter().filter(|b| matches!(b.slot, Slot::Storage(_))).count();
            assert!(storages <= MOST, "{kernel:?} binds {storages}");
        }
    }

    /// Every long list is seen whole by every kernel that binds it, in one dispatch or in several.
    #[test]
    fn no_kernel_misses_a_half() {
        for kernel in Kernel::ALL.into_iter().filter(|&kernel| !is_of_middle_stage(kernel)) {
            let bound = bindings(kernel, Lists::ByHalves);
            for buffer in kernel.bindings().map(|binding| binding.buffer).filter(|b| is_long(*b)) {
                let both = bound.iter().filter(|bound| is_of(bound, buffer)).count() == 2;
                let views = match (kernel, buffer) {
                    (Kernel::ScatterReferences, Buffer::Triangles) => false,
                    (Kernel::ScatterReferences, _) => true,
                    (Kernel::BuildSmall | Kernel::EmitSmall, _) => true,
                    _ => false,
                };
                assert_ne!(both, views, "{kernel:?} {buffer:?}");
            }
        }
    }
}
