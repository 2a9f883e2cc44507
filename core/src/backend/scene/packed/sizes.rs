//! How long the arrays of a packed scene are.

use super::{MOST_TOP_NODES, PackedInstance, PackedTopNode, SHAPES, ShapeBlock};
use crate::backend::scene::built::BuiltGeometry;
use crate::scene::{GeometryId, OpacityMask};
use crate::tree::node::KdNode;
use crate::watch::Progress;

/// Arrays that geometries share: nodes, references, triangles, blocks of shapes.
pub(super) const SHARED: usize = 4;

/// Words of a packed opacity mask before those of its cells: its level, and the first triangle.
pub(super) const OPACITY_HEAD: usize = 2;

/// Shapes of a block.
pub(super) const SHAPES_A_BLOCK: usize = 8;

/// Why a scene has no packed form.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Unpackable {
    /// The system has no memory for the arrays.
    Memory {
        /// Bytes of all of them.
        needed: u64,
    },
    /// A geometry that is not in the scene, or whose place is not of its size.
    NoPlace {
        /// Its name.
        geometry: u32,
    },
    /// Something that only the host answers; see [`BuiltScene::host_only`](super::super::BuiltScene::host_only).
    HostOnly(&'static str),
    /// A watch cancelled the work.
    Cancelled {
        /// How far it got.
        progress: Progress,
    },
    /// More nodes, references or top nodes than places can be named.
    TooMany {
        /// What there are too many of.
        what: &'static str,
        /// How many there are.
        count: u64,
        /// How many there may be.
        most: u64,
    },
}

/// How long the arrays of a packed scene are.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PackedSizes {
    /// Nodes of the tree over instances.
    pub top_nodes: usize,
    /// Names of instances.
    pub instances: usize,
    /// Nodes of all geometries.
    pub nodes: usize,
    /// References of all geometries, and the words of their opacity masks, which lie among them.
    pub references: usize,
    /// Triangles of all geometries, those dropped included.
    pub triangles: usize,
    /// Blocks of all sets of shapes.
    pub shapes: usize,
}

impl PackedSizes {
    /// Bytes of each array: nodes of the tree over instances, instances, nodes, references, corners, shapes.
    pub fn bytes(&self) -> [u64; 6] {
        [
            (self.top_nodes * size_of::<PackedTopNode>()) as u64,
            (self.instances * size_of::<PackedInstance>()) as u64,
            (self.nodes * size_of::<KdNode>()) as u64,
            4 * self.references as u64,
            36 * self.triangles as u64,
            (self.shapes * size_of::<ShapeBlock>()) as u64,
        ]
    }

    /// Of the arrays that geometries share.
    pub(super) fn shared(&self) -> [usize; SHARED] {
        [self.nodes, self.references, self.triangles, self.shapes]
    }

    /// With a geometry more, which has this opacity mask.
    #[must_use]
    pub(in crate::backend::scene) fn and(
        mut self,
        geometry: &BuiltGeometry,
        opacity: Option<&OpacityMask>,
    ) -> PackedSizes {
        let tree = geometry.accelerator.tree();
        self.nodes += tree.nodes.len();
        self.references +=
            tree.references.len() + opacity.map_or(0, |mask| OPACITY_HEAD + mask.words().len());
        self.triangles += tree.triangles as usize;
        if let Some(own) = geometry.shapes() {
            self.shapes += own.tree().nodes().len() + own.shapes().len().div_ceil(SHAPES_A_BLOCK);
        }
        self
    }

    pub(super) fn check(&self) -> Result<(), Unpackable> {
        let most = [
            ("nodes of geometries", self.nodes, KdNode::MAX_INDEX as usize),
            ("references of geometries", self.references, SHAPES as usize - 1),
            ("triangles of geometries", self.triangles, u32::MAX as usize / 16),
            ("nodes of the tree over instances", self.top_nodes, MOST_TOP_NODES),
            ("blocks of shapes", self.shapes, MOST_TOP_NODES),
        ];
        for (what, count, most) in most {
            if count > most {
                let (count, most) = (count as u64, most as u64);
                return Err(Unpackable::TooMany { what, count, most });
            }
        }
        Ok(())
    }
}

/// A geometry that an update makes, replaces, gives another opacity mask, or drops.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct GeometryChange {
    /// Which.
    pub geometry: GeometryId,
    /// What it is going to have of the arrays of the packed scene; `None` for one that is dropped.
    pub sizes: Option<PackedSizes>,
}
