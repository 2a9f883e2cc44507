//! Edits and updates of scenes by bytes of chance: what they reach, and calls with a fault, which they must find.

use std::panic::{AssertUnwindSafe, catch_unwind};

use crate::common::{is_caught, make_pool};
use splitplane_core::backend::scene::{
    BuiltScene, FinishError, PendingUpdate, SceneAccelerator, SceneUpdater, UpdateReport,
};
use splitplane_core::backend::{Accelerator, Backend, BuildOptions, LoadOptions};
use splitplane_core::error::BuildError;
use splitplane_core::mesh::Mesh;
use splitplane_core::report::BackendInfo;
use splitplane_core::scene::{
    BakeError, BakedTable, GeometryId, InstanceId, Scene, SceneBuildError, SceneError,
};
use splitplane_core::tree::KdTree;
use splitplane_cpu::CpuBackend;
use splitplane_fuzz_targets::scene_operations::{self, Library, Reached};
use splitplane_test_support::random::Random;

/// Up to 1,000 bytes of chance.
fn chance(seed: u64) -> Vec<u8> {
    let mut random = Random::new(seed);
    (0..random.below(1000)).map(|_| random.bits() as u8).collect()
}

/// Sequences of edits, many where there is time. They reach trees over instances of several levels, refits of several nodes, trees that
/// are worn, and every way of updating, with each of its outcomes.
#[test]
fn scenes_brought_up_to_date_are_those_built_from_nothing() {
    let long = std::env::var_os("SPLITPLANE_LONG").is_some();
    let sequences: u64 = if long { 1_000_000 } else { 3000 };
    let threads = std::thread::available_parallelism().map_or(1, |n| n.get() as u64);
    let all = |first: u64| {
        let mut sum = Reached::default();
        for seed in (first..sequences).step_by(threads as usize) {
            let bytes = chance(!seed);
            match catch_unwind(AssertUnwindSafe(|| scene_operations::reached(&bytes))) {
                Ok(one) => sum = sum.and(one),
                Err(panic) => {
                    eprintln!("edits of seed {seed} fail: {bytes:?}");
                    std::panic::resume_unwind(panic);
                }
            }
        }
        sum
    };
    make_pool();
    let reached = std::thread::scope(|scope| {
        let parts: Vec<_> = (0..threads).map(|first| scope.spawn(move || all(first))).collect();
        let parts = parts.into_iter().map(|part| part.join().expect("no difference"));
        parts.fold(Reached::default(), Reached::and)
    });
    println!("{sequences} sequences: {reached:?}");
    assert_eq!(reached.instances, 200);
    for (count, least) in [
        (reached.updates, 2.0),
        (reached.changed, 20.0),
        (reached.refits, 0.05),
        (reached.worn, 0.02),
        (reached.cancelled, 0.3),
        (reached.refused, 0.1),
        (reached.limited, 0.02),
        (reached.respared, 0.006),
        (reached.cleared, 0.002),
        (reached.shared, 0.02),
        (reached.baked, 0.15),
        (reached.unbaked, 0.2),
        (reached.unbuilt, 0.03),
        (reached.renewed, 0.003),
        (reached.outdated, 0.1),
        (reached.lacking, 0.05),
        (reached.dropped, 0.01),
        (reached.finished, 0.02),
    ] {
        assert!(count as f64 > least * sequences as f64, "{count} {least} {reached:?}");
    }
}

/// A fault in one of the calls.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Fault {
    /// None.
    None,
    /// Sharing arrays does nothing.
    SharesNothing,
    /// Sharing copies the arrays, and forgets the opacity mask.
    Unmasks,
    /// Baking does not know its limit.
    BakesWithoutLimit,
    /// The last group is not baked.
    ForgetsGroup,
    /// The description that was baked comes back as the baked one.
    BakesNothing,
    /// Updates do not know their limit.
    UpdatesWithoutLimit,
    /// An update that is refused or cancelled takes place.
    UpdatesInSpite,
    /// A build into a spare leaves it as it was.
    StaleSpare,
    /// Spares have no bound.
    Unbounded,
    /// Spares stay.
    ClearsNothing,
    /// The next tree is said to be built.
    BuildsNothing,
    /// A pending build does not hear its watch.
    Deaf,
    /// A pending build does not know its limit.
    BuildsWithoutLimit,
    /// Renewing does nothing.
    RenewsNothing,
    /// Renewing forgets the trees.
    RenewsAll,
    /// What is finished is not put in place.
    FinishesNothing,
    /// What is outdated is put in place all the same.
    FinishesLate,
    /// What lacks a tree is built at once.
    FinishesAtOnce,
}

