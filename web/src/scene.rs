//! A scene of many objects: its description, and what is built of it.

use js_sys::Function;
use splitplane::objects::{
    GeometryId, Instance, InstanceId, Scene as Description, SceneAccelerator, SceneHit,
};
use splitplane::{Backend, BuildOptions, CpuBackend, Ray};
use wasm_bindgen::prelude::*;

use crate::edits::Edits;
use crate::failure::Failure;
use crate::mesh::mesh;
use crate::named::{build_options, culling, scene_options, transform};
use crate::progress::watched;
use crate::words::{Words, zeros};

/// A scene of instances of meshes.
#[wasm_bindgen]
pub struct Scene {
    description: Description,
    built: Box<dyn SceneAccelerator>,
    edits: Edits,
}

impl Scene {
    /// What is built. Edits after it have to have been tried: where their update failed, it answers without them.
    fn current(&self) -> Result<&dyn SceneAccelerator, Failure> {
        match self.edits {
            Edits::Waiting => {
                Err(Failure::new("stale", "the scene was edited since it was built; call update()"))
            }
            Edits::Taken | Edits::Refused => Ok(&*self.built),
        }
    }
}

#[wasm_bindgen]
impl Scene {
    /// A scene without anything.
    #[wasm_bindgen(constructor)]
    pub fn new() -> Result<Scene, JsValue> {
        let description = Description::new();
        let built = CpuBackend::new().build_scene(&description, &BuildOptions::default());
        Ok(Scene { description, built: built.map_err(Failure::from)?, edits: Edits::Taken })
    }

    /// Adds a mesh; its name.
    #[wasm_bindgen(js_name = addGeometry)]
    pub fn add_geometry(
        &mut self,
        positions: &Words,
        indices: &Words,
        is_indexed: bool,
    ) -> Result<u32, JsValue> {
        let mesh = mesh(positions, indices, is_indexed)?;
        let name = self.description.add_mesh(&mesh).map_err(Failure::from)?;
        self.edits = Edits::Waiting;
        Ok(name.0)
    }

    /// Removes a mesh that has no instances.
    #[wasm_bindgen(js_name = removeGeometry)]
    pub fn remove_geometry(&mut self, geometry: u32) -> Result<(), JsValue> {
        self.description.remove_geometry(GeometryId(geometry)).map_err(Failure::from)?;
        self.edits = Edits::Waiting;
        Ok(())
    }

    /// Adds an instance; its name.
    #[wasm_bindgen(js_name = addInstance)]
    pub fn add_instance(
        &mut self,
        geometry: u32,
        matrix: &[f32],
        mask: u32,
        side: u32,
    ) -> Result<u32, JsValue> {
        let instance = Instance {
            mask,
            culling: culling(side)?,
            ..Instance::new(GeometryId(geometry), transform(matrix)?)
        };
        let name = self.description.add_instance(instance).map_err(Failure::from)?;
        self.edits = Edits::Waiting;
        Ok(name.0)
    }

    /// Moves an instance.
    #[wasm_bindgen(js_name = moveInstance)]
    pub fn move_instance(&mut self, instance: u32, matrix: &[f32]) -> Result<(), JsValue> {
        let (name, matrix) = (InstanceId(instance), transform(matrix)?);
        self.description.move_instance(name, matrix).map_err(Failure::from)?;
        self.edits = Edits::Waiting;
        Ok(())
    }

    /// Removes an instance.
    #[wasm_bindgen(js_name = removeInstance)]
    pub fn remove_instance(&mut self, instance: u32) -> Result<(), JsValue> {
        self.description.remove_instance(InstanceId(instance)).map_err(Failure::from)?;
        self.edits = Edits::Waiting;
        Ok(())
    }

    /// Builds what changed.
    pub fn update(
        &mut self,
        preset: &str,
        layout: &str,
        max_memory: Option<f64>,
        called: Option<Function>,
    ) -> Result<(), JsValue> {
        let options = build_options(preset, layout, max_memory)?;
        let (built, description) = (&mut *self.built, &self.description);
        let done = watched(called, |watch| {
            let options = BuildOptions { watch, ..options };
            CpuBackend::new().update_scene(built, description, &options)
        });
        self.edits = self.edits.after_update(done.is_ok());
        done.map_err(|error| Failure::from(error).of_update())?;
        Ok(())
    }

    /// The digest of the built scene, 16 hexadecimal digits.
    pub fn digest(&self) -> Result<String, JsValue> {
        Ok(self.current()?.scene().digest().to_string())
    }

    /// The closest hits of some rays of 8 words, into hits of 6 words: t, u, v, triangle, geometry, instance.
    #[wasm_bindgen(js_name = closestHits)]
    pub fn closest_hits(
        &self,
        rays: &Words,
        hits: &mut Words,
        first: u32,
        count: u32,
        options: &[u32],
    ) -> Result<(), JsValue> {
        let options = scene_options(options)?;
        let rays: &[Ray] = rays.part("rays", first, count)?;
        let hits: &mut [SceneHit] = hits.part_mut("hits", first, count)?;
        self.current()?.closest_hits(rays, hits, &options).map_err(Failure::from)?;
        Ok(())
    }

    /// Whether some rays hit anything: a byte each.
    #[wasm_bindgen(js_name = anyHits)]
    pub fn any_hits(
        &self,
        rays: &Words,
        occluded: &mut Words,
        first: u32,
        count: u32,
        options: &[u32],
    ) -> Result<(), JsValue> {
        let options = scene_options(options)?;
        let rays: &[Ray] = rays.part("rays", first, count)?;
        let bytes: &mut [u8] = occluded.part_mut("occluded", first, count)?;
        let mut answers: Vec<bool> = zeros(rays.len())?;
        self.current()?.any_hits(rays, &mut answers, &options).map_err(Failure::from)?;
        for (byte, answer) in bytes.iter_mut().zip(answers) {
            *byte = u8::from(answer);
        }
        Ok(())
    }
}
