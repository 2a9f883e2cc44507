//! Where an object stands: moved, turned and scaled; and between two such poses.

use crate::angle::sin_cos;
use splitplane_core::scene::Transform;
use splitplane_float_state::standard;

/// Scaled, then turned, then moved. In `f64`; a transform is rounded to `f32` once.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// By how much it is moved.
    pub translate: [f64; 3],
    /// How it is turned: a quaternion of length 1, the real part last.
    pub rotate: [f64; 4],
    /// The factor along each of its own axes; negative ones reflect.
    pub scale: [f64; 3],
}

/// A pose in a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Key {
    /// The frame.
    pub frame: u32,
    /// The pose.
    pub pose: Pose,
}

impl Pose {
    /// In place.
    pub const IDENTITY: Pose =
        Pose { translate: [0.0; 3], rotate: [0.0, 0.0, 0.0, 1.0], scale: [1.0; 3] };

    /// A rotation around an axis of any length, by degrees, counter-clockwise seen against the axis; `None` for an axis of no direction.
    /// From `+ - * /` and square roots only, so it is the same everywhere.
    pub fn rotation([x, y, z]: [f64; 3], degrees: f64) -> Option<[f64; 4]> {
        standard(|| {
            let greatest = x.abs().max(y.abs()).max(z.abs());
            // The greatest of some numbers and a NaN is one of the numbers.
            if ![x, y, z, degrees].iter().all(|x| x.is_finite()) || greatest == 0.0 {
                return None;
            }
            let [x, y, z] = [x / greatest, y / greatest, z / greatest];
            let length = ((x * x + y * y) + z * z).sqrt();
            let (sin, cos) = sin_cos(degrees % 720.0 / 720.0);
            let part = sin / length;
            Some([x * part, y * part, z * part, cos])
        })
    }

    /// The transform from the object's space to the world.
    pub fn transform(&self) -> Transform {
        standard(|| {
            let [x, y, z, w] = self.rotate;
            let turned = [
                [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)],
                [2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)],
                [2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)],
            ];
            let [sx, sy, sz] = self.scale;
            let row = |row: usize| {
                let [a, b, c] = turned[row];
                [a * sx, b * sy, c * sz, self.translate[row]].map(|part| part as f32)
            };
            [row(0), row(1), row(2)]
        })
    }

    /// A pose between two: places and scales evenly, rotations the shorter way around by the sum of quaternions, brought to length 1.
    pub fn between(&self, other: &Pose, part: f64) -> Pose {
        standard(|| {
            let mix = |a: f64, b: f64| a + (b - a) * part;
            let dot: f64 = self.rotate.iter().zip(other.rotate).map(|(a, b)| a * b).sum();
            let sign = if dot < 0.0 { -1.0 } else { 1.0 };
            let sum: [f64; 4] =
                std::array::from_fn(|k| mix(self.rotate[k], sign * other.rotate[k]));
            // Two opposite halves of a turn have no shorter way; the sum is at least 1/2 long for all others.
            let length = sum.iter().map(|part| part * part).sum::<f64>().sqrt();
            Pose {
                translate: std::array::from_fn(|k| mix(self.translate[k], other.translate[k])),
                rotate: sum.map(|part| part / length),
                scale: std::array::from_fn(|k| mix(self.scale[k], other.scale[k])),
            }
        })
    }
}

/// The transform in a frame. There is a key.
pub(super) fn at(keys: &[Key], frame: u32) -> Transform {
    let after = keys.partition_point(|key| key.frame <= frame);
    let (Some(before), after) = (keys[..after].last(), keys.get(after)) else {
        return keys.first().map_or(Pose::IDENTITY, |key| key.pose).transform();
    };
    let Some(after) = after else { return before.pose.transform() };
    let part = f64::from(frame - before.frame) / f64::from(after.frame - before.frame);
    before.pose.between(&after.pose, part).transform()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn near(a: Transform, b: [[f64; 4]; 3]) {
        for (a, b) in a.as_flattened().iter().zip(b.as_flattened()) {
            assert!((f64::from(*a) - b).abs() < 1e-6, "{a} for {b}");
        }
    }

    #[test]
    fn a_quarter_turn_and_halfway_to_it() {
        let rotate = Pose::rotation([0.0, 0.0, 3.0], 90.0).unwrap();
        let turned = Pose { translate: [4.0, 0.0, -2.0], rotate, scale: [2.0, 1.0, -1.0] };
        near(
            turned.transform(),
            [[0.0, -1.0, 0.0, 4.0], [2.0, 0.0, 0.0, 0.0], [0.0, 0.0, -1.0, -2.0]],
        );
        let keys = [
            Key { frame: 2, pose: Pose::IDENTITY },
            Key { frame: 6, pose: Pose { scale: [1.0; 3], ..turned } },
        ];
        let half = 0.5f64.sqrt();
        near(
            at(&keys, 4),
            [[half, -half, 0.0, 2.0], [half, half, 0.0, 0.0], [0.0, 0.0, 1.0, -1.0]],
        );
        assert_eq!(at(&keys, 0), Pose::IDENTITY.transform());
        assert_eq!(at(&keys, 9), keys[1].pose.transform());
    }

    #[test]
    fn directions_that_are_none_are_no_axes() {
        for bad in [[0.0; 3], [f64::NAN, 0.0, 1.0], [f64::INFINITY, 0.0, 0.0]] {
            assert_eq!(Pose::rotation(bad, 10.0), None);
        }
        let tiny = Pose::rotation([0.0, 1e-300, 0.0], 180.0).unwrap();
        assert!((tiny[1] - 1.0).abs() < 1e-12, "{tiny:?}");
    }
}
