//! The CPU as a [`Backend`].

use std::sync::Mutex;

use splitplane_core::backend::scene::SceneAccelerator;
use splitplane_core::backend::{Accelerator, Backend, BuildOptions, LoadOptions};
use splitplane_core::error::BuildError;
use splitplane_core::kernel::Counter;
use splitplane_core::mesh::Mesh;
use splitplane_core::report::{BackendInfo, BuildSummary};
use splitplane_core::scene::{Scene, SceneBuildError};
use splitplane_core::tree::validate::validate_mesh_while;
use splitplane_core::tree::{KdTree, KdTreeView};
use splitplane_core::triangle::{Prepared, Triangle, prepare};
use splitplane_core::watch::Stage;
use splitplane_float_state::Standard;

use crate::accelerator::CpuAccelerator;
use crate::build::{self, BuildScratch, Finished, Lists};
use crate::cancel::{ProgressMeter, UNWATCHED};
use crate::layout::scratch::{LayoutScratch, LayoutSource};
use crate::memory::{Memory, boxed, extend};
use crate::parallel::{Parallel, ParallelSlice};
use crate::scene::CpuScene;
use crate::simd::InstructionSet;

/// The CPU backend. Work runs in the rayon pool of the calling thread.
///
/// Scratch memory is kept between builds, counts towards their limits, and is freed where they leave no space for it. How
/// much is kept depends on the call. [`CpuBackend::rebuild_accelerator`] keeps all, so that the next rebuild of the kind
/// makes none anew. [`CpuBackend::build_accelerator`] frees the builder's lists before it makes the query layout; a first
/// rebuild after it makes them anew. Lists of less than a mebibyte in all are kept by both.
#[derive(Debug)]
pub struct CpuBackend {
    scratch: Mutex<Option<Box<(BuildScratch, LayoutScratch)>>>,
    set: InstructionSet,
}

/// A finished tree, and the scratch memory for its query layout.
struct BuiltTree<'a> {
    tree: BuiltNodes<'a>,
    summary: BuildSummary,
    /// Snapped corners of the mesh.
    triangles: &'a [Triangle],
    memory: Memory,
    scratch: &'a mut LayoutScratch,
}

/// Who has a tree's nodes and references.
enum BuiltNodes<'a> {
    /// The backend, which keeps their memory.
    Kept(KdTreeView<'a>),
    /// The tree itself, in memory that has been accounted for.
    Own(KdTree),
}

