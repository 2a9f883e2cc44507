//! The kernel set of the queries that run on a device, of the data of triangles that they need
//! first, and of vertices that move before a build. There is no schedule: each is one dispatch over what the host counts.

use crate::kernel_set;
use crate::query::traverse::Query;
use crate::ray::{Hit, Ray};
use crate::tree::node::KdNode;

kernel_set! {
    /// Rays through a finished tree on a device.
    set RayQueries "ray queries", counted by QueryCounter;
    every kernel: ;
    exchanged: ;

    /// The inputs of query kernels.
    uniforms QueryUniform {
        /// The scene as a whole: [`layout::SceneUniform`](crate::layout::SceneUniform).
        Scene "scene";
        /// How many rays, and the options: [`layout::BatchUniform`](crate::layout::BatchUniform).
        Batch "batch";
        /// How many rays of a scene of many objects, and the options: [`layout::SceneBatch`](crate::layout::SceneBatch).
        SceneBatch "scene_batch";
        /// How many triangles: [`layout::TriangleCount`](crate::layout::TriangleCount).
        TriangleCount "triangle_count";
        /// How many vertices: [`layout::VertexCount`](crate::layout::VertexCount).
        VertexCount "vertex_count";
    }

    /// The buffers of queries.
    buffers QueryBuffer {
        /// The tree's nodes: [`KdNode`].
        Nodes "nodes", size_of::<KdNode>();
        /// The tree's references.
        LeafReferences "leaf_references", 4;
        /// Snapped corners by triangle index: 9 `f32`.
        Triangles "triangles", 36, live Triangles;
        /// The rays of a batch: [`Ray`].
        Rays "rays", size_of::<Ray>(), live Rays;
        /// The closest hit of each of them: [`Hit`].
        Hits "hits", size_of::<Hit>(), live Rays;
        /// Whether each of them hits anything: a word.
        Occluded "occluded", 4, live Rays;
        /// The triangles that each of them may meet, or that were counted:
        /// [`BatchUniform::room`](crate::layout::BatchUniform::room) words a ray.
        Listed "listed", 4;
        /// How many surfaces each of them crosses for certain: from the front in the lower half of a word, from the back in
        /// the upper half; or a mark.
        Counted "counted", 4, live Rays;
        /// The rays that a lean kernel leaves to another: their number, then their indices.
        Deferred "deferred_rays", 4;
        /// The nodes of a tree's wide form: [`CompressedNode`](crate::query::compressed::CompressedNode).
        CompressedNodes "compressed_nodes", 80;
        /// The references of its leaves.
        CompressedReferences "compressed_references", 4;
        /// The tree over the instances of a scene: [`PackedTopNode`](crate::backend::scene::packed::PackedTopNode).
        BoxNodes "box_nodes", 256;
        /// Its instances: [`PackedInstance`](crate::backend::scene::packed::PackedInstance).
        Instances "instances", 128;
        /// Sets of shapes: [`PackedScene::shapes`](crate::backend::scene::packed::PackedScene::shapes).
        Shapes "shapes", 256;
        /// The closest hit with a scene: [`SceneHit`](crate::scene::SceneHit).
        SceneHits "scene_hits", 24, live Rays;
        /// The way of each ray through the tree over instances: [`SceneBatch::way`](crate::layout::SceneBatch::way) words a
        /// ray, of all rays one after the other. The instance that it has entered, or `u32::MAX`; one more than the number
        /// of its stack's entries, 0 for a ray that has not begun, `u32::MAX` for one that is done; the entries.
        Ways "ways", 4;
        /// Instances entered by all rays since the host set this to zero, and rays that are done.
        WaveCounts "wave_counts", 4;
        /// The range of coordinates and sizes of all triangles: four `f32`, see
        /// [`query::intersect::Limits`](crate::query::intersect::Limits).
        Limits "limits", 16;
        /// Positions at rest: three `f32` each.
        RestPositions "rest_positions", 12, live Vertices;
        /// The group of each vertex.
        VertexGroups "vertex_groups", 4, live Vertices;
        /// A transform of each group: [`Transform`](crate::scene::Transform), with numbers below 2^-126 as +0.
        Transforms "transforms", 48;
        /// Positions: three `f32` each.
        Positions "positions", 12, live Vertices;
    }

    /// The kernels of queries. Each is a file of the same name, joined with one triangle test or
    /// another.
    kernels QueryKernel {
        /// The closest hit of every ray of the plain case.
        ClosestHit "closest_hit", Invocations(Rays, 64) =>
            reads Nodes, reads LeafReferences, reads Triangles, uniform Scene,
            reads Rays, writes Hits, uniform Batch, updates Deferred;
        /// The closest hit of every ray that the kernel before deferred.
        ClosestHitRetry "closest_hit_retry", Few(Rays, 64) =>
            reads Nodes, reads LeafReferences, reads Triangles, uniform Scene,
            reads Rays, scatters Hits, uniform Batch, reads Deferred;
        /// Whether every ray of the plain case hits anything.
        AnyHit "any_hit", Invocations(Rays, 64) =>
            reads Nodes, reads LeafReferences, reads Triangles, uniform Scene,
            reads Rays, writes Occluded, uniform Batch, updates Deferred;
        /// Whether every ray that the kernel before deferred hits anything.
        AnyHitRetry "any_hit_retry", Few(Rays, 64) =>
            reads Nodes, reads LeafReferences, reads Triangles, uniform Scene,
            reads Rays, scatters Occluded, uniform Batch, reads Deferred;
        /// The triangles that every ray of the plain case may meet.
        ListTriangles "list_triangles", Invocations(Rays, 64) =>
            reads Nodes, reads LeafReferences, reads Triangles, uniform Scene,
            reads Rays, scatters Listed, uniform Batch, updates Deferred;
        /// The triangles that every ray that the kernel before deferred may meet.
        ListTrianglesRetry "list_triangles_retry", Few(Rays, 64) =>
            reads Nodes, reads LeafReferences, reads Triangles, uniform Scene,
            reads Rays, scatters Listed, uniform Batch, reads Deferred;
        /// How many surfaces every ray of the plain case crosses.
        CountCrossings "count_crossings", Invocations(Rays, 64) =>
            reads Nodes, reads LeafReferences, reads Triangles, uniform Scene,
            reads Rays, updates Listed, uniform Batch, updates Deferred, writes Counted;
        /// How many surfaces every ray that the kernel before deferred crosses.
        CountCrossingsRetry "count_crossings_retry", Few(Rays, 64) =>
            reads Nodes, reads LeafReferences, reads Triangles, uniform Scene,
            reads Rays, updates Listed, uniform Batch, reads Deferred, scatters Counted;
        /// As `closest_hit`, through compressed nodes.
        ClosestHitCompressed "closest_hit_compressed", Invocations(Rays, 64) =>
            reads CompressedNodes, reads CompressedReferences, reads Triangles, uniform Scene,
            reads Rays, writes Hits, uniform Batch, updates Deferred;
        /// As `any_hit`, through compressed nodes.
        AnyHitCompressed "any_hit_compressed", Invocations(Rays, 64) =>
            reads CompressedNodes, reads CompressedReferences, reads Triangles, uniform Scene,
            reads Rays, writes Occluded, uniform Batch, updates Deferred;
        /// The next instance of a scene that every ray enters.
        EnterInstances "enter_instances", Invocations(Rays, 64) =>
            reads BoxNodes, reads Instances, reads Rays, updates SceneHits,
            uniform SceneBatch, scatters Deferred, updates Ways, updates WaveCounts;
        /// The closest hit, or any, of every ray with the instance that it has entered, in the plain case. Nodes,
        /// references and triangles are those of all geometries.
        TraceInstances "trace_instances", Invocations(Rays, 64) =>
            reads Nodes, reads LeafReferences, reads Triangles, reads Instances,
            reads Rays, updates SceneHits, uniform SceneBatch, updates Deferred, reads Ways;
        /// The same of every ray that the kernel before deferred.
        TraceInstancesRetry "trace_instances_retry", Few(Rays, 64) =>
            reads Nodes, reads LeafReferences, reads Triangles, reads Instances,
            reads Rays, updates SceneHits, uniform SceneBatch, reads Deferred, reads Ways;
        /// As `trace_instances`, where a geometry has an opacity mask: hits count in cells that are opaque.
        TraceInstancesMasked "trace_instances_masked", Invocations(Rays, 64) =>
            reads Nodes, reads LeafReferences, reads Triangles, reads Instances,
            reads Rays, updates SceneHits, uniform SceneBatch, updates Deferred, reads Ways;
        /// The same of every ray that the kernel before deferred.
        TraceInstancesRetryMasked "trace_instances_retry_masked", Few(Rays, 64) =>
            reads Nodes, reads LeafReferences, reads Triangles, reads Instances,
            reads Rays, updates SceneHits, uniform SceneBatch, reads Deferred, reads Ways;
        /// The closest hit, or any, of every ray with the set of shapes of which it has entered an instance.
        TraceShapes "trace_shapes", Invocations(Rays, 64) =>
            reads Shapes, reads Instances, reads Rays, updates SceneHits, uniform SceneBatch, reads Ways;
        /// The range of coordinates and sizes of the triangles.
        TriangleLimits "triangle_limits", Invocations(Triangles, 256) =>
            reads Triangles, uniform TriangleCount, updates Limits;
        /// Moves every vertex by the transform of its group: see [`scene::moved`](crate::scene::moved).
        MoveVertices "move_vertices", Invocations(Vertices, 64) =>
            reads RestPositions, reads VertexGroups, reads Transforms, uniform VertexCount, writes Positions;
    }
}

