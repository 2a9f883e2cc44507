//! Functions compiled for every instruction set.

/// Defines a function that takes an instruction set first and runs its body as compiled for that set, which
/// the body knows as `S`: a task of [`InstructionSet::run`](crate::simd::InstructionSet::run). The body is
/// plain Rust; a compiler turns its loops into the vector instructions that it may use. Callers have the set
/// from [`InstructionSet::available`](crate::simd::InstructionSet::available): others may not run here.
macro_rules! for_every_set {
    (
        $(#[$doc:meta])*
        $visible:vis fn $name:ident<$set:ident>($($argument:ident: $type:ty),* $(,)?) -> $out:ty $body:block
    ) => {
        $(#[$doc])*
        #[allow(clippy::too_many_arguments, reason = "one more than the body needs")]
        $visible fn $name(set: $crate::simd::InstructionSet, $($argument: $type),*) -> $out {
            /// The arguments.
            struct Task<T>(T);
            impl $crate::simd::Compiled for Task<($($type,)*)> {
                type Output = $out;

                #[cfg_attr(not(unoptimised), inline(always))]
                unsafe fn run<$set: $crate::simd::Simd>(self) -> $out {
                    // That references do not overlap is known of a function's arguments only.
                    #[cfg_attr(not(unoptimised), inline(always))]
                    #[allow(clippy::unused_unit, reason = "the type is always written")]
                    #[allow(clippy::extra_unused_type_parameters, reason = "not all ask for the set")]
                    fn plain<$set: $crate::simd::Simd>($($argument: $type),*) -> $out $body
                    let Task(($($argument,)*)) = self;
                    plain::<$set>($($argument),*)
                }
            }
            // SAFETY: only sets that the processor has come here.
            unsafe { set.run(Task(($($argument,)*))) }
        }
    };
}

pub(crate) use for_every_set;
