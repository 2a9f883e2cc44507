//! Scenes whose geometries are built as rays reach them.

use std::sync::{Arc, RwLock};

use library::Backend as LibraryBackend;
use library::objects::{LazyScene, Scene as Description};

use crate::buffer::{check, write};
use crate::build_settings::Build;
use crate::built::Built;
use crate::edits::Edits;
use crate::entry::entry;
use crate::handle::{Backend, Scene, get, insert};
use crate::options::{BuildOptions, QueryOptions};
use crate::pool;
use crate::progress::watch;
use crate::query_settings::{Query, Uses};
use crate::scene::{State, current};
use crate::status::{Failure, Status};
use crate::tree::look;

/// Makes a scene without anything, of which a geometry is built when the first ray reaches the box of an instance of it, and nothing that is built hides it. Answers are those of other scenes. Queries
/// may then take memory, call the progress function while they build, and fail as builds do; a geometry that was not built stays unbuilt. Points, overlaps, files and digests build everything.
///
/// `options`, which may be NULL, holds for all that queries build: `max_memory` for the whole scene. Progress and threads are those of the calls, so here they have to be left as they are.
///
/// Threads: any.
///
/// # Safety
/// `options` says what is there, and `scene` has room for a handle.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn splitplane_scene_create_lazy(
    backend: Backend,
    options: *const BuildOptions,
    scene: *mut Scene,
) -> Status {
    entry(|| {
        check(scene, "scene")?;
        let opened = get(backend)?;
        // SAFETY: as the caller says.
        let build = unsafe { Build::read(options)? };
        if build.threads != 0 || build.caller.is_some() {
            let text = "options: `threads` and `progress` are those of calls that build";
            return Err(Failure::new(Status::Option, text));
        }
        let (description, engine) = (Description::new(), Arc::clone(&opened.engine));
        let engine: Arc<dyn LibraryBackend> = engine;
        let lazy = LazyScene::new(engine, &description, &build.options())?;
        let built = Built::Lazy(Box::new(lazy));
        let state = State { description, built, opened, edits: Edits::Taken };
        // SAFETY: there is room.
        unsafe { write(scene, insert(RwLock::new(state))?, "scene") }
    })
}

/// How many geometries of a lazy scene no query has built; 0 for other scenes.
///
/// Threads: any.
///
/// # Safety
/// `count` has room.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn splitplane_scene_waiting(scene: Scene, count: *mut usize) -> Status {
    entry(|| {
        check(count, "count")?;
        let object = get(scene)?;
        let waiting = look(&object)?.built.waiting();
        // SAFETY: there is room.
        unsafe { write(count, waiting, "count") }
    })
}

/// Builds the geometries of a lazy scene that no query has built; of others it does nothing. `options` may be NULL: progress and threads.
///
/// Threads: any; it may run beside queries.
///
/// # Safety
/// `options` says what is there.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn splitplane_scene_complete(
    scene: Scene,
    options: *const QueryOptions,
) -> Status {
    entry(|| {
        let object = get(scene)?;
        // SAFETY: as the caller says.
        let query = unsafe { Query::read(options, Uses::COMPLETE)? };
        let state = current(&object)?;
        pool::run(query.threads, || state.built.complete(watch(&query.caller)))
    })
}
