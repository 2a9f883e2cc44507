//! The kernel set of the ray tracer: the ABI between its schedule and its executors, as
//! `splitplane_core::kernel` is the tree builder's.

use splitplane_core::kernel::{Binding, Slot};
use splitplane_core::kernel_set;
use splitplane_core::query::compressed::CompressedNode;
use splitplane_core::ray::{Hit, Ray};
use splitplane_core::tree::node::KdNode;

use crate::layout::{Counters, FirstCost, FirstHit, Path, Spawned, Surface};

/// Paths of a chunk: what one workgroup takes at a time.
pub const CHUNK: u32 = 256;

/// Rays that a workgroup of a kernel that traces takes: no more, since their stacks lie in its memory.
pub const TRACED: u32 = 64;

/// Words of [`Buffer::Deferred`] before the list: the numbers of paths and of shadow rays, and those of undecided ones.
pub const DEFERRED_HEAD: u32 = 4;
/// Words of a deferred ray in the list: its index, and what is left of its walk.
pub const DEFERRED_WORDS: u32 = 4;

/// The word with the number of undecided paths.
pub const UNDECIDED_PATHS: u32 = 2;
/// The word with the number of undecided shadow rays, whose list is in the same place.
pub const UNDECIDED_SHADOW_RAYS: u32 = 3;

/// Words of an undecided ray, in a list behind that of the deferred ones: its index, its triangle if that is certain, the ray, its light.
pub const UNDECIDED_WORDS: u32 = 13;

kernel_set! {
    /// The ray tracer: Whitted 1980, in waves (Laine, Karras, Aila 2013).
    set RayTracer "ray tracer", counted by Counter;
    every kernel: uniform Frame, reads Counters;
    exchanged: Rays with NextRays, Paths with NextPaths;

    /// The inputs of kernels, which do not change.
    uniforms Uniform {
        /// The picture, its camera and its settings: [`layout::Frame`](crate::layout::Frame).
        Frame "frame";
        /// The tree's scale, which traversals read: [`splitplane_core::layout::SceneUniform`].
        Scene "scene";
    }

    /// The buffers that kernels exchange.
    buffers Buffer {
        /// The rays of this wave: [`Ray`].
        Rays "rays", size_of::<Ray>(), live Paths;
        /// The other data of the paths of this wave: [`Path`].
        Paths "paths", size_of::<Path>(), live Paths;
        /// The rays of the next wave.
        NextRays "next_rays", size_of::<Ray>(), live NextPaths;
        /// The paths of the next wave.
        NextPaths "next_paths", size_of::<Path>(), live NextPaths;
        /// What the rays met: [`Hit`].
        Hits "hits", size_of::<Hit>(), live Paths;
        /// The tree's nodes: [`KdNode`]. The tree's own.
        Nodes "nodes", size_of::<KdNode>();
        /// The tree's references. The tree's own.
        LeafReferences "leaf_references", 4;
        /// Compressed nodes of the tree: [`CompressedNode`](splitplane_core::query::compressed::CompressedNode). The tree's own, where a device
        /// holds some: no kernel names them in this table, see [`of_compressed`].
        CompressedNodes "compressed_nodes", size_of::<CompressedNode>();
        /// The references of compressed nodes. The tree's own, likewise.
        CompressedReferences "compressed_references", 4;
        /// Corners by triangle index, as the tree builder snapped them: 9 `f32`. The tree's own.
        Triangles "triangles", 36;
        /// Materials, lights, normals and textures, as words: see [`scene_data`](crate::scene_data).
        Scene "scene_words", 4;
        /// The surface at every hit: [`Surface`].
        Surfaces "surfaces", size_of::<Surface>(), live Paths;
        /// Numbers of rays asked for, by chunk: [`Spawned`]; counts, then offsets.
        Spawned "spawned", size_of::<Spawned>(), live PathChunks;
        /// Rays towards lights: [`Ray`].
        ShadowRays "shadow_rays", size_of::<Ray>(), live ShadowRays;
        /// The light that each of them brings: 4 `f32`, the last 1 when the driver did not follow the
        /// ray to its end, else 0.
        ShadowLight "shadow_light", 16, live ShadowRays;
        /// Sums by pixel of the whole picture: 4 `f32`, the last the number of rays that a device's
        /// driver did not follow to their end.
        Radiance "radiance", 16, live Pixels;
        /// The hit of the first ray of each pixel: [`layout::FirstHit`](crate::layout::FirstHit).
        FirstHits "first_hits", size_of::<FirstHit>(), live Pixels;
        /// The cost of its traversal: [`layout::FirstCost`](crate::layout::FirstCost).
        FirstCosts "first_costs", size_of::<FirstCost>(), live Pixels;
        /// The pixels for a screen: 8 bits each of red, green, blue and 255, from the top left. The
        /// last is 0 where a ray was not followed to its end.
        Pixels "pixels", 4, live Pixels;
        /// Rays of this wave that a lean kernel of a device left to its second one: numbers, then indices; and those of an exact
        /// frame that are left to the CPU. Other executors do not need it.
        Deferred "deferred_rays", 4;
        /// [`Counters`].
        Counters "counters", size_of::<Counters>();
    }

    /// The kernels of the ray tracer. Each is a file of the same name in every executor.
    kernels Kernel {
        /// Takes the next slice of the picture.
        BeginSlice "begin_slice", One => updates Counters, scatters Deferred;
        /// A ray through every sample of the slice's pixels.
        CameraRays "camera_rays", Invocations(Paths, CHUNK) => writes Rays, writes Paths;
        /// Records the cost of the first ray of every pixel.
        FirstCosts "first_costs", Invocations(Paths, CHUNK) =>
            reads Rays, reads Paths, scatters FirstCosts,
            reads Nodes, reads LeafReferences, reads Triangles, uniform Scene;
        /// The closest hit of every path's ray.
        ClosestHits "closest_hits", Invocations(Paths, TRACED) =>
            reads Rays, writes Hits,
            reads Nodes, reads LeafReferences, reads Triangles, uniform Scene, updates Deferred;
        /// Records the hit of the first ray of every pixel.
        FirstHits "first_hits", Invocations(Paths, CHUNK) =>
            reads Rays, reads Paths, reads Hits, reads Triangles, scatters FirstHits;
        /// Computes what every path's ray met: the surface, the light it sends back by itself, and
        /// which rays it asks for.
        Shade "shade", Invocations(Paths, CHUNK) =>
            reads Rays, reads Paths, reads Hits, reads Triangles, reads Scene,
            writes Surfaces, writes Spawned;
        /// Scans the numbers of rays asked for.
        ScanSpawned "scan_spawned", One => updates Counters, updates Spawned;
        /// A ray towards every light that may light a surface.
        ShadowRays "shadow_rays", Invocations(Paths, CHUNK) =>
            reads Paths, reads Triangles, reads Scene, reads Surfaces, reads Spawned,
            writes ShadowRays, writes ShadowLight;
        /// Removes the light of shadow rays that hit something.
        ShadowHits "shadow_hits", Invocations(ShadowRays, TRACED) =>
            reads ShadowRays, updates ShadowLight,
            reads Nodes, reads LeafReferences, reads Triangles, uniform Scene, updates Deferred;
        /// As [`Kernel::ShadowHits`], where clear bodies only tint the light. The scene says which
        /// triangles are clear.
        ShadowHitsThroughGlass "shadow_hits_through_glass", Invocations(ShadowRays, TRACED) =>
            reads ShadowRays, updates ShadowLight,
            reads Nodes, reads LeafReferences, reads Triangles, uniform Scene, updates Deferred,
            reads Scene;
        /// Sums the light of the paths, pixel by pixel.
        Accumulate "accumulate", Invocations(Paths, CHUNK) =>
            reads Paths, reads Surfaces, reads Spawned, reads ShadowLight, updates Radiance;
        /// The reflected and refracted rays of the next wave.
        NextPaths "next_paths", Invocations(Paths, CHUNK) =>
            reads Rays, reads Paths, reads Scene, reads Surfaces, reads Spawned,
            writes NextRays, writes NextPaths;
        /// Makes the next wave the current one.
        BeginWave "begin_wave", One => updates Counters, scatters Deferred;
        /// Converts radiance to screen pixels. The scene holds the table of sRGB.
        Resolve "resolve", Invocations(Pixels, CHUNK) =>
            reads Radiance, reads Scene, writes Pixels;
    }
}

