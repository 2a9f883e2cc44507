//! The name of a scene.

use super::description::Instance;
use super::hit::{GeometryId, InstanceId};
use super::opacity::OpacityMask;
use super::transform::Transform;
use crate::tree::digest::{Digest, Xxh64};

/// Names a scene: its geometries' trees, and all instances with their transforms and inverses, masks, numbers and
/// culling. The tree over the instances is not part of it, since no hit depends on that.
///
/// XXH64 with seed 1 over 32-bit words: for each geometry its name and the digest of its tree or shapes, and where it has an opacity mask
/// `u32::MAX`, the mask's level and its words; then for each instance its
/// name, geometry, mask, number, culling, transform and inverse; both in the order of names.
pub(crate) struct SceneDigest(Xxh64);

impl SceneDigest {
    pub(crate) const fn new() -> SceneDigest {
        SceneDigest(Xxh64::new(1))
    }

    pub(crate) fn geometry(
        &mut self,
        name: GeometryId,
        Digest(tree): Digest,
        opacity: Option<&OpacityMask>,
    ) {
        self.0.write_words(&[name.0, tree as u32, (tree >> 32) as u32]);
        if let Some(mask) = opacity {
            self.0.write_words(&[u32::MAX, mask.level()]);
            self.0.write_words(mask.words());
        }
    }

    pub(crate) fn instance(&mut self, name: InstanceId, instance: &Instance, inverse: &Transform) {
        let Instance { geometry, transform, mask, id, culling } = instance;
        self.0.write_words(&[name.0, geometry.0, *mask, *id, *culling as u32]);
        for rows in [transform, inverse] {
            rows.iter().for_each(|row| self.0.write_words(&row.map(f32::to_bits)));
        }
    }

    pub(crate) fn finish(&self) -> Digest {
        Digest(self.0.finish())
    }
}
