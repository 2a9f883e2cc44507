//! Scenes whose trees are built when the first ray needs them: model only what is looked at.

mod near;
mod reach;
mod state;

use self::reach::Reach;
use self::state::{State, description};
use splitplane_core::backend::scene::{
    BuiltScene, SceneAccelerator, SceneAllHits, SceneAllHitsOptions, SceneWriteError,
    SharedGeometry, write_file,
};
use splitplane_core::backend::{Backend, BuildOptions};
use splitplane_core::error::QueryError;
use splitplane_core::mesh::Mesh;
use splitplane_core::ray::Ray;
use splitplane_core::report::QueryReport;
use splitplane_core::scene::{
    GeometryId, GeometryMesh, Scene, SceneBuildError, SceneHit, SceneOptions, SceneReport,
};
use splitplane_core::watch::Watch;
use splitplane_float_state::Standard;
use std::collections::BTreeSet;
use std::sync::{Arc, Mutex, PoisonError};
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
/// a ray's answer. How many are built can depend on which rays come first; answers cannot.
///
/// Queries may come from many threads at once, also from tasks of a pool that the backend itself works in: nobody waits for another. Where two threads
/// reach a geometry at the same time both may build it, and one tree is kept. A query is answered by what was built when it began, or by
/// itself since.
///
/// A step that builds also looks once at what is built already, and makes the trees over instances and over shapes anew. So ask with many rays at once.
/// Limits of memory hold for what answers rays, as in a scene that is built at once. Beside that stand the places of all instances that wait and a tree over them, some 270 bytes for each, and, while a step builds, what was
/// built before, of which only trees of meshes are shared. A device gets all of the scene in each step. A query's watch is called while it builds, and may cancel that. All queries
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
    /// Never held while anything is built or asked.
    current: Mutex<Arc<State>>,
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
        let options = options.unwatched();
        let accelerator = backend.build_scene(&Scene::new(), &options)?;
        let (trees, waiting, reach, builds) = (Vec::new(), Vec::new(), Reach::default(), 0);
        let current = Mutex::new(Arc::new(State { accelerator, trees, waiting, reach, builds }));
        let mut lazy = LazyScene { backend, options, scene: Scene::new(), nothing, current };
        lazy.update(scene)?;
        Ok(lazy)
    }

    /// Brings the scene up to date with a description. What is built over arrays that are still those of a geometry stays built; new ones wait
    /// for rays.
    ///
    /// # Errors
    /// As for [`LazyScene::new`]; the scene is then what it was.
    pub fn update(&mut self, scene: &Scene) -> Result<(), SceneBuildError> {
        let _state = Standard::set();
        self.backend.check_shapes(scene)?;
        let mirror = description(scene, scene, |_| false)?;
        let state = self.state();
        let is_built = |name: GeometryId, mesh: &Arc<GeometryMesh>| {
            let same = self.scene.geometry(name).is_ok_and(|own| Arc::ptr_eq(own, mesh));
            same && state.waiting.get(name.0 as usize) == Some(&false)
        };
        let mut waiting = vec![false; mirror.geometry_names()];
        for (name, mesh) in mirror.geometries() {
            waiting[name.0 as usize] = !is_built(name, mesh);
        }
        let mut trees = state.trees.clone();
        trees.resize(waiting.len(), None);
        for (tree, _) in trees.iter_mut().zip(&waiting).filter(|(_, waits)| **waits) {
            *tree = None;
        }
        let described = (&mirror, &self.nothing);
        let next =
            State::new(&*self.backend, described, (waiting, trees), state.builds, &self.options)?;
        self.scene = mirror;
        *self.current.get_mut().unwrap_or_else(PoisonError::into_inner) = Arc::new(next);
        Ok(())
    }

    /// Geometries that are built.
    pub fn built(&self) -> usize {
        self.state().waiting_of(&self.scene).filter(|waiting| !waiting).count()
    }

    /// Geometries that no ray has reached.
    pub fn waiting(&self) -> usize {
        self.state().waiting_of(&self.scene).filter(|waiting| *waiting).count()
    }

    /// How often a geometry was built so far.
    pub fn builds(&self) -> u64 {
        self.state().builds
    }

    /// Bytes of what is built and answers rays, without the places of instances that wait.
    pub fn bytes(&self) -> u64 {
        self.state().accelerator.scene().bytes()
    }

    /// Looks at what is built. Geometries that wait are empty there.
    pub fn look<R>(&self, look: impl FnOnce(&BuiltScene) -> R) -> R {
        look(self.state().accelerator.scene())
    }

    /// Builds all that waits.
    ///
    /// # Errors
    /// [`LazyError::Build`].
    pub fn complete(&self, watch: Option<&dyn Watch>) -> Result<(), LazyError> {
        let all = self.scene.geometries().map(|(name, _)| name).collect();
        self.build(&all, watch).map(drop)
    }

    /// Builds all that waits, and gives the bytes of a scene file: those of the scene built at once.
    ///
    /// # Errors
    /// [`LazyError::Build`] and [`LazyError::Write`].
    pub fn save(&self, watch: Option<&dyn Watch>) -> Result<Vec<u8>, LazyError> {
        self.complete(watch)?;
        Ok(write_file(self.state().accelerator.scene())?)
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
        let _state = Standard::set();
        let reached = self.reached(rays, options);
        Ok(self.build(&reached, options.query.watch)?.accelerator.all_hits(rays, options)?)
    }

    /// How many crossings every ray has: see [`SceneAccelerator::count_hits`]. Builds what the rays reach on their whole ways.
    ///
    /// # Errors
    /// As for [`LazyScene::closest_hits`].
    pub fn count_hits(
        &self,
        rays: &[Ray],
        counts: &mut [u64],
        options: &SceneAllHitsOptions<'_>,
    ) -> Result<QueryReport, LazyError> {
        let _state = Standard::set();
        let state = self.build(&self.reached(rays, options), options.query.watch)?;
        Ok(state.accelerator.count_hits(rays, counts, options)?)
    }

    /// All geometries that rays reach on their whole ways.
    fn reached(&self, rays: &[Ray], options: &SceneAllHitsOptions<'_>) -> BTreeSet<GeometryId> {
        let state = self.state();
        let mut reached = BTreeSet::new();
        for ray in rays {
            state.reach.walk(ray, f32::INFINITY, &options.query, |geometry| {
                reached.insert(geometry);
                true
            });
        }
        reached
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
        let _state = Standard::set();
        let mut state = self.state();
        let mut report = ask(&*state.accelerator, rays, answers)?;
        let mut open: Vec<usize> = (0..rays.len()).collect();
        let (mut again, mut found) = (Vec::new(), Vec::new());
        loop {
            // By the state that gave the answers: another thread may have built since.
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
            if open.is_empty() {
                return Ok(report);
            }
            state = self.build(&reached, options.watch)?;
            again.clear();
            again.extend(open.iter().map(|&place| rays[place]));
            found.clear();
            found.resize(open.len(), none.clone());
            report.add(ask(&*state.accelerator, &again, &mut found)?)?;
            for (&place, found) in open.iter().zip(&found) {
                answers[place] = found.clone();
            }
        }
    }

    /// Builds those of these geometries that wait, and gives a state in which none of them does.
    fn build(
        &self,
        names: &BTreeSet<GeometryId>,
        watch: Option<&dyn Watch>,
    ) -> Result<Arc<State>, LazyError> {
        let _state = Standard::set();
        let options = BuildOptions { watch, ..self.options };
        // What this call has built, should others be faster.
        let mut built: Vec<(GeometryId, SharedGeometry)> = Vec::new();
        loop {
            let base = self.state();
            let (mut waiting, mut trees) = (base.waiting.clone(), base.trees.clone());
            let mut builds = base.builds;
            for name in names {
                let at = name.0 as usize;
                if let Some(waits) = waiting.get_mut(at).filter(|waits| **waits) {
                    *waits = false;
                    builds += 1;
                    let own = built.iter().find(|(own, _)| own == name);
                    trees[at] = own.map(|(_, tree)| tree.clone());
                }
            }
            if builds == base.builds {
                return Ok(base);
            }
            let described = (&self.scene, &self.nothing);
            let next = State::new(&*self.backend, described, (waiting, trees), builds, &options)?;
            built.clear();
            built.extend(names.iter().filter_map(|name| {
                let tree = next.trees.get(name.0 as usize)?.as_ref()?;
                Some((*name, tree.clone()))
            }));
            let mut current = self.current.lock().unwrap_or_else(PoisonError::into_inner);
            if Arc::ptr_eq(&current, &base) {
                *current = Arc::new(next);
                return Ok(Arc::clone(&current));
            }
        }
    }

    /// What is built now.
    fn state(&self) -> Arc<State> {
        Arc::clone(&self.current.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

fn no_memory() -> SceneBuildError {
    SceneBuildError::OutOfMemory { needed: 0, limit: 0 }
}
