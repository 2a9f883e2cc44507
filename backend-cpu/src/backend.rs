//! The CPU as a [`Backend`].

use std::sync::Mutex;

use splitplane_core::backend::{BuildError, BuildOptions, BuildSummary};
use splitplane_core::kernel::Counter;
use splitplane_core::mesh::Mesh;
use splitplane_core::schedule;
use splitplane_core::tree::KdTree;

use crate::buffers::Buffers;
use crate::executor::CpuExecutor;

/// The CPU backend. Work runs in the rayon pool of the calling thread; scratch memory is kept
/// between builds.
#[derive(Debug, Default)]
pub struct CpuBackend {
    scratch: Mutex<Option<Box<Buffers>>>,
}

impl CpuBackend {
    /// A backend without scratch memory.
    pub fn new() -> CpuBackend {
        CpuBackend::default()
    }

    /// Builds the canonical tree alone, without what queries need.
    ///
    /// # Errors
    /// As for [`Backend::build`].
    pub fn build_tree(
        &self,
        mesh: &Mesh<'_>,
        options: &BuildOptions,
    ) -> Result<(KdTree, BuildSummary), BuildError> {
        options.config.validate()?;
        // A poisoned lock means that another build panicked; its scratch is not needed.
        let scratch = self.scratch.lock().map_or(None, |mut kept| kept.take()).unwrap_or_default();
        let mut executor = CpuExecutor::new(*mesh, options.config, *scratch, options.max_memory)?;
        schedule::build(&mut executor)?;
        let peak_bytes = executor.peak_bytes();
        let buffers = executor.finish();
        let counters = buffers.counters;
        let nodes = counters[Counter::Nodes] as usize;
        let references = counters[Counter::LeafReferences] as usize;
        let tree = KdTree {
            nodes: buffers.nodes[..nodes].to_vec(),
            references: buffers.leaf_references[..references].to_vec(),
            bounds: buffers.root_bounds,
            triangles: counters[Counter::Triangles],
            config: options.config,
        };
        let summary = BuildSummary {
            triangles: counters[Counter::Triangles],
            dropped: counters[Counter::Dropped],
            snapped: counters[Counter::Snapped],
            large_levels: counters[Counter::Levels],
            small_roots: counters[Counter::SmallRoots],
            peak_bytes,
        };
        if let Ok(mut kept) = self.scratch.lock() {
            *kept = Some(Box::new(buffers));
        }
        Ok((tree, summary))
    }
}
