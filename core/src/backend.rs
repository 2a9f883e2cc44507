//! The seam between backends: object-safe traits at batch level.

mod count;
mod locate;
mod options;
mod part;
#[cfg(target_has_atomic = "ptr")]
pub mod scene;

use crate::cancel::go_on_tracing;
use crate::config::BuildConfig;
use crate::error::{BuildError, QueryError};
use crate::mesh::Mesh;
use crate::query::all_hits::{AllHits, AllHitsOptions};
use crate::query::cast::{Cast, CastOptions, Impact};
use crate::query::closest_point::{ClosestPoint, ClosestPointOptions};
use crate::query::inside::{self, LocateOptions, Located};
use crate::query::overlap::{OverlapOptions, Overlaps, Volume};
use crate::ray::{Hit, QueryOptions, Ray, Rays};
use crate::report::{BackendInfo, BuildSummary, QueryReport};
#[cfg(target_has_atomic = "ptr")]
use crate::scene::file::SceneFile;
#[cfg(target_has_atomic = "ptr")]
use crate::scene::shape::Shapes;
#[cfg(target_has_atomic = "ptr")]
use crate::scene::{Scene, SceneBuildError};
use crate::tree::KdTree;
use crate::tree::node::KdNode;
use crate::watch::Watch;
use alloc::boxed::Box;
use core::any::Any;

use count::count_by_all_hits;
pub use locate::locate_along;
pub use options::{BuildOptions, LoadOptions, QueryLayout};
use part::in_records;
#[cfg(target_has_atomic = "ptr")]
use scene::{HostScene, SceneAccelerator, UpdateReport};

/// Builds trees and the structures that answer rays through them. Programs may implement it for their own
/// backends; start summaries and reports from their `Default`, since they may gain fields.
pub trait Backend: Send + Sync {
    /// Describes the backend, for reports.
    fn describe(&self) -> BackendInfo;

    /// Builds the tree and everything else that queries need.
    ///
    /// # Errors
    /// A configuration out of range, a limit that binds, or a watch that cancels the build.
    fn build(
        &self,
        mesh: &Mesh<'_>,
        options: &BuildOptions<'_>,
    ) -> Result<Box<dyn Accelerator>, BuildError>;

    /// As [`Backend::build`], but reuses the memory of an accelerator that is no longer needed,
    /// over any mesh and by any backend: for meshes that change every frame. After an error the
    /// accelerator is unchanged. For that, a backend may need new memory where a watch can cancel the
    /// work: the CPU backend then makes the query layout in new memory, and until the rebuild ends both layouts
    /// are held and count towards the limit.
    ///
    /// Backends that cannot reuse the memory keep this default, which replaces the accelerator. The memory of both counts towards the limit where both are held at once.
    ///
    /// # Errors
    /// As for [`Backend::build`].
    fn rebuild(
        &self,
        accelerator: &mut Box<dyn Accelerator>,
        mesh: &Mesh<'_>,
        options: &BuildOptions<'_>,
    ) -> Result<(), BuildError> {
        let held = accelerator.held_bytes();
        let built = self.build(mesh, &options.beside(held));
        *accelerator = built.map_err(|error| error.beside(held, options.max_memory))?;
        Ok(())
    }

    /// Makes an accelerator from a tree built earlier, over the same mesh.
    ///
    /// # Errors
    /// A tree that does not belong to this mesh, a limit that binds, or a watch that cancels the
    /// work.
    fn load(
        &self,
        mesh: &Mesh<'_>,
        tree: KdTree,
        options: &LoadOptions<'_>,
    ) -> Result<Box<dyn Accelerator>, BuildError>;

    /// Builds a scene of many objects: a tree for each geometry, and one over the instances.
    ///
    /// The default finds on the calling thread which instances each ray enters, and gives the rays of each geometry to its
    /// accelerator, batch by batch.
    ///
    /// # Errors
    /// A geometry that is not built, a limit that binds, or a watch that cancels the build.
    #[cfg(target_has_atomic = "ptr")]
    fn build_scene(
        &self,
        scene: &Scene,
        options: &BuildOptions<'_>,
    ) -> Result<Box<dyn SceneAccelerator>, SceneBuildError> {
        self.check_shapes(scene)?;
        let mut build = |mesh: &Mesh<'_>, options: &BuildOptions<'_>| self.build(mesh, options);
        Ok(Box::new(HostScene::build(scene, options, &mut build)?))
    }

