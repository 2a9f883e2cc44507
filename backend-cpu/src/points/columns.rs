//! Points as columns: the coordinates of an axis one after the other, and the indices. A column has places for whole blocks; those after the
//! last point have infinite coordinates.

use core::ptr::null_mut;

/// Most columns: four axes, and the indices, which follow the axes.
pub(crate) const MOST_COLUMNS: usize = 5;

/// Where columns begin. Only those of the axes and the one after them are there.
pub(crate) type Pointers = [*mut u32; MOST_COLUMNS];

/// Columns that may be written.
#[derive(Debug)]
pub(super) struct Columns<'a, const N: usize> {
    axes: [&'a mut [f32]; N],
    points: &'a mut [u32],
}

impl<'a, const N: usize> Columns<'a, N> {
    /// Coordinates are N columns, one after the other, each as long as that of the indices.
    pub(super) fn new(coordinates: &'a mut [f32], points: &'a mut [u32]) -> Columns<'a, N> {
        assert_eq!(coordinates.len(), N * points.len());
        let mut rest = coordinates;
        let axes = core::array::from_fn(|_| {
            let (column, others) = core::mem::take(&mut rest).split_at_mut(points.len());
            rest = others;
            column
        });
        Columns { axes, points }
    }

    /// Places of a column.
    pub(super) fn len(&self) -> usize {
        self.points.len()
    }

    /// The first places, and the others.
    pub(super) fn split_at(self, middle: usize) -> [Columns<'a, N>; 2] {
        let (left, right) = self.points.split_at_mut(middle);
        let none = || core::array::from_fn(|_| <&mut [f32]>::default());
        let mut sides = [left, right].map(|points| Columns { axes: none(), points });
        for (axis, column) in self.axes.into_iter().enumerate() {
            (sides[0].axes[axis], sides[1].axes[axis]) = column.split_at_mut(middle);
        }
        sides
    }

    /// Those of axes, and the indices.
    pub(super) fn parts(&mut self) -> (&mut [&'a mut [f32]; N], &mut [u32]) {
        (&mut self.axes, self.points)
    }

    /// Where they begin.
    pub(super) fn pointers(&mut self) -> Pointers {
        let mut all = [null_mut(); MOST_COLUMNS];
        for (to, column) in all.iter_mut().zip(&mut self.axes) {
            *to = column.as_mut_ptr().cast();
        }
        all[N] = self.points.as_mut_ptr();
        all
    }
}

/// The same columns from another place on.
///
/// # Safety
/// They must have that place.
#[cfg_attr(not(unoptimised), inline(always))]
pub(super) unsafe fn from_place<const N: usize>(columns: &Pointers, place: usize) -> Pointers {
    let mut all = *columns;
    for column in &mut all[..=N] {
        // SAFETY: the caller's contract.
        *column = unsafe { column.add(place) };
    }
    all
}
