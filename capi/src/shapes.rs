//! Geometries that are not meshes: spheres, capsules, and shapes that a function of the caller's intersects.

use std::any::Any;
use std::ffi::c_void;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use library::Ray;
use library::core::aabb::Aabb;
use library::core::scene::MAX_INSTANCES;
use library::core::scene::shape::{
    Capsule, OwnShape, ShapeHit as LibraryHit, Shapes as LibraryShapes, Sphere,
};
use library::objects::{GeometryId, Scene as Description};

use crate::buffer::{Given, check, read, reserve, write};
use crate::entry::entry;
use crate::handle::Scene;
use crate::options::{chosen, reserved};
use crate::scene::edit;
use crate::status::{Failure, Status};

/// What a set of shapes consists of.
#[repr(u32)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ShapeKind {
    /// Spheres: 4 numbers each, the centre and the radius.
    Spheres = 0,
    /// Capsules, all points within a radius of a segment: 7 numbers each, both ends of the segment and the radius.
    Capsules = 1,
    /// Shapes of yours: 6 numbers each, the lower and the upper corner of the box that it is in. On the CPU only.
    Own = 2,
}

/// A place where a ray meets a shape of yours.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ShapeHit {
    /// Where on the ray, in units of its direction. It counts where it is finite and between the ray's limits.
    pub t: f32,
    /// Two numbers of yours, which hits carry.
    pub u: f32,
    /// The other one.
    pub v: f32,
    /// Anything but 0 where the ray comes from the front, which culling tells from the back.
    pub front: u32,
}

/// Takes a place where a ray meets a shape: `to` is what the intersect function was given.
pub type ShowHitFunction = Option<unsafe extern "C" fn(to: *mut c_void, hit: *const ShapeHit)>;

/// Intersects a shape of yours: calls `show(to, hit)` for every place where the ray meets it, in any order. `user` is that of the shapes. `ray` is eight floats in the object's space: origin, least t,
/// direction, greatest t; hits beyond the limits are not needed. For the same ray and primitive it has to show the same places, each in the primitive's box to within 2^-16 of (the
/// greatest of the ray's origin, and of the box). Called from any thread, by several at a time; it must not throw, `longjmp`, or keep `ray` and `to`.
pub type IntersectFunction = Option<
    unsafe extern "C" fn(
        user: *mut c_void,
        primitive: u32,
        ray: *const f32,
        show: ShowHitFunction,
        to: *mut c_void,
    ),
>;

/// Told that nothing uses `user` any more. Called once, by any thread, maybe in the middle of a call that changes the scene: it must not throw or `longjmp`, and calls for that scene are `SPLITPLANE_STATUS_BUSY`.
pub type ReleaseFunction = Option<unsafe extern "C" fn(user: *mut c_void)>;

/// A set of shapes. Hits name a shape as they do a triangle. One with a number that is not finite, a radius that is not more than 0 or a box that is empty is left out.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct Shapes {
    /// A `splitplane_shape_kind`.
    pub kind: u32,
    /// 0.
    pub reserved: u32,
    /// Numbers of the first shape. They are copied.
    pub numbers: *const f32,
    /// Bytes from one shape to the next.
    pub stride: usize,
    /// How many shapes, less than 2^28.
    pub count: usize,
    /// Intersects shapes of yours; NULL for others.
    pub intersect: IntersectFunction,
    /// Handed to it.
    pub user: *mut c_void,
    /// Told when the library is done with `user`: the scene is freed or has other shapes, and no call uses them. May be NULL. Not called where the call fails that was given the shapes.
    pub release: ReleaseFunction,
}

/// Shapes of the caller's.
struct Own {
    bounds: Vec<[f32; 6]>,
    intersect: unsafe extern "C" fn(*mut c_void, u32, *const f32, ShowHitFunction, *mut c_void),
    user: *mut c_void,
    release: ReleaseFunction,
    /// Whether a scene has taken them.
    taken: AtomicBool,
}

// SAFETY: the functions may be called from any thread, as their documentation says.
unsafe impl Send for Own {}
// SAFETY: as above.
unsafe impl Sync for Own {}

/// Where hits go while a function of the caller's runs.
struct Sink<'a> {
    show: &'a mut dyn FnMut(LibraryHit),
    panic: Option<Box<dyn Any + Send>>,
}