    /// Brings a built scene up to date with its description: only what changed is made anew. The report says what was.
    /// The scene may be of another backend: geometries that are built from now on are this one's.
    ///
    /// # Errors
    /// As for [`Backend::build_scene`]; the scene is then what it was.
    #[cfg(target_has_atomic = "ptr")]
    fn update_scene(
        &self,
        built: &mut dyn SceneAccelerator,
        scene: &Scene,
        options: &BuildOptions<'_>,
    ) -> Result<UpdateReport, SceneBuildError> {
        self.check_shapes(scene)?;
        built.update_by(scene, options, &mut |mesh, options| self.build(mesh, options))
    }

    /// Whether the backend answers rays through shapes of the user's own, whose functions the CPU calls. Spheres and capsules it always answers.
    fn answers_own_shapes(&self) -> bool {
        true
    }

    /// Refuses a scene with shapes that the backend does not answer.
    ///
    /// # Errors
    /// [`SceneBuildError::OwnShapes`], of the first such geometry.
    #[cfg(target_has_atomic = "ptr")]
    fn check_shapes(&self, scene: &Scene) -> Result<(), SceneBuildError> {
        if self.answers_own_shapes() {
            return Ok(());
        }
        let mut geometries = scene.geometries();
        let own = geometries.find(|(_, own)| matches!(own.shapes(), Some(Shapes::Own(_))));
        own.map_or(Ok(()), |(name, _)| {
            Err(SceneBuildError::OwnShapes { geometry: name.0, backend: self.describe().name })
        })
    }

    /// Makes a scene of a scene file: its description, which can be edited and handed to
    /// [`Backend::update_scene`], and what answers rays through it. Trees are loaded, not built; the one over the
    /// instances is made anew.
    ///
    /// # Errors
    /// A tree that does not name all that it has to of its mesh, no memory, a limit that binds, or a watch that cancels the work.
    #[cfg(target_has_atomic = "ptr")]
    fn load_scene(
        &self,
        file: &SceneFile<'_>,
        options: &LoadOptions<'_>,
    ) -> Result<(Scene, Box<dyn SceneAccelerator>), SceneBuildError> {
        let LoadOptions { max_memory, layout, watch } = *options;
        // The trees have their own configurations.
        let empty = BuildOptions { config: BuildConfig::default(), max_memory, layout, watch };
        let mut built = self.build_scene(&Scene::new(), &empty)?;
        let scene = self.load_scene_into(&mut *built, file, options)?;
        Ok((scene, built))
    }

    /// As [`Backend::load_scene`], into a scene that is there, of this backend's own type where it has one. What it was before is replaced by the file's.
    ///
    /// # Errors
    /// As there; the scene is then what it was.
    #[cfg(target_has_atomic = "ptr")]
    fn load_scene_into(
        &self,
        built: &mut dyn SceneAccelerator,
        file: &SceneFile<'_>,
        options: &LoadOptions<'_>,
    ) -> Result<Scene, SceneBuildError> {
        let LoadOptions { max_memory, layout, watch } = *options;
        let options = BuildOptions { config: BuildConfig::default(), max_memory, layout, watch };
        let scene = file.to_scene()?;
        let mut trees = file.geometries().filter_map(|(_, geometry)| {
            let tree = geometry.tree()?.tree.to_tree();
            Some(tree)
        });
        built.update_by(&scene, &options, &mut |mesh, options| {
            // Geometries are asked for in the order of their names.
            let missing = || BuildError::WrongMesh { reason: "the file has no tree of it".into() };
            let tree = trees.next().ok_or_else(missing)?;
            self.load(mesh, tree?, &options.for_loading())
        })?;
        Ok(scene)
    }
}

/// A built tree, ready for rays. Answers do not depend on the order of rays or the thread count.
///
/// It has its own copy of all that it needs of the mesh: the caller may change or drop the arrays.
pub trait Accelerator: Send + Sync {
    /// The canonical tree: the bytes the digest names.
    fn tree(&self) -> &KdTree;

    /// What the build dropped, changed and took.
    fn summary(&self) -> &BuildSummary;

    /// Bytes of everything that a query reads: nodes, references, vertices or copies of them.
    fn query_bytes(&self) -> u64;

    /// Bytes that the accelerator holds, the tree included and whether queries read them or not: one that was built into the memory of a larger one
    /// ([`Backend::rebuild`]) may hold more than it needs.
    ///
    /// The default counts the capacity of the tree, and [`Accelerator::query_bytes`].
    fn held_bytes(&self) -> u64 {
        let KdTree { nodes, references, .. } = self.tree();
        let nodes = nodes.capacity() * size_of::<KdNode>();
        self.query_bytes() + (nodes + references.capacity() * size_of::<u32>()) as u64
    }

