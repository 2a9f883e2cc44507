//! What frames read of the instances of a scene: where each is, which triangles it shows, and in which material.

mod changes;

pub(crate) use changes::Changed;

use super::round::{self, RoundPlace, Ways};
use super::{AppearanceError, NONE};
use crate::vector::{Vector, greatest};
use changes::Lines;
use splitplane_core::aabb::Aabb;
use splitplane_core::arithmetic::{Arithmetic, Strict, snap};
use splitplane_core::backend::scene::BuiltScene;
use splitplane_core::ray::{Hit, Ray};
use splitplane_core::scene::{Changes, GeometryMesh, Placement, Transform};
use splitplane_core::triangle::Triangle;
use std::sync::Arc;

/// How a scene of instances looks, besides what its [`Appearance`](crate::Appearance) says of the triangles of all its
/// geometries, one after the other.
#[derive(Clone, Copy, Debug, Default)]
pub struct Geometries<'a> {
    /// For every geometry, by its name, the number of its first triangle among those of all; of shapes any number.
    pub first_triangles: &'a [u32],
    /// For every instance, by its name, the material of all of it; [`NONE`] for those of its triangles, and for shapes that of number 0.
    /// May be shorter than the list of instances.
    pub materials: &'a [u32],
}

/// An instance, as kernels see it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Shown {
    transform: Transform,
    /// From the world to the object.
    inverse: Transform,
    /// Its shapes among those of the table, or [`NONE`] for triangles.
    shapes: u32,
    /// The number of its geometry's first triangle among those of all.
    pub(crate) first_triangle: u32,
    pub(crate) triangles: u32,
    /// The material of all of it, or [`NONE`].
    pub(crate) material: u32,
    /// Whether the transform is a reflection.
    pub(crate) mirrored: bool,
    /// The greatest row of |transform| |inverse| 1, without translations: how much larger roundings in the object's space are in the
    /// world. 1 where axes go to axes.
    stretch: f32,
}

/// The instances of a scene by their names, for kernels.
#[derive(Clone, Debug, Default)]
pub struct InstanceTable {
    rows: Vec<Option<Shown>>,
    /// The geometries that consist of shapes.
    shapes: Vec<Arc<GeometryMesh>>,
    /// Of which geometries the rows were written.
    lines: Lines,
    /// By the name of an instance the material of all of it, as given.
    materials: Vec<u32>,
}

impl Shown {
    fn new(
        placement: &Placement,
        (first_triangle, triangles): (u32, u32),
        shapes: u32,
        material: u32,
    ) -> Shown {
        let (transform, space) = (placement.instance.transform, placement.space);
        let row = |row: usize| {
            let part = |column: usize| -> f64 {
                let product = |k: usize| {
                    (f64::from(transform[row][k]) * f64::from(space.inverse[k][column])).abs()
                };
                (product(0) + product(1)) + product(2)
            };
            (part(0) + part(1)) + part(2)
        };
        let stretch = row(0).max(row(1)).max(row(2)) as f32;
        let (inverse, mirrored) = (space.inverse, space.mirrored);
        Shown { transform, inverse, shapes, first_triangle, triangles, material, mirrored, stretch }
    }

    /// The corners in the world, and the greatest magnitude that went into a coordinate: sums of
    /// magnitudes of their terms. Each product and sum is guarded and snapped, `((m0 x + m1 y) + m2 z) + m3`.
    pub(crate) fn in_world(&self, corners: &Triangle) -> (Triangle, f32) {
        let mut world = [[0.0; 3]; 3];
        let mut reach = 0.0f32;
        for (to, corner) in world.iter_mut().zip(corners) {
            let [x, y, z] = corner.map(snap);
            for (to, [m0, m1, m2, m3]) in to.iter_mut().zip(&self.transform) {
                let [a, b, c] = [
                    Strict::snapped_product(*m0, x),
                    Strict::snapped_product(*m1, y),
                    Strict::snapped_product(*m2, z),
                ];
                let sum = |a, b, c, d| {
                    Strict::snapped_sum(Strict::snapped_sum(Strict::snapped_sum(a, b), c), d)
                };
                *to = sum(a, b, c, snap(*m3));
                reach = reach.max(sum(a.abs(), b.abs(), c.abs(), m3.abs()));
            }
        }
        (world, reach)
    }

    /// A box in the world around one of the object's; nothing around nothing.
    pub(crate) fn box_in_world(&self, bounds: &Aabb) -> Aabb {
        if bounds.is_empty() {
            return Aabb::EMPTY;
        }
        let ends = [bounds.lo, bounds.hi];
        let corner = |i: usize| [ends[i & 1][0], ends[i >> 1 & 1][1], ends[i >> 2][2]];
        let four = |first: usize| {
            let (three, _) = self.in_world(&[0, 1, 2].map(|i| corner(first + i)));
            let (last, _) = self.in_world(&[corner(first + 3); 3]);
            [three[0], three[1], three[2], last[0]]
        };
        Aabb::of_points([four(0), four(4)].as_flattened())
    }

