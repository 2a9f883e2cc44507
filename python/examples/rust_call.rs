//! The Rust calls beside the package's: `cargo run --release --example rust_call -- DIRECTORY SET RAYS THREADS REPEATS`.
//!
//! Prints the seconds of each batch without a watch and with one, by the wall clock, and the CPU time of both over all calls (on Linux), for `scripts/overhead.py`.

use std::error::Error;
use std::ops::ControlFlow;
use std::path::Path;
use std::time::{Duration, Instant};

use splitplane::{BackendKind, BuildOptions, Hit, Mesh, Progress, QueryOptions, Ray};

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [folder, set, rays, threads, repeats] = arguments.as_slice() else {
        return Err("DIRECTORY SET RAYS THREADS REPEATS".into());
    };
    let read = |name: &str| -> Result<Vec<u32>, Box<dyn Error>> {
        let bytes = std::fs::read(Path::new(folder).join(name))?;
        Ok(bytes.as_chunks::<4>().0.iter().map(|word| u32::from_le_bytes(*word)).collect())
    };
    let (vertices, faces, words) =
        (read("verts.f32")?, read("index.u32")?, read(&format!("{set}.rays"))?);
    let vertices: Vec<[f32; 3]> =
        vertices.as_chunks::<3>().0.iter().map(|vertex| vertex.map(f32::from_bits)).collect();
    let rays: Vec<Ray> = words
        .as_chunks::<8>()
        .0
        .iter()
        .take(rays.parse()?)
        .map(|ray| {
            let [a, b, c, x, y, z, _, _] = ray.map(f32::from_bits);
            Ray::new([a, b, c], [x, y, z])
        })
        .collect();
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads.parse()?).build()?;
    let mesh = Mesh::indexed(&vertices, faces.as_chunks::<3>().0)?;
    let backend = BackendKind::Cpu.open()?.backend;
    let tree = backend.build(&mesh, &BuildOptions::default())?;
    let mut hits = vec![Hit::MISS; rays.len()];
    let watch = |_: &Progress| ControlFlow::Continue(());
    let options = [
        ("plain", QueryOptions::default()),
        ("watched", QueryOptions { watch: Some(&watch), ..QueryOptions::default() }),
    ];
    let repeats: usize = repeats.parse()?;
    for (name, options) in &options {
        let mut call = || pool.install(|| tree.closest_hits(&rays, &mut hits, options));
        call()?;
        let before = cpu_seconds();
        let mut seconds = Vec::with_capacity(repeats);
        for _ in 0..repeats {
            let begun = Instant::now();
            call()?;
            seconds.push(begun.elapsed().as_secs_f64());
        }
        let cpu = cpu_seconds() - before;
        seconds.iter().for_each(|seconds| println!("{name} {seconds}"));
        println!("{name}-cpu {}", cpu / repeats as f64);
    }
    Ok(())
}

/// CPU time of all threads so far; 0 where the system does not tell it this way.
fn cpu_seconds() -> f64 {
    // A thread that runs is behind by up to a tick, unless it has just waited.
    std::thread::sleep(Duration::from_millis(1));
    let Ok(threads) = std::fs::read_dir("/proc/self/task") else { return 0.0 };
    let of = |thread: std::io::Result<std::fs::DirEntry>| -> Option<f64> {
        let text = std::fs::read_to_string(thread.ok()?.path().join("schedstat")).ok()?;
        text.split(' ').next()?.parse().ok()
    };
    threads.filter_map(of).sum::<f64>() / 1e9
}
