//! See `stl` in `tests/targets`.

#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| splitplane_fuzz_targets::stl::run(data));
