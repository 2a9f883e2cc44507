//! A scene of many objects: its description, and what is built of it.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, RwLock, RwLockReadGuard, RwLockWriteGuard};

use numpy::{
    IntoPyArray, PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2,
    PyReadwriteArray1, PyReadwriteArray2,
};
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use splitplane::objects::file::SceneFile;
use splitplane::objects::{
    Filter, GeometryId, IgnoredTriangle, Instance, InstanceId, LazyScene, Scene as Description,
    SceneAllHitsOptions, SceneClosestPoint, SceneClosestPointOptions, SceneCrossing, SceneHit,
    SceneOptions, SceneReport, TopUpdate,
};
use splitplane::{Backend, BuildOptions, LocateOptions, Mesh, Watch};

use crate::answers::{Columns, Crossings, located};
use crate::arrays::{flat, reserved, room, room_for_rows, rows};
use crate::built::Built;
use crate::call::{Call, Part};
use crate::edits::Edits;
use crate::failure::Failure;
use crate::ignored::IgnoredList;
use crate::open::{Opened, open};
use crate::options::{Counts, accuracy, add, culling};
use crate::order::ordered;
use crate::rays::{CHUNK, LimitArgument, Rays};
use crate::tree::{BuildArguments, build_options, busy};

pub(crate) struct State {
    description: Description,
    pub(crate) built: Built,
    opened: Arc<Opened>,
    edits: Edits,
}

/// See `splitplane.Scene`.
#[pyclass(frozen, module = "splitplane._native")]
pub(crate) struct Scene {
    state: RwLock<State>,
    /// Updates that have succeeded.
    updates: AtomicU64,
}

/// What rays pass: one (instance, triangle), or rows of them.
#[derive(FromPyObject)]
enum Ignore<'py> {
    One((u32, u32)),
    Many(PyReadonlyArray2<'py, u32>),
}

/// Accuracy, culling, mask, what is ignored.
type Options<'py> = (String, String, u32, Option<Ignore<'py>>);

/// Vertices and faces.
type Arrays<'py> = (Bound<'py, PyArray2<f32>>, Bound<'py, PyArray2<u32>>);

impl Scene {
    fn of(description: Description, built: Built, opened: Arc<Opened>) -> Scene {
        let state = State { description, built, opened, edits: Edits::Taken };
        Scene { state: RwLock::new(state), updates: AtomicU64::new(0) }
    }

    fn read(&self) -> Result<RwLockReadGuard<'_, State>, Failure> {
        self.state.try_read().map_err(|_| busy())
    }

    fn write(&self) -> Result<RwLockWriteGuard<'_, State>, Failure> {
        self.state.try_write().map_err(|_| busy())
    }

    /// Edits the description. An edit that fails changes nothing.
    pub(crate) fn edit<T>(
        &self,
        work: impl FnOnce(&mut Description) -> Result<T, Failure>,
    ) -> Result<T, Failure> {
        let mut state = self.write()?;
        let done = work(&mut state.description)?;
        state.edits = Edits::Waiting;
        Ok(done)
    }

    /// Looks at the description.
    pub(crate) fn look<T>(
        &self,
        work: impl FnOnce(&Description) -> Result<T, Failure>,
    ) -> Result<T, Failure> {
        work(&self.read()?.description)
    }

    /// What is built. Edits after it have to have been tried: where their update failed, it answers without them.
    pub(crate) fn current(&self) -> Result<RwLockReadGuard<'_, State>, Failure> {
        let state = self.read()?;
        state.opened.check_process()?;
        match state.edits {
            Edits::Waiting => Err(Failure::new(
                "StaleError",
                "the scene was edited since it was built; call update()",
            )),
            Edits::Taken | Edits::Refused => Ok(state),
        }
    }
}

pub(crate) fn ignored(ignore: Option<(u32, u32)>) -> Option<IgnoredTriangle> {
    ignore.map(|(instance, triangle)| IgnoredTriangle { instance: InstanceId(instance), triangle })
}

