//! A tree over a mesh, and its queries.

use js_sys::{Function, Uint8Array};
use splitplane::core::tree::file::{self, TreeFile};
use splitplane::{
    Accelerator, AllHitsOptions, Backend, BuildOptions, ClosestPoint, ClosestPointOptions,
    CpuBackend, Hit, LocateOptions, Ray,
};
use wasm_bindgen::prelude::*;

use crate::crossings::Crossings;
use crate::failure::Failure;
use crate::mesh::{file_of, mesh};
use crate::named::{NONE, build_options, culling, query_options};
use crate::progress::watched;
use crate::words::{Words, zeros};

/// A tree, ready for rays.
#[wasm_bindgen]
pub struct Tree {
    accelerator: Box<dyn Accelerator>,
    /// Keeps memory between rebuilds; there is none before the first.
    backend: Option<CpuBackend>,
}

#[wasm_bindgen]
impl Tree {
    /// Builds a tree.
    pub fn build(
        positions: &Words,
        indices: &Words,
        is_indexed: bool,
        preset: &str,
        layout: &str,
        max_memory: Option<f64>,
        called: Option<Function>,
    ) -> Result<Tree, JsValue> {
        let mesh = mesh(positions, indices, is_indexed)?;
        let options = build_options(preset, layout, max_memory)?;
        let built = watched(called, |watch| {
            CpuBackend::new().build(&mesh, &BuildOptions { watch, ..options })
        });
        Ok(Tree { accelerator: built.map_err(Failure::from)?, backend: None })
    }

    /// Builds it again, over other arrays.
    #[expect(clippy::too_many_arguments, reason = "what JavaScript hands over, one by one")]
    pub fn rebuild(
        &mut self,
        positions: &Words,
        indices: &Words,
        is_indexed: bool,
        preset: &str,
        layout: &str,
        max_memory: Option<f64>,
        called: Option<Function>,
    ) -> Result<(), JsValue> {
        let mesh = mesh(positions, indices, is_indexed)?;
        let options = build_options(preset, layout, max_memory)?;
        let backend = self.backend.get_or_insert_with(CpuBackend::new);
        let built = watched(called, |watch| {
            let options = BuildOptions { watch, ..options };
            backend.rebuild(&mut self.accelerator, &mesh, &options)
        });
        Ok(built.map_err(Failure::from)?)
    }

    /// Makes a tree of the bytes of a tree file, `length` bytes from the start of `kept`.
    #[expect(clippy::too_many_arguments, reason = "what JavaScript hands over, one by one")]
    pub fn load(
        kept: &Words,
        length: u32,
        positions: &Words,
        indices: &Words,
        is_indexed: bool,
        layout: &str,
        max_memory: Option<f64>,
        called: Option<Function>,
    ) -> Result<Tree, JsValue> {
        let mesh = mesh(positions, indices, is_indexed)?;
        let options = build_options("balanced", layout, max_memory)?;
        let bytes = kept.bytes().get(..length as usize);
        let bytes = bytes.ok_or_else(|| Failure::range("file", 0, length, kept.bytes().len()))?;
        let kept = TreeFile::parse(bytes).map_err(Failure::from)?;
        if kept.mesh != file::mesh_digest(&mesh) {
            let text = "the tree was built over another mesh: its digest differs";
            return Err(Failure::new("wrong-mesh", text).into());
        }
        let tree = kept.tree.to_tree().map_err(Failure::from)?;
        let loaded = watched(called, |watch| {
            let options = BuildOptions { watch, ..options };
            CpuBackend::new().load(&mesh, tree, &options.for_loading())
        });
        Ok(Tree { accelerator: loaded.map_err(Failure::from)?, backend: None })
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
        let bytes = file_of(self.accelerator.tree(), &mesh)?;
        Ok(Uint8Array::from(&bytes[..]))
    }

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

    /// The closest hits of some rays of 8 words, into hits of 4 words: t, triangle, u, v.
    #[expect(clippy::too_many_arguments, reason = "what JavaScript hands over, one by one")]
    #[wasm_bindgen(js_name = closestHits)]
    pub fn closest_hits(
        &self,
        rays: &Words,
        hits: &mut Words,
        first: u32,
        count: u32,
        accuracy: u32,
        culling: u32,
        ignore: u32,
    ) -> Result<(), JsValue> {
        let options = query_options(accuracy, culling, ignore)?;
        let rays: &[Ray] = rays.part("rays", first, count)?;
        let hits: &mut [Hit] = hits.part_mut("hits", first, count)?;
        self.accelerator.closest_hits(rays, hits, &options).map_err(Failure::from)?;
        Ok(())
    }

