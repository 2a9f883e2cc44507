//! A camera that goes around a point.

use splitplane::scene::Camera;
use splitplane::{Accelerator, QueryOptions};

type Vector = [f64; 3];

/// Looking straight up or down, turning would have no axis: a tenth of a degree is kept from it.
const STEEPEST: f64 = 89.9 * std::f64::consts::PI / 180.0;
/// How much of an angle a picture's height of dragging turns, in radians.
const TURN: f64 = 3.0;

/// Angles are about the up direction of the camera that it started from.
pub(super) struct Orbit {
    first: Camera,
    /// What it goes around.
    target: Vector,
    up: Vector,
    ahead: Vector,
    side: Vector,
    first_pitch: f64,
    first_distance: f64,
    yaw: f64,
    pitch: f64,
    distance: f64,
    moved: bool,
}

fn dot(a: Vector, b: Vector) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn cross(a: Vector, b: Vector) -> Vector {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

fn scaled(a: Vector, by: f64) -> Vector {
    a.map(|x| x * by)
}

fn sum(a: Vector, b: Vector) -> Vector {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

fn unit(a: Vector) -> Vector {
    scaled(a, 1.0 / dot(a, a).sqrt())
}

impl Orbit {
    /// Around what the camera looks at; one that only looks somewhere goes around what it sees.
    pub(super) fn new(first: Camera, looks_somewhere: bool, tree: &dyn Accelerator) -> Orbit {
        let (eye, at) = (first.eye().map(f64::from), first.look_at().map(f64::from));
        let offset = sum(at, scaled(eye, -1.0));
        let forward = unit(offset);
        let mut distance = dot(offset, offset).sqrt();
        if looks_somewhere {
            let ray = first.through(1, 1, [[0.5, 0.5]]);
            let hit = ray.first().and_then(|ray| tree.closest_hit(ray, &QueryOptions::default()));
            distance = hit.map_or(distance, |hit| f64::from(hit.t));
        }
        // What is up in the picture is never along the view.
        let picture_up = first.picture_axes()[1].map(f64::from);
        let given = unit(first.up().map(f64::from));
        let is_along = 1.0 - dot(given, forward).abs() < 1e-6;
        let up = if is_along { picture_up } else { given };
        let side = unit(cross(forward, up));
        let pitch = dot(forward, up).clamp(-1.0, 1.0).asin();
        let (target, ahead) = (sum(eye, scaled(forward, distance)), cross(up, side));
        let (first_pitch, first_distance) = (pitch, distance);
        let (yaw, moved) = (0.0, false);
        Orbit {
            first,
            target,
            up,
            ahead,
            side,
            first_pitch,
            first_distance,
            yaw,
            pitch,
            distance,
            moved,
        }
    }

    pub(super) fn home(&mut self) {
        (self.yaw, self.pitch, self.distance) = (0.0, self.first_pitch, self.first_distance);
        self.moved = false;
    }

    pub(super) fn turn(&mut self, right: f64, down: f64) {
        if !right.is_finite() || !down.is_finite() {
            return;
        }
        self.yaw = (self.yaw + right * TURN) % std::f64::consts::TAU;
        self.pitch = (self.pitch - down * TURN).clamp(-STEEPEST, STEEPEST);
        self.moved = true;
    }

    pub(super) fn zoom(&mut self, steps: f64) {
        let distance = self.distance * (-steps * 0.125).exp();
        let within = self.first_distance * 1e-3..self.first_distance * 1e3;
        if within.contains(&distance) {
            self.distance = distance;
            self.moved = true;
        }
    }

    /// The camera as it stands. Where f32 has no room for it, the first one.
    pub(super) fn camera(&self) -> Camera {
        if !self.moved {
            return self.first;
        }
        let level = sum(scaled(self.ahead, self.yaw.cos()), scaled(self.side, self.yaw.sin()));
        let forward = sum(scaled(level, self.pitch.cos()), scaled(self.up, self.pitch.sin()));
        let eye = sum(self.target, scaled(forward, -self.distance));
        let [eye, at, up] = [eye, self.target, self.up].map(|v| v.map(|x| x as f32));
        Camera::new(eye, at, up, self.first.fov_degrees()).unwrap_or(self.first)
    }
}
