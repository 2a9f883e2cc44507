//! The table that preset `auto` decides by: what builds and rays take by each preset, without Embree.

use std::sync::Arc;

use splitplane_core::backend::BuildOptions;
use splitplane_core::mesh::Mesh;
use splitplane_core::ray::{Accuracy, Hit, Ray};
use splitplane_cpu::auto_preset::MeshTraits;
use splitplane_cpu::{CpuBackend, InstructionSet};

use crate::turns::{Contestant, cpu_time, median, times};
use crate::{Options, Problem, ours, some};

/// Prints a line for each preset: the medians of the rounds, in which presets take turns. Builds are those of a builder in new memory.
/// Shadow rays ask for any hit, all others for the closest.
///
/// # Errors
/// Where something does not build.
pub(crate) fn measure(
    name: &str,
    mesh: &Mesh<'_>,
    sets: &[Vec<Ray>; 4],
    set: InstructionSet,
    options: &Options,
    pool: &rayon::ThreadPool,
) -> Result<(), Problem> {
    let presets = &options.presets;
    let mut builds = vec![Vec::new(); presets.len()];
    let mut trees = vec![None; presets.len()];
    for round in 0..=options.rounds.max(1) {
        for ((preset, seconds), tree) in presets.iter().zip(&mut builds).zip(&mut trees) {
            // Memory is returned before it is made anew.
            *tree = None;
            let (backend, build) =
                (CpuBackend::with_instruction_set(set), BuildOptions::from(*preset));
            let before = cpu_time();
            let built = pool.install(|| backend.build_accelerator(mesh, &build))?;
            let took = (cpu_time() - before).as_secs_f64();
            // The first round warms up.
            if round > 0 {
                seconds.push(took);
            }
            *tree = Some(Arc::new(built));
        }
    }
    let contestants: Vec<Contestant<'_>> = presets
        .iter()
        .zip(trees)
        .filter_map(|(preset, tree)| {
            Some(ours(preset.name().to_owned(), tree?, (Accuracy::Watertight, usize::MAX), pool))
        })
        .collect();
    let mut rays = vec![Vec::new(); presets.len()];
    for (number, all) in sets.iter().enumerate() {
        let asked = some(all, options.rays);
        let mut hits = vec![(Hit::MISS.t, Hit::MISS.triangle); asked.len()];
        let mut hit = vec![false; asked.len()];
        let seconds =
            times(contestants.len(), options.rounds, &mut |_| (), &mut |i| match number {
                1 => (contestants[i].any)(&asked, &mut hit),
                _ => (contestants[i].closest)(&asked, &mut hits),
            });
        for (place, own) in rays.iter_mut().enumerate() {
            let seconds = median(seconds.iter().map(|round| round[place]));
            own.push(seconds / asked.len().max(1) as f64 * 1e9);
        }
    }
    let MeshTraits { triangles, size_skew } = MeshTraits::of(mesh);
    for ((preset, builds), rays) in presets.iter().zip(builds).zip(rays) {
        print!("{},{},{name},{triangles},{size_skew:.4}", set.name(), preset.name());
        print!(",{:.4}", 1e3 * median(builds.into_iter()));
        for ns in rays {
            print!(",{ns:.2}");
        }
        println!();
    }
    Ok(())
}
