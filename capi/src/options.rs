//! Settings of builds and queries. A setting that means nothing for a call has to be what it is by default: nothing that is asked for is passed over.

use std::ffi::{c_char, c_void};
use std::ops::ControlFlow;

use library::objects::{
    IgnoredTriangle, InstanceId, SceneAllHitsOptions, SceneClosestPointOptions, SceneOptions,
};
use library::{
    Accuracy as LibraryAccuracy, AllHitsOptions, BuildConfig, BuildOptions as LibraryBuildOptions,
    ClosestPointOptions, Culling as LibraryCulling, LocateOptions, Preset as LibraryPreset,
    Progress, QueryLayout, QueryOptions as LibraryQueryOptions, Stage, Watch,
};

use crate::buffer::{Given, check, read, text, write};
use crate::entry::entry;
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
    /// A `splitplane_accuracy`.
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
    /// Threads that work, at most 1024; 0 for as many as there are cores, or as the environment's `RAYON_NUM_THREADS` says.
    pub threads: u32,
    /// 0.
    pub reserved: u32,
}

const BUILD_DEFAULTS: BuildOptions = BuildOptions {
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

const QUERY_DEFAULTS: QueryOptions = QueryOptions {
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
unsafe fn settings<T: Copy>(options: *const T, defaults: T) -> Result<T, Failure> {
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
const PRESETS: [(u32, LibraryPreset); 4] = [
    (Preset::Fast as u32, LibraryPreset::Fast),
    (Preset::Narrow as u32, LibraryPreset::Narrow),
    (Preset::Balanced as u32, LibraryPreset::Balanced),
    (Preset::Best as u32, LibraryPreset::Best),
];
const LAYOUTS: [(u32, QueryLayout); 2] =
    [(Layout::Fast as u32, QueryLayout::Fast), (Layout::Compact as u32, QueryLayout::Compact)];
const ACCURACIES: [(u32, LibraryAccuracy); 3] = [
    (Accuracy::Watertight as u32, LibraryAccuracy::Watertight),
    (Accuracy::Fast as u32, LibraryAccuracy::Fast),
    (Accuracy::Exact as u32, LibraryAccuracy::Exact),
];

/// The progress function of a call, for a part of it.
#[derive(Clone, Copy)]
pub(crate) struct Caller {
    function: unsafe extern "C" fn(*mut c_void, *const c_char, u64, u64) -> i32,
    user: *mut c_void,
    /// Items before this part.
    first: u64,
    /// Items of the whole; `None` where the part is all.
    total: Option<u64>,
}

// SAFETY: the function may be called from any thread, as its documentation says.
unsafe impl Send for Caller {}
// SAFETY: as above.
unsafe impl Sync for Caller {}

impl Caller {
    /// The same for a part of a batch.
    pub(crate) fn part(self, first: usize, total: usize) -> Caller {
        Caller { first: first as u64, total: Some(total as u64), ..self }
    }
}

/// A stage's name with an end.
pub(crate) fn stage_name(stage: Stage) -> &'static std::ffi::CStr {
    match stage {
        Stage::Start => c"triangle bounds",
        Stage::LargeNodes => c"large-node stage",
        Stage::SmallNodes => c"small-node stage",
        Stage::Output => c"output stage",
        Stage::Offline => c"offline builder",
        Stage::Layout => c"query layout",
        Stage::Device => c"device",
        Stage::Rays => c"rays",
        Stage::Geometries => c"geometries",
        Stage::Points => c"point tree",
        _ => c"work",
    }
}

impl Watch for Caller {
    fn progress(&self, progress: &Progress) -> ControlFlow<()> {
        let (done, total) = match (progress.stage, self.total) {
            (Stage::Rays, Some(total)) => (progress.done + self.first, total),
            _ => (progress.done, progress.total),
        };
        let name = stage_name(progress.stage).as_ptr();
        // SAFETY: the caller of the entry vouches for the function.
        match unsafe { (self.function)(self.user, name, done, total) } {
            0 => ControlFlow::Continue(()),
            _ => ControlFlow::Break(()),
        }
    }
}

fn caller(progress: ProgressFunction, user: *mut c_void) -> Option<Caller> {
    progress.map(|function| Caller { function, user, first: 0, total: None })
}

pub(crate) fn watch(caller: &Option<Caller>) -> Option<&dyn Watch> {
    caller.as_ref().map(|caller| -> &dyn Watch { caller })
}

fn limit(max_memory: u64) -> Option<u64> {
    (max_memory != 0).then_some(max_memory)
}

fn reserved(word: u32) -> Result<(), Failure> {
    match word {
        0 => Ok(()),
        _ => Err(Failure::new(Status::Option, "options: `reserved` is not 0")),
    }
}

/// The settings of a build, checked.
pub(crate) struct Build {
    options: LibraryBuildOptions<'static>,
    pub(crate) caller: Option<Caller>,
    pub(crate) threads: u32,
}

impl Build {
    /// # Safety
    /// See [`settings`]; knobs are there as they say.
    pub(crate) unsafe fn read(options: *const BuildOptions) -> Result<Build, Failure> {
        // SAFETY: as the caller says.
        let own = unsafe { settings(options, BUILD_DEFAULTS)? };
        reserved(own.reserved)?;
        let mut config = chosen(own.preset, &PRESETS, "preset")?.config();
        let layout = chosen(own.layout, &LAYOUTS, "layout")?;
        // SAFETY: as the caller says.
        unsafe { turn(&mut config, own.knobs, own.knob_count)? };
        config.validate()?;
        let max_memory = limit(own.max_memory);
        Ok(Build {
            options: LibraryBuildOptions { config, layout, max_memory, watch: None },
            caller: caller(own.progress, own.user),
            threads: own.threads,
        })
    }

    pub(crate) fn options(&self) -> LibraryBuildOptions<'_> {
        LibraryBuildOptions { watch: watch(&self.caller), ..self.options }
    }

    /// Refuses what a load finds in its file.
    pub(crate) fn for_loading(&self) -> Result<(), Failure> {
        match self.options.config == BuildConfig::default() {
            true => Ok(()),
            false => {
                let text = "a file has its own configuration: preset and knobs mean nothing here";
                Err(Failure::new(Status::Option, text))
            }
        }
    }

    /// Refuses what a build of points does not use.
    pub(crate) fn for_points(&self) -> Result<(), Failure> {
        self.for_loading()?;
        match self.options.layout == QueryLayout::Fast {
            true => Ok(()),
            false => Err(Failure::new(Status::Option, "a point tree has one layout")),
        }
    }
}

/// Turns knobs.
///
/// # Safety
/// So many are there.
unsafe fn turn(config: &mut BuildConfig, first: *const Knob, count: usize) -> Result<(), Failure> {
    if count > 64 {
        return Err(Failure::new(Status::Count, format!("{count} knobs are more than there are")));
    }
    for place in 0..count {
        check(first, "options: `knobs`")?;
        // SAFETY: so many are there.
        let knob = unsafe { first.add(place).read() };
        // SAFETY: as above.
        let name = unsafe { text(knob.name, "the name of a knob")? };
        let known = match name {
            "traversal_cost" => Some(&mut config.traversal_cost),
            "intersection_cost" => Some(&mut config.intersection_cost),
            "block_width" => Some(&mut config.block_width),
            "max_depth" => Some(&mut config.max_depth),
            "references_per_triangle" => Some(&mut config.references_per_triangle),
            "clip" if knob.value <= 1 => {
                config.clip = knob.value == 1;
                continue;
            }
            "clip" => return Err(Failure::new(Status::Option, "clip is 0 or 1")),
            "small_node_limit" => config.stages_mut().map(|stages| &mut stages.small_node_limit),
            "empty_cutoff" => config.stages_mut().map(|stages| &mut stages.empty_cutoff),
            "nodes_per_triangle" => {
                config.stages_mut().map(|stages| &mut stages.nodes_per_triangle)
            }
            "bins" => config.bins_mut(),
            "empty_bonus" => config.sweep_mut().map(|sweep| &mut sweep.empty_bonus),
            "bad_splits" => config.sweep_mut().map(|sweep| &mut sweep.bad_splits),
            _ => return Err(Failure::new(Status::Option, format!("there is no knob `{name}`"))),
        };
        *known.ok_or_else(|| {
            Failure::new(Status::Option, format!("the preset's builder has no knob `{name}`"))
        })? = knob.value;
    }
    Ok(())
}

/// What a query uses of its settings, besides progress and threads.
#[derive(Clone, Copy)]
pub(crate) struct Uses {
    pub(crate) accuracy: bool,
    pub(crate) culling: bool,
    pub(crate) ignore: bool,
    pub(crate) instances: bool,
    pub(crate) max_distance: bool,
    pub(crate) max_memory: bool,
}

impl Uses {
    const NOTHING: Uses = Uses {
        accuracy: false,
        culling: false,
        ignore: false,
        instances: false,
        max_distance: false,
        max_memory: false,
    };
    pub(crate) const HITS: Uses =
        Uses { accuracy: true, culling: true, ignore: true, ..Uses::NOTHING };
    pub(crate) const ALL_HITS: Uses =
        Uses { culling: true, ignore: true, max_memory: true, ..Uses::NOTHING };
    pub(crate) const LOCATE: Uses = Uses { max_memory: true, ..Uses::NOTHING };
    pub(crate) const CLOSEST_POINTS: Uses =
        Uses { ignore: true, max_distance: true, ..Uses::NOTHING };
    pub(crate) const SIGNED: Uses = Uses { max_memory: true, ..Uses::NOTHING };
    pub(crate) const POINTS: Uses = Uses { max_distance: true, max_memory: true, ..Uses::NOTHING };

    /// The same for a scene.
    pub(crate) const fn of_instances(self) -> Uses {
        Uses { instances: true, ..self }
    }
}

/// The settings of a query, checked.
pub(crate) struct Query {
    accuracy: LibraryAccuracy,
    culling: LibraryCulling,
    mask: u32,
    ignore: Option<u32>,
    ignore_instance: Option<u32>,
    pub(crate) max_distance: f32,
    pub(crate) max_memory: Option<u64>,
    pub(crate) caller: Option<Caller>,
    pub(crate) threads: u32,
}

impl Query {
    /// # Safety
    /// See [`settings`].
    pub(crate) unsafe fn read(options: *const QueryOptions, uses: Uses) -> Result<Query, Failure> {
        // SAFETY: as the caller says.
        let own = unsafe { settings(options, QUERY_DEFAULTS)? };
        reserved(own.reserved)?;
        let standard = QUERY_DEFAULTS;
        let limited = own.max_distance != standard.max_distance;
        for (used, changed, name) in [
            (uses.accuracy, own.accuracy != standard.accuracy, "accuracy"),
            (uses.culling, own.culling != standard.culling, "culling"),
            (uses.instances, own.mask != standard.mask, "mask"),
            (uses.ignore, own.ignore_triangle != NONE, "ignore_triangle"),
            (uses.instances && uses.ignore, own.ignore_instance != NONE, "ignore_instance"),
            (uses.max_distance, limited, "max_distance"),
            (uses.max_memory, own.max_memory != 0, "max_memory"),
        ] {
            if changed && !used {
                let text = format!("options: `{name}` means nothing for this call");
                return Err(Failure::new(Status::Option, text));
            }
        }
        if own.max_distance.is_nan() {
            return Err(Failure::new(Status::Option, "options: `max_distance` is NaN"));
        }
        let accuracy = chosen(own.accuracy, &ACCURACIES, "accuracy")?;
        let culling = chosen(own.culling, &CULLINGS, "culling")?;
        let [ignore, ignore_instance] = [own.ignore_triangle, own.ignore_instance]
            .map(|number| Some(number).filter(|&n| n != NONE));
        if uses.instances && ignore.is_some() != ignore_instance.is_some() {
            let text =
                "options: a triangle to ignore needs its instance too, and the other way round";
            return Err(Failure::new(Status::Option, text));
        }
        Ok(Query {
            accuracy,
            culling,
            mask: own.mask,
            ignore,
            ignore_instance,
            max_distance: own.max_distance,
            max_memory: limit(own.max_memory),
            caller: caller(own.progress, own.user),
            threads: own.threads,
        })
    }

    pub(crate) fn hits<'a>(&self, watch: Option<&'a dyn Watch>) -> LibraryQueryOptions<'a> {
        let Query { accuracy, culling, ignore, .. } = *self;
        LibraryQueryOptions { accuracy, culling, ignore, watch, ..LibraryQueryOptions::default() }
    }

    pub(crate) fn all_hits<'a>(&self, watch: Option<&'a dyn Watch>) -> AllHitsOptions<'a> {
        let Query { culling, ignore, max_memory, .. } = *self;
        AllHitsOptions { culling, ignore, max_memory, watch }
    }

    pub(crate) fn locate<'a>(&self, watch: Option<&'a dyn Watch>) -> LocateOptions<'a> {
        LocateOptions { max_memory: self.max_memory, watch }
    }

    pub(crate) fn closest<'a>(&self, watch: Option<&'a dyn Watch>) -> ClosestPointOptions<'a> {
        let Query { max_distance, ignore, .. } = *self;
        ClosestPointOptions { max_distance, ignore, watch }
    }

    fn ignored(&self) -> Option<IgnoredTriangle> {
        let (instance, triangle) = (InstanceId(self.ignore_instance?), self.ignore?);
        Some(IgnoredTriangle { instance, triangle })
    }

    pub(crate) fn scene_hits<'a>(&self, watch: Option<&'a dyn Watch>) -> SceneOptions<'a> {
        let Query { accuracy, culling, mask, .. } = *self;
        SceneOptions { accuracy, culling, mask, ignore: self.ignored(), filter: None, watch }
    }

    pub(crate) fn scene_all_hits<'a>(
        &self,
        watch: Option<&'a dyn Watch>,
    ) -> SceneAllHitsOptions<'a> {
        SceneAllHitsOptions { query: self.scene_hits(watch), max_memory: self.max_memory }
    }

    pub(crate) fn scene_closest<'a>(
        &self,
        watch: Option<&'a dyn Watch>,
    ) -> SceneClosestPointOptions<'a> {
        let Query { max_distance, mask, .. } = *self;
        SceneClosestPointOptions { max_distance, mask, ignore: self.ignored(), watch }
    }
}

/// Points of three coordinates.
///
/// # Safety
/// As for [`Given::new`].
pub(crate) unsafe fn points<'a>(
    first: *const f32,
    stride: usize,
    count: usize,
) -> Result<Given<'a, [f32; 3]>, Failure> {
    // SAFETY: as the caller says.
    unsafe { Given::new(first.cast(), stride, count, "points") }
}
