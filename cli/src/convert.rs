//! `splitplane convert`.

use super::failure::Failure;
use super::files::{self, ends_in};
use super::options::bytes;
use super::output;
use super::own_files;
use clap::{Args, ValueEnum};
use splitplane::scene::ply::{self, Encoding};
use splitplane::scene::{InstancedScene, MeshFileProblem, Scene, SceneOptions, gltf};
use splitplane_scene::from_file::{quoted, quoted_path};
use std::ffi::OsString;
use std::path::{Path, PathBuf};

#[derive(Args, Debug)]
pub(super) struct Arguments {
    /// What to write: an .obj, .ply, .stl, .gltf or .glb file, a .json scene file, or builtin:NAME[:SIZE]
    #[arg(value_name = "SCENE")]
    scene: OsString,
    /// The file: .ply takes positions, normals and triangles, of all instances in the first frame; .glb all of the
    /// scene
    #[arg(value_name = "FILE.ply|.glb")]
    output: PathBuf,
    /// How the numbers of a .ply are written
    #[arg(long, value_enum, default_value_t = Numbers::Little)]
    numbers: Numbers,
    /// Most bytes of a file that is read whole. Half of the machine's memory when left out
    #[arg(long, value_name = "BYTES", value_parser = bytes)]
    max_file: Option<u64>,
    /// Print nothing but errors
    #[arg(long, short)]
    quiet: bool,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum Numbers {
    /// As text
    Ascii,
    /// As bytes, the least first
    Little,
    /// As bytes, the greatest first
    Big,
}

impl From<Numbers> for Encoding {
    fn from(numbers: Numbers) -> Encoding {
        match numbers {
            Numbers::Ascii => Encoding::Ascii,
            Numbers::Little => Encoding::LittleEndian,
            Numbers::Big => Encoding::BigEndian,
        }
    }
}

pub(super) fn run(arguments: &Arguments) -> Result<(), Failure> {
    let (is_ply, is_glb) = (ends_in(&arguments.output, "ply"), ends_in(&arguments.output, "glb"));
    if !is_ply && !is_glb {
        let shown = quoted_path(&arguments.output);
        let message =
            format!("`{shown}` does not end in .ply or .glb; these are the formats written");
        return Err(Failure::usage(message));
    }
    own_files::check([Path::new(&arguments.scene)], [arguments.output.as_path()])?;
    // A .ply has no place for textures.
    let options = SceneOptions {
        textures: is_glb,
        // Files for others keep instances.
        bake: false,
        file_limit: arguments.max_file,
        ..SceneOptions::default()
    };
    let scene = match InstancedScene::is_named_by(&arguments.scene) {
        true => InstancedScene::open_with(&arguments.scene, &options)?,
        false => Scene::open_with(&arguments.scene, &options)?.into(),
    };
    if !arguments.quiet {
        for sentence in scene.parts.notes.sentences() {
            output::note(&format!("note: {}: {sentence}", quoted(&scene.name)));
        }
    }
    let solids = scene.geometries.iter().filter(|own| own.solids.is_some()).count();
    if solids > 0 && !arguments.quiet {
        let name = quoted(&scene.name);
        output::note(&format!(
            "note: {name}: {solids} geometries of spheres or capsules are left out"
        ));
    }
    let failed = |problem: MeshFileProblem| {
        let shown = quoted_path(&arguments.output);
        Failure::limit(format!("cannot write `{shown}`: {problem}"))
    };
    let bytes = if is_glb {
        gltf::to_glb(&scene).map_err(failed)?
    } else {
        let limit = splitplane_scene::from_file::usual_limit();
        // What is one mesh keeps its vertices as they are.
        let mesh = match scene.instances.len() {
            1 if !InstancedScene::is_named_by(&arguments.scene) => scene.parts,
            _ => scene.flatten(limit).map_err(failed)?,
        };
        ply::to_bytes(&mesh, arguments.numbers.into()).map_err(|_| {
            let shown = quoted_path(&arguments.output);
            Failure::limit(format!("cannot write `{shown}`: there is not memory enough for it"))
        })?
    };
    files::write(&arguments.output, &bytes)?;
    match arguments.quiet {
        true => Ok(()),
        false => output::data(&format!("written  {}\n", arguments.output.display())),
    }
}
