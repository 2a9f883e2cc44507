//! A tree over one mesh.

use std::collections::BTreeMap;
use std::sync::{Arc, RwLock, RwLockReadGuard, RwLockWriteGuard};

use numpy::{PyReadonlyArray1, PyReadonlyArray2, PyReadwriteArray1, PyReadwriteArray2};
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use rayon::prelude::*;
use splitplane::core::tree::file::{self, TreeFile};
use splitplane::{
    Accelerator, AllHitsOptions, BuildOptions, ClosestPoint, ClosestPointOptions, Crossing, Hit,
    LoadOptions, LocateOptions, Mesh, QueryOptions, QueryReport, Ray, Rays as Given, Watch,
};

use crate::answers::{Columns, Crossings, located};
use crate::arrays::{flat, reserved, room, room_for_rows, rows};
use crate::call::{Blocks, Call, Pace, Part};
use crate::failure::Failure;
use crate::open::{Opened, open};
use crate::options::{Counts, accuracy, add, config, culling, layout};
use crate::order::ordered;
use crate::rays::{BLOCK, CHUNK, LimitArgument, Rays};

/// Up to this many rays are answered by the calling thread, one after the other.
pub(crate) const FEW: usize = 16;
/// Rays for a device at once.
const DEVICE_CHUNK: usize = 1 << 22;

pub(crate) struct State {
    pub(crate) accelerator: Box<dyn Accelerator>,
    pub(crate) opened: Arc<Opened>,
}

/// See `splitplane.Tree`.
#[pyclass(frozen, module = "splitplane._native")]
pub(crate) struct Tree {
    state: RwLock<State>,
}

pub(crate) fn busy() -> Failure {
    Failure::new(
        "BusyError",
        "another thread is changing or asking this object; wait until it has finished",
    )
}

impl Tree {
    pub(crate) fn read(&self) -> Result<RwLockReadGuard<'_, State>, Failure> {
        self.state.try_read().map_err(|_| busy())
    }

    fn write(&self) -> Result<RwLockWriteGuard<'_, State>, Failure> {
        self.state.try_write().map_err(|_| busy())
    }
}

/// The build's settings as Python hands them over: preset, knobs, layout, most bytes.
pub(crate) type BuildArguments = (String, BTreeMap<String, i64>, String, Option<u64>);

pub(crate) fn build_options<'a>(
    (preset, knobs, layout_name, max_memory): &BuildArguments,
) -> Result<BuildOptions<'a>, Failure> {
    let (config, layout) = (config(preset, knobs)?, layout(layout_name)?);
    Ok(BuildOptions { config, layout, max_memory: *max_memory, watch: None })
}

#[pymethods]
impl Tree {
    /// Builds a tree.
    #[staticmethod]
    fn build(
        py: Python<'_>,
        vertices: PyReadonlyArray2<'_, f32>,
        faces: PyReadonlyArray2<'_, u32>,
        arguments: BuildArguments,
        backend: (String, Option<String>),
        call: Call,
    ) -> PyResult<Tree> {
        let (vertices, faces) = (rows(&vertices, "vertices")?, rows(&faces, "faces")?);
        let mesh = Mesh::indexed(vertices, faces).map_err(Failure::from)?;
        let options = build_options(&arguments)?;
        let opened = open(py, &backend.0, backend.1.as_deref(), options.config.preset())?;
        let accelerator = call.run(py, |watcher| {
            let options = BuildOptions { watch: Some(watcher), ..options };
            Ok(opened.backend().build(&mesh, &options)?)
        })?;
        Ok(Tree { state: RwLock::new(State { accelerator, opened: kept(opened)? }) })
    }

