//! The end of a build: what came back is a tree, or says what must be submitted yet.

use splitplane_core::error::BuildError;
use splitplane_core::kernel::{Buffer, Counter, Overflow};
use splitplane_core::layout::LargeNode;
use splitplane_core::query::intersect::Limits;
use splitplane_core::report::BuildSummary;
use splitplane_core::tree::KdTree;
use splitplane_core::tree::node::KdNode;

use super::{Effort, PendingBuild};
use crate::builder::buffers::readback;
use crate::builder::executor::counters_from;
use crate::builder::middle_stage::MiddleStage;
use crate::builder::shared::Pooled;
use crate::device::host;
use crate::device::profile::KernelTime;
use crate::error::GpuError;
use crate::query::limits::limits_from;
use crate::query::{DeviceTree, TreeParts};

/// A finished build: the tree on the device, and what the host knows of it.
#[derive(Debug)]
#[non_exhaustive]
pub struct DeviceBuild {
    /// The tree, ready for rays.
    pub tree: DeviceTree,
    /// What the build dropped, changed and took.
    pub summary: BuildSummary,
    /// The device work that it took.
    pub effort: Effort,
    /// The time of each kernel, if requested and if the device has timestamps.
    pub times: Option<Vec<KernelTime>>,
    /// The tree in host memory, where the host wanted it.
    pub(crate) host_tree: Option<KdTree>,
}

impl PendingBuild {
    /// Reads what came back: the build is done, or must be repeated.
    pub(super) fn look(&mut self) -> Result<Option<DeviceBuild>, BuildError> {
        self.effort.readbacks += 1;
        let config = self.options.config;
        let readback = self.buffers.as_ref().expect("until finished").readback.clone();
        let refused = |error: wgpu::MapRangeError| GpuError::Refused(error.to_string());
        // Where the host wants no tree, no more than the head was copied.
        let copied = if self.tree_to_host { readback.size() } else { readback::TREE };
        self.shared.gpu.note_readback(copied);
        let head = readback.get_mapped_range(..readback::TREE).map_err(refused)?.to_vec();
        let counters = counters_from(&head, self.swapped);
        if counters[Counter::Overflow] & Overflow::Unfinished as u32 != 0 {
            return Err(GpuError::Unfinished { what: "the scene".into() }.into());
        }
        if counters[Counter::Overflow] & Overflow::MiddleStage as u32 != 0 {
            readback.unmap();
            self.capacities = self.capacities.without_middle_stage();
            self.effort.middle_stage = MiddleStage::Void;
            self.reserve(None)?;
            self.effort.repeats += 1;
            self.begin(config.max_depth + 1)?;
            return Ok(None);
        }
        if counters[Counter::Overflow] != 0 {
            readback.unmap();
            let grown = self.capacities.grown(&counters, &config, self.shared.gpu.limits());
            self.capacities = grown;
            self.reserve(Some(&grown))?;
            self.effort.repeats += 1;
            self.begin(config.max_depth + 1)?;
            return Ok(None);
        }
        if counters[Counter::ActiveNodes] > 0 {
            readback.unmap();
            self.spare_levels = LEVELS_TO_SPARE;
            self.record(config.max_depth + 1, false)?;
            return Ok(None);
        }
        let (nodes, references) = (counters[Counter::Nodes], counters[Counter::LeafReferences]);
        if nodes > KdNode::MAX_INDEX {
            let (nodes, references) = (u64::from(nodes), u64::from(references));
            return Err(BuildError::TooLarge { nodes, references });
        }
        let root_at = readback::ROOT as usize;
        let root: LargeNode = bytemuck::pod_read_unaligned(&head[root_at..root_at + 64]);
        let bounds = root.cell();
        let triangles = self.capacities.triangles;
        let host_tree = if self.tree_to_host {
            let nodes_end = readback::TREE + 8 * u64::from(nodes);
            let at = readback::TREE + self.capacities.bytes_of(Buffer::Nodes);
            let view = |from: u64, to: u64| readback.get_mapped_range(from..to).map_err(refused);
            let nodes = host::copied(&view(readback::TREE, nodes_end)?)?;
            let references = match references {
                0 => Vec::new(),
                _ => host::copied(&view(at, at + 4 * u64::from(references))?)?,
            };
            Some(KdTree { nodes, references, bounds, triangles, config })
        } else {
            None
        };
        readback.unmap();
        let times = match &self.profile {
            Some(profile) => Some(profile.read(&self.shared.gpu)?),
            None => None,
        };
        let peak_bytes = self.needed_bytes();
        let mut buffers = self.buffers.take().expect("until finished");
        let mut summary = BuildSummary::default();
        summary.triangles = triangles;
        summary.dropped = counters[Counter::Dropped];
        summary.snapped = counters[Counter::Snapped];
        summary.large_levels = counters[Counter::Levels].max(counters[Counter::MiddleLevels]);
        summary.small_roots = counters[Counter::SmallRoots];
        summary.peak_bytes = peak_bytes;
        let parts = TreeParts {
            nodes: buffers.take(Buffer::Nodes),
            leaf_references: buffers.take(Buffer::LeafReferences),
            triangles: buffers.take(Buffer::Triangles),
            node_count: nodes,
            reference_count: references,
            triangle_count: triangles,
            bounds,
            config,
        };
        let limits = match triangles {
            0 => Limits::NONE,
            _ => limits_from(&head[readback::LIMITS as usize..]),
        };
        let scene = buffers.scene.take();
        self.shared.keep_buffers(Pooled {
            buffers,
            capacities: self.capacities,
            triangles,
            config,
            levels: counters[Counter::Levels],
            middle_was_void: self.middle_was_void(),
            spare_levels: self.spare_levels,
        });
        let tree = DeviceTree::with_limits(&self.shared.queries, parts, &limits, scene)?;
        let effort = self.effort;
        Ok(Some(DeviceBuild { tree, summary, effort, times, host_tree }))
    }
}

/// Levels recorded beyond those of the last such build of as many triangles once these turned out to be too few: the scene moves,
/// and moving scenes change their levels little from frame to frame.
const LEVELS_TO_SPARE: u32 = 1;
