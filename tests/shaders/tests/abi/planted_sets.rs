//! Faults planted in the shaders of every set, and in a table: each is found where it must be.

use splitplane_core::kernel::{Kernel as B, QueryKernel as Q, RayQueries, TreeBuilder};
use splitplane_core::kernel_set;
use splitplane_render::RayTracer;
use splitplane_render::kernel::Kernel as K;

use super::sets::{self, Shaders, faults, table_faults};

/// Replacing a text in a kernel brings a fault that says this.
#[track_caller]
fn found<S: Shaders>(plants: &[(S::Kernel, &str, &str, &str)]) {
    let known = S::known();
    for (kernel, from, to, words) in plants {
        let mut parts = sets::text_of::<S>(*kernel);
        let mut replaced = 0;
        for part in &mut parts {
            replaced += part.text.matches(from).count();
            part.text = part.text.replacen(from, to, 1);
        }
        assert!(replaced > 0, "{from}");
        // Where the text no longer validates, the fault says that.
        let faults = faults::<S>(&parts, *kernel, &known);
        assert!(faults.iter().any(|fault| fault.contains(words)), "{from} -> {to}: {faults:?}");
    }
}

#[test]
fn faults_of_the_ray_tracers_kernels_are_found() {
    found::<RayTracer>(&[
        (K::Accumulate, "read_write> radiance", "read> radiance", "writing to this location"),
        (K::Accumulate, "@binding(5)", "@binding(7)", "in place of shadow_light at 5"),
        (K::ClosestHits, "read> rays", "read_write> rays", "rays is Storage"),
        (
            K::ClosestHits,
            "nodes: array<vec2<u32>>",
            "nodes: array<vec2<u32>, 4>",
            "nodes has another type",
        ),
        (
            K::ClosestHits,
            "struct Scene {",
            "alias Scene = Other;\nstruct Other {",
            "scene has another type",
        ),
        (K::Shade, "hits: array<vec4<u32>>", "hits: array<vec4<u32>, 4>", "hits has another type"),
        (K::ScanSpawned, "read_write> counters", "read> counters", "writing to this location"),
        (K::CameraRays, "read> counters", "read_write> counters", "counters is Storage"),
        (
            K::Accumulate,
            "    offset: f32,\n    geometric",
            "    geometric",
            "Surface: member `offset`",
        ),
        (K::BeginSlice, "    step_y: vec3<f32>,\n    samples", "    samples", "Frame: member"),
        (K::NextPaths, "SURFACE_REFRACTS: u32 = 2u", "SURFACE_REFRACTS: u32 = 3u", "constant"),
        (K::BeginWave, "COUNTER_WAVE: u32 = 3u", "COUNTER_WAVE: u32 = 2u", "constant COUNTER_WAVE"),
        (K::Shade, "ONE_OVER_PI: f32 = 0.318", "ONE_OVER_PI: f32 = 0.319", "constant ONE_OVER_PI"),
        (K::Resolve, "@workgroup_size(256)", "@workgroup_size(128)", "workgroups of [128, 1, 1]"),
    ]);
}

