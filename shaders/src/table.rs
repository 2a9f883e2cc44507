//! Which parts each shader is joined from.

use crate::{Part, Shader};

macro_rules! library {
    ($($constant:ident $name:literal)*) => {
        $(pub(crate) const $constant: Part =
            Part { name: $name, text: include_str!(concat!("../lib/", $name, ".wgsl")) };)*
        /// The modules that shaders share, by name.
        pub const LIBRARY: &[Part] = &[$($constant),*];
    };
}

macro_rules! shaders {
    ($(#[$doc:meta])* $table:ident $folder:literal { $($name:literal $(is $file:literal)?: $($part:ident)*;)* }) => {
        $(#[$doc])*
        pub const $table: &[Shader] = &[$(Shader {
            name: $name,
            parts: &[$($part,)* own!($folder $name $($file)?)],
        }),*];
    };
}

/// A kernel's own text: in the file of its name, or in another's.
macro_rules! own {
    ($folder:literal $name:literal) => {
        own!($folder $name $name)
    };
    ($folder:literal $name:literal $file:literal) => {
        Part { name: $file, text: include_str!(concat!("../", $folder, "/", $file, ".wgsl")) }
    };
}

library! {
    ARITHMETIC "arithmetic"
    AABB "aabb"
    LAYOUT "layout"
    KERNEL "kernel"
    ONE_ENTRY "one_entry"
    STRIDED "strided"
    TRIANGLE "triangle"
    SPLIT "split"
    SAH "sah"
    NODE "node"
    CORNERS "corners"
    CHILDREN "children"
    CHILDREN_BY_HALVES "children_by_halves"
    CHUNK_STATE "chunk_state"
    CHUNK_STATE_STORE "chunk_state_store"
    CHUNK_BOUNDS "chunk_bounds"
    ACTIVE_NODE "active_node"
    CHUNK_BOUNDS_STORE "chunk_bounds_store"
    REDUCE "reduce"
    SCAN "scan"
    WIDE "wide"
    BINS "bins"
    DECISION "decision"
    BALLOT "ballot"
    SMALL_ROOT "small_root"
    SMALL_NODE "small_node"
    MIDDLE "middle"
    WIDE_SCAN "wide_scan"
    SHORT_SCAN "short_scan"
    RAY "ray"
    BINDINGS "bindings"
    MESH "mesh"
    MESH_WITH_TAIL "mesh_with_tail"
    INTERSECT "intersect"
    ANY_RAY "any_ray"
    PLAIN_RAY "plain_ray"
    SHEARED "sheared"
    CLOSER_LOOK "closer_look"
    WATERTIGHT "watertight"
    ANY_TRIANGLE "any_triangle"
    PLAIN_TRIANGLE "plain_triangle"
    MOELLER_TRUMBORE "moeller_trumbore"
    OBSERVER "observer"
    COUNTING_OBSERVER "counting_observer"
    SEARCH "search"
    OPAQUE_SEARCH "opaque_search"
    SCREEN "screen"
    CERTAIN "certain"
    CERTAIN_SEARCH "certain_search"
    ROUNDED "rounded"
    CERTAIN_RECORD "certain_record"
    LIST_SEARCH "list_search"
    COUNT_SEARCH "count_search"
    WALK "walk"
    TRAVERSE "traverse"
    SET_ASIDE "set_aside"
    NOTHING_ASIDE "nothing_aside"
    TAKEN_UP "taken_up"
    ONE_HIT "one_hit"
    THROUGH_GLASS "through_glass"
    THROUGH_GLASS_EXACTLY "through_glass_exactly"
    PRIVATE_STACK "private_stack"
    SHORT_STACK "short_stack"
    SHORT_STACK_WORKGROUP "short_stack_workgroup"
    QUERY "query"
    LIST "list"
    COUNT_LIST "count_list"
    NEAR_LAYOUT "near_layout"
    NEAR_TRIANGLE "near_triangle"
    NEAR_WALK "near_walk"
    NEAR_VOLUME "near_volume"
    COMPRESS_LAYOUT "compress_layout"
    COMPRESSED_BINDINGS "compressed_bindings"
    COMPRESSED_WALK "compressed_walk"
    BOX_STACK "box_stack"
    BOX_STACK_WORKGROUP "box_stack_workgroup"
    SCENE_BINDINGS "scene_bindings"
    SCENE_QUERY "scene_query"
    SEEN "seen"
    SHAPE "shape"
    ENTERED "entered"
    HOST_SCENE_BINDINGS "host_scene_bindings"
    HOST_SCENE "host_scene"
    ENTERED_SHAPES "entered_shapes"
    BOX_WALK "box_walk"
    DEFER "defer"
    DEFERRED "deferred"
    RENDER_LAYOUT "render_layout"
    RENDER_KERNEL "render_kernel"
    RENDER_DEFER "render_defer"
    RENDER_TREE "render_tree"
    RENDER_COMPRESSED_TREE "render_compressed_tree"
    UNDECIDED "undecided"
    ALWAYS_DECIDED "always_decided"
    VECTOR "vector"
    RANDOM "random"
    SCENE_WORDS "scene_words"
    TEXTURED "textured"
    UNTEXTURED "untextured"
    ENVIRONMENT "environment"
    INCIDENCE "incidence"
    FRESNEL "fresnel"
    PLANE "plane"
    SMOOTH_NORMALS "smooth_normals"
    FLAT_NORMALS "flat_normals"
    SURFACE "surface"
    SHADE_SURFACE "shade_surface"
    DIELECTRICS "dielectrics"
    NO_DIELECTRICS "no_dielectrics"
    LIGHTING "lighting"
    AREA_LIGHTS "area_lights"
    NO_AREA_LIGHTS "no_area_lights"
    BOUNCE "bounce"
    REFRACTION "refraction"
    NO_REFRACTION "no_refraction"
    TONE "tone"
    EMIT_CHILDREN "emit_children"
    TOP_TREE "top_tree"
    POINT_LAYOUT "point_layout"
    POINT_WALK "point_walk"
    POINT_LIST_ONE "point_list_one"
    POINT_HEAP "point_heap"
    POINT_HEAP_SHORT "point_heap_short"
    POINT_HEAP_LONG "point_heap_long"
}

shaders! {
    /// The kernels of the tree builder, in the order of the schedule.
    KERNELS "kernels" {
        "triangle_bounds": ARITHMETIC AABB LAYOUT KERNEL TRIANGLE CHUNK_STATE CHUNK_STATE_STORE REDUCE CHUNK_BOUNDS_STORE BALLOT;
        "scan_triangles": ARITHMETIC AABB LAYOUT KERNEL CHUNK_STATE CHUNK_STATE_STORE REDUCE WIDE_SCAN;
        "gather_references": ARITHMETIC AABB LAYOUT KERNEL TRIANGLE CHUNK_STATE BALLOT;
        "split_median": ARITHMETIC AABB LAYOUT KERNEL SPLIT SAH WIDE CHUNK_BOUNDS REDUCE ACTIVE_NODE DECISION;
        "node_bounds": ARITHMETIC AABB LAYOUT KERNEL CHUNK_BOUNDS REDUCE ACTIVE_NODE;
        "bin_references": ARITHMETIC AABB LAYOUT KERNEL SAH WIDE BINS;
        "split_binned": ARITHMETIC AABB LAYOUT KERNEL SPLIT SAH SCAN WIDE BINS DECISION;
        "classify_references": ARITHMETIC AABB LAYOUT KERNEL TRIANGLE SPLIT SAH CORNERS CHUNK_STATE BALLOT;
        "allocate_children": ARITHMETIC AABB LAYOUT KERNEL SHORT_SCAN EMIT_CHILDREN;
        "scatter_references": ARITHMETIC AABB LAYOUT KERNEL TRIANGLE SPLIT SAH CORNERS CHUNK_STATE CHILDREN;
        "build_middle": ARITHMETIC AABB LAYOUT KERNEL TRIANGLE SPLIT SAH WIDE CORNERS MIDDLE WIDE_SCAN;
        "scan_middle": LAYOUT KERNEL SCAN;
        "place_middle": LAYOUT KERNEL MIDDLE;
        "build_small": ARITHMETIC AABB LAYOUT KERNEL SPLIT SAH NODE SMALL_ROOT SMALL_NODE;
        "measure_middle": LAYOUT KERNEL;
        "subtree_sizes": LAYOUT KERNEL TOP_TREE;
        "preorder_addresses": LAYOUT KERNEL TOP_TREE;
        "emit_middle": LAYOUT KERNEL NODE MIDDLE;
        "emit_top": LAYOUT KERNEL NODE;
        "emit_small": LAYOUT KERNEL NODE SMALL_ROOT;
    }
}

shaders! {
    /// What finishes what kernels of the tree builder leave to it, over the same bindings. Their names are those of the
    /// kernels, with `_retry`.
    KERNEL_RETRIES "kernels" {
        "allocate_children_retry": ARITHMETIC AABB LAYOUT KERNEL EMIT_CHILDREN;
        "subtree_sizes_retry": LAYOUT KERNEL TOP_TREE;
        "preorder_addresses_retry": LAYOUT KERNEL TOP_TREE;
        "emit_small_retry": ARITHMETIC AABB LAYOUT KERNEL SPLIT SAH NODE SMALL_ROOT SMALL_NODE;
    }
}

shaders! {
    /// The kernels of queries. Those that end in `_fast` have the test of Moeller and Trumbore
    /// in place of the watertight one; those that end in `_exact` tell exact hits where they are certain; those that end in
    /// `_compressed` go through compressed nodes. The lean ones leave what is not plain to those whose names have `_retry`.
    QUERIES "queries" {
        "closest_hit": ARITHMETIC RAY BINDINGS MESH INTERSECT PLAIN_RAY SHEARED WATERTIGHT PLAIN_TRIANGLE OBSERVER SEARCH SET_ASIDE WALK TRAVERSE ONE_HIT SHORT_STACK QUERY DEFER;
        "closest_hit_retry": ARITHMETIC RAY BINDINGS MESH INTERSECT ANY_RAY SHEARED CLOSER_LOOK WATERTIGHT ANY_TRIANGLE OBSERVER SEARCH TAKEN_UP WALK TRAVERSE ONE_HIT PRIVATE_STACK QUERY DEFERRED STRIDED;
        "closest_hit_fast" is "closest_hit": ARITHMETIC RAY BINDINGS MESH INTERSECT PLAIN_RAY MOELLER_TRUMBORE OBSERVER SEARCH NOTHING_ASIDE WALK TRAVERSE ONE_HIT SHORT_STACK QUERY DEFER;
        "closest_hit_retry_fast" is "closest_hit_retry": ARITHMETIC RAY BINDINGS MESH INTERSECT ANY_RAY MOELLER_TRUMBORE OBSERVER SEARCH TAKEN_UP WALK TRAVERSE ONE_HIT PRIVATE_STACK QUERY DEFERRED STRIDED;
        "closest_hit_exact" is "closest_hit": ARITHMETIC RAY BINDINGS MESH INTERSECT PLAIN_RAY SHEARED SCREEN CERTAIN OBSERVER CERTAIN_SEARCH NOTHING_ASIDE WALK TRAVERSE ONE_HIT SHORT_STACK QUERY DEFER;
        "closest_hit_retry_exact" is "closest_hit_retry": ARITHMETIC RAY BINDINGS MESH INTERSECT ANY_RAY SHEARED SCREEN CERTAIN OBSERVER CERTAIN_SEARCH TAKEN_UP WALK TRAVERSE ONE_HIT PRIVATE_STACK QUERY DEFERRED STRIDED;
        "any_hit": ARITHMETIC RAY BINDINGS MESH INTERSECT PLAIN_RAY SHEARED WATERTIGHT PLAIN_TRIANGLE OBSERVER SEARCH SET_ASIDE WALK TRAVERSE ONE_HIT SHORT_STACK QUERY DEFER;
        "any_hit_retry": ARITHMETIC RAY BINDINGS MESH INTERSECT ANY_RAY SHEARED CLOSER_LOOK WATERTIGHT ANY_TRIANGLE OBSERVER SEARCH TAKEN_UP WALK TRAVERSE ONE_HIT PRIVATE_STACK QUERY DEFERRED STRIDED;
        "any_hit_fast" is "any_hit": ARITHMETIC RAY BINDINGS MESH INTERSECT PLAIN_RAY MOELLER_TRUMBORE OBSERVER SEARCH NOTHING_ASIDE WALK TRAVERSE ONE_HIT SHORT_STACK QUERY DEFER;
        "any_hit_retry_fast" is "any_hit_retry": ARITHMETIC RAY BINDINGS MESH INTERSECT ANY_RAY MOELLER_TRUMBORE OBSERVER SEARCH TAKEN_UP WALK TRAVERSE ONE_HIT PRIVATE_STACK QUERY DEFERRED STRIDED;
        "any_hit_exact" is "any_hit": ARITHMETIC RAY BINDINGS MESH INTERSECT PLAIN_RAY SHEARED SCREEN CERTAIN OBSERVER CERTAIN_SEARCH NOTHING_ASIDE WALK TRAVERSE ONE_HIT SHORT_STACK QUERY DEFER;
        "any_hit_retry_exact" is "any_hit_retry": ARITHMETIC RAY BINDINGS MESH INTERSECT ANY_RAY SHEARED SCREEN CERTAIN OBSERVER CERTAIN_SEARCH TAKEN_UP WALK TRAVERSE ONE_HIT PRIVATE_STACK QUERY DEFERRED STRIDED;
        "list_triangles": ARITHMETIC RAY BINDINGS MESH INTERSECT PLAIN_RAY SHEARED SCREEN OBSERVER LIST_SEARCH NOTHING_ASIDE WALK TRAVERSE ONE_HIT SHORT_STACK QUERY LIST DEFER;
        "list_triangles_retry": ARITHMETIC RAY BINDINGS MESH INTERSECT ANY_RAY SHEARED SCREEN OBSERVER LIST_SEARCH NOTHING_ASIDE WALK TRAVERSE ONE_HIT PRIVATE_STACK QUERY LIST DEFERRED STRIDED;
        "count_crossings": ARITHMETIC RAY BINDINGS MESH INTERSECT PLAIN_RAY SHEARED SCREEN CERTAIN OBSERVER COUNT_SEARCH NOTHING_ASIDE WALK TRAVERSE ONE_HIT SHORT_STACK QUERY COUNT_LIST DEFER;
        "count_crossings_retry": ARITHMETIC RAY BINDINGS MESH INTERSECT ANY_RAY SHEARED SCREEN CERTAIN OBSERVER COUNT_SEARCH NOTHING_ASIDE WALK TRAVERSE ONE_HIT PRIVATE_STACK QUERY COUNT_LIST DEFERRED STRIDED;
        "closest_hit_compressed" is "closest_hit": ARITHMETIC RAY COMPRESSED_BINDINGS MESH INTERSECT PLAIN_RAY SHEARED WATERTIGHT PLAIN_TRIANGLE OBSERVER SEARCH SET_ASIDE COMPRESSED_WALK ONE_HIT BOX_STACK QUERY DEFER;
        "any_hit_compressed" is "any_hit": ARITHMETIC RAY COMPRESSED_BINDINGS MESH INTERSECT PLAIN_RAY SHEARED WATERTIGHT PLAIN_TRIANGLE OBSERVER SEARCH SET_ASIDE COMPRESSED_WALK ONE_HIT BOX_STACK QUERY DEFER;
        "enter_instances": ARITHMETIC RAY INTERSECT PLAIN_RAY BOX_WALK SCENE_QUERY;
        "trace_instances": ARITHMETIC RAY SCENE_BINDINGS MESH INTERSECT PLAIN_RAY SHEARED WATERTIGHT PLAIN_TRIANGLE OBSERVER SEARCH NOTHING_ASIDE WALK ONE_HIT SHORT_STACK SCENE_QUERY SEEN ENTERED DEFER;
        "trace_instances_retry": ARITHMETIC RAY SCENE_BINDINGS MESH INTERSECT ANY_RAY SHEARED CLOSER_LOOK WATERTIGHT ANY_TRIANGLE OBSERVER SEARCH NOTHING_ASIDE WALK ONE_HIT PRIVATE_STACK SCENE_QUERY SEEN ENTERED DEFERRED STRIDED;
        "trace_instances_masked" is "trace_instances": ARITHMETIC RAY SCENE_BINDINGS MESH INTERSECT PLAIN_RAY SHEARED WATERTIGHT PLAIN_TRIANGLE OBSERVER OPAQUE_SEARCH NOTHING_ASIDE WALK ONE_HIT SHORT_STACK SCENE_QUERY SEEN ENTERED DEFER;
        "trace_instances_retry_masked" is "trace_instances_retry": ARITHMETIC RAY SCENE_BINDINGS MESH INTERSECT ANY_RAY SHEARED CLOSER_LOOK WATERTIGHT ANY_TRIANGLE OBSERVER OPAQUE_SEARCH NOTHING_ASIDE WALK ONE_HIT PRIVATE_STACK SCENE_QUERY SEEN ENTERED DEFERRED STRIDED;
        "trace_shapes": ARITHMETIC RAY INTERSECT PLAIN_RAY BOX_WALK SCENE_QUERY SEEN SHAPE;
        "triangle_limits": ARITHMETIC;
        "move_vertices": ARITHMETIC;
    }
}

shaders! {
    /// The kernels of the ray tracer, in the order of its schedule, each with all that a scene may
    /// need and the watertight triangle test. [`render_parts`](crate::render_parts) leaves out what it does not.
    RENDER "render" {
        "begin_slice": RENDER_LAYOUT RENDER_KERNEL;
        "camera_rays": ARITHMETIC RAY RENDER_LAYOUT RENDER_KERNEL VECTOR RANDOM;
        "first_costs": ARITHMETIC RAY MESH INTERSECT ANY_RAY SHEARED CLOSER_LOOK WATERTIGHT ANY_TRIANGLE COUNTING_OBSERVER SEARCH NOTHING_ASIDE WALK TRAVERSE ONE_HIT PRIVATE_STACK RENDER_LAYOUT RENDER_KERNEL;
        "closest_hits": ARITHMETIC RAY MESH INTERSECT PLAIN_RAY SHEARED WATERTIGHT PLAIN_TRIANGLE OBSERVER SEARCH SET_ASIDE WALK TRAVERSE ONE_HIT SHORT_STACK RENDER_TREE RENDER_LAYOUT RENDER_KERNEL RENDER_DEFER;
        "first_hits": ARITHMETIC RAY MESH RENDER_LAYOUT RENDER_KERNEL VECTOR PLANE;
        "shade": ARITHMETIC RAY MESH RENDER_LAYOUT RENDER_KERNEL SCAN VECTOR RANDOM SCENE_WORDS TEXTURED ENVIRONMENT INCIDENCE FRESNEL PLANE SMOOTH_NORMALS SURFACE LIGHTING AREA_LIGHTS DIELECTRICS SHADE_SURFACE;
        "scan_spawned": RENDER_LAYOUT RENDER_KERNEL SCAN;
        "shadow_rays": ARITHMETIC RAY MESH RENDER_LAYOUT RENDER_KERNEL SCAN VECTOR RANDOM SCENE_WORDS PLANE SURFACE LIGHTING AREA_LIGHTS;
        "shadow_hits": ARITHMETIC RAY MESH INTERSECT PLAIN_RAY SHEARED WATERTIGHT PLAIN_TRIANGLE OBSERVER SEARCH SET_ASIDE WALK TRAVERSE ONE_HIT SHORT_STACK RENDER_TREE RENDER_LAYOUT RENDER_KERNEL RENDER_DEFER ALWAYS_DECIDED;
        "shadow_hits_through_glass": ARITHMETIC RAY MESH INTERSECT PLAIN_RAY SHEARED WATERTIGHT PLAIN_TRIANGLE OBSERVER SEARCH NOTHING_ASIDE WALK TRAVERSE THROUGH_GLASS SHORT_STACK RENDER_TREE RENDER_LAYOUT RENDER_KERNEL RENDER_DEFER ALWAYS_DECIDED VECTOR SCENE_WORDS;
        "accumulate": ARITHMETIC RENDER_LAYOUT RENDER_KERNEL SCAN VECTOR;
        "next_paths": ARITHMETIC RAY RENDER_LAYOUT RENDER_KERNEL SCAN VECTOR INCIDENCE FRESNEL SCENE_WORDS SURFACE BOUNCE REFRACTION;
        "begin_wave": RENDER_LAYOUT RENDER_KERNEL;
        "resolve": ARITHMETIC RENDER_LAYOUT RENDER_KERNEL SCENE_WORDS TONE;
    }
}

shaders! {
    /// What stands in place of the lean kernels of the ray tracer where the tree has compressed nodes: they bind these in place
    /// of the tree's. Their names are those of the kernels, with `_compressed`.
    RENDER_COMPRESSED "render" {
        "closest_hits_compressed" is "closest_hits": ARITHMETIC RAY MESH INTERSECT PLAIN_RAY SHEARED WATERTIGHT PLAIN_TRIANGLE OBSERVER SEARCH SET_ASIDE COMPRESSED_WALK ONE_HIT BOX_STACK RENDER_COMPRESSED_TREE RENDER_LAYOUT RENDER_KERNEL RENDER_DEFER;
        "shadow_hits_compressed" is "shadow_hits": ARITHMETIC RAY MESH INTERSECT PLAIN_RAY SHEARED WATERTIGHT PLAIN_TRIANGLE OBSERVER SEARCH SET_ASIDE COMPRESSED_WALK ONE_HIT BOX_STACK RENDER_COMPRESSED_TREE RENDER_LAYOUT RENDER_KERNEL RENDER_DEFER ALWAYS_DECIDED;
        "shadow_hits_through_glass_compressed" is "shadow_hits_through_glass": ARITHMETIC RAY MESH INTERSECT PLAIN_RAY SHEARED WATERTIGHT PLAIN_TRIANGLE OBSERVER SEARCH NOTHING_ASIDE COMPRESSED_WALK THROUGH_GLASS BOX_STACK RENDER_COMPRESSED_TREE RENDER_LAYOUT RENDER_KERNEL RENDER_DEFER ALWAYS_DECIDED VECTOR SCENE_WORDS;
    }
}

shaders! {
    /// What finishes what the lean kernels of the ray tracer leave to it. Their names are those of the kernels, with
    /// `_retry`.
    RENDER_RETRIES "render" {
        "closest_hits_retry": ARITHMETIC RAY MESH INTERSECT ANY_RAY SHEARED CLOSER_LOOK WATERTIGHT ANY_TRIANGLE OBSERVER SEARCH TAKEN_UP WALK TRAVERSE ONE_HIT PRIVATE_STACK RENDER_TREE RENDER_LAYOUT RENDER_KERNEL STRIDED;
        "shadow_hits_retry": ARITHMETIC RAY MESH INTERSECT ANY_RAY SHEARED CLOSER_LOOK WATERTIGHT ANY_TRIANGLE OBSERVER SEARCH TAKEN_UP WALK TRAVERSE ONE_HIT PRIVATE_STACK RENDER_TREE RENDER_LAYOUT RENDER_KERNEL ALWAYS_DECIDED STRIDED;
        "shadow_hits_through_glass_retry": ARITHMETIC RAY MESH INTERSECT ANY_RAY SHEARED CLOSER_LOOK WATERTIGHT ANY_TRIANGLE OBSERVER SEARCH NOTHING_ASIDE WALK TRAVERSE THROUGH_GLASS PRIVATE_STACK RENDER_TREE RENDER_LAYOUT RENDER_KERNEL ALWAYS_DECIDED VECTOR SCENE_WORDS STRIDED;
    }
}

shaders! {
    /// What follows the kernels of the ray tracer whose hits are to be exact, and their retries, over the same bindings. Their
    /// names are those of the kernels, with `_settle`.
    RENDER_SETTLES "render" {
        "closest_hits_settle": ARITHMETIC RAY MESH INTERSECT PLAIN_RAY SHEARED SCREEN CERTAIN ROUNDED CERTAIN_RECORD RENDER_LAYOUT RENDER_KERNEL UNDECIDED;
    }
}

/// A part, and what stands in its place.
pub(crate) type Substitute = (Part, &'static [Part]);

/// The parts that replace others where a scene does not need those, or takes another triangle test.
pub(crate) struct Substitutes {
    pub textures: [Substitute; 1],
    pub smooth_normals: [Substitute; 1],
    pub area_lights: [Substitute; 1],
    pub dielectrics: [Substitute; 3],
    pub fast: [Substitute; 5],
    pub certain: [Substitute; 7],
    pub one_binding: [Substitute; 1],
}

pub(crate) const SUBSTITUTES: Substitutes = Substitutes {
    textures: [(TEXTURED, &[UNTEXTURED])],
    smooth_normals: [(SMOOTH_NORMALS, &[FLAT_NORMALS])],
    area_lights: [(AREA_LIGHTS, &[NO_AREA_LIGHTS])],
    dielectrics: [(DIELECTRICS, &[NO_DIELECTRICS]), (REFRACTION, &[NO_REFRACTION]), (FRESNEL, &[])],
    fast: [
        (SHEARED, &[]),
        (CLOSER_LOOK, &[]),
        (WATERTIGHT, &[MOELLER_TRUMBORE]),
        (ANY_TRIANGLE, &[]),
        (PLAIN_TRIANGLE, &[]),
    ],
    certain: [
        (CLOSER_LOOK, &[]),
        (WATERTIGHT, &[SCREEN, CERTAIN, ROUNDED]),
        (ANY_TRIANGLE, &[]),
        (PLAIN_TRIANGLE, &[]),
        (SEARCH, &[CERTAIN_SEARCH]),
        (THROUGH_GLASS, &[THROUGH_GLASS_EXACTLY]),
        (ALWAYS_DECIDED, &[UNDECIDED]),
    ],
    one_binding: [(MESH, &[MESH_WITH_TAIL])],
};

/// The part that replaces another where there are as many invocations as entries of a list.
pub(crate) const ONE_EACH: [(Part, Part); 1] = [(STRIDED, ONE_ENTRY)];

/// The parts that replace others where the stacks of rays are in the memory of the workgroup.
pub(crate) const WORKGROUP_STACKS: [(Part, Part); 2] =
    [(SHORT_STACK, SHORT_STACK_WORKGROUP), (BOX_STACK, BOX_STACK_WORKGROUP)];

/// The part that replaces another in the kernels of the tree builder where lists go on in second bindings.
pub(crate) const BY_HALVES: [(Part, Part); 1] = [(CHILDREN, CHILDREN_BY_HALVES)];

/// What a host's own shader needs for tracing rays, except the bindings, the triangle test and the
/// traversal that goes with it.
pub(crate) const TRAVERSAL: [Part; 6] = [ARITHMETIC, RAY, MESH, INTERSECT, ANY_RAY, OBSERVER];
pub(crate) const TRAVERSAL_BINDINGS: Part = BINDINGS;
pub(crate) const TRAVERSAL_TESTS: [&[Part]; 3] = [
    &[
        SHEARED,
        CLOSER_LOOK,
        WATERTIGHT,
        ANY_TRIANGLE,
        SEARCH,
        NOTHING_ASIDE,
        WALK,
        TRAVERSE,
        ONE_HIT,
        PRIVATE_STACK,
    ],
    &[MOELLER_TRUMBORE, SEARCH, NOTHING_ASIDE, WALK, TRAVERSE, ONE_HIT, PRIVATE_STACK],
    &[
        SHEARED,
        SCREEN,
        CERTAIN,
        CERTAIN_SEARCH,
        NOTHING_ASIDE,
        WALK,
        TRAVERSE,
        ONE_HIT,
        PRIVATE_STACK,
    ],
];

/// What a host's own shader needs for tracing rays through a scene of many objects, except the bindings and [`SCENE_BOXES`].
pub(crate) const SCENE_TRAVERSAL: [Part; 21] = [
    ARITHMETIC,
    RAY,
    MESH,
    INTERSECT,
    ANY_RAY,
    SHEARED,
    CLOSER_LOOK,
    WATERTIGHT,
    ANY_TRIANGLE,
    OBSERVER,
    OPAQUE_SEARCH,
    NOTHING_ASIDE,
    WALK,
    ONE_HIT,
    PRIVATE_STACK,
    SCENE_QUERY,
    SEEN,
    ENTERED,
    SHAPE,
    ENTERED_SHAPES,
    HOST_SCENE,
];
/// The walk through the tree over instances. It has a function that the walk through a mesh has too.
pub(crate) const SCENE_BOXES: Part = BOX_WALK;
pub(crate) const SCENE_TRAVERSAL_BINDINGS: Part = HOST_SCENE_BINDINGS;

shaders! {
    /// The kernels that make compressed nodes from a finished tree, in the order of their schedule.
    COMPRESS "compress" {
        "open_parts": ARITHMETIC AABB MESH COMPRESS_LAYOUT;
        "place_children": COMPRESS_LAYOUT WIDE_SCAN;
        "emit_nodes": ARITHMETIC COMPRESS_LAYOUT;
    }
}

shaders! {
    /// The kernels that build trees of points, in the order of their schedule.
    POINT_BUILD "point_build" {
        "measure_points": ARITHMETIC POINT_LAYOUT;
        "scan_points": ARITHMETIC POINT_LAYOUT WIDE_SCAN;
        "gather_points": ARITHMETIC POINT_LAYOUT WIDE_SCAN;
        "point_extents": ARITHMETIC POINT_LAYOUT;
        "choose_axes": ARITHMETIC POINT_LAYOUT;
        "count_digits": ARITHMETIC POINT_LAYOUT;
        "pick_digits": ARITHMETIC POINT_LAYOUT WIDE_SCAN;
        "count_sides": ARITHMETIC POINT_LAYOUT;
        "place_sides": ARITHMETIC POINT_LAYOUT WIDE_SCAN;
        "scatter_points": ARITHMETIC POINT_LAYOUT WIDE_SCAN;
        "next_height": ARITHMETIC POINT_LAYOUT;
        "build_small_points": ARITHMETIC POINT_LAYOUT;
    }
}

shaders! {
    /// The queries to trees of points, in the order of the table of their set.
    POINTS "points" {
        "nearest_point": ARITHMETIC POINT_WALK POINT_LIST_ONE;
        "nearest_points": ARITHMETIC POINT_WALK POINT_HEAP POINT_HEAP_SHORT;
        "nearest_points_many": ARITHMETIC POINT_WALK POINT_HEAP POINT_HEAP_LONG;
        "count_within": ARITHMETIC POINT_WALK;
        "list_within": ARITHMETIC POINT_WALK;
    }
}

shaders! {
    /// The queries for what is near, in the order of the table of their set.
    NEAR "near" {
        "closest_triangles": ARITHMETIC AABB VECTOR MESH NEAR_LAYOUT NEAR_TRIANGLE NEAR_WALK;
        "overlapped_triangles": ARITHMETIC AABB VECTOR MESH NEAR_LAYOUT NEAR_TRIANGLE NEAR_VOLUME;
    }
}

shaders! {
    /// What the self-test of a device runs.
    CHECKS "checks" {
        "arithmetic_check": ARITHMETIC;
    }
}
