//! What is timed and judged by kind of ray.

use serde::{Deserialize, Serialize};

/// Something for each of the four sets of rays that are timed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Sets<T> {
    /// Rays of the camera: closest hits.
    pub primary: T,
    /// From what the camera sees towards lights: any hits.
    pub shadow: T,
    /// From what the camera sees into the half-space above the surface: closest hits.
    pub bounce: T,
    /// Chords of the sphere around the scene: closest hits.
    pub random: T,
}

impl<T> Sets<T> {
    /// The names of the sets, in their order.
    pub const NAMES: [&'static str; 4] = ["primary", "shadow", "bounce", "random"];

    /// The place of the set of which only is asked whether anything is hit.
    pub const SHADOW: usize = 1;

    /// All four, in their order.
    pub fn each(&self) -> [&T; 4] {
        [&self.primary, &self.shadow, &self.bounce, &self.random]
    }

    /// The same from four values in their order.
    pub fn of([primary, shadow, bounce, random]: [T; 4]) -> Sets<T> {
        Sets { primary, shadow, bounce, random }
    }
}

/// Kinds of rays whose answers are judged.
pub const KINDS: usize = 6;

/// Something for each of the kinds of rays whose answers are judged.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Aims<T> {
    /// Chords of the sphere around the scene.
    pub random: T,
    /// Aimed at points of edges.
    pub edge: T,
    /// Aimed at vertices.
    pub vertex: T,
    /// Rays of the camera, as many of the timed ones as there are.
    pub primary: T,
    /// From what the camera sees into the half-space above the surface, likewise.
    pub bounce: T,
    /// From what the camera sees towards lights, likewise; of these only is asked whether anything is hit, of the
    /// others, what is.
    pub shadow: T,
}

impl<T> Aims<T> {
    /// The names of the kinds, in their order.
    pub const NAMES: [&'static str; KINDS] =
        ["random", "edge", "vertex", "primary", "bounce", "shadow"];

    /// Those that are aimed where tests go wrong; real rays are hardly ever.
    pub const AIMED: [&'static str; 2] = ["edge", "vertex"];

    /// All of them, in their order.
    pub fn each(&self) -> [&T; KINDS] {
        [&self.random, &self.edge, &self.vertex, &self.primary, &self.bounce, &self.shadow]
    }

    /// The same from values in their order.
    pub fn of([random, edge, vertex, primary, bounce, shadow]: [T; KINDS]) -> Aims<T> {
        Aims { random, edge, vertex, primary, bounce, shadow }
    }
}

/// Time to trace one set of rays.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Trace {
    /// Rays in the batch. 0 where the scene gives none: the camera sees nothing, or no light is above
    /// any surface.
    pub rays: usize,
    /// Nanoseconds a ray, the median of the repeats. None without rays.
    pub ns: Option<f64>,
    /// The same, the least of the repeats.
    pub least_ns: Option<f64>,
}
