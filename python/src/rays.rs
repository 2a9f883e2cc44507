//! Rays: rows of numbers as the library's records.

use std::cell::Cell;

use numpy::{PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;
use pyo3::types::PyFloat;
use rayon::prelude::*;
use splitplane::{Ray, Rays as Given};

use crate::arrays::{flat, reserved};
use crate::failure::Failure;

/// Rays that are answered at once: few enough for the caches, many enough for the batch.
pub(crate) const CHUNK: usize = 1 << 18;
/// Rays of a task, as many as the CPU backend has in one: its records and answers stay in the caches.
pub(crate) const BLOCK: usize = 4096;
/// Rows that a task turns into records.
const TASK: usize = 1 << 13;

thread_local! {
    static RECORDS: Cell<Vec<Ray>> = const { Cell::new(Vec::new()) };
}

/// A limit of `t`: one for all rays, or one for each.
#[derive(FromPyObject)]
pub(crate) enum LimitArgument<'py> {
    /// One for all, mostly: looked for first, as it is found at once.
    Number(Bound<'py, PyFloat>),
    /// One for each.
    Each(PyReadonlyArray1<'py, f32>),
    /// One for all.
    All(f32),
}

#[derive(Clone, Copy)]
enum Limit<'a> {
    Each(&'a [f32]),
    All(f32),
}

impl Limit<'_> {
    fn at(&self, place: usize) -> f32 {
        match self {
            Limit::Each(each) => each[place],
            Limit::All(all) => *all,
        }
    }
}

/// Rays as they lie in an array.
#[derive(Clone, Copy)]
pub(crate) enum Rays<'a> {
    /// Eight numbers a row are the library's own record: origin, least t, direction, greatest t.
    Whole(&'a [Ray]),
    /// Six numbers a row: origin and direction.
    Split { rows: &'a [[f32; 6]], t_min: Limits<'a>, t_max: Limits<'a> },
}

/// Limits of all rays.
#[derive(Clone, Copy)]
pub(crate) struct Limits<'a>(Limit<'a>);

impl<'a> Limits<'a> {
    pub(crate) fn new(
        argument: &'a LimitArgument<'_>,
        rays: usize,
        name: &str,
    ) -> Result<Limits<'a>, Failure> {
        match argument {
            LimitArgument::Number(all) => Ok(Limits(Limit::All(all.value() as f32))),
            LimitArgument::All(all) => Ok(Limits(Limit::All(*all))),
            LimitArgument::Each(each) => {
                let each = flat(each, name)?;
                if each.len() != rays {
                    let text = format!("{name} has {} entries for {rays} rays", each.len());
                    return Err(Failure::new("ShapeError", text));
                }
                Ok(Limits(Limit::Each(each)))
            }
        }
    }
}

impl<'a> Rays<'a> {
    pub(crate) fn new(
        array: &'a PyReadonlyArray2<'_, f32>,
        t_min: &'a LimitArgument<'_>,
        t_max: &'a LimitArgument<'_>,
    ) -> Result<Rays<'a>, Failure> {
        let columns = array.as_array().ncols();
        let numbers = array.as_slice().map_err(|_| {
            Failure::new("ShapeError", "rays must be aligned and contiguous, in the order of C")
        })?;
        match columns {
            8 => Ok(Rays::Whole(bytemuck::cast_slice(numbers))),
            6 => {
                let rows = numbers.as_chunks::<6>().0;
                let t_min = Limits::new(t_min, rows.len(), "t_min")?;
                let t_max = Limits::new(t_max, rows.len(), "t_max")?;
                Ok(Rays::Split { rows, t_min, t_max })
            }
            _ => {
                let text = format!("rays have {columns} columns, but must have 6 or 8");
                Err(Failure::new("ShapeError", text))
            }
        }
    }

    pub(crate) fn len(&self) -> usize {
        match self {
            Rays::Whole(rays) => rays.len(),
            Rays::Split { rows, .. } => rows.len(),
        }
    }

    fn at(&self, place: usize) -> Ray {
        match self {
            Rays::Whole(rays) => rays[place],
            Rays::Split { rows, t_min: Limits(t_min), t_max: Limits(t_max) } => {
                let [a, b, c, x, y, z] = rows[place];
                let (t_min, t_max) = (t_min.at(place), t_max.at(place));
                Ray { origin: [a, b, c], t_min, direction: [x, y, z], t_max }
            }
        }
    }

    /// Few rays, one after the other.
    pub(crate) fn each(&self) -> impl Iterator<Item = Ray> {
        (0..self.len()).map(|place| self.at(place))
    }

    /// Shows the rays of one block: as they lie, unless each has limits of its own.
    pub(crate) fn with_block<T>(
        &self,
        number: usize,
        show: impl FnOnce(Given<'_>) -> Result<T, Failure>,
    ) -> Result<T, Failure> {
        let here = number * BLOCK..self.len().min((number + 1) * BLOCK);
        match *self {
            Rays::Whole(rays) => return show(Given::Records(&rays[here])),
            Rays::Split {
                rows,
                t_min: Limits(Limit::All(t_min)),
                t_max: Limits(Limit::All(t_max)),
            } => return show(Given::Rows { rows: &rows[here], t_min, t_max }),
            Rays::Split { .. } => {}
        }
        // Taken out, so that a task that this thread does in between has its own.
        let mut records = RECORDS.take();
        records.clear();
        records.try_reserve(BLOCK).map_err(|_| Failure::memory(BLOCK * size_of::<Ray>()))?;
        records.extend(here.map(|place| self.at(place)));
        let shown = show(Given::Records(&records));
        RECORDS.set(records);
        shown
    }

    /// Shows the rays chunk by chunk, each with the place of its first.
    pub(crate) fn in_chunks(
        &self,
        chunk: usize,
        mut show: impl FnMut(&[Ray], usize) -> Result<(), Failure>,
    ) -> Result<(), Failure> {
        let total = self.len();
        if let Rays::Whole(rays) = self {
            for (number, rays) in rays.chunks(chunk).enumerate() {
                show(rays, number * chunk)?;
            }
            return Ok(());
        }
        let mut records = reserved(total.min(chunk), Ray::new([0.0; 3], [0.0; 3]))?;
        for first in (0..total).step_by(chunk) {
            let records = &mut records[..chunk.min(total - first)];
            records.par_chunks_mut(TASK).enumerate().for_each(|(number, records)| {
                let first = first + number * TASK;
                for (place, record) in records.iter_mut().enumerate() {
                    *record = self.at(first + place);
                }
            });
            show(records, first)?;
        }
        Ok(())
    }
}
