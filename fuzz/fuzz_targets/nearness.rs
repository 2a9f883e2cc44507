//! See `nearness` in `tests/targets`.

#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| splitplane_fuzz_targets::nearness::run(data));
