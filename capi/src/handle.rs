//! Handles: numbers that name objects in a table, so that a handle that is dead or made up is found out without touching what it names.

use std::any::Any;
use std::sync::{Arc, PoisonError, RwLock};

use crate::entry::entry;
use crate::status::{Failure, Status};

/// Bits of a handle that are a place in the table; the others count how often it was used.
const PLACE_BITS: u32 = 24;
const PLACES: usize = 1 << PLACE_BITS;
const USES: u64 = 1 << (64 - PLACE_BITS);

type Object = Arc<dyn Any + Send + Sync>;

struct Slot {
    uses: u64,
    object: Option<Object>,
}

struct Table {
    slots: Vec<Slot>,
    free: Vec<u32>,
}

static TABLE: RwLock<Table> = RwLock::new(Table { slots: Vec::new(), free: Vec::new() });

/// A handle of C's.
pub(crate) trait Handle: Copy {
    /// What it names.
    type Object: Any + Send + Sync;
    /// Its name in messages.
    const NAME: &str;
    fn id(self) -> u64;
    fn of(id: u64) -> Self;
}

macro_rules! handle {
    ($handle:ident, $name:literal, $object:ty) => {
        impl Handle for $handle {
            type Object = $object;
            const NAME: &str = $name;
            fn id(self) -> u64 {
                self.id
            }
            fn of(id: u64) -> Self {
                $handle { id }
            }
        }
    };
}

/// An opened backend. 0 names none, as in all handles.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Backend {
    /// A number that means nothing.
    pub id: u64,
}

/// A tree over one mesh.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Tree {
    /// A number that means nothing.
    pub id: u64,
}

/// A scene of many objects.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Scene {
    /// A number that means nothing.
    pub id: u64,
}

/// A tree of points.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PointTree {
    /// A number that means nothing.
    pub id: u64,
}

/// Answers of different length: a list of records for each ray or point that was asked for.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Lists {
    /// A number that means nothing.
    pub id: u64,
}

handle!(Backend, "backend", crate::backend::Opened);
handle!(Tree, "tree", crate::tree::Object);
handle!(Scene, "scene", crate::scene::Object);
handle!(PointTree, "point tree", crate::points::Object);
handle!(Lists, "lists", crate::lists::Object);

fn dead<H: Handle>(handle: H) -> Failure {
    let text = format!("{:#x} is no handle of a {}, or was freed", handle.id(), H::NAME);
    Failure::new(Status::Handle, text)
}

/// Puts an object into the table.
pub(crate) fn insert<H: Handle>(object: H::Object) -> Result<H, Failure> {
    let object: Object = Arc::new(object);
    let mut table = TABLE.write().unwrap_or_else(PoisonError::into_inner);
    let Table { slots, free } = &mut *table;
    let place = match free.pop() {
        Some(place) => place as usize,
        None => {
            let full = || Failure::new(Status::OutOfMemory, "there are too many objects");
            if slots.len() == PLACES {
                return Err(full());
            }
            // Then to free an object needs no memory.
            slots.try_reserve(1).map_err(|_| full())?;
            free.try_reserve(slots.len() + 1).map_err(|_| full())?;
            slots.push(Slot { uses: 1, object: None });
            slots.len() - 1
        }
    };
    slots[place].object = Some(object);
    Ok(H::of(slots[place].uses << PLACE_BITS | place as u64))
}

fn split(id: u64) -> (usize, u64) {
    (id as usize & (PLACES - 1), id >> PLACE_BITS)
}

/// The object of a handle. Whoever holds it keeps it, though it be freed meanwhile.
pub(crate) fn get<H: Handle>(handle: H) -> Result<Arc<H::Object>, Failure> {
    let (place, uses) = split(handle.id());
    let found = {
        let table = TABLE.read().unwrap_or_else(PoisonError::into_inner);
        let slot = table.slots.get(place).filter(|slot| slot.uses == uses);
        slot.and_then(|slot| slot.object.clone())
    };
    found.and_then(|object| object.downcast().ok()).ok_or_else(|| dead(handle))
}

/// Takes an object out of the table; its memory goes when the last call that uses it ends. The handle 0 is no mistake.
pub(crate) fn free<H: Handle>(handle: H) -> Result<(), Failure> {
    if handle.id() == 0 {
        return Ok(());
    }
    let (place, uses) = split(handle.id());
    let object = {
        let mut table = TABLE.write().unwrap_or_else(PoisonError::into_inner);
        let Table { slots, free } = &mut *table;
        let slot = slots.get_mut(place).filter(|slot| slot.uses == uses);
        let slot =
            slot.filter(|slot| slot.object.as_ref().is_some_and(|own| own.is::<H::Object>()));
        let slot = slot.ok_or_else(|| dead(handle))?;
        slot.uses += 1;
        let object = slot.object.take();
        // A place whose uses are counted out is not used again.
        if slot.uses < USES {
            free.push(place as u32);
        }
        object
    };
    drop(object);
    Ok(())
}

/// How many objects there are: handles that were given and not freed. For tests of who frees what.
///
/// Threads: any.
#[unsafe(no_mangle)]
pub extern "C" fn splitplane_live_handles() -> u64 {
    let mut live = 0;
    entry(|| {
        let table = TABLE.read().unwrap_or_else(PoisonError::into_inner);
        live = table.slots.iter().filter(|slot| slot.object.is_some()).count() as u64;
        Ok(())
    });
    live
}
