//! Trees over one mesh: builds and files.

use std::ffi::c_char;
use std::sync::{Arc, RwLock, RwLockReadGuard, RwLockWriteGuard, TryLockError};

use library::core::tree::file::{self, TreeFile};
use library::core::tree::validate::validate_mesh;
use library::{Accelerator, LoadOptions};

use crate::backend::{Opened, hand_over};
use crate::buffer::{Given, check, filled, text, write};
use crate::build_settings::Build;
use crate::entry::entry;
use crate::handle::{Backend, Tree, free, get, insert};
use crate::mesh::{Copies, Mesh};
use crate::options::BuildOptions;
use crate::pool;
use crate::status::{Failure, Status};

/// A tree and its backend.
pub struct State {
    pub(crate) accelerator: Box<dyn Accelerator>,
    pub(crate) opened: Arc<Opened>,
}

/// What a handle of a tree names.
pub type Object = RwLock<State>;

fn busy() -> Failure {
    let text =
        "another thread is changing this object, or asking it while this call would change it";
    Failure::new(Status::Busy, text)
}

/// Looks at an object that nobody is changing. What a panic left is as usable as what an error left.
pub(crate) fn look<T>(object: &RwLock<T>) -> Result<RwLockReadGuard<'_, T>, Failure> {
    match object.try_read() {
        Ok(guard) => Ok(guard),
        Err(TryLockError::Poisoned(broken)) => Ok(broken.into_inner()),
        Err(TryLockError::WouldBlock) => Err(busy()),
    }
}

/// Changes an object that nobody is looking at.
pub(crate) fn change<T>(object: &RwLock<T>) -> Result<RwLockWriteGuard<'_, T>, Failure> {
    match object.try_write() {
        Ok(guard) => Ok(guard),
        Err(TryLockError::Poisoned(broken)) => Ok(broken.into_inner()),
        Err(TryLockError::WouldBlock) => Err(busy()),
    }
}

/// What a build did with its input, and what came of it.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TreeSummary {
    /// Triangles of the mesh.
    pub triangles: u32,
    /// Triangles left out: a coordinate that is not finite, or two equal corners.
    pub dropped: u32,
    /// Triangles with a coordinate that was snapped to 0: less than 2^-126.
    pub snapped: u32,
    /// 0.
    pub reserved: u32,
    /// Nodes of the tree.
    pub nodes: u64,
    /// References of its leaves to triangles.
    pub references: u64,
    /// Most bytes that the build held at once besides your arrays.
    pub peak_bytes: u64,
    /// Bytes that queries read.
    pub query_bytes: u64,
    /// Lower corner of the box around all triangles that are kept.
    pub lower: [f32; 3],
    /// Upper corner.
    pub upper: [f32; 3],
}

/// Builds a tree over a mesh. It has its own copy of what it needs: your arrays may go or change after the call. `options` may be NULL for the defaults.
///
/// Threads: any.
///
/// # Safety
/// `mesh` and `options` say what is there, and `tree` has room for a handle.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn splitplane_tree_build(
    backend: Backend,
    mesh: *const Mesh,
    options: *const BuildOptions,
    tree: *mut Tree,
) -> Status {
    entry(|| {
        check(tree, "tree")?;
        let (opened, mut copies) = (get(backend)?, Copies::default());
        // SAFETY: as the caller says.
        let (build, mesh) = unsafe { (Build::read(options)?, copies.mesh(mesh)?) };
        let options = build.options();
        let built = pool::run(build.threads, || Ok(opened.backend().build(&mesh, &options)?))?;
        let handle = insert(RwLock::new(State { accelerator: built, opened }))?;
        // SAFETY: there is room.
        unsafe { write(tree, handle, "tree") }
    })
}

/// Builds a tree again, over another mesh or the same one that changed, in the memory that it has where nothing can cancel the build. After a failure the tree is what it was.
///
/// Threads: any, while no other call uses the tree: else `SPLITPLANE_STATUS_BUSY`.
///
/// # Safety
/// As for `splitplane_tree_build`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn splitplane_tree_rebuild(
    tree: Tree,
    mesh: *const Mesh,
    options: *const BuildOptions,
) -> Status {
    entry(|| {
        let (object, mut copies) = (get(tree)?, Copies::default());
        // SAFETY: as the caller says.
        let (build, mesh) = unsafe { (Build::read(options)?, copies.mesh(mesh)?) };
        let options = build.options();
        let mut state = change(&object)?;
        let State { accelerator, opened } = &mut *state;
        let backend = opened.backend();
        pool::run(build.threads, || Ok(backend.rebuild(accelerator, &mesh, &options)?))
    })
}