impl QueryKernel {
    /// The kernels that answer a query, one after the other: a lean one for the plain case, and one for the
    /// rays that it defers.
    pub const fn of(query: Query) -> [QueryKernel; 2] {
        match query {
            Query::Closest => [QueryKernel::ClosestHit, QueryKernel::ClosestHitRetry],
            Query::Any => [QueryKernel::AnyHit, QueryKernel::AnyHitRetry],
        }
    }

    /// The kernels that list the triangles which rays may meet, likewise.
    pub const LISTING: [QueryKernel; 2] =
        [QueryKernel::ListTriangles, QueryKernel::ListTrianglesRetry];

    /// The kernels that count crossings, likewise.
    pub const COUNTING: [QueryKernel; 2] =
        [QueryKernel::CountCrossings, QueryKernel::CountCrossingsRetry];

    /// The same for a tree that has compressed nodes. What is deferred goes through the tree itself.
    pub const fn of_compressed(query: Query) -> [QueryKernel; 2] {
        match query {
            Query::Closest => [QueryKernel::ClosestHitCompressed, QueryKernel::ClosestHitRetry],
            Query::Any => [QueryKernel::AnyHitCompressed, QueryKernel::AnyHitRetry],
        }
    }

    /// The kernels of a wave, one after the other: every ray that is not done enters its next instance, and is traced
    /// there.
    pub const WAVE: [QueryKernel; 3] = [
        QueryKernel::EnterInstances,
        QueryKernel::TraceInstances,
        QueryKernel::TraceInstancesRetry,
    ];

    /// The same for a scene in which a geometry has an opacity mask.
    pub const MASKED_WAVE: [QueryKernel; 3] = [
        QueryKernel::EnterInstances,
        QueryKernel::TraceInstancesMasked,
        QueryKernel::TraceInstancesRetryMasked,
    ];

    /// Bytes of the list of deferred rays of a batch: a number, and for each an index and what is left of its walk.
    pub const fn deferred_bytes(rays: u32) -> u64 {
        4 + 16 * rays as u64
    }

    /// Bytes of an answer to a query: what its kernel writes for each ray.
    pub const fn result_bytes(query: Query) -> u64 {
        match query {
            Query::Closest => size_of::<Hit>() as u64,
            Query::Any => size_of::<u32>() as u64,
        }
    }
}

/// What the host counts for queries.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum QueryCounter {
    /// Rays of a batch.
    Rays,
    /// Triangles of a mesh.
    Triangles,
    /// Vertices of a mesh.
    Vertices,
}
