//! Opacity masks: parts of triangles that rays pass.

use std::ffi::c_void;

use library::objects::{GeometryId, OpacityMask, Scene as Description, SceneError};

use crate::buffer::{Given, check, check_offer, write};
use crate::entry::entry;
use crate::handle::{Scene, get};
use crate::scene::edit;
use crate::status::{Failure, Status};
use crate::tree::look;

/// Says whether rays meet a place of a triangle, by the weights of its second and third corner: anything but 0 if they do. `user` is that of the call. Called by the thread that
/// makes the call; it must not throw or `longjmp`.
pub type OpacityFunction =
    Option<unsafe extern "C" fn(user: *mut c_void, triangle: u32, u: f32, v: f32) -> i32>;

fn triangles(description: &Description, geometry: u32) -> Result<usize, SceneError> {
    Ok(description.geometry(GeometryId(geometry))?.mesh().len())
}

/// Says which parts of a geometry's triangles count for rays: a triangle has `4^level` cells of one bit each, of which the first of a word is its lowest. Rays pass cells whose bit
/// is 0. Points inside and closest points are those of the whole mesh. Words are those that `splitplane_scene_get_opacity` gives, `triangles * 4^level` bits in all, rounded up
/// to whole words; bits after the last cell are 0. `level` is 12 at most.
///
/// The guide says in which order cells are; `splitplane_scene_make_opacity` makes words of a function.
///
/// Threads: as for `splitplane_scene_add_geometry`.
///
/// # Safety
/// So many words are there.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn splitplane_scene_set_opacity(
    scene: Scene,
    geometry: u32,
    level: u32,
    words: *const u32,
    word_count: usize,
) -> Status {
    entry(|| {
        // SAFETY: as the caller says.
        let given = unsafe { Given::<u32>::new(words, size_of::<u32>(), word_count, "words")? };
        let words = given.packed().unwrap_or_default();
        edit(scene, |description| {
            let count = triangles(description, geometry)?;
            let mask = OpacityMask::of_words(count, level, words)?;
            Ok(description.set_opacity(GeometryId(geometry), Some(mask))?)
        })
    })
}

/// As `splitplane_scene_set_opacity`, of what a function says about the middle of each cell: such as what a texture has there.
///
/// Threads: as for `splitplane_scene_add_geometry`; the function must not use the scene.
///
/// # Safety
/// The function may be called with `user`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn splitplane_scene_make_opacity(
    scene: Scene,
    geometry: u32,
    level: u32,
    function: OpacityFunction,
    user: *mut c_void,
) -> Status {
    entry(|| {
        let function =
            function.ok_or_else(|| Failure::new(Status::NullPointer, "function is NULL"))?;
        edit(scene, |description| {
            let count = triangles(description, geometry)?;
            // SAFETY: as the caller says.
            let says = |triangle, [u, v]: [f32; 2]| unsafe { function(user, triangle, u, v) != 0 };
            let mask = OpacityMask::new(count, level, says)?;
            Ok(description.set_opacity(GeometryId(geometry), Some(mask))?)
        })
    })
}

/// Makes all parts of a geometry's triangles count again.
///
/// Threads: as for `splitplane_scene_add_geometry`.
#[unsafe(no_mangle)]
pub extern "C" fn splitplane_scene_clear_opacity(scene: Scene, geometry: u32) -> Status {
    entry(|| edit(scene, |description| Ok(description.set_opacity(GeometryId(geometry), None)?)))
}

/// The opacity mask of a geometry: `level` gets its level, and `words` its words. `needed`, which may be NULL, gets how many words there are: 0 where all of the geometry counts, of which the level
/// is 0. `SPLITPLANE_STATUS_CAPACITY` where there is room for fewer; with `words` NULL and capacity 0 no words are written.
///
/// Threads: any.
///
/// # Safety
/// `words` has room for `capacity` of them, and `level` for one number.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn splitplane_scene_get_opacity(
    scene: Scene,
    geometry: u32,
    level: *mut u32,
    words: *mut u32,
    capacity: usize,
    needed: *mut usize,
) -> Status {
    entry(|| {
        check(level, "level")?;
        check_offer(needed, "needed")?;
        let object = get(scene)?;
        let state = look(&object)?;
        let mask = state.description.opacity(GeometryId(geometry))?;
        let own = mask.map_or(&[][..], |mask| mask.words());
        let asks = words.is_null() && capacity == 0;
        if asks {
            check(needed, "needed")?;
        } else {
            check(words, "words")?;
        }
        // SAFETY: there is room for both numbers.
        unsafe {
            write(level, mask.map_or(0, |mask| mask.level()), "level")?;
            if !needed.is_null() {
                write(needed, own.len(), "needed")?;
            }
        }
        if asks {
            return Ok(());
        }
        if capacity < own.len() {
            let text = format!("there is room for {capacity} words, and {} are needed", own.len());
            return Err(Failure::new(Status::Capacity, text));
        }
        // SAFETY: there is room for them, and it is not memory of ours.
        unsafe { std::ptr::copy_nonoverlapping(own.as_ptr(), words, own.len()) };
        Ok(())
    })
}
