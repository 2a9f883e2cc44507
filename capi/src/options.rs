//! Settings of builds and queries, as C has them. A setting that means nothing for a call has to be what it is by default: nothing that is asked for is passed over.

use std::ffi::{c_char, c_void};

use library::{
    Accuracy as LibraryAccuracy, Culling as LibraryCulling, Preset as LibraryPreset, QueryLayout,
};

use crate::buffer::{check, read, write};
use crate::entry::entry;
use crate::record::SceneHit;
use crate::status::{Failure, Status};

/// No triangle, instance, geometry or point: what records of a miss have.
pub const NONE: u32 = u32::MAX;

/// Which builder makes a tree.
#[repr(u32)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Preset {
    /// The fastest build.
    Fast = 0,
    /// Small leaves, for rays that test one triangle at a time.
    Narrow = 1,
    /// A better tree for a slower build.
    Balanced = 2,
    /// The best tree, offline; on the CPU only.
    Best = 3,
}

/// What queries read of a tree. Answers do not depend on it.
#[repr(u32)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Layout {
    /// Copies of triangles as the test reads them.
    Fast = 0,
    /// A third to a half of the memory, and slower rays.
    Compact = 1,
}

/// Which ray and triangle test answers.
#[repr(u32)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Accuracy {
    /// No ray slips between two triangles that share an edge or a corner. The default.
    Watertight = 0,
    /// Rays aimed at edges and corners may leak.
    Fast = 1,
    /// The hit that real arithmetic gives.
    Exact = 2,
}

/// Which side of triangles is ignored. The front is where the corners run counter-clockwise.
#[repr(u32)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Culling {
    /// Both sides count.
    None = 0,
    /// Triangles seen from the back are ignored.
    Back = 1,
    /// Triangles seen from the front are ignored.
    Front = 2,
}

/// Told how far a call has come: `user` is that of the options; `stage` a text that stays; `total` is 0 where it is not known. Returns 0 to go on, anything else to end the
/// call with `SPLITPLANE_STATUS_CANCELLED`. Called from any thread, by one at a time for each call, and often; it must not throw, `longjmp`, or free what the call uses.
pub type ProgressFunction = Option<
    unsafe extern "C" fn(user: *mut c_void, stage: *const c_char, done: u64, total: u64) -> i32,
>;

/// Decides which hits count: `user` is `filter_user` of the options. Returns 0 for a hit that is to count as not there, anything else for one that counts. Called from any thread, by several at a
/// time. For the same hit it has to return the same, whoever asks and how often; it must not throw or `longjmp`.
pub type FilterFunction =
    Option<unsafe extern "C" fn(user: *mut c_void, hit: *const SceneHit) -> i32>;

/// The same for points of a cloud, by their places in your array.
pub type PointFilterFunction = Option<unsafe extern "C" fn(user: *mut c_void, point: u32) -> i32>;

/// A change to a preset: `traversal_cost`, `intersection_cost`, `block_width`, `max_depth`, `references_per_triangle`, `clip`, `small_node_limit`, `empty_cutoff`,
/// `nodes_per_triangle`, `bins`, `empty_bonus`, `bad_splits`.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct Knob {
    /// Its name.
    pub name: *const c_char,
    /// Its value; of `clip` 0 or 1.
    pub value: u32,
}

/// Settings of builds, loads and updates. `splitplane_build_options_init` first.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct BuildOptions {
    /// `sizeof(splitplane_build_options)`.
    pub size: usize,
    /// A `splitplane_preset`; for loads, which find it in the file, the default.
    pub preset: u32,
    /// A `splitplane_layout`.
    pub layout: u32,
    /// Changes to the preset; may be NULL where there are none.
    pub knobs: *const Knob,
    /// How many.
    pub knob_count: usize,
    /// Most bytes that the build may hold besides your arrays; 0 for no limit.
    pub max_memory: u64,
    /// Told how far it is; may be NULL.
    pub progress: ProgressFunction,
    /// Handed to it.
    pub user: *mut c_void,
    /// Threads that work, at most 1024; 0 for as many as there are cores, or as the environment's `RAYON_NUM_THREADS` says.
    pub threads: u32,
    /// 0.
    pub reserved: u32,
}

/// Settings of queries. `splitplane_query_options_init` first. What a call does not use must be as it was then.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct QueryOptions {
    /// `sizeof(splitplane_query_options)`.
    pub size: usize,
    /// A `splitplane_accuracy`. Of closest points `EXACT` finds the nearest triangle of real arithmetic, the others that of the least distance in `double`.
    pub accuracy: u32,
    /// A `splitplane_culling`.
    pub culling: u32,
    /// Scenes: instances answer when a bit of theirs is in this mask.
    pub mask: u32,
    /// A triangle to ignore, for all rays or points of the call; `SPLITPLANE_NONE` for none.
    pub ignore_triangle: u32,
    /// Scenes: its instance.
    pub ignore_instance: u32,
    /// Closest points and points of a cloud: nothing farther away is looked for. Not NaN; infinity for no limit.
    pub max_distance: f32,
    /// Answers of unknown length, points inside, nearest points: most bytes that they and their parts may take; 0 for no limit.
    pub max_memory: u64,
    /// Told how far it is; may be NULL.
    pub progress: ProgressFunction,
    /// Handed to it.
    pub user: *mut c_void,
    /// Hits, crossings and their number in scenes: decides on the CPU which count; NULL: all do.
    pub filter: FilterFunction,
    /// Points of a cloud: decides on the CPU which count; NULL: all do.
    pub point_filter: PointFilterFunction,
    /// Handed to both.
    pub filter_user: *mut c_void,
    /// Threads that work, at most 1024; 0 for as many as there are cores, or as the environment's `RAYON_NUM_THREADS` says.
    pub threads: u32,
    /// 0.
    pub reserved: u32,
}

