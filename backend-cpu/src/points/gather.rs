//! From the caller's points to columns, and back to points in the order of a tree.

use splitplane_core::arithmetic::{Arithmetic, Strict, power_of_two, snap};
use splitplane_core::points::build::is_kept;
use splitplane_core::points::distance::Unit;
use splitplane_core::points::tree::BLOCK;

use super::columns::Columns;
use super::layout::Line;
use crate::simd::{Compiled, Simd};

/// Gathers the points that are kept, in the tree's unit, by index.
pub(super) struct Gather<'a, 'b, const N: usize> {
    pub(super) points: &'a [[f32; N]],
    /// Whether all are kept.
    pub(super) all: bool,
    pub(super) unit: Unit,
    /// Room for them and for the rest of a block.
    pub(super) columns: &'a mut Columns<'b, N>,
}

impl<const N: usize> Compiled for Gather<'_, '_, N> {
    type Output = ();

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn run<S: Simd>(self) {
        let Gather { points, all, unit, columns } = self;
        // As `Unit::scaled`.
        let scale = power_of_two(-unit.exponent());
        let scaled = |x| Strict::snapped_product(snap(x), scale);
        let none: &[[[f32; N]; BLOCK]] = &[];
        let (chunks, rest) = if all { points.as_chunks::<BLOCK>() } else { (none, points) };
        let (axes, indices) = columns.parts();
        let mut place = 0;
        for chunk in chunks {
            let mut units = *chunk;
            for x in units.as_flattened_mut() {
                *x = scaled(*x);
            }
            for axis in 0..N {
                let column = &mut axes[axis][place..place + BLOCK];
                for i in 0..BLOCK {
                    column[i] = units[i][axis];
                }
            }
            for (i, index) in indices[place..place + BLOCK].iter_mut().enumerate() {
                *index = (place + i) as u32;
            }
            place += BLOCK;
        }
        for (index, point) in (points.len() - rest.len()..).zip(rest) {
            if all || is_kept(point) {
                for axis in 0..N {
                    axes[axis][place] = scaled(point[axis]);
                }
                indices[place] = index as u32;
                place += 1;
            }
        }
        for axis in 0..N {
            axes[axis][place..].fill(f32::INFINITY);
        }
        indices[place..].fill(u32::MAX);
    }
}

/// Writes points in the order of columns.
pub(super) struct Spread<'a, const N: usize> {
    /// N columns, one after the other.
    pub(super) columns: &'a [Line],
    pub(super) points: &'a mut [[f32; N]],
}

impl<const N: usize> Compiled for Spread<'_, N> {
    type Output = ();

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn run<S: Simd>(self) {
        let blocks = self.points.len().div_ceil(BLOCK);
        for (block, points) in self.points.chunks_mut(BLOCK).enumerate() {
            for axis in 0..N {
                let line = &self.columns[axis * blocks + block];
                for (point, &x) in points.iter_mut().zip(&line.0) {
                    point[axis] = x;
                }
            }
        }
    }
}
