//! Scenes of many objects: their description, which is edited, and what is built of it.

use std::ffi::c_char;
use std::sync::{Arc, RwLock, RwLockReadGuard};

use library::objects::file::SceneFile;
use library::objects::{
    GeometryId, Instance as Described, InstanceId, Scene as Description, TopUpdate,
    UpdateReport as LibraryReport,
};
use library::{BuildOptions as LibraryBuildOptions, LoadOptions};

use crate::backend::{Opened, hand_over};
use crate::buffer::{check, check_offer, offer, read, text, write};
use crate::build_settings::Build;
use crate::built::Built;
use crate::edits::Edits;
use crate::entry::entry;
use crate::handle::{Backend, Scene, free, get, insert};
use crate::mesh::{Copies, Mesh};
use crate::options::{BuildOptions, CULLINGS, chosen};
use crate::pool;
use crate::status::{Failure, Status};
use crate::tree::{change, fetch, look, memory, store};

/// A scene and its backend.
pub struct State {
    pub(crate) description: Description,
    pub(crate) built: Built,
    pub(crate) opened: Arc<Opened>,
    pub(crate) edits: Edits,
}

/// What a handle of a scene names.
pub type Object = RwLock<State>;

/// Looks at a scene whose edits have been tried: where their update failed, it answers without them.
pub(crate) fn current(object: &Object) -> Result<RwLockReadGuard<'_, State>, Failure> {
    let state = look(object)?;
    match state.edits {
        Edits::Taken | Edits::Refused => Ok(state),
        Edits::Waiting => {
            let text = "the scene was edited since its last update: call splitplane_scene_update";
            Err(Failure::new(Status::Stale, text))
        }
    }
}

/// A geometry, placed in the world.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Instance {
    /// From the object to the world: three rows of four, the last column is the translation. It has to have an inverse.
    pub transform: [f32; 12],
    /// The geometry.
    pub geometry: u32,
    /// Queries enter the instance when a bit of their mask is in this one.
    pub mask: u32,
    /// A number of yours, which means nothing here.
    pub id: u32,
    /// A `splitplane_culling`: the side that this instance ignores, whatever the query.
    pub culling: u32,
}

impl Instance {
    fn described(&self) -> Result<Described, Failure> {
        let rows = self.transform.as_chunks::<4>().0;
        let (geometry, transform) = (GeometryId(self.geometry), [rows[0], rows[1], rows[2]]);
        let culling = chosen(self.culling, &CULLINGS, "culling")?;
        Ok(Described { geometry, transform, mask: self.mask, id: self.id, culling })
    }

    fn of(own: &Described) -> Instance {
        let mut transform = [0.0; 12];
        transform.copy_from_slice(own.transform.as_flattened());
        let culling = CULLINGS.iter().find(|(_, meaning)| *meaning == own.culling);
        let culling = culling.map_or(0, |(number, _)| *number);
        Instance { transform, geometry: own.geometry.0, mask: own.mask, id: own.id, culling }
    }
}

/// What an update did.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct UpdateReport {
    /// Geometries that were built.
    pub geometries_built: u32,
    /// Geometries that were dropped.
    pub geometries_dropped: u32,
    /// Instances that came, went or changed.
    pub instances_changed: u32,
    /// 1 where the tree over the instances was built anew.
    pub top_rebuilt: u32,
    /// Nodes of that tree that have new boxes.
    pub top_nodes_changed: u64,
}

/// Makes a scene without anything.
///
/// Threads: any.
///
/// # Safety
/// `scene` has room for a handle.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn splitplane_scene_create(backend: Backend, scene: *mut Scene) -> Status {
    entry(|| {
        check(scene, "scene")?;
        let (opened, description) = (get(backend)?, Description::new());
        let built = opened.backend().build_scene(&description, &LibraryBuildOptions::default())?;
        let built = Built::Whole(built);
        let state = State { description, built, opened, edits: Edits::Taken };
        // SAFETY: there is room.
        unsafe { write(scene, insert(RwLock::new(state))?, "scene") }
    })
}

/// Frees a scene. 0 is no mistake.
///
/// Threads: any; calls that use it go on.
#[unsafe(no_mangle)]
pub extern "C" fn splitplane_scene_free(scene: Scene) -> Status {
    entry(|| free(scene))
}

/// Edits a description. An edit that fails changes nothing.
pub(crate) fn edit<T>(
    scene: Scene,
    work: impl FnOnce(&mut Description) -> Result<T, Failure>,
) -> Result<T, Failure> {
    let object = get(scene)?;
    let mut state = change(&object)?;
    let done = work(&mut state.description)?;
    state.edits = Edits::Waiting;
    Ok(done)
}

