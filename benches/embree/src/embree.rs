//! Embree 4 through its C interface, opened when the program runs: it builds without it. Declarations follow
//! Embree's documentation.

use std::ffi::{CString, c_char, c_void};
use std::path::Path;
use std::sync::atomic::{AtomicI64, Ordering};

use libloading::Library;
use splitplane_core::ray::Ray;
use splitplane_core::scene::Transform;

use crate::turns::{Took, took};
pub(crate) use packets::{Of, Packets};

mod packets;

pub(crate) type Handle = *mut c_void;
type Release = unsafe extern "C" fn(Handle);
/// `rtcIntersect1` and `rtcOccluded1` differ in what the second argument points to; the latter reads the ray alone.
type Query = unsafe extern "C" fn(Handle, *mut RayHit, *mut Arguments);

/// What Embree tells of its memory: bytes that it takes, less than none for those that it returns.
type Monitor = unsafe extern "C" fn(Handle, isize, bool) -> bool;

/// Bytes that all of Embree's devices hold.
static HELD: AtomicI64 = AtomicI64::new(0);

unsafe extern "C" fn count_bytes(_: Handle, bytes: isize, _: bool) -> bool {
    HELD.fetch_add(bytes as i64, Ordering::Relaxed);
    true
}

/// Bytes that Embree holds, among them its copies of vertices and of indices.
pub(crate) fn bytes_held() -> i64 {
    HELD.load(Ordering::Relaxed)
}

/// `RTCRayHit`.
#[repr(C, align(16))]
struct RayHit {
    origin: [f32; 3],
    t_near: f32,
    direction: [f32; 3],
    time: f32,
    t_far: f32,
    mask: u32,
    id: u32,
    flags: u32,
    normal: [f32; 3],
    uv: [f32; 2],
    triangle: u32,
    geometry: u32,
    /// Instance fields, of which later versions have two.
    instance: [u32; 9],
}

/// `RTCIntersectArguments` and `RTCOccludedArguments`: flags, features, and pointers that may be null.
#[repr(C, align(8))]
pub(crate) struct Arguments {
    flags: u32,
    features: u32,
    pointers: [usize; 6],
}

/// The scene's triangles in Embree, medium quality.
pub(crate) struct Embree {
    /// What rays go through: the mesh, or instances of it.
    scene: Handle,
    mesh: Handle,
    device: Handle,
    calls: Calls,
    pub version: String,
    /// The build: from its own vertices and indices to a scene that is ready.
    pub build: Took,
}

/// Embree's functions.
#[derive(Clone, Copy)]
struct Calls {
    intersect: Query,
    occluded: Query,
    by_8: (packets::Query<8>, packets::Query<8>),
    by_16: (packets::Query<16>, packets::Query<16>),
    error: unsafe extern "C" fn(Handle) -> u32,
    new_scene: unsafe extern "C" fn(Handle) -> Handle,
    new_geometry: unsafe extern "C" fn(Handle, u32) -> Handle,
    set_instanced: unsafe extern "C" fn(Handle, Handle),
    set_transform: unsafe extern "C" fn(Handle, u32, u32, *const f32),
    attach: unsafe extern "C" fn(Handle, Handle) -> u32,
    commit_geometry: Release,
    release_geometry: Release,
    commit_scene: Release,
    release_scene: Release,
    release_device: Release,
}

/// Numbers of Embree's enumerations.
const VERSION: u32 = 0;
const NATIVE_RAY8: u32 = 33;
const NATIVE_RAY16: u32 = 34;
const INDEX_BUFFER: u32 = 0;
const VERTEX_BUFFER: u32 = 1;
const UINT3: u32 = 0x5003;
const FLOAT3: u32 = 0x9003;
const FLOAT3X4_BY_ROWS: u32 = 0x9134;
const TRIANGLES: u32 = 0;
const INSTANCE: u32 = 121;
const NONE: u32 = u32::MAX;
/// All features.
const FEATURES: u32 = u32::MAX;

