//! The turn of rays that go into instances: each into its own, as many at a time as a vector has lanes.
//!
//! The operations are those of a ray alone, in their order, and so are the bits. What a ray, an instance and a mesh have to say is a record of 16
//! numbers each; records become rows, and each operation is done for all rays.

use splitplane_core::backend::scene::{Asked, SceneAnswer, seen_by};
use splitplane_core::query::intersect::SceneScale;
use splitplane_core::query::traverse::Query;
use splitplane_core::ray::QueryOptions;
use splitplane_core::scene::{InstanceId, LEAST_OF_WAY, Placement, TOP_INSTANCE};

use super::Shared;
use super::lane::{Lane, Waiting, lanes_of};
use crate::layout::tree_layout::TreeLayout;
use crate::layout::wide_node::DONE;
use crate::scene::found::Found;
use crate::scene::parts::Reached;
use crate::scene::seen::WorldRay;
use crate::simd::{Compiled, Simd};
use crate::trace::block_test::BestHit;
use crate::trace::prepare::{PerRay, PreparedRays, RECORD, RECORD_OF_SCALE, WIDE};
use crate::trace::prepare_one::Readiness;
use crate::trace::ray_state::{RayState, ScalarOutcome};
use crate::trace::single::Single;
use crate::trace::step::ask_for;

/// Rays that go into instances together.
pub(super) const GROUP: usize = 16;
/// So few go alone.
const FEW: usize = 3;

/// Sixteen numbers of each ray.
#[derive(Clone, Copy)]
#[repr(C, align(64))]
struct Records([[f32; 16]; GROUP]);

/// The same by rows.
type Rows = [PerRay<f32, GROUP>; 16];

/// Rays that go into instances together.
pub(super) struct Group {
    /// The rays with their limits, the ways into the instances' spaces, and the meshes.
    rays: Records,
    ways: Records,
    scales: Records,
    lanes: [u8; GROUP],
    count: usize,
    prepared: PreparedRays<GROUP>,
    ray_states: [RayState; GROUP],
}

impl Group {
    /// No rays.
    pub(super) const fn new() -> Group {
        let none = Records([[0.0; 16]; GROUP]);
        Group {
            rays: none,
            ways: none,
            scales: none,
            lanes: [0; GROUP],
            count: 0,
            prepared: PreparedRays::NONE,
            ray_states: [RayState::NONE; GROUP],
        }
    }
}

impl Records {
    /// Rows of them.
    ///
    /// # Safety
    /// The processor must have the set.
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn rows<S: Simd>(&self) -> Rows {
        let mut rows = [[0.0; GROUP]; 16];
        let (from, to) = (self.0.as_flattened().as_ptr(), rows.as_flattened_mut().as_mut_ptr());
        for ray in (0..GROUP).step_by(S::N) {
            for first in (0..16).step_by(S::N) {
                // SAFETY: the caller's contract; as many rays and numbers.
                unsafe {
                    let from = from.add(ray * 16 + first);
                    S::transpose(from, 16, to.add(first * GROUP + ray), GROUP);
                }
            }
        }
        rows
    }
}

/// Takes all rays that wait for it into their instances, or past them.
pub(super) struct Enter<'a, 'b, T, L> {
    pub(super) lanes: *mut Lane<'b, T, L>,
    pub(super) waiting: &'a mut Waiting,
    pub(super) shared: &'a Shared<'b>,
    pub(super) group: &'a mut Group,
    /// Instances entered.
    pub(super) entered: &'a mut u64,
}

impl<'b, T: SceneAnswer, L: Found<'b>> Compiled for Enter<'_, 'b, T, L> {
    type Output = ();

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn run<S: Simd>(self) {
        let Enter { lanes, waiting, shared, group, entered } = self;
        let mut left = *waiting;
        group.count = 0;
        for number in lanes_of(core::mem::take(&mut left.enter)) {
            // SAFETY: the caller's contract; lanes are below LANES, and all different.
            unsafe {
                let lane = &mut *lanes.add(number);
                if group.count == GROUP {
                    go_in::<S, T, L>(lanes, &mut left, shared, group);
                }
                if !shared.is_met::<S, T, L>(lane, number, group, entered) {
                    left.put_top(number, lane.pop_top());
                }
            }
        }
        // SAFETY: the caller's contract.
        unsafe { go_in::<S, T, L>(lanes, &mut left, shared, group) };
        *waiting = left;
    }
}

