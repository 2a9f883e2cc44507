//! How the user moves the camera: about a point, or through the scene. No epsilon is absolute, since
//! scenes differ by orders of magnitude.

use glam::DVec3;
use splitplane::scene::Camera;
use splitplane_core::aabb::Aabb;

/// Looking straight up or down, turning would have no axis: a tenth of a degree is kept from it.
const STEEPEST: f64 = 89.9 * std::f64::consts::PI / 180.0;
/// How much of an angle a picture's height of dragging turns, in radians.
const TURN: f64 = 3.0;
/// Nearest distance to the point turned about, in parts of the greatest coordinate: below it, steps
/// of f32 would show.
const NEAREST: f64 = 1.0 / (1u64 << 18) as f64;
/// Farthest, in parts of the scene's size.
const FARTHEST: f64 = 1e4;

/// What dragging does.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) enum Mode {
    /// The eye goes round a point.
    #[default]
    Orbit,
    /// The eye stays where it is, and looks around; keys move it.
    Fly,
}

/// A camera that can be moved. Angles are about the up direction of the camera it started from.
#[derive(Clone, Debug)]
pub(super) struct Rig {
    home: Camera,
    home_distance: f64,
    /// Greatest extent of the scene; the distance at home for a scene without extent.
    size: f64,
    pub(super) mode: Mode,
    /// Unit vectors: up, the direction of yaw 0, and the one of yaw 90 degrees.
    up: DVec3,
    ahead: DVec3,
    side: DVec3,
    eye: DVec3,
    yaw: f64,
    pitch: f64,
    distance: f64,
    moved: bool,
}

impl Rig {
    /// A camera at its home, that turns about a point so far ahead.
    pub(super) fn new(home: Camera, distance: f64, bounds: &Aabb) -> Rig {
        let vector = |v: [f32; 3]| DVec3::from_array(v.map(f64::from));
        let (eye, at) = (vector(home.eye()), vector(home.look_at()));
        let forward = (at - eye).normalize();
        let mut up = vector(home.up()).normalize();
        if forward.cross(up).length_squared() < 1e-12 {
            // Looking along `up`: what is up in the picture serves as well.
            up = vector(home.picture_axes()[1]);
        }
        let side = forward.cross(up).normalize();
        let ahead = up.cross(side);
        let pitch = forward.dot(up).clamp(-1.0, 1.0).asin();
        let given = Some(distance).filter(|d| d.is_finite() && *d > 0.0);
        let distance = given.unwrap_or_else(|| eye.distance(at));
        let extent = |axis: usize| f64::from(bounds.hi[axis]) - f64::from(bounds.lo[axis]);
        let extent = (0..3).map(extent).fold(0.0, f64::max);
        let size = if extent > 0.0 { extent } else { distance };
        let (home_distance, mode, yaw, moved) = (distance, Mode::Orbit, 0.0, false);
        Rig { home, home_distance, size, mode, up, ahead, side, eye, yaw, pitch, distance, moved }
    }

    /// Back to where it started, in the same mode.
    pub(super) fn reset(&mut self) {
        let eye = DVec3::from_array(self.home.eye().map(f64::from));
        let at = DVec3::from_array(self.home.look_at().map(f64::from));
        self.eye = eye;
        self.yaw = 0.0;
        self.pitch = (at - eye).normalize().dot(self.up).clamp(-1.0, 1.0).asin();
        self.distance = self.home_distance;
        self.moved = false;
    }

    /// The camera as it stands. Where f32 has no room for it, the one of the start.
    pub(super) fn camera(&self) -> Camera {
        if !self.moved {
            return self.home;
        }
        // Far enough that rounding the point to f32 does not turn the view.
        let reach = self.distance.max(self.eye.abs().max_element());
        let at = self.eye + self.forward() * reach;
        let [eye, at, up] = [self.eye, at, self.up].map(|v| v.as_vec3().to_array());
        Camera::new(eye, at, up, self.home.fov_degrees()).unwrap_or(self.home)
    }

    /// The distance to the point turned about; speeds are in proportion to it.
    pub(super) fn distance(&self) -> f64 {
        self.distance
    }

    fn forward(&self) -> DVec3 {
        let level = self.ahead * self.yaw.cos() + self.side * self.yaw.sin();
        level * self.pitch.cos() + self.up * self.pitch.sin()
    }

    fn target(&self) -> DVec3 {
        self.eye + self.forward() * self.distance
    }

