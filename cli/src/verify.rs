//! `splitplane verify`.

use super::failure::Failure;
use super::options::Common;
use super::prepared::{Prepared, in_pool, print_json};
use super::tree::check_tree;
use super::{output, progress, verify_objects};
use clap::Args;
use serde::Serialize;
use splitplane::scene::InstancedScene;
use splitplane::verify::{Aim, check};
use std::ffi::OsString;

#[derive(Args, Debug)]
pub(super) struct Arguments {
    /// An .obj, .ply, .stl, .gltf or .glb file, a .json or .scene file of many objects, or builtin:NAME[:SIZE]
    #[arg(value_name = "SCENE")]
    scene: OsString,
    /// Rays of each kind: random, aimed at edges, aimed at vertices. Of many objects each geometry gets its share of them, and as many or
    /// fewer go through the whole scene, to be compared with all instances asked one after the other
    #[arg(long, value_name = "N", default_value_t = 100_000, value_parser = clap::value_parser!(u64).range(1..=1_000_000_000))]
    rays: u64,
    #[command(flatten)]
    pub(super) common: Common,
}

#[derive(Serialize)]
struct VerifyReport {
    rays: u64,
    mismatches: u64,
    misses: u64,
    phantoms: u64,
    unexplained: u64,
}

pub(super) fn run(arguments: &Arguments) -> Result<(), Failure> {
    let common = &arguments.common;
    in_pool(common, || {
        if InstancedScene::is_named_by(&arguments.scene) {
            return verify_objects::run(&arguments.scene, arguments.rays, common);
        }
        let rays = arguments.rays * Aim::ALL.len() as u64;
        let prepared = Prepared::open(&arguments.scene, common, Ok(rays))?;
        let mesh = prepared.scene.mesh()?;
        let accelerator = prepared.accelerator.as_ref();
        let sound = check_tree(accelerator, &mesh);
        let total = arguments.rays * Aim::ALL.len() as u64;
        let bar = progress::bar(common.quiet, "checking", total);
        let options = common.query_options();
        let found = check(accelerator, &mesh, arguments.rays, &options, &|rays| bar.inc(rays))?;
        bar.finish_and_clear();
        if common.json {
            print_json(&VerifyReport {
                rays: found.rays,
                mismatches: found.mismatches,
                misses: found.misses,
                phantoms: found.phantoms,
                unexplained: found.unexplained,
            })?;
        } else if !common.quiet {
            let soundness = match &sound {
                Ok(()) => "is sound",
                Err(problem) => problem,
            };
            output::data(&format!(
                "{}checked  the tree {soundness}\n\
                 checked  {} rays, accuracy {}: {} mismatches, {} misses, {} phantoms, {} of them \
                 beyond the error bound; {} answers of the reference by brute force\n",
                prepared.built().describe(),
                found.rays,
                common.accuracy_name(),
                found.mismatches,
                found.misses,
                found.phantoms,
                found.unexplained,
                found.spot_checks
            ))?;
        }
        sound
            .map_err(|problem| Failure::failed_check(format!("the tree is damaged: {problem}")))?;
        match &found.first {
            None => Ok(()),
            Some(first) => Err(Failure::failed_check(format!(
                "{} answers are wrong; the first is {first}",
                found.unexplained
            ))),
        }
    })
}
