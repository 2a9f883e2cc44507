//! An instance where it is: its space, its box, and how its geometry is asked.

use super::description::Instance;
use super::outline::Outline;
use super::transform::ObjectSpace;
use super::world_box::WorldBox;
use crate::aabb::Aabb;
use crate::ray::Culling;

/// What queries need of an instance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placement {
    /// The instance as described.
    pub instance: Instance,
    /// The way into the object's space.
    pub space: ObjectSpace,
    /// The geometry's box, in the object's space.
    pub bounds: Aabb,
    /// The box in the world; `None` for an instance of a geometry without triangles, which nothing enters.
    pub world_box: Option<WorldBox>,
}

impl Placement {
    /// An instance with its space, of a geometry with these bounds and this outline.
    pub fn new(
        instance: &Instance,
        space: ObjectSpace,
        bounds: &Aabb,
        outline: Option<&Outline>,
    ) -> Placement {
        let world_box = WorldBox::new(&instance.transform, &space, bounds, outline);
        Placement { instance: *instance, space, bounds: *bounds, world_box }
    }

    /// The same of a geometry of shapes, whose outside is where it is: a reflection does not exchange their sides.
    pub fn of_shapes(instance: &Instance, space: ObjectSpace, bounds: &Aabb) -> Placement {
        let world_box = WorldBox::of_shapes(&instance.transform, &space, bounds);
        let space = ObjectSpace { mirrored: false, ..space };
        Placement { instance: *instance, space, bounds: *bounds, world_box }
    }

    /// The side of triangles, as the object sees them, that is ignored: by the query, and by the instance. A reflection
    /// exchanges the sides. `None` where both are.
    #[inline]
    pub fn culling(&self, query: Culling) -> Option<Culling> {
        let culling = match (query, self.instance.culling) {
            (one, Culling::None) | (Culling::None, one) => one,
            (one, other) if one == other => one,
            _ => return None,
        };
        Some(match culling {
            Culling::Back if self.space.mirrored => Culling::Front,
            Culling::Front if self.space.mirrored => Culling::Back,
            culling => culling,
        })
    }

    /// Whether rays of this mask enter the instance.
    #[inline]
    pub fn answers(&self, ray_mask: u32) -> bool {
        self.instance.mask & ray_mask != 0
    }
}
