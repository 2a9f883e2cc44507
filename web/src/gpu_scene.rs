//! A scene of many objects on a browser's GPU. What waits for the device gives a promise.

use std::cell::RefCell;
use std::rc::Rc;

use js_sys::{Function, Promise};
use splitplane::objects::{
    GeometryId, Instance, InstanceId, Scene as Description, SceneAccelerator, SceneHit,
    SceneOptions,
};
use splitplane::{Accuracy, BuildOptions, Ray};
use splitplane_wgpu::WgpuBackend;
use splitplane_wgpu::query::WgpuScene;
use wasm_bindgen::prelude::*;
use wasm_bindgen_futures::future_to_promise;

use crate::edits::Edits;
use crate::failure::Failure;
use crate::mesh::mesh;
use crate::named::{build_options, culling, scene_options, transform};
use crate::progress::Called;
use crate::words::{Words, zeros};

/// A scene of instances of meshes, on a device.
#[wasm_bindgen]
pub struct GpuScene {
    backend: Rc<WgpuBackend>,
    /// Taken while an update is under way.
    state: Rc<RefCell<Option<State>>>,
}

struct State {
    description: Description,
    /// Shared with batches that are under way.
    built: Option<Rc<WgpuScene>>,
    edits: Edits,
}

fn updating() -> Failure {
    Failure::new("busy", "an update of the scene is under way; await it")
}

impl GpuScene {
    pub(crate) fn new(backend: Rc<WgpuBackend>) -> GpuScene {
        let state = State { description: Description::new(), built: None, edits: Edits::Waiting };
        GpuScene { backend, state: Rc::new(RefCell::new(Some(state))) }
    }

    /// Changes the description.
    fn edit<T, E: Into<Failure>>(
        &self,
        edit: impl FnOnce(&mut Description) -> Result<T, E>,
    ) -> Result<T, Failure> {
        let mut state = self.state.borrow_mut();
        let state = state.as_mut().ok_or_else(updating)?;
        let done = edit(&mut state.description).map_err(Into::into)?;
        state.edits = Edits::Waiting;
        Ok(done)
    }

    /// What is built. Edits after it have to have been tried: where their update failed, it answers without them.
    fn built(&self) -> Result<Rc<WgpuScene>, Failure> {
        let state = self.state.borrow();
        let state = state.as_ref().ok_or_else(updating)?;
        let built = state.built.as_ref().filter(|_| state.edits != Edits::Waiting);
        let text = "the scene was edited since it was built; await updateAsync()";
        built.map(Rc::clone).ok_or_else(|| Failure::new("stale", text))
    }

    /// The same, where it answers such a batch on the device.
    fn answering(&self, options: &SceneOptions<'_>) -> Result<Rc<WgpuScene>, Failure> {
        let built = self.built()?;
        if options.accuracy != Accuracy::Watertight {
            let text = "scenes on a GPU answer accuracy watertight alone; take a Scene for others";
            return Err(Failure::new("config", text));
        }
        match built.needs_cpu(options) {
            Some(reason) => {
                Err(Failure::new("device", format!("the GPU cannot answer for it: {reason}")))
            }
            None => Ok(built),
        }
    }
}

#[wasm_bindgen]
impl GpuScene {
    /// Adds a mesh; its name.
    #[wasm_bindgen(js_name = addGeometry)]
    pub fn add_geometry(
        &self,
        positions: &Words,
        indices: &Words,
        is_indexed: bool,
    ) -> Result<u32, JsValue> {
        let mesh = mesh(positions, indices, is_indexed)?;
        Ok(self.edit(|scene| scene.add_mesh(&mesh))?.0)
    }

    /// Removes a mesh that has no instances.
    #[wasm_bindgen(js_name = removeGeometry)]
    pub fn remove_geometry(&self, geometry: u32) -> Result<(), JsValue> {
        self.edit(|scene| scene.remove_geometry(GeometryId(geometry)).map(drop))?;
        Ok(())
    }

    /// Adds an instance; its name.
    #[wasm_bindgen(js_name = addInstance)]
    pub fn add_instance(
        &self,
        geometry: u32,
        matrix: &[f32],
        mask: u32,
        side: u32,
    ) -> Result<u32, JsValue> {
        let (culling, transform) = (culling(side)?, transform(matrix)?);
        let own = Instance { mask, culling, ..Instance::new(GeometryId(geometry), transform) };
        Ok(self.edit(|scene| scene.add_instance(own))?.0)
    }

