//! A scene of many objects with what answers its rays, and nothing that shows it: for verbs that ask, check and save.

use super::failure::Failure;
use super::options::Common;
use super::prepared::{counted, milliseconds};
use super::{output, progress};
use serde::Serialize;
use splitplane::objects::file::SceneFile;
use splitplane::objects::{BakedTable, SceneAccelerator};
use splitplane::scene::InstancedScene;
use splitplane::scene::instanced::is_saved;
use splitplane::{BackendInfo, BuildOptions, LoadOptions};
use splitplane_scene::from_file::{self, quoted, quoted_path};
use std::ffi::OsStr;
use std::path::Path;
use std::time::Instant;

/// A scene of many objects that is built or loaded.
pub(super) struct BuiltObjects {
    pub(super) accelerator: Box<dyn SceneAccelerator>,
    /// What triangles were in the scene's file.
    pub(super) table: BakedTable,
    name: String,
    info: BackendInfo,
    reason: String,
    preset: &'static str,
    build_ms: f64,
    /// Whether its trees come from a file.
    loaded: bool,
}

impl BuiltObjects {
    /// Opens scene and backend and builds what answers rays; trees in a file of a built scene are loaded. To be called inside
    /// [`in_pool`](super::prepared::in_pool).
    pub(super) fn open(spec: &OsStr, common: &Common) -> Result<BuiltObjects, Failure> {
        // What is asked for and cannot be had is said before a large file is read.
        let options = common.build_options()?;
        let opened = common.open()?;
        let info = opened.backend.describe();
        let loaded = is_saved(spec);
        let spinner = progress::spinner(common.quiet, "reading the scene");
        let (name, scene, bytes) = if loaded {
            let path = Path::new(spec);
            let name = path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned();
            (name, None, read(path, common)?)
        } else {
            let scene = InstancedScene::open_with(spec, &common.bare_scene())?;
            (scene.name.clone(), Some(scene), Vec::new())
        };
        spinner.finish_and_clear();
        if !common.quiet {
            if let Some(scene) = &scene {
                for sentence in scene.parts.notes.sentences() {
                    output::note(&format!("note: {}: {sentence}", quoted(&scene.name)));
                }
            }
            output::note(&format!("backend: {} ({})", info.name, opened.reason));
        }
        let watch = progress::watch(common.quiet);
        let start = Instant::now();
        let accelerator = match &scene {
            Some(scene) => {
                let options = BuildOptions { watch: Some(&watch), ..options };
                opened.backend.build_scene(&scene.describe()?, &options)?
            }
            None => {
                let options = LoadOptions { watch: Some(&watch), ..options.for_loading() };
                let fail = |error: &dyn std::fmt::Display| {
                    Failure::file(format!("`{}`: {error}", quoted_path(spec)))
                };
                let file = SceneFile::parse(&bytes).map_err(|error| fail(&error))?;
                opened.backend.load_scene(&file, &options)?.1
            }
        };
        let build_ms = milliseconds(start);
        drop(watch);
        if let Some(reason) = accelerator.placed_by_cpu().filter(|_| !common.quiet) {
            output::note(&format!("note: the CPU finds the instances that rays enter: {reason}"));
        }
        let (preset, reason) = (options.config.preset().name(), opened.reason);
        let table = scene.map(|scene| scene.baked.table).unwrap_or_default();
        Ok(BuiltObjects { accelerator, table, name, info, reason, preset, build_ms, loaded })
    }

    pub(super) fn report(&self) -> ObjectsReport {
        let built = self.accelerator.scene();
        let sizes = |name| {
            built.geometry(name).map_or([0, 0], |own| match own.shapes() {
                Some(shapes) => [0, shapes.shapes().len() as u64],
                None => [own.mesh().mesh().len() as u64, 0],
            })
        };
        let sum = |all: &mut dyn Iterator<Item = [u64; 2]>| {
            all.fold([0; 2], |[a, b], [c, d]| [a + c, b + d])
        };
        let [triangles, shapes] = sum(&mut built.geometries().map(|(name, _)| sizes(name)));
        let placed = built.placements().map(|(_, placement)| sizes(placement.instance.geometry));
        let [instanced_triangles, instanced_shapes] = sum(&mut { placed });
        ObjectsReport {
            scene: self.name.clone(),
            geometries: built.geometries().count(),
            triangles,
            shapes,
            instances: built.placements().count(),
            instanced_triangles,
            instanced_shapes,
            backend: self.info.name.clone(),
            adapter: self.info.adapter.clone(),
            preset: (!self.loaded).then_some(self.preset),
            threads: self.info.threads,
            build_ms: self.build_ms,
            bytes: built.bytes(),
            digest: built.digest().to_string(),
        }
    }

    /// The scene in a few readable lines.
    pub(super) fn describe(&self) -> String {
        let report = self.report();
        let by = match (&report.adapter, report.threads) {
            (Some(adapter), _) => adapter.clone(),
            (None, Some(threads)) => counted(threads as u64, "thread"),
            (None, None) => self.info.detail.clone(),
        };
        let shapes = match report.shapes {
            0 => String::new(),
            some => format!(" and {some} shapes that are {}", report.instanced_shapes),
        };
        let how = match report.preset {
            Some(preset) => format!("built    in {:.1} ms by preset {preset}", report.build_ms),
            None => format!("loaded   in {:.1} ms", report.build_ms),
        };
        format!(
            "scene    {}: {} instances of {} geometries, {} triangles that are {}{shapes} in the world\n\
             backend  {} ({by}; {})\n{how}, {} bytes, digest {}\n",
            quoted(&report.scene),
            report.instances,
            report.geometries,
            report.triangles,
            report.instanced_triangles,
            report.backend,
            self.reason,
            report.bytes,
            report.digest
        )
    }
}

/// The bytes of a file.
fn read(path: &Path, common: &Common) -> Result<Vec<u8>, Failure> {
    let limit = common.max_file.unwrap_or_else(from_file::usual_limit);
    from_file::read(path, limit).map_err(|error| {
        let message = format!("cannot read the scene `{}`: {error}", quoted_path(path));
        match error.is_limit() {
            true => Failure::limit(message + "; --max-file allows more"),
            false => Failure::file(message),
        }
    })
}

/// What `--json` says about a scene of many objects.
#[derive(Serialize)]
pub(super) struct ObjectsReport {
    scene: String,
    geometries: usize,
    /// Triangles of all geometries.
    triangles: u64,
    /// Spheres and capsules of all geometries.
    shapes: u64,
    instances: usize,
    /// Triangles of all instances, each counted as often as it is placed.
    instanced_triangles: u64,
    instanced_shapes: u64,
    backend: String,
    adapter: Option<String>,
    /// Null where trees come from a file.
    preset: Option<&'static str>,
    threads: Option<usize>,
    build_ms: f64,
    bytes: u64,
    pub(super) digest: String,
}