impl Embree {
    /// Builds with so many threads. `isa` holds Embree to an instruction set, such as `avx2`.
    ///
    /// # Errors
    /// Where there is no such library, or it refuses.
    pub(crate) fn build(
        library: &Path,
        (isa, threads): (Option<&str>, usize),
        vertices: &[[f32; 3]],
        triangles: &[[u32; 3]],
    ) -> Result<Embree, String> {
        // SAFETY: the user names the library; it is Embree if it has these functions, which are declared as
        // Embree's headers declare them. It stays open: its threads may outlive a scene.
        unsafe {
            let failed = |error: libloading::Error| format!("{}: {error}", library.display());
            let library: &'static Library =
                Box::leak(Box::new(Library::new(library).map_err(failed)?));
            macro_rules! function {
                ($name:literal: $($kind:tt)*) => {
                    *library.get::<$($kind)*>($name).map_err(failed)?
                };
            }
            let new_device =
                function!(b"rtcNewDevice\0": unsafe extern "C" fn(*const c_char) -> Handle);
            let monitor = function!(b"rtcSetDeviceMemoryMonitorFunction\0": unsafe extern "C" fn(Handle, Monitor, Handle));
            let property =
                function!(b"rtcGetDeviceProperty\0": unsafe extern "C" fn(Handle, u32) -> isize);
            let new_buffer = function!(b"rtcSetNewGeometryBuffer\0": unsafe extern "C" fn(Handle, u32, u32, u32, usize, usize) -> *mut c_void);
            let calls = Calls {
                intersect: function!(b"rtcIntersect1\0": Query),
                occluded: function!(b"rtcOccluded1\0": Query),
                by_8: (
                    function!(b"rtcIntersect8\0": packets::Query<8>),
                    function!(b"rtcOccluded8\0": packets::Query<8>),
                ),
                by_16: (
                    function!(b"rtcIntersect16\0": packets::Query<16>),
                    function!(b"rtcOccluded16\0": packets::Query<16>),
                ),
                error: function!(b"rtcGetDeviceError\0": unsafe extern "C" fn(Handle) -> u32),
                new_scene: function!(b"rtcNewScene\0": unsafe extern "C" fn(Handle) -> Handle),
                new_geometry: function!(b"rtcNewGeometry\0": unsafe extern "C" fn(Handle, u32) -> Handle),
                set_instanced: function!(b"rtcSetGeometryInstancedScene\0": unsafe extern "C" fn(Handle, Handle)),
                set_transform: function!(b"rtcSetGeometryTransform\0": unsafe extern "C" fn(Handle, u32, u32, *const f32)),
                attach: function!(b"rtcAttachGeometry\0": unsafe extern "C" fn(Handle, Handle) -> u32),
                commit_geometry: function!(b"rtcCommitGeometry\0": Release),
                release_geometry: function!(b"rtcReleaseGeometry\0": Release),
                commit_scene: function!(b"rtcCommitScene\0": Release),
                release_scene: function!(b"rtcReleaseScene\0": Release),
                release_device: function!(b"rtcReleaseDevice\0": Release),
            };
            let isa_is = isa.map_or(String::new(), |isa| format!(",isa={isa}"));
            let config = CString::new(format!("threads={threads},user_threads=0{isa_is}"))
                .map_err(|error| error.to_string())?;
            let device = new_device(config.as_ptr());
            if device.is_null() {
                return Err("rtcNewDevice failed".into());
            }
            monitor(device, count_bytes, std::ptr::null_mut());
            let native = (property(device, NATIVE_RAY8), property(device, NATIVE_RAY16));
            if isa == Some("avx2") && native != (1, 0) {
                return Err("Embree was not held to AVX2".into());
            }
            let version = property(device, VERSION);
            let scene = (calls.new_scene)(device);
            let geometry = (calls.new_geometry)(device, TRIANGLES);
            let to = new_buffer(geometry, VERTEX_BUFFER, 0, FLOAT3, 12, vertices.len());
            let named = new_buffer(geometry, INDEX_BUFFER, 0, UINT3, 12, triangles.len());
            if to.is_null() || named.is_null() {
                return Err(format!("no buffer: Embree's error {}", (calls.error)(device)));
            }
            to.cast::<[f32; 3]>().copy_from_nonoverlapping(vertices.as_ptr(), vertices.len());
            named.cast::<[u32; 3]>().copy_from_nonoverlapping(triangles.as_ptr(), triangles.len());
            let (build, ()) = took(|| {
                (calls.commit_geometry)(geometry);
                (calls.attach)(scene, geometry);
                (calls.release_geometry)(geometry);
                (calls.commit_scene)(scene);
            });
            match (calls.error)(device) {
                0 => {}
                code => return Err(format!("Embree's error {code}")),
            }
            let version = format!("{}.{}.{}", version / 10000, version / 100 % 100, version % 100);
            Ok(Embree { scene, mesh: scene, device, calls, version, build })
        }
    }

