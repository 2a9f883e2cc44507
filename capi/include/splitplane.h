/* splitplane: SAH kd-trees for ray tracing. Made of the sources by cbindgen; the guide's page on C explains it.
 *
 * Every call returns a status, 0 (SPLITPLANE_STATUS_OK) if it did what it says. Arrays are given by pointer, stride in bytes and count. Handles are numbers; 0 names nothing. */

#ifndef SPLITPLANE_H
#define SPLITPLANE_H

#include <stddef.h>
#include <stdint.h>

#define SPLITPLANE_VERSION "0.1.0"

// No triangle, instance, geometry or point: what records of a miss have.
#define SPLITPLANE_NONE UINT32_MAX

// The winding number of a point that lies on a surface.
#define SPLITPLANE_BOUNDARY INT32_MIN

// What every call returns. After anything but `SPLITPLANE_STATUS_OK`, `splitplane_last_message` says more. Numbers keep their meaning; more may come.
enum splitplane_status
#if defined(__cplusplus) || __STDC_VERSION__ >= 202311L
  : int32_t
#endif // defined(__cplusplus) || __STDC_VERSION__ >= 202311L
 {
    // It is done.
    SPLITPLANE_STATUS_OK = 0,
    // A pointer is NULL that must not be.
    SPLITPLANE_STATUS_NULL_POINTER = 1,
    // A pointer is not a multiple of what its type needs: 4 for `float` and `uint32_t`, 8 for records with `double`.
    SPLITPLANE_STATUS_MISALIGNED = 2,
    // A stride is less than the size of an item, or not a multiple of its alignment.
    SPLITPLANE_STATUS_STRIDE = 3,
    // A count for which no array can have room, or that is too great for this call.
    SPLITPLANE_STATUS_COUNT = 4,
    // An array that is written shares bytes with one that is read.
    SPLITPLANE_STATUS_OVERLAP = 5,
    // A setting that does not exist, is out of range, or means nothing for this call.
    SPLITPLANE_STATUS_OPTION = 6,
    // A handle that was never given, that is freed, or of something else.
    SPLITPLANE_STATUS_HANDLE = 7,
    // Another call is changing the object, or is asking it while this one would change it.
    SPLITPLANE_STATUS_BUSY = 8,
    // The scene was edited, and no update was tried since.
    SPLITPLANE_STATUS_STALE = 9,
    // There is less room than the answer needs.
    SPLITPLANE_STATUS_CAPACITY = 10,
    // Arrays that are not a mesh: an index out of range, or too many triangles.
    SPLITPLANE_STATUS_MESH = 11,
    // A scene has no geometry or instance of this number.
    SPLITPLANE_STATUS_UNKNOWN_ID = 12,
    // A scene cannot have this: a transform that is not finite or has no inverse, a geometry that is removed while it has instances, a mesh or a mask where there are shapes.
    SPLITPLANE_STATUS_SCENE = 13,
    // A tree would be too large for its format.
    SPLITPLANE_STATUS_BUILD = 14,
    // More memory than is allowed, or than there is.
    SPLITPLANE_STATUS_OUT_OF_MEMORY = 15,
    // The progress function ended the call.
    SPLITPLANE_STATUS_CANCELLED = 16,
    // A tree and a mesh that do not belong together.
    SPLITPLANE_STATUS_WRONG_MESH = 17,
    // The backend does not do this.
    SPLITPLANE_STATUS_UNSUPPORTED = 18,
    // Bytes that are not a file of this kind, or a damaged one.
    SPLITPLANE_STATUS_FILE = 19,
    // The system could not read or write a file.
    SPLITPLANE_STATUS_IO = 20,
    // A text that is not UTF-8, or has no end within 4096 bytes.
    SPLITPLANE_STATUS_TEXT = 21,
    // A backend could not be opened.
    SPLITPLANE_STATUS_OPEN = 22,
    // A device failed.
    SPLITPLANE_STATUS_DEVICE = 23,
    // A fault of the library. Objects that the call was changing should be freed.
    SPLITPLANE_STATUS_INTERNAL = 70,
};
#ifndef __cplusplus
#if __STDC_VERSION__ >= 202311L
typedef enum splitplane_status splitplane_status;
#else
typedef int32_t splitplane_status;
#endif // __STDC_VERSION__ >= 202311L
#endif // __cplusplus

// Which builder makes a tree.
enum splitplane_preset
#if defined(__cplusplus) || __STDC_VERSION__ >= 202311L
  : uint32_t
#endif // defined(__cplusplus) || __STDC_VERSION__ >= 202311L
 {
    // The fastest build.
    SPLITPLANE_PRESET_FAST = 0,
    // Small leaves, for rays that test one triangle at a time.
    SPLITPLANE_PRESET_NARROW = 1,
    // A better tree for a slower build.
    SPLITPLANE_PRESET_BALANCED = 2,
    // The best tree, offline; on the CPU only.
    SPLITPLANE_PRESET_BEST = 3,
};
#ifndef __cplusplus
#if __STDC_VERSION__ >= 202311L
typedef enum splitplane_preset splitplane_preset;
#else
typedef uint32_t splitplane_preset;
#endif // __STDC_VERSION__ >= 202311L
#endif // __cplusplus

// What queries read of a tree. Answers do not depend on it.
enum splitplane_layout
#if defined(__cplusplus) || __STDC_VERSION__ >= 202311L
  : uint32_t
#endif // defined(__cplusplus) || __STDC_VERSION__ >= 202311L
 {
    // Copies of triangles as the test reads them.
    SPLITPLANE_LAYOUT_FAST = 0,
    // A third to a half of the memory, and slower rays.
    SPLITPLANE_LAYOUT_COMPACT = 1,
};
#ifndef __cplusplus
#if __STDC_VERSION__ >= 202311L
typedef enum splitplane_layout splitplane_layout;
#else
typedef uint32_t splitplane_layout;
#endif // __STDC_VERSION__ >= 202311L
#endif // __cplusplus

// Which ray and triangle test answers.
enum splitplane_accuracy
#if defined(__cplusplus) || __STDC_VERSION__ >= 202311L
  : uint32_t
#endif // defined(__cplusplus) || __STDC_VERSION__ >= 202311L
 {
    // No ray slips between two triangles that share an edge or a corner. The default.
    SPLITPLANE_ACCURACY_WATERTIGHT = 0,
    // Rays aimed at edges and corners may leak.
    SPLITPLANE_ACCURACY_FAST = 1,
    // The hit that real arithmetic gives.
    SPLITPLANE_ACCURACY_EXACT = 2,
};
#ifndef __cplusplus
#if __STDC_VERSION__ >= 202311L
typedef enum splitplane_accuracy splitplane_accuracy;
#else
typedef uint32_t splitplane_accuracy;
#endif // __STDC_VERSION__ >= 202311L
#endif // __cplusplus

