//! Answers of unknown length. A query keeps them behind a handle; a second call writes them where the caller has made room.

use library::objects::{SceneAllHits, SceneOverlaps};
use library::points::Neighbour as Near;
use library::{AllHits, Overlaps};

use crate::buffer::{Wanted, check, write};
use crate::entry::entry;
use crate::handle::{Lists, free, get};
use crate::options::NONE;
use crate::record::{Crossing, Neighbour};
use crate::status::{Failure, Status};
use crate::volumes::Overlap;

/// What a handle of lists names.
pub enum Object {
    /// Crossings with a mesh.
    Tree(AllHits),
    /// Crossings with a scene.
    Scene(SceneAllHits),
    /// Triangles of a mesh that volumes meet.
    TreeOverlaps(Overlaps),
    /// Triangles of instances that volumes meet.
    SceneOverlaps(SceneOverlaps),
    /// Points.
    Points {
        /// Where the records of each query begin, and how many there are.
        starts: Vec<usize>,
        /// All of them.
        found: Vec<Near>,
    },
}

impl Object {
    fn starts(&self) -> &[usize] {
        match self {
            Object::Tree(all) => &all.starts,
            Object::Scene(all) => &all.starts,
            Object::TreeOverlaps(all) => &all.starts,
            Object::SceneOverlaps(all) => &all.starts,
            Object::Points { starts, .. } => starts,
        }
    }

    fn records(&self) -> usize {
        match self {
            Object::Tree(all) => all.crossings.len(),
            Object::Scene(all) => all.crossings.len(),
            Object::TreeOverlaps(all) => all.triangles.len(),
            Object::SceneOverlaps(all) => all.triangles.len(),
            Object::Points { found, .. } => found.len(),
        }
    }
}

/// How many lists there are, one for each ray or point that was asked for, and how many records they have together.
///
/// Threads: any.
///
/// # Safety
/// There is room for both numbers.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn splitplane_lists_size(
    lists: Lists,
    list_count: *mut usize,
    record_count: *mut usize,
) -> Status {
    entry(|| {
        check(list_count, "list_count")?;
        check(record_count, "record_count")?;
        let object = get(lists)?;
        // SAFETY: as the caller says.
        unsafe {
            write(list_count, object.starts().len() - 1, "list_count")?;
            write(record_count, object.records(), "record_count")
        }
    })
}

fn room(capacity: usize, needed: usize) -> Result<(), Failure> {
    match capacity >= needed {
        true => Ok(()),
        false => {
            let text = format!("there is room for {capacity} items, and {needed} are needed");
            Err(Failure::new(Status::Capacity, text))
        }
    }
}

/// Writes where the records of each list begin, followed by how many records there are: one number more than lists. List `i` has the records `starts[i]` up to, and without, `starts[i + 1]`.
///
/// Threads: any.
///
/// # Safety
/// `starts` has room for `capacity` numbers.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn splitplane_lists_starts(
    lists: Lists,
    starts: *mut u64,
    capacity: usize,
) -> Status {
    entry(|| {
        let object = get(lists)?;
        let own = object.starts();
        check(starts, "starts")?;
        room(capacity, own.len())?;
        // SAFETY: there is room, and what is not needed is not touched.
        let mut wanted = unsafe { Wanted::new(starts, size_of::<u64>(), own.len(), "starts")? };
        own.iter().enumerate().for_each(|(place, &start)| wanted.set(place, start as u64));
        Ok(())
    })
}

fn other_kind(asked: &str) -> Failure {
    Failure::new(Status::Handle, format!("these lists do not have {asked}"))
}

