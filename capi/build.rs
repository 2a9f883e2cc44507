//! Gives the shared library its name for loaders, on the systems that have such names.

fn main() {
    let system = std::env::var("CARGO_CFG_TARGET_OS").unwrap_or_default();
    // Before 1.0 a minor version may break programs.
    let [major, minor] = ["MAJOR", "MINOR"]
        .map(|part| std::env::var(format!("CARGO_PKG_VERSION_{part}")).unwrap_or_default());
    let name = if major == "0" { format!("{major}.{minor}") } else { major };
    match system.as_str() {
        "linux" | "freebsd" | "netbsd" | "openbsd" => {
            println!("cargo::rustc-cdylib-link-arg=-Wl,-soname,libsplitplane.so.{name}");
        }
        "macos" => {
            println!(
                "cargo::rustc-cdylib-link-arg=-Wl,-install_name,@rpath/libsplitplane.{name}.dylib"
            );
        }
        _ => {}
    }
    println!("cargo::rerun-if-changed=build.rs");
}
