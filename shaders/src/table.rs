//! Which parts each shader is joined from.

use crate::{Part, Shader};

macro_rules! library {
    ($($constant:ident $name:literal)*) => {
        $(const $constant: Part =
            Part { name: $name, text: include_str!(concat!("../lib/", $name, ".wgsl")) };)*
        /// The modules that shaders share, by name.
        pub const LIBRARY: &[Part] = &[$($constant),*];
    };
}

macro_rules! shaders {
    ($(#[$doc:meta])* $table:ident $folder:literal { $($name:literal: $($part:ident)*;)* }) => {
        $(#[$doc])*
        pub const $table: &[Shader] = &[$(Shader {
            name: $name,
            parts: &[$($part,)* Part {
                name: $name,
                text: include_str!(concat!("../", $folder, "/", $name, ".wgsl")),
            }],
        }),*];
    };
}

library! {
    ARITHMETIC "arithmetic"
    AABB "aabb"
    LAYOUT "layout"
    KERNEL "kernel"
    TRIANGLE "triangle"
    SPLIT "split"
    SAH "sah"
    NODE "node"
    CORNERS "corners"
    CHUNK_STATE "chunk_state"
    CHUNK_STATE_STORE "chunk_state_store"
    CHUNK_BOUNDS_STORE "chunk_bounds_store"
    REDUCE "reduce"
    SCAN "scan"
    BALLOT "ballot"
    SMALL_NODE "small_node"
    RAY "ray"
    BINDINGS "bindings"
    INTERSECT "intersect"
    WATERTIGHT "watertight"
    MOELLER_TRUMBORE "moeller_trumbore"
    TRAVERSE "traverse"
    QUERY "query"
}

shaders! {
    /// The kernels of the tree builder, in the order of the schedule.
    KERNELS "kernels" {
        "triangle_bounds": ARITHMETIC AABB LAYOUT KERNEL TRIANGLE CHUNK_STATE CHUNK_STATE_STORE REDUCE CHUNK_BOUNDS_STORE BALLOT;
        "scan_triangles": ARITHMETIC AABB LAYOUT KERNEL CHUNK_STATE CHUNK_STATE_STORE REDUCE SCAN;
        "gather_references": ARITHMETIC AABB LAYOUT KERNEL TRIANGLE CHUNK_STATE BALLOT;
        "node_bounds": ARITHMETIC AABB LAYOUT KERNEL CHUNK_STATE REDUCE;
        "split_large": ARITHMETIC AABB LAYOUT KERNEL SPLIT SAH;
        "chunk_nodes": LAYOUT KERNEL SCAN;
        "assign_chunks": LAYOUT KERNEL;
        "classify_references": ARITHMETIC AABB LAYOUT KERNEL TRIANGLE SPLIT SAH CORNERS CHUNK_STATE CHUNK_STATE_STORE BALLOT;
        "count_children": ARITHMETIC AABB LAYOUT KERNEL CHUNK_STATE CHUNK_STATE_STORE SCAN;
        "allocate_children": ARITHMETIC AABB LAYOUT KERNEL SCAN;
        "scatter_references": ARITHMETIC AABB LAYOUT KERNEL TRIANGLE SPLIT SAH CORNERS CHUNK_STATE REDUCE CHUNK_BOUNDS_STORE;
        "build_small": ARITHMETIC AABB LAYOUT KERNEL SPLIT SAH NODE SMALL_NODE;
        "subtree_sizes": LAYOUT KERNEL;
        "preorder_addresses": LAYOUT KERNEL;
        "emit_top": LAYOUT KERNEL NODE;
        "emit_small": ARITHMETIC AABB LAYOUT KERNEL SPLIT SAH NODE SMALL_NODE;
    }
}

macro_rules! queries {
    ($($name:literal is $file:literal with $($part:ident)*;)*) => {
        /// The kernels of queries. Those that end in `_fast` have the test of Moeller and Trumbore
        /// in place of the watertight one.
        pub const QUERIES: &[Shader] = &[$(Shader {
            name: $name,
            parts: &[$($part,)* Part {
                name: $file,
                text: include_str!(concat!("../queries/", $file, ".wgsl")),
            }],
        }),*];
    };
}

queries! {
    "closest_hit" is "closest_hit" with ARITHMETIC RAY BINDINGS INTERSECT WATERTIGHT TRAVERSE QUERY;
    "closest_hit_fast" is "closest_hit"
        with ARITHMETIC RAY BINDINGS INTERSECT MOELLER_TRUMBORE TRAVERSE QUERY;
    "any_hit" is "any_hit" with ARITHMETIC RAY BINDINGS INTERSECT WATERTIGHT TRAVERSE QUERY;
    "any_hit_fast" is "any_hit"
        with ARITHMETIC RAY BINDINGS INTERSECT MOELLER_TRUMBORE TRAVERSE QUERY;
    "triangle_limits" is "triangle_limits" with ARITHMETIC;
}

/// What a host's own shader needs for tracing rays, but for the bindings and the triangle test.
pub(crate) const TRAVERSAL: [Part; 4] = [ARITHMETIC, RAY, INTERSECT, TRAVERSE];
pub(crate) const TRAVERSAL_BINDINGS: Part = BINDINGS;
pub(crate) const TRAVERSAL_TESTS: [Part; 2] = [WATERTIGHT, MOELLER_TRUMBORE];

shaders! {
    /// What the self-test of a device runs.
    CHECKS "checks" {
        "arithmetic_check": ARITHMETIC;
    }
}
