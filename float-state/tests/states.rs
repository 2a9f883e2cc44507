//! Work runs in the default state, whatever state the thread has, and the thread has its own again
//! afterwards.

#![cfg(all(target_arch = "x86_64", not(miri)))]

use core::arch::asm;
use std::hint::black_box;
use std::panic::{AssertUnwindSafe, catch_unwind};

use splitplane_float_state::{Standard, is_standard, standard};

const DEFAULT: u32 = 0x1f80;
/// The flag of an inexact result.
const INEXACT: u32 = 1 << 5;

fn read() -> u32 {
    let mut word = 0u32;
    // SAFETY: stores MXCSR to a variable of this function.
    unsafe { asm!("stmxcsr [{}]", in(reg) &raw mut word, options(nostack)) };
    word
}

fn write(word: u32) {
    // SAFETY: loads MXCSR with a word without reserved bits.
    unsafe { asm!("ldmxcsr [{}]", in(reg) &raw const word, options(nostack)) };
}

/// A third, a tenth below zero, the least subnormal doubled and the least normal number halved:
/// each state but the default changes one of them.
fn numbers() -> [u32; 4] {
    let [one, two, three, ten] = black_box([1.0f32, 2.0, 3.0, -10.0]);
    let (least, normal) = black_box((f32::from_bits(1), f32::MIN_POSITIVE));
    [one / three, one / ten, least * two, normal / two].map(f32::to_bits)
}

#[test]
fn work_runs_in_the_default_state() {
    write(DEFAULT);
    let expected = numbers();
    assert!(is_standard());
    for state in (0..16u32).map(|i| DEFAULT | (i & 3) << 13 | (i >> 2 & 1) << 15 | (i >> 3) << 6) {
        write(state);
        let (own, found) = (numbers(), standard(numbers));
        let (after, known) = (read() & !0x3f, is_standard());
        let guarded = {
            let _state = Standard::set();
            numbers()
        };
        let ended = catch_unwind(AssertUnwindSafe(|| {
            standard(|| assert_eq!(read() & !0x3f, state | 1 << 31));
        }));
        let at_last = read() & !0x3f;
        write(DEFAULT);
        assert!(ended.is_err());
        assert_eq!([after, at_last], [state; 2]);
        assert_eq!([found, guarded], [expected; 2], "{state:#x}");
        assert_eq!(own == expected, state == DEFAULT, "{state:#x}");
        assert_eq!(known, state == DEFAULT);
    }
}

#[test]
fn flags_stay_and_exceptions_are_masked() {
    // Inexact results are not masked: outside of the work they would end the program.
    write(DEFAULT & !(INEXACT << 7));
    let third = standard(|| black_box(1.0f32) / black_box(3.0f32));
    let after = read();
    write(DEFAULT | 1);
    standard(|| black_box(third / black_box(3.0f32)));
    let raised = read();
    write(DEFAULT);
    assert_eq!(after, DEFAULT & !(INEXACT << 7));
    assert_eq!(raised & 0x21, 0x21);
}