    /// Has rays go through the mesh at these places, in place of what they went through. Returns what `clock` says of the commit of
    /// the scene over all of them.
    ///
    /// # Errors
    /// Embree's.
    pub(crate) fn place<T>(
        &mut self,
        places: &[Transform],
        clock: impl FnOnce(&mut dyn FnMut()) -> T,
    ) -> Result<T, String> {
        let Embree { mesh, device, calls, .. } = *self;
        // SAFETY: handles of this device; a transform is twelve numbers, row by row.
        unsafe {
            self.drop_places();
            let scene = (calls.new_scene)(device);
            for transform in places {
                let geometry = (calls.new_geometry)(device, INSTANCE);
                (calls.set_instanced)(geometry, mesh);
                (calls.set_transform)(geometry, 0, FLOAT3X4_BY_ROWS, transform.as_ptr().cast());
                (calls.commit_geometry)(geometry);
                (calls.attach)(scene, geometry);
                (calls.release_geometry)(geometry);
            }
            let took = clock(&mut || (calls.commit_scene)(scene));
            self.scene = scene;
            match (calls.error)(device) {
                0 => Ok(took),
                code => Err(format!("Embree's error {code}")),
            }
        }
    }

    fn drop_places(&mut self) {
        if self.scene != self.mesh {
            // SAFETY: made by `place`, and released once.
            unsafe { (self.calls.release_scene)(self.scene) };
            self.scene = self.mesh;
        }
    }

    /// Distance (infinity for none) and triangle of each ray's closest hit.
    pub(crate) fn closest(&self, rays: &[Ray], hits: &mut [(f32, u32)]) {
        self.ask(self.calls.intersect, rays, |place, ray| {
            let missed = ray.geometry == NONE;
            hits[place] = if missed { (f32::INFINITY, NONE) } else { (ray.t_far, ray.triangle) };
        });
    }

    /// Whether each ray hits anything.
    pub(crate) fn any(&self, rays: &[Ray], hits: &mut [bool]) {
        // Minus infinity says that there is something.
        self.ask(self.calls.occluded, rays, |place, ray| hits[place] = ray.t_far < 0.0);
    }

    fn ask(&self, query: Query, rays: &[Ray], mut answer: impl FnMut(usize, &RayHit)) {
        let mut arguments = Arguments { flags: 0, features: FEATURES, pointers: [0; 6] };
        flushing(|| {
            for (place, ray) in rays.iter().enumerate() {
                let mut asked = RayHit {
                    origin: ray.origin,
                    t_near: ray.t_min,
                    direction: ray.direction,
                    time: 0.0,
                    t_far: ray.t_max,
                    mask: u32::MAX,
                    id: 0,
                    flags: 0,
                    normal: [0.0; 3],
                    uv: [0.0; 2],
                    triangle: NONE,
                    geometry: NONE,
                    instance: [NONE; 9],
                };
                // SAFETY: a committed scene, and structures as Embree reads and writes them.
                unsafe { query(self.scene, &mut asked, &mut arguments) };
                answer(place, &asked);
            }
        });
    }
}

impl Drop for Embree {
    fn drop(&mut self) {
        self.drop_places();
        // SAFETY: both were made by `build` and are released once.
        unsafe {
            (self.calls.release_scene)(self.mesh);
            (self.calls.release_device)(self.device);
        }
    }
}

/// Embree asks its callers to have subnormal numbers flushed.
fn flushing(work: impl FnOnce()) {
    #[cfg(target_arch = "x86_64")]
    {
        /// Puts the register back, whatever becomes of the work.
        struct PutBack(u32);
        impl Drop for PutBack {
            fn drop(&mut self) {
                // SAFETY: it is what the register held.
                unsafe { std::arch::asm!("ldmxcsr [{}]", in(reg) &raw const self.0) };
            }
        }
        let mut before = 0u32;
        // SAFETY: only the two bits for subnormal numbers change, and they are put back. Rust takes them for unset: what it does itself
        // meanwhile is to copy rays and answers, and no arithmetic on numbers that could be subnormal.
        unsafe {
            std::arch::asm!("stmxcsr [{}]", in(reg) &raw mut before);
            let flushed = before | 0x8040;
            std::arch::asm!("ldmxcsr [{}]", in(reg) &raw const flushed);
        }
        let _put_back = PutBack(before);
        work();
    }
    #[cfg(not(target_arch = "x86_64"))]
    work();
}
