//! The kernel set of a device's self-test.

use crate::kernel_set;

kernel_set! {
    /// Checks of a device's arithmetic.
    set DeviceChecks "device checks", counted by CheckCounter;
    every kernel: ;
    exchanged: ;

    /// The inputs of checks.
    uniforms CheckUniform {
        /// How many pairs: [`layout::CheckParameters`](crate::layout::CheckParameters).
        CheckParameters "parameters";
    }

    /// The buffers of checks.
    buffers CheckBuffer {
        /// Pairs of operands: 2 `f32`.
        Operands "operands", 8, live Pairs;
        /// The results of each pair, as bits: 8 words.
        Results "results", 32, live Pairs;
    }

    /// The checks. Each is a file of the same name.
    kernels CheckKernel {
        /// Runs every guarded operation.
        ArithmeticCheck "arithmetic_check", Invocations(Pairs, 64) =>
            uniform CheckParameters, reads Operands, writes Results;
    }
}

/// What the host counts for checks.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum CheckCounter {
    /// Pairs of operands.
    Pairs,
}
