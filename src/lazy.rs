//! Scenes whose trees are built when the first ray needs them: model only what is looked at.

use splitplane_core::aabb::Aabb;
use splitplane_core::backend::scene::{
    Asked, BuiltScene, SceneAccelerator, SceneAllHits, SceneAllHitsOptions, SceneClosestPoint,
    SceneClosestPointOptions, SceneWriteError, UpdateReport, write_file,
};
use splitplane_core::backend::{Backend, BuildOptions};
use splitplane_core::error::QueryError;
use splitplane_core::mesh::Mesh;
use splitplane_core::query::inside::{LocateOptions, Located};
use splitplane_core::ray::Ray;
use splitplane_core::report::QueryReport;
use splitplane_core::scene::{
    GeometryId, GeometryMesh, Instance, InstanceId, ObjectSpace, Placement, Scene, SceneBuildError,
    SceneError, SceneHit, SceneOptions, SceneReport, TopRay, TopStack, TopTree, WIDEST_STACK,
    WorldBox,
};
use splitplane_core::triangle::{Prepared, prepare};
use splitplane_core::watch::Watch;
use std::collections::BTreeSet;
use std::sync::{Arc, PoisonError, RwLock, RwLockReadGuard, RwLockWriteGuard};
use thiserror::Error;

/// Why a scene that is built as it is looked at gave no answer.
#[derive(Clone, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum LazyError {
    /// A geometry that rays reach was not built: the error names it. It stays unbuilt, what was built before stays, and the next
    /// query that reaches it tries again.
    #[error("not built when rays reached it: {0}")]
    Build(#[from] SceneBuildError),
    /// The query itself.
    #[error(transparent)]
    Query(#[from] QueryError),
    /// The bytes of a file.
    #[error(transparent)]
    Write(#[from] SceneWriteError),
}

/// A scene of which a geometry's tree is built when the first ray reaches the box of an instance of it, and nothing that is built hides it.
///
/// Answers are those of [`Backend::build_scene`], bit for bit, in accuracies watertight and exact: what is not built does not lie before
/// a ray's answer. Queries may come from many threads at once; each geometry is built once, and the others wait for it. How many
/// are built can depend on which rays come first; answers cannot.
///
/// Limits of memory hold for what is built. A query's watch is called while it builds, and may cancel that. All queries
/// have an error for a geometry that is not built: [`LazyError::Build`].
///
/// ```
/// # #[cfg(feature = "cpu")] {
/// use splitplane::objects::{Instance, LazyScene, Scene, SceneOptions, translation};
/// use splitplane::{BuildOptions, CpuBackend, Mesh, Ray};
/// use std::sync::Arc;
///
/// let triangle = [[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]];
/// let mut scene = Scene::new();
/// for x in [0.0, 10.0] {
///     let geometry = scene.add_mesh(&Mesh::soup(&triangle).unwrap()).unwrap();
///     scene.add_instance(Instance::new(geometry, translation([x, 0.0, 0.0]))).unwrap();
/// }
/// let options = BuildOptions::default();
/// let lazy = LazyScene::new(Arc::new(CpuBackend::new()), &scene, &options).unwrap();
/// let ray = Ray::new([0.2, 0.2, 5.0], [0.0, 0.0, -1.0]);
/// let hit = lazy.closest_hit(&ray, &SceneOptions::default()).unwrap();
/// assert_eq!(hit.map(|hit| hit.geometry), Some(0));
/// assert_eq!((lazy.built(), lazy.waiting()), (1, 1));
/// # }
/// ```
pub struct LazyScene {
    backend: Arc<dyn Backend>,
    options: BuildOptions<'static>,
    /// The description, which shares its arrays with the user's.
    scene: Scene,
    /// A description of one empty mesh, which stands for all that is not built.
    nothing: Scene,
    state: RwLock<State>,
}

/// What is built, and what is not.
struct State {
    /// Over the description in which what is not built is empty.
    accelerator: Box<dyn SceneAccelerator>,
    /// By geometry: whether it is not built.
    waiting: Vec<bool>,
    reach: Reach,
    /// Geometries that were built, the empty ones not counted.
    builds: u64,
}

/// The instances of what is not built.
#[derive(Default)]
struct Reach {
    /// By instance.
    placements: Vec<Option<Placement>>,
    top: TopTree,
}

impl core::fmt::Debug for LazyScene {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_struct("LazyScene")
            .field("built", &self.built())
            .field("waiting", &self.waiting())
            .finish_non_exhaustive()
    }
}

impl LazyScene {
    /// A scene of which nothing is built but the tree over instances. The arrays of the description are shared, not copied; its later edits
    /// are taken over by [`LazyScene::update`]. A watch in the options is not kept.
    ///
    /// # Errors
    /// Shapes that the backend does not answer, or no memory.
    pub fn new(
        backend: Arc<dyn Backend>,
        scene: &Scene,
        options: &BuildOptions<'_>,
    ) -> Result<LazyScene, SceneBuildError> {
        let mut nothing = Scene::new();
        let empty: [[[f32; 3]; 3]; 0] = [];
        nothing.add_mesh(&Mesh::soup(&empty).map_err(|_| no_memory())?)?;
        let accelerator = backend.build_scene(&Scene::new(), &options.unwatched())?;
        let (waiting, reach, builds) = (Vec::new(), Reach::default(), 0);
        let state = RwLock::new(State { accelerator, waiting, reach, builds });
        let options = options.unwatched();
        let mut lazy = LazyScene { backend, options, scene: Scene::new(), nothing, state };
        lazy.update(scene)?;
        Ok(lazy)
    }

    /// Brings the scene up to date with a description. What is built over arrays that are still those of a geometry stays built; new ones wait
    /// for rays.
    ///
    /// # Errors
    /// As for [`LazyScene::new`]; the scene is then what it was.
    pub fn update(&mut self, scene: &Scene) -> Result<UpdateReport, SceneBuildError> {
        self.backend.check_shapes(scene)?;
        let mirror = shared(scene, scene, |_| false)?;
        let state = self.state.get_mut().unwrap_or_else(PoisonError::into_inner);
        let is_built = |name: GeometryId, mesh: &Arc<GeometryMesh>| {
            let same = self.scene.geometry(name).is_ok_and(|own| Arc::ptr_eq(own, mesh));
            same && state.waiting.get(name.0 as usize) == Some(&false)
        };
        let mut waiting = vec![false; mirror.geometry_names()];
        for (name, mesh) in mirror.geometries() {
            waiting[name.0 as usize] = !is_built(name, mesh);
        }
        let report =
            state.change(&*self.backend, (&mirror, &self.nothing), waiting, &self.options)?;
        self.scene = mirror;
        Ok(report)
    }

    /// Geometries that are built.
    pub fn built(&self) -> usize {
        self.read().waiting_of(&self.scene).filter(|waiting| !waiting).count()
    }

    /// Geometries that no ray has reached.
    pub fn waiting(&self) -> usize {
        self.read().waiting_of(&self.scene).filter(|waiting| *waiting).count()
    }

    /// How often a geometry was built so far.
    pub fn builds(&self) -> u64 {
        self.read().builds
    }

    /// Bytes that are held for queries.
    pub fn bytes(&self) -> u64 {
        self.read().accelerator.scene().bytes()
    }

    /// Looks at what is built. Geometries that wait are empty there.
    pub fn look<R>(&self, look: impl FnOnce(&BuiltScene) -> R) -> R {
        look(self.read().accelerator.scene())
    }

    /// Builds all that waits.
    ///
    /// # Errors
    /// [`LazyError::Build`].
    pub fn complete(&self, watch: Option<&dyn Watch>) -> Result<(), LazyError> {
        let all = self.scene.geometries().map(|(name, _)| name).collect();
        self.build(&all, watch)
    }

    /// Builds all that waits, and gives the bytes of a scene file: those of the scene built at once.
    ///
    /// # Errors
    /// [`LazyError::Build`] and [`LazyError::Write`].
    pub fn save(&self, watch: Option<&dyn Watch>) -> Result<Vec<u8>, LazyError> {
        self.complete(watch)?;
        Ok(write_file(self.read().accelerator.scene())?)
    }

    /// The closest hit of a ray.
    ///
    /// # Errors
    /// As for [`LazyScene::closest_hits`].
    pub fn closest_hit(
        &self,
        ray: &Ray,
        options: &SceneOptions<'_>,
    ) -> Result<Option<SceneHit>, LazyError> {
        let mut hit = [SceneHit::MISS];
        self.closest_hits(core::slice::from_ref(ray), &mut hit, options)?;
        let [hit] = hit;
        Ok(hit.some())
    }

    /// The hit of least (t, instance, triangle) of every ray: see [`SceneAccelerator::closest_hits`]. Rays that reach what is not
    /// built are traced again when it is; the report counts them as often. After an error `hits` must not be used.
    ///
    /// # Errors
    /// [`LazyError::Build`], and those of the query.
    pub fn closest_hits(
        &self,
        rays: &[Ray],
        hits: &mut [SceneHit],
        options: &SceneOptions<'_>,
    ) -> Result<SceneReport, LazyError> {
        let ask = |scene: &dyn SceneAccelerator, rays: &[Ray], hits: &mut [SceneHit]| {
            scene.closest_hits(rays, hits, options)
        };
        self.answer(rays, hits, SceneHit::MISS, options, ask, |hit| hit.t)
    }

    /// For every ray, whether it hits anything: see [`SceneAccelerator::any_hits`]. After an error `occluded` must not be used.
    ///
    /// # Errors
    /// As for [`LazyScene::closest_hits`].
    pub fn any_hits(
        &self,
        rays: &[Ray],
        occluded: &mut [bool],
        options: &SceneOptions<'_>,
    ) -> Result<SceneReport, LazyError> {
        let ask = |scene: &dyn SceneAccelerator, rays: &[Ray], occluded: &mut [bool]| {
            scene.any_hits(rays, occluded, options)
        };
        // A ray that is stopped reaches nothing more.
        let limit = |&occluded: &bool| if occluded { f32::NEG_INFINITY } else { f32::INFINITY };
        self.answer(rays, occluded, false, options, ask, limit)
    }

    /// All crossings of every ray: see [`SceneAccelerator::all_hits`]. Builds what the rays reach on their whole ways.
    ///
    /// # Errors
    /// As for [`LazyScene::closest_hits`].
    pub fn all_hits(
        &self,
        rays: &[Ray],
        options: &SceneAllHitsOptions<'_>,
    ) -> Result<SceneAllHits, LazyError> {
        let reached = {
            let state = self.read();
            let mut reached = BTreeSet::new();
            for ray in rays {
                state.reach.walk(ray, f32::INFINITY, &options.query, |geometry| {
                    reached.insert(geometry);
                    true
                });
            }
            reached
        };
        self.build(&reached, options.query.watch)?;
        Ok(self.read().accelerator.all_hits(rays, options)?)
    }

    /// How often surfaces wind around each point: see [`SceneAccelerator::locate`]. Builds everything: points have no way that could
    /// reach a part of it.
    ///
    /// # Errors
    /// As for [`LazyScene::closest_hits`].
    pub fn locate(
        &self,
        points: &[[f32; 3]],
        options: &LocateOptions<'_>,
    ) -> Result<Located, LazyError> {
        self.complete(options.watch)?;
        Ok(self.read().accelerator.locate(points, options)?)
    }

    /// The closest point of the scene to each point: see [`SceneAccelerator::closest_points`]. Builds everything.
    ///
    /// # Errors
    /// As for [`LazyScene::closest_hits`].
    pub fn closest_points(
        &self,
        points: &[[f32; 3]],
        closest: &mut [SceneClosestPoint],
        options: &SceneClosestPointOptions<'_>,
    ) -> Result<QueryReport, LazyError> {
        self.complete(options.watch)?;
        Ok(self.read().accelerator.closest_points(points, closest, options)?)
    }

    /// Asks what is built; then builds the first that each ray reaches before its answer, and asks those rays again, until none reaches
    /// anything that waits. `limit` is where a ray with such an answer ends.
    fn answer<T: Clone>(
        &self,
        rays: &[Ray],
        answers: &mut [T],
        none: T,
        options: &SceneOptions<'_>,
        ask: impl Fn(&dyn SceneAccelerator, &[Ray], &mut [T]) -> Result<SceneReport, QueryError>,
        limit: impl Fn(&T) -> f32,
    ) -> Result<SceneReport, LazyError> {
        let mut report = ask(&*self.read().accelerator, rays, answers)?;
        let mut open: Vec<usize> = (0..rays.len()).collect();
        let (mut again, mut found) = (Vec::new(), Vec::new());
        loop {
            let reached = {
                let state = self.read();
                let mut reached = BTreeSet::new();
                open.retain(|&place| {
                    let mut first = None;
                    state.reach.walk(&rays[place], limit(&answers[place]), options, |geometry| {
                        first = Some(geometry);
                        false
                    });
                    reached.extend(first);
                    first.is_some()
                });
                reached
            };
            if open.is_empty() {
                return Ok(report);
            }
            self.build(&reached, options.watch)?;
            again.clear();
            again.extend(open.iter().map(|&place| rays[place]));
            found.clear();
            found.resize(open.len(), none.clone());
            report.add(ask(&*self.read().accelerator, &again, &mut found)?)?;
            for (&place, found) in open.iter().zip(&found) {
                answers[place] = found.clone();
            }
        }
    }

    /// Builds those of these geometries that wait. Others that ask for them meanwhile wait for it.
    fn build(
        &self,
        names: &BTreeSet<GeometryId>,
        watch: Option<&dyn Watch>,
    ) -> Result<(), LazyError> {
        let mut state = self.write();
        let mut waiting = state.waiting.clone();
        let mut builds = 0;
        for name in names {
            if let Some(waits) = waiting.get_mut(name.0 as usize).filter(|waits| **waits) {
                *waits = false;
                builds += 1;
            }
        }
        if builds > 0 {
            let options = BuildOptions { watch, ..self.options };
            state.change(&*self.backend, (&self.scene, &self.nothing), waiting, &options)?;
            state.builds += builds;
        }
        Ok(())
    }

    fn read(&self) -> RwLockReadGuard<'_, State> {
        // A change is made in one step at its end: a panic before leaves what was.
        self.state.read().unwrap_or_else(PoisonError::into_inner)
    }

    fn write(&self) -> RwLockWriteGuard<'_, State> {
        self.state.write().unwrap_or_else(PoisonError::into_inner)
    }
}

