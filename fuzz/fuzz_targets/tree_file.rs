//! See `tree_file` in `tests/targets`.

#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| splitplane_fuzz_targets::tree_file::run(data));