/// Adds a geometry: a copy of a mesh. `geometry` gets its number; those of removed ones are used again.
///
/// Threads: any, while no other call uses the scene: else `SPLITPLANE_STATUS_BUSY`.
///
/// # Safety
/// `mesh` says what is there, and `geometry` has room.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn splitplane_scene_add_geometry(
    scene: Scene,
    mesh: *const Mesh,
    geometry: *mut u32,
) -> Status {
    entry(|| {
        check(geometry, "geometry")?;
        let mut copies = Copies::default();
        // SAFETY: as the caller says.
        let mesh = unsafe { copies.mesh(mesh)? };
        let name = edit(scene, |description| Ok(description.add_mesh(&mesh)?))?;
        // SAFETY: there is room.
        unsafe { write(geometry, name.0, "geometry") }
    })
}

/// Gives a geometry another mesh; its instances stay.
///
/// Threads: as for `splitplane_scene_add_geometry`.
///
/// # Safety
/// `mesh` says what is there.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn splitplane_scene_replace_geometry(
    scene: Scene,
    geometry: u32,
    mesh: *const Mesh,
) -> Status {
    entry(|| {
        let mut copies = Copies::default();
        // SAFETY: as the caller says.
        let mesh = unsafe { copies.mesh(mesh)? };
        edit(scene, |description| Ok(description.replace_mesh(GeometryId(geometry), &mesh)?))
    })
}

/// Removes a geometry that has no instances.
///
/// Threads: as for `splitplane_scene_add_geometry`.
#[unsafe(no_mangle)]
pub extern "C" fn splitplane_scene_remove_geometry(scene: Scene, geometry: u32) -> Status {
    entry(|| edit(scene, |description| Ok(description.remove_geometry(GeometryId(geometry))?)))
}

/// Adds an instance. `number` gets its number; those of removed ones are used again.
///
/// Threads: as for `splitplane_scene_add_geometry`.
///
/// # Safety
/// `instance` is there, and `number` has room.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn splitplane_scene_add_instance(
    scene: Scene,
    instance: *const Instance,
    number: *mut u32,
) -> Status {
    entry(|| {
        check(number, "number")?;
        // SAFETY: as the caller says.
        let described = unsafe { read(instance, "instance")? }.described()?;
        let name = edit(scene, |description| Ok(description.add_instance(described)?))?;
        // SAFETY: there is room.
        unsafe { write(number, name.0, "number") }
    })
}

/// Replaces all that an instance is, its geometry included.
///
/// Threads: as for `splitplane_scene_add_geometry`.
///
/// # Safety
/// `instance` is there.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn splitplane_scene_set_instance(
    scene: Scene,
    number: u32,
    instance: *const Instance,
) -> Status {
    entry(|| {
        // SAFETY: as the caller says.
        let described = unsafe { read(instance, "instance")? }.described()?;
        edit(scene, |description| Ok(description.set_instance(InstanceId(number), described)?))
    })
}

/// Gives an instance another transform: 12 numbers, as in `splitplane_instance`.
///
/// Threads: as for `splitplane_scene_add_geometry`.
///
/// # Safety
/// 12 numbers are there.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn splitplane_scene_move_instance(
    scene: Scene,
    number: u32,
    transform: *const f32,
) -> Status {
    entry(|| {
        // SAFETY: as the caller says.
        let rows: [[f32; 4]; 3] = unsafe { read(transform.cast(), "transform")? };
        edit(scene, |description| Ok(description.move_instance(InstanceId(number), rows)?))
    })
}

/// Removes an instance.
///
/// Threads: as for `splitplane_scene_add_geometry`.
#[unsafe(no_mangle)]
pub extern "C" fn splitplane_scene_remove_instance(scene: Scene, number: u32) -> Status {
    entry(|| edit(scene, |description| Ok(description.remove_instance(InstanceId(number))?)))
}

/// What an instance is.
///
/// Threads: any.
///
/// # Safety
/// `instance` has room.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn splitplane_scene_instance(
    scene: Scene,
    number: u32,
    instance: *mut Instance,
) -> Status {
    entry(|| {
        check(instance, "instance")?;
        let object = get(scene)?;
        let found = Instance::of(look(&object)?.description.instance(InstanceId(number))?);
        // SAFETY: there is room.
        unsafe { write(instance, found, "instance") }
    })
}

