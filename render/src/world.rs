//! Where kernels find the triangle that a ray met: in one mesh, or in the instances of a scene.

use crate::plane::Plane;
use crate::scene_data::instances::{InstanceTable, Shown};
use crate::scene_data::{NONE, RoundPlace};
use crate::scene_words::SceneWords;
use crate::vector::Vector;
use splitplane_core::mesh::Mesh;
use splitplane_core::query::traverse::Triangles;
use splitplane_core::ray::{Hit, Ray};
use splitplane_core::triangle::Triangle;

/// Names a triangle of what is shown.
#[derive(Clone, Copy)]
pub(crate) struct Spot {
    /// The triangle, by its number in its mesh.
    pub(crate) triangle: u32,
    /// The instance; 0 in one mesh.
    pub(crate) instance: u32,
}

/// What is shown. `Copy`, since it is some references.
pub(crate) trait World: Copy + Sync {
    /// The number by which the appearance knows a triangle.
    fn described(&self, at: Spot) -> u32;

    /// The corners in the world, and their plane.
    fn plane(&self, at: Spot) -> (Triangle, Plane);

    /// The corners of a triangle of which nothing but corners is needed: of one mesh. `None` for instances.
    fn corners_alone(&self, triangle: u32) -> Option<Triangle>;

    /// The place of a hit with a shape, which has no corners; `None` for a triangle.
    fn round(&self, ray: &Ray, hit: (&Hit, u32)) -> Option<RoundPlace>;

    /// A point of a shape that shines, drawn by two numbers; `None` for a triangle.
    fn point_of_shape(&self, at: Spot, numbers: [f32; 2]) -> Option<RoundPlace>;

    /// The material of a triangle, or of a shape.
    fn material(&self, scene: &SceneWords<'_>, at: Spot) -> u32;

    /// The direction of a normal of an instance in the world.
    fn normal(&self, normal: Vector, instance: u32) -> Vector;

    /// Whether fronts of an instance are seen as backs.
    fn mirrored(&self, instance: u32) -> bool;
}

/// One mesh, where it is.
#[derive(Clone, Copy)]
pub(crate) struct OneMesh<'a>(pub(crate) Mesh<'a>);

impl World for OneMesh<'_> {
    fn described(&self, at: Spot) -> u32 {
        at.triangle
    }

    fn plane(&self, at: Spot) -> (Triangle, Plane) {
        let corners = self.0.corners(at.triangle);
        (corners, Plane::of(&corners))
    }

    #[inline]
    fn corners_alone(&self, triangle: u32) -> Option<Triangle> {
        Some(self.0.corners(triangle))
    }

    #[inline]
    fn round(&self, _ray: &Ray, _hit: (&Hit, u32)) -> Option<RoundPlace> {
        None
    }

    #[inline]
    fn point_of_shape(&self, _at: Spot, _numbers: [f32; 2]) -> Option<RoundPlace> {
        None
    }

    fn material(&self, scene: &SceneWords<'_>, at: Spot) -> u32 {
        scene.material_of(at.triangle)
    }

    fn normal(&self, normal: Vector, _instance: u32) -> Vector {
        normal
    }

    fn mirrored(&self, _instance: u32) -> bool {
        false
    }
}

/// The instances of a scene, over the triangles of all its geometries.
#[derive(Clone, Copy)]
pub(crate) struct Instances<'a> {
    pub(crate) mesh: Mesh<'a>,
    pub(crate) table: &'a InstanceTable,
}

impl World for Instances<'_> {
    fn described(&self, at: Spot) -> u32 {
        at.triangle + self.table.shown(at.instance).map_or(0, |shown| shown.first_triangle)
    }

    fn plane(&self, at: Spot) -> (Triangle, Plane) {
        let corners = self.mesh.corners(self.described(at));
        let Some(shown) = self.table.shown(at.instance) else {
            return (corners, Plane::of(&corners));
        };
        let (corners, reach) = shown.in_world(&corners);
        let plane = Plane::of(&corners);
        // The ray is rounded on its way into the object's space too: by units of what went into the corners.
        (corners, plane.within_reach(reach * shown.stretch()))
    }

    fn corners_alone(&self, _triangle: u32) -> Option<Triangle> {
        None
    }

    fn round(&self, ray: &Ray, (hit, instance): (&Hit, u32)) -> Option<RoundPlace> {
        self.table.round(ray, hit, instance)
    }

    fn point_of_shape(&self, at: Spot, numbers: [f32; 2]) -> Option<RoundPlace> {
        self.table.sample(at.triangle, at.instance, numbers)
    }

    fn material(&self, scene: &SceneWords<'_>, at: Spot) -> u32 {
        let shown = self.table.shown(at.instance);
        match shown.map(|shown| shown.material) {
            Some(NONE) if shown.is_some_and(Shown::has_shapes) => 0,
            None | Some(NONE) => scene.material_of(self.described(at)),
            Some(material) => material.min(scene.frame.materials - 1),
        }
    }

    fn normal(&self, normal: Vector, instance: u32) -> Vector {
        self.table.shown(instance).map_or(normal, |shown| shown.normal_in_world(normal))
    }

    fn mirrored(&self, instance: u32) -> bool {
        self.table.shown(instance).is_some_and(|shown| shown.mirrored)
    }
}
