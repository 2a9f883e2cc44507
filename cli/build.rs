//! Tests of the viewer need a display and a GPU adapter. They are ignored, visibly, where
//! `scripts/test.sh` could not set them up.

use std::env;

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    for (variable, cfg) in [("SPLITPLANE_DISPLAY", "no_display"), ("SPLITPLANE_GPU", "no_gpu")] {
        println!("cargo::rerun-if-env-changed={variable}");
        println!("cargo::rustc-check-cfg=cfg({cfg})");
        if env::var(variable).is_ok_and(|value| value == "absent") {
            println!("cargo::rustc-cfg={cfg}");
        }
    }
}
