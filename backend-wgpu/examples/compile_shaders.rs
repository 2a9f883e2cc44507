//! Compiles every shader by itself on a GPU adapter, and prints how much processor time and memory its driver took: as a table, and as
//! a report for `scripts/shader_figures.py`.
//!
//! ```sh
//! cargo run --release -p splitplane-wgpu --example compile_shaders -- ADAPTER KEY [REPORT.json] [NAME...]
//! ```
//!
//! Shaders whose rays may keep their stacks in the memory of the workgroup are compiled so too, as `NAME.workgroup`.
//!
//! ADAPTER is part of its name, KEY what the report calls the driver (`swiftshader`), NAME part of a shader's name; without one, all.
//! Each shader is compiled in a process of its own, which can be ended, and whose greatest memory is that of this shader. On Linux
//! only: elsewhere no system says what a process took. Exit code 1 where a shader does not compile, or takes more than 5 s or 1 GiB.

use std::borrow::Cow;
use std::error::Error;
use std::io::Write;
use std::process::{Command, ExitCode, Stdio};
use std::time::Duration;

use splitplane_shaders::{
    CHECKS, COMPRESS, KERNEL_RETRIES, KERNELS, NEAR, POINT_BUILD, POINTS, QUERIES, RENDER,
    RENDER_COMPRESSED, RENDER_RETRIES, RENDER_SETTLES, find, join, with_workgroup_stacks,
};
use splitplane_wgpu::{Gpu, OpenOptions, RayStack};

/// What a shader may take: seconds, and MiB.
const MOST: [f64; 2] = [5.0, 1024.0];
/// The first argument of a child.
const ONE: &str = "--one";
/// Behind the name of a shader: with the stacks of rays in the memory of the workgroup.
const WORKGROUP: &str = ".workgroup";
/// A driver that takes more is ended.
const LIMIT: Duration = Duration::from_secs(60);

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let done = match &arguments[..] {
        [first, adapter, shader] if first == ONE => one(adapter, shader).map(|()| true),
        [adapter, key, rest @ ..] => all(adapter, key, rest),
        _ => Err("arguments: ADAPTER KEY [REPORT.json] [NAME...]".into()),
    };
    match done {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(error) => {
            eprintln!("compile_shaders: {error}");
            ExitCode::FAILURE
        }
    }
}

/// Compiles one shader, and writes what that took.
fn one(adapter: &str, shader: &str) -> Result<(), Box<dyn Error>> {
    let (shader, ray_stack) = match shader.strip_suffix(WORKGROUP) {
        Some(shader) => (shader, Some(RayStack::Workgroup)),
        None => (shader, Some(RayStack::Private)),
    };
    let shader = find(shader).ok_or("no such shader")?;
    let options = OpenOptions {
        adapter: Some(adapter.into()),
        default_limits: true,
        driver_time: Some(LIMIT),
        driver_memory: Some(u64::MAX),
        ray_stack,
        ..OpenOptions::default()
    };
    let gpu = Gpu::open(&options)?;
    let parts = Cow::Borrowed(shader.parts);
    let source = join(&gpu.parts(parts));
    let before = taken().ok_or("this system does not say what a process takes")?;
    gpu.pipeline(shader.name, &source)?;
    let after = taken().ok_or("this system does not say what a process takes")?;
    println!("took {:.2} {:.0}", after[0] - before[0], after[1] - before[1]);
    Ok(())
}

/// Seconds on processors, and the most MiB of memory, of this process so far.
fn taken() -> Option<[f64; 2]> {
    let stat = std::fs::read_to_string("/proc/self/stat").ok()?;
    // A name in parentheses may hold anything; times follow the state and ten numbers, in hundredths of a second.
    let mut fields = stat.rsplit_once(')')?.1.split_ascii_whitespace().skip(11);
    let mut ticks = || fields.next()?.parse::<f64>().ok();
    let seconds = (ticks()? + ticks()?) / 100.0;
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let most = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    let kibibytes: f64 = most.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some([seconds, kibibytes / 1024.0])
}

/// Compiles all shaders, and writes table and report. Whether none takes too much.
fn all(adapter: &str, key: &str, rest: &[String]) -> Result<bool, Box<dyn Error>> {
    let (report, names) = match rest {
        [file, names @ ..] if file.ends_with(".json") => (Some(file), names),
        names => (None, names),
    };
    let tables = [
        KERNELS,
        KERNEL_RETRIES,
        COMPRESS,
        QUERIES,
        POINT_BUILD,
        POINTS,
        NEAR,
        RENDER,
        RENDER_COMPRESSED,
        RENDER_RETRIES,
        RENDER_SETTLES,
        CHECKS,
    ];
    let asked = |name: &str| names.is_empty() || names.iter().any(|part| name.contains(&part[..]));
    let shaders = tables.into_iter().flatten().flat_map(|shader| {
        let own = Cow::Borrowed(shader.parts);
        let other = (with_workgroup_stacks(own) != shader.parts).then_some(WORKGROUP);
        let endings = std::iter::once("").chain(other);
        endings.map(|ending| format!("{}{ending}", shader.name))
    });
    let shaders = shaders.filter(|name| asked(name));
    let (mut lines, mut fine, mut worst) = (Vec::new(), true, [0.0f64; 2]);
    for name in shaders {
        let child = Command::new(std::env::current_exe()?)
            .args([ONE, adapter, &name])
            .stderr(Stdio::piped())
            .output()?;
        let said = String::from_utf8_lossy(&child.stdout);
        let numbers = said.lines().find_map(|line| {
            let (seconds, mebibytes) = line.strip_prefix("took ")?.split_once(' ')?;
            Some([seconds.parse::<f64>().ok()?, mebibytes.parse::<f64>().ok()?])
        });
        let Some(took) = numbers else {
            let why = String::from_utf8_lossy(&child.stderr);
            println!("{name:<32} FAILED: {}", why.lines().last().unwrap_or("it said nothing"));
            lines.push(format!("  \"{name}\": {{\"{key}.seconds\": \"failed\"}}"));
            fine = false;
            continue;
        };
        let over = took[0] > MOST[0] || took[1] > MOST[1];
        println!(
            "{name:<32} {:>6.2} s {:>6.0} MiB{}",
            took[0],
            took[1],
            if over { "  TOO MUCH" } else { "" }
        );
        let [seconds, mebibytes] = took;
        lines.push(format!(
            "  \"{name}\": {{\"{key}.seconds\": {seconds}, \"{key}.mib\": {mebibytes}}}"
        ));
        fine &= !over;
        worst = [worst[0].max(took[0]), worst[1].max(took[1])];
    }
    println!("{} shaders; at most {:.2} s and {:.0} MiB", lines.len(), worst[0], worst[1]);
    if let Some(file) = report {
        let mut file = std::fs::File::create(file)?;
        writeln!(file, "{{\n{}\n}}", lines.join(",\n"))?;
    }
    Ok(fine && !lines.is_empty())
}
