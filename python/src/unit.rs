//! Rays in float64 as the library's rows, in one pass: what the classes of trimesh's shape are given.

use std::sync::atomic::{AtomicBool, Ordering};

use numpy::{PyReadonlyArray2, PyReadwriteArray2};
use pyo3::prelude::*;
use rayon::prelude::*;

use crate::arrays::{room_for_rows, rows};
use crate::call::Call;
use crate::failure::Failure;
use splitplane_float_state::Standard;

/// Rays that a task takes.
const TASK: usize = 1 << 13;

/// A direction of length 1; one of no length, or of one that is no number, as it is.
fn unit([x, y, z]: [f64; 3]) -> [f64; 3] {
    let length = (x * x + y * y + z * z).sqrt();
    let length = if length > 0.0 { length } else { 1.0 };
    [x / length, y / length, z / length]
}

/// Writes rays as rows of float32: origins relative to `shift`, directions of length 1. What is finite must stay so.
fn write(
    origins: &[[f64; 3]],
    directions: &[[f64; 3]],
    shift: [f64; 3],
    rows: &mut [[f32; 6]],
) -> bool {
    // A thread of the pool; the calling thread has this state already.
    let _state = Standard::set();
    let mut too_far = false;
    for ((origin, direction), row) in origins.iter().zip(directions).zip(rows) {
        let [x, y, z] = *origin;
        let shifted = [x - shift[0], y - shift[1], z - shift[2]];
        let [x, y, z] = unit(*direction);
        *row =
            [shifted[0] as f32, shifted[1] as f32, shifted[2] as f32, x as f32, y as f32, z as f32];
        // Directions are no longer than 1, or were not finite.
        for axis in 0..3 {
            too_far |= row[axis].is_infinite() & shifted[axis].is_finite();
        }
    }
    too_far
}

/// Rows (n, 6) of rays: origins (n, 3) relative to `shift`, and directions (n, 3), of length 1.
#[pyfunction]
pub(crate) fn unit_rays(
    py: Python<'_>,
    origins: PyReadonlyArray2<'_, f64>,
    directions: PyReadonlyArray2<'_, f64>,
    shift: [f64; 3],
    mut found: PyReadwriteArray2<'_, f32>,
    call: Call,
) -> PyResult<()> {
    let origins = rows::<f64, 3>(&origins, "origins")?;
    let directions = rows::<f64, 3>(&directions, "directions")?;
    let total = origins.len();
    if directions.len() != total {
        return Err(Failure::new("ShapeError", "origins and directions differ in number").into());
    }
    let found = room_for_rows::<f32, 6>(&mut found, total)?;
    let too_far = if call.is_alone(total.div_ceil(TASK)) {
        call.run_alone(py, |_| Ok(write(origins, directions, shift, found)))?
    } else {
        call.run(py, |_| {
            let too_far = AtomicBool::new(false);
            let given = origins.par_chunks(TASK).zip(directions.par_chunks(TASK));
            given.zip(found.par_chunks_mut(TASK)).for_each(|((origins, directions), rows)| {
                if write(origins, directions, shift, rows) {
                    too_far.store(true, Ordering::Relaxed);
                }
            });
            Ok(too_far.into_inner())
        })?
    };
    match too_far {
        true => {
            let text = "rays has numbers beyond the greatest float32, 3.4e38";
            Err(Failure::new("RangeError", text).into())
        }
        false => Ok(()),
    }
}
