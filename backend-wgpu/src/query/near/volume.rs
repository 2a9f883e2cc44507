//! Volumes as a device has them: a box and half-spaces around them, as seen from an origin in a unit.

use splitplane_core::aabb::Aabb;
use splitplane_core::arithmetic::snap;
use splitplane_core::layout::NearBatch;
use splitplane_core::query::overlap::{Plane, Region, Volume};

use super::unit::unit_at;

/// Farther away than anything in a scene, in the unit of a volume: half-spaces beyond it are all or nothing.
const BEYOND: f64 = 8.0;
/// Most half-spaces of a volume on a device.
const MOST_PLANES: usize = 64;
/// What a half-space may err before it is sent, in a volume's unit: less than a rounding on the device.
const OFFSET_ERROR: f64 = 1.0 / 16_777_216.0;
/// Roundings of a few operations in `f64`, relative, with room to spare.
const FEW: f64 = 1e-14;
/// The square of the sine of an angle from which on the normal of a triangle is known well enough.
const WIDE: f64 = 1e-10;

/// The rows of a volume, and its half-spaces.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Sent {
    rows: [[f32; 4]; 4],
    planes: Vec<[f32; 4]>,
}

impl Sent {
    /// The rows, where half-spaces so far are this many.
    pub(super) fn rows(&self, first: usize) -> [[f32; 4]; 4] {
        let mut rows = self.rows;
        rows[3] = [word(first as u32), word(self.planes.len() as u32), 0.0, 0.0];
        rows
    }

    pub(super) fn planes(&self) -> &[[f32; 4]] {
        &self.planes
    }
}

/// A word among floats.
fn word(word: u32) -> f32 {
    f32::from_bits(word)
}

type Vector = [f64; 3];

fn dot(a: Vector, b: Vector) -> f64 {
    (a[0] * b[0] + a[1] * b[1]) + a[2] * b[2]
}

