//! The way of a ray through a packed scene: the serial reference of the kernels `enter_instances`, `trace_instances` and `trace_shapes`, all waves
//! of them together.

use core::cmp::min;

use super::sizes::OPACITY_HEAD;
use super::{
    ALWAYS, BOX_COORDINATE_MOST, MIRRORED, PackedInstance, PackedScene, PackedTopNode, SHAPES,
};
use crate::aabb::{Aabb, max};
use crate::arithmetic::{Arithmetic, ordered_bits, snap};
use crate::layout::SceneBatch;
use crate::query::intersect::{PreparedRay, STOP_SLACK, SceneScale};
use crate::query::traverse::{Best, InnerRay, Query, Triangles};
use crate::query::walk::{Leaf, walk_from};
use crate::ray::{Accuracy, Culling, Hit, QueryOptions, Ray};
use crate::scene::shape::{Capsule, ShapeRay};
use crate::scene::{
    GeometryId, InstanceId, ObjectSpace, SceneHit, TOP_INSTANCE, TOP_NONE, TOP_WIDTH, TopRay,
    WIDEST_STACK, is_culled, opacity_bit,
};
use crate::triangle::Triangle;

/// Components of a direction are taken to be at least this part of the greatest.
const BOX_DIRECTION_LEAST: f32 = 9.094_947e-13; // 2^-40
/// Rays whose direction is longer, or shorter than the reciprocal, enter every instance.
const BOX_DIRECTION_MOST: f32 = 1.099_511_6e12; // 2^40
/// From here on the interval in which boxes count has no end.
const ENDLESS: f32 = 8.507_059e37; // 2^126
/// The key of a child that the ray does not enter.
const NO_CHILD: u32 = u32::MAX;

/// A ray among the boxes of a packed tree: a [`TopRay`] whose operations are free, and whose numbers are so bounded that
/// none overflows.
///
/// A box is as wide as the roundings of its test, 12 u of the distances |o| + X: see [`TopRay`] and
/// `docs/design/scenes.md`. Under WGSL's rules three differences and products err by 2 u each, the reciprocal by 5 u,
/// 11 u in all. A component below 2^-40 of the greatest that is taken as that moves the ray by 2^-40 (|o| + X), which is below
/// what is left of the twelfth.
struct BoxRay {
    origin: [f32; 3],
    reciprocal: [f32; 3],
    distance: f32,
    t_min: f32,
    tame: bool,
}

impl BoxRay {
    /// `None` for a ray that hits nothing.
    fn new<A: Arithmetic>(ray: &Ray) -> Option<BoxRay> {
        TopRay::new(ray)?;
        let greatest = |v: [f32; 3]| v.into_iter().fold(0.0f32, |m, x| m.max(x.abs()));
        let (length, distance) = (greatest(ray.direction), greatest(ray.origin));
        let tame = (1.0 / BOX_DIRECTION_MOST..=BOX_DIRECTION_MOST).contains(&length)
            && distance <= BOX_COORDINATE_MOST;
        let least = A::product(length, BOX_DIRECTION_LEAST);
        let reciprocal =
            ray.direction.map(|d| A::free_reciprocal(if d.abs() < least { least } else { d }));
        let t_min = snap(ray.t_min).clamp(-f32::MAX, f32::MAX);
        let t_min = if t_min > -ENDLESS {
            let lower = A::difference(t_min, A::product(t_min.abs(), STOP_SLACK));
            A::difference(lower, f32::MIN_POSITIVE)
        } else {
            -f32::MAX
        };
        Some(BoxRay { origin: ray.origin, reciprocal, distance, t_min, tame })
    }

    /// [`TopRay::stop_after`], finite.
    fn stop_after<A: Arithmetic>(t_max: f32) -> f32 {
        let t_max = if t_max >= 0.0 { max(t_max, f32::MIN_POSITIVE) } else { t_max };
        if t_max.abs() >= ENDLESS {
            return if t_max > 0.0 { f32::MAX } else { -f32::MAX };
        }
        A::sum(t_max, A::product(t_max.abs(), STOP_SLACK))
    }

    /// Where the ray enters a child's box, in the order of the floats; [`NO_CHILD`] where it does not meet it up to `stop`.
    fn key<A: Arithmetic>(&self, node: &PackedTopNode, slot: usize, stop: f32) -> u32 {
        let child = node.children[slot];
        let (mut near, mut far) = (self.t_min, stop);
        if child == TOP_NONE {
            return NO_CHILD;
        }
        if self.tame && child & ALWAYS == 0 {
            let wider = A::free_mul(node.reach[slot], self.distance);
            for axis in 0..3 {
                let (origin, reciprocal) = (self.origin[axis], self.reciprocal[axis]);
                let low = A::free_sub(A::free_sub(node.lo[axis][slot], wider), origin);
                let high = A::free_sub(A::free_mul_add(1.0, node.hi[axis][slot], wider), origin);
                let (first, last) = if reciprocal < 0.0 { (high, low) } else { (low, high) };
                near = max(near, A::free_mul(first, reciprocal));
                far = crate::aabb::min(far, A::free_mul(last, reciprocal));
            }
        }
        if near <= far { ordered_bits(near) } else { NO_CHILD }
    }
}

