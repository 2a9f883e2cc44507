//! The scene on a GPU of the browser: its tree, and pictures. Every call gives a promise.

use std::rc::Rc;

use js_sys::{Float64Array, Function, Promise};
use splitplane::BuildOptions;
use splitplane::tracer::Tracer;
use wasm_bindgen::prelude::*;
use wasm_bindgen_futures::future_to_promise;

use super::picture::{self, Wanted};
use super::{Page, judge};
use crate::failure::Failure;
use crate::gpu::Gpu;
use crate::named::build_options;
use crate::progress::Called;

fn busy() -> Failure {
    Failure::new("stale", "the scene has no tree on the GPU, or work there is under way")
}

#[wasm_bindgen]
impl Page {
    /// Builds the tree on a GPU: a promise of its digest.
    #[wasm_bindgen(js_name = buildOnGpu)]
    pub fn build_on_gpu(
        &self,
        gpu: &Gpu,
        preset: &str,
        called: Option<Function>,
    ) -> Result<Promise, JsValue> {
        let options = build_options(preset, "fast", None)?;
        let (scene, place) = (Rc::clone(&self.scene), Rc::clone(&self.on_gpu));
        let backend = gpu.backend().clone();
        let old = place.take();
        Ok(future_to_promise(async move {
            let mesh = scene.mesh().map_err(Failure::from)?;
            let called = called.map(Called::new);
            let watch = called.as_ref().map(Called::watch);
            let options = BuildOptions { watch, ..options };
            drop(old);
            let tracer = Tracer::load_async(backend, &mesh, &scene.appearance(), &options).await;
            let tracer = tracer.map_err(Failure::from)?;
            let digest = tracer.digest().map_err(Failure::from)?.to_string();
            place.replace(Some(tracer));
            Ok(digest.into())
        }))
    }

    /// Lets the scene on the GPU go.
    #[wasm_bindgen(js_name = leaveGpu)]
    pub fn leave_gpu(&self) {
        self.on_gpu.take();
    }

    /// As `frame`, on the GPU: a promise of a `Told`. Of exact pictures the CPU answers what the GPU leaves undecided, between waves. Light by photons
    /// and paths is the CPU's.
    #[wasm_bindgen(js_name = frameOnGpu)]
    pub fn frame_on_gpu(&mut self, numbers: &[u32]) -> Result<Promise, JsValue> {
        let wanted = Wanted::of(numbers)?;
        let settings = wanted.settings(self.settings);
        let (_, _, orbit) = self.ready()?;
        let request = wanted.request(settings, orbit.camera());
        let mut tracer = self.on_gpu.take().ok_or_else(busy)?;
        let scene = Rc::clone(&self.scene);
        let (place, pixels) = (Rc::clone(&self.on_gpu), Rc::clone(&self.pixels));
        Ok(future_to_promise(async move {
            let done = async {
                let mesh = scene.mesh().map_err(Failure::from)?;
                let looks = wanted.appearance(&scene);
                tracer.update_appearance(&mesh, &looks).map_err(Failure::from)?;
                let frame = tracer.frame_async(&mesh, &request).await.map_err(Failure::from)?;
                picture::take(&frame, &wanted, &pixels)
            };
            let done: Result<picture::Told, Failure> = done.await;
            place.replace(Some(tracer));
            Ok(done?.into())
        }))
    }

    /// As `judge`, of watertight first rays on the GPU against those of the CPU: a promise of the numbers of rays and of those whose words differ.
    #[wasm_bindgen(js_name = compareWithGpu)]
    pub fn compare_with_gpu(&mut self, width: u32, height: u32) -> Result<Promise, JsValue> {
        let size = picture::size(width, height)?;
        let settings = self.settings;
        let (scene, tracer, orbit) = self.ready()?;
        let request = judge::request(settings, orbit.camera(), size, judge::WATERTIGHT)?;
        let mesh = scene.mesh().map_err(Failure::from)?;
        let frame = tracer.frame(&mesh, &request).map_err(Failure::from)?;
        let own = frame.first_hits().map_err(Failure::from)?.into_owned();
        let mut tracer = self.on_gpu.take().ok_or_else(busy)?;
        let (scene, place) = (Rc::clone(&self.scene), Rc::clone(&self.on_gpu));
        Ok(future_to_promise(async move {
            let done = async {
                let mesh = scene.mesh().map_err(Failure::from)?;
                let frame = tracer.frame_async(&mesh, &request).await.map_err(Failure::from)?;
                let found = frame.first_hits().map_err(Failure::from)?;
                Ok::<f64, Failure>(judge::differences(&found, &own))
            };
            let done: Result<f64, Failure> = done.await;
            place.replace(Some(tracer));
            Ok(Float64Array::from(&[own.len() as f64, done?][..]).into())
        }))
    }
}