/// Settings of rays, and the list that they refer to.
struct Asked {
    options: SceneOptions<'static>,
    list: Option<IgnoredList>,
}

impl Asked {
    fn new((test, side, mask, ignore): &Options<'_>) -> Result<Asked, Failure> {
        let (accuracy, culling, mask) = (accuracy(test)?, culling(side)?, *mask);
        let (one, list) = match ignore {
            None => (None, None),
            Some(Ignore::One(one)) => (ignored(Some(*one)), None),
            Some(Ignore::Many(rows)) => (None, Some(IgnoredList::new(rows)?)),
        };
        let options =
            SceneOptions { accuracy, culling, mask, ignore: one, ..SceneOptions::default() };
        Ok(Asked { options, list })
    }

    fn options(&self) -> SceneOptions<'_> {
        let filter = self.list.as_ref().map(|list| -> &dyn Filter { list });
        SceneOptions { filter, ..self.options }
    }
}

fn transform(array: &PyReadonlyArray2<'_, f32>) -> Result<[[f32; 4]; 3], Failure> {
    let rows = rows::<f32, 4>(array, "a transform")?;
    rows.try_into().map_err(|_| {
        Failure::new("ShapeError", format!("a transform has {} rows, but must have 3", rows.len()))
    })
}

fn add_scene(sum: &mut Counts, report: &SceneReport) {
    add(sum, &report.geometries);
    sum.3 += report.placed_by_cpu;
}

/// A scene whose geometries are built as rays reach them.
fn lazily(
    opened: &Opened,
    description: &Description,
    options: &BuildOptions<'_>,
) -> Result<LazyScene, Failure> {
    let backend: Arc<dyn Backend> = opened.engine.clone();
    Ok(LazyScene::new(backend, description, options)?)
}

/// Makes of what is built what is described. After an error it is what it was.
fn bring_up_to_date(
    opened: &Opened,
    description: &Description,
    built: &mut Built,
    options: &BuildOptions<'_>,
) -> Result<BTreeMap<&'static str, u64>, Failure> {
    match built {
        Built::Whole(scene) => {
            let done = opened.backend().update_scene(&mut **scene, description, options)?;
            Ok(BTreeMap::from([
                ("geometries_built", u64::from(done.geometries_built)),
                ("geometries_dropped", u64::from(done.geometries_dropped)),
                ("instances_changed", u64::from(done.instances_changed)),
                ("top_nodes_changed", done.top_nodes_changed),
                ("top_rebuilt", u64::from(done.top == TopUpdate::Rebuilt)),
            ]))
        }
        Built::Lazy(scene, limit) => {
            match *limit == options.max_memory {
                true => scene.update(description)?,
                // The limit is one of the whole scene, so it begins anew.
                false => **scene = lazily(opened, description, options)?,
            }
            *limit = options.max_memory;
            let (kept, waiting) = (scene.built() as u64, scene.waiting() as u64);
            Ok(BTreeMap::from([("geometries_kept", kept), ("geometries_waiting", waiting)]))
        }
    }
}

#[pymethods]
impl Scene {
    /// A scene without anything.
    #[new]
    fn new(
        py: Python<'_>,
        arguments: BuildArguments,
        backend: (String, Option<String>),
        lazy: bool,
    ) -> PyResult<Scene> {
        let options = build_options(&arguments)?;
        let opened = open(py, &backend.0, backend.1.as_deref(), options.config.preset())?;
        let description = Description::new();
        let built = match lazy {
            true => {
                let scene = lazily(&opened, &description, &options)?;
                Built::Lazy(Box::new(scene), options.max_memory)
            }
            false => {
                let built = opened.backend().build_scene(&description, &options);
                Built::Whole(built.map_err(Failure::from)?)
            }
        };
        Ok(Scene::of(description, built, opened))
    }