/// A ray's way through the tree over instances: nodes with the children that are yet to be visited, the next one last. An entry is
/// a node times 256, and a bit for each child.
struct BoxStack {
    entries: [u32; WIDEST_STACK],
    top: usize,
}

impl BoxStack {
    fn new(nodes: usize) -> BoxStack {
        // The root with all of its children.
        let mut entries = [0; WIDEST_STACK];
        entries[0] = 0xff;
        BoxStack { entries, top: min(nodes, 1) }
    }

    /// The way through a tree that begins at another node.
    fn at(root: u32) -> BoxStack {
        let mut stack = BoxStack::new(1);
        stack.entries[0] |= root << 8;
        stack
    }

    /// The next instance that the ray enters, nearest boxes first.
    fn next<A: Arithmetic>(
        &mut self,
        nodes: &[PackedTopNode],
        ray: &BoxRay,
        stop: f32,
    ) -> Option<u32> {
        while self.top > 0 {
            self.top -= 1;
            let entry = self.entries[self.top];
            let node = &nodes[(entry >> 8) as usize];
            let (mut nearest, mut first, mut met) = (NO_CHILD, 0, 0u32);
            for slot in 0..TOP_WIDTH {
                if entry >> slot & 1 == 1 {
                    let key = ray.key::<A>(node, slot, stop);
                    met |= u32::from(key != NO_CHILD) << slot;
                    if key < nearest {
                        (nearest, first) = (key, slot);
                    }
                }
            }
            if met == 0 {
                continue;
            }
            let rest = met & !(1 << first);
            if rest != 0 {
                self.entries[self.top] = entry & !0xff | rest;
                self.top += 1;
            }
            let child = node.children[first] & !ALWAYS;
            if child & TOP_INSTANCE != 0 {
                return Some(child & !TOP_INSTANCE);
            }
            self.entries[self.top] = child << 8 | 0xff;
            self.top += 1;
        }
        None
    }
}

impl Triangles for PackedScene {
    fn corners(&self, triangle: u32) -> Triangle {
        self.triangles[triangle as usize]
    }
}

impl PackedInstance {
    /// The side that is ignored, as the object sees it; `None` where both are.
    fn culling(&self, query: u32) -> Option<Culling> {
        let mirrored = self.sides & MIRRORED != 0;
        match ((self.sides | query) & 3, mirrored) {
            (0, _) => Some(Culling::None),
            (1, false) | (2, true) => Some(Culling::Back),
            (2, false) | (1, true) => Some(Culling::Front),
            _ => None,
        }
    }

    fn scale(&self) -> SceneScale {
        SceneScale {
            bounds: Aabb { lo: self.lo, hi: self.hi },
            slack: self.slack,
            // Not used by rays.
            base_slack: 0.0,
            origin_least: self.origin_least,
            near: Aabb { lo: self.near_lo, hi: self.near_hi },
            wide: self.wide != 0,
        }
    }
}

impl PackedScene {
    /// Traces one ray under accuracy `watertight`: the hit of least (t, instance, triangle), or any. The answers of
    /// [`SceneAccelerator`](super::super::SceneAccelerator), bit for bit.
    pub fn trace<A: Arithmetic>(&self, ray: &Ray, batch: &SceneBatch) -> SceneHit {
        let query = if batch.any == 0 { Query::Closest } else { Query::Any };
        let mut best = SceneHit::MISS;
        let Some(boxes) = BoxRay::new::<A>(ray) else { return best };
        let mut stack = BoxStack::new(self.box_nodes.len());
        loop {
            let stop = BoxRay::stop_after::<A>(ray.t_max.min(best.t));
            let Some(name) = stack.next::<A>(&self.box_nodes, &boxes, stop) else { return best };
            let found = self.trace_in::<A>(name, ray, &best, batch, query);
            if found.is_hit() && found.precedes(&best) {
                best = found;
                if query == Query::Any {
                    return best;
                }
            }
        }
    }

