//! The kernel set of the ray tracer: names, buffers, bindings, grids. The ABI between its schedule and
//! whoever runs it, as `splitplane_core::kernel` is the tree builder's.

use splitplane_core::kernel::{Access, KernelSet};
use splitplane_core::ray::{Hit, Ray};

use crate::layout::{Counters, Path, Spawned, Surface};

/// Paths of a chunk: what one workgroup takes at a time.
pub const CHUNK: u32 = 256;

/// The ray tracer: Whitted 1980, in waves (Laine, Karras, Aila 2013).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RayTracer {}

impl KernelSet for RayTracer {
    type Kernel = Kernel;
    type Buffer = Buffer;
    type Counter = Counter;

    fn written(kernel: Kernel, visit: &mut dyn FnMut(Buffer)) {
        for &(buffer, access) in kernel.bindings() {
            if access != Access::Read {
                visit(buffer);
            }
        }
        if kernel.writes_counters() {
            visit(Buffer::Counters);
        }
    }

    fn element_size(buffer: Buffer) -> usize {
        buffer.element_size()
    }
}

/// The kernels of the ray tracer. Each is a file of the same name in every executor.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Kernel {
    /// Takes the next slice of the picture.
    BeginSlice,
    /// A ray through every sample of the slice's pixels.
    CameraRays,
    /// The closest hit of every path's ray.
    ClosestHits,
    /// What every path's ray met: the surface, the light it sends back by itself, and which rays it
    /// asks for.
    Shade,
    /// Scans the numbers of rays asked for.
    ScanSpawned,
    /// A ray towards every light that may light a surface.
    ShadowRays,
    /// Puts out the light of shadow rays that hit something.
    ShadowHits,
    /// As [`Kernel::ShadowHits`], where clear bodies only tint the light.
    ShadowHitsThroughGlass,
    /// Sums the light of the paths, pixel by pixel.
    Accumulate,
    /// The reflected and refracted rays of the next wave.
    NextPaths,
    /// Makes the next wave this one.
    BeginWave,
    /// Notes what the first ray of every pixel met.
    FirstHits,
    /// Notes what the traversal of the first ray of every pixel cost.
    FirstCosts,
    /// Radiance to what a screen shows.
    Resolve,
}

impl Kernel {
    /// All kernels, in the order of the schedule.
    pub const ALL: [Kernel; 14] = [
        Kernel::BeginSlice,
        Kernel::CameraRays,
        Kernel::FirstCosts,
        Kernel::ClosestHits,
        Kernel::FirstHits,
        Kernel::Shade,
        Kernel::ScanSpawned,
        Kernel::ShadowRays,
        Kernel::ShadowHits,
        Kernel::ShadowHitsThroughGlass,
        Kernel::Accumulate,
        Kernel::NextPaths,
        Kernel::BeginWave,
        Kernel::Resolve,
    ];

