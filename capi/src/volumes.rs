//! Volumes that triangles may meet: as C has them, and the calls that ask.

use library::core::aabb::Aabb;
use library::{Plane, Volume, Watch};

use crate::batch::Report;
use crate::buffer::{Given, Places, Wanted, check, check_offer, offer, read, reserve, write};
use crate::entry::entry;
use crate::handle::{Lists, Scene, Tree, get, insert};
use crate::lists::Object as ListsObject;
use crate::options::{QueryOptions, chosen, reserved};
use crate::pool;
use crate::progress::watch;
use crate::query_settings::{Query, Uses};
use crate::scene::current;
use crate::status::{Failure, Status};
use crate::tree::look;

/// What volumes are.
#[repr(u32)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum VolumeKind {
    /// Boxes: 6 numbers each, the lower and the upper corner. Sides may be infinite.
    Box = 0,
    /// Balls: 4 numbers each, the centre and the radius, 0 or more.
    Ball = 1,
    /// Capsules: 7 numbers each, both ends of a segment and the radius, 0 or more.
    Capsule = 2,
    /// Triangles, such as those of another mesh: 9 numbers each.
    Triangle = 3,
    /// Sets of half-spaces, such as frusta: 4 numbers for a plane, the normal n, which points outwards and may have any length, and the offset d: the points with n . x <= d.
    /// What is in all half-spaces of a set.
    Planes = 4,
}

/// Volumes in your arrays. One with a number that is NaN, or that is empty, meets nothing.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct Volumes {
    /// A `splitplane_volume_kind`.
    pub kind: u32,
    /// 0.
    pub reserved: u32,
    /// Numbers of the first volume, or of the first plane.
    pub numbers: *const f32,
    /// Bytes from one volume, or plane, to the next.
    pub stride: usize,
    /// How many volumes.
    pub count: usize,
    /// Of sets of planes, where those of each set begin, and after them how many planes there are: `count + 1` numbers, the first 0, none less than the one before. NULL for others.
    pub starts: *const u64,
}

/// A triangle that a volume meets.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Overlap {
    /// The triangle's place in the arrays of the mesh or geometry.
    pub triangle: u32,
    /// The instance; `SPLITPLANE_NONE` for a tree.
    pub instance: u32,
}

/// Numbers of a volume as the library has it.
type Numbers = [f32; 9];

/// The volumes of a call, copied: numbers, or sets of planes.
pub(crate) struct Copied {
    kind: VolumeKind,
    numbers: Vec<Numbers>,
    planes: Vec<Plane>,
    starts: Vec<usize>,
    places: [Option<Places>; 2],
}

fn point(numbers: &[f32]) -> [f32; 3] {
    [numbers[0], numbers[1], numbers[2]]
}

/// Copies rows of `N` numbers.
///
/// # Safety
/// As for [`Given::new`].
unsafe fn rows<const N: usize, T>(
    own: &Volumes,
    count: usize,
    made: impl Fn([f32; N]) -> T,
) -> Result<(Vec<T>, Places), Failure>
where
    [f32; N]: bytemuck::Pod,
{
    // SAFETY: as the caller says.
    let given =
        unsafe { Given::<[f32; N]>::new(own.numbers.cast(), own.stride, count, "numbers")? };
    let mut list = Vec::new();
    reserve(&mut list, count)?;
    list.extend((0..count).map(|place| made(given.at(place))));
    Ok((list, given.places))
}

fn wide<const N: usize>(row: [f32; N]) -> Numbers {
    let mut numbers = [0.0; 9];
    numbers[..N].copy_from_slice(&row);
    numbers
}

