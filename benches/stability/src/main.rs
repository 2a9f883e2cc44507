//! `splitplane-stability`: traces rays at closed meshes, aimed at random, at edges and at vertices,
//! near the origin and far from it, and counts what the exact oracle would have answered otherwise.

mod options;
mod report;
mod subjects;

use crate::options::Options;
use crate::report::{Report, Row};
use clap::Parser;
use rayon::prelude::*;
use splitplane::{Accelerator, Backend, BuildOptions, Hit, QueryOptions, Ray};
use splitplane_test_support::aim::Aim;
use splitplane_test_support::oracle::Oracle;
use splitplane_test_support::stability::{Counter, Place, Shots, Side, Subject, Tally};
use std::error::Error;
use std::process::ExitCode;
use std::time::Instant;

type Failure = Box<dyn Error + Send + Sync>;

/// Rays of a batch, and of the part of it that one task makes and judges.
const BATCH: u64 = 1 << 17;
const PART: usize = 1 << 12;

fn main() -> ExitCode {
    let options = Options::parse();
    let opened = match options.backend.open() {
        Ok(opened) => opened,
        Err(error) => {
            eprintln!("splitplane-stability: {error}");
            return ExitCode::from(5);
        }
    };
    eprintln!("backend {}: {}", opened.backend.describe().name, opened.reason);
    match run(&options, &*opened.backend) {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(error) => {
            eprintln!("splitplane-stability: {error}");
            ExitCode::from(2)
        }
    }
}

fn run(options: &Options, backend: &dyn Backend) -> Result<bool, Failure> {
    let mut subjects = Vec::new();
    for name in &options.scene {
        subjects.push(subjects::open(name)?);
    }
    let mut report = Report::new(options);
    for &place in &options.place {
        let moves = place.moves();
        let share = options.rays.div_ceil((moves.len() * subjects.len()) as u64);
        for subject in &subjects {
            for &sizes in moves {
                let moved = subject.moved(sizes);
                let run = Run::new(&moved, options, backend)?;
                // Rays from far away come from outside; asked for once.
                let sides = options
                    .from
                    .iter()
                    .filter(|&&side| place != Place::Distant || side == Side::Outside);
                for &side in sides {
                    for &target in &options.aims {
                        let started = Instant::now();
                        let tally = run.trace(Shots { target, place, side }, share)?;
                        report.add(Row {
                            scene: moved.scene.name.clone(),
                            triangles: moved.scene.mesh().len(),
                            place: place.name(),
                            sizes,
                            from: side.name(),
                            aim: target.name(),
                            seconds: started.elapsed().as_secs_f64(),
                            tally,
                        });
                    }
                }
            }
        }
    }
    report.finish(options)
}

/// A mesh with its tree and its oracle.
struct Run<'a> {
    subject: &'a Subject,
    accelerator: Box<dyn Accelerator>,
    oracle: Oracle,
    query: QueryOptions<'static>,
    seed: u64,
    any: bool,
}

impl<'a> Run<'a> {
    fn new(
        subject: &'a Subject,
        options: &Options,
        backend: &dyn Backend,
    ) -> Result<Run<'a>, Failure> {
        let mesh = subject.scene.mesh();
        let build = BuildOptions::from(options.preset.config());
        let accelerator = backend.build(&mesh, &build)?;
        let query = QueryOptions { accuracy: options.accuracy, ..Default::default() };
        let (seed, any) = (options.seed, !options.closest_only);
        Ok(Run { subject, accelerator, oracle: Oracle::new(&mesh), query, seed, any })
    }

    fn trace(&self, shots: Shots, count: u64) -> Result<Tally, Failure> {
        let mesh = self.subject.scene.mesh();
        let aim = Aim::new(&mesh, 0);
        let counter = Counter::new(&mesh, &self.oracle, self.query);
        let mut total = Tally::default();
        for first in (0..count).step_by(BATCH as usize) {
            let batch = BATCH.min(count - first) as usize;
            let parts: Vec<(usize, u64)> = (0..batch)
                .step_by(PART)
                .map(|start| (PART.min(batch - start), first + start as u64))
                .collect();
            let rays: Vec<Ray> = parts
                .par_iter()
                .flat_map_iter(|&(size, number)| {
                    let key = (shots.target as u64) << 56 ^ (shots.side as u64) << 52;
                    let seed = self.seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ key ^ number;
                    shots.rays(self.subject, &aim, size, seed)
                })
                .collect();
            let mut hits = vec![Hit::MISS; rays.len()];
            self.accelerator.closest_hits(&rays, &mut hits, &self.query)?;
            let mut any = vec![false; if self.any { rays.len() } else { 0 }];
            if self.any {
                self.accelerator.any_hits(&rays, &mut any, &self.query)?;
            }
            let tallies: Vec<Tally> = rays
                .par_chunks(PART)
                .zip(hits.par_chunks(PART))
                .enumerate()
                .map(|(part, (rays, hits))| {
                    let from = part * PART;
                    let any = self.any.then(|| &any[from..from + rays.len()]);
                    counter.count(rays, hits, any)
                })
                .collect();
            tallies.iter().for_each(|tally| total.add(tally));
        }
        Ok(total)
    }
}
