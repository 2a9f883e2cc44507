//! Tests that need a GPU adapter are ignored, visibly, where `scripts/test.sh` could not set one up.

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    println!("cargo::rerun-if-env-changed=SPLITPLANE_GPU");
    println!("cargo::rustc-check-cfg=cfg(no_gpu)");
    if std::env::var("SPLITPLANE_GPU").is_ok_and(|value| value == "absent") {
        println!("cargo::rustc-cfg=no_gpu");
    }
}
