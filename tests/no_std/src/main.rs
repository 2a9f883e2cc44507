//! Uses every module of the core in a program that has neither std nor, without the feature
//! `alloc`, an allocator. The exit code says whether the answers were right; `main` is called by the
//! C runtime, since Rust's own start-up code is part of std.
//!
//! What proves the absence of std is the panic handler below: where any crate of the graph links
//! std, there are two, and the compiler refuses.

#![no_std]
#![no_main]

#[cfg(feature = "alloc")]
extern crate alloc;
#[cfg(feature = "links-std")]
extern crate std;

use core::panic::PanicInfo;
use splitplane_core::aabb::Aabb;
use splitplane_core::arithmetic::snap;
use splitplane_core::build::mask::TriangleMask;
use splitplane_core::build::{schedule, split};
use splitplane_core::config::{BuildConfig, MAX_SMALL, Planes};
use splitplane_core::kernel::Kernel;
use splitplane_core::layout::Reference;
use splitplane_core::mesh::Mesh;
use splitplane_core::query::intersect::{Limits, SceneScale};
use splitplane_core::query::lines::{Lines, scene_scale, trace_lines};
use splitplane_core::query::traverse;
use splitplane_core::ray::{QueryOptions, Ray};
use splitplane_core::tree::KdTreeView;
use splitplane_core::tree::digest::Xxh64;
use splitplane_core::tree::file::{FileError, TreeFile};
use splitplane_core::tree::node::KdNode;
use splitplane_core::tree::stats::TreeStats;
use splitplane_core::tree::validate::validate_mesh;
use splitplane_core::{sah, triangle};

#[link(name = "c")]
unsafe extern "C" {
    fn abort() -> !;
}

#[panic_handler]
fn panic(_: &PanicInfo<'_>) -> ! {
    // SAFETY: `abort` takes nothing and does not return.
    unsafe { abort() }
}

/// Hands out memory from one array and never takes it back.
#[cfg(feature = "alloc")]
mod bump {
    use core::alloc::{GlobalAlloc, Layout};
    use core::cell::UnsafeCell;
    use core::sync::atomic::{AtomicUsize, Ordering};

    const SIZE: usize = 1 << 20;

    struct Bump {
        memory: UnsafeCell<[u8; SIZE]>,
        used: AtomicUsize,
    }

    // SAFETY: ranges are handed out through an atomic counter, so no two callers share bytes.
    unsafe impl Sync for Bump {}

    // SAFETY: a range is inside the array, aligned as asked, and given out once.
    unsafe impl GlobalAlloc for Bump {
        unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
            let base = self.memory.get() as usize;
            let mut start = 0;
            let taken = self.used.fetch_update(Ordering::Relaxed, Ordering::Relaxed, |used| {
                start = (base + used).next_multiple_of(layout.align()) - base;
                let end = start.checked_add(layout.size())?;
                (end <= SIZE).then_some(end)
            });
            if taken.is_err() {
                return core::ptr::null_mut();
            }
            // SAFETY: `start` plus the size is at most `SIZE`.
            unsafe { self.memory.get().cast::<u8>().add(start) }
        }

        unsafe fn dealloc(&self, _: *mut u8, _: Layout) {}
    }

    #[global_allocator]
    static MEMORY: Bump = Bump { memory: UnsafeCell::new([0; SIZE]), used: AtomicUsize::new(0) };
}

/// Two triangles, a square, across the z axis.
const SQUARE: [[f32; 3]; 4] = [[0.0, 0.0, 1.0], [2.0, 0.0, 1.0], [2.0, 2.0, 1.0], [0.0, 2.0, 1.0]];

/// The number of the first answer that is wrong; 0 when all are right.
fn first_wrong() -> i32 {
    let Ok(mesh) = Mesh::indexed(&SQUARE, &[[0, 1, 2], [0, 2, 3]]) else { return 1 };
    let corners = [mesh.triangle(0), mesh.triangle(1)];
    let limits = corners.iter().fold(Limits::NONE, |limits, c| limits.union(Limits::of(c)));
    let tree = KdTreeView {
        nodes: &[KdNode::leaf(0, 2)],
        references: &[0, 1],
        bounds: Aabb::of_points(&SQUARE),
        triangles: 2,
        config: BuildConfig::default(),
    };
    if validate_mesh(&tree, &mesh).is_err() || TreeStats::of(&tree).leaves != 1 {
        return 2;
    }
    let scale = SceneScale::new(tree.bounds, &limits);
    let ray = Ray::new([1.5, 1.0, 3.0], [0.0, 0.0, -1.0]);
    let options = QueryOptions::default();
    match traverse::closest_hit(&tree, &mesh, &scale, &ray, &options) {
        Some(hit) if hit.t == 2.0 && hit.triangle == 0 => {}
        _ => return 3,
    }
    let away = Ray::new([1.5, 1.0, 3.0], [0.0, 0.0, 1.0]);
    if traverse::any_hit(&tree, &mesh, &scale, &away, &options) {
        return 4;
    }
    let Some(lines) = Lines::through(&tree.bounds, 1) else { return 11 };
    let scene = scene_scale(&tree, &corners[..]);
    let measured = trace_lines(&tree, &corners[..], &scene, &lines, 0..100, &options);
    if measured.passing.mean() != TreeStats::of(&tree).expected || measured.closest.hits != 100 {
        return 11;
    }
    let mut hash = Xxh64::new(0);
    hash.write(b"abc");
    if hash.finish() != 0x44bc_2cf5_ad77_0999 {
        return 5;
    }
    if !matches!(TreeFile::parse(b"no tree"), Err(FileError::Magic)) {
        return 6;
    }
    let cube = Aabb { lo: [0.0; 3], hi: [1.0; 3] };
    if sah::half_area_of(&cube) != 3.0
        || split::spatial_median::<splitplane_core::arithmetic::Strict>(&cube).is_none()
    {
        return 7;
    }
    if TriangleMask::first(MAX_SMALL).count() != 64 || snap(-0.0).to_bits() != 0 {
        return 8;
    }
    let whole = Reference::new(&cube, 7);
    if whole.bounds() != cube || !triangle::prepare(&corners[0]).kept {
        return 9;
    }
    schedule_of_nothing()
}

