//! How many signs it takes to decide whether a triangle meets many half-spaces: a few for each, on
//! average.

use core::cmp::Ordering;
use core::sync::atomic::{AtomicU64, Ordering::Relaxed};

use super::super::number::Bounded;
use super::{InPlanes, Number, Plane, Predicate};
use crate::arithmetic::{snap, sqrt};
use alloc::vec::Vec;

static SIGNS: AtomicU64 = AtomicU64::new(0);

#[derive(Clone)]
struct Counted(Bounded);

impl Number for Counted {
    fn of(x: f32) -> Counted {
        Counted(Bounded::of(x))
    }
    fn difference(a: f32, b: f32) -> Counted {
        Counted(Bounded::difference(a, b))
    }
    fn plus(&self, other: &Counted) -> Counted {
        Counted(self.0.plus(&other.0))
    }
    fn minus(&self, other: &Counted) -> Counted {
        Counted(self.0.minus(&other.0))
    }
    fn times(&self, other: &Counted) -> Counted {
        Counted(self.0.times(&other.0))
    }
    fn sign(&self) -> Option<Ordering> {
        SIGNS.fetch_add(1, Relaxed);
        self.0.sign()
    }
}

/// Half-spaces around a ball, which touch it all over: in the order of a spiral, so that each cuts
/// something off from what those before it left.
fn around_a_ball(count: u32, radius: f32) -> Vec<Plane> {
    let mut planes = Vec::new();
    let (mut x, mut y) = (1.0f64, 0.0f64);
    // A turn by about the golden angle.
    let (cos, sin) = (-0.737_368_878, 0.675_490_294);
    for i in 0..count {
        let z = 1.0 - 2.0 * (f64::from(i) + 0.5) / f64::from(count);
        let flat = sqrt(1.0 - z * z);
        let normal = [x * flat, y * flat, z].map(|x| snap(x as f32));
        planes.push(Plane { normal, offset: radius });
        (x, y) = (x * cos - y * sin, x * sin + y * cos);
    }
    planes
}

#[test]
fn signs_grow_with_the_number_of_planes() {
    // One triangle around the ball's middle, one beside the ball that no plane alone parts from it.
    let met = [[-4.0, -3.0, 0.1], [4.0, -3.0, 0.2], [0.1, 5.0, -0.3]];
    let missed = [[0.9, 0.9, -3.0], [0.9, 0.9, 3.0], [3.0, 3.1, 0.1]];
    for (triangle, meets) in [(met, true), (missed, false)] {
        for count in [100, 300, 1000, 3000] {
            let planes = around_a_ball(count, 1.0);
            for order in 0..2 {
                let mut planes = planes.clone();
                if order == 1 {
                    planes.reverse();
                }
                SIGNS.store(0, Relaxed);
                let answer = InPlanes(&triangle, &planes).answer::<Counted>();
                assert_eq!(answer, Some(meets), "{count} planes");
                let (signs, most) = (SIGNS.load(Relaxed), 40 * u64::from(count));
                assert!(signs <= most, "{signs} signs of {count} planes, not {most}");
            }
        }
    }
}