    /// Makes a tree of the bytes of a tree file.
    #[staticmethod]
    fn load(
        py: Python<'_>,
        bytes: PyReadonlyArray1<'_, u8>,
        vertices: PyReadonlyArray2<'_, f32>,
        faces: PyReadonlyArray2<'_, u32>,
        arguments: BuildArguments,
        backend: (String, Option<String>),
        call: Call,
    ) -> PyResult<Tree> {
        let (vertices, faces) = (rows(&vertices, "vertices")?, rows(&faces, "faces")?);
        let mesh = Mesh::indexed(vertices, faces).map_err(Failure::from)?;
        let options = build_options(&arguments)?;
        let bytes = flat(&bytes, "the file")?;
        let opened = open(py, &backend.0, backend.1.as_deref(), options.config.preset())?;
        let accelerator = call.run(py, |watcher| {
            let kept = TreeFile::parse(bytes)?;
            if kept.mesh != file::mesh_digest(&mesh) {
                let text = "the tree was built over another mesh: its digest differs";
                return Err(Failure::new("WrongMeshError", text));
            }
            let limits = LoadOptions { watch: Some(watcher), ..options.for_loading() };
            Ok(opened.backend().load(&mesh, kept.tree.to_tree()?, &limits)?)
        })?;
        Ok(Tree { state: RwLock::new(State { accelerator, opened }) })
    }

    /// Builds again, over other arrays.
    fn rebuild(
        &self,
        py: Python<'_>,
        vertices: PyReadonlyArray2<'_, f32>,
        faces: PyReadonlyArray2<'_, u32>,
        arguments: BuildArguments,
        call: Call,
    ) -> PyResult<()> {
        let (vertices, faces) = (rows(&vertices, "vertices")?, rows(&faces, "faces")?);
        let mesh = Mesh::indexed(vertices, faces).map_err(Failure::from)?;
        let options = build_options(&arguments)?;
        let mut state = self.write()?;
        let State { accelerator, opened } = &mut *state;
        opened.check_process()?;
        call.run(py, |watcher| {
            let options = BuildOptions { watch: Some(watcher), ..options };
            Ok(opened.backend().rebuild(accelerator, &mesh, &options)?)
        })
    }

