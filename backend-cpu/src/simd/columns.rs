//! References of the nodes of one task as a structure of arrays.

use std::collections::TryReserveError;

use splitplane_core::aabb::{Aabb, max, min};
use splitplane_core::layout::Reference;

use super::WIDTH;

/// One column for each of the six faces (lower x, y, z, upper x, y, z) and one for the triangle. A node is
/// a range of it.
#[derive(Debug, Default)]
pub(crate) struct Columns {
    faces: [Vec<f32>; 6],
    triangles: Vec<u32>,
}

/// One row of [`Columns`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct ReferenceRow {
    /// Lower x, y, z, upper x, y, z.
    pub faces: [f32; 6],
    /// The triangle's index in the mesh.
    pub triangle: u32,
}

impl Columns {
    /// Capacity in rows.
    #[inline]
    pub(crate) fn room(&self) -> usize {
        self.triangles.len()
    }

    /// Bytes held.
    pub(crate) fn bytes(&self) -> u64 {
        let faces: usize = self.faces.iter().map(Vec::capacity).sum();
        4 * (faces + self.triangles.capacity()) as u64
    }

    /// Makes space for `rows` rows in all; existing rows stay.
    ///
    /// # Errors
    /// Less memory than that.
    pub(crate) fn lengthen(&mut self, rows: usize) -> Result<(), TryReserveError> {
        let more = rows.saturating_sub(self.room());
        if more > 0 {
            for column in &mut self.faces {
                column.try_reserve(more)?;
                column.resize(rows, 0.0);
            }
            self.triangles.try_reserve(more)?;
            self.triangles.resize(rows, 0);
        }
        Ok(())
    }

    /// Copies references to the front, where there must be space for them.
    pub(crate) fn load(&mut self, references: &[Reference]) {
        let count = references.len();
        let [lx, ly, lz, hx, hy, hz] = &mut self.faces;
        let columns = [lx, ly, lz, hx, hy, hz].map(|column| &mut column[..count]);
        let [lx, ly, lz, hx, hy, hz] = columns;
        let triangles = &mut self.triangles[..count];
        for (i, reference) in references.iter().enumerate() {
            [lx[i], ly[i], lz[i]] = reference.lo;
            [hx[i], hy[i], hz[i]] = reference.hi;
            triangles[i] = reference.triangle;
        }
    }

    /// A row.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) fn get(&self, index: usize) -> ReferenceRow {
        ReferenceRow {
            faces: core::array::from_fn(|row| self.faces[row][index]),
            triangle: self.triangles[index],
        }
    }

    /// Overwrites a row.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) fn set(&mut self, index: usize, row: &ReferenceRow) {
        for (column, face) in self.faces.iter_mut().zip(row.faces) {
            column[index] = face;
        }
        self.triangles[index] = row.triangle;
    }

    /// Rows of one face.
    #[inline]
    pub(crate) fn face(&self, face: usize, first: usize, count: usize) -> &[f32] {
        &self.faces[face][first..first + count]
    }

    /// Triangles of some rows.
    #[inline]
    pub(crate) fn triangles(&self, first: usize, count: usize) -> &[u32] {
        &self.triangles[first..first + count]
    }

    /// The starts of the columns, for the SIMD module.
    #[cfg(target_arch = "x86_64")]
    #[inline]
    pub(super) fn pointers(&mut self) -> ([*mut f32; 6], *mut u32) {
        (self.faces.each_mut().map(|column| column.as_mut_ptr()), self.triangles.as_mut_ptr())
    }

    /// Moves rows to a lower place.
    pub(crate) fn move_down(&mut self, from: usize, count: usize, to: usize) {
        for column in &mut self.faces {
            column.copy_within(from..from + count, to);
        }
        self.triangles.copy_within(from..from + count, to);
    }

    /// Rows as references.
    ///
    /// # Errors
    /// Less memory than they take.
    pub(crate) fn references(
        &self,
        first: usize,
        count: usize,
        out: &mut Vec<Reference>,
    ) -> Result<(), TryReserveError> {
        out.clear();
        out.try_reserve(count)?;
        out.extend((first..first + count).map(|index| {
            let ReferenceRow { faces: [lx, ly, lz, hx, hy, hz], triangle } = self.get(index);
            Reference::new(&Aabb { lo: [lx, ly, lz], hi: [hx, hy, hz] }, triangle)
        }));
        Ok(())
    }

    /// The bounds of some rows. Faces are never -0 and never NaN, so the order does not show.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) fn bounds(&self, first: usize, count: usize) -> Aabb {
        let mut bounds = Aabb::EMPTY;
        for axis in 0..3 {
            bounds.lo[axis] = fold(self.face(axis, first, count), f32::MAX, min);
            bounds.hi[axis] = fold(self.face(3 + axis, first, count), -f32::MAX, max);
        }
        bounds
    }
}

/// Folds side by side, so that vector instructions serve.
#[cfg_attr(not(unoptimised), inline(always))]
fn fold(values: &[f32], neutral: f32, f: impl Fn(f32, f32) -> f32) -> f32 {
    let mut lanes = [neutral; WIDTH];
    let mut blocks = values.chunks_exact(WIDTH);
    for block in &mut blocks {
        for lane in 0..WIDTH {
            lanes[lane] = f(lanes[lane], block[lane]);
        }
    }
    for (lane, &value) in lanes.iter_mut().zip(blocks.remainder()) {
        *lane = f(*lane, value);
    }
    lanes.into_iter().fold(neutral, f)
}