    /// The name of the kernel's file.
    pub const fn name(self) -> &'static str {
        match self {
            Kernel::BeginSlice => "begin_slice",
            Kernel::CameraRays => "camera_rays",
            Kernel::ClosestHits => "closest_hits",
            Kernel::Shade => "shade",
            Kernel::ScanSpawned => "scan_spawned",
            Kernel::ShadowRays => "shadow_rays",
            Kernel::ShadowHits => "shadow_hits",
            Kernel::ShadowHitsThroughGlass => "shadow_hits_through_glass",
            Kernel::Accumulate => "accumulate",
            Kernel::NextPaths => "next_paths",
            Kernel::BeginWave => "begin_wave",
            Kernel::FirstHits => "first_hits",
            Kernel::FirstCosts => "first_costs",
            Kernel::Resolve => "resolve",
        }
    }

    /// What the kernel's workgroups stand for.
    pub const fn grid(self) -> Grid {
        match self {
            Kernel::BeginSlice | Kernel::ScanSpawned | Kernel::BeginWave => Grid::One,
            Kernel::CameraRays
            | Kernel::ClosestHits
            | Kernel::Shade
            | Kernel::ShadowRays
            | Kernel::Accumulate
            | Kernel::NextPaths
            | Kernel::FirstHits
            | Kernel::FirstCosts => Grid::Chunks(Counter::Paths),
            Kernel::ShadowHits | Kernel::ShadowHitsThroughGlass => {
                Grid::Chunks(Counter::ShadowRays)
            }
            Kernel::Resolve => Grid::Chunks(Counter::Pixels),
        }
    }

    /// The buffers the kernel reads and writes, besides [`Buffer::Counters`], in the order of a
    /// device's bindings. At most seven, so that with the counters WebGPU's default of eight storage
    /// buffers suffices; kernels that trace rays bind the tree's three besides.
    pub const fn bindings(self) -> &'static [(Buffer, Access)] {
        use Access::{Read, ReadWrite, Write};
        use Buffer as B;
        match self {
            Kernel::BeginSlice | Kernel::BeginWave => &[],
            Kernel::CameraRays => &[(B::Rays, Write), (B::Paths, Write)],
            Kernel::ClosestHits => &[(B::Rays, Read), (B::Hits, Write)],
            Kernel::Shade => &[
                (B::Rays, Read),
                (B::Paths, Read),
                (B::Hits, Read),
                (B::Triangles, Read),
                (B::Scene, Read),
                (B::Surfaces, Write),
                (B::Spawned, Write),
            ],
            Kernel::ScanSpawned => &[(B::Spawned, ReadWrite)],
            Kernel::ShadowRays => &[
                (B::Paths, Read),
                (B::Triangles, Read),
                (B::Scene, Read),
                (B::Surfaces, Read),
                (B::Spawned, Read),
                (B::ShadowRays, Write),
                (B::ShadowLight, Write),
            ],
            Kernel::ShadowHits => &[(B::ShadowRays, Read), (B::ShadowLight, ReadWrite)],
            // The scene says which triangles are clear.
            Kernel::ShadowHitsThroughGlass => {
                &[(B::ShadowRays, Read), (B::Scene, Read), (B::ShadowLight, ReadWrite)]
            }
            Kernel::Accumulate => &[
                (B::Paths, Read),
                (B::Surfaces, Read),
                (B::Spawned, Read),
                (B::ShadowLight, Read),
                (B::Radiance, ReadWrite),
            ],
            Kernel::NextPaths => &[
                (B::Rays, Read),
                (B::Paths, Read),
                (B::Scene, Read),
                (B::Surfaces, Read),
                (B::Spawned, Read),
                (B::NextRays, Write),
                (B::NextPaths, Write),
            ],
            Kernel::FirstHits => &[
                (B::Rays, Read),
                (B::Paths, Read),
                (B::Hits, Read),
                (B::Triangles, Read),
                (B::FirstHits, ReadWrite),
            ],
            Kernel::FirstCosts => &[(B::Rays, Read), (B::Paths, Read), (B::FirstCosts, ReadWrite)],
            // The scene holds the table of sRGB.
            Kernel::Resolve => &[(B::Radiance, Read), (B::Scene, Read), (B::Pixels, Write)],
        }
    }

    /// Whether the kernel traces rays, so that a device binds the tree for it.
    pub const fn traces(self) -> bool {
        matches!(
            self,
            Kernel::ClosestHits
                | Kernel::ShadowHits
                | Kernel::ShadowHitsThroughGlass
                | Kernel::FirstCosts
        )
    }

    /// Whether the kernel writes counters. Only kernels of one workgroup do.
    pub const fn writes_counters(self) -> bool {
        matches!(self, Kernel::BeginSlice | Kernel::ScanSpawned | Kernel::BeginWave)
    }
}

/// How many workgroups a dispatch means.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Grid {
    /// One workgroup does it all.
    One,
    /// One workgroup for each [`CHUNK`] of the things counted.
    Chunks(Counter),
}

/// The buffers that kernels exchange.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Buffer {
    /// The rays of this wave: [`Ray`].
    Rays,
    /// What else is known of the paths of this wave: [`Path`].
    Paths,
    /// The rays of the next wave.
    NextRays,
    /// The paths of the next wave.
    NextPaths,
    /// What the rays met: [`Hit`].
    Hits,
    /// Corners by triangle index, as the tree builder snapped them: 9 `f32`. The tree's own.
    Triangles,
    /// Materials, lights, normals and textures, as words: see [`crate::scene_data`].
    Scene,
    /// What is known of the surface at every hit: [`Surface`].
    Surfaces,
    /// Numbers of rays asked for, by chunk: [`Spawned`]; counts, then offsets.
    Spawned,
    /// Rays towards lights: [`Ray`].
    ShadowRays,
    /// The light that each of them brings: 4 `f32`, the last 1 when the driver did not follow the ray
    /// to its end, else 0.
    ShadowLight,
    /// Sums by pixel of the whole picture: 4 `f32`, the last the number of rays that a device's
    /// driver did not follow to their end.
    Radiance,
    /// What the first ray of each pixel met: [`crate::layout::FirstHit`].
    FirstHits,
    /// What its traversal cost: [`crate::layout::FirstCost`].
    FirstCosts,
    /// What a screen shows: 8 bits each of red, green, blue and 255, from the top left. The last is 0
    /// where a ray was not followed to its end.
    Pixels,
    /// [`Counters`].
    Counters,
}

