//! Answers of the library as arrays.

use numpy::{IntoPyArray, PyArray1};
use pyo3::prelude::*;
use splitplane::objects::SceneCrossing;
use splitplane::{Crossing, Located, Watch};

use crate::call::{Part, Watcher};
use crate::failure::Failure;
use crate::options::{Counts, add};

/// Points whose places are asked for at once.
const POINTS: usize = 1 << 16;

/// The crossings of rays, a column for each thing that is known of them.
#[derive(Default)]
pub(crate) struct Columns {
    starts: Vec<i64>,
    t: Vec<f32>,
    triangle: Vec<u32>,
    u: Vec<f32>,
    v: Vec<f32>,
    front: Vec<bool>,
    geometry: Vec<u32>,
    instance: Vec<u32>,
}

/// What a crossing gives to the columns.
pub(crate) trait Row {
    /// t, triangle, u, v, front.
    fn common(&self) -> (f32, u32, f32, f32, bool);
    /// Geometry and instance, where there are any.
    fn names(&self) -> Option<(u32, u32)>;
}

impl Row for Crossing {
    fn common(&self) -> (f32, u32, f32, f32, bool) {
        (self.hit.t, self.hit.triangle, self.hit.u, self.hit.v, self.front)
    }
    fn names(&self) -> Option<(u32, u32)> {
        None
    }
}

impl Row for SceneCrossing {
    fn common(&self) -> (f32, u32, f32, f32, bool) {
        (self.hit.t, self.hit.triangle, self.hit.u, self.hit.v, self.front)
    }
    fn names(&self) -> Option<(u32, u32)> {
        Some((self.hit.geometry, self.hit.instance))
    }
}

/// The columns as arrays: starts, t, triangle, u, v, front, geometry, instance; and the counts of the report.
pub(crate) type Crossings<'py> = (
    (Bound<'py, PyArray1<i64>>, Bound<'py, PyArray1<f32>>, Bound<'py, PyArray1<u32>>),
    (Bound<'py, PyArray1<f32>>, Bound<'py, PyArray1<f32>>, Bound<'py, PyArray1<bool>>),
    (Bound<'py, PyArray1<u32>>, Bound<'py, PyArray1<u32>>),
    Counts,
);

impl Columns {
    pub(crate) fn of<R: Row>(starts: &[usize], crossings: &[R]) -> Result<Columns, Failure> {
        let mut columns = Columns::default();
        let length = crossings.len();
        let bytes = 8 * starts.len() + 26 * length;
        let refused = |_| Failure::memory(bytes);
        columns.starts.try_reserve_exact(starts.len()).map_err(refused)?;
        columns.starts.extend(starts.iter().map(|&start| start as i64));
        for column in [&mut columns.t, &mut columns.u, &mut columns.v] {
            column.try_reserve_exact(length).map_err(refused)?;
        }
        let named = crossings.first().is_some_and(|first| first.names().is_some());
        let names = if named { length } else { 0 };
        columns.geometry.try_reserve_exact(names).map_err(refused)?;
        columns.instance.try_reserve_exact(names).map_err(refused)?;
        columns.triangle.try_reserve_exact(length).map_err(refused)?;
        columns.front.try_reserve_exact(length).map_err(refused)?;
        for crossing in crossings {
            let (t, triangle, u, v, front) = crossing.common();
            columns.t.push(t);
            columns.triangle.push(triangle);
            columns.u.push(u);
            columns.v.push(v);
            columns.front.push(front);
            if let Some((geometry, instance)) = crossing.names() {
                columns.geometry.push(geometry);
                columns.instance.push(instance);
            }
        }
        Ok(columns)
    }

    pub(crate) fn into_arrays(self, py: Python<'_>, counts: Counts) -> Crossings<'_> {
        (
            (self.starts.into_pyarray(py), self.t.into_pyarray(py), self.triangle.into_pyarray(py)),
            (self.u.into_pyarray(py), self.v.into_pyarray(py), self.front.into_pyarray(py)),
            (self.geometry.into_pyarray(py), self.instance.into_pyarray(py)),
            counts,
        )
    }
}

/// Asks where points lie, some at a time.
pub(crate) fn located(
    points: &[[f32; 3]],
    winding: &mut [i32],
    boundary: &mut [bool],
    watcher: &Watcher,
    ask: impl Fn(&[[f32; 3]], &dyn Watch) -> Result<Located, Failure>,
) -> Result<Counts, Failure> {
    let (mut sum, total) = (Counts::default(), points.len());
    for (number, few) in points.chunks(POINTS).enumerate() {
        let first = number * POINTS;
        let answer = ask(few, &Part { watcher, first, total })?;
        add(&mut sum, &answer.report);
        for (place, wound) in answer.windings.iter().enumerate() {
            winding[first + place] = wound.unwrap_or(0);
            boundary[first + place] = wound.is_none();
        }
    }
    Ok(sum)
}