impl Copied {
    /// # Safety
    /// What the record says is memory that nobody writes during the call.
    pub(crate) unsafe fn new(volumes: *const Volumes) -> Result<Copied, Failure> {
        use VolumeKind as Kind;
        // SAFETY: as the caller says.
        let own = unsafe { read(volumes, "volumes")? };
        reserved(own.reserved)?;
        let kinds = [Kind::Box, Kind::Ball, Kind::Capsule, Kind::Triangle, Kind::Planes];
        let kind = chosen(own.kind, &kinds.map(|kind| (kind as u32, kind)), "kind of volumes")?;
        let mut copied = Copied {
            kind,
            numbers: Vec::new(),
            planes: Vec::new(),
            starts: Vec::new(),
            places: [None; 2],
        };
        if kind != Kind::Planes {
            if !own.starts.is_null() {
                let text = "volumes: `starts` means nothing for this kind";
                return Err(Failure::new(Status::Option, text));
            }
            let count = own.count;
            // SAFETY: as the caller says.
            let (numbers, places) = unsafe {
                match kind {
                    Kind::Box => rows::<6, _>(&own, count, wide)?,
                    Kind::Ball => rows::<4, _>(&own, count, wide)?,
                    Kind::Capsule => rows::<7, _>(&own, count, wide)?,
                    _ => rows::<9, _>(&own, count, wide)?,
                }
            };
            (copied.numbers, copied.places[0]) = (numbers, Some(places));
            return Ok(copied);
        }
        let ends = own.count.checked_add(1);
        let ends = ends.ok_or_else(|| Failure::new(Status::Count, "there are too many volumes"))?;
        // SAFETY: as the caller says.
        let starts = unsafe { Given::<u64>::new(own.starts, size_of::<u64>(), ends, "starts")? };
        reserve(&mut copied.starts, ends)?;
        for place in 0..ends {
            let start = starts.at(place);
            let least = copied.starts.last().map_or(0, |last| *last as u64);
            if start < least || (place == 0 && start != 0) {
                let text =
                    format!("volumes: `starts[{place}]` is {start}, less than before or not 0");
                return Err(Failure::new(Status::Option, text));
            }
            let start = usize::try_from(start)
                .map_err(|_| Failure::new(Status::Count, "no memory can hold so many planes"))?;
            copied.starts.push(start);
        }
        let planes = copied.starts.last().copied().unwrap_or(0);
        let plane = |[a, b, c, offset]: [f32; 4]| Plane { normal: [a, b, c], offset };
        // SAFETY: as the caller says.
        let (planes, places) = unsafe { rows::<4, _>(&own, planes, plane)? };
        (copied.planes, copied.places) = (planes, [Some(places), Some(starts.places)]);
        Ok(copied)
    }

    fn len(&self) -> usize {
        match self.kind {
            VolumeKind::Planes => self.starts.len() - 1,
            _ => self.numbers.len(),
        }
    }

    fn at(&self, place: usize) -> Volume<'_> {
        if self.kind == VolumeKind::Planes {
            return Volume::Planes(&self.planes[self.starts[place]..self.starts[place + 1]]);
        }
        let own = &self.numbers[place];
        match self.kind {
            VolumeKind::Box => Volume::Box(Aabb { lo: point(own), hi: point(&own[3..]) }),
            VolumeKind::Ball => Volume::Ball { centre: point(own), radius: own[3] },
            VolumeKind::Capsule => {
                Volume::Capsule { from: point(own), to: point(&own[3..]), radius: own[6] }
            }
            _ => Volume::Triangle([point(own), point(&own[3..]), point(&own[6..])]),
        }
    }

    fn all(&self) -> Result<Vec<Volume<'_>>, Failure> {
        let mut all = Vec::new();
        reserve(&mut all, self.len())?;
        all.extend((0..self.len()).map(|place| self.at(place)));
        Ok(all)
    }
}

/// Keeps lists behind a handle.
///
/// # Safety
/// `lists` has room for a handle, and `report` for a report where it is not NULL.
unsafe fn keep(
    lists: *mut Lists,
    object: ListsObject,
    report: *mut Report,
    found: Report,
) -> Result<(), Failure> {
    let handle = insert(object)?;
    // SAFETY: as the caller says.
    unsafe { write(lists, handle, "lists").and_then(|()| offer(report, found, "report")) }
}

/// The triangles that every volume meets, decided exactly, also where they only touch: a list of `splitplane_overlap` for each volume, in ascending order. Read them by `splitplane_lists_size`,
/// `splitplane_lists_starts` and `splitplane_lists_overlaps`, then free them. `max_memory` of the options limits what they take.
///
/// Threads: any; one tree may answer many calls at a time.
///
/// # Safety
/// `volumes` and `options` say what is there, and `lists` has room for a handle.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn splitplane_tree_overlaps(
    tree: Tree,
    volumes: *const Volumes,
    options: *const QueryOptions,
    lists: *mut Lists,
    report: *mut Report,
) -> Status {
    entry(|| {
        check(lists, "lists")?;
        check_offer(report, "report")?;
        let object = get(tree)?;
        // SAFETY: as the caller says.
        let (query, given) =
            unsafe { (Query::read(options, Uses::OVERLAPS)?, Copied::new(volumes)?) };
        let (state, all) = (look(&object)?, given.all()?);
        let accelerator = &state.accelerator;
        let met = pool::run(query.threads, || {
            Ok(accelerator.overlaps(&all, &query.overlaps(watch(&query.caller)))?)
        })?;
        let mut found = Report::default();
        found.add(&met.report);
        // SAFETY: as the caller says.
        unsafe { keep(lists, ListsObject::TreeOverlaps(met), report, found) }
    })
}