#[test]
fn faults_of_the_queries_are_found() {
    found::<RayQueries>(&[
        // Bindings out of order, missing, besides, of another access or type.
        (Q::ClosestHit, "@binding(5)", "@binding(9)", "batch at 6 in place of hits at 5"),
        (Q::ClosestHit, "@binding(4)", "@binding(8)", "hits at 5 in place of rays at 4"),
        (
            Q::AnyHit,
            "@group(0) @binding(5) var<storage, read_write> occluded: array<u32>;",
            "var<private> occluded: array<u32, 4>;",
            "batch at 6 in place of occluded at 5",
        ),
        (
            Q::TriangleLimits,
            "@group(0) @binding(2) var<storage, read_write> limits",
            "var<workgroup> limits",
            "limits is not bound",
        ),
        (
            Q::AnyHit,
            "@compute",
            "@group(0) @binding(9) var<storage> more: array<u32>;\n@compute",
            "more is bound besides",
        ),
        (Q::AnyHit, "read> rays", "read_write> rays", "rays is Storage"),
        (Q::AnyHit, "var<uniform> batch", "var<storage> batch", "batch is Storage"),
        (Q::ClosestHit, "rays: array<vec4<u32>>", "rays: array<vec4<u32>, 4>", "rays has another"),
        (Q::ClosestHit, "hits: array<vec4<u32>>", "hits: array<vec4<u32>, 4>", "hits has another"),
        (
            Q::TriangleLimits,
            "limits: array<atomic<u32>, 4>",
            "limits: array<atomic<u32>, 5>",
            "limits has",
        ),
        (Q::TriangleLimits, "@group(0) @binding(0)", "@group(1) @binding(0)", "is not in group 0"),
        // Widths, records, constants.
        (Q::ClosestHit, "@workgroup_size(64)", "@workgroup_size(32)", "workgroups of [32, 1, 1]"),
        (Q::TriangleLimits, "@workgroup_size(256)", "@workgroup_size(64)", "workgroups of [64"),
        (
            Q::AnyHit,
            "    culling: u32,\n    ignore: u32,\n",
            "    ignore: u32,\n    culling: u32,\n",
            "Batch: member `culling`",
        ),
        (
            Q::ClosestHit,
            "    slack: f32,\n",
            "    slack: f32,\n    gap: vec4<f32>,\n",
            "Scene: 80 bytes",
        ),
        (
            Q::TriangleLimits,
            "    count: u32,\n    zero: u32",
            "    zero: u32,\n    count: u32",
            "TriangleCount: member",
        ),
        (
            Q::AnyHit,
            "UNDECIDED_HIT: u32 = 0xfffffffdu",
            "UNDECIDED_HIT: u32 = 0xfffffffcu",
            "constant UNDECIDED_HIT",
        ),
    ]);
}

/// A kernel that does not use a buffer as its table says.
#[test]
fn uses_that_are_not_declared_are_found() {
    found::<TreeBuilder>(&[(
        B::NodeBounds,
        "node_bounds[6u * index + lane] =",
        "_ =",
        "node_bounds is not written",
    )]);
    let (from, to) = ("leaf(address.y, 0u);", "leaf(address.y, nodes[index].x);");
    found::<TreeBuilder>(&[(B::EmitTop, from, to, "nodes is read")]);
    found::<RayQueries>(&[
        (Q::ClosestHit, "hits[index] = hit_words(hit);", "", "hits is not written"),
        (Q::ClosestHit, "batch_ray(index), ", "Ray(), ", "rays is not read"),
    ]);
}

kernel_set! {
    /// A set with a fault of every kind.
    set Faulty "faulty", counted by Count;
    every kernel: uniform Given, reads Counters;
    exchanged: A with B;

    /// What kernels are given.
    uniforms GivenUniform {
        /// Not used.
        Given "given";
    }

    /// Buffers of which two have one name, and two that change places are not of one size.
    buffers FaultyBuffer {
        /// One.
        A "a", 4, live Things;
        /// Another.
        B "b", 8, live Things;
        /// A namesake.
        C "b", 4, live Things;
        /// More.
        D "d", 4;
        /// More.
        E "e", 4;
        /// More.
        F "f", 4;
        /// More.
        G "g", 4;
        /// More.
        H "h", 4;
        /// Counters.
        Counters "counters", 64;
    }

    /// Kernels.
    kernels FaultyKernel {
        /// Binds nine buffers.
        Greedy "greedy", One =>
            reads A, reads B, reads C, reads D, reads E, reads F, reads G, writes H;
        /// Has the name of something else.
        Renamed "something_else", Invocations(Things, 64) => reads A, writes A;
        /// Writes counters from everywhere.
        Counting "counting", Each(Things) => updates Counters;
    }
}

/// What a faulty set counts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[expect(unreachable_pub, reason = "the set that it counts for is public, as sets are")]
pub enum Count {
    /// Whatever.
    Things,
}

#[test]
fn faults_of_a_table_are_found() {
    let faults = table_faults::<Faulty>();
    for words in [
        "b twice",
        "Renamed is called something_else",
        "something_else names",
        "greedy binds 9 storage buffers",
        "counting writes counters from many workgroups",
        "b cannot stand for a",
    ] {
        assert!(faults.iter().any(|fault| fault.contains(words)), "{words}: {faults:?}");
    }
}
