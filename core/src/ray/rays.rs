//! The rays of a batch, as they lie in memory.

use super::Ray;
use core::ops::Range;

/// The rays of a batch, as they lie in memory: for programs that have no [`Ray`]s, and would otherwise make them first.
///
/// ```
/// use splitplane_core::ray::{Ray, Rays};
///
/// let rows = [[0.25, 0.25, 5.0, 0.0, 0.0, -1.0]];
/// let rays = Rays::Rows { rows: &rows, t_min: 0.0, t_max: f32::INFINITY };
/// assert_eq!(rays.ray(0), Ray::new([0.25, 0.25, 5.0], [0.0, 0.0, -1.0]));
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Rays<'a> {
    /// The library's own records.
    Records(&'a [Ray]),
    /// Six numbers a ray, its origin and then its direction, and limits that all rays have.
    Rows {
        /// Origins and directions: see [`Ray`] for what they may be.
        rows: &'a [[f32; 6]],
        /// Least accepted `t`.
        t_min: f32,
        /// Greatest accepted `t`.
        t_max: f32,
    },
}

impl<'a> Rays<'a> {
    /// How many there are.
    pub const fn len(&self) -> usize {
        match self {
            Rays::Records(rays) => rays.len(),
            Rays::Rows { rows, .. } => rows.len(),
        }
    }

    /// Whether there are none.
    pub const fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// One of them.
    ///
    /// # Panics
    /// Without such a ray.
    #[inline]
    pub fn ray(&self, place: usize) -> Ray {
        match self {
            Rays::Records(rays) => rays[place],
            Rays::Rows { rows, t_min, t_max } => {
                let [ox, oy, oz, dx, dy, dz] = rows[place];
                let (origin, direction) = ([ox, oy, oz], [dx, dy, dz]);
                Ray { origin, t_min: *t_min, direction, t_max: *t_max }
            }
        }
    }

    /// Some of them.
    ///
    /// # Panics
    /// Without such rays.
    #[inline]
    #[must_use]
    pub fn part(&self, places: Range<usize>) -> Rays<'a> {
        match *self {
            Rays::Records(rays) => Rays::Records(&rays[places]),
            Rays::Rows { rows, t_min, t_max } => Rays::Rows { rows: &rows[places], t_min, t_max },
        }
    }
}

impl<'a> From<&'a [Ray]> for Rays<'a> {
    fn from(rays: &'a [Ray]) -> Rays<'a> {
        Rays::Records(rays)
    }
}