impl<'b> Shared<'b> {
    /// Finds what the ray meets in the instance that it has come to. Puts it into the group where that is a mesh; else takes its hit and returns false.
    ///
    /// # Safety
    /// The processor must have the set; the group must have space for a ray.
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn is_met<S: Simd, T: SceneAnswer, L: Found<'b>>(
        &self,
        lane: &mut Lane<'b, T, L>,
        number: usize,
        group: &mut Group,
        entered: &mut u64,
    ) -> bool {
        let instance = InstanceId(lane.top_child & !TOP_INSTANCE);
        let Some(Some(placement)) = self.placements.get(instance.0 as usize) else { return false };
        let Some(asked) = Asked::of(instance, placement, self.options) else { return false };
        let geometry = placement.instance.geometry;
        (lane.instance, lane.geometry, lane.best) = (instance, geometry, BestHit::NONE);
        let options = &self.asked[asked.culling as usize % self.asked.len()];
        let Some(listed) = self.listed.get(geometry.0 as usize) else { return false };
        let Some(layout) = listed.layout else {
            if let Some(Reached::Shapes(shapes)) = listed.reached {
                *entered += 1;
                let seen =
                    &seen_by(placement, &self.rays[lane.index as usize], &lane.answer.best());
                lane.best.hit = shapes.trace(seen, options, T::QUERY, |_| true);
                // SAFETY: the caller's contract.
                unsafe { lane.take::<S>(self.rays, self.top_room) };
            }
            return false;
        };
        let Some(leaves) = L::of(layout) else { return false };
        *entered += 1;
        (lane.lines, lane.leaves) = (layout.wide.lines().as_ptr(), Some(leaves));
        lane.options = options;
        let place = group.count;
        group.count += 1;
        group.lanes[place] = number as u8;
        let ray: &[f32; RECORD] = bytemuck::cast_ref(&self.rays[lane.index as usize]);
        group.rays.0[place][..RECORD].copy_from_slice(ray);
        group.rays.0[place][RECORD - 1] = lane.limit;
        // SAFETY: the way is the first of a placement's numbers, of which there are more than 16.
        group.ways.0[place] = unsafe { (&raw const *placement).cast::<[f32; 16]>().read() };
        group.scales.0[place] = listed.scale.0;
        true
    }
}

/// Takes a group's rays into their instances, and past those whose meshes' bounds they miss. The group is empty then.
///
/// # Safety
/// The processor must have the set; the group's rays must be of these lanes.
#[cfg_attr(not(unoptimised), inline(always))]
unsafe fn go_in<'b, S: Simd, T: SceneAnswer, L: Found<'b>>(
    lanes: *mut Lane<'b, T, L>,
    left: &mut Waiting,
    shared: &Shared<'b>,
    group: &mut Group,
) {
    let count = core::mem::take(&mut group.count);
    let (mut ready, mut alone) = (0, u32::MAX);
    if count >= FEW {
        // SAFETY: the caller's contract.
        (ready, alone) = unsafe { S::call(Prepare { group: &mut *group, query: T::QUERY }) };
    }
    for place in 0..count {
        let number = group.lanes[place] as usize;
        // SAFETY: the caller's contract.
        unsafe {
            let lane = &mut *lanes.add(number);
            let mut goes_in = ready >> place & 1 != 0;
            if goes_in {
                lane.ray_state = group.ray_states[place];
            } else if alone >> place & 1 != 0 {
                goes_in = shared.prepare_alone::<S, T, L>(lane);
            }
            if goes_in {
                (lane.child, lane.last) = (0, lane.stack);
                *lane.stack = DONE;
                *lane.stack.add(shared.room).cast::<f32>() = f32::NEG_INFINITY;
                left.node |= 1 << number;
                ask_for::<S, L>(lane.lines, lane.leaves.unwrap_unchecked(), 0);
            } else {
                left.put_top(number, lane.pop_top());
            }
        }
    }
}

/// [`Group::prepare`], which depends on neither answers nor layouts: compiled once for a set.
struct Prepare<'a> {
    group: &'a mut Group,
    query: Query,
}

impl Compiled for Prepare<'_> {
    type Output = (u32, u32);

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn run<S: Simd>(self) -> (u32, u32) {
        // SAFETY: the caller's contract.
        unsafe { self.group.prepare::<S>(self.query) }
    }
}