impl Kernel {
    /// Whether the kernel traces rays, and so reads the tree.
    pub fn traces(self) -> bool {
        self.bindings().any(|binding| binding.buffer == Buffer::Nodes)
    }
}

/// What the shader of a kernel binds that goes through compressed nodes, in the place of what the kernel binds: compressed nodes
/// and their references instead of the tree's, and otherwise the same. What finishes the kernel's work binds the tree's.
pub fn of_compressed(slot: Slot<RayTracer>) -> Slot<RayTracer> {
    let Slot::Storage(Binding { buffer, access }) = slot else { return slot };
    let buffer = match buffer {
        Buffer::Nodes => Buffer::CompressedNodes,
        Buffer::LeafReferences => Buffer::CompressedReferences,
        other => other,
    };
    Slot::Storage(Binding { buffer, access })
}

impl Buffer {
    /// All buffers that a frame allocates on any executor, in the order that a plan lists them.
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
}

/// What kernels count, and where in [`Counters::words`].
#[repr(u32)]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Counter {
    /// Where the pixels to make end: as many as the picture has, but in a [`Part`](crate::Part) of it.
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
    /// Bits that say which queue overflowed: see [`Overflow`]. The frame is then invalid.
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

impl core::ops::Index<Counter> for Counters {
    type Output = u32;
    fn index(&self, counter: Counter) -> &u32 {
        &self.words[counter as usize]
    }
}

impl core::ops::IndexMut<Counter> for Counters {
    fn index_mut(&mut self, counter: Counter) -> &mut u32 {
        &mut self.words[counter as usize]
    }
}

/// The counters that a frame of these pixels starts with.
pub fn first_counters(pixels: core::ops::Range<u32>) -> Counters {
    let mut counters = Counters::default();
    counters[Counter::Pixels] = pixels.end;
    counters[Counter::PixelsLeft] = pixels.end - pixels.start;
    counters
}

/// The bits of [`Counter::Overflow`]: queues that outgrew their capacity.
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
            let bindings: Vec<_> = kernel.bindings().collect();
            assert!(bindings.len() <= 7, "{kernel:?}");
            for (i, a) in bindings.iter().enumerate() {
                assert!(bindings[..i].iter().all(|b| b.buffer != a.buffer), "{kernel:?}");
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
