//! Updates whose trees are built while the scene goes on answering.

use core::ops::ControlFlow;
use std::sync::Arc;

use super::Run;
use super::edit::deform;
use super::update::{is_of_limit, limit};
use crate::source::Source;
use splitplane_core::backend::BuildOptions;
use splitplane_core::backend::scene::{BuiltScene, FinishError, PendingUpdate};
use splitplane_core::scene::{GeometryId, GeometryMesh, Scene, SceneBuildError};
use splitplane_core::tree::digest::Digest;
use splitplane_core::watch::Progress;

/// A pending update, and what it should have.
pub(super) struct Pending {
    update: PendingUpdate,
    /// The meshes that need a tree, each once, with the first geometry that has it, and whether it has one.
    needed: Vec<(GeometryId, Arc<GeometryMesh>, bool)>,
    /// The scene when it began or was renewed.
    digest: Digest,
    /// Updates of the scene since.
    pub(super) others: u64,
}

/// The meshes of a description that are not built, in the order of their geometries' names.
fn unbuilt<'a>(
    built: &'a BuiltScene,
    scene: &'a Scene,
) -> impl Iterator<Item = (GeometryId, &'a Arc<GeometryMesh>)> {
    scene.geometries().filter(|(name, mesh)| {
        let is_there = built.geometry(*name).is_some_and(|own| Arc::ptr_eq(own.mesh(), mesh));
        mesh.shapes().is_none() && !is_there
    })
}

/// What an update needs that has these trees already.
fn needed(
    built: &BuiltScene,
    scene: &Scene,
    before: &[(GeometryId, Arc<GeometryMesh>, bool)],
) -> Vec<(GeometryId, Arc<GeometryMesh>, bool)> {
    let mut all: Vec<(GeometryId, Arc<GeometryMesh>, bool)> = Vec::new();
    for (name, mesh) in unbuilt(built, scene) {
        if !all.iter().any(|(_, own, _)| Arc::ptr_eq(own, mesh)) {
            let has = before.iter().any(|(_, own, has)| *has && Arc::ptr_eq(own, mesh));
            all.push((name, Arc::clone(mesh), has));
        }
    }
    all
}

impl Pending {
    fn begin(run: &Run<'_>) -> Pending {
        let built = run.built.scene();
        let update = PendingUpdate::begin(run.library.backend(), built, &run.scene);
        Pending {
            update: update.expect("a pending update"),
            needed: needed(built, &run.scene, &[]),
            digest: built.digest(),
            others: 0,
        }
    }

    fn check(&self) {
        let left = self.needed.iter().filter(|(.., has)| !has).count();
        assert_eq!(self.update.left(), left);
        let Progress { done, total, .. } = self.update.progress();
        assert_eq!((total, done), (self.needed.len() as u64, (self.needed.len() - left) as u64));
        let next = self.needed.iter().find(|(.., has)| !has);
        assert_eq!(self.update.next_mesh().map(|(name, _)| name), next.map(|(name, ..)| *name));
        assert!(left < self.needed.len() || self.update.bytes() == 0);
    }

    fn has_trees(&self) -> bool {
        self.needed.iter().any(|(.., has)| *has)
    }

    /// Builds one tree, or tries to, maybe into a spare. False where nothing was left.
    fn build_next(
        &mut self,
        run: &mut Run<'_>,
        by_updater: bool,
        options: &BuildOptions<'_>,
    ) -> bool {
        let next = self.needed.iter_mut().find(|(.., has)| !has);
        let before = run.updater.spare_bytes();
        let updater = by_updater.then_some(&mut run.updater);
        let built = run.library.build_next(updater, &mut self.update, options);
        assert!(run.updater.spare_bytes() <= before);
        run.reached.respared += u64::from(run.updater.spare_bytes() < before);
        match (built, next) {
            (Ok(true), Some((.., has))) => *has = true,
            (Ok(false), None) => return false,
            (Err(SceneBuildError::Cancelled { .. }), Some(_)) => {
                assert!(options.watch.is_some());
                run.reached.unbuilt += 1;
            }
            (Err(error), Some(_)) => {
                let limit = options.max_memory.expect("a limit");
                assert!(is_of_limit(&error, limit), "{error:?} {limit}");
                run.reached.unbuilt += 1;
            }
            (told, _) => panic!("{told:?}"),
        }
        self.check();
        true
    }