    /// How many times as far off a triangle rays must start as in a mesh that stands in the world.
    pub(crate) fn stretch(&self) -> f32 {
        self.stretch.max(1.0)
    }

    fn ways(&self) -> Ways<'_> {
        Ways { transform: &self.transform, inverse: &self.inverse, stretch: self.stretch() }
    }

    /// Whether it consists of shapes, which have no triangles.
    pub(crate) fn has_shapes(&self) -> bool {
        self.shapes != NONE
    }

    /// The direction of a normal in the world: through the inverse's transpose. Not of length 1.
    pub(crate) fn normal_in_world(&self, [x, y, z]: Vector) -> Vector {
        let m = &self.inverse;
        // A transform that grows much makes normals small: a power of two brings them back.
        let size = greatest(m.map(|[a, b, c, _]| greatest([a.abs(), b.abs(), c.abs()])));
        let factor = crate::vector::power_of_two(-crate::vector::exponent(size));
        [0, 1, 2].map(|k| {
            let [a, b, c] = [m[0][k] * factor, m[1][k] * factor, m[2][k] * factor];
            (a * x + b * y) + c * z
        })
    }
}

impl InstanceTable {
    /// The instances of a scene that is built. `triangles` is how many there are in all geometries together.
    ///
    /// # Errors
    /// Geometries that do not lie among these triangles.
    pub fn new(
        scene: &BuiltScene,
        geometries: &Geometries<'_>,
        triangles: u32,
    ) -> Result<InstanceTable, AppearanceError> {
        let mut table = InstanceTable::default();
        table.update(scene, geometries, triangles)?;
        Ok(table)
    }

    /// As [`InstanceTable::new`], in the memory that is there: writes the rows of all instances.
    ///
    /// # Errors
    /// As there; nothing has changed then.
    pub fn update(
        &mut self,
        scene: &BuiltScene,
        geometries: &Geometries<'_>,
        triangles: u32,
    ) -> Result<(), AppearanceError> {
        let (lines, changed) = self.changed(scene, geometries, triangles, Changes::Unknown)?;
        self.write(scene, geometries, lines, &changed);
        Ok(())
    }

    /// Instances that are there.
    pub fn len(&self) -> usize {
        self.rows.iter().flatten().count()
    }

    /// Whether no instance is there.
    pub fn is_empty(&self) -> bool {
        self.rows.iter().all(Option::is_none)
    }

    /// Bytes that are held.
    pub fn bytes(&self) -> u64 {
        let rows = self.rows.capacity() * size_of::<Option<Shown>>();
        (rows + self.materials.capacity() * size_of::<u32>() + self.lines.bytes()) as u64
    }

    /// The place of a hit with a shape, in the world; `None` for a triangle.
    pub(crate) fn round(&self, ray: &Ray, hit: &Hit, instance: u32) -> Option<RoundPlace> {
        let shown = self.shown(instance)?;
        let shapes = self.shapes.get(shown.shapes as usize)?.shapes()?;
        Some(round::place(shapes, &shown.ways(), ray, hit))
    }

    /// A place of a shape of an instance, evenly over its surface in the object's space; `None` for a triangle, and for shapes of the user's own.
    pub(crate) fn sample(
        &self,
        primitive: u32,
        instance: u32,
        numbers: [f32; 2],
    ) -> Option<RoundPlace> {
        let shown = self.shown(instance)?;
        let shapes = self.shapes.get(shown.shapes as usize)?.shapes()?;
        round::sample(shapes, &shown.ways(), primitive, numbers)
    }

    /// By primitive about the areas in the world of an instance's spheres or capsules; nothing for other instances.
    pub(super) fn areas(&self, shown: &Shown) -> impl Iterator<Item = f64> {
        let shapes = self.shapes.get(shown.shapes as usize).and_then(|own| own.shapes());
        let count = shapes.map_or(0, |own| own.len() as u32);
        let ways = shown.ways();
        (0..count).map(move |primitive| match shapes {
            Some(shapes) => round::area_in_world(shapes, &ways, primitive),
            None => 0.0,
        })
    }

    pub(crate) fn shown(&self, instance: u32) -> Option<&Shown> {
        self.rows.get(instance as usize)?.as_ref()
    }

    /// All that are there, by name.
    pub(crate) fn all(&self) -> impl Iterator<Item = (u32, &Shown)> {
        let rows = self.rows.iter().enumerate();
        rows.filter_map(|(name, row)| Some((name as u32, row.as_ref()?)))
    }
}