impl State {
    /// Builds what does not wait any more, and drops what is to wait. After an error all is as it was.
    fn change(
        &mut self,
        backend: &dyn Backend,
        (scene, nothing): (&Scene, &Scene),
        waiting: Vec<bool>,
        options: &BuildOptions<'_>,
    ) -> Result<UpdateReport, SceneBuildError> {
        let waits = |name: GeometryId| waiting.get(name.0 as usize) == Some(&true);
        let present = shared(scene, nothing, waits)?;
        let reach = Reach::of(scene, waits)?;
        let report = backend.update_scene(&mut *self.accelerator, &present, options)?;
        (self.waiting, self.reach) = (waiting, reach);
        Ok(report)
    }

    /// Of each geometry of the description whether it waits.
    fn waiting_of<'a>(&'a self, scene: &'a Scene) -> impl Iterator<Item = bool> + 'a {
        let waits = |name: GeometryId| self.waiting.get(name.0 as usize) == Some(&true);
        scene.geometries().map(move |(name, _)| waits(name))
    }
}

impl Reach {
    /// The instances of those geometries that wait.
    fn of(scene: &Scene, waits: impl Fn(GeometryId) -> bool) -> Result<Reach, SceneBuildError> {
        let bounds: Vec<Option<Aabb>> = {
            let mut bounds = vec![None; scene.geometry_names()];
            for (name, mesh) in scene.geometries().filter(|(name, _)| waits(*name)) {
                bounds[name.0 as usize] = Some(bounds_of(mesh));
            }
            bounds
        };
        let mut placements: Vec<Option<Placement>> = vec![None; scene.instance_names()];
        let mut boxes: Vec<(u32, WorldBox)> = Vec::new();
        for (name, instance) in scene.instances() {
            let geometry = instance.geometry;
            let Some(bounds) = bounds[geometry.0 as usize] else { continue };
            // Checked when it was edited.
            let Some(space) = ObjectSpace::new(&instance.transform) else { continue };
            let has_shapes = scene.geometry(geometry).is_ok_and(|mesh| mesh.shapes().is_some());
            let placement = match has_shapes {
                true => Placement::of_shapes(instance, space, &bounds),
                false => Placement::new(instance, space, &bounds, None),
            };
            boxes.extend(placement.world_box.map(|own| (name.0, own)));
            placements[name.0 as usize] = Some(placement);
        }
        let top = TopTree::build(placements.len(), boxes.into_iter()).ok_or_else(no_memory)?;
        Ok(Reach { placements, top })
    }