impl BuiltNodes<'_> {
    fn view(&self) -> KdTreeView<'_> {
        match self {
            BuiltNodes::Kept(tree) => *tree,
            BuiltNodes::Own(tree) => tree.view(),
        }
    }

    /// Bytes that [`BuiltNodes::into_own`] takes in addition.
    fn more(&self) -> u64 {
        match self {
            BuiltNodes::Kept(tree) => tree_bytes(tree),
            BuiltNodes::Own(_) => 0,
        }
    }

    /// A tree of its own, for which `memory` accounts.
    ///
    /// # Errors
    /// Less memory than that, or the end of the work.
    fn into_own(self, memory: &Memory, meter: &ProgressMeter<'_>) -> Result<KdTree, BuildError> {
        match self {
            BuiltNodes::Kept(tree) => copied(&tree, memory, meter),
            BuiltNodes::Own(tree) => Ok(tree),
        }
    }
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
        let set = if available.contains(&set) { set } else { InstructionSet::least() };
        CpuBackend { scratch: Mutex::new(None), set }
    }

    /// Builds only the canonical tree, without the query layout.
    ///
    /// # Errors
    /// As for [`Backend::build`].
    pub fn build_tree(
        &self,
        mesh: &Mesh<'_>,
        options: &BuildOptions<'_>,
    ) -> Result<(KdTree, BuildSummary), BuildError> {
        let meter = &ProgressMeter::of(options.watch);
        self.with_built(mesh, options, meter, (Lists::Keep, 0), |built| {
            Ok((built.tree.into_own(&built.memory, meter)?, built.summary))
        })
    }

    /// Builds, and also makes the query layout. Returns the accelerator by its concrete type. The builder's lists are freed
    /// before the layout is made: see [`CpuBackend`].
    ///
    /// # Errors
    /// As for [`Backend::build`].
    pub fn build_accelerator(
        &self,
        mesh: &Mesh<'_>,
        options: &BuildOptions<'_>,
    ) -> Result<CpuAccelerator, BuildError> {
        self.build_beside(mesh, options, (Lists::GiveBack, 0))
    }

    /// Builds while an accelerator of so many bytes is held that will be replaced.
    fn build_beside(
        &self,
        mesh: &Mesh<'_>,
        options: &BuildOptions<'_>,
        how @ (lists, old): (Lists, u64),
    ) -> Result<CpuAccelerator, BuildError> {
        let built = self.build_once(mesh, options, how);
        if lists == Lists::Keep && matches!(built, Err(BuildError::OutOfMemory { .. })) {
            return self.build_once(mesh, options, (Lists::GiveBack, old));
        }
        built
    }

    /// As [`CpuBackend::build_beside`]; what is done with lists does not depend on the limit.
    fn build_once(
        &self,
        mesh: &Mesh<'_>,
        options: &BuildOptions<'_>,
        how: (Lists, u64),
    ) -> Result<CpuAccelerator, BuildError> {
        let meter = &ProgressMeter::of(options.watch);
        self.with_built(mesh, options, meter, how, |built| {
            let BuiltTree { tree, summary, triangles, mut memory, scratch } = built;
            begin_layout(meter, &tree.view());
            memory.take(tree.more())?;
            let tree = tree.into_own(&memory, meter)?;
            let source = LayoutSource { mesh, triangles, layout: options.layout };
            let with = (&mut memory, scratch);
            let built = CpuAccelerator::new(tree, summary, source, self.set, meter, with)?;
            meter.finish_stage();
            meter.check().map(|()| built)
        })
    }

    /// As [`CpuBackend::build_accelerator`], reusing the memory of an accelerator that is no longer
    /// needed, over any mesh. This saves allocations when rebuilding each frame. After an error the
    /// accelerator is unchanged. For that, under a watch the query layout is made in new memory,
    /// which counts towards the limit together with the old one.
    ///
    /// # Errors
    /// As for [`Backend::build`].
    pub fn rebuild_accelerator(
        &self,
        accelerator: &mut CpuAccelerator,
        mesh: &Mesh<'_>,
        options: &BuildOptions<'_>,
    ) -> Result<(), BuildError> {
        if options.watch.is_some() {
            let old = accelerator.bytes();
            *accelerator = self.build_beside(mesh, options, (Lists::Keep, old))?;
            return Ok(());
        }
        self.with_built(mesh, options, &UNWATCHED, (Lists::Keep, 0), |built| {
            let BuiltTree { tree, summary, triangles, mut memory, scratch } = built;
            let source = LayoutSource { mesh, triangles, layout: options.layout };
            accelerator.replace(&tree.view(), summary, source, (&mut memory, scratch))
        })
    }

    /// Builds a tree and hands it over, while an accelerator of so many bytes is held. If memory kept from earlier builds makes this build exceed
    /// its limit, that memory is freed and the build is repeated: what a limit allows does not
    /// depend on what was built before.
    fn with_built<T>(
        &self,
        mesh: &Mesh<'_>,
        options: &BuildOptions<'_>,
        meter: &ProgressMeter<'_>,
        how: (Lists, u64),
        mut then: impl FnMut(BuiltTree<'_>) -> Result<T, BuildError>,
    ) -> Result<T, BuildError> {
        let _state = Standard::set();
        options.config.validate()?;
        // A poisoned lock means that another build panicked; its scratch is not needed.
        let kept = self.scratch.lock().map_or(None, |mut kept| kept.take());
        let is_kept = kept.is_some();
        let new = || boxed(Default::default).map_err(|_| Memory::default().lacking());
        let mut kept = kept.map_or_else(new, Ok)?;
        let mut out = self.build_with(&mut kept, mesh, options, meter, how, &mut then);
        if is_kept && matches!(out, Err(BuildError::OutOfMemory { .. })) {
            *kept = Default::default();
            out = self.build_with(&mut kept, mesh, options, meter, how, &mut then);
        }
        // Memory that was too small is not worth keeping: the next build would only have to give it
        // back.
        if !matches!(out, Err(BuildError::OutOfMemory { .. }))
            && let Ok(mut scratch) = self.scratch.lock()
        {
            *scratch = Some(kept);
        }
        out
    }

    /// Builds in memory that may have been used before.
    fn build_with<T>(
        &self,
        (kept, layout): &mut (BuildScratch, LayoutScratch),
        mesh: &Mesh<'_>,
        options: &BuildOptions<'_>,
        meter: &ProgressMeter<'_>,
        (lists, old): (Lists, u64),
        then: &mut impl FnMut(BuiltTree<'_>) -> Result<T, BuildError>,
    ) -> Result<T, BuildError> {
        let beside = old + layout.bytes();
        let Finished { nodes, references, stages, mut memory } =
            build::build(kept, mesh, options, self.set, meter, (lists, beside))?;
        if lists == Lists::GiveBack {
            kept.give_back(&mut memory);
        }
        let buffers = &mut kept.buffers;
        let counters = buffers.counters;
        let (bounds, triangles) = (buffers.root_bounds, counters[Counter::Triangles]);
        let config = options.config;
        // What is longer than the tree, from another build, stays here.
        let fits =
            [buffers.nodes.capacity(), buffers.leaf_references.capacity()] == [nodes, references];
        let tree = if lists == Lists::GiveBack && fits {
            let nodes = core::mem::take(&mut buffers.nodes);
            let references = core::mem::take(&mut buffers.leaf_references);
            BuiltNodes::Own(KdTree { nodes, references, bounds, triangles, config })
        } else {
            let nodes = &buffers.nodes[..nodes];
            let references = &buffers.leaf_references[..references];
            BuiltNodes::Kept(KdTreeView { nodes, references, bounds, triangles, config })
        };
        let mut summary = BuildSummary::default();
        summary.triangles = counters[Counter::Triangles];
        summary.dropped = counters[Counter::Dropped];
        summary.snapped = counters[Counter::Snapped];
        summary.large_levels = stages.levels;
        summary.small_roots = stages.small_roots;
        summary.peak_bytes = memory.peak;
        let triangles = &buffers.triangles[..mesh.len()];
        then(BuiltTree { tree, summary, triangles, memory, scratch: layout })
    }
}

impl Backend for CpuBackend {
    fn describe(&self) -> BackendInfo {
        let mut info = BackendInfo::new("cpu");
        info.threads = Some(rayon::current_num_threads());
        info.detail = format!("instruction set {}", self.set.name());
        info
    }

    /// Calls the watch after every few thousand triangles' worth of work, from one thread at a
    /// time, so `done` never falls within a stage. Where a limit leaves no space for memory kept
    /// from earlier builds, that memory is freed, and the stages begin again. A panic of the watch
    /// is passed on to the caller; backend, pool and accelerators stay usable.
    fn build(
        &self,
        mesh: &Mesh<'_>,
        options: &BuildOptions<'_>,
    ) -> Result<Box<dyn Accelerator>, BuildError> {
        in_box(self.build_accelerator(mesh, options)?)
    }

    /// As [`CpuBackend::rebuild_accelerator`]; an accelerator of another backend is replaced.
    fn rebuild(
        &self,
        accelerator: &mut Box<dyn Accelerator>,
        mesh: &Mesh<'_>,
        options: &BuildOptions<'_>,
    ) -> Result<(), BuildError> {
        match accelerator.downcast_mut::<CpuAccelerator>() {
            Some(own) => self.rebuild_accelerator(own, mesh, options),
            None => {
                let held = accelerator.held_bytes();
                let built = self.build(mesh, &options.beside(held));
                *accelerator = built.map_err(|error| error.beside(held, options.max_memory))?;
                Ok(())
            }
        }
    }

    fn load(
        &self,
        mesh: &Mesh<'_>,
        tree: KdTree,
        options: &LoadOptions<'_>,
    ) -> Result<Box<dyn Accelerator>, BuildError> {
        let _state = Standard::set();
        let meter = &ProgressMeter::of(options.watch);
        // Each triangle is checked, then prepared.
        meter.begin_stage(Stage::Start, 2 * mesh.len() as u64);
        let wrong = |reason: String| BuildError::WrongMesh { reason };
        validate_mesh_while(&tree.view(), mesh, |triangles| {
            meter.advance(u64::from(triangles));
            !meter.record_work(4096)
        })
        .map_err(|violation| wrong(violation.to_string()))?;
        meter.check()?;
        let mut memory = Memory { limit: options.max_memory, ..Memory::default() };
        memory.take(tree_bytes(&tree.view()))?;
        let mut triangles: Vec<Triangle> = Vec::new();
        memory.grow_watched(&mut triangles, mesh.len(), meter)?;
        let of_piece = |(piece, triangles): (usize, &mut [Triangle])| {
            let mut counts = [0; 2];
            if meter.record_work(triangles.len() as u64) {
                return counts;
            }
            for (i, triangle) in triangles.iter_mut().enumerate() {
                let Prepared { corners, kept, snapped } =
                    prepare(&mesh.triangle(piece * PIECE + i));
                *triangle = corners;
                counts = [counts[0] + u32::from(!kept), counts[1] + u32::from(snapped)];
            }
            meter.advance(triangles.len() as u64);
            counts
        };
        let pieces = triangles.par_chunks_mut(PIECE).enumerate();
        let [dropped, snapped] = pieces.reduce([0; 2], of_piece, |all: &mut [u32; 2], some| {
            *all = [all[0] + some[0], all[1] + some[1]];
        });
        meter.finish_stage();
        meter.check()?;
        let mut summary = BuildSummary::default();
        summary.triangles = mesh.len() as u32;
        (summary.dropped, summary.snapped) = (dropped, snapped);
        summary.peak_bytes = memory.peak;
        begin_layout(meter, &tree.view());
        let mut scratch = LayoutScratch::default();
        let source = LayoutSource { mesh, triangles: &triangles, layout: options.layout };
        let with = (&mut memory, &mut scratch);
        let loaded = CpuAccelerator::new(tree, summary, source, self.set, meter, with)?;
        meter.finish_stage();
        meter.check()?;
        in_box(loaded)
    }

    /// Scenes whose batches are answered by all threads.
    fn build_scene(
        &self,
        scene: &Scene,
        options: &BuildOptions<'_>,
    ) -> Result<Box<dyn SceneAccelerator>, SceneBuildError> {
        let mut build = |mesh: &Mesh<'_>, options: &BuildOptions<'_>| self.build(mesh, options);
        Ok(Box::new(CpuScene::build(scene, options, &mut build, self.set)?))
    }
}

/// An accelerator whose kind the caller need not know.
///
/// # Errors
/// No memory for the box.
fn in_box(accelerator: CpuAccelerator) -> Result<Box<dyn Accelerator>, BuildError> {
    let held = accelerator.bytes();
    match boxed(|| accelerator) {
        Ok(accelerator) => Ok(accelerator),
        Err(_) => Err(BuildError::OutOfMemory { needed: held, limit: held }),
    }
}

/// Triangles that are prepared between two calls of the watch.
const PIECE: usize = 4096;

/// Bytes of nodes and references.
fn tree_bytes(tree: &KdTreeView<'_>) -> u64 {
    (size_of_val(tree.nodes) + size_of_val(tree.references)) as u64
}

/// The layout reads each node and each reference once.
fn begin_layout(meter: &ProgressMeter<'_>, tree: &KdTreeView<'_>) {
    meter.begin_stage(Stage::Layout, (tree.nodes.len() + tree.references.len()) as u64);
}

/// A tree of its own, for which `memory` accounts where needed.
///
/// # Errors
/// Less memory than that, or the end of the work.
fn copied(
    tree: &KdTreeView<'_>,
    memory: &Memory,
    meter: &ProgressMeter<'_>,
) -> Result<KdTree, BuildError> {
    let (mut nodes, mut references) = (Vec::new(), Vec::new());
    memory.reserve(&mut nodes, tree.nodes.len())?;
    memory.reserve(&mut references, tree.references.len())?;
    extend(meter, &mut nodes, tree.nodes);
    extend(meter, &mut references, tree.references);
    meter.check()?;
    let KdTreeView { bounds, triangles, config, .. } = *tree;
    Ok(KdTree { nodes, references, bounds, triangles, config })
}