/// Brings a scene up to date with its edits: only what changed is made anew. After a failure queries answer as they did before it, and the edits stay: mend or undo them, and update again. `options` and `report` may be NULL.
/// A lazy scene has the settings that it was created with, so its `options` have to be NULL; nothing is built, and the report is 0.
///
/// Threads: as for `splitplane_scene_add_geometry`.
///
/// # Safety
/// `options` says what is there, and `report` has room.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn splitplane_scene_update(
    scene: Scene,
    options: *const BuildOptions,
    report: *mut UpdateReport,
) -> Status {
    entry(|| {
        check_offer(report, "report")?;
        let object = get(scene)?;
        let given = !options.is_null();
        // SAFETY: as the caller says.
        let build = unsafe { Build::read(options)? };
        let (mut state, options) = (change(&object)?, build.options());
        if given && matches!(state.built, Built::Lazy(_)) {
            let text = "options: a lazy scene has the settings that it was created with";
            return Err(Failure::new(Status::Option, text));
        }
        let State { description, built, opened, edits } = &mut *state;
        let done = match built {
            Built::Whole(built) => pool::run(build.threads, || {
                Ok(opened.backend().update_scene(&mut **built, description, &options)?)
            }),
            Built::Lazy(lazy) => match lazy.update(description) {
                Ok(()) => Ok(LibraryReport::default()),
                Err(error) => Err(error.into()),
            },
        };
        *edits = edits.after_update(done.is_ok());
        let done = done.map_err(Failure::of_update)?;
        let found = UpdateReport {
            geometries_built: done.geometries_built,
            geometries_dropped: done.geometries_dropped,
            instances_changed: done.instances_changed,
            top_rebuilt: u32::from(done.top == TopUpdate::Rebuilt),
            top_nodes_changed: done.top_nodes_changed,
        };
        // SAFETY: as the caller says.
        unsafe { offer(report, found, "report") }
    })
}

/// The digest of a scene: of its geometries' trees and of its instances. Builds all of a lazy scene, as files do.
///
/// Threads: any.
///
/// # Safety
/// `digest` has room.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn splitplane_scene_digest(scene: Scene, digest: *mut u64) -> Status {
    entry(|| {
        check(digest, "digest")?;
        let object = get(scene)?;
        let found = current(&object)?.built.digest()?.0;
        // SAFETY: there is room.
        unsafe { write(digest, found, "digest") }
    })
}

fn file_of(scene: Scene) -> Result<Vec<u8>, Failure> {
    let object = get(scene)?;
    let state = current(&object)?;
    state.built.to_bytes()
}

/// Writes a scene file: meshes, trees and instances.
///
/// Threads: any.
///
/// # Safety
/// `path` ends with a 0.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn splitplane_scene_save(scene: Scene, path: *const c_char) -> Status {
    entry(|| {
        // SAFETY: as the caller says.
        let path = unsafe { text(path, "path")? };
        store(path, &file_of(scene)?)
    })
}

/// Writes the bytes of a scene file into memory, as `splitplane_tree_write` does.
///
/// Threads: any.
///
/// # Safety
/// `bytes` has room for `capacity`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn splitplane_scene_write(
    scene: Scene,
    bytes: *mut u8,
    capacity: usize,
    needed: *mut usize,
) -> Status {
    // SAFETY: as the caller says.
    entry(|| unsafe { hand_over(&file_of(scene)?, bytes, capacity, needed) })
}

/// Makes a scene of a scene file, without building trees of geometries. Of `options` preset and knobs stay the defaults.
///
/// Threads: any.
///
/// # Safety
/// `path` ends with a 0, `options` says what is there, and `scene` has room for a handle.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn splitplane_scene_load(
    backend: Backend,
    path: *const c_char,
    options: *const BuildOptions,
    scene: *mut Scene,
) -> Status {
    entry(|| {
        check(scene, "scene")?;
        let opened = get(backend)?;
        // SAFETY: as the caller says.
        unsafe { load(opened, fetch(text(path, "path")?)?.bytes(), options, scene) }
    })
}

/// As `splitplane_scene_load`, of the bytes of a file that are in memory, such as a file that you mapped. They start at a multiple of 4, and are not needed after the call.
///
/// Threads: any.
///
/// # Safety
/// As for `splitplane_scene_load`, and so many bytes are there.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn splitplane_scene_load_memory(
    backend: Backend,
    bytes: *const u8,
    size: usize,
    options: *const BuildOptions,
    scene: *mut Scene,
) -> Status {
    entry(|| {
        check(scene, "scene")?;
        let opened = get(backend)?;
        // SAFETY: as the caller says.
        unsafe { load(opened, memory(bytes, size)?, options, scene) }
    })
}

/// # Safety
/// `options` says what is there, and `scene` has room for a handle.
unsafe fn load(
    opened: Arc<Opened>,
    bytes: &[u8],
    options: *const BuildOptions,
    scene: *mut Scene,
) -> Result<(), Failure> {
    // SAFETY: as the caller says.
    let build = unsafe { Build::read(options)? };
    build.for_loading()?;
    let limits: LoadOptions<'_> = build.options().for_loading();
    let (description, built) = pool::run(build.threads, || {
        Ok(opened.backend().load_scene(&SceneFile::parse(bytes)?, &limits)?)
    })?;
    let built = Built::Whole(built);
    let state = State { description, built, opened, edits: Edits::Taken };
    // SAFETY: there is room.
    unsafe { write(scene, insert(RwLock::new(state))?, "scene") }
}
