//! A ray under way, as steps at nodes and tests of blocks read it.

use splitplane_core::aabb::Aabb;
use splitplane_core::arithmetic::Strict;
use splitplane_core::query::intersect::{PLANE_SLACK, PreparedRay, SceneScale};
use splitplane_core::query::traverse::Query;
use splitplane_core::ray::{Accuracy, Hit, Ray};

/// A ray under way: the values that a step at a node needs, and those that a test of a block needs, in a cache line each. What
/// [`super::prepare_one`] has side by side is side by side here.
#[derive(Clone, Copy, Debug, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C, align(64))]
pub(crate) struct RayState {
    pub reciprocal: [f32; 3],
    pub enter: f32,
    /// Origin times reciprocal, with the slack of planes added, and in `far` with it taken away; boxes allow for their
    /// triangles' sizes.
    pub near: [f32; 3],
    /// Where the ray leaves the bounds, or where nothing can precede its best hit any more.
    pub stop: f32,
    /// [`EXIT_FACTOR`] times the reciprocal, for planes behind which a ray leaves; so is `far`.
    pub exit_reciprocal: [f32; 3],
    /// Bits 0 to 2: the direction is negative on x, y, z; bit 3: far children come first.
    pub octant: u32,
    pub far: [f32; 3],
    /// The ray's place in its batch; [`RayState::NO_RAY`] for none.
    pub index: u32,
    /// The origin on the sheared axes.
    pub origin: [f32; 3],
    pub shear: [f32; 3],
    pub t_min: f32,
    pub t_max: f32,
    pub limits: [f32; 2],
    /// The largest component's axis, and 3 more if it is negative.
    pub axes: u32,
    pub exponent: i32,
    pub direction: [f32; 3],
    /// See [`PreparedRay::offset`].
    pub offset: f32,
}

/// Words of a [`RayState`].
pub(crate) const RAY_STATE_WORDS: usize = size_of::<RayState>() / 4;

/// The axes that shearing calls x, y and z, by [`RayState::axes`]. Two more than there are, so that
/// the remainder operation that keeps indices in bounds costs nothing.
pub(crate) static AXES: [[usize; 3]; 8] =
    [[1, 2, 0], [2, 0, 1], [0, 1, 2], [2, 1, 0], [0, 2, 1], [1, 0, 2], [0, 1, 2], [0, 1, 2]];

/// The same as bytes from x's coordinate to theirs, where one follows the other: so that finding rows takes no shifts.
static BYTES_TO_AXES: [[usize; 3]; 8] = {
    let mut bytes = [[0; 3]; 8];
    let mut i = 0;
    while i < 24 {
        bytes[i / 3][i % 3] = size_of::<f32>() * AXES[i / 3][i % 3];
        i += 1;
    }
    bytes
};

/// [`RayState::axes`] by the signs of a direction's components, and from bit 3 on by which of them are the largest.
pub(crate) static AXES_OF_SIGNS: [u8; 64] = {
    let mut axes = [0; 64];
    let mut i = 0;
    while i < 64 {
        let (negative, largest): (usize, usize) = (i & 7, i >> 3);
        // The first of the largest components.
        let axis = if largest == 0 { 0 } else { largest.trailing_zeros() as usize };
        axes[i] = (axis + 3 * (negative >> axis & 1)) as u8;
        i += 1;
    }
    axes
};

/// By [`RayState::axes`] where the words from `origin` on come from: of an origin with `t_min` and of slopes with the last one. Two words
/// more than count.
pub(crate) static SHEARED: [[u32; 8]; 8] = {
    let mut places = [[3; 8]; 8];
    let mut i = 0;
    while i < 8 {
        let [x, y, z] = AXES[i];
        let [x, y, z] = [x as u32, y as u32, z as u32];
        places[i] = [x, y, z, 4 + x, 4 + y, 7, 3, 3];
        i += 1;
    }
    places
};

/// The sign of the largest component by [`RayState::axes`].
pub(crate) static SIGNS: [f32; 8] = [0.0, 0.0, 0.0, -0.0, -0.0, -0.0, 0.0, 0.0];

