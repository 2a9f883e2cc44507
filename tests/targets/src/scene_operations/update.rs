//! Updates at once: by a backend or an updater, cancelled, and within a limit of memory.

use core::ops::ControlFlow;

use super::edit::deform;
use super::{Reached, Run};
use crate::source::Source;
use splitplane_core::backend::BuildOptions;
use splitplane_core::backend::scene::UpdateReport;
use splitplane_core::error::BuildError;
use splitplane_core::scene::SceneBuildError;
use splitplane_core::watch::Progress;

/// A limit of memory, from nothing to more than is needed.
pub(super) fn limit(source: &mut Source<'_>, held: u64) -> u64 {
    let more = source.below(1 << 10) as u64 * 1024;
    source.pick(&[held + more, held, held / 2, 0])
}

/// Whether an error says that a limit binds, and which.
pub(super) fn is_of_limit(error: &SceneBuildError, limit: u64) -> bool {
    match *error {
        SceneBuildError::OutOfMemory { needed, limit: told }
        | SceneBuildError::Geometry {
            error: BuildError::OutOfMemory { needed, limit: told },
            ..
        } => told == limit && needed > limit,
        _ => false,
    }
}

fn update_by(
    run: &mut Run<'_>,
    by_updater: bool,
    options: &BuildOptions<'_>,
) -> Result<UpdateReport, SceneBuildError> {
    let Run { library, scene, built, updater, .. } = run;
    match by_updater {
        true => updater.update(library.backend(), built, scene, options),
        false => library.update(built, scene, options),
    }
}

/// Brings the scene up to date, maybe after a call that is cancelled or that a limit refuses, and holds it to one that is built from nothing.
pub(super) fn update(source: &mut Source<'_>, run: &mut Run<'_>) {
    let options = BuildOptions::default();
    if source.once_in(3) {
        deform(source, &mut run.scene, &mut run.model);
    }
    if source.once_in(8) {
        run.reached.cleared += u64::from(run.updater.spare_bytes() > 0);
        run.library.clear(&mut run.updater);
        assert_eq!(run.updater.spare_bytes(), 0);
    }
    if source.once_in(3) {
        let stop = |_: &Progress| ControlFlow::Break(());
        let cancelled = BuildOptions { watch: Some(&stop), ..options };
        let by_updater = source.once_in(2);
        if update_by(run, by_updater, &cancelled).is_err() {
            run.is_as_before();
            assert!(run.updater.spare_bytes() <= run.bound);
            run.reached.cancelled += 1;
        }
    }
    let unbuilt = run.unbuilt();
    if source.once_in(3) {
        let limit = limit(source, run.built.scene().bytes());
        let limited = BuildOptions { max_memory: Some(limit), ..options };
        let by_updater = source.once_in(2);
        match update_by(run, by_updater, &limited) {
            Ok(report) => {
                let own = run.built.scene();
                let geometries = own.bytes() - own.bytes_beside_geometries();
                assert!(unbuilt == 0 || geometries <= limit, "{geometries} {limit}");
                run.reached.limited += u64::from(unbuilt > 0);
                return run.is_up_to_date(source, &report, unbuilt);
            }
            Err(error) => {
                assert!(is_of_limit(&error, limit), "{error:?} {limit}");
                run.is_as_before();
                assert!(run.updater.spare_bytes() <= run.bound);
                run.reached.refused += 1;
            }
        }
    }
    let unbuilt = run.unbuilt();
    let by_updater = source.once_in(2);
    let has_spares = by_updater && unbuilt > 0 && run.updater.spare_bytes() > 0;
    let report = update_by(run, by_updater, &options).expect("an update");
    run.reached = run.reached.and(Reached { respared: has_spares.into(), ..Reached::default() });
    run.is_up_to_date(source, &report, unbuilt);
}