    /// The bytes of a tree file.
    fn to_bytes<'py>(
        &self,
        py: Python<'py>,
        vertices: PyReadonlyArray2<'_, f32>,
        faces: PyReadonlyArray2<'_, u32>,
    ) -> PyResult<Bound<'py, PyBytes>> {
        let (vertices, faces) = (rows(&vertices, "vertices")?, rows(&faces, "faces")?);
        let mesh = Mesh::indexed(vertices, faces).map_err(Failure::from)?;
        let state = self.read()?;
        let tree = state.accelerator.tree().view();
        let bytes = py.detach(|| file::write(&tree, &mesh)).map_err(Failure::from)?;
        Ok(PyBytes::new(py, &bytes))
    }

    /// 16 hexadecimal digits.
    fn digest(&self, py: Python<'_>) -> PyResult<String> {
        let state = self.read()?;
        let tree = state.accelerator.tree();
        Ok(py.detach(|| tree.digest()).to_string())
    }

    /// Numbers about the tree and its build, by name.
    fn summary(&self) -> PyResult<BTreeMap<&'static str, u64>> {
        let state = self.read()?;
        let (summary, tree) = (state.accelerator.summary(), state.accelerator.tree());
        Ok(BTreeMap::from([
            ("triangles", u64::from(summary.triangles)),
            ("dropped", u64::from(summary.dropped)),
            ("snapped", u64::from(summary.snapped)),
            ("peak_bytes", summary.peak_bytes),
            ("query_bytes", state.accelerator.query_bytes()),
            ("nodes", tree.nodes.len() as u64),
            ("references", tree.references.len() as u64),
        ]))
    }

    /// The box of all triangles that are kept: its lower and its upper corner.
    fn bounds(&self) -> PyResult<([f32; 3], [f32; 3])> {
        let state = self.read()?;
        let bounds = state.accelerator.tree().bounds;
        Ok((bounds.lo, bounds.hi))
    }

    /// The backend, and why it is this one.
    fn backend(&self) -> PyResult<(String, String)> {
        let state = self.read()?;
        Ok((state.opened.name.clone(), state.opened.reason.clone()))
    }

    /// See `splitplane.Tree.closest_hits`. Four numbers of 32 bits a ray: the library's own records, so that nothing is copied.
    fn closest_hits(
        &self,
        py: Python<'_>,
        rays: PyReadonlyArray2<'_, f32>,
        limits: (LimitArgument<'_>, LimitArgument<'_>),
        options: (String, String, Option<u32>),
        mut records: PyReadwriteArray2<'_, f32>,
        call: Call,
    ) -> PyResult<Counts> {
        let rays = Rays::new(&rays, &limits.0, &limits.1)?;
        let options = query_options(&options)?;
        let (total, state) = (rays.len(), self.read()?);
        state.opened.check_process()?;
        let hits: &mut [Hit] =
            bytemuck::cast_slice_mut(room_for_rows::<f32, 4>(&mut records, total)?);
        let State { accelerator, opened } = &*state;
        if total <= FEW && opened.is_cpu() && !call.is_watched() {
            for (ray, hit) in rays.each().zip(hits) {
                *hit = accelerator.closest_hit(&ray, &options).unwrap_or(Hit::MISS);
            }
            return Ok(Counts::default());
        }
        if opened.is_cpu() {
            return in_blocks(py, &call, &rays, hits.chunks_mut(BLOCK), |rays, hits, watch| {
                accelerator.closest_hits_of(rays, hits, &QueryOptions { watch, ..options })?;
                Ok(())
            });
        }
        on_device(py, &call, &rays, hits, |rays, hits, watch| {
            Ok(accelerator.closest_hits(rays, hits, &QueryOptions { watch, ..options })?)
        })
    }

    /// See `splitplane.Tree.any_hits`.
    fn any_hits(
        &self,
        py: Python<'_>,
        rays: PyReadonlyArray2<'_, f32>,
        limits: (LimitArgument<'_>, LimitArgument<'_>),
        options: (String, String, Option<u32>),
        mut occluded: PyReadwriteArray1<'_, bool>,
        call: Call,
    ) -> PyResult<Counts> {
        let rays = Rays::new(&rays, &limits.0, &limits.1)?;
        let options = query_options(&options)?;
        let (total, state) = (rays.len(), self.read()?);
        state.opened.check_process()?;
        let occluded = room(&mut occluded, total)?;
        let State { accelerator, opened } = &*state;
        if total <= FEW && opened.is_cpu() && !call.is_watched() {
            for (ray, occluded) in rays.each().zip(occluded) {
                *occluded = accelerator.any_hit(&ray, &options);
            }
            return Ok(Counts::default());
        }
        if opened.is_cpu() {
            let outs = occluded.chunks_mut(BLOCK);
            return in_blocks(py, &call, &rays, outs, |rays, occluded, watch| {
                accelerator.any_hits_of(rays, occluded, &QueryOptions { watch, ..options })?;
                Ok(())
            });
        }
        on_device(py, &call, &rays, occluded, |rays, occluded, watch| {
            Ok(accelerator.any_hits(rays, occluded, &QueryOptions { watch, ..options })?)
        })
    }

    /// See `splitplane.Tree.all_hits`. Starts, t, triangle, u, v, front, counts.
    fn all_hits<'py>(
        &self,
        py: Python<'py>,
        rays: PyReadonlyArray2<'py, f32>,
        limits: (LimitArgument<'py>, LimitArgument<'py>),
        options: (String, Option<u32>, Option<u64>),
        call: Call,
    ) -> PyResult<Crossings<'py>> {
        let rays = Rays::new(&rays, &limits.0, &limits.1)?;
        let (side, ignore, max_memory) = options;
        let culling = culling(&side)?;
        let state = self.read()?;
        state.opened.check_process()?;
        let accelerator = &state.accelerator;
        let (columns, counts) = call.run(py, |watcher| {
            let options = AllHitsOptions { culling, ignore, max_memory, watch: Some(watcher) };
            // No rays are shown where there are none.
            let mut columns = Columns::of::<Crossing>(&[0], &[])?;
            let mut sum = Counts::default();
            rays.in_chunks(usize::MAX, |rays, _| {
                let all = accelerator.all_hits(rays, &options)?;
                add(&mut sum, &all.report);
                columns = Columns::of(&all.starts, &all.crossings)?;
                Ok(())
            })?;
            Ok((columns, sum))
        })?;
        Ok(columns.into_arrays(py, counts))
    }

    /// See `splitplane.Tree.count_hits`.
    fn count_hits(
        &self,
        py: Python<'_>,
        rays: PyReadonlyArray2<'_, f32>,
        limits: (LimitArgument<'_>, LimitArgument<'_>),
        options: (String, Option<u32>, Option<u64>),
        mut found: PyReadwriteArray1<'_, i64>,
        call: Call,
    ) -> PyResult<Counts> {
        let rays = Rays::new(&rays, &limits.0, &limits.1)?;
        let (side, ignore, max_memory) = options;
        let culling = culling(&side)?;
        let (total, state) = (rays.len(), self.read()?);
        state.opened.check_process()?;
        let (accelerator, found) = (&state.accelerator, room(&mut found, total)?);
        call.run(py, |watcher| {
            let mut sum = Counts::default();
            let mut counts = reserved(total.min(CHUNK), 0u32)?;
            rays.in_chunks(CHUNK, |rays, first| {
                let counts = &mut counts[..rays.len()];
                let part = Part { watcher, first, total };
                let options = AllHitsOptions { culling, ignore, max_memory, watch: Some(&part) };
                add(&mut sum, &accelerator.count_hits(rays, counts, &options)?);
                for (count, found) in counts.iter().zip(&mut found[first..]) {
                    *found = i64::from(*count);
                }
                Ok(())
            })?;
            Ok(sum)
        })
    }

    /// See `splitplane.Tree.locate`.
    fn locate(
        &self,
        py: Python<'_>,
        points: PyReadonlyArray2<'_, f32>,
        max_memory: Option<u64>,
        mut winding: PyReadwriteArray1<'_, i32>,
        mut boundary: PyReadwriteArray1<'_, bool>,
        call: Call,
    ) -> PyResult<Counts> {
        let points = rows(&points, "points")?;
        let state = self.read()?;
        state.opened.check_process()?;
        let (winding, boundary) =
            (room(&mut winding, points.len())?, room(&mut boundary, points.len())?);
        let accelerator = &state.accelerator;
        call.run(py, |watcher| {
            let ask = |points: &[[f32; 3]], watch: &dyn Watch| {
                Ok(accelerator.locate(points, &LocateOptions { max_memory, watch: Some(watch) })?)
            };
            located(points, winding, boundary, watcher, ask)
        })
    }

    /// See `splitplane.Tree.closest_points`.
    #[expect(clippy::too_many_arguments, reason = "what Python hands over, argument by argument")]
    fn closest_points(
        &self,
        py: Python<'_>,
        points: PyReadonlyArray2<'_, f32>,
        options: (f32, Option<u32>, String),
        mut squared: PyReadwriteArray1<'_, f64>,
        mut closest: PyReadwriteArray2<'_, f32>,
        mut triangle: PyReadwriteArray1<'_, u32>,
        mut u: PyReadwriteArray1<'_, f32>,
        mut v: PyReadwriteArray1<'_, f32>,
        call: Call,
    ) -> PyResult<Counts> {
        let points = rows::<f32, 3>(&points, "points")?;
        let (max_distance, ignore, name) = options;
        let accuracy = accuracy(&name)?;
        let (total, state) = (points.len(), self.read()?);
        state.opened.check_process()?;
        let closest = room_for_rows::<f32, 3>(&mut closest, total)?;
        let (squared, triangle) = (room(&mut squared, total)?, room(&mut triangle, total)?);
        let (u, v) = (room(&mut u, total)?, room(&mut v, total)?);
        let accelerator = &state.accelerator;
        call.run(py, |watcher| {
            let mut sum = Counts::default();
            let mut found = reserved(total.min(CHUNK), ClosestPoint::NONE)?;
            for first in (0..total).step_by(CHUNK) {
                let here = first..total.min(first + CHUNK);
                let found = &mut found[..here.len()];
                let part = Part { watcher, first, total };
                let watch: Option<&dyn Watch> = Some(&part);
                let options = ClosestPointOptions { max_distance, accuracy, ignore, watch };
                let given = &points[here.clone()];
                let ordered = ordered(given)?;
                let asked = ordered.as_ref().map_or(given, |ordered| &ordered.points[..]);
                add(&mut sum, &accelerator.closest_points(asked, found, &options)?);
                for (number, found) in found.iter().enumerate() {
                    let own = ordered.as_ref().map_or(number, |own| own.places[number] as usize);
                    let place = first + own;
                    (squared[place], closest[place]) = (found.distance_squared, found.point);
                    (triangle[place], u[place], v[place]) = (found.triangle, found.u, found.v);
                }
            }
            Ok(sum)
        })
    }
}

