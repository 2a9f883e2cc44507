//! Memory of scene files: at no time more is held than the limit and a constant, whatever the text says, and what fits is the same scene.

#[path = "scene_text/families.rs"]
mod families;

use families::{Family, bad, good};
use splitplane_scene::SceneOptions;
use splitplane_scene::instanced::{InstancedScene, Placed, SceneFileError, SceneFileProblem, read};
use std::alloc::{GlobalAlloc, Layout, System};
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};
use std::sync::{Mutex, MutexGuard, PoisonError};

/// Bytes that the process holds, and the most it held.
static HELD: AtomicUsize = AtomicUsize::new(0);
static PEAK: AtomicUsize = AtomicUsize::new(0);

fn take(bytes: usize) {
    PEAK.fetch_max(HELD.fetch_add(bytes, Relaxed) + bytes, Relaxed);
}

/// The system's allocator, which counts.
struct Counting;

// SAFETY: passes everything on to the system's allocator, and only adds up sizes.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        take(layout.size());
        // SAFETY: the caller's promise.
        unsafe { System.alloc(layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        take(layout.size());
        // SAFETY: the caller's promise.
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        HELD.fetch_sub(layout.size(), Relaxed);
        // SAFETY: the caller's promise.
        unsafe { System.dealloc(pointer, layout) }
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        take(size);
        HELD.fetch_sub(layout.size(), Relaxed);
        // SAFETY: the caller's promise.
        unsafe { System.realloc(pointer, layout, size) }
    }
}

#[global_allocator]
static COUNTING: Counting = Counting;

/// What a count says is about one test at a time.
fn alone() -> MutexGuard<'static, ()> {
    static ALONE: Mutex<()> = Mutex::new(());
    ALONE.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The most bytes that some work holds at once besides what is held before.
fn peak<T>(work: impl FnOnce() -> T) -> (u64, T) {
    let held = HELD.load(Relaxed);
    PEAK.store(held, Relaxed);
    let result = work();
    ((PEAK.load(Relaxed) - held) as u64, result)
}

/// What is held besides what counts: the system's buffers, errors, words of up to 4,096 bytes that an error quotes.
const SLACK: u64 = 160 << 10;

/// A limit that suffices for all.
const ENOUGH: u64 = 1 << 26;

/// Reads a scene file under a limit.
type Reader<'a> = &'a dyn Fn(&Path, u64) -> Result<InstancedScene, SceneFileError>;

fn within(path: &Path, limit: u64) -> Result<InstancedScene, SceneFileError> {
    read(path, &SceneOptions { memory_limit: Some(limit), ..SceneOptions::default() })
}

/// Whether a reader keeps to a limit; gives what it reads.
fn check_limit(
    family: &Family,
    path: &Path,
    limit: u64,
    reader: Reader<'_>,
) -> Result<Result<InstancedScene, SceneFileError>, String> {
    let (peak, found) = peak(|| reader(path, limit));
    if peak > limit.saturating_add(SLACK) {
        return Err(format!("{}: {peak} bytes are held under a limit of {limit}", family.name));
    }
    Ok(found)
}

/// Whether a reader keeps to all limits about the least that suffices, refuses what is less, and reads the same scene, or says the same, under any that suffices.
fn check(family: &Family, path: &Path, reader: Reader<'_>) -> Result<(), String> {
    let name = family.name;
    let wanted = within(path, u64::MAX);
    if wanted.is_ok() != family.is_scene {
        return Err(format!("{name}: {:?}", wanted.err()));
    }
    if check_limit(family, path, 0, reader)? == wanted {
        return Err(format!("{name}: nothing suffices"));
    }
    // The least limit is above the one and at most the other.
    let (mut less, mut enough) = (0, ENOUGH);
    while enough - less > 1 {
        let limit = less.midpoint(enough);
        let found = check_limit(family, path, limit, reader)?;
        if found == wanted {
            enough = limit;
            continue;
        }
        let Err(error) = found else {
            return Err(format!("{name}: another scene under a limit of {limit}"));
        };
        match *error.problem {
            SceneFileProblem::Memory { needed, limit: named }
                if named == limit && needed > limit && error.problem.is_limit() => {}
            _ => return Err(format!("{name}: {error} under a limit of {limit}")),
        }
        less = limit;
    }
    match check_limit(family, path, ENOUGH, reader)? == wanted {
        true => Ok(()),
        false => Err(format!("{name}: {ENOUGH} bytes do not suffice")),
    }
}

/// A folder with the files that texts name, and the path of the text in it.
fn folder() -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    families::files(folder.path());
    let path = folder.path().join("scene.json");
    (folder, path)
}

#[test]
fn no_more_is_held_than_the_limit_and_what_fits_is_read() {
    let _alone = alone();
    let (_folder, path) = folder();
    for family in good() {
        fs::write(&path, &family.text).unwrap();
        check(&family, &path, &within).unwrap();
    }
}

#[test]
fn a_text_that_is_no_scene_takes_no_more_either() {
    let _alone = alone();
    let (_folder, path) = folder();
    for family in bad() {
        fs::write(&path, &family.text).unwrap();
        check(&family, &path, &within).unwrap();
    }
}

/// Faults that are planted: each is found with every text.
#[test]
fn readers_that_do_not_keep_to_limits_are_found() {
    let _alone = alone();
    let (_folder, path) = folder();
    // It looks at what was read.
    let late = |path: &Path, limit: u64| {
        let (peak, scene) = peak(|| within(path, u64::MAX));
        if peak > limit {
            let problem = SceneFileProblem::Memory { needed: peak, limit };
            let (file, field) = (path.to_owned(), String::new());
            return Err(SceneFileError { file, place: None, field, problem: Box::new(problem) });
        }
        scene
    };
    // It refuses what fits, from some size on.
    let shy = |path: &Path, limit: u64| within(path, limit.min(1 << 16));
    // It leaves out what does not fit.
    let short = |path: &Path, limit: u64| {
        within(path, u64::MAX).map(|mut scene| {
            scene.instances.truncate(limit as usize / size_of::<Placed>());
            scene
        })
    };
    let faults: [(&str, Reader<'_>); 3] = [("late", &late), ("shy", &shy), ("short", &short)];
    for family in good() {
        fs::write(&path, &family.text).unwrap();
        for (fault, reader) in faults {
            let found = check(&family, &path, reader);
            assert!(found.is_err(), "{}: {fault}", family.name);
        }
    }
}
