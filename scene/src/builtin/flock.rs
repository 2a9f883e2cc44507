//! A flock of birds that circle over a lake: every one moves in every frame.

use super::BuiltinError;
use super::builder::{Builder, Point};
use super::forest::look;
use super::hills::{Hills, Kinds, Objects, ground};
use crate::angle::sin_cos;
use crate::instanced::{InstancedScene, Key, Placed, Pose};
use splitplane_core::random::unit;

const DEFAULT: u64 = 2_000;
const SEED: u64 = 59;
/// Frames of a round, after which it begins again without a seam, and those between two keys of a bird.
const FRAMES: u32 = 240;
const BETWEEN: u32 = 6;
/// Objects that stay.
const TREES: u64 = 350;

pub(super) fn open(size: Option<&str>) -> Result<InstancedScene, BuiltinError> {
    let count = super::size("flock", size, DEFAULT, [10, 20_000])?;
    let hills = Hills { side: 110.0 };
    let mut objects = Objects::new("flock");
    ground(&mut objects, hills);
    let kinds = Kinds::new(&mut objects);
    let eye = look(&mut objects, hills);
    kinds.scatter(&mut objects, hills, TREES, eye);
    let colours = [[0.82, 0.80, 0.76], [0.10, 0.10, 0.12], [0.62, 0.16, 0.08], [0.75, 0.52, 0.12]];
    let colours = colours.map(|colour| objects.builder.material("plumage", colour));
    let wings =
        [0.28, -0.05, -0.3].map(|lift| objects.geometry("bird", |b| bird(b, colours[0], lift)));
    for number in 0..count {
        let draw = |k: u64| unit(SEED, &[number, k]);
        let colour = colours[(draw(0) * draw(1) * 4.0) as usize % 4];
        let keys = keys(draw, count);
        let transform = keys[0].pose.transform();
        let geometry = wings[(draw(2) * 3.0) as usize % 3];
        let (material, id) = (Some(colour), number as u32);
        objects.instances.push(Placed { material, id, keys, ..Placed::new(geometry, transform) });
    }
    Ok(objects.finish(FRAMES, 1.0 / 24.0))
}

/// Circles of many sizes around an axis over the lake, dense near the middle.
fn keys(draw: impl Fn(u64) -> f64, count: u64) -> Vec<Key> {
    let spread = (count as f64 / 2000.0).sqrt().max(0.35);
    let radius = spread * (4.0 + 20.0 * draw(3) * draw(4));
    let height = 8.0 + spread * (13.0 * draw(5) + 0.25 * radius);
    let (rounds, phase) = (if radius < 12.0 { 2.0 } else { 1.0 }, draw(6));
    let middle = [3.0 * (draw(7) - 0.5), -12.0 + 4.0 * (draw(8) - 0.5)];
    let size = 0.45 + 0.3 * draw(9);
    let pose = |frame: u32| {
        let part = f64::from(frame) / f64::from(FRAMES);
        let (sin, cos) = sin_cos(rounds * part + phase);
        let (wave, _) = sin_cos(3.0 * part + draw(10));
        // It flies along its own x axis, which is the direction of a growing angle, and leans inwards.
        let heading = Pose::rotation([0.0, 1.0, 0.0], -360.0 * (rounds * part + phase) - 90.0);
        let lean = Pose::rotation([1.0, 0.0, 0.0], 16.0 + 14.0 * wave);
        let still = Pose::IDENTITY.rotate;
        Pose {
            translate: [middle[0] + radius * cos, height + 1.6 * wave, middle[1] + radius * sin],
            rotate: product(heading.unwrap_or(still), lean.unwrap_or(still)),
            scale: [size; 3],
        }
    };
    (0..=FRAMES / BETWEEN).map(|k| Key { frame: k * BETWEEN, pose: pose(k * BETWEEN) }).collect()
}

/// The rotation by the second, then the first.
fn product([x, y, z, w]: [f64; 4], [a, b, c, d]: [f64; 4]) -> [f64; 4] {
    [
        w * a + x * d + y * c - z * b,
        w * b - x * c + y * d + z * a,
        w * c + x * b - y * a + z * d,
        w * d - x * a - y * b - z * c,
    ]
}

/// A bird that flies along x, with wings that are lifted so far.
fn bird(b: &mut Builder, plumage: u32, lift: f64) {
    let start = b.mark();
    b.sphere(plumage, [0.0; 3], 1.0, 8);
    b.reshape(start, |[x, y, z]| {
        let thick = 0.17 * (1.0 - 0.35 * x) * (if x > 0.6 { 1.25 } else { 1.0 });
        [0.8 * x, thick * y + 0.05 * x, thick * z]
    });
    b.smooth(start);
    let mut wing = |side: f64| {
        let points: [Point; 6] = [
            [0.42, 0.05, 0.1 * side],
            [-0.25, 0.05, 0.1 * side],
            [0.34, 0.05 + 0.6 * lift, 0.75 * side],
            [-0.22, 0.05 + 0.6 * lift, 0.7 * side],
            [-0.05, 0.05 + lift, 1.6 * side],
            [-0.25, 0.05 + lift, 1.5 * side],
        ];
        let v = points.map(|point| b.vertex(point));
        b.join(plumage, [v[0], v[1], v[3], v[2]]);
        b.join(plumage, [v[2], v[3], v[5], v[4]]);
    };
    wing(1.0);
    wing(-1.0);
    b.quad(
        plumage,
        [[-0.7, 0.0, 0.06], [-1.25, 0.05, 0.3], [-1.25, 0.05, -0.3], [-0.7, 0.0, -0.06]],
    );
}
