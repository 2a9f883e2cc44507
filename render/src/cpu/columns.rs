//! Hits and surfaces of a chunk as columns: where rays met their triangles, and what lights without a size do for all of them. The operations
//! are those of [`crate::surface`] and [`crate::lighting`], in their order for each lane, so the bits are the same; the compiler makes
//! vectors of them, where nothing branches.

use crate::layout::{Path, Surface};
use crate::lighting::albedo;
use crate::plane::{Plane, start};
use crate::scene_data::DIRECTIONAL;
use crate::scene_words::{LightWords, SceneWords, weighted};
use crate::vector::{Vector, add, dot, exponent, normalized, power_of_two, reach, scaled};
use splitplane_core::triangle::Triangle;

/// Paths of a chunk.
const CHUNK: usize = crate::kernel::CHUNK as usize;
/// Lanes that are computed together; some more are computed than there are surfaces.
const LANES: usize = 16;

/// A vector of each surface.
struct Column<const N: usize>([[f32; N]; 3]);

impl<const N: usize> Column<N> {
    const ZERO: Column<N> = Column([[0.0; N]; 3]);

    #[inline(always)]
    fn put(&mut self, lane: usize, vector: Vector) {
        for (column, part) in self.0.iter_mut().zip(vector) {
            column[lane] = part;
        }
    }

    #[inline(always)]
    fn get(&self, lane: usize) -> Vector {
        [self.0[0][lane], self.0[1][lane], self.0[2][lane]]
    }
}

/// Lanes for which something is computed, a whole number of vectors, of `N`.
fn lanes<const N: usize>(count: usize) -> usize {
    count.next_multiple_of(LANES).min(N)
}

/// Hits whose points are found together: with their columns they stay in the nearest cache.
pub(crate) const HITS: usize = 64;

/// Hits with triangles of one mesh, and where they are: what [`crate::surface::meet`] does for each, over lanes.
pub(crate) struct Hits {
    count: usize,
    corners: [Column<HITS>; 3],
    /// Normals at the corners, where the scene has some.
    normals: [Column<HITS>; 3],
    directions: Column<HITS>,
    u: [f32; HITS],
    v: [f32; HITS],
    points: Column<HITS>,
    offsets: [f32; HITS],
    geometric_normals: Column<HITS>,
    smooth_normals: Column<HITS>,
    /// Dot products of the triangles' own normals with the directions.
    cosines: [f32; HITS],
}

impl Hits {
    /// None yet.
    pub(crate) const NONE: Hits = Hits {
        count: 0,
        corners: [Column::ZERO; 3],
        normals: [Column::ZERO; 3],
        directions: Column::ZERO,
        u: [0.0; HITS],
        v: [0.0; HITS],
        points: Column::ZERO,
        offsets: [0.0; HITS],
        geometric_normals: Column::ZERO,
        smooth_normals: Column::ZERO,
        cosines: [0.0; HITS],
    };

    /// Removes all.
    pub(crate) fn clear(&mut self) {
        self.count = 0;
    }

    /// Adds a hit of a ray with a triangle of these corners, which have these normals if the scene has some.
    pub(crate) fn push(
        &mut self,
        corners: &Triangle,
        normals: Option<&[Vector; 3]>,
        direction: Vector,
        [u, v]: [f32; 2],
    ) {
        let lane = self.count;
        for (column, corner) in self.corners.iter_mut().zip(corners) {
            column.put(lane, *corner);
        }
        if let Some(normals) = normals {
            for (column, normal) in self.normals.iter_mut().zip(normals) {
                column.put(lane, *normal);
            }
        }
        self.directions.put(lane, direction);
        (self.u[lane], self.v[lane]) = (u, v);
        self.count += 1;
    }

    /// Finds the points of all, and normals between those of the corners where there are some.
    pub(crate) fn meet(&mut self, has_normals: bool) {
        let lanes = lanes::<HITS>(self.count);
        self.find_points(lanes);
        if has_normals {
            self.find_normals(lanes);
        }
    }

