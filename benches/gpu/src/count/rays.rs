//! Counts a query: what the rays of a batch do on the device.

use splitplane::core::arithmetic::Strict;
use splitplane::core::query::traverse::{Cost, Query, trace_observed};
use splitplane::core::triangle::{Triangle, prepare};
use splitplane::{BuildOptions, Mesh, Preset, QueryOptions, Ray};
use wgpu::BufferUsages as Usage;

use super::device::Counter;
use super::rewrite;
use super::tally::{Counted, Tally};
use crate::Failure;

/// Rays that were counted.
#[derive(Clone, Debug)]
pub(crate) struct CountedRays {
    pub rays: u64,
    /// The kernels of the query; both count together.
    pub kernel: Counted,
    /// Nodes visited and triangles tested by a ray on average, in the tree as it is.
    pub nodes: f64,
    pub triangles: f64,
}

/// The shader of closest hits, the watertight ones.
const KERNEL: &str = "closest_hit";
/// Rays of which nodes and triangles are counted, on the CPU.
const SAMPLE: usize = 4096;

/// Counts closest hits.
pub(crate) fn count(
    counter: &Counter,
    mesh: &Mesh<'_>,
    preset: Preset,
    rays: &[Ray],
) -> Result<CountedRays, Failure> {
    let backend = &counter.backend;
    let gpu = backend.gpu();
    let build = BuildOptions::from(preset.config());
    let tree = backend.build_on_device(mesh, &build)?.tree;
    let count = rays.len() as u32;
    let bytes: &[u8] = bytemuck::cast_slice(rays);
    let uploaded = gpu.buffer("rays", bytes.len() as u64, Usage::STORAGE | Usage::COPY_DST)?;
    gpu.queue().write_buffer(&uploaded, 0, bytes);
    let hits = gpu.buffer("hits", 16 * u64::from(count), Usage::STORAGE | Usage::COPY_SRC)?;
    let options = QueryOptions::default();
    let mut encoder = gpu.device().create_command_encoder(&Default::default());
    counter.clear();
    backend.queries().record_closest_hits(
        &mut encoder,
        &tree,
        &uploaded,
        &hits,
        count,
        &options,
    )?;
    gpu.submit([encoder.finish()])?;
    gpu.wait()?;
    let mut tally = Tally::of_words(&counter.read()?);
    (tally.read, tally.written) = (32 * u64::from(count), 16 * u64::from(count));
    let shader = splitplane_shaders::find(KERNEL).ok_or("no such query")?;
    let lanes = rewrite::lanes(&shader.source())?;
    let kernel = Counted { kernel: KERNEL, lanes, dispatches: vec![tally] };

    let host = tree.read(gpu)?;
    let corners: Vec<Triangle> =
        (0..mesh.len()).map(|i| prepare(&mesh.triangle(i)).corners).collect();
    let scale = tree.scene_scale();
    let (mut all, mut sampled) = ([0.0; 2], 0.0);
    for ray in rays.iter().step_by(rays.len().div_ceil(SAMPLE).max(1)) {
        let mut cost = Cost::default();
        let view = host.view();
        trace_observed::<Strict, _>(
            &view,
            &corners[..],
            scale,
            ray,
            &options,
            Query::Closest,
            &mut cost,
        );
        all[0] += f64::from(cost.nodes);
        all[1] += f64::from(cost.triangles);
        sampled += 1.0;
    }
    let [nodes, triangles] = all.map(|sum| sum / f64::max(sampled, 1.0));
    Ok(CountedRays { rays: count.into(), kernel, nodes, triangles })
}