// Which side of triangles is ignored. The front is where the corners run counter-clockwise.
enum splitplane_culling
#if defined(__cplusplus) || __STDC_VERSION__ >= 202311L
  : uint32_t
#endif // defined(__cplusplus) || __STDC_VERSION__ >= 202311L
 {
    // Both sides count.
    SPLITPLANE_CULLING_NONE = 0,
    // Triangles seen from the back are ignored.
    SPLITPLANE_CULLING_BACK = 1,
    // Triangles seen from the front are ignored.
    SPLITPLANE_CULLING_FRONT = 2,
};
#ifndef __cplusplus
#if __STDC_VERSION__ >= 202311L
typedef enum splitplane_culling splitplane_culling;
#else
typedef uint32_t splitplane_culling;
#endif // __STDC_VERSION__ >= 202311L
#endif // __cplusplus

// How axes of a point tree are chosen.
enum splitplane_point_axes
#if defined(__cplusplus) || __STDC_VERSION__ >= 202311L
  : uint32_t
#endif // defined(__cplusplus) || __STDC_VERSION__ >= 202311L
 {
    // The axis along which the points of a node reach farthest.
    SPLITPLANE_POINT_AXES_WIDEST = 0,
    // By level, one after the other.
    SPLITPLANE_POINT_AXES_CYCLE = 1,
};
#ifndef __cplusplus
#if __STDC_VERSION__ >= 202311L
typedef enum splitplane_point_axes splitplane_point_axes;
#else
typedef uint32_t splitplane_point_axes;
#endif // __STDC_VERSION__ >= 202311L
#endif // __cplusplus

// What a set of shapes consists of.
enum splitplane_shape_kind
#if defined(__cplusplus) || __STDC_VERSION__ >= 202311L
  : uint32_t
#endif // defined(__cplusplus) || __STDC_VERSION__ >= 202311L
 {
    // Spheres: 4 numbers each, the centre and the radius.
    SPLITPLANE_SHAPE_KIND_SPHERES = 0,
    // Capsules, all points within a radius of a segment: 7 numbers each, both ends of the segment and the radius.
    SPLITPLANE_SHAPE_KIND_CAPSULES = 1,
    // Shapes of yours: 6 numbers each, the lower and the upper corner of the box that it is in. On the CPU only.
    SPLITPLANE_SHAPE_KIND_OWN = 2,
};
#ifndef __cplusplus
#if __STDC_VERSION__ >= 202311L
typedef enum splitplane_shape_kind splitplane_shape_kind;
#else
typedef uint32_t splitplane_shape_kind;
#endif // __STDC_VERSION__ >= 202311L
#endif // __cplusplus

// What volumes are.
enum splitplane_volume_kind
#if defined(__cplusplus) || __STDC_VERSION__ >= 202311L
  : uint32_t
#endif // defined(__cplusplus) || __STDC_VERSION__ >= 202311L
 {
    // Boxes: 6 numbers each, the lower and the upper corner. Sides may be infinite.
    SPLITPLANE_VOLUME_KIND_BOX = 0,
    // Balls: 4 numbers each, the centre and the radius, 0 or more.
    SPLITPLANE_VOLUME_KIND_BALL = 1,
    // Capsules: 7 numbers each, both ends of a segment and the radius, 0 or more.
    SPLITPLANE_VOLUME_KIND_CAPSULE = 2,
    // Triangles, such as those of another mesh: 9 numbers each.
    SPLITPLANE_VOLUME_KIND_TRIANGLE = 3,
    // Sets of half-spaces, such as frusta: 4 numbers for a plane, the normal n, which points outwards and may have any length, and the offset d: the points with n . x <= d.
    // What is in all half-spaces of a set.
    SPLITPLANE_VOLUME_KIND_PLANES = 4,
};
#ifndef __cplusplus
#if __STDC_VERSION__ >= 202311L
typedef enum splitplane_volume_kind splitplane_volume_kind;
#else
typedef uint32_t splitplane_volume_kind;
#endif // __STDC_VERSION__ >= 202311L
#endif // __cplusplus

// A change to a preset: `traversal_cost`, `intersection_cost`, `block_width`, `max_depth`, `references_per_triangle`, `clip`, `small_node_limit`, `empty_cutoff`,
// `nodes_per_triangle`, `bins`, `empty_bonus`, `bad_splits`.
typedef struct splitplane_knob {
    // Its name.
    const char *name;
    // Its value; of `clip` 0 or 1.
    uint32_t value;
} splitplane_knob;

// Told how far a call has come: `user` is that of the options; `stage` a text that stays; `total` is 0 where it is not known. Returns 0 to go on, anything else to end the
// call with `SPLITPLANE_STATUS_CANCELLED`. Called from any thread, by one at a time for each call, and often; it must not throw, `longjmp`, or free what the call uses.
typedef int32_t (*splitplane_progress)(void *user, const char *stage, uint64_t done, uint64_t total);

// Settings of builds, loads and updates. `splitplane_build_options_init` first.
typedef struct splitplane_build_options {
    // `sizeof(splitplane_build_options)`.
    size_t size;
    // A `splitplane_preset`; for loads, which find it in the file, the default.
    uint32_t preset;
    // A `splitplane_layout`.
    uint32_t layout;
    // Changes to the preset; may be NULL where there are none.
    const struct splitplane_knob *knobs;
    // How many.
    size_t knob_count;
    // Most bytes that the build may hold besides your arrays; 0 for no limit.
    uint64_t max_memory;
    // Told how far it is; may be NULL.
    splitplane_progress progress;
    // Handed to it.
    void *user;
    // Threads that work, at most 1024; 0 for as many as there are cores, or as the environment's `RAYON_NUM_THREADS` says.
    uint32_t threads;
    // 0.
    uint32_t reserved;
} splitplane_build_options;

// Where a ray meets a triangle of an instance.
typedef struct splitplane_scene_hit {
    // Distance in units of the ray's direction; infinity for a miss.
    float t;
    // Weight of the second corner.
    float u;
    // Weight of the third corner.
    float v;
    // The triangle's place in the geometry's arrays; `SPLITPLANE_NONE` for a miss, as the next two.
    uint32_t triangle;
    // The geometry.
    uint32_t geometry;
    // The instance.
    uint32_t instance;
} splitplane_scene_hit;

