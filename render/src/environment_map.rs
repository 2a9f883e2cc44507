//! Light from everywhere as a picture: radiance by direction, and directions drawn by it.
//!
//! A texel has one radiance. Directions are drawn by two tables (Pharr, Jakob and Humphreys, Physically Based Rendering, 4th edition, 14.3.4): a row
//! by the light of all its texels, and in the row a texel by its luminance; within the texel evenly by solid angle. So the density is
//! exactly that of the tables: the luminance of a direction over that of all. Nothing here depends on the platform's sines and cosines.

use crate::vector::{Vector, scaled};
use crate::warp::turn;
use core::fmt;
use splitplane_core::tree::digest::{Digest, Xxh64};
use thiserror::Error;

#[cfg(test)]
mod tests;

/// Greatest width and height of an environment map.
const MAX_SIDE: u32 = 16_384;
/// Greatest radiance of a texel.
const MAX_RADIANCE: f32 = 1e12;
/// Parts of probabilities: these are so many parts of one.
const ONE: u64 = 1 << 32;

/// Light from everywhere, given by a picture of all directions (equirectangular: every column is a meridian, the top row is straight above, `+y`). The middle
/// of the picture is where a camera looks that looks along `-z`, and what is right of it in the picture, is right of it for the camera.
///
/// Between texels nothing is smoothed: a map shows as many directions as it has texels.
#[derive(Clone, PartialEq)]
pub struct EnvironmentMap {
    width: u32,
    height: u32,
    /// Row by row from the top left.
    texels: Vec<Vector>,
    strength: f32,
    /// Sine and cosine of the rotation about `y`.
    rotation: [f32; 2],
    rotation_degrees: f32,
    /// By row how many parts of [`ONE`] come before.
    rows: Vec<u32>,
    /// The same by texel, of its row.
    columns: Vec<u32>,
    /// `y` of the directions at the upper edge of each row, and at the lower one of the last.
    edges: Vec<f32>,
    /// Sine and cosine of the angle from the middle, at the left edges of columns.
    meridians: Vec<[f32; 2]>,
    /// Of a texel, by row.
    solid_angles: Vec<f32>,
    /// Radiance times solid angle of all.
    total: Vector,
}

/// Why there is no environment map.
#[derive(Clone, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum EnvironmentMapError {
    /// A picture without texels, with too many in a row or column, or with others than its size says.
    #[error(
        "an environment of {width}x{height} texels, {found} of them there, cannot be; each side must be from 1 to {MAX_SIDE}"
    )]
    Size {
        /// Texels from left to right.
        width: u32,
        /// Texels from top to bottom.
        height: u32,
        /// Texels given.
        found: usize,
    },
    /// A radiance that cannot be.
    #[error(
        "the texel in column {column}, row {row}, counted from 0 at the top left, has the radiance {value}; it must be from 0 to {MAX_RADIANCE:e}"
    )]
    Radiance {
        /// From 0 at the left.
        column: u32,
        /// From 0 at the top.
        row: u32,
        /// The first component that cannot be.
        value: f32,
    },
    /// A strength that cannot be, or with which a texel is brighter than can be.
    #[error(
        "the strength {strength} of the environment must be from 0 to 1e12, and radiance times strength at most {MAX_RADIANCE:e}"
    )]
    Strength {
        /// The factor.
        strength: f32,
    },
    /// A rotation that is not a number.
    #[error("the rotation of the environment is {degrees} degrees; it must be finite")]
    Rotation {
        /// The angle.
        degrees: f32,
    },
    /// No memory.
    #[error("there is not memory enough for an environment of {width}x{height} texels")]
    Memory {
        /// Texels from left to right.
        width: u32,
        /// Texels from top to bottom.
        height: u32,
    },
}

/// A direction that was drawn.
#[derive(Clone, Copy, Debug)]
pub(crate) struct MapSample {
    /// Of length 1 but for its rounding.
    pub(crate) direction: Vector,
    pub(crate) radiance: Vector,
    /// By solid angle; 0 in texels of which there is nothing on a sphere of floats.
    pub(crate) density: f32,
}

/// What the eye sees of a colour (Rec. 709), where any light is more than none.
fn luminance([r, g, b]: Vector) -> f64 {
    0.2126 * f64::from(r) + 0.7152 * f64::from(g) + 0.0722 * f64::from(b)
}

/// Fills a table with how many parts of [`ONE`] come before each weight. Where there is no weight all are as likely.
fn before(weights: impl Iterator<Item = f64> + Clone, table: &mut Vec<u32>) -> f64 {
    let total: f64 = weights.clone().sum();
    let mut sum = 0.0;
    let count = weights.clone().count() as f64;
    for (place, weight) in weights.enumerate() {
        let part = if total > 0.0 { sum / total } else { place as f64 / count };
        // What has no weight at the end gets the last part of all.
        table.push((part * ONE as f64).min(f64::from(u32::MAX)) as u32);
        sum += weight;
    }
    total
}