/// The library's calls with a fault.
struct Faulty {
    cpu: StaleOrNot,
    fault: Fault,
}

/// A CPU that may say that it has built into the memory of a tree, and leave that as it was.
struct StaleOrNot(CpuBackend, bool);

impl Backend for StaleOrNot {
    fn describe(&self) -> BackendInfo {
        self.0.describe()
    }

    fn build(
        &self,
        mesh: &Mesh<'_>,
        options: &BuildOptions<'_>,
    ) -> Result<Box<dyn Accelerator>, BuildError> {
        self.0.build(mesh, options)
    }

    fn rebuild(
        &self,
        tree: &mut Box<dyn Accelerator>,
        mesh: &Mesh<'_>,
        options: &BuildOptions<'_>,
    ) -> Result<(), BuildError> {
        if self.1 { Ok(()) } else { self.0.rebuild(tree, mesh, options) }
    }

    fn load(
        &self,
        mesh: &Mesh<'_>,
        tree: KdTree,
        options: &LoadOptions<'_>,
    ) -> Result<Box<dyn Accelerator>, BuildError> {
        self.0.load(mesh, tree, options)
    }
}

/// The library without a fault: what the trait itself does.
struct Plain<'a>(&'a dyn Backend);

impl Library for Plain<'_> {
    fn backend(&self) -> &dyn Backend {
        self.0
    }
}

impl Faulty {
    fn new(fault: Fault) -> Faulty {
        Faulty { cpu: StaleOrNot(CpuBackend::new(), fault == Fault::StaleSpare), fault }
    }

    fn plain(&self) -> Plain<'_> {
        Plain(&self.cpu)
    }
}

type Built<'a> = &'a mut Box<dyn SceneAccelerator>;

impl Library for Faulty {
    fn backend(&self) -> &dyn Backend {
        &self.cpu
    }

    fn updater(&self, bound: u64) -> SceneUpdater {
        SceneUpdater::new(if self.fault == Fault::Unbounded { u64::MAX } else { bound })
    }

    fn clear(&self, updater: &mut SceneUpdater) {
        if self.fault != Fault::ClearsNothing {
            updater.clear();
        }
    }

    fn share(&self, scene: &mut Scene, to: GeometryId, from: GeometryId) -> Result<(), SceneError> {
        if self.fault == Fault::SharesNothing {
            return scene.geometry(to).and(scene.geometry(from)).map(drop);
        }
        self.plain().share(scene, to, from)?;
        if self.fault == Fault::Unmasks && scene.geometry(to)?.shapes().is_none() {
            scene.set_opacity(to, None)?;
        }
        Ok(())
    }

    fn bake(
        &self,
        scene: &Scene,
        groups: &[&[InstanceId]],
        limit: u64,
    ) -> Result<(Scene, BakedTable), BakeError> {
        match self.fault {
            Fault::BakesWithoutLimit => scene.bake(groups),
            Fault::ForgetsGroup => scene.bake_within(&groups[..groups.len() - 1], limit),
            Fault::BakesNothing => scene.bake_within(&[], limit),
            _ => scene.bake_within(groups, limit),
        }
    }

