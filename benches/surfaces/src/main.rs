//! `splitplane-surfaces`: the long run of `tests/surfaces.rs`.

mod options;
mod run;

use crate::options::Options;
use crate::run::{Spent, Worker, device, sets};
use clap::Parser;
use splitplane_test_support::grazing::{Kind, Shape, Surface};
use splitplane_test_support::surfaces::{Failure, INSIDE, Tally, words};
use splitplane_wgpu::Queries;
use std::error::Error;
use std::fmt::Write as _;
use std::process::ExitCode;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::sync::{Arc, Mutex};
use std::time::Instant;

type Problem = Box<dyn Error + Send + Sync>;

fn main() -> ExitCode {
    match run(&Options::parse()) {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(problem) => {
            eprintln!("splitplane-surfaces: {problem}");
            ExitCode::from(2)
        }
    }
}

/// What all threads share.
struct Shared {
    next: AtomicU64,
    /// What was counted, by number of the surface.
    done: Mutex<Vec<(u64, Tally)>>,
    spent: Mutex<Spent>,
    device: Option<Arc<Queries>>,
}

fn run(options: &Options) -> Result<bool, Problem> {
    let started = Instant::now();
    let shared = Shared {
        next: AtomicU64::new(0),
        done: Mutex::new(Vec::new()),
        spent: Mutex::new(Spent::default()),
        device: options.gpu.as_deref().map(device).transpose()?,
    };
    let names: Vec<&str> = sets().iter().map(|set| set.name()).collect();
    if let Some(device) = &shared.device {
        let info = device.gpu().info();
        println!(
            "seed {}; 3 presets take turns on {} ({})",
            options.seed, info.name, info.driver_info
        );
    } else {
        println!(
            "seed {}; of 3 presets, 2 layouts and the sets {}, {} configurations a surface take turns",
            options.seed,
            names.join(", "),
            options.configurations
        );
    }
    let results: Vec<Result<(), Problem>> = std::thread::scope(|scope| {
        let threads: Vec<_> =
            (0..options.threads).map(|_| scope.spawn(|| work(options, &shared))).collect();
        threads.into_iter().map(|thread| thread.join().expect("no panic")).collect()
    });
    results.into_iter().collect::<Result<(), Problem>>()?;
    let mut done = shared.done.into_inner()?;
    // In the order of surfaces, so that the first failures are the same whatever the threads.
    done.sort_by_key(|(number, _)| *number);
    let mut total = Tally::default();
    done.into_iter().for_each(|(_, tally)| total.add(tally));
    print!("{total}");
    for failure in &total.first {
        print!("{}", mesh_of(failure));
        if let Some(folder) = &options.save {
            save(failure, folder)?;
        }
    }
    let wall = started.elapsed().as_secs_f64();
    let spent = *shared.spent.lock().map_err(|_| "a thread panicked")?;
    let core_seconds = wall * f64::from(options.threads);
    println!(
        "{wall:.1} s on {} threads; a second of a core: {:.2} million rays, {:.2} million answers",
        options.threads,
        total.rays as f64 / core_seconds / 1e6,
        total.answers as f64 / core_seconds / 1e6
    );
    println!("{spent}");
    Ok(total.all_is_well().is_ok())
}

/// How many surfaces give the rays that were asked for, whatever the threads.
fn surfaces(options: &Options) -> u64 {
    // Rays from inside are for the closed ones only.
    let closed = Shape::ALL.into_iter().filter(|shape| shape.is_closed()).count();
    let kinds = Shape::ALL.len() * (Kind::ALL.len() - 1) + closed * INSIDE;
    let rays = u128::from(options.rays) * Shape::ALL.len() as u128;
    rays.div_ceil(kinds as u128 * u128::from(options.each)) as u64
}

/// One thread: takes surfaces until there are rays enough. Queries go to a pool of one thread, so that they stay
/// here.
fn work(options: &Options, shared: &Shared) -> Result<(), Problem> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build()?;
    pool.install(|| {
        let mut worker = Worker::new(options, shared.device.clone());
        let surfaces = surfaces(options);
        loop {
            let number = shared.next.fetch_add(1, Relaxed);
            if number >= surfaces {
                break;
            }
            let tally = worker.surface(number)?;
            shared.done.lock().map_err(|_| "a thread panicked")?.push((number, tally));
        }
        shared.spent.lock().map_err(|_| "a thread panicked")?.add(&worker.spent);
        Ok(())
    })
}

/// Mesh and ray of a failure in hexadecimal words.
fn mesh_of(failure: &Failure) -> String {
    let surface = Surface::new(failure.surface.0, failure.surface.1);
    let mut text = format!("{}, ray", failure.what);
    words(&failure.ray).iter().for_each(|word| write!(text, " {word:08x}").expect("a string"));
    text.push('\n');
    for corners in surface.scene.triangles() {
        for x in corners.as_flattened() {
            write!(text, " {:08x}", x.to_bits()).expect("a string");
        }
        text.push('\n');
    }
    text
}

fn save(failure: &Failure, folder: &std::path::Path) -> Result<(), Problem> {
    let surface = Surface::new(failure.surface.0, failure.surface.1);
    let mut text = String::new();
    for [x, y, z] in &surface.scene.positions {
        writeln!(text, "v {x} {y} {z}")?;
    }
    for [a, b, c] in surface.scene.indices.as_deref().unwrap_or_default() {
        writeln!(text, "f {} {} {}", a + 1, b + 1, c + 1)?;
    }
    std::fs::create_dir_all(folder)?;
    let file = folder.join(failure.what.replace(' ', "-"));
    std::fs::write(file.with_extension("obj"), text)?;
    let bytes: Vec<u8> = words(&failure.ray).iter().flat_map(|word| word.to_le_bytes()).collect();
    std::fs::write(file.with_extension("rays"), bytes)?;
    Ok(())
}
