//! `splitplane build`.

use super::failure::Failure;
use super::files;
use super::objects_built::BuiltObjects;
use super::options::Common;
use super::output;
use super::own_files;
use super::prepared::{Prepared, in_pool, print_json};
use super::tree::save_tree;
use clap::Args;
use splitplane::objects::write_file;
use splitplane::scene::InstancedScene;
use splitplane::scene::instanced::is_saved;
use splitplane_scene::from_file::quoted_path;
use std::ffi::OsString;
use std::path::{Path, PathBuf};

#[derive(Args, Debug)]
pub(super) struct Arguments {
    /// An .obj, .ply, .stl, .gltf or .glb file, a .json or .scene file of many objects, or builtin:NAME[:SIZE]
    #[arg(value_name = "SCENE")]
    scene: OsString,
    /// Write the tree to this file; of many objects all that is built, to a file that ends in .scene
    #[arg(long, short, value_name = "FILE")]
    output: Option<PathBuf>,
    /// How many rays the tree is to answer: what --preset auto chooses by
    #[arg(long, value_name = "N")]
    rays: Option<u64>,
    #[command(flatten)]
    pub(super) common: Common,
}

pub(super) fn run(arguments: &Arguments) -> Result<(), Failure> {
    let common = &arguments.common;
    if arguments.rays.is_some() && !common.is_auto() {
        return Err(Failure::usage("--rays is what --preset auto chooses by; leave it out"));
    }
    own_files::check([Path::new(&arguments.scene)], arguments.output.as_deref())?;
    in_pool(common, || {
        if InstancedScene::is_named_by(&arguments.scene) {
            return build_objects(arguments);
        }
        let rays =
            arguments.rays.ok_or("--preset auto chooses by the number of rays: give --rays N");
        let prepared = Prepared::open(&arguments.scene, common, rays)?;
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

/// Builds a scene of many objects.
fn build_objects(arguments: &Arguments) -> Result<(), Failure> {
    let common = &arguments.common;
    // What is saved is found again by its name.
    if let Some(path) = arguments.output.as_ref().filter(|path| !is_saved(path)) {
        return Err(Failure::usage(format!(
            "`{}` does not end in .scene; scenes of many objects are saved under such names",
            quoted_path(path)
        )));
    }
    let built = BuiltObjects::open(&arguments.scene, common)?;
    if let Some(path) = &arguments.output {
        files::write(path, &write_file(built.accelerator.scene())?)?;
    }
    if common.json {
        return print_json(&built.report());
    }
    if common.quiet {
        return Ok(());
    }
    let mut text = built.describe();
    if let Some(path) = &arguments.output {
        text.push_str(&format!("written  {}\n", path.display()));
    }
    output::data(&text)
}
