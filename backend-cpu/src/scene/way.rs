//! Rays that go the same way through the tree over instances.

use splitplane_core::arithmetic::snap;
use splitplane_core::backend::scene::{SceneAnswer, limit_within};
use splitplane_core::ray::{Hit, Ray};
use splitplane_core::scene::{
    GeometryId, InstanceId, LEAST_OF_RAY, Placement, SceneHit, TOP_INSTANCE, TOP_NONE, TOP_WIDTH,
    TopNode, TopRay,
};

use super::top_walk::{PRODUCT_MOST, Planes};
use super::turn_ray::TurnRay;
use crate::simd::{Compiled, MOST_LANES, Simd};
use crate::trace::bunch::{PART, PartRows};
use crate::trace::prepare::{CHUNK, PerRay, RECORD};

/// Slopes of rays that go the same way differ by less than this, parts of the greatest component, on all axes together.
const SLOPE_SPREAD: f32 = 0.3;
/// Their origins differ by less than this part of the extents of all instances together.
const ORIGIN_SPREAD: f32 = 1.0;

/// A child of a node that some ray may enter.
#[derive(Clone, Copy)]
pub(super) struct Entry {
    pub(super) enter: f32,
    node: u32,
    slot: u32,
}

/// Rays by rows, as the tree over instances tests them, and what holds for all of them.
pub(super) struct Way {
    /// Snapped.
    origin: [PerRay<f32>; 3],
    direction: [PerRay<f32>; 3],
    pub(super) t_min: PerRay<f32>,
    /// Up to their best hits; lower than all others for rays that are done.
    pub(super) limit: PerRay<f32>,
    reciprocal: [PerRay<f32>; 3],
    /// What is taken from a plane times the reciprocal.
    first: [PerRay<f32>; 3],
    last: [PerRay<f32>; 3],
    enter: PerRay<f32>,
    pub(super) stop: PerRay<f32>,
    /// The greatest component of the origin.
    distance: PerRay<f32>,
    /// What boxes are widened by, per unit of that.
    widen: f32,
    planes: Planes,
    pub(super) all: Interval,
}

/// Bounds that hold for all rays.
#[derive(Clone, Copy)]
pub(super) struct Interval {
    /// What is taken from the planes that come first, and last, so that the distance is the least, and the greatest.
    first: [f32; 3],
    last: [f32; 3],
    reciprocal: [[f32; 2]; 3],
    enter: f32,
    pub(super) stop: f32,
}

/// The least and the greatest of a row.
#[cfg_attr(not(unoptimised), inline(always))]
pub(super) fn range(row: &PerRay<f32>) -> [f32; 2] {
    let (mut least, mut most) = ([row[0]; MOST_LANES], [row[0]; MOST_LANES]);
    for first in (0..CHUNK).step_by(MOST_LANES) {
        for lane in 0..MOST_LANES {
            let x = row[first + lane];
            least[lane] = if x < least[lane] { x } else { least[lane] };
            most[lane] = if x > most[lane] { x } else { most[lane] };
        }
    }
    let mut count = MOST_LANES / 2;
    while count > 0 {
        for lane in 0..count {
            let (a, b) = (least[lane], least[lane + count]);
            least[lane] = if a < b { a } else { b };
            let (a, b) = (most[lane], most[lane + count]);
            most[lane] = if a > b { a } else { b };
        }
        count /= 2;
    }
    [least[0], most[0]]
}

impl Entry {
    /// No entry.
    pub(super) const NONE: Entry = Entry { enter: 0.0, node: 0, slot: 0 };
}

impl Way {
    /// No rays.
    pub(super) const NONE: Way = Way {
        origin: [[0.0; CHUNK]; 3],
        direction: [[0.0; CHUNK]; 3],
        t_min: [0.0; CHUNK],
        limit: [0.0; CHUNK],
        reciprocal: [[0.0; CHUNK]; 3],
        first: [[0.0; CHUNK]; 3],
        last: [[0.0; CHUNK]; 3],
        enter: [0.0; CHUNK],
        stop: [0.0; CHUNK],
        distance: [0.0; CHUNK],
        widen: 0.0,
        planes: Planes::NONE,
        all: Interval {
            first: [0.0; 3],
            last: [0.0; 3],
            reciprocal: [[0.0; 2]; 3],
            enter: 0.0,
            stop: 0.0,
        },
    };

