//! Bindings of a shader, and the limits of plain WebGPU.

use naga::ir::{AddressSpace, ArraySize, ScalarKind, ShaderStage, StorageAccess, TypeInner};
use naga::proc::Layouter;
use naga::valid::GlobalUse;
use naga::{GlobalVariable, Handle};
use splitplane_core::kernel::{Access, Binding, BufferRow, Grid, KernelSet, Slot};
use splitplane_shaders::ENTRY_POINT;

use super::sets::Shaders;
use crate::source::Parsed;

/// Storage buffers of a stage.
pub(crate) const MAX_STORAGE_BUFFERS: usize = 8;
/// Invocations of a workgroup.
const MAX_INVOCATIONS: u32 = 256;
/// Invocations along the last axis.
const MAX_DEPTH: u32 = 64;
/// Bytes of workgroup memory.
const MAX_WORKGROUP_BYTES: u32 = 16384;

/// Faults against the limits of plain WebGPU, and an entry point that is not as it should be.
pub(crate) fn limit_faults(parsed: &Parsed) -> Vec<String> {
    let module = &parsed.module;
    let mut faults = Vec::new();
    let [entry] = &module.entry_points[..] else {
        return vec![format!("{} entry points", module.entry_points.len())];
    };
    if entry.name != ENTRY_POINT || entry.stage != ShaderStage::Compute {
        faults.push(format!("entry point {} of stage {:?}", entry.name, entry.stage));
    }
    let size = entry.workgroup_size;
    if size.iter().product::<u32>() > MAX_INVOCATIONS || size[2] > MAX_DEPTH {
        faults.push(format!("workgroups of {size:?}"));
    }
    let mut layouter = Layouter::default();
    layouter.update(module.to_ctx()).expect("a valid module has layouts");
    let (mut storage, mut bytes) = (0, 0);
    for (handle, global) in module.global_variables.iter() {
        if global.binding.is_some_and(|binding| binding.group != 0) {
            faults.push(format!("{} is not in group 0", name_of(global)));
        }
        match global.space {
            AddressSpace::Storage { .. } => storage += 1,
            // As WebGPU counts: what the entry point uses, each rounded up to 16 bytes.
            AddressSpace::WorkGroup if is_used(parsed, handle) => {
                bytes += layouter[global.ty].size.next_multiple_of(16);
            }
            _ => {}
        }
    }
    if storage > MAX_STORAGE_BUFFERS {
        faults.push(format!("{storage} storage buffers"));
    }
    if bytes > MAX_WORKGROUP_BYTES {
        faults.push(format!("{bytes} bytes of workgroup memory"));
    }
    faults
}

/// Whether the bindings of a kernel are what its set's table says.
pub(crate) fn binding_faults<S: Shaders>(parsed: &Parsed, wanted: &[Slot<S>]) -> Vec<String> {
    let globals = parsed.module.global_variables.iter();
    let mut bound: Vec<(u32, &GlobalVariable)> =
        globals.filter_map(|(_, global)| Some((global.binding?.binding, global))).collect();
    bound.sort_by_key(|(binding, _)| *binding);
    let mut faults = Vec::new();
    for (place, slot) in wanted.iter().enumerate() {
        let name = name_of_slot(slot);
        let Some(&(binding, global)) = bound.get(place) else {
            faults.push(format!("{name} is not bound"));
            continue;
        };
        let found = name_of(global);
        if binding as usize != place || found != name {
            faults.push(format!("{found} at {binding} in place of {name} at {place}"));
            continue;
        }
        // The layout of a binding says whether it is written, and the shader must say the same.
        let (space, suits) = match slot {
            Slot::Uniform(uniform) => {
                let record = parsed.module.types[global.ty].name.as_deref();
                (AddressSpace::Uniform, record == Some(&format!("{uniform:?}")))
            }
            Slot::Storage(storage) => {
                let written = storage.access != Access::Read;
                (self::storage(written), is_of::<S>(parsed, global, storage.buffer))
            }
        };
        if global.space != space {
            faults.push(format!("{name} is {:?} in place of {space:?}", global.space));
        } else if !suits {
            faults.push(format!("{name} has another type"));
        }
    }
    let besides = bound.iter().skip(wanted.len());
    faults.extend(besides.map(|(_, global)| format!("{} is bound besides", name_of(global))));
    faults
}

