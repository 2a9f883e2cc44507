//! What the processor can do.

#[cfg(target_arch = "x86_64")]
use super::avx2::Avx2;
#[cfg(target_arch = "x86_64")]
use super::avx512::Avx512;
#[cfg(target_arch = "aarch64")]
use super::neon::Neon;
#[cfg(not(all(target_arch = "wasm32", target_feature = "simd128")))]
use super::portable::Portable;
#[cfg(all(target_arch = "wasm32", target_feature = "simd128"))]
use super::simd128::Simd128;
use super::{Compiled, Simd};

/// What the processor can do, found at run time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum InstructionSet {
    /// Plain Rust, over 8 floats.
    Portable,
    /// Vectors of 4 floats in pairs; every 64-bit Arm processor.
    Neon,
    /// Vectors of 4 floats in pairs: WebAssembly, where the program is compiled for them.
    Simd128,
    /// Vectors of 8 floats.
    Avx2,
    /// Vectors of 16 floats.
    Avx512,
}

impl InstructionSet {
    /// The best this processor has. `SPLITPLANE_ISA` (`portable`, `neon`, `simd128`, `avx2`, `avx512`) lowers it, for
    /// tests and measurements; it never raises it.
    pub fn detect() -> InstructionSet {
        let wanted = match std::env::var("SPLITPLANE_ISA").as_deref() {
            Ok("portable") => InstructionSet::Portable,
            Ok("neon") => InstructionSet::Neon,
            Ok("simd128") => InstructionSet::Simd128,
            Ok("avx2") => InstructionSet::Avx2,
            _ => InstructionSet::Avx512,
        };
        InstructionSet::available()
            .into_iter()
            .rfind(|&set| set as u32 <= wanted as u32)
            .unwrap_or(InstructionSet::least())
    }

    /// The worst that there is.
    pub(crate) fn least() -> InstructionSet {
        InstructionSet::available()[0]
    }

    /// All that this processor has, worst first. A program for WebAssembly is loaded only where there is all that it was compiled for, so
    /// one with vectors has no other set: it would only be longer to load.
    pub fn available() -> Vec<InstructionSet> {
        #[cfg(all(target_arch = "wasm32", target_feature = "simd128"))]
        return vec![InstructionSet::Simd128];
        #[cfg(not(all(target_arch = "wasm32", target_feature = "simd128")))]
        InstructionSet::of_processor()
    }

    #[cfg(not(all(target_arch = "wasm32", target_feature = "simd128")))]
    fn of_processor() -> Vec<InstructionSet> {
        #[allow(unused_mut, reason = "no other set on other processors")]
        let mut sets = vec![InstructionSet::Portable];
        #[cfg(all(target_arch = "aarch64", not(miri)))]
        sets.push(InstructionSet::Neon);
        #[cfg(all(target_arch = "x86_64", not(miri)))]
        {
            let avx2 = is_x86_feature_detected!("avx2")
                && is_x86_feature_detected!("bmi1")
                && is_x86_feature_detected!("bmi2")
                && is_x86_feature_detected!("lzcnt")
                && is_x86_feature_detected!("popcnt")
                && is_x86_feature_detected!("fma");
            if avx2 {
                sets.push(InstructionSet::Avx2);
            }
            if avx2
                && is_x86_feature_detected!("avx512f")
                && is_x86_feature_detected!("avx512dq")
                && is_x86_feature_detected!("avx512bw")
                && is_x86_feature_detected!("avx512vl")
            {
                sets.push(InstructionSet::Avx512);
            }
        }
        sets
    }

    /// Floats in a vector: children of a wide node, triangles of a block.
    pub const fn lanes(self) -> usize {
        match self {
            InstructionSet::Avx512 => 16,
            _ => 8,
        }
    }

    /// The name in reports.
    pub const fn name(self) -> &'static str {
        match self {
            InstructionSet::Portable => "portable",
            InstructionSet::Neon => "neon",
            InstructionSet::Simd128 => "simd128",
            InstructionSet::Avx2 => "avx2",
            InstructionSet::Avx512 => "avx512",
        }
    }
}

impl InstructionSet {
    /// Does a task, as compiled for this set, in the default floating-point state: threads of pools may have another. Each
    /// set's `call` is a function of its own, so nothing of the task moves out of that state.
    ///
    /// # Safety
    /// The processor must have the set.
    #[inline]
    pub(crate) unsafe fn run<T: Compiled>(self, task: T) -> T::Output {
        let _state = splitplane_float_state::Standard::set();
        // SAFETY: the caller's contract.
        unsafe {
            match self {
                #[cfg(target_arch = "x86_64")]
                InstructionSet::Avx512 => Avx512::call(task),
                #[cfg(target_arch = "x86_64")]
                InstructionSet::Avx2 => Avx2::call(task),
                #[cfg(target_arch = "aarch64")]
                InstructionSet::Neon => Neon::call(task),
                #[cfg(all(target_arch = "wasm32", target_feature = "simd128"))]
                _ => Simd128::call(task),
                #[cfg(not(all(target_arch = "wasm32", target_feature = "simd128")))]
                _ => Portable::call(task),
            }
        }
    }
}