    /// Turns by a drag, in parts of the picture's height: right and down are positive. In orbit, the
    /// scene follows the hand; in flight, the view does.
    pub(super) fn turn(&mut self, right: f64, down: f64) {
        if right == 0.0 && down == 0.0 {
            return;
        }
        let target = self.target();
        self.yaw += right * TURN;
        self.pitch -= down * TURN;
        self.yaw %= std::f64::consts::TAU;
        self.pitch = self.pitch.clamp(-STEEPEST, STEEPEST);
        if self.mode == Mode::Orbit {
            self.eye = target - self.forward() * self.distance;
        }
        self.moved = true;
    }

    /// Shifts the view by a drag, in parts of the picture's height; what lies at the target's
    /// distance stays under the pointer.
    pub(super) fn pan(&mut self, right: f64, down: f64) {
        let height = 2.0 * (0.5 * f64::from(self.home.fov_degrees()).to_radians()).tan();
        let scale = height * self.distance;
        let across = self.forward().cross(self.up).normalize();
        let upwards = across.cross(self.forward());
        self.shift((upwards * down - across * right) * scale);
    }

    /// Comes nearer for positive steps of the wheel, an eighth of the distance each. In flight, that
    /// makes it slower.
    pub(super) fn zoom(&mut self, steps: f64) {
        let target = self.target();
        let reach = target.abs().max_element().max(self.size * 1e-3);
        let distance = self.distance * (-steps * 0.125).exp();
        let distance = distance.clamp(reach * NEAREST, self.size * FARTHEST + self.home_distance);
        if !distance.is_finite() || distance == self.distance {
            return;
        }
        self.distance = distance;
        if self.mode == Mode::Orbit {
            self.eye = target - self.forward() * distance;
        }
        self.moved = true;
    }

    /// Flies for some seconds along the view's own axes: right, up, forward, each -1, 0 or 1.
    pub(super) fn fly(&mut self, direction: [f64; 3], seconds: f64, fast: bool) {
        let [right, up, forward] = direction;
        let across = self.forward().cross(self.up).normalize();
        let along = across * right + self.up * up + self.forward() * forward;
        let speed = self.distance * if fast { 2.5 } else { 0.5 };
        self.shift(along.normalize_or_zero() * speed * seconds);
    }