    /// Moves an instance.
    #[wasm_bindgen(js_name = moveInstance)]
    pub fn move_instance(&self, instance: u32, matrix: &[f32]) -> Result<(), JsValue> {
        let (name, matrix) = (InstanceId(instance), transform(matrix)?);
        self.edit(|scene| scene.move_instance(name, matrix).map(drop))?;
        Ok(())
    }

    /// Removes an instance.
    #[wasm_bindgen(js_name = removeInstance)]
    pub fn remove_instance(&self, instance: u32) -> Result<(), JsValue> {
        self.edit(|scene| scene.remove_instance(InstanceId(instance)).map(drop))?;
        Ok(())
    }

    /// Builds what changed: a promise of nothing.
    pub fn update(
        &self,
        preset: &str,
        max_memory: Option<f64>,
        called: Option<Function>,
    ) -> Result<Promise, JsValue> {
        let options = build_options(preset, "fast", max_memory)?;
        let place = Rc::clone(&self.state);
        let backend = Rc::clone(&self.backend);
        let mut state = place.take().ok_or_else(updating)?;
        if state.built.as_mut().is_some_and(|built| Rc::get_mut(built).is_none()) {
            place.replace(Some(state));
            let text = "rays with the scene are under way; await them before an update";
            return Err(Failure::new("busy", text).into());
        }
        Ok(future_to_promise(async move {
            let called = called.map(Called::new);
            let watch = called.as_ref().map(Called::watch);
            let options = BuildOptions { watch, ..options };
            let own = state.built.as_mut().and_then(Rc::get_mut);
            let done = match own {
                Some(built) => {
                    backend.update_scene_async(built, &state.description, &options).await.map(drop)
                }
                None => {
                    let built = backend.build_scene_async(&state.description, &options).await;
                    built.map(|built| state.built = Some(Rc::new(built)))
                }
            };
            // A device that refuses what it is sent when all is built has no scene until the next update.
            let answers = state.built.as_ref().is_some_and(|built| {
                done.is_ok() || built.needs_cpu(&SceneOptions::default()).is_none()
            });
            state.edits = match answers {
                true => state.edits.after_update(done.is_ok()),
                false => Edits::Waiting,
            };
            place.replace(Some(state));
            done.map_err(Failure::from).map_err(|failure| match answers {
                true => failure.of_update(),
                false => failure,
            })?;
            Ok(JsValue::UNDEFINED)
        }))
    }

    /// The digest of the built scene, 16 hexadecimal digits.
    pub fn digest(&self) -> Result<String, JsValue> {
        Ok(self.built()?.scene().digest().to_string())
    }

    /// The closest hits of rays of 8 words: a promise of words, 6 a ray: t, u, v, triangle, geometry, instance.
    #[wasm_bindgen(js_name = closestHits)]
    pub fn closest_hits(
        &self,
        rays: Words,
        numbers: &[u32],
        called: Option<Function>,
    ) -> Result<Promise, JsValue> {
        let options = scene_options(numbers)?;
        let built = self.answering(&options)?;
        Ok(future_to_promise(async move {
            let rays: &[Ray] = rays.part("rays", 0, (rays.length() / 8) as u32)?;
            let mut hits: Vec<[u32; 6]> = zeros(rays.len())?;
            let called = called.map(Called::new);
            let watch = called.as_ref().map(Called::watch);
            let options = SceneOptions { watch, ..options };
            let found: &mut [SceneHit] = bytemuck::cast_slice_mut(&mut hits);
            built.closest_hits_async(rays, found, &options).await.map_err(Failure::from)?;
            Ok(Words::of(bytemuck::allocation::cast_vec(hits)).into())
        }))
    }

    /// Whether rays hit anything: a promise of words that hold a byte a ray.
    #[wasm_bindgen(js_name = anyHits)]
    pub fn any_hits(
        &self,
        rays: Words,
        numbers: &[u32],
        called: Option<Function>,
    ) -> Result<Promise, JsValue> {
        let options = scene_options(numbers)?;
        let built = self.answering(&options)?;
        Ok(future_to_promise(async move {
            let rays: &[Ray] = rays.part("rays", 0, (rays.length() / 8) as u32)?;
            let mut found: Vec<bool> = zeros(rays.len())?;
            let called = called.map(Called::new);
            let watch = called.as_ref().map(Called::watch);
            let options = SceneOptions { watch, ..options };
            built.any_hits_async(rays, &mut found, &options).await.map_err(Failure::from)?;
            let mut words: Vec<u32> = zeros(rays.len().div_ceil(4))?;
            let bytes: &mut [u8] = bytemuck::cast_slice_mut(&mut words);
            for (byte, found) in bytes.iter_mut().zip(found) {
                *byte = u8::from(found);
            }
            Ok(Words::of(words).into())
        }))
    }
}
