//! Functions compiled for every instruction set.

/// Defines a function that takes an instruction set first and runs its body as compiled for that set. The
/// body is plain Rust; a compiler turns its loops into the vector instructions that it may use. The features
/// named here must be among those that [`InstructionSet::available`](crate::query::InstructionSet::available)
/// asks for.
macro_rules! for_every_set {
    (
        $(#[$doc:meta])*
        $visible:vis fn $name:ident($($argument:ident: $type:ty),* $(,)?) -> $out:ty $body:block
    ) => {
        $(#[$doc])*
        #[allow(clippy::too_many_arguments, reason = "one more than the body needs")]
        $visible fn $name(set: $crate::query::InstructionSet, $($argument: $type),*) -> $out {
            #[cfg_attr(optimised, inline(always))]
            #[allow(clippy::unused_unit, reason = "the type is always written")]
            fn plain($($argument: $type),*) -> $out $body
            #[cfg(target_arch = "x86_64")]
            #[target_feature(enable = "avx512f,avx512dq,avx512bw,avx512vl,bmi1,bmi2,popcnt")]
            fn wide_16($($argument: $type),*) -> $out {
                plain($($argument),*)
            }
            #[cfg(target_arch = "x86_64")]
            #[target_feature(enable = "avx2,bmi1,bmi2,popcnt")]
            fn wide_8($($argument: $type),*) -> $out {
                plain($($argument),*)
            }
            match set {
                #[cfg(target_arch = "x86_64")]
                // SAFETY: only sets that the processor has come here.
                $crate::query::InstructionSet::Avx512 => unsafe { wide_16($($argument),*) },
                #[cfg(target_arch = "x86_64")]
                // SAFETY: as above.
                $crate::query::InstructionSet::Avx2 => unsafe { wide_8($($argument),*) },
                _ => plain($($argument),*),
            }
        }
    };
}

pub(crate) use for_every_set;