pub(crate) const BUILD_DEFAULTS: BuildOptions = BuildOptions {
    size: size_of::<BuildOptions>(),
    preset: Preset::Fast as u32,
    layout: Layout::Fast as u32,
    knobs: std::ptr::null(),
    knob_count: 0,
    max_memory: 0,
    progress: None,
    user: std::ptr::null_mut(),
    threads: 0,
    reserved: 0,
};

pub(crate) const QUERY_DEFAULTS: QueryOptions = QueryOptions {
    size: size_of::<QueryOptions>(),
    accuracy: Accuracy::Watertight as u32,
    culling: Culling::None as u32,
    mask: u32::MAX,
    ignore_triangle: NONE,
    ignore_instance: NONE,
    max_distance: f32::INFINITY,
    max_memory: 0,
    progress: None,
    user: std::ptr::null_mut(),
    filter: None,
    point_filter: None,
    filter_user: std::ptr::null_mut(),
    threads: 0,
    reserved: 0,
};

fn check_size(given: usize, own: usize, what: &str) -> Result<(), Failure> {
    if given == own {
        return Ok(());
    }
    let text = format!(
        "{what} have size {given}, and this library's have {own}: initialise them, and compile with its header"
    );
    Err(Failure::new(Status::Option, text))
}

/// Sets the defaults: preset fast, no limit, all cores. `size` is `sizeof(splitplane_build_options)`.
///
/// Threads: any.
///
/// # Safety
/// `options` has room for them.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn splitplane_build_options_init(
    options: *mut BuildOptions,
    size: usize,
) -> Status {
    entry(|| {
        check(options, "options")?;
        check_size(size, size_of::<BuildOptions>(), "options")?;
        // SAFETY: there is room.
        unsafe { write(options, BUILD_DEFAULTS, "options") }
    })
}

/// Sets the defaults: watertight, nothing ignored, no limit, all cores. `size` is `sizeof(splitplane_query_options)`.
///
/// Threads: any.
///
/// # Safety
/// `options` has room for them.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn splitplane_query_options_init(
    options: *mut QueryOptions,
    size: usize,
) -> Status {
    entry(|| {
        check(options, "options")?;
        check_size(size, size_of::<QueryOptions>(), "options")?;
        // SAFETY: there is room.
        unsafe { write(options, QUERY_DEFAULTS, "options") }
    })
}

/// Reads settings, whose size is looked at before the rest.
///
/// # Safety
/// A pointer that is not null points to at least a `usize`, and to a `T` where that is its size.
pub(crate) unsafe fn settings<T: Copy>(options: *const T, defaults: T) -> Result<T, Failure> {
    if options.is_null() {
        return Ok(defaults);
    }
    check(options, "options")?;
    // SAFETY: as the caller says.
    let size = unsafe { options.cast::<usize>().read() };
    check_size(size, size_of::<T>(), "options")?;
    // SAFETY: as the caller says.
    unsafe { read(options, "options") }
}

/// What a number stands for.
pub(crate) fn chosen<T: Copy>(number: u32, known: &[(u32, T)], what: &str) -> Result<T, Failure> {
    let found = known.iter().find(|(own, _)| *own == number);
    found
        .map(|(_, meaning)| *meaning)
        .ok_or_else(|| Failure::new(Status::Option, format!("there is no {what} {number}")))
}

pub(crate) const CULLINGS: [(u32, LibraryCulling); 3] = [
    (Culling::None as u32, LibraryCulling::None),
    (Culling::Back as u32, LibraryCulling::Back),
    (Culling::Front as u32, LibraryCulling::Front),
];
pub(crate) const PRESETS: [(u32, LibraryPreset); 4] = [
    (Preset::Fast as u32, LibraryPreset::Fast),
    (Preset::Narrow as u32, LibraryPreset::Narrow),
    (Preset::Balanced as u32, LibraryPreset::Balanced),
    (Preset::Best as u32, LibraryPreset::Best),
];
pub(crate) const LAYOUTS: [(u32, QueryLayout); 2] =
    [(Layout::Fast as u32, QueryLayout::Fast), (Layout::Compact as u32, QueryLayout::Compact)];
pub(crate) const ACCURACIES: [(u32, LibraryAccuracy); 3] = [
    (Accuracy::Watertight as u32, LibraryAccuracy::Watertight),
    (Accuracy::Fast as u32, LibraryAccuracy::Fast),
    (Accuracy::Exact as u32, LibraryAccuracy::Exact),
];
/// A limit of bytes, of which 0 is none.
pub(crate) fn limit(max_memory: u64) -> Option<u64> {
    (max_memory != 0).then_some(max_memory)
}

/// Refuses what is not 0.
pub(crate) fn reserved(word: u32) -> Result<(), Failure> {
    match word {
        0 => Ok(()),
        _ => Err(Failure::new(Status::Option, "options: `reserved` is not 0")),
    }
}
