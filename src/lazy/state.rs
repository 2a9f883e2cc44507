//! What of a scene is built, and what is not.

use super::reach::Reach;
use splitplane_core::backend::scene::{SceneAccelerator, SharedGeometry};
use splitplane_core::backend::{Backend, BuildOptions};
use splitplane_core::mesh::Mesh;
use splitplane_core::scene::{
    GeometryId, Instance, InstanceId, Scene, SceneBuildError, SceneError,
};
use std::collections::BTreeMap;
use std::sync::Arc;

/// What is built, and what is not. It does not change; another one takes its place.
pub(super) struct State {
    /// Over the description in which what is not built is empty.
    pub(super) accelerator: Box<dyn SceneAccelerator>,
    /// By geometry, what answers its rays; `None` for shapes, and for what is not built.
    pub(super) trees: Vec<Option<SharedGeometry>>,
    /// By geometry: whether it is not built.
    pub(super) waiting: Vec<bool>,
    pub(super) reach: Reach,
    /// Geometries that were built, the empty ones not counted.
    pub(super) builds: u64,
}

impl State {
    /// A state in which all is built that does not wait: by what there is of `trees`, and anew for the rest.
    pub(super) fn new(
        backend: &dyn Backend,
        (scene, nothing): (&Scene, &Scene),
        (waiting, mut trees): (Vec<bool>, Vec<Option<SharedGeometry>>),
        builds: u64,
        options: &BuildOptions<'_>,
    ) -> Result<State, SceneBuildError> {
        let waits = |name: GeometryId| waiting.get(name.0 as usize) == Some(&true);
        let present = description(scene, nothing, waits)?;
        let reach = Reach::of(scene, waits)?;
        let mut accelerator = backend.build_scene(&Scene::new(), &options.unwatched())?;
        share_trees(&present, &mut trees);
        let asked = accelerator.scene().unbuilt(&present)?;
        let meshes: Vec<_> = asked.map(|(name, own)| (name, Arc::clone(own))).collect();
        let mut meshes = meshes.into_iter();
        accelerator.update_by(&present, options, &mut |mesh, options| {
            let asked = meshes.next().filter(|(name, _)| !waits(*name));
            let place = asked.and_then(|(name, own)| Some((trees.get_mut(name.0 as usize)?, own)));
            let Some((kept, own)) = place else {
                return backend.build(mesh, options);
            };
            let shared = match kept {
                Some(shared) => shared,
                None => kept.insert(SharedGeometry::new(own, backend.build(mesh, options)?)),
            };
            Ok(Box::new(shared.clone()))
        })?;
        share_trees(&present, &mut trees);
        Ok(State { accelerator, trees, waiting, reach, builds })
    }

    /// Of each geometry of the description whether it waits.
    pub(super) fn waiting_of<'a>(&'a self, scene: &'a Scene) -> impl Iterator<Item = bool> + 'a {
        let waits = |name: GeometryId| self.waiting.get(name.0 as usize) == Some(&true);
        scene.geometries().map(move |(name, _)| waits(name))
    }
}

/// Gives geometries that have the arrays of a built one its tree.
fn share_trees(present: &Scene, trees: &mut [Option<SharedGeometry>]) {
    let built: BTreeMap<_, SharedGeometry> =
        trees.iter().flatten().map(|own| (Arc::as_ptr(own.mesh()), own.clone())).collect();
    for (name, mesh) in present.geometries() {
        if let Some(own @ None) = trees.get_mut(name.0 as usize) {
            *own = built.get(&Arc::as_ptr(mesh)).cloned();
        }
    }
}

/// A description with the same names, which shares arrays with `scene`; geometries that `is_left_out` names are the first of `nothing`.
pub(super) fn description(
    scene: &Scene,
    nothing: &Scene,
    is_left_out: impl Fn(GeometryId) -> bool,
) -> Result<Scene, SceneError> {
    let mut own = Scene::new();
    let empty: [[[f32; 3]; 3]; 0] = [];
    let mesh = Mesh::soup(&empty).map_err(|_| SceneError::OutOfMemory { bytes: 0 })?;
    // Names are given in order; what is not there is taken out again.
    for name in (0..scene.geometry_names() as u32).map(GeometryId) {
        own.add_mesh(&mesh)?;
        if scene.geometry(name).is_ok() {
            match is_left_out(name) {
                true => own.share_geometry(name, nothing, GeometryId(0))?,
                false => own.share_geometry(name, scene, name)?,
            }
        }
    }
    let free = |name: &InstanceId| scene.instance(*name).is_err();
    let names = || (0..scene.instance_names() as u32).map(InstanceId);
    for name in names() {
        let stand_in = || Instance::in_place(GeometryId(0));
        own.add_instance(scene.instance(name).map_or_else(|_| stand_in(), |there| *there))?;
    }
    for name in names().filter(free) {
        own.remove_instance(name)?;
    }
    for name in (0..scene.geometry_names() as u32).map(GeometryId) {
        if scene.geometry(name).is_err() {
            own.remove_geometry(name)?;
        }
    }
    Ok(own)
}