// Decides which hits count: `user` is `filter_user` of the options. Returns 0 for a hit that is to count as not there, anything else for one that counts. Called from any thread, by several at a
// time. For the same hit it has to return the same, whoever asks and how often; it must not throw or `longjmp`.
typedef int32_t (*splitplane_filter)(void *user, const struct splitplane_scene_hit *hit);

// The same for points of a cloud, by their places in your array.
typedef int32_t (*splitplane_point_filter)(void *user, uint32_t point);

// Settings of queries. `splitplane_query_options_init` first. What a call does not use must be as it was then.
typedef struct splitplane_query_options {
    // `sizeof(splitplane_query_options)`.
    size_t size;
    // A `splitplane_accuracy`. Of closest points `EXACT` finds the nearest triangle of real arithmetic, the others that of the least distance in `double`.
    uint32_t accuracy;
    // A `splitplane_culling`.
    uint32_t culling;
    // Scenes: instances answer when a bit of theirs is in this mask.
    uint32_t mask;
    // A triangle to ignore, for all rays or points of the call; `SPLITPLANE_NONE` for none.
    uint32_t ignore_triangle;
    // Scenes: its instance.
    uint32_t ignore_instance;
    // Closest points and points of a cloud: nothing farther away is looked for. Not NaN; infinity for no limit.
    float max_distance;
    // Answers of unknown length, points inside, nearest points: most bytes that they and their parts may take; 0 for no limit.
    uint64_t max_memory;
    // Told how far it is; may be NULL.
    splitplane_progress progress;
    // Handed to it.
    void *user;
    // Hits, crossings and their number in scenes: decides on the CPU which count; NULL: all do.
    splitplane_filter filter;
    // Points of a cloud: decides on the CPU which count; NULL: all do.
    splitplane_point_filter point_filter;
    // Handed to both.
    void *filter_user;
    // Threads that work, at most 1024; 0 for as many as there are cores, or as the environment's `RAYON_NUM_THREADS` says.
    uint32_t threads;
    // 0.
    uint32_t reserved;
} splitplane_query_options;

// An opened backend. 0 names none, as in all handles.
typedef struct splitplane_backend {
    // A number that means nothing.
    uint64_t id;
} splitplane_backend;

// The triangles of a mesh, in your arrays. They are read while a call runs that is given them, and not changed.
typedef struct splitplane_mesh {
    // x, y and z of the first corner.
    const float *positions;
    // Bytes from one position to the next: 12 where nothing is between them.
    size_t position_stride;
    // How many positions.
    size_t position_count;
    // The three corners of the first triangle; NULL where every three positions are a triangle.
    const uint32_t *indices;
    // Bytes from one triangle to the next: 12 where nothing is between them. 0 without indices.
    size_t index_stride;
    // How many triangles; without indices a third of the positions.
    size_t triangle_count;
} splitplane_mesh;

// A tree over one mesh.
typedef struct splitplane_tree {
    // A number that means nothing.
    uint64_t id;
} splitplane_tree;

// What a build did with its input, and what came of it.
typedef struct splitplane_tree_summary {
    // Triangles of the mesh.
    uint32_t triangles;
    // Triangles left out: a coordinate that is not finite, or two equal corners.
    uint32_t dropped;
    // Triangles with a coordinate that was snapped to 0: less than 2^-126.
    uint32_t snapped;
    // 0.
    uint32_t reserved;
    // Nodes of the tree.
    uint64_t nodes;
    // References of its leaves to triangles.
    uint64_t references;
    // Most bytes that the build held at once besides your arrays.
    uint64_t peak_bytes;
    // Bytes that queries read.
    uint64_t query_bytes;
    // Lower corner of the box around all triangles that are kept.
    float lower[3];
    // Upper corner.
    float upper[3];
} splitplane_tree_summary;

// Rays in your arrays: the points `origin + t * direction` with `t_min <= t <= t_max`. `t` is in units of the direction's length.
//
// A ray with an origin or direction that is not finite, a direction of zeros or a limit that is NaN hits nothing. Records of eight floats (origin, least t, direction, greatest t)
// with all four strides 32 are read where they lie. So are rows of six (origin, direction) with both strides 24 and limits that all rays have, by closest and any hits of a tree.
// Others are copied, some at a time.
typedef struct splitplane_rays {
    // x, y and z of the first origin.
    const float *origins;
    // Bytes from one to the next.
    size_t origin_stride;
    // x, y and z of the first direction, of any length but zero.
    const float *directions;
    // Bytes from one to the next.
    size_t direction_stride;
    // Least t; NULL for 0.
    const float *t_min;
    // Bytes from one to the next; 0: all rays have the first one.
    size_t t_min_stride;
    // Greatest t; NULL for infinity.
    const float *t_max;
    // Bytes from one to the next; 0: all rays have the first one.
    size_t t_max_stride;
    // How many rays.
    size_t count;
} splitplane_rays;

// Where a ray meets a triangle: at `(1 - u - v) * a + u * b + v * c` for its corners `a`, `b`, `c`.
typedef struct splitplane_hit {
    // Distance in units of the ray's direction; infinity for a miss.
    float t;
    // The triangle's place in your arrays; `SPLITPLANE_NONE` for a miss.
    uint32_t triangle;
    // Weight of the second corner.
    float u;
    // Weight of the third corner.
    float v;
} splitplane_hit;

// How a batch was answered. All 0 for the CPU backend.
typedef struct splitplane_report {
    // Rays or points of which a device left something undecided; the CPU decided it.
    uint64_t undecided;
    // Rays that a device's driver did not follow to their end; the CPU answered them.
    uint64_t unfinished;
    // Rays or points that the CPU answered alone for a device.
    uint64_t answered_by_cpu;
    // Rays through scenes that the CPU took from instance to instance, for a device that does not hold the scene: it answers in each.
    uint64_t placed_by_cpu;
} splitplane_report;

// Answers of different length: a list of records for each ray or point that was asked for.
typedef struct splitplane_lists {
    // A number that means nothing.
    uint64_t id;
} splitplane_lists;

// The point of a mesh that is closest to a point.
typedef struct splitplane_closest_point {
    // The square of the distance; infinity where there is none.
    double distance_squared;
    // x, y and z.
    float point[3];
    // The triangle's place in your arrays; `SPLITPLANE_NONE` where there is none.
    uint32_t triangle;
    // Weight of the second corner.
    float u;
    // Weight of the third corner.
    float v;
} splitplane_closest_point;

// A scene of many objects.
typedef struct splitplane_scene {
    // A number that means nothing.
    uint64_t id;
} splitplane_scene;

