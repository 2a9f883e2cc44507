//! Makes the arrays of a packed scene from a scene that is built.

use super::piece::PackedPiece;
use super::places::PackedPlaces;
use super::sizes::{PackedSizes, SHAPES_A_BLOCK, SHARED, Unpackable};
use super::{
    ALWAYS, BOX_COORDINATE_MOST, MIRRORED, PackedInstance, PackedScene, PackedTopNode, SHAPES,
    ShapeBlock,
};
use crate::backend::scene::built::{BuiltGeometry, BuiltScene};
use crate::layout::{SceneUniform, culling_bits};
use crate::scene::shape::Shapes;
use crate::scene::{
    GeometryId, InstanceId, Placement, ShapeTree, TOP_INSTANCE, TOP_NONE, TOP_WIDTH, TopNode,
};
use crate::tree::node::{KdNode, NodeKind};
use crate::triangle::prepare;

impl BuiltScene {
    /// How long the arrays of the packed scene are.
    pub fn packed_sizes(&self) -> PackedSizes {
        let own = PackedSizes {
            top_nodes: self.top.nodes().len(),
            instances: self.placements.len(),
            ..PackedSizes::default()
        };
        self.geometries().fold(own, |sizes, (_, geometry)| sizes.and(geometry, geometry.opacity()))
    }

    /// The whole scene as a device holds it, one geometry behind the other in the order of their names.
    ///
    /// # Errors
    /// No memory, more than can be named, or something that only the host answers.
    pub fn packed(&self) -> Result<PackedScene, Unpackable> {
        if let Some(reason) = self.host_only() {
            return Err(Unpackable::HostOnly(reason));
        }
        let sizes = self.packed_sizes();
        sizes.check()?;
        let mut packed = PackedScene::default();
        packed.reserve(&sizes)?;
        for (_, geometry) in self.geometries() {
            packed.append(geometry, packed.lengths());
        }
        self.pack_instances(&mut packed, &PackedPlaces::of(self)?)?;
        Ok(packed)
    }

    /// What a geometry has of the shared arrays, for the places that are given.
    ///
    /// # Errors
    /// No memory, a geometry that the scene does not have, or one that has no place of its size.
    pub fn packed_piece(
        &self,
        geometry: GeometryId,
        places: &PackedPlaces,
    ) -> Result<PackedPiece, Unpackable> {
        let missing = Unpackable::NoPlace { geometry: geometry.0 };
        let own = self.geometry(geometry).ok_or(missing)?;
        let sizes = PackedSizes::default().and(own, own.opacity());
        let firsts = places.firsts(geometry).ok_or(missing)?;
        if places.counts(geometry) != Some(sizes.shared()) {
            return Err(missing);
        }
        let mut arrays = PackedScene::default();
        arrays.reserve(&sizes)?;
        arrays.append(own, firsts);
        Ok(PackedPiece { firsts, arrays })
    }

    /// Makes the tree over instances and the instances of a packed scene anew: all that depends on where instances are, and on where geometries lie.
    ///
    /// # Errors
    /// As for [`BuiltScene::packed`].
    pub fn pack_instances(
        &self,
        packed: &mut PackedScene,
        places: &PackedPlaces,
    ) -> Result<(), Unpackable> {
        let sizes = self.packed_sizes();
        sizes.check()?;
        let needed = sizes.bytes()[..2].iter().sum();
        let lacking = |_| Unpackable::Memory { needed };
        packed.box_nodes.clear();
        packed.box_nodes.try_reserve_exact(sizes.top_nodes).map_err(lacking)?;
        packed.box_nodes.extend(self.top.nodes().iter().map(PackedTopNode::from));
        packed.instances.clear();
        packed.instances.try_reserve_exact(sizes.instances).map_err(lacking)?;
        packed.instances.extend((0..sizes.instances as u32).map(|name| {
            let placement = self.placement(InstanceId(name));
            placement.and_then(|own| self.packed_instance(own, places)).unwrap_or(NOWHERE)
        }));
        Ok(())
    }

    fn packed_instance(&self, own: &Placement, places: &PackedPlaces) -> Option<PackedInstance> {
        let name: GeometryId = own.instance.geometry;
        let geometry = self.geometry(name)?;
        let firsts = places.firsts(name)?;
        let [root, reference, first_triangle, block] = firsts.map(|first| first as u32);
        let behind = reference + geometry.accelerator.tree().references.len() as u32;
        let shapes = geometry.shapes().map(|own| own.tree().nodes().len()).filter(|own| *own > 0);
        let scale = SceneUniform::from(geometry.scale());
        let mirrored = if own.space.mirrored { MIRRORED } else { 0 };
        Some(PackedInstance {
            inverse: own.space.inverse,
            mask: own.instance.mask,
            sides: name.0 << 3 | mirrored | culling_bits(own.instance.culling),
            root,
            first_triangle: shapes.map_or(first_triangle, |nodes| block + nodes as u32),
            lo: scale.lo,
            slack: scale.slack,
            hi: scale.hi,
            wide: scale.wide,
            near_lo: scale.near_lo,
            // Behind references: a geometry without any has no hits.
            opacity: match shapes {
                Some(_) => SHAPES | block,
                None => geometry.opacity().map_or(0, |_| behind),
            },
            near_hi: scale.near_hi,
            origin_least: scale.origin_least,
        })
    }
}

