//! Prepares 32 rays at once: [`PreparedRay::new`] and [`PreparedRay::enter`], lane by lane.
//!
//! Loops without branches over arrays of 32, which compilers turn into vector instructions. The rare
//! rays that need more (moved origins, extreme exponents) are left to the scalar code.

use core::mem::MaybeUninit;

use splitplane_core::arithmetic::snap;
use splitplane_core::query::intersect::{
    COORDINATE_MOST, DIRECTION_LEAST, ORIGIN_LEAST, PLANE_SLACK, PreparedRay, SLOPE_LEAST,
    STOP_SLACK, SceneScale,
};
use splitplane_core::query::traverse::Query;
use splitplane_core::ray::Rays;

use super::ray_state::{
    AXES, EXIT_FACTOR, ORIGIN_SLACK, RAY_STATE_WORDS, RayState, behind, far_end_is_solid,
};
use crate::simd::{MOST_LANES, Simd};

/// Rays prepared together.
pub(crate) const CHUNK: usize = 32;

/// A number of each ray.
pub(crate) type PerRay<T, const N: usize = CHUNK> = [T; N];

/// The numbers of rays one after the other, and how many each has.
#[cfg_attr(not(unoptimised), inline(always))]
pub(super) fn numbers<'a>(rays: &Rays<'a>) -> (&'a [f32], usize) {
    match *rays {
        Rays::Records(rays) => (bytemuck::cast_slice(rays), RECORD),
        Rays::Rows { rows, .. } => (rows.as_flattened(), ROW),
    }
}

/// Numbers of a record.
pub(crate) const RECORD: usize = 8;
/// Numbers of a row.
const ROW: usize = 6;

/// What preparing rays needs of the meshes that they enter, by the places of its numbers in a [`ScaleRecord`].
pub(crate) trait Scales {
    /// A number of a ray's mesh.
    fn number(&self, place: usize, ray: usize) -> f32;

    /// That of the first `N` rays.
    fn row<const N: usize>(&self, place: usize) -> PerRay<f32, N>;

    /// Whether all rays need more care.
    fn is_wide(&self) -> bool;

    /// Whether there is nothing to be met.
    fn is_empty(&self) -> bool;
}

/// The numbers of a [`SceneScale`], as many as a cache line has.
#[derive(Clone, Copy)]
#[repr(C, align(64))]
pub(crate) struct ScaleRecord(pub(crate) [f32; RECORD_OF_SCALE]);

/// Numbers of a [`ScaleRecord`].
pub(crate) const RECORD_OF_SCALE: usize = 16;
const LO: usize = 0;
const HI: usize = 3;
const NEAR_LO: usize = 6;
const NEAR_HI: usize = 9;
const SLACK: usize = 12;
const BASE_SLACK: usize = 13;
const ORIGIN: usize = 14;
/// Not 0 for a mesh that the vector code does not handle.
pub(crate) const WIDE: usize = 15;

impl ScaleRecord {
    /// No mesh.
    pub(crate) const NONE: ScaleRecord = ScaleRecord([0.0; RECORD_OF_SCALE]);

    /// The numbers of a mesh's scale.
    pub(crate) fn new(scale: &SceneScale) -> ScaleRecord {
        ScaleRecord(core::array::from_fn(|place| match place {
            WIDE => f32::from(u8::from(scale.wide)),
            _ => scale.number(place, 0),
        }))
    }
}

