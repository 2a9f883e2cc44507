//! The builders at work, round by round.

use super::{BuilderRow, Placed, Settings, trace};
use crate::paper::rays::FrameRays;
use crate::paper::timing::{median, pool, timed};
use crate::paper::{Builder, ReportError, at_equal_knobs};
use splitplane::backend::{BackendKind, OpenOptions};
use splitplane::scene::Scene;
use splitplane::tracer::{FrameRequest, Tracer};
use splitplane_core::backend::BuildOptions;
use splitplane_core::config::BuildConfig;
use splitplane_core::tree::KdTreeView;
use splitplane_core::tree::cost::equation_5_printed;
use splitplane_core::tree::stats::TreeStats;

/// A builder at work on a scene, and the times it has taken so far.
pub(super) struct Contender {
    pub(super) tracer: Tracer,
    options: BuildOptions<'static>,
    building: rayon::ThreadPool,
    tree_ms: Vec<f64>,
    trace_ms: Vec<f64>,
    row: BuilderRow,
}

impl Contender {
    /// Opens a backend, builds a tree with it, and traces the rays of the frame.
    pub(super) fn new(
        builder: Builder,
        placed: &Placed,
        settings: &Settings,
        tracing: &rayon::ThreadPool,
        rays: &mut Option<FrameRays>,
    ) -> Result<Contender, ReportError> {
        let kind = if builder.gpu { BackendKind::Wgpu } else { BackendKind::Cpu };
        let open = if builder.gpu { settings.open.clone() } else { OpenOptions::default() };
        let engine = kind.open_engine(&open)?.engine;
        let threads = if builder.offline { 1 } else { settings.threads };
        let building = pool(threads)?;
        let options = settings.build_with(builder.config());
        let scene = &placed.scene;
        let (mesh, appearance) = (scene.mesh()?, scene.appearance());
        let tracer = building.install(|| Tracer::load(engine, &mesh, &appearance, &options))?;
        let accelerator = tracer.accelerator().expect("a tracer that has just loaded has it");
        let rays = match rays {
            Some(rays) => rays,
            None => rays
                .insert(tracing.install(|| {
                    FrameRays::of(scene, &placed.camera, settings.size, accelerator)
                })?),
        };
        let rays_ms = tracing.install(|| trace(accelerator, rays, settings.repeat))?;
        let view = accelerator.tree().view();
        // The same constants for all, whatever shaped the tree.
        let usual = BuildConfig::default();
        let blocks = BuildConfig {
            traversal_cost: usual.traversal_cost,
            intersection_cost: usual.intersection_cost,
            block_width: usual.block_width,
            ..view.config
        };
        let block_cost = TreeStats::of(&KdTreeView { config: blocks, ..view }).block_cost;
        let equal = KdTreeView { config: at_equal_knobs(view.config), ..view };
        let stats = TreeStats::of(&equal);
        let row = BuilderRow {
            preset: builder.preset.name(),
            knobs: builder.knobs(),
            backend: tracer.backend().name,
            offline: builder.offline,
            threads: (!builder.gpu).then_some(threads),
            tree_ms: 0.0,
            trace_ms: 0.0,
            rays_ms,
            sah_cost: stats.sah_cost,
            printed_cost: equation_5_printed(equal.config.cost_ratio(), 1.0, &equal),
            block_cost,
            nodes: stats.nodes,
            leaves: stats.leaves,
            references: stats.references,
            max_depth: stats.max_depth,
            bytes: accelerator.query_bytes(),
            digest: accelerator.tree().digest().to_string(),
        };
        let (tree_ms, trace_ms) = (Vec::new(), Vec::new());
        Ok(Contender { tracer, options, building, tree_ms, trace_ms, row })
    }

    /// Builds the tree again and makes a frame; gives the frame's rays.
    pub(super) fn round(
        &mut self,
        scene: &Scene,
        request: &FrameRequest,
        tracing: &rayon::ThreadPool,
        counts: bool,
    ) -> Result<u64, ReportError> {
        let Contender { tracer, options, building, .. } = self;
        let mesh = scene.mesh()?;
        let (built, tree_ms) = building.install(|| timed(|| tracer.rebuild(&mesh, options)));
        built?;
        let (traced, trace_ms) = tracing.install(|| {
            timed(|| {
                let frame = tracer.frame(&mesh, request)?;
                // On a GPU the frame is done when its pixels are here.
                frame.pixels()?;
                Ok::<u64, ReportError>(frame.stats().rays())
            })
        });
        if counts {
            self.tree_ms.push(tree_ms);
            self.trace_ms.push(trace_ms);
        }
        traced
    }

    pub(super) fn finish(self) -> BuilderRow {
        let Contender { tree_ms, trace_ms, row, .. } = self;
        BuilderRow { tree_ms: median(tree_ms), trace_ms: median(trace_ms), ..row }
    }
}