impl Buffer {
    /// All buffers that a frame allocates, in the order that a plan lists them.
    pub const ALLOCATED: [Buffer; 14] = [
        Buffer::Rays,
        Buffer::Paths,
        Buffer::NextRays,
        Buffer::NextPaths,
        Buffer::Hits,
        Buffer::Scene,
        Buffer::Surfaces,
        Buffer::Spawned,
        Buffer::ShadowRays,
        Buffer::ShadowLight,
        Buffer::Radiance,
        Buffer::FirstHits,
        Buffer::FirstCosts,
        Buffer::Pixels,
    ];

    /// Bytes of one element.
    pub const fn element_size(self) -> usize {
        match self {
            Buffer::Rays | Buffer::NextRays | Buffer::ShadowRays => size_of::<Ray>(),
            Buffer::Paths | Buffer::NextPaths => size_of::<Path>(),
            Buffer::Hits => size_of::<Hit>(),
            Buffer::Triangles => 36,
            Buffer::Scene | Buffer::Pixels => 4,
            Buffer::Surfaces => size_of::<Surface>(),
            Buffer::Spawned => size_of::<Spawned>(),
            Buffer::ShadowLight | Buffer::Radiance => 16,
            Buffer::FirstHits => size_of::<crate::layout::FirstHit>(),
            Buffer::FirstCosts => size_of::<crate::layout::FirstCost>(),
            Buffer::Counters => size_of::<Counters>(),
        }
    }

    /// The counter that tells the number of live elements; `None` for those whose length is fixed by
    /// the scene.
    pub const fn live(self) -> Option<Counter> {
        Some(match self {
            Buffer::Rays | Buffer::Paths | Buffer::Hits | Buffer::Surfaces => Counter::Paths,
            Buffer::NextRays | Buffer::NextPaths => Counter::NextPaths,
            Buffer::Spawned => Counter::PathChunks,
            Buffer::ShadowRays | Buffer::ShadowLight => Counter::ShadowRays,
            Buffer::Radiance | Buffer::FirstHits | Buffer::FirstCosts | Buffer::Pixels => {
                Counter::Pixels
            }
            Buffer::Triangles | Buffer::Scene | Buffer::Counters => return None,
        })
    }
}

/// What kernels count, and where in [`Counters::words`].
#[repr(u32)]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Counter {
    /// Pixels of the picture.
    Pixels = 0,
    /// Pixels that no slice has taken yet.
    PixelsLeft,
    /// First pixel of this slice.
    FirstPixel,
    /// Number of this wave in its slice, from 0.
    Wave,
    /// Paths of this wave.
    Paths,
    /// Chunks of [`CHUNK`] paths of this wave.
    PathChunks,
    /// Paths of the next wave.
    NextPaths,
    /// Shadow rays of this wave.
    ShadowRays,
    /// Bits that say which room did not suffice: see [`Overflow`]. The frame is void.
    Overflow,
    /// Camera, reflected and refracted rays of the frame, low word.
    TotalPathsLow,
    /// The same, high word.
    TotalPathsHigh,
    /// Shadow rays of the frame, low word.
    TotalShadowRaysLow,
    /// The same, high word.
    TotalShadowRaysHigh,
    /// Not used.
    Spare13,
    /// Not used.
    Spare14,
    /// Not used.
    Spare15,
}

impl Counter {
    /// All counters, by their word.
    pub const ALL: [Counter; 16] = [
        Counter::Pixels,
        Counter::PixelsLeft,
        Counter::FirstPixel,
        Counter::Wave,
        Counter::Paths,
        Counter::PathChunks,
        Counter::NextPaths,
        Counter::ShadowRays,
        Counter::Overflow,
        Counter::TotalPathsLow,
        Counter::TotalPathsHigh,
        Counter::TotalShadowRaysLow,
        Counter::TotalShadowRaysHigh,
        Counter::Spare13,
        Counter::Spare14,
        Counter::Spare15,
    ];
}

/// The counters that a frame starts with.
pub fn first_counters(pixels: u32) -> Counters {
    let mut counters = Counters::default();
    counters[Counter::Pixels] = pixels;
    counters[Counter::PixelsLeft] = pixels;
    counters
}

/// The bits of [`Counter::Overflow`]: queues that outgrew their room.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum Overflow {
    /// Paths of the next wave.
    Paths = 1,
    /// Shadow rays.
    ShadowRays = 2,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bindings_fit_the_default_limits_and_name_no_buffer_twice() {
        for kernel in Kernel::ALL {
            let bindings = kernel.bindings();
            let tree = if kernel.traces() { 3 } else { 0 };
            assert!(bindings.len() + tree <= 7, "{kernel:?}");
            for (i, a) in bindings.iter().enumerate() {
                assert!(bindings[..i].iter().all(|b| b.0 != a.0), "{kernel:?}");
            }
        }
    }

    #[test]
    fn counters_stand_at_their_words() {
        for (word, counter) in Counter::ALL.into_iter().enumerate() {
            assert_eq!(counter as usize, word);
        }
    }
}
