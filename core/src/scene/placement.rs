//! An instance where it is: its space, its box, and how its geometry is asked.

use super::description::Instance;
use super::outline::Outline;
use super::transform::{Defect, ObjectSpace};
use super::world_box::WorldBox;
use crate::aabb::Aabb;
use crate::ray::Culling;

/// What queries need of an instance. What a ray that enters it reads is in one cache line: the inverse, the geometry, the mask, and culling.
#[repr(C, align(64))]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placement {
    /// The way into the object's space.
    pub space: ObjectSpace,
    /// The instance as described.
    pub instance: Instance,
    /// The geometry's box, in the object's space.
    pub bounds: Aabb,
    /// The box in the world; `None` for an instance of a geometry without triangles, which nothing enters.
    pub world_box: Option<WorldBox>,
    /// Whether each number of the way into the object's space is 0 or at least [`LEAST_OF_WAY`] in magnitude. For rays whose numbers are 0
    /// or at least [`LEAST_OF_RAY`], products are then 0 or at least 2^-102, multiples of 2^-125, and so are all sums of
    /// them: none is snapped, but for the sign of zeros.
    pub ordinary: bool,
}

/// See [`Placement::ordinary`]: 2^-62.
pub const LEAST_OF_WAY: f32 = 2.168_404_3e-19;
/// See [`Placement::ordinary`]: 2^-40.
pub const LEAST_OF_RAY: f32 = 9.094_947e-13;

impl Placement {
    /// An instance with its space, of a geometry with these bounds and this outline.
    pub fn new(
        instance: &Instance,
        space: ObjectSpace,
        bounds: &Aabb,
        outline: Option<&Outline>,
    ) -> Placement {
        let defect = space.defect(&instance.transform);
        Placement::with_defect(instance, (space, &defect), bounds, outline)
    }

    /// The same where the space's defect is known.
    pub(crate) fn with_defect(
        instance: &Instance,
        (space, defect): (ObjectSpace, &Defect),
        bounds: &Aabb,
        outline: Option<&Outline>,
    ) -> Placement {
        let of_triangles = (&space, defect);
        let world_box = WorldBox::with_defect(&instance.transform, of_triangles, bounds, outline);
        Placement::with_box(instance, space, bounds, world_box)
    }

    /// The same of a geometry of shapes, whose outside is where it is: a reflection does not exchange their sides.
    pub fn of_shapes(instance: &Instance, space: ObjectSpace, bounds: &Aabb) -> Placement {
        let world_box = WorldBox::of_shapes(&instance.transform, &space, bounds);
        let space = ObjectSpace { mirrored: false, ..space };
        Placement::with_box(instance, space, bounds, world_box)
    }

    fn with_box(
        instance: &Instance,
        space: ObjectSpace,
        bounds: &Aabb,
        world_box: Option<WorldBox>,
    ) -> Placement {
        let mut ordinary = true;
        for row in &space.inverse {
            for number in row {
                ordinary &= (number.abs() >= LEAST_OF_WAY) | (*number == 0.0);
            }
        }
        Placement { instance: *instance, space, bounds: *bounds, world_box, ordinary }
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
