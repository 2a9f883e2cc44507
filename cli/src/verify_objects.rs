//! `splitplane verify` of scenes of many objects.

use super::failure::Failure;
use super::objects_built::BuiltObjects;
use super::options::Common;
use super::prepared::{counted, print_json};
use super::tree::check_tree;
use super::{output, progress};
use serde::Serialize;
use splitplane::objects::SceneOptions;
use splitplane::verify::{Aim, check, check_objects, rays_of};
use std::ffi::OsStr;

#[derive(Serialize)]
struct Report {
    /// Geometries whose trees are sound.
    sound: u64,
    /// Rays through single geometries, compared with a reference in `f64`.
    geometry_rays: u64,
    unexplained: u64,
    /// Rays through the scene, compared with all instances asked one after the other.
    rays: u64,
    hits: u64,
    different: u64,
}

/// Checks each geometry, then the scene. To be called inside a pool.
pub(super) fn run(scene: &OsStr, rays: u64, common: &Common) -> Result<(), Failure> {
    let objects = BuiltObjects::open(scene, common)?;
    let built = objects.accelerator.scene();
    let meshes: Vec<_> = built.geometries().filter(|(_, own)| own.shapes().is_none()).collect();
    let each = rays.div_ceil(meshes.len().max(1) as u64);
    let through = rays_of(rays, built.placements().count());
    let total = each * (Aim::ALL.len() * meshes.len()) as u64 + through;
    let bar = progress::bar(common.quiet, "checking", total);
    let (mut sound, mut geometry_rays, mut unexplained) = (0, 0, 0);
    let mut wrong: Option<String> = None;
    let options = common.query_options();
    for (name, own) in meshes {
        let mesh = own.mesh().mesh();
        match check_tree(own.accelerator(), &mesh) {
            Ok(()) => sound += 1,
            Err(problem) => {
                wrong.get_or_insert(format!("geometry {}: the tree is damaged: {problem}", name.0));
            }
        }
        let found = check(own.accelerator(), &mesh, each, &options, &|rays| bar.inc(rays))?;
        geometry_rays += found.rays;
        unexplained += found.unexplained;
        if let Some(first) = found.first {
            wrong.get_or_insert(format!("geometry {}: {first}", name.0));
        }
    }
    let options = SceneOptions { accuracy: options.accuracy, ..SceneOptions::default() };
    let found = check_objects(&*objects.accelerator, rays, &options, &|rays| bar.inc(rays))?;
    bar.finish_and_clear();
    if let Some(first) = found.first {
        wrong.get_or_insert(first);
    }
    if common.json {
        let (rays, hits, different) = (found.rays, found.hits, found.different);
        print_json(&Report { sound, geometry_rays, unexplained, rays, hits, different })?;
    } else if !common.quiet {
        output::data(&format!(
            "{}checked  the trees of {} are sound\n\
             checked  {} through single geometries, accuracy {}: {unexplained} beyond the error bound\n\
             checked  {} through the scene, {} of them hit: {} differ from all instances one after the other\n",
            objects.describe(),
            match sound {
                1 => "1 geometry".to_owned(),
                more => format!("{more} geometries"),
            },
            counted(geometry_rays, "ray"),
            common.accuracy_name(),
            counted(found.rays, "ray"),
            found.hits,
            found.different
        ))?;
    }
    match wrong {
        None => Ok(()),
        Some(wrong) => Err(Failure::failed_check(wrong)),
    }
}
