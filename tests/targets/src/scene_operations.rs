//! Edits of a scene in any order, brought up to date after some of them, in every way that there is: what comes out is what a scene built from
//! nothing is, and the same as a list of what should be there.

mod bake;
mod edit;
mod library;
mod model;
mod pending;
mod reached;
mod update;

use crate::source::Source;
use bake::bake;
use edit::edit;
use model::Model;
use pending::Pending;
use splitplane_core::backend::scene::{SceneAccelerator, SceneUpdater, TopUpdate, UpdateReport};
use splitplane_core::backend::{Backend, BuildOptions};
use splitplane_core::ray::{Accuracy, Ray};
use splitplane_core::scene::{Scene, SceneHit, SceneOptions};
use splitplane_core::tree::digest::Digest;
use splitplane_cpu::CpuBackend;

pub(crate) use edit::transform;
pub use library::{Library, OnBackend};
pub use reached::Reached;

thread_local! {
    static BACKEND: CpuBackend = CpuBackend::new();
}

/// Edits of one input.
const EDITS: usize = 40;
/// Bounds of the spares of an updater: none, about one small tree, some, all.
const BOUNDS: [u64; 4] = [u64::MAX, 1 << 16, 4096, 0];

/// Bytes as edits, for the CPU backend.
pub fn run(data: &[u8]) {
    reached(data);
}

/// The same, and what was reached.
pub fn reached(data: &[u8]) -> Reached {
    crate::single_thread();
    BACKEND.with(|backend| run_on(data, backend, |scene| scene))
}

/// The same, with what is built given through `fault`.
pub fn run_on(
    data: &[u8],
    backend: &dyn Backend,
    fault: impl Fn(Box<dyn SceneAccelerator>) -> Box<dyn SceneAccelerator>,
) -> Reached {
    run_with(data, &OnBackend { backend, fault })
}

/// The same, with every call going through `library`.
pub fn run_with(data: &[u8], library: &dyn Library) -> Reached {
    let source = &mut Source::new(data);
    let scene = Scene::new();
    let built = library.backend().build_scene(&scene, &BuildOptions::default());
    let built = library.scene(built.expect("an empty scene"));
    let bound = source.pick(&BOUNDS);
    let mut run = Run {
        library,
        scene,
        model: Model::default(),
        answers: Answers::of(&*built, source),
        built,
        bound,
        updater: library.updater(bound),
        pending: None,
        reached: Reached::default(),
    };
    for _ in 0..EDITS {
        run.reached.shared += u64::from(edit(source, library, &mut run.scene, &mut run.model));
        run.model.check(&run.scene);
        match source.below(8) {
            4 => bake(source, &mut run),
            5.. => pending::step(source, &mut run),
            _ => {}
        }
        if source.once_in(4) || source.is_empty() {
            update::update(source, &mut run);
        }
        if source.is_empty() {
            break;
        }
    }
    update::update(source, &mut run);
    run.reached
}

/// A scene, what should be in it, and what brings it up to date.
struct Run<'a> {
    library: &'a dyn Library,
    scene: Scene,
    model: Model,
    built: Box<dyn SceneAccelerator>,
    /// What it answered when it was last compared.
    answers: Answers,
    /// Of the updater's spares.
    bound: u64,
    updater: SceneUpdater,
    pending: Option<Pending>,
    reached: Reached,
}

/// What a scene is and answers, to see that it stays.
struct Answers {
    digest: Digest,
    rays: Vec<Ray>,
    hits: Vec<SceneHit>,
}

impl Answers {
    fn of(scene: &dyn SceneAccelerator, source: &mut Source<'_>) -> Answers {
        let rays: Vec<Ray> = (0..12)
            .map(|_| {
                let mut point = || [(); 3].map(|()| source.step());
                Ray::segment(point(), point()).with_limits(-1.0, f32::INFINITY)
            })
            .collect();
        let hits = hits_of(scene, &rays, &query(Accuracy::Watertight));
        Answers { digest: scene.scene().digest(), rays, hits }
    }
}

fn query(accuracy: Accuracy) -> SceneOptions<'static> {
    SceneOptions { accuracy, mask: 1, ..SceneOptions::default() }
}

fn hits_of(
    scene: &dyn SceneAccelerator,
    rays: &[Ray],
    options: &SceneOptions<'_>,
) -> Vec<SceneHit> {
    let mut hits = vec![SceneHit::MISS; rays.len()];
    scene.closest_hits(rays, &mut hits, options).expect("hits");
    hits
}

/// By bits.
fn same(a: &[SceneHit], b: &[SceneHit]) -> bool {
    bytemuck::cast_slice::<_, u8>(a) == bytemuck::cast_slice::<_, u8>(b)
}

impl Run<'_> {
    /// Nothing that failed, or that is not in place yet, changes what is built.
    fn is_as_before(&self) {
        let Answers { digest, rays, hits } = &self.answers;
        assert_eq!(self.built.scene().digest(), *digest);
        assert!(same(&hits_of(&*self.built, rays, &query(Accuracy::Watertight)), hits));
    }

    /// Geometries that the next update builds.
    fn unbuilt(&self) -> usize {
        let built = |name| self.built.scene().geometry(name).map(|own| own.mesh());
        let is_same = |name, mesh| built(name).is_some_and(|own| std::sync::Arc::ptr_eq(own, mesh));
        self.scene.geometries().filter(|(name, mesh)| !is_same(*name, *mesh)).count()
    }

    /// Holds what was brought up to date to a scene that is built from nothing. `unbuilt` are the geometries that the update had to build.
    fn is_up_to_date(&mut self, source: &mut Source<'_>, report: &UpdateReport, unbuilt: usize) {
        assert_eq!(report.geometries_built as usize, unbuilt);
        assert!(self.updater.spare_bytes() <= self.bound);
        if let Some(pending) = &mut self.pending {
            pending.others += 1;
        }
        let others = core::mem::take(&mut self.model.other_instances);
        self.reached = self.reached.and(Reached {
            updates: 1,
            instances: self.scene.len(),
            changed: report.instances_changed.into(),
            refits: u64::from(report.top == TopUpdate::Refitted && report.top_nodes_changed > 1),
            worn: u64::from(report.top == TopUpdate::Rebuilt && !others),
            ..Reached::default()
        });
        let built = &*self.built;
        let fresh = self.library.backend().build_scene(&self.scene, &BuildOptions::default());
        let fresh = fresh.expect("a scene");
        assert_eq!(built.scene().digest(), fresh.scene().digest());
        self.answers = Answers::of(built, source);
        let rays = &self.answers.rays;
        for accuracy in [Accuracy::Watertight, Accuracy::Exact] {
            let query = query(accuracy);
            let (hits, expected) = (hits_of(built, rays, &query), hits_of(&*fresh, rays, &query));
            assert!(same(&hits, &expected), "{hits:?} {expected:?}");
            for (ray, hit) in rays.iter().zip(&hits) {
                let by_all: SceneHit = built.scene().answer_by_all(ray, &query);
                assert!(same(&[by_all], &[*hit]), "{ray:?} {hit:?} {by_all:?}");
                assert_eq!(built.any_hit(ray, &query), hit.is_hit(), "{ray:?}");
            }
        }
    }
}
