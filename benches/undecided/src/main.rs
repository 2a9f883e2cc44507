//! Counts the rays of accuracy `exact` that a device's bounds of error leave undecided.
//!
//!     splitplane-undecided SCENE.obj [RAYS...] [--every N] [--aimed N]
//!
//! The device's traversal is run on the CPU, by its twin in the core (`splitplane_core::query::certify`); on
//! a device with bitwise parity it decides the same. Each RAYS is a file of 32-byte records as the verb
//! `query` reads them, of which every N-th ray is taken; `--aimed` adds N rays each at edges, at
//! vertices and at random points. Every decided ray is held against the exact traversal: closest hit
//! and any hit. Exit code 1 if one differs.

use std::process::ExitCode;

use rayon::prelude::*;
use splitplane_core::arithmetic::Strict;
use splitplane_core::backend::{Accelerator, BuildOptions};
use splitplane_core::mesh::Mesh;
use splitplane_core::query::certify;
use splitplane_core::query::traverse::Query;
use splitplane_core::query::traverse::exact;
use splitplane_core::ray::{Hit, QueryOptions, Ray};
use splitplane_cpu::{CpuAccelerator, CpuBackend};
use splitplane_test_support::{aim, scenes};

/// What is counted of a set of rays.
#[derive(Clone, Copy, Default)]
struct Counts {
    rays: u64,
    hits: u64,
    undecided: u64,
    undecided_any: u64,
    wrong: u64,
}

impl Counts {
    fn of(built: &CpuAccelerator, mesh: &Mesh<'_>, ray: &Ray) -> Counts {
        let (tree, scale) = (built.tree().view(), built.scene_scale());
        let options = QueryOptions::default();
        let found = |query| certify::trace::<Strict>(&tree, mesh, scale, ray, &options, query);
        let closest = found(Query::Closest);
        let any = found(Query::Any);
        let expected = exact::closest_hit(&tree, mesh, ray, &options);
        let expected_triangle = expected.map_or(u32::MAX, |hit| hit.triangle);
        let undecided = closest.triangle == Hit::UNDECIDED;
        let undecided_any = any.triangle == Hit::UNDECIDED;
        let wrong = (!undecided && closest.triangle != expected_triangle)
            || (!undecided_any && any.is_hit() != expected.is_some());
        Counts {
            rays: 1,
            hits: expected.is_some().into(),
            undecided: undecided.into(),
            undecided_any: undecided_any.into(),
            wrong: wrong.into(),
        }
    }

    fn plus(self, other: Counts) -> Counts {
        Counts {
            rays: self.rays + other.rays,
            hits: self.hits + other.hits,
            undecided: self.undecided + other.undecided,
            undecided_any: self.undecided_any + other.undecided_any,
            wrong: self.wrong + other.wrong,
        }
    }
}

fn main() -> ExitCode {
    let mut files = Vec::new();
    let (mut every, mut aimed) = (1usize, 0usize);
    let mut arguments = std::env::args().skip(1);
    while let Some(argument) = arguments.next() {
        let mut number = || arguments.next().and_then(|n| n.parse().ok());
        match argument.as_str() {
            "--every" => every = number().unwrap_or(0),
            "--aimed" => aimed = number().unwrap_or(0),
            _ => files.push(argument),
        }
    }
    if files.is_empty() || every == 0 {
        eprintln!("splitplane-undecided SCENE.obj [RAYS...] [--every N] [--aimed N]");
        return ExitCode::from(2);
    }
    let scene_file = files.remove(0);
    let text = match std::fs::read_to_string(&scene_file) {
        Ok(text) => text,
        Err(error) => {
            eprintln!("{scene_file}: {error}");
            return ExitCode::from(3);
        }
    };
    let scene = scenes::parse_obj(&scene_file, &text);
    let mesh = scene.mesh();
    let built = match CpuBackend::new().build_accelerator(&mesh, &BuildOptions::default()) {
        Ok(built) => built,
        Err(error) => {
            eprintln!("{scene_file}: {error}");
            return ExitCode::from(3);
        }
    };
    let mut sets = Vec::new();
    for file in files {
        match std::fs::read(&file) {
            Ok(bytes) => {
                // Records of origin, direction, limits.
                let word = |at: &[u8]| f32::from_le_bytes([at[0], at[1], at[2], at[3]]);
                let ray = |record: &[u8]| {
                    let r: Vec<f32> = record.chunks_exact(4).map(word).collect();
                    Ray::new([r[0], r[1], r[2]], [r[3], r[4], r[5]]).with_limits(r[6], r[7])
                };
                let rays = bytes.chunks_exact(32).step_by(every).map(ray).collect::<Vec<Ray>>();
                sets.push((file, rays));
            }
            Err(error) => {
                eprintln!("{file}: {error}");
                return ExitCode::from(3);
            }
        }
    }
    if aimed > 0 {
        for kind in aim::Kind::ALL {
            sets.push((format!("aimed, {kind:?}"), aim::rays(&mesh, kind, aimed, 1)));
        }
    }
    println!("| scene | rays | number | hit | undecided | share | any hit: undecided | wrong |");
    println!("|---|---|---:|---:|---:|---:|---:|---:|");
    let mut wrong = 0;
    for (name, rays) in sets {
        let counts = rays
            .par_iter()
            .map(|ray| Counts::of(&built, &mesh, ray))
            .reduce(Counts::default, Counts::plus);
        let Counts { rays, hits, undecided, undecided_any, .. } = counts;
        let share = undecided as f64 / rays.max(1) as f64;
        println!(
            "| {scene_file} | {name} | {rays} | {hits} | {undecided} | {share:.1e} | \
             {undecided_any} | {} |",
            counts.wrong
        );
        wrong += counts.wrong;
    }
    ExitCode::from(u8::from(wrong > 0))
}
