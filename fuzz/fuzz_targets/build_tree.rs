//! See `build_tree` in `tests/targets`.

#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| splitplane_fuzz_targets::build_tree::run(data));