/// What no ray enters.
const NOWHERE: PackedInstance = PackedInstance {
    inverse: [[0.0; 4]; 3],
    mask: 0,
    sides: 0,
    root: 0,
    first_triangle: 0,
    lo: [0.0; 3],
    slack: 0.0,
    hi: [0.0; 3],
    wide: 0,
    near_lo: [0.0; 3],
    opacity: 0,
    near_hi: [0.0; 3],
    origin_least: 0.0,
};

impl PackedScene {
    /// How long the arrays that geometries share are.
    pub(super) fn lengths(&self) -> [usize; SHARED] {
        [self.nodes.len(), self.references.len(), self.triangles.len(), self.shapes.len()]
    }

    /// Makes room in these arrays.
    fn reserve(&mut self, sizes: &PackedSizes) -> Result<(), Unpackable> {
        let needed = sizes.bytes()[2..].iter().sum();
        let lacking = |_| Unpackable::Memory { needed };
        self.nodes.try_reserve_exact(sizes.nodes).map_err(lacking)?;
        self.references.try_reserve_exact(sizes.references).map_err(lacking)?;
        self.triangles.try_reserve_exact(sizes.triangles).map_err(lacking)?;
        self.shapes.try_reserve_exact(sizes.shapes).map_err(lacking)
    }

    /// Adds a geometry behind what is there, as it is where it begins at these places; there is room for it.
    fn append(&mut self, geometry: &BuiltGeometry, firsts: [usize; SHARED]) {
        let tree = geometry.accelerator.tree();
        let [node, reference, triangle, block] = firsts.map(|first| first as u32);
        self.nodes.extend(tree.nodes.iter().map(|own| match own.kind() {
            NodeKind::Interior { right, .. } => own.with_right(node + right),
            NodeKind::Leaf { first, count } => KdNode::leaf(reference + first, count),
        }));
        self.references.extend(tree.references.iter().map(|own| triangle + own));
        if let Some(mask) = geometry.opacity() {
            // Who traces looks for the cell of a triangle without asking whether there is one.
            debug_assert_eq!(mask.triangles() as usize, geometry.mesh.mesh().len());
            self.references.extend([mask.level(), triangle]);
            self.references.extend(mask.words());
        }
        if let Some(own) = geometry.shapes() {
            self.append_shapes(own, block);
        }
        let mesh = geometry.mesh.mesh();
        self.triangles.extend((0..mesh.len()).map(|own| prepare(&mesh.triangle(own)).corners));
    }
}

impl PackedScene {
    /// The same of a set of shapes.
    fn append_shapes(&mut self, set: &ShapeTree, root: u32) {
        self.shapes.extend(set.tree().nodes().iter().map(|node| {
            let mut packed = PackedTopNode::from(node);
            for child in &mut packed.children {
                if *child & TOP_INSTANCE == 0 {
                    *child += root;
                }
            }
            bytemuck::cast::<_, ShapeBlock>(packed)
        }));
        let count = set.shapes().len();
        for first in (0..count).step_by(SHAPES_A_BLOCK) {
            let mut block: ShapeBlock = [0; 64];
            for (number, to) in (first..count).zip(block.chunks_exact_mut(8)) {
                let (ends, radius) = match set.shapes() {
                    Shapes::Spheres(all) => ([all[number].centre; 2], all[number].radius),
                    Shapes::Capsules(all) => (all[number].ends, all[number].radius),
                    Shapes::Own(_) => continue,
                };
                to[..3].copy_from_slice(&ends[0].map(f32::to_bits));
                to[3] = radius.to_bits();
                to[4..7].copy_from_slice(&ends[1].map(f32::to_bits));
            }
            self.shapes.push(block);
        }
    }
}

impl From<&TopNode> for PackedTopNode {
    fn from(node: &TopNode) -> PackedTopNode {
        let TopNode { lo, hi, reach, children } = *node;
        let mut packed = PackedTopNode { lo, hi, reach, children };
        for slot in 0..TOP_WIDTH {
            let none = children[slot] == TOP_NONE;
            let within = |sides: &[[f32; TOP_WIDTH]; 3]| {
                (0..3).all(|axis| sides[axis][slot].abs() <= BOX_COORDINATE_MOST)
            };
            if !none && within(&lo) && within(&hi) {
                continue;
            }
            for axis in 0..3 {
                (packed.lo[axis][slot], packed.hi[axis][slot]) = (0.0, 0.0);
            }
            packed.reach[slot] = 0.0;
            if !none {
                packed.children[slot] |= ALWAYS;
            }
        }
        packed
    }
}
