//! The CPU as a [`Backend`].

use std::sync::Mutex;

use rayon::prelude::*;
use splitplane_core::backend::{
    Accelerator, Backend, BackendInfo, BuildError, BuildOptions, BuildSummary,
};
use splitplane_core::kernel::Counter;
use splitplane_core::mesh::Mesh;
use splitplane_core::schedule;
use splitplane_core::tree::{KdTree, KdTreeView};
use splitplane_core::triangle::{Prepared, Triangle, prepare};
use splitplane_core::validate::validate_mesh;

use crate::best;
use crate::buffers::{Buffers, Memory};
use crate::executor::CpuExecutor;
use crate::query::{CpuAccelerator, InstructionSet};

/// The CPU backend. Work runs in the rayon pool of the calling thread; scratch memory is kept
/// between builds.
#[derive(Debug)]
pub struct CpuBackend {
    scratch: Mutex<Option<Box<Buffers>>>,
    set: InstructionSet,
}

impl Default for CpuBackend {
    fn default() -> CpuBackend {
        CpuBackend::with_instruction_set(InstructionSet::detect())
    }
}

impl CpuBackend {
    /// A backend that uses the best instruction set this processor has.
    pub fn new() -> CpuBackend {
        CpuBackend::default()
    }

    /// A backend that uses at most this instruction set; for tests and measurements. Answers do not
    /// depend on it.
    pub fn with_instruction_set(set: InstructionSet) -> CpuBackend {
        let available = InstructionSet::available();
        let set = if available.contains(&set) { set } else { InstructionSet::Portable };
        CpuBackend { scratch: Mutex::new(None), set }
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
        self.with_built(mesh, options, |tree, summary, _, _| Ok((tree.into(), summary)))
    }

    /// Builds, and also makes the query layout; the accelerator by its own type.
    ///
    /// # Errors
    /// As for [`Backend::build`].
    pub fn build_accelerator(
        &self,
        mesh: &Mesh<'_>,
        options: &BuildOptions,
    ) -> Result<CpuAccelerator, BuildError> {
        self.with_built(mesh, options, |tree, mut summary, triangles, mut memory| {
            memory.take(CpuAccelerator::bytes_for(&tree))?;
            summary.peak_bytes = memory.peak;
            Ok(CpuAccelerator::new(tree.into(), summary, triangles, self.set))
        })
    }

    /// As [`CpuBackend::build_accelerator`], into the memory of an accelerator that is no longer
    /// needed, whatever it was built over. Whoever rebuilds every frame saves the allocations. After
    /// an error the accelerator is what it was.
    ///
    /// # Errors
    /// As for [`Backend::build`].
    pub fn rebuild(
        &self,
        accelerator: &mut CpuAccelerator,
        mesh: &Mesh<'_>,
        options: &BuildOptions,
    ) -> Result<(), BuildError> {
        self.with_built(mesh, options, |tree, mut summary, triangles, mut memory| {
            memory.take(CpuAccelerator::bytes_for(&tree))?;
            summary.peak_bytes = memory.peak;
            accelerator.replace(&tree, summary, triangles);
            Ok(())
        })
    }

    /// Builds a tree and hands it over with its summary and the snapped corners.
    fn with_built<T>(
        &self,
        mesh: &Mesh<'_>,
        options: &BuildOptions,
        then: impl FnOnce(KdTreeView<'_>, BuildSummary, &[Triangle], Memory) -> Result<T, BuildError>,
    ) -> Result<T, BuildError> {
        options.config.validate()?;
        // A poisoned lock means that another build panicked; its scratch is not needed.
        let scratch = self.scratch.lock().map_or(None, |mut kept| kept.take()).unwrap_or_default();
        let mut executor: CpuExecutor<'_> =
            CpuExecutor::new(*mesh, options.config, self.set, *scratch, options.max_memory)?;
        let planes = options.config.preset.planes();
        match planes {
            Some(planes) => schedule::build(&mut executor, planes)?,
            None => schedule::start(&mut executor)?,
        }
        let mut memory = executor.memory();
        let mut buffers = executor.finish();
        let counters = buffers.counters;
        let (nodes, references) = if planes.is_some() {
            let [nodes, references] =
                [Counter::Nodes, Counter::LeafReferences].map(|counter| counters[counter] as usize);
            (nodes, references)
        } else {
            best::build(&options.config, self.set, &mut buffers, &mut memory)?
        };
        let tree = KdTreeView {
            nodes: &buffers.nodes[..nodes],
            references: &buffers.leaf_references[..references],
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
            peak_bytes: memory.peak,
        };
        let out = then(tree, summary, &buffers.triangles[..mesh.len()], memory);
        if let Ok(mut kept) = self.scratch.lock() {
            *kept = Some(Box::new(buffers));
        }
        out
    }
}

impl Backend for CpuBackend {
    fn describe(&self) -> BackendInfo {
        BackendInfo {
            name: "cpu".into(),
            adapter: None,
            threads: Some(rayon::current_num_threads()),
            detail: format!("instruction set {}", self.set.name()),
        }
    }

    fn build(
        &self,
        mesh: &Mesh<'_>,
        options: &BuildOptions,
    ) -> Result<Box<dyn Accelerator>, BuildError> {
        Ok(Box::new(self.build_accelerator(mesh, options)?))
    }

    fn load(
        &self,
        mesh: &Mesh<'_>,
        tree: KdTree,
        options: &BuildOptions,
    ) -> Result<Box<dyn Accelerator>, BuildError> {
        let wrong = |reason: String| BuildError::WrongMesh { reason };
        validate_mesh(&tree.view(), mesh).map_err(|violation| wrong(violation.to_string()))?;
        let bytes = mesh.len() * (size_of::<Triangle>() + size_of::<Prepared>());
        let mut memory = Memory { limit: options.max_memory, ..Memory::default() };
        memory.take(bytes as u64 + CpuAccelerator::bytes_for(&tree.view()))?;
        let prepared: Vec<_> =
            (0..mesh.len()).into_par_iter().map(|i| prepare(&mesh.triangle(i))).collect();
        let count = |test: fn(&Prepared) -> bool| {
            prepared.iter().filter(|triangle| test(triangle)).count() as u32
        };
        let summary = BuildSummary {
            triangles: mesh.len() as u32,
            dropped: count(|triangle| !triangle.kept),
            snapped: count(|triangle| triangle.snapped),
            large_levels: 0,
            small_roots: 0,
            peak_bytes: memory.peak,
        };
        let triangles: Vec<Triangle> = prepared.into_iter().map(|p| p.corners).collect();
        Ok(Box::new(CpuAccelerator::new(tree, summary, &triangles, self.set)))
    }
}
