//! How builds would scale: work and the longest chain of what must follow one another, measured on one thread with tasks as small as many
//! threads have them.

use splitplane_core::backend::BuildOptions;
use splitplane_core::mesh::Mesh;
use splitplane_cpu::span::{Span, measure as measured};
use splitplane_cpu::{CpuBackend, InstructionSet};

use crate::turns::cpu_time;
use crate::{Options, Problem};

/// Prints what the columns of [`measure`] are.
pub(crate) fn print_head(threads: u32) {
    println!(
        "| scene | preset | | work, ms | span, ms | span, % | work / span | serial, % | on {threads} threads at most, ms | times as fast |"
    );
    println!("|---|---|---|---:|---:|---:|---:|---:|---:|---:|");
}

/// Prints a line for the tree alone and one for the rebuild of an accelerator, by each preset: of the rounds the one that took least. The first
/// build makes the memory.
///
/// # Errors
/// Where something does not build.
pub(crate) fn measure(
    name: &str,
    mesh: &Mesh<'_>,
    (set, threads): (InstructionSet, u32),
    options: &Options,
    pool: &rayon::ThreadPool,
) -> Result<(), Problem> {
    for preset in &options.presets {
        let (backend, build) = (CpuBackend::with_instruction_set(set), BuildOptions::from(*preset));
        let mut kept = pool.install(|| backend.build_accelerator(mesh, &build))?;
        let (mut tree, mut whole) = (Vec::new(), Vec::new());
        for round in 0..=options.rounds.max(1) {
            let (span, built) = pool.install(|| {
                measured(threads as usize, cpu_time, || backend.build_tree(mesh, &build))
            });
            drop(built?);
            let (other, rebuilt) = pool.install(|| {
                measured(threads as usize, cpu_time, || {
                    backend.rebuild_accelerator(&mut kept, mesh, &build)
                })
            });
            rebuilt?;
            // The first round makes what so many threads need.
            if round > 0 {
                tree.push(span);
                whole.push(other);
            }
        }
        for (what, spans) in [("tree", tree), ("all", whole)] {
            let Some(span) = spans.into_iter().min_by_key(|span| span.work) else { continue };
            print(&[name, preset.name(), what], &span, threads);
        }
    }
    Ok(())
}

fn print([scene, preset, what]: &[&str; 3], span: &Span, threads: u32) {
    let ms = |time: std::time::Duration| 1e3 * time.as_secs_f64();
    let (work, chain, least) = (ms(span.work), ms(span.span), ms(span.time_on(threads)));
    println!(
        "| {scene} | `{preset}` | {what} | {work:.1} | {chain:.2} | {:.1} | {:.0} | {:.2} | {least:.2} | {:.0} |",
        100.0 * chain / work,
        work / chain,
        100.0 * ms(span.serial) / work,
        work / least
    );
}