/// Where among these x, y and z are.
static PLACES: [[usize; 3]; 6] = [[2, 0, 1], [1, 2, 0], [0, 1, 2], [2, 1, 0], [0, 2, 1], [1, 0, 2]];

/// How to trace a ray that the vector code did not prepare.
pub(crate) enum ScalarOutcome {
    /// It goes through the wide nodes.
    Traced(RayState),
    /// It is answered.
    Answer(Hit),
}

/// The error of a ray that the sieve of accuracy `exact` assumes, in inner units. Preparing it
/// flushes what is below 2^-126 in its direction and, of its greatest coordinate, in its origin:
/// less than 2^-65 on any axis then.
const FARTHEST: f32 = 1.152_921_5e18; // 2^60
/// Greatest exponent, either way, of directions that are scaled in one step.
const MOST_EXPONENT: i32 = 126;

impl RayState {
    /// A ray prepared by the core, moved if it starts far away; `None` for the few that must be
    /// traced alone.
    #[cold]
    pub(crate) fn prepare_by_core(
        ray: &Ray,
        scene: &SceneScale,
        accuracy: Accuracy,
        query: Query,
    ) -> Option<ScalarOutcome> {
        let from = ray.origin.iter().fold(0.0f32, |most, x| most.max(x.abs()));
        let Some(ray) = PreparedRay::new::<Strict>(ray, scene) else {
            return Some(ScalarOutcome::Answer(Hit::MISS));
        };
        let too_far = accuracy == Accuracy::Exact && from.max(ray.offset.abs()) > FARTHEST;
        if ray.wide || ray.exponent.abs() > MOST_EXPONENT || too_far {
            return None;
        }
        Some(
            RayState::of(&ray, scene, query)
                .map_or(ScalarOutcome::Answer(Hit::MISS), ScalarOutcome::Traced),
        )
    }

    /// The state of a ray that the core has prepared; `None` where the ray misses the scene's bounds.
    fn of(ray: &PreparedRay, scene: &SceneScale, query: Query) -> Option<RayState> {
        let (enter, exit) = ray.enter::<Strict>(&around_moved(&scene.bounds, ray))?;
        let reach = behind(enter, exit);
        let (mut near, mut far, mut octant) = ([0.0; 3], [0.0; 3], 0);
        for axis in 0..3 {
            let from = ray.origin[axis] * ray.reciprocal[axis];
            let base = (scene.base_slack * ray.reciprocal[axis].abs()).min(f32::MAX);
            let slack = (base + from.abs() * ORIGIN_SLACK) + reach;
            (near[axis], far[axis]) = (from + slack, (from - slack) * EXIT_FACTOR);
            octant |= u32::from(ray.direction[axis] < 0.0) << axis;
        }
        let solid = query == Query::Any && far_end_is_solid(enter, ray.t_min, exit, ray.t_max);
        let main = ray.axes[2];
        Some(RayState {
            reciprocal: ray.reciprocal,
            near,
            far,
            enter,
            stop: exit,
            octant: octant | u32::from(solid) << 3,
            origin: ray.axes.map(|axis| ray.origin[axis]),
            shear: ray.shear,
            t_min: ray.t_min,
            t_max: ray.t_max,
            axes: main as u32 + 3 * (octant >> main & 1),
            exponent: ray.exponent,
            limits: ray.limits,
            direction: ray.direction,
            exit_reciprocal: ray.reciprocal.map(|r| r * EXIT_FACTOR),
            index: RayState::NO_RAY,
            offset: ray.offset,
        })
    }

    /// Not a place in a batch.
    pub(crate) const NO_RAY: u32 = u32::MAX;

    /// No ray.
    pub(crate) const NONE: RayState = RayState {
        reciprocal: [0.0; 3],
        enter: 0.0,
        near: [0.0; 3],
        stop: 0.0,
        exit_reciprocal: [0.0; 3],
        octant: 0,
        far: [0.0; 3],
        index: RayState::NO_RAY,
        origin: [0.0; 3],
        shear: [0.0; 3],
        t_min: 0.0,
        t_max: 0.0,
        limits: [0.0; 2],
        axes: 0,
        exponent: 0,
        direction: [0.0; 3],
        offset: 0.0,
    };

