//! Opacity masks: which parts of triangles rays meet.

use alloc::vec::Vec;

use super::error::SceneError;
use super::hit::MAX_OPACITY_LEVEL;
use crate::arithmetic::{Arithmetic, Strict, snap};

/// Which parts of a geometry's triangles count, one bit each.
///
/// At level `n` each triangle is divided into `4^n` congruent *micro-cells*: its edges into `2^n` parts. A hit in a cell whose bit is not set counts as not
/// there, as if a [`Filter`](super::Filter) rejected it, and that is how ties are decided.
///
/// A hit at (u, v) is in the column `i`, the whole part of `2^n u`, and the row `j`, that of `2^n v`. Let `a` and `b` be what is left of both; the cell is the lower
/// one of its square where the rounded sum `a + b` is less than 1, and the upper one elsewhere. Each row `j` has `2 (2^n - j) - 1` cells: those of
/// column 0, lower and upper, of column 1, and so on. Hits beyond the last cell of their row, by roundings or at a corner, are in
/// the last one. All operations but that sum are exact, so that a device can find the same cell.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct OpacityMask {
    level: u32,
    triangles: u32,
    /// The cells of all triangles, one triangle after the other; a word has 32, the first in its lowest bit.
    words: Vec<u32>,
}

impl OpacityMask {
    /// A mask of this many triangles, by a function of the triangle and the middle of a cell, in (u, v), which says whether rays meet it: such as what
    /// a texture has there.
    ///
    /// # Errors
    /// A level beyond [`MAX_OPACITY_LEVEL`], or no memory.
    pub fn new(
        triangles: usize,
        level: u32,
        mut is_opaque: impl FnMut(u32, [f32; 2]) -> bool,
    ) -> Result<OpacityMask, SceneError> {
        let mut mask = OpacityMask::blank(triangles, level)?;
        let edge = 1u32 << level;
        let mut bit = 0u64;
        for triangle in 0..triangles as u32 {
            for row in 0..edge {
                for place in 0..2 * (edge - row) - 1 {
                    let (column, upper) = (place / 2, place % 2 == 1);
                    let third = if upper { 2.0 / 3.0 } else { 1.0 / 3.0 };
                    let middle = [column, row].map(|at| (at as f32 + third) / edge as f32);
                    if is_opaque(triangle, middle) {
                        mask.words[(bit / 32) as usize] |= 1 << (bit % 32);
                    }
                    bit += 1;
                }
            }
        }
        Ok(mask)
    }

    /// A mask of the words that [`OpacityMask::words`] gave.
    ///
    /// # Errors
    /// A level beyond [`MAX_OPACITY_LEVEL`], another number of words than these triangles need, a bit set after the last cell, or no memory.
    pub fn of_words(
        triangles: usize,
        level: u32,
        words: &[u32],
    ) -> Result<OpacityMask, SceneError> {
        let mut mask = OpacityMask::blank(triangles, level)?;
        let over = (triangles as u64) << (2 * level) & 31;
        let spare = words.last().is_some_and(|last| over > 0 && last >> over != 0);
        if words.len() != mask.words.len() || spare {
            return Err(SceneError::OpacityWords {
                words: words.len() as u64,
                expected: mask.words.len() as u64,
            });
        }
        mask.words.copy_from_slice(words);
        Ok(mask)
    }

    fn blank(triangles: usize, level: u32) -> Result<OpacityMask, SceneError> {
        if level > MAX_OPACITY_LEVEL {
            return Err(SceneError::OpacityLevel { level });
        }
        // No mesh has more triangles than a u32 can name, so no memory is the answer to that.
        let words = OpacityMask::words_of(triangles as u64, level);
        let bytes = words.map_or(u64::MAX, |words| words.saturating_mul(4));
        let mut own: Vec<u32> = Vec::new();
        let fits = words.and_then(|words| usize::try_from(words).ok());
        let words = fits.ok_or(SceneError::OutOfMemory { bytes })?;
        own.try_reserve_exact(words).map_err(|_| SceneError::OutOfMemory { bytes })?;
        own.resize(words, 0);
        Ok(OpacityMask { level, triangles: triangles as u32, words: own })
    }

    /// How many words a mask of so many triangles has; `None` for a level that is too great, or more triangles than can be named.
    pub(crate) fn words_of(triangles: u64, level: u32) -> Option<u64> {
        if level > MAX_OPACITY_LEVEL || triangles > u64::from(u32::MAX) {
            return None;
        }
        Some((triangles << (2 * level)).div_ceil(32))
    }

    /// The level.
    pub const fn level(&self) -> u32 {
        self.level
    }

    /// How many triangles it is for.
    pub const fn triangles(&self) -> u32 {
        self.triangles
    }

    /// The bits of all cells, 32 a word.
    pub fn words(&self) -> &[u32] {
        &self.words
    }