    /// Whether some rays hit anything: a byte each.
    #[expect(clippy::too_many_arguments, reason = "what JavaScript hands over, one by one")]
    #[wasm_bindgen(js_name = anyHits)]
    pub fn any_hits(
        &self,
        rays: &Words,
        occluded: &mut Words,
        first: u32,
        count: u32,
        accuracy: u32,
        culling: u32,
        ignore: u32,
    ) -> Result<(), JsValue> {
        let options = query_options(accuracy, culling, ignore)?;
        let rays: &[Ray] = rays.part("rays", first, count)?;
        let bytes: &mut [u8] = occluded.part_mut("occluded", first, count)?;
        let mut answers: Vec<bool> = zeros(rays.len())?;
        self.accelerator.any_hits(rays, &mut answers, &options).map_err(Failure::from)?;
        for (byte, answer) in bytes.iter_mut().zip(answers) {
            *byte = u8::from(answer);
        }
        Ok(())
    }

    /// The closest hit of the first of `rays`, into the first of `hits`; whether there is one.
    #[wasm_bindgen(js_name = closestHit)]
    pub fn closest_hit(
        &self,
        rays: &Words,
        hits: &mut Words,
        accuracy: u32,
        culling: u32,
        ignore: u32,
    ) -> Result<bool, JsValue> {
        let options = query_options(accuracy, culling, ignore)?;
        let ray: &Ray = &rays.part("rays", 0, 1)?[0];
        let to: &mut Hit = &mut hits.part_mut("hits", 0, 1)?[0];
        let hit = self.accelerator.closest_hit(ray, &options);
        *to = hit.unwrap_or(Hit::MISS);
        Ok(hit.is_some())
    }

    /// Whether the first of `rays` hits anything.
    #[wasm_bindgen(js_name = anyHit)]
    pub fn any_hit(
        &self,
        rays: &Words,
        accuracy: u32,
        culling: u32,
        ignore: u32,
    ) -> Result<bool, JsValue> {
        let options = query_options(accuracy, culling, ignore)?;
        Ok(self.accelerator.any_hit(&rays.part("rays", 0, 1)?[0], &options))
    }

    /// All crossings of all rays.
    #[wasm_bindgen(js_name = allHits)]
    pub fn all_hits(
        &self,
        rays: &Words,
        count: u32,
        side: u32,
        ignore: u32,
        max_memory: Option<f64>,
        called: Option<Function>,
    ) -> Result<Crossings, JsValue> {
        let rays: &[Ray] = rays.part("rays", 0, count)?;
        let (culling, ignore) = (culling(side)?, (ignore != NONE).then_some(ignore));
        let max_memory = max_memory.map(|bytes| bytes as u64);
        let all = watched(called, |watch| {
            let options = AllHitsOptions { culling, ignore, max_memory, watch };
            self.accelerator.all_hits(rays, &options)
        });
        Ok(Crossings::of(&all.map_err(Failure::from)?)?)
    }

    /// How often the surface winds around some points, 2 words each: the winding number, and 1 for a point on the surface.
    pub fn locate(
        &self,
        points: &Words,
        windings: &mut Words,
        first: u32,
        count: u32,
        max_memory: Option<f64>,
        called: Option<Function>,
    ) -> Result<(), JsValue> {
        let points: &[[f32; 3]] = points.part("points", first, count)?;
        let windings: &mut [[i32; 2]] = windings.part_mut("windings", first, count)?;
        let max_memory = max_memory.map(|bytes| bytes as u64);
        let located = watched(called, |watch| {
            self.accelerator.locate(points, &LocateOptions { max_memory, watch })
        });
        for (to, winding) in windings.iter_mut().zip(located.map_err(Failure::from)?.windings) {
            *to = [winding.unwrap_or(0), i32::from(winding.is_none())];
        }
        Ok(())
    }

    /// The closest points to some points, 8 words each: the square of the distance (an `f64`), x, y, z, triangle, u, v.
    #[expect(clippy::too_many_arguments, reason = "what JavaScript hands over, one by one")]
    #[wasm_bindgen(js_name = closestPoints)]
    pub fn closest_points(
        &self,
        points: &Words,
        closest: &mut Words,
        first: u32,
        count: u32,
        max_distance: f32,
        ignore: u32,
        called: Option<Function>,
    ) -> Result<(), JsValue> {
        let points: &[[f32; 3]] = points.part("points", first, count)?;
        let to: &mut [[u32; 8]] = closest.part_mut("closest points", first, count)?;
        let ignore = (ignore != NONE).then_some(ignore);
        let mut found = Vec::new();
        let memory = |_| Failure::memory(size_of_val(points));
        found.try_reserve_exact(points.len()).map_err(memory)?;
        found.resize(points.len(), ClosestPoint::NONE);
        watched(called, |watch| {
            let options = ClosestPointOptions { max_distance, ignore, watch, ..Default::default() };
            self.accelerator.closest_points(points, &mut found, &options)
        })
        .map_err(Failure::from)?;
        for (to, found) in to.iter_mut().zip(&found) {
            let square = found.distance_squared.to_bits();
            let [x, y, z] = found.point.map(f32::to_bits);
            let (u, v) = (found.u.to_bits(), found.v.to_bits());
            *to = [square as u32, (square >> 32) as u32, x, y, z, found.triangle, u, v];
        }
        Ok(())
    }
}