impl EnvironmentMap {
    /// A map of `width * height` texels of linear red, green and blue radiance, row by row from the top left.
    ///
    /// # Errors
    /// A size that cannot be or is not that of the texels; a radiance that is negative, not finite or above 1e12; no memory.
    pub fn new(
        width: u32,
        height: u32,
        texels: Vec<[f32; 3]>,
    ) -> Result<EnvironmentMap, EnvironmentMapError> {
        let found = texels.len();
        let sides = 1..=MAX_SIDE;
        let fits = sides.contains(&width) && sides.contains(&height);
        if !fits || u64::from(width) * u64::from(height) != found as u64 {
            return Err(EnvironmentMapError::Size { width, height, found });
        }
        let mut map = EnvironmentMap {
            width,
            height,
            texels,
            strength: 1.0,
            rotation: [0.0, 1.0],
            rotation_degrees: 0.0,
            rows: Vec::new(),
            columns: Vec::new(),
            edges: Vec::new(),
            meridians: Vec::new(),
            solid_angles: Vec::new(),
            total: [0.0; 3],
        };
        for (place, texel) in (0..).zip(&map.texels) {
            let possible = |value: &&f32| !(0.0..=MAX_RADIANCE).contains(*value);
            if let Some(value) = texel.iter().find(possible) {
                let (column, row) = (place % width, place / width);
                return Err(EnvironmentMapError::Radiance { column, row, value: *value });
            }
        }
        map.columns
            .try_reserve_exact(found)
            .map_err(|_| EnvironmentMapError::Memory { width, height })?;
        map.tabulate();
        Ok(map)
    }

    fn tabulate(&mut self) {
        let (width, height) = (f64::from(self.width), f64::from(self.height));
        let edge = |row: u32| turn(f64::from(row) / (2.0 * height))[1];
        self.edges = (0..=self.height).map(edge).collect();
        self.meridians = (0..self.width).map(|i| turn(f64::from(i) / width - 0.5)).collect();
        let mut sums = [0.0f64; 3];
        let mut weights = Vec::with_capacity(self.height as usize);
        for (row, texels) in self.texels.chunks(self.width as usize).enumerate() {
            // What the floats leave between the edges.
            let cap = f64::from(self.edges[row]) - f64::from(self.edges[row + 1]);
            let solid_angle = core::f64::consts::TAU / width * cap.max(0.0);
            self.solid_angles.push(solid_angle as f32);
            let of_row = before(texels.iter().map(|texel| luminance(*texel)), &mut self.columns);
            weights.push(of_row * solid_angle);
            for (sum, channel) in sums.iter_mut().zip(0..3) {
                let light: f64 = texels.iter().map(|texel| f64::from(texel[channel])).sum();
                *sum += light * solid_angle;
            }
        }
        before(weights.iter().copied(), &mut self.rows);
        self.total = sums.map(|sum| sum as f32);
    }

    /// The same map, all of it brighter by a factor.
    ///
    /// # Errors
    /// A factor that is negative, not finite or above 1e12, or with which a texel is brighter than 1e12.
    pub fn with_strength(mut self, strength: f32) -> Result<EnvironmentMap, EnvironmentMapError> {
        let most = self.texels.as_flattened().iter().fold(0.0f32, |most, part| most.max(*part));
        let fits = (0.0..=1e12).contains(&strength) && most * strength <= MAX_RADIANCE;
        if !fits {
            return Err(EnvironmentMapError::Strength { strength });
        }
        self.strength = strength;
        Ok(self)
    }

    /// The same map, turned about `y` by an angle, counter-clockwise seen from above.
    ///
    /// # Errors
    /// An angle that is not finite.
    pub fn with_rotation(mut self, degrees: f32) -> Result<EnvironmentMap, EnvironmentMapError> {
        if !degrees.is_finite() {
            return Err(EnvironmentMapError::Rotation { degrees });
        }
        self.rotation_degrees = degrees;
        // The remainder is exact.
        self.rotation = turn(f64::from(degrees % 360.0) / 360.0);
        Ok(self)
    }

    /// Texels from left to right.
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Texels from top to bottom.
    pub fn height(&self) -> u32 {
        self.height
    }

    /// The factor of [`EnvironmentMap::with_strength`].
    pub fn strength(&self) -> f32 {
        self.strength
    }

    /// The angle of [`EnvironmentMap::with_rotation`].
    pub fn rotation_degrees(&self) -> f32 {
        self.rotation_degrees
    }