/// Frees a tree. 0 is no mistake.
///
/// Threads: any; calls that use it go on.
#[unsafe(no_mangle)]
pub extern "C" fn splitplane_tree_free(tree: Tree) -> Status {
    entry(|| free(tree))
}

/// Numbers about a tree and its build.
///
/// Threads: any.
///
/// # Safety
/// `summary` has room for them.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn splitplane_tree_get_summary(
    tree: Tree,
    summary: *mut TreeSummary,
) -> Status {
    entry(|| {
        check(summary, "summary")?;
        let object = get(tree)?;
        let state = look(&object)?;
        let (own, tree) = (state.accelerator.summary(), state.accelerator.tree());
        let found = TreeSummary {
            triangles: own.triangles,
            dropped: own.dropped,
            snapped: own.snapped,
            reserved: 0,
            nodes: tree.nodes.len() as u64,
            references: tree.references.len() as u64,
            peak_bytes: own.peak_bytes,
            query_bytes: state.accelerator.query_bytes(),
            lower: tree.bounds.lo,
            upper: tree.bounds.hi,
        };
        // SAFETY: there is room.
        unsafe { write(summary, found, "summary") }
    })
}

/// The digest of a tree: the same for the same mesh and settings, on any machine, backend and number of threads.
///
/// Threads: any.
///
/// # Safety
/// `digest` has room for it.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn splitplane_tree_digest(tree: Tree, digest: *mut u64) -> Status {
    entry(|| {
        check(digest, "digest")?;
        let object = get(tree)?;
        let found = look(&object)?.accelerator.tree().digest().0;
        // SAFETY: there is room.
        unsafe { write(digest, found, "digest") }
    })
}

/// The bytes of a tree's file.
///
/// # Safety
/// `mesh` says what is there.
unsafe fn file_of(tree: Tree, mesh: *const Mesh) -> Result<Vec<u8>, Failure> {
    let (object, mut copies) = (get(tree)?, Copies::default());
    // SAFETY: as the caller says.
    let mesh = unsafe { copies.mesh(mesh)? };
    let state = look(&object)?;
    let tree = state.accelerator.tree().view();
    validate_mesh(&tree, &mesh).map_err(|wrong| {
        Failure::new(Status::WrongMesh, format!("the tree is not one of this mesh: {wrong}"))
    })?;
    Ok(file::write(&tree, &mesh)?)
}

/// Writes a tree file, of the tree and not of its mesh, which has to be given: the file has its digest.
///
/// Threads: any.
///
/// # Safety
/// `mesh` says what is there, and `path` ends with a 0.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn splitplane_tree_save(
    tree: Tree,
    mesh: *const Mesh,
    path: *const c_char,
) -> Status {
    entry(|| {
        // SAFETY: as the caller says.
        let (path, bytes) = unsafe { (text(path, "path")?, file_of(tree, mesh)?) };
        store(path, &bytes)
    })
}

/// Writes the bytes of a tree file into memory. `needed`, which may be NULL, gets how many there are; `SPLITPLANE_STATUS_CAPACITY` where there is less room. With `bytes` NULL and capacity 0 only
/// `needed` is written.
///
/// Threads: any.
///
/// # Safety
/// `mesh` says what is there, and `bytes` has room for `capacity`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn splitplane_tree_write(
    tree: Tree,
    mesh: *const Mesh,
    bytes: *mut u8,
    capacity: usize,
    needed: *mut usize,
) -> Status {
    // SAFETY: as the caller says.
    entry(|| unsafe { hand_over(&file_of(tree, mesh)?, bytes, capacity, needed) })
}