    fn find_points(&mut self, lanes: usize) {
        let Hits { corners, directions, u, v, points, offsets, geometric_normals, cosines, .. } =
            self;
        for lane in 0..lanes {
            let corners = corners.each_ref().map(|column| column.get(lane));
            let plane = Plane::of(&corners);
            let along_u = scaled(plane.edges[0], u[lane]);
            let along_v = scaled(plane.edges[1], v[lane]);
            points.put(lane, add(corners[0], add(along_u, along_v)));
            offsets[lane] = plane.offset;
            let own = normalized(plane.scaled_normal);
            let direction = directions.get(lane);
            let cosine = dot(own, direction);
            cosines[lane] = cosine;
            let faces = cosine < 0.0;
            let is_none = own[0] == 0.0 && own[1] == 0.0 && own[2] == 0.0;
            let side: Vector = core::array::from_fn(|axis| {
                let turned = if faces { own[axis] } else { -own[axis] };
                if is_none { -direction[axis] } else { turned }
            });
            geometric_normals.put(lane, side);
        }
    }

    fn find_normals(&mut self, lanes: usize) {
        let Hits { normals, directions, u, v, geometric_normals, smooth_normals, .. } = self;
        for lane in 0..lanes {
            let weights = [(1.0 - u[lane]) - v[lane], u[lane], v[lane]];
            let between = weighted(normals.each_ref().map(|column| column.get(lane)), weights);
            let own = geometric_normals.get(lane);
            let unit = normalized(between);
            let is_behind = dot(unit, own) < 0.0;
            let unit = unit.map(|part| if is_behind { -part } else { part });
            let faces = dot(unit, directions.get(lane)) < 0.0;
            smooth_normals
                .put(lane, core::array::from_fn(|axis| if faces { unit[axis] } else { own[axis] }));
        }
    }

    /// The surface of a hit, with this material, and whether the ray met the front.
    pub(crate) fn surface(&self, lane: usize, material: u32, has_normals: bool) -> (Surface, bool) {
        let geometric_normal = self.geometric_normals.get(lane);
        let smooth = if has_normals { &self.smooth_normals } else { &self.geometric_normals };
        let surface = Surface {
            point: self.points.get(lane),
            offset: self.offsets[lane],
            geometric_normal,
            material,
            normal: smooth.get(lane),
            ..Surface::default()
        };
        (surface, self.cosines[lane] < 0.0)
    }
}

/// Surfaces that lights may light, before it is known which do.
pub(crate) struct Facing {
    /// Which surface of the chunk each is.
    surfaces: [u8; CHUNK],
    count: usize,
    points: Column<CHUNK>,
    normals: Column<CHUNK>,
    geometric_normals: Column<CHUNK>,
}

impl Facing {
    /// None yet.
    pub(crate) const NONE: Facing = Facing {
        surfaces: [0; CHUNK],
        count: 0,
        points: Column::ZERO,
        normals: Column::ZERO,
        geometric_normals: Column::ZERO,
    };

    /// Adds a surface, of this number in its chunk.
    pub(crate) fn push(&mut self, number: usize, surface: &Surface) {
        let lane = self.count;
        self.surfaces[lane] = number as u8;
        self.points.put(lane, surface.point);
        self.normals.put(lane, surface.normal);
        self.geometric_normals.put(lane, surface.geometric_normal);
        self.count += 1;
    }

    /// Names in each surface the lights without a size that are on its side.
    pub(crate) fn ask(&self, scene: &SceneWords<'_>, surfaces: &mut [Surface]) {
        let mut masks = [0; CHUNK];
        for light in 0..scene.frame.lights {
            self.add_light(&scene.light(light), 1 << light, &mut masks);
        }
        for (&number, mask) in self.surfaces[..self.count].iter().zip(masks) {
            surfaces[number as usize].lights |= mask;
        }
    }

