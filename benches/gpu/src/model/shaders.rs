//! What offline compilers say of a kernel: from `docs/measurements/shaders.json`, as it was when this was built.

use std::borrow::Cow;

use serde_json::Value;
use splitplane_shaders::with_workgroup_stacks;

use super::devices::Compiler;
use crate::count::rewrite;

const FIGURES: &str = include_str!("../../../../docs/measurements/shaders.json");

/// What a compiler made of a kernel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Shader {
    /// Instructions for each operation that stands in the shader.
    pub per_operation: f64,
    /// Of a lane.
    pub registers: f64,
    /// Bytes of workgroup memory.
    pub shared: f64,
    /// False where the compiler was not asked, and a typical kernel stands in.
    pub known: bool,
}

/// For kernels of which nothing is known.
const TYPICAL: Shader =
    Shader { per_operation: 1.0, registers: 64.0, shared: 6144.0, known: false };

/// The figures of a kernel.
pub(crate) fn find(kernel: &str, compiler: Compiler) -> Shader {
    let all: Value = serde_json::from_str(FIGURES).unwrap_or_default();
    let names = match compiler {
        Compiler::Cuda => ["cuda.instructions", "cuda.registers", "cuda.shared"],
        Compiler::Aco => ["aco.instructions", "aco.vgprs", "aco.lds"],
    };
    // What adapters of AMD are given in place of what others are.
    let workgroup = format!("{kernel}.workgroup");
    let stack = compiler == Compiler::Aco && all.get(&workgroup).is_some();
    let row = if stack { &all[&workgroup] } else { &all[kernel] };
    let [instructions, registers, shared] = names.map(|name| row[name].as_f64());
    let parts = splitplane_shaders::find(kernel).map(|shader| Cow::Borrowed(shader.parts));
    let parts = parts.map(|parts| if stack { with_workgroup_stacks(parts) } else { parts });
    let source = parts.map(|parts| splitplane_shaders::join(&parts));
    let operations = source.and_then(|source| rewrite::written(&source).ok());
    match (instructions, registers, shared, operations) {
        (Some(instructions), Some(registers), Some(shared), Some(operations)) => Shader {
            per_operation: instructions / operations.max(1) as f64,
            registers,
            shared,
            known: true,
        },
        _ => TYPICAL,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn kernels_have_figures_and_others_are_told_apart() {
        let lean = find("closest_hit", Compiler::Cuda);
        assert!(lean.known && (0.2..5.0).contains(&lean.per_operation), "{lean:?}");
        let of_amd = find("closest_hit", Compiler::Aco);
        assert!(of_amd.known && of_amd.registers < 72.0 && of_amd.shared > 9000.0, "{of_amd:?}");
        assert_eq!(find("no such kernel", Compiler::Cuda), TYPICAL);
    }
}