// A geometry, placed in the world.
typedef struct splitplane_instance {
    // From the object to the world: three rows of four, the last column is the translation. It has to have an inverse.
    float transform[12];
    // The geometry.
    uint32_t geometry;
    // Queries enter the instance when a bit of their mask is in this one.
    uint32_t mask;
    // A number of yours, which means nothing here.
    uint32_t id;
    // A `splitplane_culling`: the side that this instance ignores, whatever the query.
    uint32_t culling;
} splitplane_instance;

// What an update did.
typedef struct splitplane_update_report {
    // Geometries that were built.
    uint32_t geometries_built;
    // Geometries that were dropped.
    uint32_t geometries_dropped;
    // Instances that came, went or changed.
    uint32_t instances_changed;
    // 1 where the tree over the instances was built anew.
    uint32_t top_rebuilt;
    // Nodes of that tree that have new boxes.
    uint64_t top_nodes_changed;
} splitplane_update_report;

// Says whether rays meet a place of a triangle, by the weights of its second and third corner: anything but 0 if they do. `user` is that of the call. Called by the thread that
// makes the call; it must not throw or `longjmp`.
typedef int32_t (*splitplane_opacity)(void *user, uint32_t triangle, float u, float v);

// A place where a ray meets a shape of yours.
typedef struct splitplane_shape_hit {
    // Where on the ray, in units of its direction. It counts where it is finite and between the ray's limits.
    float t;
    // Two numbers of yours, which hits carry.
    float u;
    // The other one.
    float v;
    // Anything but 0 where the ray comes from the front, which culling tells from the back.
    uint32_t front;
} splitplane_shape_hit;

// Takes a place where a ray meets a shape: `to` is what the intersect function was given.
typedef void (*splitplane_show_hit)(void *to, const struct splitplane_shape_hit *hit);

// Intersects a shape of yours: calls `show(to, hit)` for every place where the ray meets it, in any order. `user` is that of the shapes. `ray` is eight floats in the object's space: origin, least t,
// direction, greatest t; hits beyond the limits are not needed. For the same ray and primitive it has to show the same places, each in the primitive's box to within 2^-16 of (the
// greatest of the ray's origin, and of the box). Called from any thread, by several at a time; it must not throw, `longjmp`, or keep `ray` and `to`.
typedef void (*splitplane_intersect)(void *user,
                                     uint32_t primitive,
                                     const float *ray,
                                     splitplane_show_hit show,
                                     void *to);

// Told that nothing uses `user` any more. Called once, by any thread, maybe in the middle of a call that changes the scene: it must not throw or `longjmp`, and calls for that scene are `SPLITPLANE_STATUS_BUSY`.
typedef void (*splitplane_release)(void *user);

// A set of shapes. Hits name a shape as they do a triangle. One with a number that is not finite, a radius that is not more than 0 or a box that is empty is left out.
typedef struct splitplane_shapes {
    // A `splitplane_shape_kind`.
    uint32_t kind;
    // 0.
    uint32_t reserved;
    // Numbers of the first shape. They are copied.
    const float *numbers;
    // Bytes from one shape to the next.
    size_t stride;
    // How many shapes, less than 2^28.
    size_t count;
    // Intersects shapes of yours; NULL for others.
    splitplane_intersect intersect;
    // Handed to it.
    void *user;
    // Told when the library is done with `user`: the scene is freed or has other shapes, and no call uses them. May be NULL. Not called where the call fails that was given the shapes.
    splitplane_release release;
} splitplane_shapes;

// The point of a scene that is closest to a point.
typedef struct splitplane_scene_closest_point {
    // The square of the distance; infinity where there is none.
    double distance_squared;
    // x, y and z in the world.
    float point[3];
    // The triangle's place in the geometry's arrays; `SPLITPLANE_NONE` where there is none, as the last two.
    uint32_t triangle;
    // Weight of the second corner.
    float u;
    // Weight of the third corner.
    float v;
    // The geometry.
    uint32_t geometry;
    // The instance.
    uint32_t instance;
} splitplane_scene_closest_point;

// Volumes in your arrays. One with a number that is NaN, or that is empty, meets nothing.
typedef struct splitplane_volumes {
    // A `splitplane_volume_kind`.
    uint32_t kind;
    // 0.
    uint32_t reserved;
    // Numbers of the first volume, or of the first plane.
    const float *numbers;
    // Bytes from one volume, or plane, to the next.
    size_t stride;
    // How many volumes.
    size_t count;
    // Of sets of planes, where those of each set begin, and after them how many planes there are: `count + 1` numbers, the first 0, none less than the one before. NULL for others.
    const uint64_t *starts;
} splitplane_volumes;

// What moves along rays: balls, or capsules, which are all points within a radius of a segment.
typedef struct splitplane_bodies {
    // The first radius, 0 or more.
    const float *radii;
    // Bytes from one to the next; 0: all have the first one.
    size_t radius_stride;
    // Of capsules, x, y and z from the end of the first segment that moves along the ray to the other end; NULL for balls.
    const float *axes;
    // Bytes from one to the next; 0: all have the first one.
    size_t axis_stride;
} splitplane_bodies;

// What a body touches first.
typedef struct splitplane_impact {
    // When, in units of the ray's direction: its least t where they touch from the start. Infinity where nothing is touched.
    float t;
    // The triangle's place in your arrays; `SPLITPLANE_NONE` where nothing is touched.
    uint32_t triangle;
} splitplane_impact;

// A tree of points.
typedef struct splitplane_point_tree {
    // A number that means nothing.
    uint64_t id;
} splitplane_point_tree;

// What a build of points did.
typedef struct splitplane_point_tree_summary {
    // Points given.
    uint32_t points;
    // Points left out: a coordinate that is not finite.
    uint32_t dropped;
    // Bytes of the tree and of what searches it.
    uint64_t bytes;
} splitplane_point_tree_summary;

// A point of a cloud.
typedef struct splitplane_neighbour {
    // The square of its distance; infinity where there is none.
    double distance_squared;
    // Its place in your array; `SPLITPLANE_NONE` where there is none.
    uint32_t point;
    // 0.
    uint32_t reserved;
} splitplane_neighbour;

// A place where a ray crosses a surface.
typedef struct splitplane_crossing {
    // Distance in units of the ray's direction.
    float t;
    // The triangle's place in the arrays of the mesh or geometry.
    uint32_t triangle;
    // Weight of the second corner.
    float u;
    // Weight of the third corner.
    float v;
    // The geometry; `SPLITPLANE_NONE` for a tree, as the next one.
    uint32_t geometry;
    // The instance.
    uint32_t instance;
    // 1 where the ray comes from the front: the side from which the corners run counter-clockwise.
    uint32_t front;
} splitplane_crossing;