/// Answers rays of the CPU block by block, on all threads or on the calling one, each block with a watch only while blocks are slow.
/// `outs` are where the answers of each block go.
pub(crate) fn in_blocks<P: Send>(
    py: Python<'_>,
    call: &Call,
    rays: &Rays<'_>,
    outs: impl ExactSizeIterator<Item = P> + Send,
    ask: impl Fn(Given<'_>, P, Option<&dyn Watch>) -> Result<(), Failure> + Sync,
) -> PyResult<Counts> {
    let block = |blocks: &Blocks<'_>, pace: &mut Pace, (number, out): (usize, P)| {
        rays.with_block(number, |rays| {
            ask(rays, out, pace.begin(blocks)?)?;
            pace.end(blocks, rays.len());
            Ok::<(), Failure>(())
        })
    };
    let count = outs.len();
    if call.is_alone(count) {
        call.run_alone(py, |watcher| {
            let (blocks, mut pace) = (Blocks::new(watcher, rays.len()), Pace::new());
            outs.enumerate().try_for_each(|out| block(&blocks, &mut pace, out))
        })?;
        return Ok(Counts::default());
    }
    call.run(py, |watcher| {
        let mut listed = Vec::new();
        let refused = |_| Failure::memory(count * size_of::<P>());
        listed.try_reserve_exact(count).map_err(refused)?;
        listed.extend(outs);
        let blocks = &Blocks::new(watcher, rays.len());
        let listed = listed.into_par_iter().enumerate();
        listed.try_for_each_init(Pace::new, |pace, out| block(blocks, pace, out))
    })?;
    Ok(Counts::default())
}