    /// Moves the eye and what it turns about, not out of the reach of f32 though.
    fn shift(&mut self, by: DVec3) {
        let eye = self.eye + by;
        let far = f64::from(f32::MAX) * 0.25;
        if by != DVec3::ZERO && eye.is_finite() && eye.abs().max_element() < far {
            self.eye = eye;
            self.moved = true;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const UP: [f32; 3] = [0.0, 1.0, 0.0];

    fn rig(scale: f32) -> Rig {
        let home = Camera::new([0.0, 3.0 * scale, 4.0 * scale], [0.0; 3], UP, 40.0).unwrap();
        let bounds = Aabb { lo: [-scale; 3], hi: [scale; 3] };
        Rig::new(home, 5.0 * f64::from(scale), &bounds)
    }

    fn close(a: DVec3, b: DVec3, scale: f64) -> bool {
        (a - b).abs().max_element() < 1e-9 * scale
    }

    #[test]
    fn home_is_the_camera_itself_and_reset_leads_back() {
        let mut rig = rig(1.0);
        let home = rig.camera();
        assert_eq!(home, rig.home);
        rig.turn(0.2, 0.1);
        rig.zoom(3.0);
        rig.fly([1.0, 0.0, 1.0], 0.5, true);
        assert_ne!(rig.camera(), home);
        rig.reset();
        assert_eq!(rig.camera(), home);
        assert!(close(rig.target(), DVec3::ZERO, 1.0));
    }

    #[test]
    fn orbit_keeps_the_distance_and_the_target_at_every_scale() {
        for scale in [1e-6, 1.0, 1e9] {
            let mut rig = rig(scale);
            let scale = f64::from(scale);
            let at = rig.target();
            for (right, down) in [(0.3, 0.1), (-2.0, 0.7), (5.0, -9.0), (0.001, 0.0)] {
                rig.turn(right, down);
                assert!(close(rig.target(), at, scale), "{scale} {}", rig.target());
                let distance = rig.eye.distance(at) / scale;
                assert!((distance - 5.0).abs() < 1e-6, "{scale} {distance}");
            }
        }
    }

    #[test]
    fn dragging_right_brings_the_scenes_left_side_forward() {
        let mut rig = rig(1.0);
        rig.turn(0.1, 0.0);
        // The scene turns with the hand, so the eye goes to the left.
        assert!(rig.eye.x < 0.0, "{}", rig.eye);
        let mut rig = self::rig(1.0);
        rig.mode = Mode::Fly;
        rig.turn(0.1, 0.0);
        assert!(rig.forward().x > 0.0 && rig.eye.x == 0.0);
    }

    #[test]
    fn poles_do_not_flip() {
        let mut rig = rig(1.0);
        for _ in 0..100 {
            rig.turn(0.01, 0.5);
            let [_, up] = rig.camera().picture_axes();
            assert!(up[1] > 0.0, "{up:?}");
        }
        assert!(rig.eye.y > 4.99, "{}", rig.eye);
        for _ in 0..100 {
            rig.turn(0.0, -0.5);
            let [_, up] = rig.camera().picture_axes();
            assert!(up[1] > 0.0, "{up:?}");
        }
        assert!(rig.eye.y < -4.99, "{}", rig.eye);
    }

    #[test]
    fn flying_forward_moves_along_the_view_in_proportion_to_the_distance() {
        for scale in [1e-5, 1.0, 1e5] {
            let mut rig = rig(scale);
            rig.mode = Mode::Fly;
            rig.turn(0.3, 0.2);
            let (start, forward) = (rig.eye, rig.forward());
            rig.fly([0.0, 0.0, 1.0], 0.5, false);
            let moved = rig.eye - start;
            assert!(moved.normalize().dot(forward) > 1.0 - 1e-12);
            assert!((moved.length() / rig.distance() - 0.25).abs() < 1e-9);
            let slow = moved.length();
            let start = rig.eye;
            rig.fly([0.0, 0.0, 1.0], 0.5, true);
            assert!(((rig.eye - start).length() / slow - 5.0).abs() < 1e-9);
            let before = rig.eye;
            rig.fly([0.0; 3], 0.5, false);
            assert_eq!(rig.eye, before);
        }
    }

    #[test]
    fn changing_the_mode_does_not_move_the_camera() {
        let mut rig = rig(1.0);
        rig.turn(0.4, 0.1);
        let before = rig.camera();
        rig.mode = Mode::Fly;
        assert_eq!(rig.camera(), before);
        rig.fly([0.0, 0.0, 1.0], 0.1, false);
        let (eye, forward) = (rig.eye, rig.forward());
        rig.mode = Mode::Orbit;
        rig.turn(1e-9, 0.0);
        assert!(rig.eye.distance(eye) < 1e-6 && rig.forward().distance(forward) < 1e-6);
    }

    #[test]
    fn zooming_keeps_the_target_and_stops_before_f32_does() {
        for scale in [1e-6, 1.0, 1e9] {
            let mut rig = rig(scale);
            let at = rig.target();
            rig.zoom(1.0);
            assert!(rig.eye.length() < 5.0 * f64::from(scale));
            assert!(close(rig.target(), at, f64::from(scale)));
            rig.zoom(1e6);
            assert!(rig.distance() > 0.0);
            assert_ne!(rig.camera().eye(), rig.camera().look_at());
            rig.zoom(-1e6);
            assert!(rig.distance().is_finite());
            assert!(rig.camera().eye().iter().all(|x| x.is_finite()));
        }
    }

    #[test]
    fn panning_keeps_the_view_direction() {
        let mut rig = rig(1.0);
        let forward = rig.forward();
        rig.pan(0.25, 0.0);
        assert!(rig.target().x < 0.0, "the scene goes right, so the target left");
        rig.pan(0.0, 0.25);
        assert!(rig.target().y > 0.0, "the scene goes down, so the target up");
        assert_eq!(rig.forward(), forward);
    }

    #[test]
    fn a_camera_that_looks_along_its_up_can_be_turned() {
        let home = Camera::new([0.0, 9.0, 0.0], [0.0; 3], UP, 40.0).unwrap();
        let mut rig = Rig::new(home, 9.0, &Aabb { lo: [-1.0; 3], hi: [1.0; 3] });
        rig.turn(0.1, 0.1);
        assert!(rig.camera().eye().iter().all(|x| x.is_finite()));
        assert!(close(rig.target(), DVec3::ZERO, 10.0));
    }
}
