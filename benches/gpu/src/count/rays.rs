//! Counts a query: what the rays of a batch do on the device.

use splitplane::core::arithmetic::Strict;
use splitplane::core::query::compressed::CompressedNodes;
use splitplane::core::query::intersect::SceneScale;
use splitplane::core::query::traverse::{Cost, Query, trace_observed};
use splitplane::core::tree::KdTreeView;
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
    pub through: Through,
    pub rays: u64,
    /// The kernels of the query; both count together.
    pub kernel: Counted,
    /// Nodes visited and triangles tested by a ray on average, in the tree as it is.
    pub nodes: f64,
    pub triangles: f64,
}

/// What rays go through.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Through {
    /// The nodes of the tree itself.
    Tree,
    /// Compressed nodes made from it.
    Compressed,
}

impl Through {
    pub(crate) const ALL: [Through; 2] = [Through::Tree, Through::Compressed];

    /// The lean shader of closest hits, the watertight one.
    fn kernel(self) -> &'static str {
        match self {
            Through::Tree => "closest_hit",
            Through::Compressed => "closest_hit_compressed",
        }
    }

    /// In a word.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Through::Tree => "the tree",
            Through::Compressed => "compressed nodes",
        }
    }
}

/// Rays of which nodes and triangles are counted, on the CPU.
const SAMPLE: usize = 4096;

/// Counts closest hits.
pub(crate) fn count(
    counter: &Counter,
    mesh: &Mesh<'_>,
    preset: Preset,
    rays: &[Ray],
) -> Result<Vec<CountedRays>, Failure> {
    let backend = &counter.backend;
    let gpu = backend.gpu();
    let build = BuildOptions::from(preset.config());
    let mut tree = backend.build_on_device(mesh, &build)?.tree;
    let host = tree.read(gpu)?;
    let corners: Vec<Triangle> =
        (0..mesh.len()).map(|i| prepare(&mesh.triangle(i)).corners).collect();
    let count = rays.len() as u32;
    let bytes: &[u8] = bytemuck::cast_slice(rays);
    let uploaded = gpu.buffer("rays", bytes.len() as u64, Usage::STORAGE | Usage::COPY_DST)?;
    gpu.queue().write_buffer(&uploaded, 0, bytes);
    let hits = gpu.buffer("hits", 16 * u64::from(count), Usage::STORAGE | Usage::COPY_SRC)?;
    let options = QueryOptions::default();
    let mut counted = Vec::new();
    for through in Through::ALL {
        if through == Through::Compressed {
            tree.compress(backend.queries(), &host.view(), &corners)?;
        }
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
        let kernel = through.kernel();
        let shader = splitplane_shaders::find(kernel).ok_or("no such query")?;
        let lanes = rewrite::lanes(&shader.source())?;
        let kernel = Counted { kernel, text: kernel, lanes, dispatches: vec![tally] };
        let [nodes, triangles] = visits(through, &host.view(), &corners, tree.scene_scale(), rays);
        counted.push(CountedRays { through, rays: count.into(), kernel, nodes, triangles });
    }
    Ok(counted)
}

/// Nodes that a ray visits and triangles that it tests on average, of a sample.
fn visits(
    through: Through,
    tree: &KdTreeView<'_>,
    corners: &[Triangle],
    scale: &SceneScale,
    rays: &[Ray],
) -> [f64; 2] {
    let options = QueryOptions::default();
    let wide = match through {
        Through::Tree => None,
        Through::Compressed => CompressedNodes::new(tree, corners, scale),
    };
    let (mut all, mut sampled) = ([0.0; 2], 0.0);
    for ray in rays.iter().step_by(rays.len().div_ceil(SAMPLE).max(1)) {
        let mut cost = Cost::default();
        let found = wide.as_ref().and_then(|nodes| {
            nodes.trace::<Strict, _>(corners, scale, ray, &options, Query::Closest, &mut cost)
        });
        // Rays that are left to the tree are counted there.
        if found.is_none() {
            trace_observed::<Strict, _>(
                tree,
                corners,
                scale,
                ray,
                &options,
                Query::Closest,
                &mut cost,
            );
        }
        all[0] += f64::from(cost.nodes);
        all[1] += f64::from(cost.triangles);
        sampled += 1.0;
    }
    all.map(|sum| sum / f64::max(sampled, 1.0))
}