unsafe extern "C" fn show(to: *mut c_void, hit: *const ShapeHit) {
    if to.is_null() || hit.is_null() || !hit.is_aligned() {
        return;
    }
    // SAFETY: it is what the intersect function was given, and its call has not ended.
    let (sink, ShapeHit { t, u, v, front }) = unsafe { (&mut *to.cast::<Sink<'_>>(), *hit) };
    let shown = catch_unwind(AssertUnwindSafe(|| {
        (sink.show)(LibraryHit { t, u, v, front: front != 0 });
    }));
    if let Err(panic) = shown {
        sink.panic = Some(panic);
    }
}

impl OwnShape for Own {
    fn primitives(&self) -> u32 {
        self.bounds.len() as u32
    }

    fn bounds(&self, primitive: u32) -> Aabb {
        let [a, b, c, x, y, z] = self.bounds[primitive as usize];
        Aabb { lo: [a, b, c], hi: [x, y, z] }
    }

    fn intersect(&self, primitive: u32, ray: &Ray, take: &mut dyn FnMut(LibraryHit)) {
        let mut sink = Sink { show: take, panic: None };
        let to: *mut Sink<'_> = &raw mut sink;
        // SAFETY: a ray is eight floats; the caller of the entry vouches for the function.
        unsafe {
            (self.intersect)(self.user, primitive, (&raw const *ray).cast(), Some(show), to.cast());
        }
        // Only now, since nothing may unwind through the function.
        if let Some(panic) = sink.panic {
            resume_unwind(panic);
        }
    }
}

impl Drop for Own {
    fn drop(&mut self) {
        if let Some(release) = self.release.filter(|_| self.taken.load(Ordering::Acquire)) {
            // SAFETY: nothing uses the shapes any more, and the caller vouched for the function.
            unsafe { release(self.user) };
        }
    }
}

/// Numbers of shapes.
///
/// # Safety
/// As for [`Given::new`].
unsafe fn copied<T: bytemuck::Pod>(own: &Shapes) -> Result<Vec<T>, Failure> {
    let (first, stride, count) = (own.numbers.cast(), own.stride, own.count);
    // SAFETY: as the caller says.
    let given = unsafe { Given::<T>::new(first, stride, count, "numbers")? };
    let mut copy = Vec::new();
    reserve(&mut copy, count)?;
    copy.extend((0..count).map(|place| given.at(place)));
    Ok(copy)
}

/// The shapes of a call, and those of the caller's own once more.
///
/// # Safety
/// What the record says is memory that nobody writes, and functions that can be called with `user`.
unsafe fn shapes(shapes: *const Shapes) -> Result<(LibraryShapes, Option<Arc<Own>>), Failure> {
    // SAFETY: as the caller says.
    let own = unsafe { read(shapes, "shapes")? };
    reserved(own.reserved)?;
    let kinds = [ShapeKind::Spheres, ShapeKind::Capsules, ShapeKind::Own];
    let kind = chosen(own.kind, &kinds.map(|kind| (kind as u32, kind)), "kind of shapes")?;
    if own.count >= MAX_INSTANCES {
        let text = format!("{} shapes are too many: a set has fewer than 2^28", own.count);
        return Err(Failure::new(Status::Count, text));
    }
    if kind != ShapeKind::Own
        && (own.intersect.is_some() || own.release.is_some() || !own.user.is_null())
    {
        let text =
            "shapes: `intersect`, `user` and `release` mean nothing for spheres and capsules";
        return Err(Failure::new(Status::Option, text));
    }
    // SAFETY: as the caller says.
    unsafe {
        match kind {
            ShapeKind::Spheres => Ok((LibraryShapes::Spheres(copied::<Sphere>(&own)?), None)),
            ShapeKind::Capsules => Ok((LibraryShapes::Capsules(copied::<Capsule>(&own)?), None)),
            ShapeKind::Own => {
                let missing = || Failure::new(Status::NullPointer, "shapes: `intersect` is NULL");
                let intersect = own.intersect.ok_or_else(missing)?;
                let (bounds, user, release) = (copied(&own)?, own.user, own.release);
                let taken = AtomicBool::new(false);
                let mine = Arc::new(Own { bounds, intersect, user, release, taken });
                Ok((LibraryShapes::Own(mine.clone()), Some(mine)))
            }
        }
    }
}

/// Hands shapes to a description, which then has them.
///
/// # Safety
/// As for [`shapes`].
unsafe fn hand<T>(
    scene: Scene,
    record: *const Shapes,
    work: impl FnOnce(&mut Description, LibraryShapes) -> Result<T, Failure>,
) -> Result<T, Failure> {
    // SAFETY: as the caller says.
    let (shapes, mine) = unsafe { shapes(record)? };
    edit(scene, |description| {
        let done = work(description, shapes)?;
        if let Some(mine) = mine {
            mine.taken.store(true, Ordering::Release);
        }
        Ok(done)
    })
}

/// Adds a geometry of shapes. `geometry` gets its number.
///
/// Threads: as for `splitplane_scene_add_geometry`.
///
/// # Safety
/// `shapes` says what is there, its functions can be called with its `user` until it is released, and `geometry` has room.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn splitplane_scene_add_shapes(
    scene: Scene,
    shapes: *const Shapes,
    geometry: *mut u32,
) -> Status {
    entry(|| {
        check(geometry, "geometry")?;
        // SAFETY: as the caller says.
        let name = unsafe { hand(scene, shapes, |to, shapes| Ok(to.add_shapes(shapes)?))? };
        // SAFETY: there is room.
        unsafe { write(geometry, name.0, "geometry") }
    })
}

/// Gives a geometry of shapes another set of any kind; its instances stay.
///
/// Threads: as for `splitplane_scene_add_geometry`.
///
/// # Safety
/// As for `splitplane_scene_add_shapes`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn splitplane_scene_replace_shapes(
    scene: Scene,
    geometry: u32,
    shapes: *const Shapes,
) -> Status {
    entry(|| {
        let name = GeometryId(geometry);
        // SAFETY: as the caller says.
        unsafe { hand(scene, shapes, |to, shapes| Ok(to.replace_shapes(name, shapes)?)) }
    })
}
