//! `splitplane build`.

use super::failure::Failure;
use super::options::Common;
use super::output;
use super::prepared::{Prepared, in_pool, print_json};
use super::tree::save_tree;
use clap::Args;
use std::ffi::OsString;
use std::path::PathBuf;

#[derive(Args, Debug)]
pub(super) struct Arguments {
    /// An .obj, .ply, .stl, .gltf or .glb file, or builtin:NAME[:SIZE]
    #[arg(value_name = "SCENE")]
    scene: OsString,
    /// Write the tree to this file
    #[arg(long, short, value_name = "TREE")]
    output: Option<PathBuf>,
    #[command(flatten)]
    pub(super) common: Common,
}

pub(super) fn run(arguments: &Arguments) -> Result<(), Failure> {
    let common = &arguments.common;
    in_pool(common, || {
        let prepared = Prepared::open(&arguments.scene, common)?;
        if let Some(path) = &arguments.output {
            save_tree(path, prepared.accelerator.as_ref(), &prepared.scene.mesh()?)?;
        }
        if common.json {
            return print_json(&prepared.built().report());
        }
        if common.quiet {
            return Ok(());
        }
        let mut text = prepared.built().describe();
        if let Some(path) = &arguments.output {
            text.push_str(&format!("written  {}\n", path.display()));
        }
        output::data(&text)
    })
}