    fn update(
        &self,
        built: Built<'_>,
        scene: &Scene,
        options: &BuildOptions<'_>,
    ) -> Result<UpdateReport, SceneBuildError> {
        let without = BuildOptions { max_memory: None, ..*options };
        if self.fault == Fault::UpdatesWithoutLimit {
            return self.cpu.update_scene(built, scene, &without);
        }
        let updated = self.cpu.update_scene(built, scene, options);
        if self.fault == Fault::UpdatesInSpite && updated.is_err() {
            self.cpu.update_scene(built, scene, &without.unwatched()).expect("an update");
        }
        updated
    }

    fn build_next(
        &self,
        updater: Option<&mut SceneUpdater>,
        pending: &mut PendingUpdate,
        options: &BuildOptions<'_>,
    ) -> Result<bool, SceneBuildError> {
        match self.fault {
            Fault::BuildsNothing => Ok(pending.left() > 0),
            Fault::Deaf => self.plain().build_next(updater, pending, &options.unwatched()),
            Fault::BuildsWithoutLimit => {
                let without = BuildOptions { max_memory: None, ..*options };
                self.plain().build_next(updater, pending, &without)
            }
            _ => self.plain().build_next(updater, pending, options),
        }
    }

    fn renew(
        &self,
        pending: &mut PendingUpdate,
        built: &BuiltScene,
        scene: &Scene,
    ) -> Result<(), SceneBuildError> {
        match self.fault {
            Fault::RenewsNothing => Ok(()),
            Fault::RenewsAll => {
                *pending = PendingUpdate::begin(&self.cpu, built, scene)?;
                Ok(())
            }
            _ => pending.renew(built, scene),
        }
    }

    fn finish(
        &self,
        updater: Option<&mut SceneUpdater>,
        pending: &mut PendingUpdate,
        built: Built<'_>,
        scene: &Scene,
        options: &BuildOptions<'_>,
    ) -> Result<UpdateReport, FinishError> {
        let finished = match self.fault {
            Fault::FinishesNothing => {
                let count = |mesh: &std::sync::Arc<_>, name| {
                    let own = built.scene().geometry(name);
                    !own.is_some_and(|own| std::sync::Arc::ptr_eq(own.mesh(), mesh))
                };
                let mut report = UpdateReport::default();
                let new = scene.geometries().filter(|(name, mesh)| count(mesh, *name));
                report.geometries_built = new.count() as u32;
                return Ok(report);
            }
            _ => self.plain().finish(updater, pending, built, scene, options),
        };
        match (&finished, self.fault) {
            (Err(FinishError::Outdated), Fault::FinishesLate)
            | (Err(FinishError::NotBuilt { .. }), Fault::FinishesAtOnce) => {
                pending.renew(built.scene(), scene)?;
                pending.build(&self.cpu, options)?;
                pending.finish(&self.cpu, built, scene, options)
            }
            _ => finished,
        }
    }
}

/// Whether a library is found out by one of many inputs of chance.
fn is_found(library: &dyn Library, inputs: u64) -> bool {
    (0..inputs).any(|seed| {
        is_caught(|| {
            scene_operations::run_with(&chance(seed), library);
        })
    })
}

/// Each call with a fault is found out, and the same without is not.
#[test]
fn faulty_calls_are_found() {
    make_pool();
    let sound = !is_found(&Faulty::new(Fault::None), 1000);
    let faults = [
        Fault::SharesNothing,
        Fault::Unmasks,
        Fault::BakesWithoutLimit,
        Fault::ForgetsGroup,
        Fault::BakesNothing,
        Fault::UpdatesWithoutLimit,
        Fault::UpdatesInSpite,
        Fault::StaleSpare,
        Fault::Unbounded,
        Fault::ClearsNothing,
        Fault::BuildsNothing,
        Fault::Deaf,
        Fault::BuildsWithoutLimit,
        Fault::RenewsNothing,
        Fault::RenewsAll,
        Fault::FinishesNothing,
        Fault::FinishesLate,
        Fault::FinishesAtOnce,
    ];
    let missed: Vec<Fault> =
        faults.into_iter().filter(|fault| !is_found(&Faulty::new(*fault), 6000)).collect();
    assert!(sound, "calls without a fault are refused");
    assert!(missed.is_empty(), "not found: {missed:?}");
}
