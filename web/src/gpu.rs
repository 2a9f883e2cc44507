//! A browser's GPU: opened, tested, and asked without waiting. Every call gives a promise.
//!
//! Arrays that are handed over are this module's from then on, so that nothing changes them while the device works.

use std::cell::RefCell;
use std::rc::Rc;
use std::time::Duration;

use js_sys::{Function, Promise, Uint8Array};
use splitplane::{Accelerator, AllHitsOptions, BuildOptions, Hit, QueryOptions, Ray};
use splitplane_wgpu::{OpenOptions, Parity, WgpuAccelerator, WgpuBackend};
use wasm_bindgen::prelude::*;
use wasm_bindgen_futures::future_to_promise;

use crate::crossings::Crossings;
use crate::failure::Failure;
use crate::gpu_scene::GpuScene;
use crate::mesh::{file_of, mesh};
use crate::named::{build_options, query_options};
use crate::progress::Called;
use crate::words::{Words, zeros};

thread_local! {
    /// Told when the module ends: promises of work under way would never be settled.
    static AFTER: RefCell<Option<Function>> = const { RefCell::new(None) };
}

/// Has this function called, with a text, when the module ends by a panic.
pub(crate) fn after_crash(called: Function) {
    AFTER.set(Some(called));
}

/// Tells that the module ends.
pub(crate) fn crashed(text: &str) {
    if let Some(called) = AFTER.take() {
        // What it throws has nowhere to go.
        let _ = called.call1(&JsValue::NULL, &text.into());
    }
}

/// A device of the browser.
#[wasm_bindgen]
pub struct Gpu {
    backend: Rc<WgpuBackend>,
}

#[wasm_bindgen]
impl Gpu {
    /// Opens the device that the browser gives, and tests it: a promise of a [`Gpu`]. `seconds` is how long opening it, and later each wait
    /// for it, may take.
    pub fn open(seconds: Option<f64>, hardware: bool) -> Promise {
        future_to_promise(async move {
            let limit = seconds
                .map(|seconds| Duration::try_from_secs_f64(seconds).unwrap_or(Duration::MAX));
            let options =
                OpenOptions { timeout: limit, driver_time: limit, ..OpenOptions::default() };
            let adapters = splitplane_wgpu::Adapters::find_async().await;
            let adapter = adapters.select(None).map_err(Failure::from)?;
            if hardware && adapter.is_software() {
                let text = format!("`{}` is software", adapter.name());
                return Err(Failure::new("no-webgpu", text).into());
            }
            let gpu = adapter.open_async(&options).await.map_err(Failure::from)?;
            let backend = WgpuBackend::new_async(gpu).await.map_err(Failure::from)?;
            Ok(Gpu { backend: Rc::new(backend) }.into())
        })
    }

    /// What the browser calls the adapter; often not more than a vendor.
    pub fn adapter(&self) -> String {
        self.backend.gpu().info().name.clone()
    }

    /// Whether shaders run on the CPU.
    #[wasm_bindgen(js_name = isSoftware)]
    pub fn is_software(&self) -> bool {
        self.backend.gpu().is_software()
    }

    /// `bitwise` or `structural`: what the self-test found.
    pub fn parity(&self) -> String {
        self.backend.parity().map_or("", Parity::name).to_owned()
    }

    /// What the self-test found to differ.
    pub fn difference(&self) -> Option<String> {
        match self.backend.parity() {
            Some(Parity::Structural(difference)) => Some(difference.clone()),
            _ => None,
        }
    }

    /// Why the device is gone; nothing while it is there.
    pub fn lost(&self) -> Option<String> {
        self.backend.gpu().check().err().map(|error| error.to_string())
    }

    /// Gives the device back to the browser; trees on it answer no more.
    pub fn destroy(&self) {
        self.backend.gpu().device().destroy();
    }

    /// A scene without anything, for this device.
    pub fn scene(&self) -> GpuScene {
        GpuScene::new(Rc::clone(&self.backend))
    }

    /// Builds a tree: a promise of a [`GpuTree`].
    pub fn build(
        &self,
        positions: Words,
        indices: Words,
        is_indexed: bool,
        preset: &str,
        max_memory: Option<f64>,
        called: Option<Function>,
    ) -> Result<Promise, JsValue> {
        let options = build_options(preset, "fast", max_memory)?;
        let backend = Rc::clone(&self.backend);
        Ok(future_to_promise(async move {
            let mesh = mesh(&positions, &indices, is_indexed)?;
            let called = called.map(Called::new);
            let watch = called.as_ref().map(Called::watch);
            let options = BuildOptions { watch, ..options };
            let built = backend.build_accelerator_async(&mesh, &options).await;
            Ok(GpuTree { accelerator: Rc::new(built.map_err(Failure::from)?) }.into())
        }))
    }
}

#[cfg(feature = "page")]
impl Gpu {
    /// What trees are built by, and pictures made.
    pub(crate) fn backend(&self) -> &WgpuBackend {
        &self.backend
    }
}

