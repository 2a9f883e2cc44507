//! What should be in a scene.

use std::collections::{BTreeMap, BTreeSet};

use splitplane_core::scene::{Instance, Scene};

/// A triangle's corners.
pub(super) type Corners = [[f32; 3]; 3];

/// What should be there.
#[derive(Clone, Default)]
pub(super) struct Model {
    /// Triangles; none for shapes.
    pub(super) geometries: BTreeMap<u32, Vec<Corners>>,
    /// Those that consist of shapes.
    pub(super) shapes: BTreeSet<u32>,
    /// Those that have an opacity mask.
    pub(super) masked: BTreeSet<u32>,
    pub(super) instances: BTreeMap<u32, Instance>,
    /// Whether instances came or went since the last update.
    pub(super) other_instances: bool,
}

impl Model {
    pub(super) fn is_mesh(&self, name: u32) -> bool {
        self.geometries.contains_key(&name) && !self.shapes.contains(&name)
    }

    pub(super) fn check(&self, scene: &Scene) {
        let instances: Vec<_> = scene.instances().map(|(name, own)| (name.0, *own)).collect();
        let expected: Vec<_> = self.instances.iter().map(|(&name, &own)| (name, own)).collect();
        assert_eq!(instances, expected);
        assert_eq!(scene.len(), expected.len());
        let geometries: Vec<u32> = scene.geometries().map(|(name, _)| name.0).collect();
        assert_eq!(geometries, self.geometries.keys().copied().collect::<Vec<_>>());
        for ((name, own), expected) in scene.geometries().zip(self.geometries.values()) {
            assert_eq!(own.shapes().is_some(), self.shapes.contains(&name.0));
            assert_eq!(scene.opacity(name).unwrap().is_some(), self.masked.contains(&name.0));
            let mesh = own.mesh();
            assert_eq!(mesh.len(), expected.len());
            for (triangle, corners) in expected.iter().enumerate() {
                let own = mesh.triangle(triangle);
                let pairs = own.iter().flatten().zip(corners.iter().flatten());
                // Which bits a NaN has that comes from arithmetic, nobody says.
                let same =
                    |(a, b): (&f32, &f32)| a.to_bits() == b.to_bits() || a.is_nan() && b.is_nan();
                assert!(pairs.clone().all(same), "geometry {}: {own:?} {corners:?}", name.0);
            }
        }
    }
}
