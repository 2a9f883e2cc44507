//! Hits of a tree over several meshes, in the columns that Open3D has: block by block, on all threads.

use std::cell::Cell;

use numpy::{PyReadonlyArray1, PyReadonlyArray2, PyReadwriteArray1, PyReadwriteArray2};
use pyo3::prelude::*;
use rayon::prelude::*;
use splitplane::{Hit, QueryOptions};

use crate::arrays::{flat, room, room_for_rows, rows};
use crate::call::Call;
use crate::failure::Failure;
use crate::rays::{BLOCK, LimitArgument, Rays};
use crate::tree::{FEW, Tree, in_blocks};

const NONE: u32 = u32::MAX;
/// Hits that a task names.
const TASK: usize = 1 << 13;

thread_local! {
    /// The hits of one block, before they are columns.
    static HITS: Cell<Vec<Hit>> = const { Cell::new(Vec::new()) };
}

/// The meshes of a tree: where the faces of each begin (one more entry than meshes), and the normals of all.
#[derive(Clone, Copy)]
struct Names<'a> {
    starts: &'a [u32],
    normals: &'a [[f32; 3]],
}

impl Names<'_> {
    /// The mesh of a face of the tree, and the face in it.
    #[inline]
    fn of(&self, triangle: u32) -> (u32, u32) {
        if triangle == NONE {
            return (NONE, NONE);
        }
        let after = self.starts.partition_point(|&start| start <= triangle) as u32;
        let mesh = after.wrapping_sub(1);
        let first = self.starts.get(mesh as usize).copied().unwrap_or(0);
        (mesh, triangle.wrapping_sub(first))
    }

    /// The normal of a face of the tree; 0 for none.
    #[inline]
    fn normal(&self, triangle: u32) -> [f32; 3] {
        self.normals.get(triangle as usize).copied().unwrap_or([0.0; 3])
    }
}

/// Room for what is told of some hits: `t` apart, these are the columns.
struct Columns<'a> {
    geometry: &'a mut [u32],
    face: &'a mut [u32],
    weights: &'a mut [[f32; 2]],
    normals: &'a mut [[f32; 3]],
}

impl Columns<'_> {
    /// Writes them, column by column: loops without calls, of which a compiler makes vectors.
    fn write(&mut self, names: &Names<'_>, hits: &[Hit]) {
        if let [_, _] = names.starts {
            for (geometry, hit) in self.geometry.iter_mut().zip(hits) {
                *geometry = if hit.triangle == NONE { NONE } else { 0 };
            }
            for (face, hit) in self.face.iter_mut().zip(hits) {
                *face = hit.triangle;
            }
        } else {
            for ((geometry, face), hit) in self.geometry.iter_mut().zip(&mut *self.face).zip(hits) {
                (*geometry, *face) = names.of(hit.triangle);
            }
        }
        for (weights, hit) in self.weights.iter_mut().zip(hits) {
            *weights = [hit.u, hit.v];
        }
        for (normal, hit) in self.normals.iter_mut().zip(hits) {
            *normal = names.normal(hit.triangle);
        }
    }
}

/// The first hit of each ray, in Open3D's columns: `t`, the mesh, the face in it, both weights side by side, and the normal.
///
/// `starts` says where the faces of each mesh begin in the tree, and has one more entry than meshes. Hits are columns as soon as a
/// block of rays is answered, while they are in the caches.
#[pyfunction]
#[expect(clippy::too_many_arguments, reason = "what Python hands over, argument by argument")]
pub(crate) fn cast_named(
    py: Python<'_>,
    tree: PyRef<'_, Tree>,
    rays: PyReadonlyArray2<'_, f32>,
    starts: PyReadonlyArray1<'_, u32>,
    table: PyReadonlyArray2<'_, f32>,
    mut t: PyReadwriteArray1<'_, f32>,
    mut geometry: PyReadwriteArray1<'_, u32>,
    mut face: PyReadwriteArray1<'_, u32>,
    mut weights: PyReadwriteArray2<'_, f32>,
    mut normals: PyReadwriteArray2<'_, f32>,
    call: Call,
) -> PyResult<()> {
    let limits = (LimitArgument::All(0.0), LimitArgument::All(f32::INFINITY));
    let rays = Rays::new(&rays, &limits.0, &limits.1)?;
    let names = Names { starts: flat(&starts, "starts")?, normals: rows(&table, "normals")? };
    let (total, options) = (rays.len(), QueryOptions::default());
    let state = tree.read()?;
    state.opened.check_process()?;
    let accelerator = &*state.accelerator;
    let t = room(&mut t, total)?;
    let (geometry, face) = (room(&mut geometry, total)?, room(&mut face, total)?);
    let weights = room_for_rows::<f32, 2>(&mut weights, total)?;
    let normals = room_for_rows::<f32, 3>(&mut normals, total)?;
    if total <= FEW && !call.is_watched() {
        let mut hits = [Hit::MISS; FEW];
        for (place, (ray, t)) in rays.each().zip(t).enumerate() {
            hits[place] = accelerator.closest_hit(&ray, &options).unwrap_or(Hit::MISS);
            *t = hits[place].t;
        }
        Columns { geometry, face, weights, normals }.write(&names, &hits[..total]);
        return Ok(());
    }
    let outs = geometry.chunks_mut(BLOCK).zip(face.chunks_mut(BLOCK));
    let outs = outs.zip(weights.chunks_mut(BLOCK)).zip(normals.chunks_mut(BLOCK));
    let outs = t.chunks_mut(BLOCK).zip(outs);
    in_blocks(
        py,
        &call,
        &rays,
        outs,
        |rays, (t, (((geometry, face), weights), normals)), watch| {
            // Taken out, so that a task that this thread does in between has its own.
            let mut hits = HITS.take();
            if hits.len() < BLOCK {
                let more = BLOCK - hits.len();
                hits.try_reserve_exact(more)
                    .map_err(|_| Failure::memory(more * size_of::<Hit>()))?;
                hits.resize(BLOCK, Hit::MISS);
            }
            let own = &mut hits[..t.len()];
            accelerator.closest_hits_of(rays, own, &QueryOptions { watch, ..options })?;
            for (t, hit) in t.iter_mut().zip(&*own) {
                *t = hit.t;
            }
            Columns { geometry, face, weights, normals }.write(&names, own);
            HITS.set(hits);
            Ok(())
        },
    )?;
    Ok(())
}

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
    // They may be columns of records, which are not contiguous.
    let (triangle, u, v) = (triangle.as_array(), u.as_array(), v.as_array());
    let names = Names { starts: flat(&starts, "starts")?, normals: rows(&table, "normals")? };
    let total = triangle.len();
    if u.len() != total || v.len() != total {
        return Err(Failure::new("ShapeError", "weights and triangles differ in number").into());
    }
    let (geometry, face) = (room(&mut geometry, total)?, room(&mut face, total)?);
    let weights = room_for_rows::<f32, 2>(&mut weights, total)?;
    let normals = room_for_rows::<f32, 3>(&mut normals, total)?;
    call.run(py, |_| {
        let outs = geometry.par_chunks_mut(TASK).zip(face.par_chunks_mut(TASK));
        let rest = weights.par_chunks_mut(TASK).zip(normals.par_chunks_mut(TASK));
        outs.zip(rest).enumerate().for_each(|(number, ((geometry, face), (weights, normals)))| {
            for place in 0..geometry.len() {
                let own = number * TASK + place;
                (geometry[place], face[place]) = names.of(triangle[own]);
                weights[place] = [u[own], v[own]];
                normals[place] = names.normal(triangle[own]);
            }
        });
        Ok(())
    })
}
