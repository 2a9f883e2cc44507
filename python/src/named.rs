//! Hits of a tree over several meshes, in the columns that Open3D has: one pass over all of them, on all threads.

use numpy::{PyReadonlyArray1, PyReadonlyArray2, PyReadwriteArray1, PyReadwriteArray2};
use pyo3::prelude::*;
use rayon::prelude::*;

use crate::arrays::{flat, room, room_for_rows, rows};
use crate::call::Call;
use crate::failure::Failure;

const NONE: u32 = u32::MAX;
/// Hits that a task names.
const TASK: usize = 1 << 13;

/// For faces of a tree over several meshes, which begin at `starts` (one more entry than meshes): the mesh, the face in it, both weights
/// side by side, and the normal.
#[pyfunction]
#[expect(clippy::too_many_arguments, reason = "what Python hands over, argument by argument")]
pub(crate) fn named(
    py: Python<'_>,
    triangle: PyReadonlyArray1<'_, u32>,
    u: PyReadonlyArray1<'_, f32>,
    v: PyReadonlyArray1<'_, f32>,
    starts: PyReadonlyArray1<'_, u32>,
    table: PyReadonlyArray2<'_, f32>,
    mut geometry: PyReadwriteArray1<'_, u32>,
    mut face: PyReadwriteArray1<'_, u32>,
    mut weights: PyReadwriteArray2<'_, f32>,
    mut normals: PyReadwriteArray2<'_, f32>,
    call: Call,
) -> PyResult<()> {
    // Columns of records, mostly, which are not contiguous.
    let (triangle, u, v) = (triangle.as_array(), u.as_array(), v.as_array());
    let starts = flat(&starts, "starts")?;
    let table = rows::<f32, 3>(&table, "normals")?;
    let total = triangle.len();
    if u.len() != total || v.len() != total {
        return Err(Failure::new("ShapeError", "weights and triangles differ in number").into());
    }
    let (geometry, face) = (room(&mut geometry, total)?, room(&mut face, total)?);
    let weights = room_for_rows::<f32, 2>(&mut weights, total)?;
    let normals = room_for_rows::<f32, 3>(&mut normals, total)?;
    call.run(py, |_| {
        let names = geometry.par_chunks_mut(TASK).zip(face.par_chunks_mut(TASK));
        let rest = weights.par_chunks_mut(TASK).zip(normals.par_chunks_mut(TASK));
        names.zip(rest).enumerate().for_each(|(number, ((geometry, face), (weights, normals)))| {
            for place in 0..geometry.len() {
                let own = number * TASK + place;
                let triangle = triangle[own];
                let mesh = match starts {
                    _ if triangle == NONE => NONE,
                    [_, _] => 0,
                    starts => {
                        (starts.partition_point(|&start| start <= triangle) as u32).wrapping_sub(1)
                    }
                };
                let first = starts.get(mesh as usize).copied().unwrap_or(0);
                geometry[place] = mesh;
                face[place] = if triangle == NONE { NONE } else { triangle - first };
                weights[place] = [u[own], v[own]];
                normals[place] = table.get(triangle as usize).copied().unwrap_or([0.0; 3]);
            }
        });
        Ok(())
    })
}
