//! Tests that need a GPU adapter are ignored, visibly, where `scripts/test.sh` could not set one up, and
//! those that need the files of real scenes where there are none. The library itself needs no build script,
//! and the published package has none.

use std::env;
use std::path::Path;

/// Where the scenes are when `SPLITPLANE_SCENES` names no other folder.
const SCENES: &str = "../shared/scenes";

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    println!("cargo::rerun-if-env-changed=SPLITPLANE_GPU");
    println!("cargo::rustc-check-cfg=cfg(no_gpu)");
    if env::var("SPLITPLANE_GPU").is_ok_and(|value| value == "absent") {
        println!("cargo::rustc-cfg=no_gpu");
    }
    println!("cargo::rerun-if-env-changed=SPLITPLANE_SCENES");
    println!("cargo::rustc-check-cfg=cfg(no_scenes)");
    if env::var_os("SPLITPLANE_SCENES").is_none() && !Path::new(SCENES).is_dir() {
        println!("cargo::rustc-cfg=no_scenes");
    }
}
