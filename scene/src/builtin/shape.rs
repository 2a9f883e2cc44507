//! Shapes that several scenes are made of.

use super::builder::{Builder, Point, unit};
use crate::angle::sin_cos;

/// A tube along a closed curve.
#[derive(Clone, Copy)]
pub(super) struct Tube {
    /// Steps along the curve and around the tube.
    pub(super) along: u32,
    pub(super) around: u32,
    pub(super) radius: f64,
}

impl Builder {
    /// A tube of round section. `curve` returns the point at a part of the way, and a direction
    /// away from its inside that never points along it.
    pub(super) fn tube(
        &mut self,
        material: u32,
        Tube { along, around, radius }: Tube,
        curve: impl Fn(f64) -> [Point; 2],
    ) {
        let rows: Vec<Vec<u32>> = (0..along)
            .map(|i| {
                let turns = f64::from(i) / f64::from(along);
                let [here, outwards] = curve(turns);
                let forward = unit(sub(curve(turns + 1e-4)[0], curve(turns - 1e-4)[0]));
                // Made perpendicular: a frame that comes back to itself after a full round.
                let lean = dot(outwards, forward);
                let normal = unit(std::array::from_fn(|k| outwards[k] - lean * forward[k]));
                let side = cross(forward, normal);
                (0..around)
                    .map(|j| {
                        let (sin, cos) = sin_cos(f64::from(j) / f64::from(around));
                        self.vertex(std::array::from_fn(|k| {
                            here[k] + radius * (cos * normal[k] + sin * side[k])
                        }))
                    })
                    .collect()
            })
            .collect();
        for i in 0..rows.len() {
            self.band(material, &rows[i], &rows[(i + 1) % rows.len()]);
        }
    }

    /// A surface of revolution around an upright axis through `base`: `profile` holds radius and
    /// height from top to bottom, and the outside is on the side away from the axis when it runs
    /// downwards. A radius of 0 at an end closes it.
    pub(super) fn turned(&mut self, material: u32, base: Point, profile: &[[f64; 2]], around: u32) {
        let mut above: Option<Vec<u32>> = None;
        for &[radius, height] in profile {
            let y = base[1] + height;
            let row: Vec<u32> = if radius == 0.0 {
                vec![self.vertex([base[0], y, base[2]]); around as usize]
            } else {
                let at = |i: u32| {
                    let (sin, cos) = sin_cos(f64::from(i) / f64::from(around));
                    [base[0] + radius * cos, y, base[2] + radius * sin]
                };
                (0..around).map(|i| self.vertex(at(i))).collect()
            };
            if let Some(above) = &above {
                self.band(material, above, &row);
            }
            above = Some(row);
        }
    }
}

pub(super) fn sub(a: Point, b: Point) -> Point {
    std::array::from_fn(|k| a[k] - b[k])
}

pub(super) fn dot(a: Point, b: Point) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

pub(super) fn cross(a: Point, b: Point) -> Point {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}
