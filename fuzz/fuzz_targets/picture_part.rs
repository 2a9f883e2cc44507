//! See `picture_part` in `tests/targets`.

#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| splitplane_fuzz_targets::picture_part::run(data));