    fn renew(&mut self, run: &mut Run<'_>) {
        let built = run.built.scene();
        run.library.renew(&mut self.update, built, &run.scene).expect("memory");
        self.needed = needed(built, &run.scene, &self.needed);
        (self.digest, self.others) = (built.digest(), 0);
        run.reached.renewed += u64::from(self.has_trees());
        self.check();
    }

    /// The geometry that lacks a tree, if any.
    fn lacking(&self, run: &Run<'_>) -> Option<u32> {
        let has = |mesh| self.needed.iter().any(|(_, own, has)| *has && Arc::ptr_eq(own, mesh));
        let mut unbuilt = unbuilt(run.built.scene(), &run.scene);
        unbuilt.find(|(_, mesh)| !has(*mesh)).map(|(name, _)| name.0)
    }
}

/// Begins a pending update, or goes on with the one that there is.
pub(super) fn step(source: &mut Source<'_>, run: &mut Run<'_>) {
    let Some(mut pending) = run.pending.take() else {
        if source.once_in(2) {
            deform(source, &mut run.scene, &mut run.model);
        }
        let pending = Pending::begin(run);
        pending.check();
        run.pending = Some(pending);
        return run.is_as_before();
    };
    let options = BuildOptions::default();
    let by_updater = source.once_in(2);
    match source.below(10) {
        0 => {
            let stop = |_: &Progress| ControlFlow::Break(());
            let left = pending.update.left();
            pending.build_next(run, by_updater, &BuildOptions { watch: Some(&stop), ..options });
            assert_eq!(pending.update.left(), left);
        }
        1 => {
            let (held, trees) = (run.built.scene().bytes(), pending.update.bytes());
            let limit = limit(source, held + trees);
            let options = BuildOptions { max_memory: Some(limit), ..options };
            pending.build_next(run, by_updater, &options);
            let grown = pending.update.bytes();
            assert!(grown == trees || held + grown <= limit || pending.others > 0);
        }
        2 => drop(pending.build_next(run, by_updater, &options)),
        3 | 4 => while pending.build_next(run, by_updater, &options) {},
        5 => pending.renew(run),
        6 => {
            run.reached.dropped += u64::from(pending.has_trees());
            return run.is_as_before();
        }
        _ => {
            if !source.once_in(4) {
                while pending.build_next(run, by_updater, &options) {}
            }
            return finish(source, run, by_updater, pending);
        }
    }
    run.pending = Some(pending);
    run.is_as_before();
}

/// Tries to put an update in place, maybe within a limit first.
fn finish(source: &mut Source<'_>, run: &mut Run<'_>, by_updater: bool, mut pending: Pending) {
    let (lacking, unbuilt) = (pending.lacking(run), run.unbuilt());
    let may_be_outdated = pending.others > 0;
    let is_outdated = may_be_outdated && run.built.scene().digest() != pending.digest;
    let mut options = BuildOptions::default();
    if source.once_in(3) {
        options.max_memory = Some(limit(source, run.built.scene().bytes()));
    }
    loop {
        let Run { library, scene, built, updater, .. } = run;
        let updater = by_updater.then_some(updater);
        match library.finish(updater, &mut pending.update, built, scene, &options) {
            Ok(report) => {
                assert!(!is_outdated && lacking.is_none());
                run.reached.finished += u64::from(pending.has_trees());
                return run.is_up_to_date(source, &report, unbuilt);
            }
            Err(FinishError::Outdated) => {
                assert!(may_be_outdated);
                run.reached.outdated += 1;
                pending.check();
                if source.once_in(2) {
                    pending.renew(run);
                }
                break;
            }
            Err(FinishError::NotBuilt { geometry }) => {
                assert!(!is_outdated);
                assert_eq!(Some(geometry), lacking);
                run.reached.lacking += 1;
                break;
            }
            Err(FinishError::Build(error)) => {
                assert!(!is_outdated && lacking.is_none());
                let limit = options.max_memory.take().expect("a limit");
                assert!(is_of_limit(&error, limit), "{error:?} {limit}");
                pending.check();
                run.is_as_before();
            }
            Err(error) => panic!("{error}"),
        }
    }
    pending.check();
    run.pending = Some(pending);
    run.is_as_before();
}
