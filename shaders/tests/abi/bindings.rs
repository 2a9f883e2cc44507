//! Bindings of a shader, and the limits of plain WebGPU.

use naga::ir::{AddressSpace, ArraySize, ScalarKind, ShaderStage, StorageAccess, TypeInner};
use naga::proc::Layouter;
use naga::{GlobalVariable, Handle};
use splitplane_core::kernel::{Access, Buffer, Kernel};
use splitplane_shaders::ENTRY_POINT;

use crate::constants::snake;
use crate::source::Parsed;

/// Storage buffers of a stage.
const MAX_STORAGE_BUFFERS: usize = 8;
/// Invocations of a workgroup.
const MAX_INVOCATIONS: u32 = 256;
/// Invocations along the last axis.
const MAX_DEPTH: u32 = 64;
/// Bytes of workgroup memory.
const MAX_WORKGROUP_BYTES: u32 = 16384;

/// Faults against the limits of plain WebGPU, and an entry point that is not as it should be.
pub fn limit_faults(parsed: &Parsed) -> Vec<String> {
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

/// Faults of the bindings of a kernel of the tree builder.
pub fn binding_faults(parsed: &Parsed, kernel: Kernel) -> Vec<String> {
    let module = &parsed.module;
    let mut bound: Vec<(u32, &GlobalVariable)> = module
        .global_variables
        .iter()
        .filter_map(|(_, global)| Some((global.binding?.binding, global)))
        .collect();
    bound.sort_by_key(|(binding, _)| *binding);
    let mut faults = Vec::new();
    for (index, (binding, global)) in bound.iter().enumerate() {
        if *binding as usize != index {
            faults.push(format!("binding {binding} of {} at place {index}", name_of(global)));
        }
    }
    let mut bound = bound.into_iter().map(|(_, global)| global);

    let is_parameters = |global: &GlobalVariable| {
        name_of(global) == "parameters"
            && global.space == AddressSpace::Uniform
            && module.types[global.ty].name.as_deref() == Some("Parameters")
    };
    if !bound.next().is_some_and(is_parameters) {
        faults.push("binding 0 is not `var<uniform> parameters: Parameters`".to_owned());
    }
    // The binding's layout says whether it is written, and the shader must say the same.
    let writes = kernel.writes_counters();
    let is_counters = |global: &GlobalVariable| {
        name_of(global) == "counters"
            && global.space == storage(writes)
            && is_counters(parsed, global)
    };
    if !bound.next().is_some_and(is_counters) {
        let access = if writes { "read_write" } else { "read" };
        faults.push(format!("binding 1 is not `var<storage, {access}> counters: array<u32, 16>`"));
    }
    let mut wanted = kernel.storage_bindings();
    loop {
        let (want, have) = (wanted.next(), bound.next());
        let Some(want) = want else {
            faults.extend(have.map(|global| format!("{} is bound besides", name_of(global))));
            break;
        };
        let name = snake(&format!("{:?}", want.buffer));
        let Some(global) = have else {
            faults.push(format!("{name} is not bound"));
            break;
        };
        if name_of(global) != name {
            faults.push(format!("{} is bound in place of {name}", name_of(global)));
        } else if global.space != storage(want.access != Access::Read) {
            faults.push(format!("{name} is {:?} in place of {:?}", global.space, want.access));
        } else if !is_list_of(parsed, global, want.buffer) {
            faults.push(format!("{name} has elements of another size"));
        }
    }
    faults
}

/// A variable's name.
pub fn name_of(global: &GlobalVariable) -> &str {
    global.name.as_deref().unwrap_or("?")
}

/// The space of a storage buffer.
pub fn storage(written: bool) -> AddressSpace {
    let write = if written { StorageAccess::STORE } else { StorageAccess::empty() };
    AddressSpace::Storage { access: StorageAccess::LOAD | write }
}

/// Whether a variable has the type of the counters.
pub fn is_counters(parsed: &Parsed, global: &GlobalVariable) -> bool {
    let types = &parsed.module.types;
    let TypeInner::Array { base, size: ArraySize::Constant(count), .. } = types[global.ty].inner
    else {
        return false;
    };
    count.get() == 16
        && matches!(types[base].inner, TypeInner::Scalar(scalar) if scalar.kind == ScalarKind::Uint)
}

/// Whether a variable is an array of the buffer's elements, or of plain words. What shares one
/// storage has elements of no one size: words.
fn is_list_of(parsed: &Parsed, global: &GlobalVariable, buffer: Buffer) -> bool {
    let TypeInner::Array { size: ArraySize::Dynamic, stride, .. } =
        parsed.module.types[global.ty].inner
    else {
        return false;
    };
    stride == 4 || (stride as usize == buffer.element_size() && buffer != Buffer::ChunkState)
}

fn is_used(parsed: &Parsed, handle: Handle<GlobalVariable>) -> bool {
    !parsed.info.get_entry_point(0)[handle].is_empty()
}