    /// Shows the geometries that wait and that a ray reaches before `limit`, the nearest boxes first, as long as `show` wants more.
    fn walk(
        &self,
        ray: &Ray,
        limit: f32,
        options: &SceneOptions<'_>,
        mut show: impl FnMut(GeometryId) -> bool,
    ) {
        let Some(ready) = TopRay::new(ray) else { return };
        let mut stack: [TopStack; WIDEST_STACK] = [(0.0, 0); WIDEST_STACK];
        let mut top = self.top.begin(&mut stack);
        if limit == f32::NEG_INFINITY {
            return;
        }
        let t_max = ray.t_max.min(limit);
        while t_max >= ray.t_min
            && let Some(name) = self.top.next(&ready, t_max, &mut stack, &mut top)
        {
            let Some(Some(placement)) = self.placements.get(name as usize) else { continue };
            let answers = Asked::of(InstanceId(name), placement, options).is_some();
            if answers && !show(placement.instance.geometry) {
                return;
            }
        }
    }
}

/// The box of all that rays can meet, in the object's space.
fn bounds_of(mesh: &GeometryMesh) -> Aabb {
    if let Some(shapes) = mesh.shapes() {
        let all = (0..shapes.len() as u32).filter_map(|primitive| shapes.bounds(primitive));
        return all.fold(Aabb::EMPTY, |bounds, own| bounds.union(&own));
    }
    let mesh = mesh.mesh();
    (0..mesh.len()).fold(Aabb::EMPTY, |bounds, triangle| {
        let Prepared { corners, kept, .. } = prepare(&mesh.triangle(triangle));
        if kept { bounds.union(&Aabb::of_points(&corners)) } else { bounds }
    })
}