    /// The accelerator by its concrete type, so that a backend can recognise its own
    /// ([`Backend::rebuild`]).
    fn as_any_mut(&mut self) -> Option<&mut dyn Any> {
        None
    }

    /// The same to look at: a backend's scenes trace through its own accelerators without a detour.
    fn as_any(&self) -> Option<&dyn Any> {
        None
    }

    /// The closest hit of a single ray. Ignores the options' watch.
    fn closest_hit(&self, ray: &Ray, options: &QueryOptions<'_>) -> Option<Hit>;

    /// Whether a single ray hits anything. Ignores the options' watch.
    fn any_hit(&self, ray: &Ray, options: &QueryOptions<'_>) -> bool;

    /// The hit of least `(t, triangle)` of every ray; [`Hit::MISS`] where there is none. After an error
    /// `hits` holds the answers to some of the rays, and nothing says which: do not use it.
    ///
    /// The default answers one ray at a time, and calls the watch between slices of 65,536.
    ///
    /// # Errors
    /// `rays` and `hits` of different length, a watch that cancels the batch, or a device that
    /// fails.
    fn closest_hits(
        &self,
        rays: &[Ray],
        hits: &mut [Hit],
        options: &QueryOptions<'_>,
    ) -> Result<QueryReport, QueryError> {
        one_by_one(rays, hits, options.watch, |ray| {
            self.closest_hit(ray, options).unwrap_or(Hit::MISS)
        })
    }

    /// For every ray, whether it hits anything. After an error `occluded` holds the answers to some of the
    /// rays, and nothing says which: do not use it.
    ///
    /// The default answers one ray at a time, and calls the watch between slices of 65,536.
    ///
    /// # Errors
    /// `rays` and `occluded` of different length, a watch that cancels the batch, or a device that
    /// fails.
    fn any_hits(
        &self,
        rays: &[Ray],
        occluded: &mut [bool],
        options: &QueryOptions<'_>,
    ) -> Result<QueryReport, QueryError> {
        one_by_one(rays, occluded, options.watch, |ray| self.any_hit(ray, options))
    }

    /// [`Accelerator::closest_hits`] of rays as they lie in memory: the same hits, bit for bit.
    ///
    /// The default makes records of rows, 262,144 at a time, and asks for those.
    ///
    /// # Errors
    /// As for [`Accelerator::closest_hits`], and no memory for records.
    fn closest_hits_of(
        &self,
        rays: Rays<'_>,
        hits: &mut [Hit],
        options: &QueryOptions<'_>,
    ) -> Result<QueryReport, QueryError> {
        in_records(rays, hits, options, |rays, hits, options| {
            self.closest_hits(rays, hits, options)
        })
    }

    /// [`Accelerator::any_hits`] of rays as they lie in memory: the same answers.
    ///
    /// The default makes records of rows, 262,144 at a time, and asks for those.
    ///
    /// # Errors
    /// As for [`Accelerator::any_hits`], and no memory for records.
    fn any_hits_of(
        &self,
        rays: Rays<'_>,
        occluded: &mut [bool],
        options: &QueryOptions<'_>,
    ) -> Result<QueryReport, QueryError> {
        in_records(rays, occluded, options, |rays, occluded, options| {
            self.any_hits(rays, occluded, options)
        })
    }

    /// All crossings of every ray with surfaces between its limits, in order along it: see
    /// [`query::all_hits`](crate::query::all_hits). They are exact.
    ///
    /// # Errors
    /// More memory than the options allow or than the system has, a watch that cancels the batch,
    /// or a device that fails.
    fn all_hits(&self, rays: &[Ray], options: &AllHitsOptions<'_>) -> Result<AllHits, QueryError>;

    /// How many crossings [`Accelerator::all_hits`] has of every ray, without them. After an error `counts` holds the answers
    /// to some of the rays, and nothing says which: do not use it.
    ///
    /// The default asks for all hits, of 4,096 rays at a time. The memory that the options allow is that of such a part.
    ///
    /// # Errors
    /// `rays` and `counts` of different length, and as for [`Accelerator::all_hits`].
    fn count_hits(
        &self,
        rays: &[Ray],
        counts: &mut [u32],
        options: &AllHitsOptions<'_>,
    ) -> Result<QueryReport, QueryError> {
        count_by_all_hits(self, rays, counts, options)
    }

    /// Where points lie relative to the surface that the triangles form: see [`query::inside`](crate::query::inside).
    ///
    /// # Errors
    /// More memory than the options allow or than the system has, a watch that cancels the batch,
    /// or a device that fails.
    fn locate(
        &self,
        points: &[[f32; 3]],
        options: &LocateOptions<'_>,
    ) -> Result<Located, QueryError> {
        locate_along(self, points, inside::DIRECTION, options)
    }

    /// The point of the mesh that is closest to each point: see [`query::closest_point`](crate::query::closest_point);
    /// [`ClosestPoint::NONE`] where none is within the greatest distance. After an error `closest` holds the answers
    /// to some of the points, and nothing says which: do not use it.
    ///
    /// The default refuses: a backend that answers this question has a method of its own.
    ///
    /// # Errors
    /// `points` and `closest` of different length, no memory for a search, a watch that cancels the batch, and
    /// [`QueryError::Unsupported`] from a backend without this query.
    fn closest_points(
        &self,
        points: &[[f32; 3]],
        closest: &mut [ClosestPoint],
        options: &ClosestPointOptions<'_>,
    ) -> Result<QueryReport, QueryError> {
        let _ = (points, closest, options);
        Err(QueryError::Unsupported { query: "closest points" })
    }

    /// What each ball or capsule that moves along a ray touches first: see [`query::cast`](crate::query::cast); [`Impact::NONE`] where it
    /// touches nothing. After an error `impacts` holds the answers to some of the casts, and nothing says which: do not use it.
    ///
    /// The default refuses: a backend that answers this question has a method of its own.
    ///
    /// # Errors
    /// `casts` and `impacts` of different length, no memory for a search, a watch that cancels the batch, and
    /// [`QueryError::Unsupported`] from a backend without this query.
    fn impacts(
        &self,
        casts: &[Cast],
        impacts: &mut [Impact],
        options: &CastOptions<'_>,
    ) -> Result<QueryReport, QueryError> {
        let _ = (casts, impacts, options);
        Err(QueryError::Unsupported { query: "impacts" })
    }

    /// The triangles that each volume meets, exactly: see [`query::overlap`](crate::query::overlap). Those of another mesh as volumes give the
    /// pairs of triangles of both that meet.
    ///
    /// The default refuses: a backend that answers this question has a method of its own.
    ///
    /// # Errors
    /// More memory than the options allow or than the system has, a watch that cancels the batch, and
    /// [`QueryError::Unsupported`] from a backend without this query.
    fn overlaps(
        &self,
        volumes: &[Volume<'_>],
        options: &OverlapOptions<'_>,
    ) -> Result<Overlaps, QueryError> {
        let _ = (volumes, options);
        Err(QueryError::Unsupported { query: "overlaps" })
    }

    /// Whether each volume meets any triangle, exactly. After an error `found` holds the answers to some of the volumes, and nothing says
    /// which: do not use it.
    ///
    /// The default refuses: a backend that answers this question has a method of its own.
    ///
    /// # Errors
    /// `volumes` and `found` of different length, and those of [`Accelerator::overlaps`].
    fn overlaps_any(
        &self,
        volumes: &[Volume<'_>],
        found: &mut [bool],
        options: &OverlapOptions<'_>,
    ) -> Result<QueryReport, QueryError> {
        let _ = (volumes, found, options);
        Err(QueryError::Unsupported { query: "overlaps" })
    }
}

impl dyn Accelerator {
    /// The accelerator by its own type, where that is `T`: for [`Backend::rebuild`].
    pub fn downcast_mut<T: Accelerator + 'static>(&mut self) -> Option<&mut T> {
        self.as_any_mut()?.downcast_mut()
    }
}

/// Rays between two calls of the watch.
const SLICE: usize = 1 << 16;

/// Answers a batch one ray at a time, and calls the watch between slices.
fn one_by_one<T>(
    rays: &[Ray],
    results: &mut [T],
    watch: Option<&dyn Watch>,
    answer: impl Fn(&Ray) -> T,
) -> Result<QueryReport, QueryError> {
    let total = rays.len();
    if total != results.len() {
        return Err(QueryError::LengthMismatch { rays: total, results: results.len() });
    }
    let mut done = 0;
    for (rays, results) in rays.chunks(SLICE).zip(results.chunks_mut(SLICE)) {
        go_on_tracing(watch, done as u64, total as u64)?;
        for (ray, result) in rays.iter().zip(results) {
            *result = answer(ray);
        }
        done += rays.len();
    }
    go_on_tracing(watch, done as u64, total as u64)?;
    Ok(QueryReport::default())
}

#[cfg(test)]
mod tests;