    /// A name of all that decides its light.
    pub fn digest(&self) -> Digest {
        let mut state = Xxh64::new(1);
        let [sine, cosine] = self.rotation.map(f32::to_bits);
        state.write_words(&[self.width, self.height, self.strength.to_bits(), sine, cosine]);
        for row in self.texels.chunks(self.width as usize) {
            let words: Vec<u32> = row.as_flattened().iter().map(|part| part.to_bits()).collect();
            state.write_words(&words);
        }
        Digest(state.finish())
    }

    /// Whether any light comes from it.
    pub fn shines(&self) -> bool {
        self.strength > 0.0 && self.total.iter().any(|part| *part > 0.0)
    }

    /// Radiance times solid angle of all directions.
    pub(crate) fn total(&self) -> Vector {
        scaled(self.total, self.strength)
    }

    /// Radiance from a direction of length 1.
    pub(crate) fn radiance(&self, direction: Vector) -> Vector {
        let (row, column) = self.place(direction);
        self.texel(row, column)
    }

    /// The density by solid angle with which [`EnvironmentMap::sample`] has a direction.
    pub(crate) fn density(&self, direction: Vector) -> f32 {
        let (row, column) = self.place(direction);
        self.density_of(row, column)
    }

    /// The direction that two random words choose.
    pub(crate) fn sample(&self, [first, second]: [u32; 2]) -> MapSample {
        let (row, down) = chosen(&self.rows, first);
        let (column, across) = chosen(self.row(&self.columns, row), second);
        let [top, bottom] = [self.edges[row], self.edges[row + 1]];
        let y = top + (bottom - top) * down;
        let [sine, cosine] =
            turn((column as f64 + f64::from(across)) / f64::from(self.width) - 0.5);
        let flat = ((1.0 - y) * (1.0 + y)).sqrt();
        // Sine is to the right, cosine to the front, which is -z.
        let (right, front) = (sine * flat, cosine * flat);
        let [s, c] = self.rotation;
        // Counter-clockwise seen from above: what is in front goes to the left.
        let direction = [right * c - front * s, y, -(front * c + right * s)];
        let (radiance, density) = (self.texel(row, column), self.density_of(row, column));
        MapSample { direction, radiance, density }
    }

    fn row<'a, T>(&self, all: &'a [T], row: usize) -> &'a [T] {
        let width = self.width as usize;
        &all[row * width..][..width]
    }

    fn texel(&self, row: usize, column: usize) -> Vector {
        scaled(self.row(&self.texels, row)[column], self.strength)
    }

    fn density_of(&self, row: usize, column: usize) -> f32 {
        let solid_angle = self.solid_angles[row];
        if solid_angle <= 0.0 {
            return 0.0;
        }
        probability(&self.rows, row) * probability(self.row(&self.columns, row), column)
            / solid_angle
    }

    /// The texel of a direction: row and column.
    fn place(&self, [x, y, z]: Vector) -> (usize, usize) {
        let [s, c] = self.rotation;
        // As the map has it: turned back.
        let (right, front) = (x * c - z * s, -(x * s + z * c));
        let last = self.height as usize - 1;
        let row = self.edges.partition_point(|edge| *edge >= y).saturating_sub(1).min(last);
        // A column is right of all meridians that are left of the direction, in its half of the circle.
        let half = self.meridians.len().div_ceil(2);
        let is_left = |[sine, cosine]: &[f32; 2]| right * cosine - front * sine >= 0.0;
        let column = if right < 0.0 {
            self.meridians[1..half].partition_point(is_left)
        } else {
            half - 1 + self.meridians[half..].partition_point(is_left)
        };
        (row, column)
    }
}

/// Of a table the place that holds a word, and how far in it the word is, 0 to 1.
fn chosen(table: &[u32], word: u32) -> (usize, f32) {
    let place = table.partition_point(|first| *first <= word).saturating_sub(1);
    let first = table[place];
    let parts = end(table, place) - u64::from(first);
    (place, ((word - first) as f64 / parts as f64) as f32)
}

/// Where a place of a table ends, in parts of [`ONE`].
fn end(table: &[u32], place: usize) -> u64 {
    table.get(place + 1).map_or(ONE, |next| u64::from(*next))
}

fn probability(table: &[u32], place: usize) -> f32 {
    (end(table, place) - u64::from(table[place])) as f32 * (1.0 / 4_294_967_296.0)
}

impl fmt::Debug for EnvironmentMap {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let EnvironmentMap { width, height, strength, rotation_degrees, .. } = self;
        write!(
            f,
            "EnvironmentMap({width}x{height}, strength {strength}, turned by {rotation_degrees})"
        )
    }
}