/// Whether a kernel does with its buffers what its set's table says: reads what it is said to read, and
/// writes what it is said to write. A text that is not `whole` may leave some of that out.
pub(crate) fn use_faults<S: Shaders>(
    parsed: &Parsed,
    bound: &[Slot<S>],
    whole: bool,
) -> Vec<String> {
    let mut faults = Vec::new();
    if parsed.module.entry_points.is_empty() {
        return faults;
    }
    for slot in bound {
        let &Slot::Storage(Binding { buffer, access }) = slot else { continue };
        // What every kernel is given it need not look at.
        if S::is_bound_by_all(buffer) && access == Access::Read {
            continue;
        }
        let name = S::buffer(buffer).name;
        let globals = parsed.module.global_variables.iter();
        let found = globals.filter(|(_, global)| name_of(global) == name);
        let uses = found.fold(GlobalUse::empty(), |uses, (handle, _)| {
            uses | parsed.info.get_entry_point(0)[handle]
        });
        let (reads, writes) = (uses.contains(GlobalUse::READ), uses.contains(GlobalUse::WRITE));
        // Of what it writes whole, a kernel may read what it has written itself.
        let may_read = access != Access::Scatter;
        let must_read = whole && matches!(access, Access::Read | Access::ReadWrite);
        let (may_write, must_write) = (access != Access::Read, whole && access != Access::Read);
        for (fault, what) in [
            (reads && !may_read, "read"),
            (writes && !may_write, "written"),
            (must_read && !reads, "not read"),
            (must_write && !writes, "not written"),
        ] {
            if fault {
                faults.push(format!("{name} is {what}, though declared {access:?}"));
            }
        }
    }
    faults
}

/// Whether workgroups are as wide as the grid says.
pub(crate) fn grid_faults<S: Shaders>(parsed: &Parsed, kernel: S::Kernel) -> Vec<String> {
    let entry = parsed.module.entry_points.first();
    let size = entry.map_or([0; 3], |entry| entry.workgroup_size);
    match S::kernel(kernel).grid {
        Grid::Invocations(_, width) | Grid::Few(_, width) if size != [width, 1, 1] => {
            vec![format!("workgroups of {size:?} in a grid of {width} a workgroup")]
        }
        _ => Vec::new(),
    }
}

/// The name of a variable in shaders.
fn name_of_slot<K: KernelSet>(slot: &Slot<K>) -> &'static str {
    match slot {
        Slot::Uniform(uniform) => K::uniform_name(*uniform),
        Slot::Storage(storage) => K::buffer(storage.buffer).name,
    }
}

/// A variable's name.
fn name_of(global: &GlobalVariable) -> &str {
    global.name.as_deref().unwrap_or("?")
}

/// The space of a storage buffer.
fn storage(written: bool) -> AddressSpace {
    let write = if written { StorageAccess::STORE } else { StorageAccess::empty() };
    AddressSpace::Storage { access: StorageAccess::LOAD | write }
}

/// Whether a variable has the type of a buffer: a list of its elements or of plain words, or the words of
/// the one record that it holds. What shares one storage has elements of no one size: words, or pairs of words where the
/// elements of each are pairs.
fn is_of<S: Shaders>(parsed: &Parsed, global: &GlobalVariable, buffer: S::Buffer) -> bool {
    let types = &parsed.module.types;
    let TypeInner::Array { base, size, stride } = types[global.ty].inner else { return false };
    let stride = stride as usize;
    let element = S::element_size(buffer);
    match size {
        ArraySize::Constant(count) => {
            let word = matches!(
                types[base].inner,
                TypeInner::Scalar(scalar) | TypeInner::Atomic(scalar)
                    if scalar.kind == ScalarKind::Uint
            );
            S::SINGLES.contains(&buffer) && word && count.get() as usize * stride == element
        }
        ArraySize::Dynamic if S::SINGLES.contains(&buffer) => false,
        ArraySize::Dynamic => {
            let of_it = |row: &&BufferRow<S>| row.storage == buffer && row.buffer != buffer;
            let mut held = S::BUFFERS.iter().filter(of_it).peekable();
            let shared = held.peek().is_some();
            stride == 4
                || (shared && stride == 8 && held.all(|row| row.element_size.is_multiple_of(8)))
                || (stride == element && !shared)
                || (S::BY_FOUR_WORDS && stride == 16 && element.is_multiple_of(16))
                || (S::PADDED.contains(&buffer) && stride == 16)
        }
        ArraySize::Pending(_) => false,
    }
}

fn is_used(parsed: &Parsed, handle: Handle<GlobalVariable>) -> bool {
    !parsed.info.get_entry_point(0)[handle].is_empty()
}