/// A tree on the device, with a copy here.
#[wasm_bindgen]
pub struct GpuTree {
    accelerator: Rc<WgpuAccelerator>,
}

#[wasm_bindgen]
impl GpuTree {
    /// 16 hexadecimal digits.
    pub fn digest(&self) -> String {
        self.accelerator.tree().digest().to_string()
    }

    /// Triangles, dropped, snapped, most bytes of the build, bytes of queries, nodes, references.
    pub fn summary(&self) -> Vec<f64> {
        let (summary, tree) = (self.accelerator.summary(), self.accelerator.tree());
        let triangles = [summary.triangles, summary.dropped, summary.snapped];
        let bytes = [summary.peak_bytes, self.accelerator.query_bytes()];
        let sizes = [tree.nodes.len() as f64, tree.references.len() as f64];
        let counts = triangles.map(f64::from).into_iter().chain(bytes.map(|bytes| bytes as f64));
        counts.chain(sizes).collect()
    }

    /// The lower and the upper corner of the box of all triangles that are kept.
    pub fn bounds(&self) -> Vec<f32> {
        let bounds = self.accelerator.tree().bounds;
        [bounds.lo, bounds.hi].concat()
    }

    /// The bytes of a tree file.
    #[wasm_bindgen(js_name = toBytes)]
    pub fn to_bytes(
        &self,
        positions: &Words,
        indices: &Words,
        is_indexed: bool,
    ) -> Result<Uint8Array, JsValue> {
        let mesh = mesh(positions, indices, is_indexed)?;
        Ok(Uint8Array::from(&file_of(self.accelerator.tree(), &mesh)?[..]))
    }

    /// The closest hits of rays of 8 words: a promise of words, 4 a ray: t, triangle, u, v.
    #[wasm_bindgen(js_name = closestHits)]
    pub fn closest_hits(
        &self,
        rays: Words,
        accuracy: u32,
        culling: u32,
        ignore: u32,
        called: Option<Function>,
    ) -> Result<Promise, JsValue> {
        let options = query_options(accuracy, culling, ignore)?;
        let accelerator = Rc::clone(&self.accelerator);
        Ok(future_to_promise(async move {
            let rays: &[Ray] = rays.part("rays", 0, (rays.length() / 8) as u32)?;
            let mut hits: Vec<[u32; 4]> = zeros(rays.len())?;
            let called = called.map(Called::new);
            let watch = called.as_ref().map(Called::watch);
            let options = QueryOptions { watch, ..options };
            let found: &mut [Hit] = bytemuck::cast_slice_mut(&mut hits);
            accelerator.closest_hits_async(rays, found, &options).await.map_err(Failure::from)?;
            Ok(Words::of(bytemuck::allocation::cast_vec(hits)).into())
        }))
    }

    /// All crossings of rays of 8 words, in order, and exactly: a promise of [`Crossings`]. What the device leaves is decided here, in one piece.
    #[wasm_bindgen(js_name = allHits)]
    pub fn all_hits(
        &self,
        rays: Words,
        side: u32,
        ignore: u32,
        max_memory: Option<f64>,
        called: Option<Function>,
    ) -> Result<Promise, JsValue> {
        let query = query_options(0, side, ignore)?;
        let max_memory = max_memory.map(|bytes| bytes as u64);
        let accelerator = Rc::clone(&self.accelerator);
        Ok(future_to_promise(async move {
            let rays: &[Ray] = rays.part("rays", 0, (rays.length() / 8) as u32)?;
            let called = called.map(Called::new);
            let watch = called.as_ref().map(Called::watch);
            let (culling, ignore) = (query.culling, query.ignore);
            let options = AllHitsOptions { culling, ignore, max_memory, watch };
            let all = accelerator.all_hits_async(rays, &options).await.map_err(Failure::from)?;
            Ok(Crossings::of(&all)?.into())
        }))
    }

    /// Whether rays hit anything: a promise of words that hold a byte a ray.
    #[wasm_bindgen(js_name = anyHits)]
    pub fn any_hits(
        &self,
        rays: Words,
        accuracy: u32,
        culling: u32,
        ignore: u32,
        called: Option<Function>,
    ) -> Result<Promise, JsValue> {
        let options = query_options(accuracy, culling, ignore)?;
        let accelerator = Rc::clone(&self.accelerator);
        Ok(future_to_promise(async move {
            let rays: &[Ray] = rays.part("rays", 0, (rays.length() / 8) as u32)?;
            let mut found: Vec<bool> = zeros(rays.len())?;
            let called = called.map(Called::new);
            let watch = called.as_ref().map(Called::watch);
            let options = QueryOptions { watch, ..options };
            accelerator.any_hits_async(rays, &mut found, &options).await.map_err(Failure::from)?;
            let mut words: Vec<u32> = zeros(rays.len().div_ceil(4))?;
            let bytes: &mut [u8] = bytemuck::cast_slice_mut(&mut words);
            for (byte, found) in bytes.iter_mut().zip(found) {
                *byte = u8::from(found);
            }
            Ok(Words::of(words).into())
        }))
    }
}