    /// Whether a hit counts. Triangles that the mask does not have count.
    #[inline]
    pub fn is_opaque(&self, triangle: u32, u: f32, v: f32) -> bool {
        if triangle >= self.triangles {
            return true;
        }
        let cell = opacity_bit::<Strict>(self.level, triangle, [u, v]);
        match self.words.get((cell / 32) as usize) {
            Some(word) => word >> (cell % 32) & 1 != 0,
            None => true,
        }
    }
}

/// The bit of a place in a triangle among those of all triangles.
pub(crate) fn opacity_bit<A: Arithmetic>(level: u32, triangle: u32, [u, v]: [f32; 2]) -> u64 {
    u64::from(triangle) << (2 * level) | u64::from(opacity_cell::<A>(level, u, v))
}

/// The micro-cell of a place in a triangle, at a level: see [`OpacityMask`].
fn opacity_cell<A: Arithmetic>(level: u32, u: f32, v: f32) -> u32 {
    let edge = 1u32 << level;
    // Exact: the factor is a power of two, and whole parts are taken away. What is NaN or below 0 becomes 0.
    let part = |x: f32| {
        let scaled = snap(if x > 0.0 { x.min(1.0) } else { 0.0 } * edge as f32);
        let whole = (scaled as u32).min(edge - 1);
        (whole, scaled - whole as f32)
    };
    let ((column, a), (row, b)) = (part(u), part(v));
    let upper = A::sum(a, b) >= 1.0;
    // Rows before have 2 edge - 1, 2 edge - 3, and so on.
    let before = row * (2 * edge - row);
    let last = 2 * (edge - row) - 2;
    before + (2 * column + u32::from(upper)).min(last)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::arithmetic::Hostile;
    use alloc::vec;

    /// Every cell's middle is in that cell, and cells are numbered without gaps.
    #[test]
    fn middles_are_in_their_cells() {
        for level in 0..=6 {
            let mut middles = Vec::new();
            OpacityMask::new(1, level, |_, middle| {
                middles.push(middle);
                true
            })
            .unwrap();
            assert_eq!(middles.len(), 1 << (2 * level));
            for (cell, &[u, v]) in middles.iter().enumerate() {
                assert!(u + v < 1.0);
                assert_eq!(opacity_cell::<Strict>(level, u, v), cell as u32, "{level} {u} {v}");
                assert_eq!(opacity_cell::<Hostile>(level, u, v), cell as u32, "{level} {u} {v}");
            }
        }
    }

    #[test]
    fn every_place_has_a_cell() {
        let mask = OpacityMask::new(3, 3, |triangle, _| triangle == 1).unwrap();
        let odd =
            [0.0, -0.0, 1.0, -1.0, f32::NAN, 2.0, 0.5, 0.999_999_94, f32::MIN_POSITIVE, 1e-40];
        for u in odd {
            for v in odd {
                let cells = [opacity_cell::<Strict>(3, u, v), opacity_cell::<Hostile>(3, u, v)];
                assert!(cells[0] < 64 && cells[0] == cells[1], "{u} {v}");
                let opaque = [0, 1, 2, 3].map(|triangle| mask.is_opaque(triangle, u, v));
                assert_eq!(opaque, [false, true, false, true]);
            }
        }
    }

    /// Five triangles leave bits of their last word; those after them are of no triangle.
    #[test]
    fn triangles_that_a_mask_does_not_have_count() {
        let mask = OpacityMask::new(5, 1, |_, _| false).unwrap();
        let opaque = [4, 5, 6, 7, 8, u32::MAX].map(|triangle| mask.is_opaque(triangle, 0.1, 0.1));
        assert_eq!(opaque, [false, true, true, true, true, true]);
    }

    #[test]
    fn words_are_checked() {
        let mask = OpacityMask::new(5, 1, |triangle, [u, _]| triangle % 2 == 0 || u < 0.3).unwrap();
        assert_eq!(mask.words().len(), 1);
        assert_eq!(OpacityMask::of_words(5, 1, mask.words()), Ok(mask.clone()));
        let wrong = |words: &[u32], expected| {
            let words_found = words.len() as u64;
            let error = SceneError::OpacityWords { words: words_found, expected };
            assert_eq!(OpacityMask::of_words(5, 1, words), Err(error));
        };
        wrong(&[], 1);
        wrong(&[0, 0], 1);
        wrong(&[1 << 20], 1);
        assert!(OpacityMask::of_words(5, 1, &[1 << 19]).is_ok());
        assert_eq!(OpacityMask::of_words(0, 0, &[]).unwrap().words(), &vec![0u32; 0][..]);
        let level = SceneError::OpacityLevel { level: 13 };
        assert_eq!(OpacityMask::of_words(5, 13, &[]), Err(level));
    }
}