impl Group {
    /// Takes the rays into their instances' spaces and prepares them. Returns those that are ready, as bits, and those that need more care.
    ///
    /// # Safety
    /// The processor must have the set.
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn prepare<S: Simd>(&mut self, query: Query) -> (u32, u32) {
        // SAFETY: the caller's contract.
        let (rays, ways, scales) =
            unsafe { (self.rays.rows::<S>(), self.ways.rows::<S>(), self.scales.rows::<S>()) };
        let [x, y, z, t_min, dx, dy, dz, limit, ..] = &rays;
        let mut ordinary = [1u32; GROUP];
        for row in &ways[..12] {
            for i in 0..GROUP {
                ordinary[i] &= u32::from(row[i].abs() >= LEAST_OF_WAY) | u32::from(row[i] == 0.0);
            }
        }
        let mut seen = [[0.0; GROUP]; RECORD];
        for axis in 0..3 {
            let [a, b, c, d] = [0, 1, 2, 3].map(|column| &ways[4 * axis + column]);
            for i in 0..GROUP {
                seen[axis][i] = ((a[i] * x[i] + b[i] * y[i]) + c[i] * z[i]) + d[i];
                seen[4 + axis][i] = (a[i] * dx[i] + b[i] * dy[i]) + c[i] * dz[i];
            }
        }
        (seen[3], seen[7]) = (*t_min, *limit);
        let scales: &[PerRay<f32, GROUP>; RECORD_OF_SCALE] = &scales;
        self.prepared.fill_rows(&seen, GROUP, scales, 0, query);
        let (mut ready, mut alone) = (0, 0);
        for i in 0..GROUP {
            let within = u32::from(self.prepared.enter[i] <= self.prepared.exit[i]);
            let wide = u32::from(scales[WIDE][i] != 0.0);
            let special = self.prepared.special[i] | (ordinary[i] ^ 1) | wide;
            alone |= special << i;
            ready |= (self.prepared.alive[i] & within & (special ^ 1)) << i;
        }
        // SAFETY: the caller's contract.
        unsafe { self.prepared.ray_states::<S>(&mut self.ray_states) };
        (ready, alone)
    }
}

impl<'b> Shared<'b> {
    /// Prepares a ray for the instance that it has come to. False where it misses that, or is answered.
    ///
    /// # Safety
    /// The processor must have the set.
    #[inline(never)]
    unsafe fn prepare_alone<S: Simd, T: SceneAnswer, L: Found<'b>>(
        &self,
        lane: &mut Lane<'b, T, L>,
    ) -> bool {
        let Some(Some(placement)) = self.placements.get(lane.instance.0 as usize) else {
            return false;
        };
        let Some(Reached::Triangles(accelerator)) = self.geometries.get(lane.geometry) else {
            return false;
        };
        let (layout, scale) = accelerator.parts();
        let ray = &self.rays[lane.index as usize];
        let limits = [ray.t_min, lane.limit];
        let seen = WorldRay::new(ray).seen_by(placement, limits);
        // SAFETY: the caller's contract.
        match unsafe { lane.ray_state.prepare_loaded::<S>(&seen, scale, T::QUERY) } {
            Readiness::Ready => true,
            Readiness::Misses => false,
            // SAFETY: the caller's contract.
            Readiness::Special => unsafe {
                self.prepare_special::<S, T, L>(lane, placement, (layout, scale))
            },
        }
    }

    /// The same for a ray that needs more care.
    ///
    /// # Safety
    /// The processor must have the set.
    #[cold]
    unsafe fn prepare_special<S: Simd, T: SceneAnswer, L: Found<'b>>(
        &self,
        lane: &mut Lane<'b, T, L>,
        placement: &Placement,
        (layout, scene): (&TreeLayout, &SceneScale),
    ) -> bool {
        let ray = &seen_by(placement, &self.rays[lane.index as usize], &lane.answer.best());
        // SAFETY: the options of the lane's instance.
        let options: &QueryOptions<'_> = unsafe { &*lane.options };
        lane.best.hit = match RayState::prepare_by_core(ray, scene, options.accuracy, T::QUERY) {
            Some(ScalarOutcome::Traced(moved)) => {
                lane.ray_state = moved;
                return true;
            }
            Some(ScalarOutcome::Answer(hit)) => hit,
            // SAFETY: the caller's contract.
            None => unsafe { S::call(Single { layout, scene, ray, options, query: T::QUERY }) },
        };
        // SAFETY: the caller's contract.
        unsafe { lane.take::<S>(self.rays, self.top_room) };
        false
    }
}
