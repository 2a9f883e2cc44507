#![doc = include_str!("../README.md")]
//!
//! # Why this is sound
//! Rust assumes the default state, so a caller that changed it must not let Rust compute.
//! [`standard`] computes nothing before it has set the state, and sets the caller's before it
//! returns. Where it sets the state, the work is a call that is not inlined, between two blocks of
//! assembly that no access to memory moves across. So no operation of the work moves out of it.
//! Where the state is the default, there is nothing to keep apart. Exception flags that operations
//! raise stay raised, as after any call.
#![no_std]
#![cfg_attr(docsrs, feature(doc_cfg))]

/// Does work in the default state. The thread's own state is restored after it, also after a panic.
#[inline(always)]
pub fn standard<R>(work: impl FnOnce() -> R) -> R {
    if state::is_standard(state::read()) {
        return work();
    }
    in_other_state(work)
}

#[cold]
#[inline(never)]
fn in_other_state<R>(work: impl FnOnce() -> R) -> R {
    let _restored = Standard::set();
    apart(work)
}

#[inline(never)]
fn apart<R>(work: impl FnOnce() -> R) -> R {
    work()
}

/// Whether the calling thread is in the default state.
pub fn is_standard() -> bool {
    state::is_standard(state::read())
}

/// The default state, until it is dropped.
///
/// For functions and closures whose floats lie in memory, behind references: the compiler may move
/// operations on values that it has in registers across this. Others use [`standard`].
#[derive(Debug)]
#[must_use = "the state is restored where this is dropped"]
pub struct Standard {
    before: Option<state::Word>,
    /// It belongs to this thread.
    thread: core::marker::PhantomData<*const ()>,
}

impl Standard {
    /// Sets the default state.
    #[inline(always)]
    pub fn set() -> Standard {
        let before = state::read();
        let differs = !state::is_standard(before);
        if differs {
            state::write(state::standard(before));
        }
        Standard { before: differs.then_some(before), thread: core::marker::PhantomData }
    }
}

impl Drop for Standard {
    #[inline(always)]
    fn drop(&mut self) {
        if let Some(before) = self.before {
            state::write(state::restored(before, state::read()));
        }
    }
}

#[cfg(all(target_arch = "x86_64", not(miri)))]
mod state {
    use core::arch::asm;

    pub(super) type Word = u32;

    /// Sticky exception flags.
    const FLAGS: u32 = 0x3f;
    /// All exceptions masked; round to nearest; no flush to zero, no denormals as zero.
    const DEFAULT: u32 = 0x1f80;

    #[inline(always)]
    pub(super) fn read() -> u32 {
        let mut word = 0u32;
        // SAFETY: stores MXCSR to a variable of this function.
        unsafe { asm!("stmxcsr [{}]", in(reg) &raw mut word, options(nostack, preserves_flags)) };
        word
    }

    #[inline(always)]
    pub(super) fn write(word: u32) {
        // SAFETY: loads MXCSR with a word whose reserved bits are 0, as they were in the one that
        // was read. No `nomem`: memory accesses stay on their side.
        unsafe { asm!("ldmxcsr [{}]", in(reg) &raw const word, options(nostack, preserves_flags)) };
    }

    #[inline(always)]
    pub(super) fn is_standard(word: u32) -> bool {
        word & !FLAGS == DEFAULT
    }

    pub(super) fn standard(before: u32) -> u32 {
        DEFAULT | before & FLAGS
    }

    /// The state before, with the flags raised since. Where exceptions are not masked, flags of
    /// masked work would raise them.
    pub(super) fn restored(before: u32, now: u32) -> u32 {
        let unmasked = !(before >> 7) & FLAGS;
        before | now & FLAGS & !unmasked
    }
}

#[cfg(all(target_arch = "aarch64", not(miri)))]
mod state {
    use core::arch::asm;

    pub(super) type Word = u64;

    /// Rounding mode (RMode), flushing (FZ, FZ16, and FIZ, AH of FEAT_AFP), and traps. The default
    /// NaN (DN) matters to no result.
    const CONTROL: u64 = 0b11 << 22 | 1 << 24 | 1 << 19 | 0b11 | 0x9f00;

    #[inline(always)]
    pub(super) fn read() -> u64 {
        let word: u64;
        // SAFETY: reads FPCR. No `nomem`, so that it stays in order with writes.
        unsafe { asm!("mrs {}, fpcr", out(reg) word, options(nostack, preserves_flags)) };
        word
    }

    #[inline(always)]
    pub(super) fn write(word: u64) {
        // SAFETY: writes FPCR with bits that were read, some of them cleared. No `nomem`: memory
        // accesses stay on their side.
        unsafe { asm!("msr fpcr, {}", in(reg) word, options(nostack, preserves_flags)) };
    }

    #[inline(always)]
    pub(super) fn is_standard(word: u64) -> bool {
        word & CONTROL == 0
    }

    pub(super) fn standard(before: u64) -> u64 {
        before & !CONTROL
    }

    /// Flags are in another register.
    pub(super) fn restored(before: u64, _now: u64) -> u64 {
        before
    }
}

#[cfg(any(not(any(target_arch = "x86_64", target_arch = "aarch64")), miri))]
mod state {
    pub(super) type Word = ();

    #[inline(always)]
    pub(super) fn read() {}
    pub(super) fn write((): ()) {}
    #[inline(always)]
    pub(super) fn is_standard((): ()) -> bool {
        true
    }
    pub(super) fn standard((): ()) {}
    pub(super) fn restored((): (), (): ()) {}
}