/// Makes a tree of a tree file, without building it. The file is checked, and so is that it belongs to the mesh. Of `options` preset and knobs stay the defaults.
///
/// Threads: any.
///
/// # Safety
/// `mesh` and `options` say what is there, `path` ends with a 0, and `tree` has room for a handle.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn splitplane_tree_load(
    backend: Backend,
    mesh: *const Mesh,
    path: *const c_char,
    options: *const BuildOptions,
    tree: *mut Tree,
) -> Status {
    entry(|| {
        check(tree, "tree")?;
        // SAFETY: as the caller says.
        let path = unsafe { text(path, "path")? };
        let opened = get(backend)?;
        // SAFETY: as the caller says.
        unsafe { load(opened, mesh, fetch(path)?.bytes(), options, tree) }
    })
}

/// As `splitplane_tree_load`, of the bytes of a file that are in memory, such as a file that you mapped. They start at a multiple of 4, and are not needed after the call.
///
/// Threads: any.
///
/// # Safety
/// As for `splitplane_tree_load`, and so many bytes are there.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn splitplane_tree_load_memory(
    backend: Backend,
    mesh: *const Mesh,
    bytes: *const u8,
    size: usize,
    options: *const BuildOptions,
    tree: *mut Tree,
) -> Status {
    entry(|| {
        check(tree, "tree")?;
        let opened = get(backend)?;
        // SAFETY: as the caller says.
        unsafe { load(opened, mesh, memory(bytes, size)?, options, tree) }
    })
}

/// Bytes of the caller's.
///
/// # Safety
/// So many are there, and nobody writes them.
pub(crate) unsafe fn memory<'a>(bytes: *const u8, size: usize) -> Result<&'a [u8], Failure> {
    // SAFETY: as the caller says.
    let given = unsafe { Given::<u8>::new(bytes, 1, size, "bytes")? };
    if size > 0 {
        check(bytes.cast::<u32>(), "bytes")?;
    }
    Ok(given.packed().unwrap_or(&[]))
}

/// # Safety
/// `mesh` and `options` say what is there, and `tree` has room for a handle.
unsafe fn load(
    opened: Arc<Opened>,
    mesh: *const Mesh,
    bytes: &[u8],
    options: *const BuildOptions,
    tree: *mut Tree,
) -> Result<(), Failure> {
    let mut copies = Copies::default();
    // SAFETY: as the caller says.
    let (build, mesh) = unsafe { (Build::read(options)?, copies.mesh(mesh)?) };
    build.for_loading()?;
    let limits: LoadOptions<'_> = build.options().for_loading();
    let accelerator = pool::run(build.threads, || {
        let kept = TreeFile::parse(bytes)?;
        if kept.mesh != file::mesh_digest(&mesh) {
            let text = "the tree was built over another mesh: its digest differs";
            return Err(Failure::new(Status::WrongMesh, text));
        }
        Ok(opened.backend().load(&mesh, kept.tree.to_tree()?, &limits)?)
    })?;
    let handle = insert(RwLock::new(State { accelerator, opened }))?;
    // SAFETY: there is room.
    unsafe { write(tree, handle, "tree") }
}

/// Writes a file.
pub(crate) fn store(path: &str, bytes: &[u8]) -> Result<(), Failure> {
    std::fs::write(path, bytes)
        .map_err(|error| Failure::new(Status::Io, format!("`{path}` was not written: {error}")))
}

/// The bytes of a file, where words can be read.
pub(crate) struct Fetched {
    words: Vec<u64>,
    length: usize,
}

impl Fetched {
    pub(crate) fn bytes(&self) -> &[u8] {
        &bytemuck::cast_slice(&self.words)[..self.length]
    }
}

/// Reads a file.
pub(crate) fn fetch(path: &str) -> Result<Fetched, Failure> {
    use std::io::Read;
    let failed =
        |error: std::io::Error| Failure::new(Status::Io, format!("`{path}` was not read: {error}"));
    let mut file = std::fs::File::open(path).map_err(failed)?;
    let length = file.metadata().map_err(failed)?.len();
    let length = usize::try_from(length).map_err(|_| Failure::memory(usize::MAX))?;
    let mut words = filled(length.div_ceil(8), 0u64)?;
    let bytes: &mut [u8] = bytemuck::cast_slice_mut(&mut words);
    file.read_exact(&mut bytes[..length]).map_err(failed)?;
    Ok(Fetched { words, length })
}
