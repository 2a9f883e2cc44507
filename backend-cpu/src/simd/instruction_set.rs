//! What the processor can do.

#[cfg(target_arch = "x86_64")]
use super::avx2::Avx2;
#[cfg(target_arch = "x86_64")]
use super::avx512::Avx512;
#[cfg(all(target_arch = "aarch64", not(miri)))]
use super::neon::Neon;
#[cfg(all(target_arch = "wasm32", target_feature = "simd128"))]
use super::simd128::Simd128;
#[cfg(target_arch = "x86_64")]
use super::sse2::Sse2;
use super::{Compiled, Simd};

/// The set that every processor of the target has: the only one besides those found at run time.
#[cfg(target_arch = "x86_64")]
type Baseline = Sse2;
#[cfg(all(target_arch = "aarch64", not(miri)))]
type Baseline = Neon;
#[cfg(all(target_arch = "wasm32", target_feature = "simd128"))]
type Baseline = Simd128;
#[cfg(not(any(
    target_arch = "x86_64",
    all(target_arch = "aarch64", not(miri)),
    all(target_arch = "wasm32", target_feature = "simd128")
)))]
type Baseline = super::portable::Portable;

/// What the processor can do, found at run time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum InstructionSet {
    /// Plain Rust, over 8 floats: processors without any of the others.
    Portable,
    /// Vectors of 4 floats in pairs; every x86-64 processor.
    Sse2,
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
    /// The best this processor has. `SPLITPLANE_ISA` (`portable`, `sse2`, `neon`, `simd128`, `avx2`,
    /// `avx512`) lowers it, for tests and measurements; it never raises it. `portable` gives the least set of the target.
    pub fn detect() -> InstructionSet {
        let wanted = match std::env::var("SPLITPLANE_ISA").as_deref() {
            Ok("portable") => InstructionSet::Portable,
            Ok("sse2") => InstructionSet::Sse2,
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

    /// All that this processor has, worst first. The first is the one that every processor of the target has.
    pub fn available() -> Vec<InstructionSet> {
        #[allow(unused_mut, reason = "no other set on other processors")]
        let mut sets = vec![Self::BASELINE];
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

    const BASELINE: InstructionSet = if cfg!(target_arch = "x86_64") {
        InstructionSet::Sse2
    } else if cfg!(all(target_arch = "aarch64", not(miri))) {
        InstructionSet::Neon
    } else if cfg!(all(target_arch = "wasm32", target_feature = "simd128")) {
        InstructionSet::Simd128
    } else {
        InstructionSet::Portable
    };

    /// Floats in a vector: children of a wide node, triangles of a block.
    pub const fn lanes(self) -> usize {
        match self {
            InstructionSet::Avx512 => 16,
            _ => 8,
        }
    }

    /// [`Simd::WRITES_OUT`].
    pub(crate) const fn writes_out(self) -> bool {
        matches!(self, InstructionSet::Avx2 | InstructionSet::Neon)
    }

    /// The name in reports.
    pub const fn name(self) -> &'static str {
        match self {
            InstructionSet::Portable => "portable",
            InstructionSet::Sse2 => "sse2",
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
                _ => Baseline::call(task),
            }
        }
    }
}