/// Runs the build schedule on an executor that has nothing to do, and counts the kernels.
fn schedule_of_nothing() -> i32 {
    use splitplane_core::kernel::{Buffer, Counter, TreeBuilder};

    struct Counting(u32);
    impl schedule::Executor<TreeBuilder> for Counting {
        type Error = core::convert::Infallible;
        fn dispatch(&mut self, kernel: Kernel) -> Result<(), Self::Error> {
            self.0 += u32::from(!kernel.name().is_empty());
            Ok(())
        }
        fn swap(&mut self, _: Buffer, _: Buffer) -> Result<(), Self::Error> {
            Ok(())
        }
        fn pending(&mut self, _: Counter, _: u32) -> Result<bool, Self::Error> {
            Ok(false)
        }
    }
    let mut executor = Counting(0);
    match schedule::build(&mut executor, Planes::Median) {
        Ok(()) if executor.0 >= 3 => 0,
        _ => 10,
    }
}

/// What only exists with an allocator: owned trees, their text, the file writer, the traits, the reference
/// builder.
#[cfg(feature = "alloc")]
fn first_wrong_with_alloc() -> i32 {
    use alloc::vec;
    use splitplane_core::backend::BuildOptions;
    use splitplane_core::tree::dump::dump;
    use splitplane_core::tree::{KdTree, file};

    let options = BuildOptions::default();
    let tree = KdTree {
        nodes: vec![KdNode::leaf(0, 2)],
        references: vec![0, 1],
        bounds: Aabb::of_points(&SQUARE),
        triangles: 2,
        config: options.config,
    };
    if !dump(&tree.view(), 10).contains("leaf") {
        return 20;
    }
    let Ok(mesh) = Mesh::indexed(&SQUARE, &[[0, 1, 2], [0, 2, 3]]) else { return 21 };
    let Ok(bytes) = file::write(&tree.view(), &mesh) else { return 23 };
    if bytes.len() < 100 {
        return 22;
    }
    first_wrong_of_a_build()
}

/// Builds a tree over a ground of squares by both presets, and traces a ray onto every triangle.
#[cfg(feature = "alloc")]
fn first_wrong_of_a_build() -> i32 {
    use splitplane_core::backend::BuildOptions;
    use splitplane_core::build::reference;
    use splitplane_core::config::Preset;
    use splitplane_core::error::BuildError;

    const SIDE: usize = 12;
    let corner = |x: usize, y: usize| [x as f32, y as f32, ((x * x + 3 * y) % 5) as f32 / 4.0];
    let mut ground = [[[0.0f32; 3]; 3]; 2 * SIDE * SIDE];
    for square in 0..SIDE * SIDE {
        let (x, y) = (square % SIDE, square / SIDE);
        let [a, b, c, d] = [(0, 0), (1, 0), (1, 1), (0, 1)].map(|(i, j)| corner(x + i, y + j));
        (ground[2 * square], ground[2 * square + 1]) = ([a, b, c], [a, c, d]);
    }
    let Ok(mesh) = Mesh::soup(&ground) else { return 24 };
    for preset in [Preset::Fast, Preset::Balanced] {
        let options = BuildOptions::from(preset.config());
        let Ok((tree, summary)) = reference::build(&mesh, &options) else { return 25 };
        let tree = tree.view();
        if summary.large_levels == 0 || validate_mesh(&tree, &mesh).is_err() {
            return 26;
        }
        let scale = scene_scale(&tree, &mesh);
        for (triangle, [a, b, c]) in ground.iter().enumerate() {
            let middle = [0, 1].map(|k| (a[k] + b[k] + c[k]) / 3.0);
            let ray = Ray::new([middle[0], middle[1], 9.0], [0.0, 0.0, -1.0]);
            match traverse::closest_hit(&tree, &mesh, &scale, &ray, &QueryOptions::default()) {
                Some(hit) if hit.triangle as usize == triangle => {}
                _ => return 27,
            }
        }
    }
    let little = BuildOptions { max_memory: Some(1 << 10), ..BuildOptions::default() };
    match reference::build(&mesh, &little) {
        Err(BuildError::OutOfMemory { limit: 1024, .. }) => 0,
        _ => 28,
    }
}

/// Called by the C runtime.
#[unsafe(no_mangle)]
extern "C" fn main() -> i32 {
    let wrong = first_wrong();
    #[cfg(feature = "alloc")]
    let wrong = if wrong == 0 { first_wrong_with_alloc() } else { wrong };
    wrong
}
