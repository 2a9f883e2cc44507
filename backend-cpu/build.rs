//! Tells the code where nothing is optimised.
//!
//! Everything generic over vectors is inlined into one function, or it would not be compiled for the instruction
//! set. A compiler that does not optimise gives each value of that function a place of its own on the stack:
//! two megabytes for a batch of rays, all that a thread has. There nothing is forced to be inlined.

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    println!("cargo::rustc-check-cfg=cfg(unoptimised)");
    // Cargo always sets it for build scripts.
    if std::env::var_os("OPT_LEVEL").is_some_and(|level| level == "0") {
        println!("cargo::rustc-cfg=unoptimised");
    }
}