    /// Takes rays. Returns those that are not unusual, as bits.
    ///
    /// # Safety
    /// The processor must have the set.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(super) unsafe fn load<S: Simd>(&mut self, rays: &[Ray; CHUNK], reach: f32) -> u32 {
        // More than is used, since whole vectors are read.
        let mut numbers = [0.0; CHUNK * RECORD + MOST_LANES];
        numbers[..CHUNK * RECORD].copy_from_slice(bytemuck::cast_slice(rays));
        let mut given = [[0.0; CHUNK]; MOST_LANES];
        for lane in (0..CHUNK).step_by(S::N) {
            let to = given.as_flattened_mut()[lane..].as_mut_ptr();
            // SAFETY: the caller's contract; a vector from the last ray's first number on is there, and rows for all columns
            // that a vector takes.
            unsafe { S::transpose(numbers.as_ptr().add(lane * RECORD), RECORD, to, CHUNK) };
        }
        let [ox, oy, oz, t_min, dx, dy, dz, t_max, ..] = &given;
        let (mut usual, mut distance, mut length) = ([1u32; CHUNK], [0.0f32; CHUNK], [0.0; CHUNK]);
        for (axis, (from, along)) in [(ox, dx), (oy, dy), (oz, dz)].into_iter().enumerate() {
            for i in 0..CHUNK {
                let (o, d) = (snap(from[i]), snap(along[i]));
                (self.origin[axis][i], self.direction[axis][i]) = (o, d);
                let (o, d) = (o.abs(), d.abs());
                usual[i] &=
                    u32::from(o <= TopRay::ORIGIN_MOST) & u32::from(d <= TopRay::DIRECTION_MOST);
                usual[i] &= u32::from(o >= LEAST_OF_RAY) | u32::from(o == 0.0);
                usual[i] &= u32::from(d >= LEAST_OF_RAY) | u32::from(d == 0.0);
                distance[i] = if o > distance[i] { o } else { distance[i] };
                length[i] = if d > length[i] { d } else { length[i] };
            }
        }
        for i in 0..CHUNK {
            usual[i] &= u32::from(length[i] >= 1.0 / TopRay::DIRECTION_MOST);
            usual[i] &= u32::from(t_min[i] <= t_max[i]);
            self.enter[i] = TopRay::start_before(t_min[i]);
            self.stop[i] = TopRay::stop_after(t_max[i]);
        }
        (self.t_min, self.limit) = (*t_min, *t_max);
        for axis in 0..3 {
            for i in 0..CHUNK {
                let (d, least) = (self.direction[axis][i], length[i] * TopRay::DIRECTION_LEAST);
                let reciprocal = 1.0 / if d.abs() < least { least } else { d };
                let from = self.origin[axis][i] * reciprocal;
                let widening = distance[i] * reciprocal.abs();
                usual[i] &= u32::from(widening <= PRODUCT_MOST);
                self.reciprocal[axis][i] = reciprocal;
                self.first[axis][i] = from + reach * widening;
                self.last[axis][i] = from - reach * widening;
            }
        }
        (self.distance, self.widen) = (distance, reach);
        let mut all = 0;
        for i in 0..CHUNK {
            all |= usual[i] << i;
        }
        all
    }

    /// The rays as they are followed each by itself.
    ///
    /// # Safety
    /// The processor must have the set.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(super) unsafe fn top_rays<S: Simd>(&self, to: &mut [TurnRay; CHUNK]) {
        let mut rows = [[0.0; CHUNK]; TurnRay::WORDS];
        rows[..3].copy_from_slice(&self.reciprocal);
        rows[4..7].copy_from_slice(&self.first);
        rows[8..11].copy_from_slice(&self.last);
        (rows[3], rows[7]) = (self.enter, self.stop);
        let [x, y, z] = &self.reciprocal;
        for i in 0..CHUNK {
            let octant =
                u32::from(x[i] < 0.0) | u32::from(y[i] < 0.0) << 1 | u32::from(z[i] < 0.0) << 2;
            rows[11][i] = f32::from_bits(octant);
        }
        let to = to.as_mut_ptr().cast::<f32>();
        for lane in (0..CHUNK).step_by(S::N) {
            for first in (0..TurnRay::WORDS).step_by(S::N) {
                // SAFETY: the caller's contract; a row for each word, and as many words for each ray.
                unsafe {
                    let from = rows.as_flattened().as_ptr().add(first * CHUNK + lane);
                    S::transpose(
                        from,
                        CHUNK,
                        to.add(lane * TurnRay::WORDS + first),
                        TurnRay::WORDS,
                    );
                }
            }
        }
    }

    /// Whether the rays, none of which is unusual, go the same way. The extents are those of all instances.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(super) fn goes_together(&mut self, extents: f32) -> bool {
        for axis in 0..3 {
            // Where rays go all ways, two are enough to detect it.
            let [one, .., other] = &self.direction[axis];
            if (*one < 0.0) != (*other < 0.0) {
                return false;
            }
        }
        let (mut slopes, mut origins, mut greatest) = (0.0, 0.0, 0.0f32);
        let wide = self.widen * range(&self.distance)[1];
        for axis in 0..3 {
            let [low, high] = range(&self.origin[axis]);
            origins += high - low;
            let [lo, hi] = range(&self.direction[axis]);
            slopes += hi - lo;
            greatest = greatest.max(hi.max(-lo));
            let [least, most] = range(&self.reciprocal[axis]);
            let negative = least < 0.0;
            if negative != (most < 0.0) {
                return false;
            }
            self.planes.set(axis, negative);
            self.all.reciprocal[axis] = [least, most];
            let (low, high) = (low - wide, high + wide);
            (self.all.first[axis], self.all.last[axis]) =
                if negative { (low, high) } else { (high, low) };
        }
        self.all.enter = range(&self.enter)[0];
        self.all.stop = range(&self.stop)[1];
        slopes <= SLOPE_SPREAD * greatest && origins <= ORIGIN_SPREAD * extents
    }

    /// Puts the children of a node that some ray may meet on the stack, nearest last. Returns how many.
    ///
    /// # Safety
    /// The processor must have the set, which must have eight lanes; the stack must have space for eight entries.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(super) unsafe fn step<S: Simd>(
        &self,
        node: &TopNode,
        index: u32,
        stack: *mut Entry,
    ) -> usize {
        let all = &self.all;
        // SAFETY: the caller's contract; rows have eight numbers.
        unsafe {
            let mut near = S::splat(all.enter);
            let mut far = S::splat(all.stop);
            for axis in 0..3 {
                let [least, most] = all.reciprocal[axis];
                let (least, most) = (S::splat(least), S::splat(most));
                let first = S::sub(self.planes.first::<S>(node, axis), S::splat(all.first[axis]));
                let last = S::sub(self.planes.last::<S>(node, axis), S::splat(all.last[axis]));
                near = S::max(S::min(S::mul(first, least), S::mul(first, most)), near);
                far = S::min(S::max(S::mul(last, least), S::mul(last, most)), far);
            }
            let mut met = S::bits(S::le(near, far));
            let mut entered = [0.0; MOST_LANES];
            S::store(entered.as_mut_ptr(), near);
            let mut end = 0;
            while met != 0 {
                let slot = met.trailing_zeros();
                met &= met - 1;
                if node.children[slot as usize % TOP_WIDTH] == TOP_NONE {
                    continue;
                }
                let enter = entered[slot as usize % MOST_LANES];
                let mut at = end;
                while at > 0 && (*stack.add(at - 1)).enter <= enter {
                    *stack.add(at) = *stack.add(at - 1);
                    at -= 1;
                }
                *stack.add(at) = Entry { enter, node: index, slot };
                end += 1;
            }
            end
        }
    }

    /// Which rays meet a child's box, as bits.
    ///
    /// # Safety
    /// The processor must have the set.
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn meets<S: Simd>(&self, node: &TopNode, slot: usize) -> u32 {
        let mut met = 0;
        for lane in (0..CHUNK).step_by(S::N) {
            // SAFETY: the caller's contract; rows have the lanes.
            unsafe {
                let row = |row: &PerRay<f32>| row.as_ptr().add(lane);
                let mut near = S::load(row(&self.enter));
                let mut far = S::load(row(&self.stop));
                for axis in 0..3 {
                    let [first, last] = self.planes.of(node, axis, slot);
                    let reciprocal = S::load(row(&self.reciprocal[axis]));
                    let enter =
                        S::mul_sub(S::splat(first), reciprocal, S::load(row(&self.first[axis])));
                    let leave =
                        S::mul_sub(S::splat(last), reciprocal, S::load(row(&self.last[axis])));
                    (near, far) = (S::max(enter, near), S::min(leave, far));
                }
                met |= S::bits(S::le(near, far)) << lane;
            }
        }
        met
    }

    /// The next instance that some rays enter, nearest boxes first, and which do, as bits; `None` when there is none left.
    ///
    /// # Safety
    /// The processor must have the set. The nodes must be all those of a tree, and the stack must have the entries that it needs and as many more as
    /// a node has children; of them `top` have been written by this function, or by [`Way::step`] for the root.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(super) unsafe fn next<S: Simd>(
        &self,
        nodes: &[TopNode],
        stack: *mut Entry,
        top: &mut usize,
    ) -> Option<(u32, u32)> {
        while *top > 0 {
            *top -= 1;
            // SAFETY: entries that were written, which name nodes and places in them; children are nodes or instances; the caller's contract.
            unsafe {
                let Entry { enter, node, slot } = *stack.add(*top);
                if enter > self.all.stop {
                    continue;
                }
                let (node, slot) = (nodes.get_unchecked(node as usize), slot as usize % TOP_WIDTH);
                let met = self.meets::<S>(node, slot);
                if met == 0 {
                    continue;
                }
                let child = node.children[slot];
                if child & TOP_INSTANCE != 0 {
                    return Some((child & !TOP_INSTANCE, met));
                }
                let node = nodes.get_unchecked(child as usize);
                *top += self.step::<S::Eight>(node, child, stack.add(*top));
            }
        }
        None
    }

    /// The rays as an instance sees them, none of whose numbers is snapped: the operations of [`WorldRay::seen_by`]. In parts of as many rays as are
    /// prepared together, of which those may stay as they are that have none of these.
    ///
    /// # Safety
    /// The processor must have the set.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(super) unsafe fn seen_by<S: Simd>(
        &self,
        placement: &Placement,
        met: u32,
        seen: &mut [PartRows; CHUNK / PART],
    ) {
        let rows = &placement.space.inverse;
        for lane in (0..CHUNK).step_by(S::N) {
            if met >> lane & (u32::MAX >> (32 - S::N)) == 0 {
                continue;
            }
            let (seen, at) = (&mut seen[lane / PART], lane % PART);
            for axis in 0..3 {
                let [a, b, c, d] = rows[axis];
                // SAFETY: the caller's contract; rows have the lanes.
                unsafe {
                    let (a, b, c, d) = (S::splat(a), S::splat(b), S::splat(c), S::splat(d));
                    for (from, to) in [(&self.origin, axis), (&self.direction, 4 + axis)] {
                        let [x, y, z] = from;
                        let two = S::add(
                            S::mul(a, S::load(x.as_ptr().add(lane))),
                            S::mul(b, S::load(y.as_ptr().add(lane))),
                        );
                        let mut sum = S::add(two, S::mul(c, S::load(z.as_ptr().add(lane))));
                        if to < 4 {
                            sum = S::add(sum, d);
                        }
                        S::store(seen[to].as_mut_ptr().add(at), sum);
                    }
                }
            }
        }
        for (part, seen) in seen.iter_mut().enumerate() {
            seen[3].copy_from_slice(&self.t_min[part * PART..][..PART]);
            seen[7].copy_from_slice(&self.limit[part * PART..][..PART]);
        }
    }
}