// A triangle that a volume meets.
typedef struct splitplane_overlap {
    // The triangle's place in the arrays of the mesh or geometry.
    uint32_t triangle;
    // The instance; `SPLITPLANE_NONE` for a tree.
    uint32_t instance;
} splitplane_overlap;

#ifdef __cplusplus
extern "C" {
#endif // __cplusplus

// Why the last call of this thread failed that did: UTF-8, empty if none has. The text is there until another call of this thread fails.
//
// Threads: each has its own.
const char *splitplane_last_message(void);

// The version of the library, such as `0.1.0`. `SPLITPLANE_VERSION` is that of the header.
//
// Threads: any.
const char *splitplane_version(void);

// How many objects there are: handles that were given and not freed. For tests of who frees what.
//
// Threads: any.
uint64_t splitplane_live_handles(void);

// Sets the defaults: preset fast, no limit, all cores. `size` is `sizeof(splitplane_build_options)`.
//
// Threads: any.
splitplane_status splitplane_build_options_init(struct splitplane_build_options *options, size_t size);

// Sets the defaults: watertight, nothing ignored, no limit, all cores. `size` is `sizeof(splitplane_query_options)`.
//
// Threads: any.
splitplane_status splitplane_query_options_init(struct splitplane_query_options *options, size_t size);

// Opens a backend: `cpu`, `wgpu` (a GPU, software included) or `auto` (a GPU that gives the CPU's answers bit for bit, else the CPU). `adapter` names a GPU by a part of its name; NULL for
// any. To open a GPU takes long, since it is tested; keep the backend.
//
// Trees and scenes keep what they need of it: it may be freed while they live. It keeps memory of builds for the next one.
//
// Threads: any; one backend may serve several at a time.
splitplane_status splitplane_backend_open(const char *name,
                                          const char *adapter,
                                          struct splitplane_backend *backend);

// Writes what a backend is, and why it is this one, as a text that ends with a 0. `needed`, which may be NULL, gets the bytes that it takes; `SPLITPLANE_STATUS_CAPACITY` where
// there is less room. With `text` NULL and capacity 0 only `needed` is written.
//
// Threads: any.
splitplane_status splitplane_backend_describe(struct splitplane_backend backend,
                                              char *text,
                                              size_t capacity,
                                              size_t *needed);

// Frees a backend. 0 is no mistake.
//
// Threads: any; calls that use it go on.
splitplane_status splitplane_backend_free(struct splitplane_backend backend);

// Builds a tree over a mesh. It has its own copy of what it needs: your arrays may go or change after the call. `options` may be NULL for the defaults.
//
// Threads: any.
splitplane_status splitplane_tree_build(struct splitplane_backend backend,
                                        const struct splitplane_mesh *mesh,
                                        const struct splitplane_build_options *options,
                                        struct splitplane_tree *tree);

// Builds a tree again, over another mesh or the same one that changed, in the memory that it has where nothing can cancel the build. After a failure the tree is what it was.
//
// Threads: any, while no other call uses the tree: else `SPLITPLANE_STATUS_BUSY`.
splitplane_status splitplane_tree_rebuild(struct splitplane_tree tree,
                                          const struct splitplane_mesh *mesh,
                                          const struct splitplane_build_options *options);

// Frees a tree. 0 is no mistake.
//
// Threads: any; calls that use it go on.
splitplane_status splitplane_tree_free(struct splitplane_tree tree);

// Numbers about a tree and its build.
//
// Threads: any.
splitplane_status splitplane_tree_get_summary(struct splitplane_tree tree, struct splitplane_tree_summary *summary);

// The digest of a tree: the same for the same mesh and settings, on any machine, backend and number of threads.
//
// Threads: any.
splitplane_status splitplane_tree_digest(struct splitplane_tree tree, uint64_t *digest);

// Writes a tree file, of the tree and not of its mesh, which has to be given: the file has its digest.
//
// Threads: any.
splitplane_status splitplane_tree_save(struct splitplane_tree tree,
                                       const struct splitplane_mesh *mesh,
                                       const char *path);

// Writes the bytes of a tree file into memory. `needed`, which may be NULL, gets how many there are; `SPLITPLANE_STATUS_CAPACITY` where there is less room. With `bytes` NULL and capacity 0 only
// `needed` is written.
//
// Threads: any.
splitplane_status splitplane_tree_write(struct splitplane_tree tree,
                                        const struct splitplane_mesh *mesh,
                                        uint8_t *bytes,
                                        size_t capacity,
                                        size_t *needed);

// Makes a tree of a tree file, without building it. The file is checked, and so is that it belongs to the mesh. Of `options` preset and knobs stay the defaults.
//
// Threads: any.
splitplane_status splitplane_tree_load(struct splitplane_backend backend,
                                       const struct splitplane_mesh *mesh,
                                       const char *path,
                                       const struct splitplane_build_options *options,
                                       struct splitplane_tree *tree);

// As `splitplane_tree_load`, of the bytes of a file that are in memory, such as a file that you mapped. They start at a multiple of 4, and are not needed after the call.
//
// Threads: any.
splitplane_status splitplane_tree_load_memory(struct splitplane_backend backend,
                                              const struct splitplane_mesh *mesh,
                                              const uint8_t *bytes,
                                              size_t size,
                                              const struct splitplane_build_options *options,
                                              struct splitplane_tree *tree);

// The closest hit of every ray: the one of least (t, triangle). `hits` has room for one record a ray, `hit_stride` bytes apart: 16 where nothing is between them. `options` and `report` may be
// NULL. After a failure the records mean nothing.
//
// Threads: any; one tree may answer many calls at a time.
splitplane_status splitplane_tree_closest_hits(struct splitplane_tree tree,
                                               const struct splitplane_rays *rays,
                                               const struct splitplane_query_options *options,
                                               struct splitplane_hit *hits,
                                               size_t hit_stride,
                                               struct splitplane_report *report);

// For every ray, whether it hits anything: 1 or 0, `occluded_stride` bytes apart. Otherwise as `splitplane_tree_closest_hits`.
//
// Threads: any; one tree may answer many calls at a time.
splitplane_status splitplane_tree_any_hits(struct splitplane_tree tree,
                                           const struct splitplane_rays *rays,
                                           const struct splitplane_query_options *options,
                                           uint8_t *occluded,
                                           size_t occluded_stride,
                                           struct splitplane_report *report);

// All crossings of every ray with surfaces, in order along it, exact: a list of `splitplane_crossing` for each ray. Read them by `splitplane_lists_size`, `splitplane_lists_starts` and
// `splitplane_lists_crossings`, then free them. `max_memory` of the options limits what they take.
//
// Threads: any; one tree may answer many calls at a time.
splitplane_status splitplane_tree_all_hits(struct splitplane_tree tree,
                                           const struct splitplane_rays *rays,
                                           const struct splitplane_query_options *options,
                                           struct splitplane_lists *lists,
                                           struct splitplane_report *report);

// How many crossings every ray has with surfaces, `count_stride` bytes apart.
//
// Threads: any; one tree may answer many calls at a time.
splitplane_status splitplane_tree_count_hits(struct splitplane_tree tree,
                                             const struct splitplane_rays *rays,
                                             const struct splitplane_query_options *options,
                                             uint64_t *counts,
                                             size_t count_stride,
                                             struct splitplane_report *report);

// How often the surface winds around every point, `winding_stride` bytes apart: 0 outside, `SPLITPLANE_BOUNDARY` on a triangle. A closed surface whose corners run counter-clockwise as seen from
// outside winds once around the points in it. Decided exactly; for surfaces that are not closed it means little.
//
// Threads: any; one tree may answer many calls at a time.
splitplane_status splitplane_tree_locate(struct splitplane_tree tree,
                                         const float *points,
                                         size_t point_stride,
                                         size_t count,
                                         const struct splitplane_query_options *options,
                                         int32_t *windings,
                                         size_t winding_stride,
                                         struct splitplane_report *report);

// The point of the mesh that is closest to every point, `closest_stride` bytes apart: 32 where nothing is between them. Of equal distances the least triangle. `max_distance` of the options
// makes the search faster.
//
// Threads: any; one tree may answer many calls at a time.
splitplane_status splitplane_tree_closest_points(struct splitplane_tree tree,
                                                 const float *points,
                                                 size_t point_stride,
                                                 size_t count,
                                                 const struct splitplane_query_options *options,
                                                 struct splitplane_closest_point *closest,
                                                 size_t closest_stride,
                                                 struct splitplane_report *report);

// The distance of every point from the surface, `distance_stride` bytes apart: negative inside, where the winding number is not 0, and 0 on it. Infinity where the mesh has no triangles.
//
// Threads: any; one tree may answer many calls at a time.
splitplane_status splitplane_tree_signed_distances(struct splitplane_tree tree,
                                                   const float *points,
                                                   size_t point_stride,
                                                   size_t count,
                                                   const struct splitplane_query_options *options,
                                                   double *distances,
                                                   size_t distance_stride,
                                                   struct splitplane_report *report);

// Makes a scene without anything.
//
// Threads: any.
splitplane_status splitplane_scene_create(struct splitplane_backend backend, struct splitplane_scene *scene);

// Frees a scene. 0 is no mistake.
//
// Threads: any; calls that use it go on.
splitplane_status splitplane_scene_free(struct splitplane_scene scene);

// Adds a geometry: a copy of a mesh. `geometry` gets its number; those of removed ones are used again.
//
// Threads: any, while no other call uses the scene: else `SPLITPLANE_STATUS_BUSY`.
splitplane_status splitplane_scene_add_geometry(struct splitplane_scene scene,
                                                const struct splitplane_mesh *mesh,
                                                uint32_t *geometry);

// Gives a geometry another mesh; its instances stay.
//
// Threads: as for `splitplane_scene_add_geometry`.
splitplane_status splitplane_scene_replace_geometry(struct splitplane_scene scene,
                                                    uint32_t geometry,
                                                    const struct splitplane_mesh *mesh);

// Removes a geometry that has no instances.
//
// Threads: as for `splitplane_scene_add_geometry`.
splitplane_status splitplane_scene_remove_geometry(struct splitplane_scene scene, uint32_t geometry);

// Adds an instance. `number` gets its number; those of removed ones are used again.
//
// Threads: as for `splitplane_scene_add_geometry`.
splitplane_status splitplane_scene_add_instance(struct splitplane_scene scene,
                                                const struct splitplane_instance *instance,
                                                uint32_t *number);

// Replaces all that an instance is, its geometry included.
//
// Threads: as for `splitplane_scene_add_geometry`.
splitplane_status splitplane_scene_set_instance(struct splitplane_scene scene,
                                                uint32_t number,
                                                const struct splitplane_instance *instance);

// Gives an instance another transform: 12 numbers, as in `splitplane_instance`.
//
// Threads: as for `splitplane_scene_add_geometry`.
splitplane_status splitplane_scene_move_instance(struct splitplane_scene scene,
                                                 uint32_t number,
                                                 const float *transform);

// Removes an instance.
//
// Threads: as for `splitplane_scene_add_geometry`.
splitplane_status splitplane_scene_remove_instance(struct splitplane_scene scene, uint32_t number);

// What an instance is.
//
// Threads: any.
splitplane_status splitplane_scene_instance(struct splitplane_scene scene,
                                            uint32_t number,
                                            struct splitplane_instance *instance);

// Brings a scene up to date with its edits: only what changed is made anew. After a failure queries answer as they did before it, and the edits stay: mend or undo them, and update again. `options` and `report` may be NULL.
// A lazy scene has the settings that it was created with, so its `options` have to be NULL; nothing is built, and the report is 0.
//
// Threads: as for `splitplane_scene_add_geometry`.
splitplane_status splitplane_scene_update(struct splitplane_scene scene,
                                          const struct splitplane_build_options *options,
                                          struct splitplane_update_report *report);

// The digest of a scene: of its geometries' trees and of its instances. Builds all of a lazy scene, as files do.
//
// Threads: any.
splitplane_status splitplane_scene_digest(struct splitplane_scene scene, uint64_t *digest);

// Writes a scene file: meshes, trees and instances.
//
// Threads: any.
splitplane_status splitplane_scene_save(struct splitplane_scene scene, const char *path);

// Writes the bytes of a scene file into memory, as `splitplane_tree_write` does.
//
// Threads: any.
splitplane_status splitplane_scene_write(struct splitplane_scene scene,
                                         uint8_t *bytes,
                                         size_t capacity,
                                         size_t *needed);

// Makes a scene of a scene file, without building trees of geometries. Of `options` preset and knobs stay the defaults.
//
// Threads: any.
splitplane_status splitplane_scene_load(struct splitplane_backend backend,
                                        const char *path,
                                        const struct splitplane_build_options *options,
                                        struct splitplane_scene *scene);

// As `splitplane_scene_load`, of the bytes of a file that are in memory, such as a file that you mapped. They start at a multiple of 4, and are not needed after the call.
//
// Threads: any.
splitplane_status splitplane_scene_load_memory(struct splitplane_backend backend,
                                               const uint8_t *bytes,
                                               size_t size,
                                               const struct splitplane_build_options *options,
                                               struct splitplane_scene *scene);

// Says which parts of a geometry's triangles count for rays: a triangle has `4^level` cells of one bit each, of which the first of a word is its lowest. Rays pass cells whose bit
// is 0. Points inside and closest points are those of the whole mesh. Words are those that `splitplane_scene_get_opacity` gives, `triangles * 4^level` bits in all, rounded up
// to whole words; bits after the last cell are 0. `level` is 12 at most.
//
// The guide says in which order cells are; `splitplane_scene_make_opacity` makes words of a function.
//
// Threads: as for `splitplane_scene_add_geometry`.
splitplane_status splitplane_scene_set_opacity(struct splitplane_scene scene,
                                               uint32_t geometry,
                                               uint32_t level,
                                               const uint32_t *words,
                                               size_t word_count);

// As `splitplane_scene_set_opacity`, of what a function says about the middle of each cell: such as what a texture has there.
//
// Threads: as for `splitplane_scene_add_geometry`; the function must not use the scene.
splitplane_status splitplane_scene_make_opacity(struct splitplane_scene scene,
                                                uint32_t geometry,
                                                uint32_t level,
                                                splitplane_opacity function,
                                                void *user);

// Makes all parts of a geometry's triangles count again.
//
// Threads: as for `splitplane_scene_add_geometry`.
splitplane_status splitplane_scene_clear_opacity(struct splitplane_scene scene, uint32_t geometry);

// The opacity mask of a geometry: `level` gets its level, and `words` its words. `needed`, which may be NULL, gets how many words there are: 0 where all of the geometry counts, of which the level
// is 0. `SPLITPLANE_STATUS_CAPACITY` where there is room for fewer; with `words` NULL and capacity 0 no words are written.
//
// Threads: any.
splitplane_status splitplane_scene_get_opacity(struct splitplane_scene scene,
                                               uint32_t geometry,
                                               uint32_t *level,
                                               uint32_t *words,
                                               size_t capacity,
                                               size_t *needed);

// Adds a geometry of shapes. `geometry` gets its number.
//
// Threads: as for `splitplane_scene_add_geometry`.
splitplane_status splitplane_scene_add_shapes(struct splitplane_scene scene,
                                              const struct splitplane_shapes *shapes,
                                              uint32_t *geometry);

// Gives a geometry of shapes another set of any kind; its instances stay.
//
// Threads: as for `splitplane_scene_add_geometry`.
splitplane_status splitplane_scene_replace_shapes(struct splitplane_scene scene,
                                                  uint32_t geometry,
                                                  const struct splitplane_shapes *shapes);

// The closest hit of every ray: the one of least (t, instance, triangle). `hits` has room for one record a ray, `hit_stride` bytes apart: 24 where nothing is between them. `options` and `report`
// may be NULL. After a failure the records mean nothing.
//
// Threads: any; one scene may answer many calls at a time.
splitplane_status splitplane_scene_closest_hits(struct splitplane_scene scene,
                                                const struct splitplane_rays *rays,
                                                const struct splitplane_query_options *options,
                                                struct splitplane_scene_hit *hits,
                                                size_t hit_stride,
                                                struct splitplane_report *report);

// For every ray, whether it hits anything: 1 or 0, `occluded_stride` bytes apart. Otherwise as `splitplane_scene_closest_hits`.
//
// Threads: any; one scene may answer many calls at a time.
splitplane_status splitplane_scene_any_hits(struct splitplane_scene scene,
                                            const struct splitplane_rays *rays,
                                            const struct splitplane_query_options *options,
                                            uint8_t *occluded,
                                            size_t occluded_stride,
                                            struct splitplane_report *report);

// All crossings of every ray with surfaces, in order of (t, instance, triangle): a list for each ray, as of `splitplane_tree_all_hits`.
//
// Threads: any; one scene may answer many calls at a time.
splitplane_status splitplane_scene_all_hits(struct splitplane_scene scene,
                                            const struct splitplane_rays *rays,
                                            const struct splitplane_query_options *options,
                                            struct splitplane_lists *lists,
                                            struct splitplane_report *report);

// How many crossings every ray has with surfaces, `count_stride` bytes apart. `max_memory` of the options limits those of one ray.
//
// Threads: any; one scene may answer many calls at a time.
splitplane_status splitplane_scene_count_hits(struct splitplane_scene scene,
                                              const struct splitplane_rays *rays,
                                              const struct splitplane_query_options *options,
                                              uint64_t *counts,
                                              size_t count_stride,
                                              struct splitplane_report *report);

// How often the surfaces of all instances wind around every point, as `splitplane_tree_locate` says it.
//
// Threads: any; one scene may answer many calls at a time.
splitplane_status splitplane_scene_locate(struct splitplane_scene scene,
                                          const float *points,
                                          size_t point_stride,
                                          size_t count,
                                          const struct splitplane_query_options *options,
                                          int32_t *windings,
                                          size_t winding_stride,
                                          struct splitplane_report *report);

// The point of the scene that is closest to every point, `closest_stride` bytes apart: 40 where nothing is between them. Of equal distances the least (instance, triangle).
//
// Threads: any; one scene may answer many calls at a time.
splitplane_status splitplane_scene_closest_points(struct splitplane_scene scene,
                                                  const float *points,
                                                  size_t point_stride,
                                                  size_t count,
                                                  const struct splitplane_query_options *options,
                                                  struct splitplane_scene_closest_point *closest,
                                                  size_t closest_stride,
                                                  struct splitplane_report *report);

// Makes a scene without anything, of which a geometry is built when the first ray reaches the box of an instance of it, and nothing that is built hides it. Answers are those of other scenes. Queries
// may then take memory, call the progress function while they build, and fail as builds do; a geometry that was not built stays unbuilt. Points, overlaps, files and digests build everything.
//
// `options`, which may be NULL, holds for all that queries build: `max_memory` for the whole scene. Progress and threads are those of the calls, so here they have to be left as they are.
//
// Threads: any.
splitplane_status splitplane_scene_create_lazy(struct splitplane_backend backend,
                                               const struct splitplane_build_options *options,
                                               struct splitplane_scene *scene);

// How many geometries of a lazy scene no query has built; 0 for other scenes.
//
// Threads: any.
splitplane_status splitplane_scene_waiting(struct splitplane_scene scene, size_t *count);

// Builds the geometries of a lazy scene that no query has built; of others it does nothing. `options` may be NULL: progress and threads.
//
// Threads: any; it may run beside queries.
splitplane_status splitplane_scene_complete(struct splitplane_scene scene,
                                            const struct splitplane_query_options *options);

// The triangles that every volume meets, decided exactly, also where they only touch: a list of `splitplane_overlap` for each volume, in ascending order. Read them by `splitplane_lists_size`,
// `splitplane_lists_starts` and `splitplane_lists_overlaps`, then free them. `max_memory` of the options limits what they take.
//
// Threads: any; one tree may answer many calls at a time.
splitplane_status splitplane_tree_overlaps(struct splitplane_tree tree,
                                           const struct splitplane_volumes *volumes,
                                           const struct splitplane_query_options *options,
                                           struct splitplane_lists *lists,
                                           struct splitplane_report *report);

// For every volume, whether it meets any triangle: 1 or 0, `met_stride` bytes apart. As `splitplane_tree_overlaps`, without lists.
//
// Threads: any; one tree may answer many calls at a time.
splitplane_status splitplane_tree_overlaps_any(struct splitplane_tree tree,
                                               const struct splitplane_volumes *volumes,
                                               const struct splitplane_query_options *options,
                                               uint8_t *met,
                                               size_t met_stride,
                                               struct splitplane_report *report);

// The triangles of instances that every volume meets in the world: a list for each volume in ascending order of (instance, triangle), as of `splitplane_tree_overlaps`.
// `SPLITPLANE_STATUS_UNSUPPORTED` where an instance that answers is one of shapes.
//
// Threads: any; one scene may answer many calls at a time.
splitplane_status splitplane_scene_overlaps(struct splitplane_scene scene,
                                            const struct splitplane_volumes *volumes,
                                            const struct splitplane_query_options *options,
                                            struct splitplane_lists *lists);

// For every volume, whether it meets any triangle of an instance: 1 or 0, `met_stride` bytes apart. As `splitplane_scene_overlaps`, without lists.
//
// Threads: any; one scene may answer many calls at a time.
splitplane_status splitplane_scene_overlaps_any(struct splitplane_scene scene,
                                                const struct splitplane_volumes *volumes,
                                                const struct splitplane_query_options *options,
                                                uint8_t *met,
                                                size_t met_stride);

// What every body that moves along its ray touches first: of equal t the least triangle. `impacts` has room for one record a ray, `impact_stride` bytes apart: 8 where nothing is between them.
// `options` and `report` may be NULL.
//
// Threads: any; one tree may answer many calls at a time.
splitplane_status splitplane_tree_impacts(struct splitplane_tree tree,
                                          const struct splitplane_rays *rays,
                                          const struct splitplane_bodies *bodies,
                                          const struct splitplane_query_options *options,
                                          struct splitplane_impact *impacts,
                                          size_t impact_stride,
                                          struct splitplane_report *report);

// Builds a tree of points of 1 to 4 coordinates, `point_stride` bytes apart. It has its own copy. `axes` is a `splitplane_point_axes`; of `options`, which may be NULL, preset, layout and knobs stay
// the defaults. The backend builds the tree and answers; answers are the same on all.
//
// Threads: any.
splitplane_status splitplane_point_tree_build(struct splitplane_backend backend,
                                              const float *points,
                                              size_t point_stride,
                                              size_t count,
                                              uint32_t dimensions,
                                              uint32_t axes,
                                              const struct splitplane_build_options *options,
                                              struct splitplane_point_tree *tree);

// Frees a point tree. 0 is no mistake.
//
// Threads: any; calls that use it go on.
splitplane_status splitplane_point_tree_free(struct splitplane_point_tree tree);

// Numbers about a point tree.
//
// Threads: any.
splitplane_status splitplane_point_tree_get_summary(struct splitplane_point_tree tree,
                                                    struct splitplane_point_tree_summary *summary);

// The digest of a point tree.
//
// Threads: any.
splitplane_status splitplane_point_tree_digest(struct splitplane_point_tree tree, uint64_t *digest);

// The `k` nearest points of every query, of as many coordinates as the tree's: `k` records a query, one query after the other, `neighbour_stride` bytes from record to record (16 where nothing is
// between them), the least (distance, point) first. Where there are fewer the rest say `SPLITPLANE_NONE`.
//
// Threads: any; one tree may answer many calls at a time.
splitplane_status splitplane_point_tree_nearest(struct splitplane_point_tree tree,
                                                const float *queries,
                                                size_t query_stride,
                                                size_t count,
                                                size_t k,
                                                const struct splitplane_query_options *options,
                                                struct splitplane_neighbour *neighbours,
                                                size_t neighbour_stride);

// All points within `max_distance` of the options of every query: a list of `splitplane_neighbour` for each, the least (distance, point) first. Read them by `splitplane_lists_size`,
// `splitplane_lists_starts` and `splitplane_lists_neighbours`, then free them. `max_memory` limits what they take.
//
// Threads: any; one tree may answer many calls at a time.
splitplane_status splitplane_point_tree_within(struct splitplane_point_tree tree,
                                               const float *queries,
                                               size_t query_stride,
                                               size_t count,
                                               const struct splitplane_query_options *options,
                                               struct splitplane_lists *lists);

// How many lists there are, one for each ray or point that was asked for, and how many records they have together.
//
// Threads: any.
splitplane_status splitplane_lists_size(struct splitplane_lists lists, size_t *list_count, size_t *record_count);

// Writes where the records of each list begin, followed by how many records there are: one number more than lists. List `i` has the records `starts[i]` up to, and without, `starts[i + 1]`.
//
// Threads: any.
splitplane_status splitplane_lists_starts(struct splitplane_lists lists,
                                          uint64_t *starts,
                                          size_t capacity);

// Writes the crossings of all lists, `crossing_stride` bytes apart: 28 where nothing is between them.
//
// Threads: any.
splitplane_status splitplane_lists_crossings(struct splitplane_lists lists,
                                             struct splitplane_crossing *crossings,
                                             size_t crossing_stride,
                                             size_t capacity);

// Writes the triangles of all lists that volumes meet, `overlap_stride` bytes apart: 8 where nothing is between them.
//
// Threads: any.
splitplane_status splitplane_lists_overlaps(struct splitplane_lists lists,
                                            struct splitplane_overlap *overlaps,
                                            size_t overlap_stride,
                                            size_t capacity);

// Writes the points of all lists, `neighbour_stride` bytes apart: 16 where nothing is between them.
//
// Threads: any.
splitplane_status splitplane_lists_neighbours(struct splitplane_lists lists,
                                              struct splitplane_neighbour *neighbours,
                                              size_t neighbour_stride,
                                              size_t capacity);

// Frees lists. 0 is no mistake.
//
// Threads: any.
splitplane_status splitplane_lists_free(struct splitplane_lists lists);

#ifdef __cplusplus
}  // extern "C"
#endif  // __cplusplus

#endif  /* SPLITPLANE_H */