    /// No ray.
    pub(crate) fn none() -> RayState {
        RayState::NONE
    }

    /// The axes that shearing calls x, y and z.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) fn axes(&self) -> [usize; 3] {
        AXES[self.axes as usize % AXES.len()]
    }

    /// [`RayState::axes`] as bytes from x's coordinate to theirs.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) fn bytes_to_axes(&self) -> [usize; 3] {
        BYTES_TO_AXES[self.axes as usize % BYTES_TO_AXES.len()]
    }

    /// The largest component of the direction: from 1 to below 2, either way.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) fn largest(&self) -> f32 {
        let [.., bytes] = self.bytes_to_axes();
        // SAFETY: bytes from the first of three numbers to one of them.
        unsafe { *self.direction.as_ptr().byte_add(bytes) }
    }

    /// The ray as the reference tests take it.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) fn ray(&self) -> PreparedRay {
        let axes = self.axes();
        // By look-ups: reading numbers together that were written one by one would stall.
        let [x, y, z] = PLACES[self.axes as usize % 6];
        let origin = [self.origin[x], self.origin[y], self.origin[z]];
        PreparedRay {
            origin,
            direction: self.direction,
            reciprocal: self.reciprocal,
            // Of planes of the tree, which are left to boxes here.
            slack: [0.0; 3],
            axes,
            shear: self.shear,
            t_min: self.t_min,
            t_max: self.t_max,
            limits: self.limits,
            offset: self.offset,
            exponent: self.exponent,
            wide: false,
        }
    }
}

/// Distances to planes are differences of products here. At most five roundings are of the origin's product,
/// three of them only where rays leave; this is eight.
pub(crate) const ORIGIN_SLACK: f32 = 4.768_371_6e-7; // 2^-21
/// The factor on distances where rays leave boxes. A ray that is in a box at T is computed to enter
/// it at T (1 + e) or before and to leave it at T (1 - e) or after, with e = [`PLANE_SLACK`]; this
/// is 1 + 4 e, so that it leaves after it enters. It is multiplied into the reciprocals beforehand;
/// as a multiplication in each step it took 2 % of the time.
pub(crate) const EXIT_FACTOR: f32 = 1.0 + 4.0 * PLANE_SLACK;
/// The part by which planes are widened for rays that begin before their origin, of the greatest distance at
/// which the ray is within the bounds: distances below 0 are not made greater by a factor.
pub(crate) const BEHIND_SLACK: f32 = 8.0 * PLANE_SLACK;

/// More than what moving an origin rounds away of a coordinate, as a part of it: that is one rounding, 2^-24, and little else. Boxes of nodes have it in
/// [`ORIGIN_SLACK`]; the scene's bounds have nothing like that.
const MOVED_SLACK: f32 = 2.384_185_8e-7; // 2^-22

/// Bounds as a moved ray must be held against: an exact hit lies on the ray as it was given, which may run along a side of the bounds that the moved
/// one passes outside of, or comes to later.
fn around_moved(bounds: &Aabb, ray: &PreparedRay) -> Aabb {
    let mut around = *bounds;
    if ray.offset != 0.0 {
        for axis in 0..3 {
            let slack = ray.origin[axis].abs() * MOVED_SLACK;
            around.lo[axis] = (around.lo[axis] - slack).next_down();
            around.hi[axis] = (around.hi[axis] + slack).next_up();
        }
    }
    around
}

/// The additional slack of planes for a ray that is within the bounds in an interval.
#[cfg_attr(not(unoptimised), inline(always))]
pub(crate) fn behind(enter: f32, exit: f32) -> f32 {
    let (from, to) = (enter.abs(), exit.abs());
    let reach = if from > to { from } else { to } * BEHIND_SLACK;
    if enter < 0.0 { reach } else { 0.0 }
}

/// Whether a ray probably ends at something solid: it starts within the bounds and runs out of them.
/// Such rays, indoors, meet the walls first when they ask for any hit from the far end.
#[cfg_attr(not(unoptimised), inline(always))]
pub(crate) fn far_end_is_solid(enter: f32, t_min: f32, exit: f32, t_max: f32) -> bool {
    (enter <= t_min) & (exit < t_max)
}
