//! Chooses the backend by name at run time: `cargo run --example switch_backend -- cpu`.

use splitplane::{BackendKind, BuildOptions, Mesh, QueryOptions, Ray};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let kind: BackendKind = match std::env::args().nth(1) {
        Some(name) => name.parse()?,
        None => BackendKind::Auto,
    };
    // Asking for a GPU where there is none is an error, never a silent run on the CPU.
    let opened = match kind.open() {
        Ok(opened) => opened,
        Err(error) => {
            println!("no backend `{kind}`: {error}");
            return Ok(());
        }
    };
    let info = opened.backend.describe();
    println!("asked for {kind}, took {} ({})", info.name, opened.reason);

    // From here on nothing depends on which backend it is; nor does the digest.
    let soup = [[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]];
    let mesh = Mesh::soup(&soup)?;
    let tree = opened.backend.build(&mesh, &BuildOptions::default())?;
    let ray = Ray::new([0.2, 0.2, 1.0], [0.0, 0.0, -1.0]);
    println!(
        "digest {}, hit {:?}",
        tree.tree().digest(),
        tree.closest_hit(&ray, &QueryOptions::default())
    );
    Ok(())
}