/// Answers rays by a device, many at once.
fn on_device<T: Send>(
    py: Python<'_>,
    call: &Call,
    rays: &Rays<'_>,
    answers: &mut [T],
    ask: impl Fn(&[Ray], &mut [T], Option<&dyn Watch>) -> Result<QueryReport, Failure> + Sync,
) -> PyResult<Counts> {
    let total = rays.len();
    call.run(py, |watcher| {
        let mut sum = Counts::default();
        rays.in_chunks(DEVICE_CHUNK, |rays, first| {
            let watch = Part { watcher, first, total };
            let answers = &mut answers[first..first + rays.len()];
            add(&mut sum, &ask(rays, answers, Some(&watch))?);
            Ok(())
        })?;
        Ok(sum)
    })
}

/// The backend that stays with a tree: a new one in place of that which built it, whose memory would stay with it.
pub(crate) fn kept(opened: Arc<Opened>) -> Result<Arc<Opened>, Failure> {
    match opened.is_cpu() {
        true => Ok(Arc::new(opened.anew()?)),
        false => Ok(opened),
    }
}

fn query_options<'a>(
    (test, side, ignore): &(String, String, Option<u32>),
) -> Result<QueryOptions<'a>, Failure> {
    let (accuracy, culling) = (accuracy(test)?, culling(side)?);
    Ok(QueryOptions { accuracy, culling, ignore: *ignore, ..QueryOptions::default() })
}