/// A description with the same names, which shares arrays with `scene`; geometries that `is_left_out` names are the first of `nothing`.
fn shared(
    scene: &Scene,
    nothing: &Scene,
    is_left_out: impl Fn(GeometryId) -> bool,
) -> Result<Scene, SceneError> {
    let mut own = Scene::new();
    let empty: [[[f32; 3]; 3]; 0] = [];
    let mesh = Mesh::soup(&empty).map_err(|_| SceneError::OutOfMemory { bytes: 0 })?;
    // Names are given in order; what is not there is taken out again.
    for name in (0..scene.geometry_names() as u32).map(GeometryId) {
        own.add_mesh(&mesh)?;
        if scene.geometry(name).is_ok() {
            match is_left_out(name) {
                true => own.share_geometry(name, nothing, GeometryId(0))?,
                false => own.share_geometry(name, scene, name)?,
            }
        }
    }
    let free = |name: &InstanceId| scene.instance(*name).is_err();
    let names = || (0..scene.instance_names() as u32).map(InstanceId);
    for name in names() {
        let stand_in = || Instance::in_place(GeometryId(0));
        own.add_instance(scene.instance(name).map_or_else(|_| stand_in(), |there| *there))?;
    }
    for name in names().filter(free) {
        own.remove_instance(name)?;
    }
    for name in (0..scene.geometry_names() as u32).map(GeometryId) {
        if scene.geometry(name).is_err() {
            own.remove_geometry(name)?;
        }
    }
    Ok(own)
}

fn no_memory() -> SceneBuildError {
    SceneBuildError::OutOfMemory { needed: 0, limit: 0 }
}