/// Answers whether volumes meet anything, one byte each.
///
/// # Safety
/// `met` has the room, and nobody else uses it.
unsafe fn any(
    given: &Copied,
    met: *mut u8,
    stride: usize,
    query: &Query,
    ask: impl FnOnce(&[Volume<'_>], &mut [bool], Option<&dyn Watch>) -> Result<Report, Failure> + Send,
) -> Result<Report, Failure> {
    let count = given.len();
    // SAFETY: as the caller says.
    let mut wanted = unsafe { Wanted::new(met.cast::<bool>(), stride, count, "met")? };
    given.places.iter().flatten().try_for_each(|places| wanted.apart_from(places))?;
    let (all, mut found) = (given.all()?, crate::buffer::filled(count, false)?);
    let report = pool::run(query.threads, || ask(&all, &mut found, watch(&query.caller)))?;
    found.into_iter().enumerate().for_each(|(place, own)| wanted.set(place, own));
    Ok(report)
}

/// For every volume, whether it meets any triangle: 1 or 0, `met_stride` bytes apart. As `splitplane_tree_overlaps`, without lists.
///
/// Threads: any; one tree may answer many calls at a time.
///
/// # Safety
/// `volumes` and `options` say what is there, `met` has room for a byte for each, and nobody else uses them during the call.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn splitplane_tree_overlaps_any(
    tree: Tree,
    volumes: *const Volumes,
    options: *const QueryOptions,
    met: *mut u8,
    met_stride: usize,
    report: *mut Report,
) -> Status {
    entry(|| {
        check_offer(report, "report")?;
        let object = get(tree)?;
        // SAFETY: as the caller says.
        let (query, given) =
            unsafe { (Query::read(options, Uses::OVERLAPS_ANY)?, Copied::new(volumes)?) };
        let state = look(&object)?;
        let accelerator = &state.accelerator;
        // SAFETY: as the caller says.
        let found = unsafe {
            any(&given, met, met_stride, &query, |all, found, watch| {
                let mut sum = Report::default();
                sum.add(&accelerator.overlaps_any(all, found, &query.overlaps(watch))?);
                Ok(sum)
            })?
        };
        // SAFETY: as the caller says.
        unsafe { offer(report, found, "report") }
    })
}

/// The triangles of instances that every volume meets in the world: a list for each volume in ascending order of (instance, triangle), as of `splitplane_tree_overlaps`.
/// `SPLITPLANE_STATUS_UNSUPPORTED` where an instance that answers is one of shapes.
///
/// Threads: any; one scene may answer many calls at a time.
///
/// # Safety
/// `volumes` and `options` say what is there, and `lists` has room for a handle.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn splitplane_scene_overlaps(
    scene: Scene,
    volumes: *const Volumes,
    options: *const QueryOptions,
    lists: *mut Lists,
) -> Status {
    entry(|| {
        check(lists, "lists")?;
        let object = get(scene)?;
        // SAFETY: as the caller says.
        let (query, given) =
            unsafe { (Query::read(options, Uses::SCENE_OVERLAPS)?, Copied::new(volumes)?) };
        let (state, all) = (current(&object)?, given.all()?);
        let built = &state.built;
        let met = pool::run(query.threads, || {
            built.overlaps(&all, &query.scene_overlaps(watch(&query.caller)))
        })?;
        let none = std::ptr::null_mut();
        // SAFETY: as the caller says.
        unsafe { keep(lists, ListsObject::SceneOverlaps(met), none, Report::default()) }
    })
}

/// For every volume, whether it meets any triangle of an instance: 1 or 0, `met_stride` bytes apart. As `splitplane_scene_overlaps`, without lists.
///
/// Threads: any; one scene may answer many calls at a time.
///
/// # Safety
/// As for `splitplane_tree_overlaps_any`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn splitplane_scene_overlaps_any(
    scene: Scene,
    volumes: *const Volumes,
    options: *const QueryOptions,
    met: *mut u8,
    met_stride: usize,
) -> Status {
    entry(|| {
        let object = get(scene)?;
        // SAFETY: as the caller says.
        let (query, given) =
            unsafe { (Query::read(options, Uses::SCENE_OVERLAPS_ANY)?, Copied::new(volumes)?) };
        let state = current(&object)?;
        let built = &state.built;
        // SAFETY: as the caller says.
        unsafe {
            any(&given, met, met_stride, &query, |all, found, watch| {
                built.overlaps_any(all, found, &query.scene_overlaps(watch))?;
                Ok(Report::default())
            })?;
        }
        Ok(())
    })
}