    /// Traces a ray through one instance.
    fn trace_in<A: Arithmetic>(
        &self,
        name: u32,
        ray: &Ray,
        best: &SceneHit,
        batch: &SceneBatch,
        query: Query,
    ) -> SceneHit {
        let own = &self.instances[name as usize];
        let Some(culling) = own.culling(batch.culling) else { return SceneHit::MISS };
        if own.mask & batch.mask == 0 {
            return SceneHit::MISS;
        }
        let ignored = (batch.ignored_instance == name)
            .then(|| own.first_triangle.wrapping_add(batch.ignored_triangle));
        let limit = if best.t >= 0.0 { max(best.t, f32::MIN_POSITIVE) } else { best.t };
        let limited = ray.with_limits(ray.t_min, ray.t_max.min(limit.next_up()));
        let space = ObjectSpace { inverse: own.inverse, mirrored: own.sides & MIRRORED != 0 };
        let (scale, seen) = (own.scale(), space.ray_in::<A>(&limited));
        if own.opacity & SHAPES != 0 {
            let ignored = (batch.ignored_instance == name).then_some(batch.ignored_triangle);
            let hit = self.trace_shapes::<A>(own, &seen, culling, ignored, query);
            return SceneHit::of(&hit, GeometryId(own.sides >> 3), InstanceId(name));
        }
        let Some(seen) = PreparedRay::new::<A>(&seen, &scale) else { return SceneHit::MISS };
        let Some(interval) = seen.enter::<A>(&scale.bounds) else { return SceneHit::MISS };
        let options = &QueryOptions {
            accuracy: Accuracy::Watertight,
            culling,
            ignore: ignored,
            ..QueryOptions::default()
        };
        let inner = InnerRay::<A>::new(&seen);
        let mut found = Best { hit: Hit::MISS, stop: f32::INFINITY };
        walk_from(&self.nodes, own.root, &inner, interval, &mut |leaf: Leaf<f32>| {
            let Leaf { first, count, .. } = leaf;
            let tested = &self.references[first as usize..][..count as usize];
            found.test_kept::<A, ()>(&seen, self, tested, options, query, &mut (), &mut |hit| {
                self.is_opaque::<A>(own.opacity, hit)
            })
        });
        let mut hit = found.hit;
        if hit.is_hit() {
            hit.triangle -= own.first_triangle;
        }
        SceneHit::of(&hit, GeometryId(own.sides >> 3), InstanceId(name))
    }

    /// Traces a ray, as an instance of shapes sees it: [`ShapeTree::trace`](crate::scene::ShapeTree::trace).
    fn trace_shapes<A: Arithmetic>(
        &self,
        own: &PackedInstance,
        ray: &Ray,
        culling: Culling,
        ignored: Option<u32>,
        query: Query,
    ) -> Hit {
        let mut best = Hit::MISS;
        let rays = BoxRay::new::<A>(ray).zip(ShapeRay::new::<A>(ray));
        let Some((boxes, ready)) = rays else { return best };
        let nodes: &[PackedTopNode] = bytemuck::cast_slice(&self.shapes);
        let mut stack = BoxStack::at(own.opacity & !SHAPES);
        loop {
            let stop = BoxRay::stop_after::<A>(ray.t_max.min(best.t));
            let Some(number) = stack.next::<A>(nodes, &boxes, stop) else { return best };
            let capsule = self.capsule(own.first_triangle, number);
            let span = capsule.span::<A>(&ready).filter(|_| ignored != Some(number));
            let Some(span) = span else { continue };
            for (end, front) in [(0, true), (1, false)] {
                let hit = Hit { t: span.t[end], triangle: number, u: span.u[end], v: 0.0 };
                let within = ray.t_min <= hit.t && hit.t <= ray.t_max && hit.t.abs() <= f32::MAX;
                if within && !is_culled(culling, front) && hit.precedes(&best) {
                    best = hit;
                }
            }
            if query == Query::Any && best.is_hit() {
                return best;
            }
        }
    }

    /// A shape of the set whose shapes begin at a block.
    fn capsule(&self, block: u32, number: u32) -> Capsule {
        let at =
            &self.shapes[block as usize + number as usize / 8][8 * (number as usize % 8)..][..8];
        let point = |from: usize| [0, 1, 2].map(|axis| f32::from_bits(at[from + axis]));
        Capsule { ends: [point(0), point(4)], radius: f32::from_bits(at[3]) }
    }

    /// Whether a hit counts, with a triangle among all triangles, where the geometry's opacity mask begins there.
    fn is_opaque<A: Arithmetic>(&self, opacity: u32, hit: &Hit) -> bool {
        if opacity == 0 {
            return true;
        }
        let mask = &self.references[opacity as usize..];
        let (level, own) = (mask[0], hit.triangle - mask[1]);
        let cell = opacity_bit::<A>(level, own, [hit.u, hit.v]);
        mask[OPACITY_HEAD + (cell / 32) as usize] >> (cell % 32) & 1 != 0
    }
}