fn difference(a: Vector, b: Vector) -> Vector {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

fn cross(a: Vector, b: Vector) -> Vector {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// The vector of length 1; `None` where it has no direction.
fn unit_vector(a: Vector) -> Option<Vector> {
    let length = dot(a, a).sqrt();
    (length > 0.0 && length.is_finite()).then(|| a.map(|x| x / length))
}

/// The greatest `f32` that is not above.
fn down(x: f64) -> f32 {
    let near = (x as f32).clamp(-f32::MAX, f32::MAX);
    let below = if f64::from(near) > x { near.next_down() } else { near };
    below.max(-f32::MAX)
}

/// The least `f32` that is not below.
fn up(x: f64) -> f32 {
    -down(-x)
}

fn sent(origin: [f32; 3], unit: f32, bounds: [[f32; 3]; 2], radius: f32, kind: u32) -> Sent {
    let ([x, y, z], [lo, hi]) = (origin, bounds);
    let rows = [[x, y, z, unit], [lo[0], lo[1], lo[2], radius], [hi[0], hi[1], hi[2], word(kind)]];
    Sent { rows: [rows[0], rows[1], rows[2], [0.0; 4]], planes: Vec::new() }
}

/// A half-space by the normal of length about 1 and the distance of its plane from the origin, in the unit; widened where the normal is
/// rounded, by less than a device allows for.
fn half_space(normal: Vector, offset: f64) -> [f32; 4] {
    let [x, y, z] = normal.map(|x| x as f32);
    [x, y, z, up(offset.clamp(-BEYOND, BEYOND))]
}

/// A half-space of the caller's, as seen from an origin; `None` where a device would know it too badly.
fn half_space_of(plane: &Plane, origin: [f32; 3], unit: f32) -> Option<[f32; 4]> {
    let normal = plane.normal.map(|x| f64::from(snap(x)));
    let greatest = normal.iter().fold(0.0f64, |most, x| most.max(x.abs()));
    if greatest == 0.0 {
        return None;
    }
    let normal = normal.map(|x| x / greatest);
    let offset = f64::from(snap(plane.offset)) / greatest;
    let origin = origin.map(f64::from);
    let size =
        [0, 1, 2].iter().fold(offset.abs(), |sum, &axis| sum + (normal[axis] * origin[axis]).abs());
    let unit = f64::from(unit);
    let known = size * FEW * unit <= OFFSET_ERROR;
    known.then(|| half_space(normal, (offset - dot(normal, origin)) * unit))
}

/// What a device is told of a volume that meets nothing.
pub(super) fn nothing() -> Sent {
    sent([0.0; 3], 1.0, [[1.0; 3], [-1.0; 3]], 0.0, NearBatch::KIND_BOX)
}

/// What a device is told of a volume about which it is not asked.
pub(super) fn not_asked() -> Sent {
    sent([0.0; 3], 1.0, [[1.0; 3], [-1.0; 3]], 0.0, NearBatch::KIND_NONE)
}

/// What a device is told of a volume that meets something; `None` where it cannot measure there. `bounds` hold all triangles.
pub(super) fn to_send(volume: &Volume<'_>, region: &Region, bounds: &Aabb) -> Option<Sent> {
    let around = region.bounds();
    let around = [around[0].map(down), around[1].map(up)];
    let snapped = |point: [f32; 3]| point.map(snap);
    let everywhere = |radius: f32| radius.is_infinite();
    match *volume {
        Volume::Box(_) => Some(sent([0.0; 3], 1.0, around, 0.0, NearBatch::KIND_BOX)),
        Volume::Ball { radius, .. } | Volume::Capsule { radius, .. } if everywhere(radius) => {
            Some(sent([0.0; 3], 1.0, around, 0.0, NearBatch::KIND_BOX))
        }
        Volume::Ball { centre, radius } => {
            let (centre, radius) = (snapped(centre), snap(radius));
            let unit = unit_at(centre, bounds, radius)?;
            Some(sent(centre, unit, around, radius * unit, NearBatch::KIND_BALL))
        }
        Volume::Planes(planes) if planes.len() <= MOST_PLANES => {
            let middle = |axis: usize| {
                (0.5 * (f64::from(bounds.lo[axis]) + f64::from(bounds.hi[axis]))) as f32
            };
            let origin = [middle(0), middle(1), middle(2)];
            let unit = unit_at(origin, bounds, 0.0)?;
            let mut own = sent(origin, unit, around, 0.0, NearBatch::KIND_PLANES);
            own.planes.try_reserve_exact(planes.len()).ok()?;
            for plane in planes {
                own.planes.push(half_space_of(plane, origin, unit)?);
            }
            Some(own)
        }
        Volume::Capsule { from, to, radius } => {
            let (from, to) = (snapped(from), snapped(to));
            let middle =
                [0, 1, 2].map(|axis| (0.5 * (f64::from(from[axis]) + f64::from(to[axis]))) as f32);
            let unit = unit_at(middle, bounds, 0.0)?;
            let mut own = sent(middle, unit, around, 0.0, NearBatch::KIND_WITHIN);
            own.planes = box_along(from, to, snap(radius), middle, unit);
            Some(own)
        }
        Volume::Triangle(corners) => {
            let corners = corners.map(snapped);
            let unit = unit_at(corners[0], bounds, 0.0)?;
            let mut own = sent(corners[0], unit, around, 0.0, NearBatch::KIND_WITHIN);
            own.planes = slab_of(corners, unit);
            Some(own)
        }
        _ => None,
    }
}

/// The sides of the box along a segment that holds all within a radius of it; none where the segment has no direction.
fn box_along(
    from: [f32; 3],
    to: [f32; 3],
    radius: f32,
    origin: [f32; 3],
    unit: f32,
) -> Vec<[f32; 4]> {
    let scale = f64::from(unit);
    let seen = |point: [f32; 3]| {
        difference(point.map(f64::from), origin.map(f64::from)).map(|x| x * scale)
    };
    let ends = [seen(from), seen(to)];
    let Some(along) = unit_vector(difference(ends[1], ends[0])) else { return Vec::new() };
    // Across the axis along which the segment reaches least.
    let mut least = 0;
    for axis in 1..3 {
        if along[axis].abs() < along[least].abs() {
            least = axis;
        }
    }
    let mut axis = [0.0; 3];
    axis[least] = 1.0;
    let Some(across) = unit_vector(cross(along, axis)) else { return Vec::new() };
    let radius = f64::from(radius) * scale;
    [along, across, cross(along, across)]
        .into_iter()
        .flat_map(|normal| [normal, normal.map(|x| -x)])
        .map(|normal| {
            let farthest = dot(normal, ends[0]).max(dot(normal, ends[1]));
            let size = farthest.abs() + radius + dot(ends[0], ends[0]).sqrt();
            half_space(normal, farthest + radius + size * FEW)
        })
        .filter(|plane| plane[3].is_finite())
        .collect()
}

/// The two sides of a triangle's plane, as seen from its first corner; none where it is not known well.
fn slab_of(corners: [[f32; 3]; 3], unit: f32) -> Vec<[f32; 4]> {
    let [a, b, c] = corners.map(|corner| corner.map(f64::from));
    let (e, f) = (unit_vector(difference(b, a)), unit_vector(difference(c, a)));
    let (Some(e), Some(f)) = (e, f) else { return Vec::new() };
    let normal = cross(e, f);
    if dot(normal, normal) < WIDE {
        return Vec::new();
    }
    let Some(normal) = unit_vector(normal) else { return Vec::new() };
    let scale = f64::from(unit);
    // How far the other corners are off by the normal's rounding to `f32`.
    let own = normal.map(|x| f64::from(x as f32));
    let off = |corner: Vector| (dot(own, difference(corner, a)) * scale).abs();
    // What is summed may cancel, so the error is in proportion to the sides.
    let side = |corner: Vector| {
        let side = difference(corner, a);
        dot(side, side).sqrt() * scale
    };
    let reach = off(b).max(off(c)) + (side(b) + side(c)) * FEW;
    [normal, normal.map(|x| -x)].into_iter().map(|normal| half_space(normal, reach)).collect()
}