/// Writes the crossings of all lists, `crossing_stride` bytes apart: 28 where nothing is between them.
///
/// Threads: any.
///
/// # Safety
/// `crossings` has room for `capacity` records.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn splitplane_lists_crossings(
    lists: Lists,
    crossings: *mut Crossing,
    crossing_stride: usize,
    capacity: usize,
) -> Status {
    entry(|| {
        let object = get(lists)?;
        room(capacity, object.records())?;
        let (stride, count) = (crossing_stride, object.records());
        // SAFETY: as the caller says.
        let mut wanted = unsafe { Wanted::new(crossings, stride, count, "crossings")? };
        match &*object {
            Object::Tree(all) => {
                for (place, own) in all.crossings.iter().enumerate() {
                    let (hit, front) = (own.hit, u32::from(own.front));
                    let (t, triangle, u, v) = (hit.t, hit.triangle, hit.u, hit.v);
                    let (geometry, instance) = (NONE, NONE);
                    wanted.set(place, Crossing { t, triangle, u, v, geometry, instance, front });
                }
            }
            Object::Scene(all) => {
                for (place, own) in all.crossings.iter().enumerate() {
                    let (hit, front) = (own.hit, u32::from(own.front));
                    let (t, triangle, u, v) = (hit.t, hit.triangle, hit.u, hit.v);
                    let (geometry, instance) = (hit.geometry, hit.instance);
                    wanted.set(place, Crossing { t, triangle, u, v, geometry, instance, front });
                }
            }
            _ => return Err(other_kind("crossings")),
        }
        Ok(())
    })
}

/// Writes the triangles of all lists that volumes meet, `overlap_stride` bytes apart: 8 where nothing is between them.
///
/// Threads: any.
///
/// # Safety
/// `overlaps` has room for `capacity` records.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn splitplane_lists_overlaps(
    lists: Lists,
    overlaps: *mut Overlap,
    overlap_stride: usize,
    capacity: usize,
) -> Status {
    entry(|| {
        let object = get(lists)?;
        let count = object.records();
        if !matches!(&*object, Object::TreeOverlaps(_) | Object::SceneOverlaps(_)) {
            return Err(other_kind("triangles that volumes meet"));
        }
        room(capacity, count)?;
        // SAFETY: as the caller says.
        let mut wanted = unsafe { Wanted::new(overlaps, overlap_stride, count, "overlaps")? };
        let mut set = |place, triangle, instance| wanted.set(place, Overlap { triangle, instance });
        match &*object {
            Object::TreeOverlaps(all) => {
                all.triangles.iter().enumerate().for_each(|(place, own)| set(place, *own, NONE));
            }
            Object::SceneOverlaps(all) => {
                let all = all.triangles.iter().enumerate();
                all.for_each(|(place, own)| set(place, own.triangle, own.instance));
            }
            _ => {}
        }
        Ok(())
    })
}

/// Writes the points of all lists, `neighbour_stride` bytes apart: 16 where nothing is between them.
///
/// Threads: any.
///
/// # Safety
/// `neighbours` has room for `capacity` records.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn splitplane_lists_neighbours(
    lists: Lists,
    neighbours: *mut Neighbour,
    neighbour_stride: usize,
    capacity: usize,
) -> Status {
    entry(|| {
        let object = get(lists)?;
        let Object::Points { found, .. } = &*object else { return Err(other_kind("points")) };
        room(capacity, found.len())?;
        let (stride, count) = (neighbour_stride, found.len());
        // SAFETY: as the caller says.
        let mut wanted = unsafe { Wanted::new(neighbours, stride, count, "neighbours")? };
        found.iter().enumerate().for_each(|(place, own)| wanted.set(place, Neighbour::of(own)));
        Ok(())
    })
}

impl Neighbour {
    pub(crate) fn of(own: &Near) -> Neighbour {
        let Near { distance_squared, point } = *own;
        Neighbour { distance_squared, point, reserved: 0 }
    }
}

/// Frees lists. 0 is no mistake.
///
/// Threads: any.
#[unsafe(no_mangle)]
pub extern "C" fn splitplane_lists_free(lists: Lists) -> Status {
    entry(|| free(lists))
}