impl Scales for SceneScale {
    #[cfg_attr(not(unoptimised), inline(always))]
    fn number(&self, place: usize, _: usize) -> f32 {
        match place {
            LO..HI => self.bounds.lo[place - LO],
            HI..NEAR_LO => self.bounds.hi[place - HI],
            NEAR_LO..NEAR_HI => self.near.lo[place - NEAR_LO],
            NEAR_HI..SLACK => self.near.hi[place - NEAR_HI],
            SLACK => self.slack,
            BASE_SLACK => self.base_slack,
            _ => self.origin_least,
        }
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn row<const N: usize>(&self, place: usize) -> PerRay<f32, N> {
        [self.number(place, 0); N]
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn is_wide(&self) -> bool {
        self.wide
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn is_empty(&self) -> bool {
        self.bounds.is_empty()
    }
}

/// The records of meshes that rays enter, each ray its own, by rows. None of the meshes is empty; which are wide is for the caller to look at.
impl<const N: usize> Scales for [PerRay<f32, N>; RECORD_OF_SCALE] {
    #[cfg_attr(not(unoptimised), inline(always))]
    fn number(&self, place: usize, ray: usize) -> f32 {
        self[place][ray]
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn row<const M: usize>(&self, place: usize) -> PerRay<f32, M> {
        let mut row = [0.0; M];
        row.copy_from_slice(&self[place][..M]);
        row
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn is_wide(&self) -> bool {
        false
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn is_empty(&self) -> bool {
        false
    }
}

/// Rays prepared together; see [`PreparedRay`] and [`RayState`] for the fields.
#[derive(Clone, Copy)]
#[repr(C, align(64))]
pub(crate) struct PreparedRays<const N: usize = CHUNK> {
    // Row by row the words of a `RayState`.
    pub reciprocal: [PerRay<f32, N>; 3],
    pub enter: PerRay<f32, N>,
    pub near: [PerRay<f32, N>; 3],
    pub exit: PerRay<f32, N>,
    pub exit_reciprocal: [PerRay<f32, N>; 3],
    pub octant: PerRay<u32, N>,
    pub far: [PerRay<f32, N>; 3],
    index: PerRay<u32, N>,
    pub sheared_origin: [PerRay<f32, N>; 3],
    pub shear: [PerRay<f32, N>; 3],
    pub t_min: PerRay<f32, N>,
    pub t_max: PerRay<f32, N>,
    pub limits: [PerRay<f32, N>; 2],
    pub axes: PerRay<u32, N>,
    pub exponent: PerRay<i32, N>,
    pub direction: [PerRay<f32, N>; 3],
    offset: PerRay<f32, N>,
    // Further fields.
    pub origin: [PerRay<f32, N>; 3],
    /// 1 for a ray that may hit something.
    pub alive: PerRay<u32, N>,
    /// 1 for a ray that the scalar code must prepare.
    pub special: PerRay<u32, N>,
    /// 1 for a ray with an origin coordinate so small that it was taken as 0.
    pub shifted: PerRay<u32, N>,
}

const _: () = assert!(core::mem::offset_of!(PreparedRays, origin) == RAY_STATE_WORDS * 4 * CHUNK);
const _: () = assert!(size_of::<PreparedRays>() == (RAY_STATE_WORDS + 6) * 4 * CHUNK);

/// The numbers of one lane.
#[cfg_attr(not(unoptimised), inline(always))]
fn three<const N: usize>(rows: &[PerRay<f32, N>; 3], lane: usize) -> [f32; 3] {
    [rows[0][lane], rows[1][lane], rows[2][lane]]
}

impl<const N: usize> PreparedRays<N> {
    /// Space for as many rays.
    pub(crate) const NONE: PreparedRays<N> = PreparedRays {
        reciprocal: [[0.0; N]; 3],
        near: [[0.0; N]; 3],
        far: [[0.0; N]; 3],
        enter: [0.0; N],
        exit: [0.0; N],
        octant: [0; N],
        sheared_origin: [[0.0; N]; 3],
        shear: [[0.0; N]; 3],
        t_min: [0.0; N],
        t_max: [0.0; N],
        axes: [0; N],
        exponent: [0; N],
        limits: [[0.0; N]; 2],
        direction: [[0.0; N]; 3],
        exit_reciprocal: [[0.0; N]; 3],
        index: [0; N],
        offset: [0.0; N],
        origin: [[0.0; N]; 3],
        alive: [0; N],
        special: [0; N],
        shifted: [0; N],
    };

    /// The states of the rays.
    ///
    /// # Safety
    /// The processor must have the set.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) unsafe fn ray_states<S: Simd>(&self, ray_states: &mut [RayState; N]) {
        for lane in (0..N).step_by(S::N) {
            // SAFETY: the caller's contract.
            unsafe { self.some_ray_states::<S>(lane, ray_states) };
        }
    }

    /// The states of as many rays as the set has lanes, from one on.
    ///
    /// # Safety
    /// The processor must have the set; there must be as many rays.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) unsafe fn some_ray_states<S: Simd>(
        &self,
        lane: usize,
        ray_states: &mut [RayState; N],
    ) {
        let rows = (&raw const *self).cast::<f32>();
        let to = ray_states.as_mut_ptr().cast::<f32>();
        for first in (0..RAY_STATE_WORDS).step_by(S::N) {
            // SAFETY: the struct begins with a row for each word of a ray's state; states are of
            // that size.
            unsafe {
                S::transpose(
                    rows.add(first * N + lane),
                    N,
                    to.add(lane * RAY_STATE_WORDS + first),
                    RAY_STATE_WORDS,
                );
            }
        }
    }

    /// One of the rays, as the triangle tests take it.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) fn ray(&self, lane: usize) -> PreparedRay {
        PreparedRay {
            origin: three(&self.origin, lane),
            direction: three(&self.direction, lane),
            reciprocal: three(&self.reciprocal, lane),
            slack: [0.0; 3],
            axes: AXES[self.axes[lane] as usize % AXES.len()],
            shear: three(&self.shear, lane),
            t_min: self.t_min[lane],
            t_max: self.t_max[lane],
            limits: [self.limits[0][lane], self.limits[1][lane]],
            offset: 0.0,
            exponent: self.exponent[lane],
            wide: false,
        }
    }

    /// Prepares rays of which rows have the numbers, in the order of records; of the lanes the first `count`.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) fn fill_rows(
        &mut self,
        given: &[PerRay<f32, N>; RECORD],
        count: usize,
        scene: &impl Scales,
        first: usize,
        query: Query,
    ) {
        let [ox, oy, oz, given_t_min, dx, dy, dz, given_t_max] = given;
        let (origins, directions) = ([ox, oy, oz], [dx, dy, dz]);
        let mut alive = [1u32; N];
        let mut special = [u32::from(scene.is_wide()); N];
        let mut largest = [0.0f32; N];
        let mut shifted = [0u32; N];
        for axis in 0..3 {
            // Rows of this loop's own, those of the scene too: else the compiler takes one ray at a time here, which takes as long as all the rest.
            // No row is cleared before it is filled: that takes a twentieth of what a ray of a packet takes in all.
            let (mut origin, mut direction) = (*origins[axis], *directions[axis]);
            let near_lo = scene.row::<N>(NEAR_LO + axis);
            let near_hi = scene.row::<N>(NEAR_HI + axis);
            let zero = scene.row::<N>(ORIGIN);
            for i in 0..N {
                let (o, d) = (origin[i], direction[i]);
                alive[i] &= u32::from(o.abs() <= f32::MAX) & u32::from(d.abs() <= f32::MAX);
                let o = snap(o);
                let near = u32::from(near_lo[i] <= o) & u32::from(o <= near_hi[i]);
                special[i] |= (near ^ 1) | u32::from(o.abs() > COORDINATE_MOST);
                let taken = if o.abs() < ORIGIN_LEAST { zero[i] } else { o };
                origin[i] = taken;
                shifted[i] |= u32::from(o != taken);
                let d = snap(d);
                direction[i] = d;
                largest[i] = if d.abs() > largest[i] { d.abs() } else { largest[i] };
            }
            (self.origin[axis], self.direction[axis]) = (origin, direction);
        }
        self.shifted = shifted;
        let mut to_unit = [0.0f32; N];
        for i in 0..N {
            let (t_min, t_max) = (given_t_min[i], given_t_max[i]);
            (self.limits[0][i], self.limits[1][i]) = (t_min, t_max);
            alive[i] &= u32::from(t_min <= t_max) & u32::from(largest[i] > 0.0);
            let biased = (largest[i].to_bits() >> 23) & 0xff;
            // Powers up to 2^126 either way serve in one step.
            special[i] |= u32::from(biased < 1) | u32::from(biased > 253);
            let biased = biased.clamp(1, 253);
            self.exponent[i] = biased as i32 - 127;
            to_unit[i] = f32::from_bits((254 - biased) << 23);
            let back = f32::from_bits(biased << 23);
            self.t_min[i] = snap((t_min * back).clamp(-f32::MAX, f32::MAX));
            self.t_max[i] = snap((t_max * back).clamp(-f32::MAX, f32::MAX));
            self.enter[i] = self.t_min[i] - self.t_min[i].abs() * STOP_SLACK;
            self.exit[i] = self.t_max[i] + self.t_max[i].abs() * STOP_SLACK;
        }
        for axis in 0..3 {
            for i in 0..N {
                let d = snap((self.direction[axis][i] * to_unit[i]).clamp(-f32::MAX, f32::MAX));
                self.direction[axis][i] = d;
                let least = if d < 0.0 { -DIRECTION_LEAST } else { DIRECTION_LEAST };
                let r = 1.0 / if d.abs() < DIRECTION_LEAST { least } else { d };
                self.reciprocal[axis][i] = r;
                // Below 2^38 * 2^80: no scene that the vector code handles is wide.
                let slack = scene.number(SLACK, i) * r.abs();
                self.exit_reciprocal[axis][i] = r * EXIT_FACTOR;
                let o = self.origin[axis][i];
                let low = (scene.number(LO + axis, i) - o) * r;
                let high = (scene.number(HI + axis, i) - o) * r;
                let (near, far) = if d < 0.0 { (high, low) } else { (low, high) };
                let near = near - (near.abs() * PLANE_SLACK + slack);
                let far = far + (far.abs() * PLANE_SLACK + slack);
                self.enter[i] = if near > self.enter[i] { near } else { self.enter[i] };
                self.exit[i] = if far < self.exit[i] { far } else { self.exit[i] };
            }
        }
        for axis in 0..3 {
            for i in 0..N {
                let reach = behind(self.enter[i], self.exit[i]);
                let origin = self.origin[axis][i] * self.reciprocal[axis][i];
                let slack = scene.number(BASE_SLACK, i) * self.reciprocal[axis][i].abs();
                let slack = (slack + origin.abs() * ORIGIN_SLACK) + reach;
                self.near[axis][i] = origin + slack;
                self.far[axis][i] = (origin - slack) * EXIT_FACTOR;
            }
        }
        let (first_index, any) = (first as u32, query == Query::Any);
        let [dx, dy, dz] = &self.direction;
        for i in 0..N {
            let (x, y, z) = (dx[i], dy[i], dz[i]);
            let from_x = y.abs() <= x.abs();
            let greater = if from_x { x.abs() } else { y.abs() };
            let is_z = z.abs() > greater;
            let axis = if is_z { 2 } else { u32::from(!from_x) };
            let main = if is_z {
                z
            } else if from_x {
                x
            } else {
                y
            };
            // The two others in cyclic order, exchanged for a negative main component.
            let first = if is_z {
                x
            } else if from_x {
                y
            } else {
                z
            };
            let second = if is_z {
                y
            } else if from_x {
                z
            } else {
                x
            };
            let (first, second) = if main < 0.0 { (second, first) } else { (first, second) };
            let (sx, sy) = (first / main, second / main);
            self.shear[0][i] = if sx.abs() < SLOPE_LEAST { 0.0 } else { sx };
            self.shear[1][i] = if sy.abs() < SLOPE_LEAST { 0.0 } else { sy };
            self.shear[2][i] = 1.0 / main;
            self.axes[i] = axis + if main < 0.0 { 3 } else { 0 };
            let [ox, oy, oz] = [self.origin[0][i], self.origin[1][i], self.origin[2][i]];
            let along = if is_z {
                oz
            } else if from_x {
                ox
            } else {
                oy
            };
            let first_origin = if is_z {
                ox
            } else if from_x {
                oy
            } else {
                oz
            };
            let second_origin = if is_z {
                oy
            } else if from_x {
                oz
            } else {
                ox
            };
            let swapped = main < 0.0;
            self.sheared_origin[0][i] = if swapped { second_origin } else { first_origin };
            self.sheared_origin[1][i] = if swapped { first_origin } else { second_origin };
            self.sheared_origin[2][i] = along;
            self.index[i] = first_index + i as u32;
            let solid = far_end_is_solid(self.enter[i], self.t_min[i], self.exit[i], self.t_max[i]);
            let negative = u32::from(x < 0.0) | u32::from(y < 0.0) << 1 | u32::from(z < 0.0) << 2;
            self.octant[i] = negative | u32::from(solid & any) << 3;
            self.alive[i] = alive[i];
            self.special[i] = special[i] & alive[i];
        }
        if scene.is_empty() {
            self.alive = [0; N];
        }
        for i in count..N {
            self.alive[i] = 0;
        }
    }
}

impl PreparedRays {
    /// Writes the numbers of the ray of one lane to other lanes.
    pub(crate) fn repeat(&mut self, one: usize, lanes: u32) {
        let count = size_of::<PreparedRays>() / size_of::<PerRay<u32>>();
        // SAFETY: rows of words and nothing else, as its size says.
        let rows = unsafe { core::slice::from_raw_parts_mut((&raw mut *self).cast(), count) };
        let rows: &mut [PerRay<u32>] = rows;
        for row in rows {
            for lane in (0..CHUNK).filter(|lane| lanes >> lane & 1 != 0) {
                row[lane] = row[one];
            }
        }
    }

    /// Prepares the first [`CHUNK`] of some rays; lanes without a ray are not alive. `first` is the
    /// place of the first in its batch.
    ///
    /// # Safety
    /// The processor must have the set.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) unsafe fn fill<S: Simd>(
        &mut self,
        rays: Rays<'_>,
        scene: &SceneScale,
        first: usize,
        query: Query,
    ) {
        let count = rays.len().min(CHUNK);
        let (numbers, each) = numbers(&rays);
        // More than is used, since whole vectors are read.
        let mut room;
        let from = if numbers.len() >= (CHUNK - 1) * each + MOST_LANES {
            numbers
        } else {
            room = [0.0; (CHUNK + 1) * RECORD];
            room[..count * each].copy_from_slice(&numbers[..count * each]);
            &room
        };
        // Not cleared: that takes as long as a twentieth of what a ray of a packet takes in all.
        let mut given = [const { MaybeUninit::<PerRay<f32>>::uninit() }; MOST_LANES];
        let to = given.as_mut_ptr().cast::<f32>();
        for lane in (0..CHUNK).step_by(S::N) {
            // SAFETY: the caller's contract; a vector from the last ray's first number on is there, and rows for all
            // columns that a vector takes. Each by a distance that the compiler knows.
            unsafe {
                match rays {
                    Rays::Records(_) => {
                        S::transpose(from.as_ptr().add(lane * RECORD), RECORD, to.add(lane), CHUNK);
                    }
                    Rays::Rows { .. } => {
                        S::transpose(from.as_ptr().add(lane * ROW), ROW, to.add(lane), CHUNK);
                    }
                }
            }
        }
        const { assert!(S::N >= RECORD && CHUNK.is_multiple_of(S::N)) };
        // SAFETY: all lanes of as many rows as a vector has lanes were written, at least these.
        let rows = unsafe { &mut *to.cast::<[PerRay<f32>; RECORD]>() };
        if let Rays::Rows { t_min, t_max, .. } = rays {
            rows.copy_within(3..6, 4);
            (rows[3], rows[7]) = ([t_min; CHUNK], [t_max; CHUNK]);
        }
        self.fill_rows(rows, count, scene, first, query);
    }
}

#[cfg(test)]
pub(super) mod tests;
