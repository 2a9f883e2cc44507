//! What offline compilers say of a kernel: from `docs/measurements/shaders.json`, as it was when this was built.

use serde_json::Value;

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
    let [instructions, registers, shared] = names.map(|name| all[kernel][name].as_f64());
    let source = splitplane_shaders::find(kernel).map(|shader| shader.source());
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
        assert!(find("closest_hit", Compiler::Aco).known);
        assert_eq!(find("no such kernel", Compiler::Cuda), TYPICAL);
    }
}