impl Way {
    /// Takes a hit of a ray, if it is better than its best. True if it is.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(super) fn improve<T: SceneAnswer>(
        &mut self,
        answer: &mut T,
        (ray, lane): (&Ray, usize),
        hit: &Hit,
        (geometry, instance): (GeometryId, InstanceId),
    ) -> bool {
        let found = SceneHit::of(hit, geometry, instance);
        if !(found.is_hit() && found.precedes(&answer.best())) {
            return false;
        }
        if answer.take(found) {
            // It enters nothing any more.
            (self.stop[lane], self.limit[lane]) = (f32::NEG_INFINITY, f32::NEG_INFINITY);
        } else {
            let best = answer.best();
            self.stop[lane] = TopRay::stop_after(ray.t_max.min(best.t));
            self.limit[lane] = limit_within(ray, &best);
        }
        true
    }
}

/// [`Way::load`], in a function of its own.
pub(super) struct LoadWay<'a> {
    pub(super) way: &'a mut Way,
    pub(super) rays: &'a [Ray; CHUNK],
    pub(super) reach: f32,
}

impl Compiled for LoadWay<'_> {
    type Output = u32;

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn run<S: Simd>(self) -> u32 {
        // SAFETY: the caller's contract.
        unsafe { self.way.load::<S>(self.rays, self.reach) }
    }
}

/// [`Way::top_rays`], in a function of its own.
pub(super) struct TopRays<'a> {
    pub(super) way: &'a Way,
    pub(super) to: &'a mut [TurnRay; CHUNK],
}

impl Compiled for TopRays<'_> {
    type Output = ();

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn run<S: Simd>(self) {
        // SAFETY: the caller's contract.
        unsafe { self.way.top_rays::<S>(self.to) }
    }
}

#[cfg(test)]
mod tests;