    /// Sets a light's bit for the surfaces that face it: the rule of [`crate::lighting::may_be_lit`].
    fn add_light(&self, light: &LightWords, bit: u32, masks: &mut [u32; CHUNK]) {
        let place = light.place;
        let add = |lane: usize, towards: Vector, mask: &mut u32| {
            let faces = dot(self.normals.get(lane), towards) > 0.0;
            let side = dot(self.geometric_normals.get(lane), towards) > 0.0;
            *mask |= if faces & side { bit } else { 0 };
        };
        let masks = masks[..lanes::<CHUNK>(self.count)].iter_mut().enumerate();
        if light.kind == DIRECTIONAL {
            masks.for_each(|(lane, mask)| add(lane, place, mask));
        } else {
            masks.for_each(|(lane, mask)| {
                let [x, y, z] = self.points.get(lane);
                add(lane, [place[0] - x, place[1] - y, place[2] - z], mask);
            });
        }
    }
}

/// Surfaces of which some light sample asks for a ray.
pub(crate) struct Lit {
    count: usize,
    /// Which samples these are.
    masks: [u32; CHUNK],
    points: Column<CHUNK>,
    normals: Column<CHUNK>,
    /// Where rays start, and what becomes of the light that they bring.
    starts: [Vector; CHUNK],
    albedos: [Vector; CHUNK],
    /// The part of a light's irradiance that arrives.
    shares: [f32; CHUNK],
}

impl Lit {
    /// Those of a chunk.
    pub(crate) fn of(surfaces: &[Surface], paths: &[Path]) -> Lit {
        let mut lit = Lit {
            count: 0,
            masks: [0; CHUNK],
            points: Column::ZERO,
            normals: Column::ZERO,
            starts: [[0.0; 3]; CHUNK],
            albedos: [[0.0; 3]; CHUNK],
            shares: [0.0; CHUNK],
        };
        for (surface, path) in surfaces.iter().zip(paths).take(CHUNK) {
            if surface.lights == 0 {
                continue;
            }
            let lane = lit.count;
            lit.masks[lane] = surface.lights;
            lit.points.put(lane, surface.point);
            lit.normals.put(lane, surface.normal);
            lit.starts[lane] = start(surface, 1.0);
            lit.albedos[lane] = albedo(surface, path);
            lit.count += 1;
        }
        lit
    }

    /// All samples that some surface asks for.
    pub(crate) fn asked(&self) -> u32 {
        self.masks[..self.count].iter().fold(0, |all, mask| all | mask)
    }

    /// Computes the shares of a light without a size and hands on, for each surface that asks for it, where the ray starts, the albedo
    /// and the share.
    pub(crate) fn each(
        &mut self,
        sample: usize,
        light: &LightWords,
        mut take: impl FnMut(Vector, Vector, f32),
    ) {
        self.find_shares(light);
        let lanes = self.masks.iter().zip(&self.starts).zip(&self.albedos).zip(&self.shares);
        for (((mask, start), albedo), share) in lanes.take(self.count) {
            if mask >> sample & 1 == 1 {
                take(*start, *albedo, *share);
            }
        }
    }

    /// The part of the irradiance that arrives at each surface: the operations of [`crate::lighting::shadow_ray`].
    fn find_shares(&mut self, light: &LightWords) {
        let Lit { points, normals, shares, count, .. } = self;
        let (place, distance) = (light.place, light.distance);
        let shares = shares[..lanes::<CHUNK>(*count)].iter_mut().enumerate();
        if light.kind == DIRECTIONAL {
            shares.for_each(|(lane, share)| *share = dot(normals.get(lane), place));
            return;
        }
        shares.for_each(|(lane, share)| {
            let [x, y, z] = points.get(lane);
            let towards = [place[0] - x, place[1] - y, place[2] - z];
            // What `length` and `normalized` have in common is done once.
            let power = exponent(reach(towards));
            let near_one = scaled(towards, power_of_two(-power));
            let squared = dot(near_one, near_one);
            let root = squared.sqrt();
            let falloff = distance / (root * power_of_two(power));
            let inverse = 1.0 / root;
            let unit = near_one.map(|part| if squared > 0.0 { part * inverse } else { 0.0 });
            *share = (falloff * falloff) * dot(normals.get(lane), unit);
        });
    }
}

#[cfg(test)]
mod tests;