    /// A scene of the bytes of a scene file.
    #[staticmethod]
    fn load(
        py: Python<'_>,
        bytes: PyReadonlyArray1<'_, u8>,
        arguments: BuildArguments,
        backend: (String, Option<String>),
        call: Call,
    ) -> PyResult<Scene> {
        let options = build_options(&arguments)?;
        let bytes = flat(&bytes, "the file")?;
        let opened = open(py, &backend.0, backend.1.as_deref(), options.config.preset())?;
        let (description, built) = call.run(py, |watcher| {
            let mut limits = options.for_loading();
            limits.watch = Some(watcher);
            Ok(opened.backend().load_scene(&SceneFile::parse(bytes)?, &limits)?)
        })?;
        let built = Built::Whole(built);
        Ok(Scene::of(description, built, opened))
    }

    /// The bytes of a scene file.
    fn to_bytes<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        let state = self.current()?;
        let bytes = Call::PLAIN.run(py, |watcher| state.built.to_bytes(watcher))?;
        Ok(PyBytes::new(py, &bytes))
    }

    /// Adds a mesh; its name.
    fn add_geometry(
        &self,
        vertices: PyReadonlyArray2<'_, f32>,
        faces: PyReadonlyArray2<'_, u32>,
    ) -> PyResult<u32> {
        let (vertices, faces) = (rows(&vertices, "vertices")?, rows(&faces, "faces")?);
        let mesh = Mesh::indexed(vertices, faces).map_err(Failure::from)?;
        let mut state = self.write()?;
        let geometry = state.description.add_mesh(&mesh).map_err(Failure::from)?;
        state.edits = Edits::Waiting;
        Ok(geometry.0)
    }

    /// Gives a geometry another mesh.
    fn replace_geometry(
        &self,
        geometry: u32,
        vertices: PyReadonlyArray2<'_, f32>,
        faces: PyReadonlyArray2<'_, u32>,
    ) -> PyResult<()> {
        let (vertices, faces) = (rows(&vertices, "vertices")?, rows(&faces, "faces")?);
        let mesh = Mesh::indexed(vertices, faces).map_err(Failure::from)?;
        let mut state = self.write()?;
        state.description.replace_mesh(GeometryId(geometry), &mesh).map_err(Failure::from)?;
        state.edits = Edits::Waiting;
        Ok(())
    }

    fn remove_geometry(&self, geometry: u32) -> PyResult<()> {
        let mut state = self.write()?;
        state.description.remove_geometry(GeometryId(geometry)).map_err(Failure::from)?;
        state.edits = Edits::Waiting;
        Ok(())
    }

    /// Adds an instance; its name.
    fn add_instance(
        &self,
        geometry: u32,
        matrix: PyReadonlyArray2<'_, f32>,
        mask: u32,
        id: u32,
        side: &str,
    ) -> PyResult<u32> {
        let (transform, culling) = (transform(&matrix)?, culling(side)?);
        let geometry = GeometryId(geometry);
        let mut state = self.write()?;
        let instance = Instance { geometry, transform, mask, id, culling };
        let name = state.description.add_instance(instance).map_err(Failure::from)?;
        state.edits = Edits::Waiting;
        Ok(name.0)
    }

    /// Changes what is given of an instance.
    fn set_instance(
        &self,
        instance: u32,
        geometry: Option<u32>,
        matrix: Option<PyReadonlyArray2<'_, f32>>,
        mask: Option<u32>,
        id: Option<u32>,
        side: Option<&str>,
    ) -> PyResult<()> {
        let mut state = self.write()?;
        let mut becomes =
            *state.description.instance(InstanceId(instance)).map_err(Failure::from)?;
        becomes.geometry = geometry.map_or(becomes.geometry, GeometryId);
        if let Some(matrix) = &matrix {
            becomes.transform = transform(matrix)?;
        }
        becomes.mask = mask.unwrap_or(becomes.mask);
        becomes.id = id.unwrap_or(becomes.id);
        if let Some(side) = side {
            becomes.culling = culling(side)?;
        }
        state.description.set_instance(InstanceId(instance), becomes).map_err(Failure::from)?;
        state.edits = Edits::Waiting;
        Ok(())
    }

    fn remove_instance(&self, instance: u32) -> PyResult<()> {
        let mut state = self.write()?;
        state.description.remove_instance(InstanceId(instance)).map_err(Failure::from)?;
        state.edits = Edits::Waiting;
        Ok(())
    }

    /// An instance: geometry, transform, mask, id.
    fn instance(&self, instance: u32) -> PyResult<(u32, [[f32; 4]; 3], u32, u32)> {
        let state = self.read()?;
        let own = state.description.instance(InstanceId(instance)).map_err(Failure::from)?;
        Ok((own.geometry.0, own.transform, own.mask, own.id))
    }

    /// The names of all instances.
    fn instances(&self) -> PyResult<Vec<u32>> {
        Ok(self.read()?.description.instances().map(|(name, _)| name.0).collect())
    }

    /// The names of all geometries.
    fn geometries(&self) -> PyResult<Vec<u32>> {
        Ok(self.read()?.description.geometries().map(|(name, _)| name.0).collect())
    }

    /// The arrays of a geometry.
    fn mesh<'py>(&self, py: Python<'py>, geometry: u32) -> PyResult<Arrays<'py>> {
        let state = self.read()?;
        let mesh = state.description.geometry(GeometryId(geometry)).map_err(Failure::from)?;
        let (positions, indices) = mesh.mesh().arrays();
        let faces: Vec<u32> = match indices {
            Some(indices) => indices.as_flattened().to_vec(),
            None => (0..positions.len() as u32).collect(),
        };
        let vertices = PyArray1::from_slice(py, positions.as_flattened());
        Ok((
            vertices.reshape([positions.len(), 3])?,
            faces.into_pyarray(py).reshape([mesh.mesh().len(), 3])?,
        ))
    }

    /// Whether the scene was edited since the last update that succeeded.
    fn edited(&self) -> PyResult<bool> {
        Ok(self.read()?.edits != Edits::Taken)
    }

    /// How many updates have succeeded.
    fn updates(&self) -> u64 {
        self.updates.load(Ordering::Acquire)
    }

    /// Brings what is built up to date. What was done, by name.
    fn update(
        &self,
        py: Python<'_>,
        arguments: BuildArguments,
        call: Call,
    ) -> PyResult<BTreeMap<&'static str, u64>> {
        let options = build_options(&arguments)?;
        let mut state = self.write()?;
        let State { description, built, opened, edits } = &mut *state;
        opened.check_process()?;
        let mut has_succeeded = false;
        let done = call.run(py, |watcher| {
            let options = BuildOptions { watch: Some(watcher), ..options };
            let done = bring_up_to_date(opened, description, built, &options);
            has_succeeded = done.is_ok();
            done.map_err(Failure::of_update)
        });
        // A callback's exception that comes when the work is done is raised, but undoes nothing.
        *edits = edits.after_update(has_succeeded);
        if has_succeeded {
            self.updates.fetch_add(1, Ordering::Release);
        }
        done
    }

    fn digest(&self, py: Python<'_>) -> PyResult<String> {
        let state = self.current()?;
        Call::PLAIN.run(py, |watcher| state.built.digest(watcher))
    }

    /// Geometries that are not built before rays reach them.
    fn waiting(&self) -> PyResult<usize> {
        Ok(self.read()?.built.waiting())
    }

    /// Bytes that are held for queries.
    fn query_bytes(&self) -> PyResult<u64> {
        Ok(self.read()?.built.bytes())
    }

    /// Builds all that waits.
    fn complete(&self, py: Python<'_>, call: Call) -> PyResult<()> {
        let state = self.current()?;
        call.run(py, |watcher| state.built.complete(watcher))
    }

    /// The backend, and why it is this one.
    fn backend(&self) -> PyResult<(String, String)> {
        let state = self.read()?;
        Ok((state.opened.name.clone(), state.opened.reason.clone()))
    }

    /// See `splitplane.Scene.closest_hits`. Six numbers of 32 bits a ray: the library's own records, so that nothing is copied.
    fn closest_hits(
        &self,
        py: Python<'_>,
        rays: PyReadonlyArray2<'_, f32>,
        limits: (LimitArgument<'_>, LimitArgument<'_>),
        options: Options<'_>,
        mut records: PyReadwriteArray2<'_, f32>,
        call: Call,
    ) -> PyResult<Counts> {
        let rays = Rays::new(&rays, &limits.0, &limits.1)?;
        let asked = Asked::new(&options)?;
        let options = asked.options();
        let (total, state) = (rays.len(), self.current()?);
        let hits: &mut [SceneHit] =
            bytemuck::cast_slice_mut(room_for_rows::<f32, 6>(&mut records, total)?);
        let built = &state.built;
        call.run(py, |watcher| {
            let mut sum = Counts::default();
            rays.in_chunks(CHUNK, |rays, first| {
                let watch = Part { watcher, first, total };
                let options = SceneOptions { watch: Some(&watch), ..options };
                let hits = &mut hits[first..first + rays.len()];
                add_scene(&mut sum, &built.closest_hits(rays, hits, &options)?);
                Ok(())
            })?;
            Ok(sum)
        })
    }

    /// See `splitplane.Scene.any_hits`.
    fn any_hits(
        &self,
        py: Python<'_>,
        rays: PyReadonlyArray2<'_, f32>,
        limits: (LimitArgument<'_>, LimitArgument<'_>),
        options: Options<'_>,
        mut occluded: PyReadwriteArray1<'_, bool>,
        call: Call,
    ) -> PyResult<Counts> {
        let rays = Rays::new(&rays, &limits.0, &limits.1)?;
        let asked = Asked::new(&options)?;
        let options = asked.options();
        let (total, state) = (rays.len(), self.current()?);
        let (occluded, built) = (room(&mut occluded, total)?, &state.built);
        call.run(py, |watcher| {
            let mut sum = Counts::default();
            rays.in_chunks(CHUNK, |rays, first| {
                let watch = Part { watcher, first, total };
                let options = SceneOptions { watch: Some(&watch), ..options };
                let occluded = &mut occluded[first..first + rays.len()];
                add_scene(&mut sum, &built.any_hits(rays, occluded, &options)?);
                Ok(())
            })?;
            Ok(sum)
        })
    }

    /// See `splitplane.Scene.all_hits`.
    fn all_hits<'py>(
        &self,
        py: Python<'py>,
        rays: PyReadonlyArray2<'py, f32>,
        limits: (LimitArgument<'py>, LimitArgument<'py>),
        options: Options<'_>,
        max_memory: Option<u64>,
        call: Call,
    ) -> PyResult<Crossings<'py>> {
        let rays = Rays::new(&rays, &limits.0, &limits.1)?;
        let asked = Asked::new(&options)?;
        let options = asked.options();
        let state = self.current()?;
        let built = &state.built;
        let (columns, counts) = call.run(py, |watcher| {
            let query = SceneOptions { watch: Some(watcher), ..options };
            // No rays are shown where there are none.
            let (mut columns, mut sum) =
                (Columns::of::<SceneCrossing>(&[0], &[])?, Counts::default());
            rays.in_chunks(usize::MAX, |rays, _| {
                let all = built.all_hits(rays, &SceneAllHitsOptions { query, max_memory })?;
                add(&mut sum, &all.report);
                columns = Columns::of(&all.starts, &all.crossings)?;
                Ok(())
            })?;
            Ok((columns, sum))
        })?;
        Ok(columns.into_arrays(py, counts))
    }

    /// See `splitplane.Scene.count_hits`.
    #[expect(clippy::too_many_arguments, reason = "what Python hands over, argument by argument")]
    fn count_hits(
        &self,
        py: Python<'_>,
        rays: PyReadonlyArray2<'_, f32>,
        limits: (LimitArgument<'_>, LimitArgument<'_>),
        options: Options<'_>,
        max_memory: Option<u64>,
        mut found: PyReadwriteArray1<'_, i64>,
        call: Call,
    ) -> PyResult<Counts> {
        let rays = Rays::new(&rays, &limits.0, &limits.1)?;
        let asked = Asked::new(&options)?;
        let options = asked.options();
        let (total, state) = (rays.len(), self.current()?);
        let (built, found) = (&state.built, room(&mut found, total)?);
        call.run(py, |watcher| {
            let mut sum = Counts::default();
            // No count is beyond what an i64 holds: each was of crossings in memory.
            let counts: &mut [u64] = bytemuck::cast_slice_mut(found);
            rays.in_chunks(CHUNK, |rays, first| {
                let part = Part { watcher, first, total };
                let query = SceneOptions { watch: Some(&part), ..options };
                let options = SceneAllHitsOptions { query, max_memory };
                let counts = &mut counts[first..first + rays.len()];
                add(&mut sum, &built.count_hits(rays, counts, &options)?);
                Ok(())
            })?;
            Ok(sum)
        })
    }

    /// See `splitplane.Scene.locate`.
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
        let state = self.current()?;
        let (winding, boundary) =
            (room(&mut winding, points.len())?, room(&mut boundary, points.len())?);
        let built = &state.built;
        call.run(py, |watcher| {
            let ask = |points: &[[f32; 3]], watch: &dyn Watch| {
                built.locate(points, &LocateOptions { max_memory, watch: Some(watch) })
            };
            located(points, winding, boundary, watcher, ask)
        })
    }

    /// See `splitplane.Scene.closest_points`.
    #[expect(clippy::too_many_arguments, reason = "what Python hands over, argument by argument")]
    fn closest_points(
        &self,
        py: Python<'_>,
        points: PyReadonlyArray2<'_, f32>,
        options: (f32, u32, Option<(u32, u32)>, String),
        mut squared: PyReadwriteArray1<'_, f64>,
        mut closest: PyReadwriteArray2<'_, f32>,
        names: (PyReadwriteArray1<'_, u32>, PyReadwriteArray1<'_, u32>, PyReadwriteArray1<'_, u32>),
        weights: (PyReadwriteArray1<'_, f32>, PyReadwriteArray1<'_, f32>),
        call: Call,
    ) -> PyResult<Counts> {
        let ((mut u, mut v), (mut triangle, mut geometry, mut instance)) = (weights, names);
        let points = rows::<f32, 3>(&points, "points")?;
        let (max_distance, mask, ignore, name) = options;
        let accuracy = accuracy(&name)?;
        let (total, state, ignore) = (points.len(), self.current()?, ignored(ignore));
        let (squared, closest) =
            (room(&mut squared, total)?, room_for_rows::<f32, 3>(&mut closest, total)?);
        let (triangle, geometry) = (room(&mut triangle, total)?, room(&mut geometry, total)?);
        let (instance, u, v) =
            (room(&mut instance, total)?, room(&mut u, total)?, room(&mut v, total)?);
        let built = &state.built;
        call.run(py, |watcher| {
            let mut sum = Counts::default();
            let mut found = reserved(total.min(CHUNK), SceneClosestPoint::NONE)?;
            for first in (0..total).step_by(CHUNK) {
                let here = first..total.min(first + CHUNK);
                let found = &mut found[..here.len()];
                let part = Part { watcher, first, total };
                let watch: Option<&dyn Watch> = Some(&part);
                let options =
                    SceneClosestPointOptions { max_distance, accuracy, mask, ignore, watch };
                let given = &points[here.clone()];
                let ordered = ordered(given)?;
                let asked = ordered.as_ref().map_or(given, |ordered| &ordered.points[..]);
                add(&mut sum, &built.closest_points(asked, found, &options)?);
                for (number, found) in found.iter().enumerate() {
                    let own = ordered.as_ref().map_or(number, |own| own.places[number] as usize);
                    let place = first + own;
                    (squared[place], closest[place]) = (found.distance_squared, found.point);
                    (triangle[place], u[place], v[place]) = (found.triangle, found.u, found.v);
                    (geometry[place], instance[place]) = (found.geometry, found.instance);
                }
            }
            Ok(sum)
        })
    }
}
