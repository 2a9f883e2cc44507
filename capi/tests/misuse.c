/* Misuses: every call with everything in order but for one thing, which has to end in the status for it. The cases are generated: each mistake is made in each call
 * that it can be made in. Prints how many there were; fails where a status is not the one expected.
 *
 *     misuse [folder [planted]]
 *
 * With `planted` one mistake is not made, which has to be found out. */
#include <math.h>
#include <splitplane.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define COUNT(array) (sizeof(array) / sizeof(array)[0])

/* What a call uses. */
enum {
    BACKEND = 1 << 0,
    TREE = 1 << 1,
    SCENE = 1 << 2,
    CLOUD = 1 << 3,
    LISTS = 1 << 4,
    MESH = 1 << 5,
    RAYS = 1 << 6,
    BUILD = 1 << 7,
    QUERY = 1 << 8,
    POINTS = 1 << 9,
    /* Answers at a stride, and such that have to be aligned. */
    OUT = 1 << 10,
    WORDS = 1 << 11,
    /* Room for one thing. */
    ROOM = 1 << 12,
    REPORT = 1 << 13,
    PATH = 1 << 14,
    BYTES = 1 << 15,
    SAVES = 1 << 16,
    INSTANCE = 1 << 17,
    GEOMETRY = 1 << 18,
    NUMBER = 1 << 19,
    CAPACITY = 1 << 20,
    NEAREST = 1 << 21,
    /* What the query does not use of its settings. */
    NO_ACCURACY = 1 << 22,
    NO_CULLING = 1 << 23,
    NO_MASK = 1 << 24,
    NO_DISTANCE = 1 << 25,
    NO_MEMORY = 1 << 26,
    LOADS = 1 << 27,
    IN_RANGE = 1 << 28,
    /* Filters of hits. */
    FILTERS = 1 << 29,
    SHAPES = 1 << 30,
};
/* Constants of an enum are no longer than an int. */
#define OPACITY ((uint64_t)1 << 31)
#define VOLUMES ((uint64_t)1 << 32)
#define BODIES ((uint64_t)1 << 33)
/* Lists of triangles that volumes meet. */
#define MET ((uint64_t)1 << 34)
/* What builds later. */
#define LAZY ((uint64_t)1 << 35)

enum { FEW = 40 };

/* All that calls are given. */
typedef struct {
    splitplane_backend backend;
    splitplane_tree tree;
    splitplane_scene scene;
    splitplane_point_tree cloud;
    splitplane_lists lists, met;
    splitplane_mesh mesh_record;
    const splitplane_mesh *mesh;
    splitplane_rays rays_record;
    const splitplane_rays *rays;
    splitplane_build_options build_record;
    const splitplane_build_options *build;
    splitplane_query_options query_record;
    const splitplane_query_options *query;
    splitplane_knob knob;
    const float *points;
    size_t point_stride, point_count, k, capacity;
    void *out;
    size_t out_stride;
    void *room;
    splitplane_report *report;
    const char *path;
    const uint8_t *bytes;
    size_t size;
    splitplane_instance instance_record;
    const splitplane_instance *instance;
    uint32_t geometry, number;
    uint32_t dimensions, axes;
    const char *backend_name;
    splitplane_shapes shapes_record;
    const splitplane_shapes *shapes;
    uint32_t level;
    const uint32_t *opacity_words;
    size_t opacity_count;
    splitplane_opacity opacity;
    splitplane_volumes volumes_record;
    const splitplane_volumes *volumes;
    splitplane_bodies bodies_record;
    const splitplane_bodies *bodies;
} args;

/* Arrays that stay. */
static float positions[8][3];
static const uint32_t faces[12][3] = {{0, 2, 3}, {0, 3, 1}, {4, 5, 7}, {4, 7, 6}, {0, 1, 5}, {0, 5, 4},
                                      {2, 6, 7}, {2, 7, 3}, {0, 4, 6}, {0, 6, 2}, {1, 3, 7}, {1, 7, 5}};
static uint32_t bad_faces[12][3];
static float ray_words[FEW][8];
static float point_words[FEW][4];
static float volume_words[FEW][6], radius_words[2 * FEW];
/* Where sets of planes begin: in order, and not. */
static uint64_t plane_starts[FEW + 1], falling_starts[FEW + 1], late_starts[FEW + 1], endless_starts[FEW + 1];
static uint64_t answers[FEW * 64];
static uint64_t room_words[64];
static splitplane_report report;
/* Level 2 of 12 triangles: 192 bits. */
static uint32_t opacity_bits[8];
static uint8_t *tree_file, *scene_file;
static uint64_t *damaged;
static size_t tree_size, scene_size;
static char endless[5000], folder[] = "/no/such/folder/file", saved[4096];
static args good;

static void need(splitplane_status status) {
    if (status != SPLITPLANE_STATUS_OK) {
        fprintf(stderr, "misuse: a call in order failed: %d: %s\n", (int)status, splitplane_last_message());
        exit(1);
    }
}

/* Calls. */
#define CALL(name, expression) \
    static splitplane_status name(const args *a) { return expression; }
CALL(do_open, splitplane_backend_open(a->backend_name, NULL, a->room))
CALL(do_describe, splitplane_backend_describe(a->backend, a->room, a->capacity, NULL))
CALL(do_build, splitplane_tree_build(a->backend, a->mesh, a->build, a->room))
CALL(do_rebuild, splitplane_tree_rebuild(a->tree, a->mesh, a->build))
CALL(do_summary, splitplane_tree_get_summary(a->tree, a->room))
CALL(do_digest, splitplane_tree_digest(a->tree, a->room))
CALL(do_save, splitplane_tree_save(a->tree, a->mesh, a->path))
CALL(do_write, splitplane_tree_write(a->tree, a->mesh, a->out, a->capacity, NULL))
CALL(do_load, splitplane_tree_load(a->backend, a->mesh, a->path, a->build, a->room))
CALL(do_load_memory, splitplane_tree_load_memory(a->backend, a->mesh, a->bytes, a->size, a->build, a->room))
CALL(do_closest, splitplane_tree_closest_hits(a->tree, a->rays, a->query, a->out, a->out_stride, a->report))
CALL(do_any, splitplane_tree_any_hits(a->tree, a->rays, a->query, a->out, a->out_stride, a->report))
CALL(do_all, splitplane_tree_all_hits(a->tree, a->rays, a->query, a->room, a->report))
CALL(do_count, splitplane_tree_count_hits(a->tree, a->rays, a->query, a->out, a->out_stride, a->report))
CALL(do_locate, splitplane_tree_locate(a->tree, a->points, a->point_stride, a->point_count, a->query, a->out, a->out_stride, a->report))
CALL(do_closest_points, splitplane_tree_closest_points(a->tree, a->points, a->point_stride, a->point_count, a->query, a->out, a->out_stride, a->report))
CALL(do_signed, splitplane_tree_signed_distances(a->tree, a->points, a->point_stride, a->point_count, a->query, a->out, a->out_stride, a->report))
CALL(do_scene_create, splitplane_scene_create(a->backend, a->room))
CALL(do_add_geometry, splitplane_scene_add_geometry(a->scene, a->mesh, a->room))
CALL(do_replace_geometry, splitplane_scene_replace_geometry(a->scene, a->geometry, a->mesh))
CALL(do_add_instance, splitplane_scene_add_instance(a->scene, a->instance, a->room))
CALL(do_set_instance, splitplane_scene_set_instance(a->scene, a->number, a->instance))
CALL(do_move_instance, splitplane_scene_move_instance(a->scene, a->number, a->instance ? a->instance->transform : NULL))
CALL(do_instance, splitplane_scene_instance(a->scene, a->number, a->room))
CALL(do_update, splitplane_scene_update(a->scene, a->build, NULL))
CALL(do_scene_digest, splitplane_scene_digest(a->scene, a->room))
CALL(do_scene_save, splitplane_scene_save(a->scene, a->path))
CALL(do_scene_write, splitplane_scene_write(a->scene, a->out, a->capacity, NULL))
CALL(do_scene_load, splitplane_scene_load(a->backend, a->path, a->build, a->room))
CALL(do_scene_load_memory, splitplane_scene_load_memory(a->backend, a->bytes, a->size, a->build, a->room))
CALL(do_scene_closest, splitplane_scene_closest_hits(a->scene, a->rays, a->query, a->out, a->out_stride, a->report))
CALL(do_scene_any, splitplane_scene_any_hits(a->scene, a->rays, a->query, a->out, a->out_stride, a->report))
CALL(do_scene_all, splitplane_scene_all_hits(a->scene, a->rays, a->query, a->room, a->report))
CALL(do_scene_locate, splitplane_scene_locate(a->scene, a->points, a->point_stride, a->point_count, a->query, a->out, a->out_stride, a->report))
CALL(do_scene_closest_points, splitplane_scene_closest_points(a->scene, a->points, a->point_stride, a->point_count, a->query, a->out, a->out_stride, a->report))
CALL(do_scene_count, splitplane_scene_count_hits(a->scene, a->rays, a->query, a->out, a->out_stride, a->report))
CALL(do_add_shapes, splitplane_scene_add_shapes(a->scene, a->shapes, a->room))
CALL(do_replace_shapes, splitplane_scene_replace_shapes(a->scene, 1 + a->geometry, a->shapes))
CALL(do_set_opacity, splitplane_scene_set_opacity(a->scene, a->geometry, a->level, a->opacity_words, a->opacity_count))
CALL(do_make_opacity, splitplane_scene_make_opacity(a->scene, a->geometry, a->level, a->opacity, NULL))
CALL(do_clear_opacity, splitplane_scene_clear_opacity(a->scene, a->geometry))
CALL(do_get_opacity, splitplane_scene_get_opacity(a->scene, a->geometry, a->room, (uint32_t *)answers, a->capacity, NULL))
CALL(do_cloud_build, splitplane_point_tree_build(a->backend, a->points, a->point_stride, a->point_count, a->dimensions, a->axes, a->build, a->room))
CALL(do_cloud_summary, splitplane_point_tree_get_summary(a->cloud, a->room))
CALL(do_cloud_digest, splitplane_point_tree_digest(a->cloud, a->room))
CALL(do_nearest, splitplane_point_tree_nearest(a->cloud, a->points, a->point_stride, a->point_count, a->k, a->query, a->out, a->out_stride))
CALL(do_within, splitplane_point_tree_within(a->cloud, a->points, a->point_stride, a->point_count, a->query, a->room))
CALL(do_overlaps, splitplane_tree_overlaps(a->tree, a->volumes, a->query, a->room, a->report))
CALL(do_overlaps_any, splitplane_tree_overlaps_any(a->tree, a->volumes, a->query, a->out, a->out_stride, a->report))
CALL(do_impacts, splitplane_tree_impacts(a->tree, a->rays, a->bodies, a->query, a->out, a->out_stride, a->report))
CALL(do_scene_overlaps, splitplane_scene_overlaps(a->scene, a->volumes, a->query, a->room))
CALL(do_scene_overlaps_any, splitplane_scene_overlaps_any(a->scene, a->volumes, a->query, a->out, a->out_stride))
CALL(do_scene_create_lazy, splitplane_scene_create_lazy(a->backend, a->build, a->room))
CALL(do_waiting, splitplane_scene_waiting(a->scene, a->room))
CALL(do_complete, splitplane_scene_complete(a->scene, a->query))
CALL(do_lists_overlaps, splitplane_lists_overlaps(a->met, a->out, a->out_stride, a->capacity))
CALL(do_lists_size, splitplane_lists_size(a->lists, a->room, (size_t *)answers))
CALL(do_lists_starts, splitplane_lists_starts(a->lists, a->room, a->capacity))
CALL(do_lists_crossings, splitplane_lists_crossings(a->lists, a->out, a->out_stride, a->capacity))

static int32_t keep_hit(void *user, const splitplane_scene_hit *hit) { return user != NULL || hit->triangle != 3; }
static int32_t keep_point(void *user, uint32_t point) { return user != NULL || point != 3; }
static int32_t opaque(void *user, uint32_t triangle, float u, float v) { return user != NULL || triangle > 2 || u < v; }
static void no_hit(void *user, uint32_t primitive, const float *ray, splitplane_show_hit show, void *to) {
    (void)user, (void)primitive, (void)ray, (void)show, (void)to;
}

#define HITS (RAYS | QUERY | OUT | REPORT | NO_DISTANCE | NO_MEMORY)
#define ALL (RAYS | QUERY | REPORT | NO_ACCURACY | NO_DISTANCE)
#define INSIDE (POINTS | QUERY | OUT | WORDS | REPORT | NO_ACCURACY | NO_CULLING | NO_MASK | NO_DISTANCE)
#define NEAR (POINTS | QUERY | OUT | WORDS | REPORT | NO_CULLING | NO_MEMORY)
#define OF_VOLUMES (VOLUMES | QUERY | NO_ACCURACY | NO_CULLING | NO_DISTANCE)
#define OF_CLOUD (CLOUD | POINTS | QUERY | NO_ACCURACY | NO_CULLING | NO_MASK)

static const struct {
    const char *name;
    splitplane_status (*call)(const args *);
    uint64_t uses;
    /* Bytes of a record that is written. */
    size_t record;
} calls[] = {
    {"backend_open", do_open, ROOM, 0},
    {"backend_describe", do_describe, BACKEND | CAPACITY, 0},
    {"tree_build", do_build, BACKEND | MESH | BUILD | ROOM | IN_RANGE, 0},
    {"tree_rebuild", do_rebuild, TREE | MESH | BUILD | IN_RANGE, 0},
    {"tree_get_summary", do_summary, TREE | ROOM, 0},
    {"tree_digest", do_digest, TREE | ROOM, 0},
    {"tree_save", do_save, TREE | MESH | PATH | SAVES, 0},
    {"tree_write", do_write, TREE | MESH | CAPACITY, 0},
    {"tree_load", do_load, BACKEND | MESH | PATH | BUILD | ROOM | LOADS, 0},
    {"tree_load_memory", do_load_memory, BACKEND | MESH | BYTES | BUILD | ROOM | LOADS, 0},
    {"tree_closest_hits", do_closest, TREE | HITS | WORDS | NO_MASK, 16},
    {"tree_any_hits", do_any, TREE | HITS | NO_MASK, 1},
    {"tree_all_hits", do_all, TREE | ALL | ROOM | NO_MASK, 0},
    {"tree_count_hits", do_count, TREE | ALL | OUT | WORDS | NO_MASK, 8},
    {"tree_locate", do_locate, TREE | INSIDE, 4},
    {"tree_closest_points", do_closest_points, TREE | NEAR | NO_MASK, 32},
    {"tree_signed_distances", do_signed, TREE | INSIDE, 8},
    {"scene_create", do_scene_create, BACKEND | ROOM, 0},
    {"scene_add_geometry", do_add_geometry, SCENE | MESH | ROOM, 0},
    {"scene_replace_geometry", do_replace_geometry, SCENE | MESH | GEOMETRY, 0},
    {"scene_add_instance", do_add_instance, SCENE | INSTANCE | ROOM, 0},
    {"scene_set_instance", do_set_instance, SCENE | INSTANCE | NUMBER, 0},
    {"scene_move_instance", do_move_instance, SCENE | NUMBER, 0},
    {"scene_instance", do_instance, SCENE | NUMBER | ROOM, 0},
    {"scene_update", do_update, SCENE | BUILD | IN_RANGE, 0},
    {"scene_digest", do_scene_digest, SCENE | ROOM, 0},
    {"scene_save", do_scene_save, SCENE | PATH | SAVES, 0},
    {"scene_write", do_scene_write, SCENE | CAPACITY, 0},
    {"scene_load", do_scene_load, BACKEND | PATH | BUILD | ROOM | LOADS, 0},
    {"scene_load_memory", do_scene_load_memory, BACKEND | BYTES | BUILD | ROOM | LOADS, 0},
    {"scene_closest_hits", do_scene_closest, SCENE | HITS | WORDS | FILTERS, 24},
    {"scene_any_hits", do_scene_any, SCENE | HITS | FILTERS, 1},
    {"scene_all_hits", do_scene_all, SCENE | ALL | ROOM | FILTERS, 0},
    {"scene_count_hits", do_scene_count, SCENE | ALL | OUT | WORDS | FILTERS, 8},
    {"scene_add_shapes", do_add_shapes, SCENE | SHAPES | ROOM, 0},
    {"scene_replace_shapes", do_replace_shapes, SCENE | SHAPES | GEOMETRY, 0},
    {"scene_set_opacity", do_set_opacity, SCENE | GEOMETRY | OPACITY, 0},
    {"scene_make_opacity", do_make_opacity, SCENE | GEOMETRY, 0},
    {"scene_get_opacity", do_get_opacity, SCENE | GEOMETRY | ROOM | CAPACITY, 0},
    {"scene_clear_opacity", do_clear_opacity, SCENE | GEOMETRY, 0},
    {"scene_locate", do_scene_locate, SCENE | INSIDE, 4},
    {"scene_closest_points", do_scene_closest_points, SCENE | NEAR, 40},
    {"point_tree_build", do_cloud_build, BACKEND | POINTS | BUILD | ROOM | LOADS, 0},
    {"point_tree_get_summary", do_cloud_summary, CLOUD | ROOM, 0},
    {"point_tree_digest", do_cloud_digest, CLOUD | ROOM, 0},
    {"point_tree_nearest", do_nearest, OF_CLOUD | OUT | WORDS | NEAREST, 16},
    {"point_tree_within", do_within, OF_CLOUD | ROOM, 0},
    {"tree_overlaps", do_overlaps, TREE | OF_VOLUMES | ROOM | REPORT | NO_MASK, 0},
    {"tree_overlaps_any", do_overlaps_any, TREE | OF_VOLUMES | OUT | REPORT | NO_MASK | NO_MEMORY, 1},
    {"tree_impacts", do_impacts, TREE | HITS | WORDS | BODIES | NO_ACCURACY | NO_CULLING | NO_MASK, 8},
    {"scene_overlaps", do_scene_overlaps, SCENE | OF_VOLUMES | ROOM, 0},
    {"scene_overlaps_any", do_scene_overlaps_any, SCENE | OF_VOLUMES | OUT | NO_MEMORY, 1},
    {"scene_create_lazy", do_scene_create_lazy, BACKEND | BUILD | ROOM | IN_RANGE | LAZY, 0},
    {"scene_waiting", do_waiting, SCENE | ROOM, 0},
    {"scene_complete", do_complete, SCENE | QUERY | NO_ACCURACY | NO_CULLING | NO_MASK | NO_DISTANCE | NO_MEMORY, 0},
    {"lists_overlaps", do_lists_overlaps, MET | OUT | WORDS | CAPACITY, 8},
    {"lists_size", do_lists_size, LISTS | ROOM, 0},
    {"lists_starts", do_lists_starts, LISTS | ROOM | CAPACITY, 0},
    {"lists_crossings", do_lists_crossings, LISTS | OUT | WORDS | CAPACITY, 28},
};

/* Mistakes. */
#define MISTAKE(name, statement) \
    static void name(args *a) { statement; }
#define BYTE(pointer, off) ((void *)((char *)(uintptr_t)(pointer) + (off)))

static uint64_t dead[6];
#define HANDLE(handle, place) \
    MISTAKE(handle##_null, a->handle.id = 0) \
    MISTAKE(handle##_made_up, a->handle.id = 0x123456789abcdefu) \
    MISTAKE(handle##_dead, a->handle.id = dead[place]) \
    MISTAKE(handle##_later, a->handle.id += (uint64_t)1 << 24) \
    MISTAKE(handle##_huge, a->handle.id = UINT64_MAX)
HANDLE(backend, 0)
HANDLE(tree, 1)
HANDLE(scene, 2)
HANDLE(cloud, 3)
HANDLE(lists, 4)
HANDLE(met, 5)
MISTAKE(tree_is_scene, a->tree.id = a->scene.id)
MISTAKE(scene_is_tree, a->scene.id = a->tree.id)
MISTAKE(cloud_is_lists, a->cloud.id = a->lists.id)
MISTAKE(lists_is_cloud, a->lists.id = a->cloud.id)
MISTAKE(met_is_crossings, a->met.id = a->lists.id)
MISTAKE(crossings_are_met, a->lists.id = a->met.id)
MISTAKE(backend_is_tree, a->backend.id = a->tree.id)

MISTAKE(mesh_null, a->mesh = NULL)
MISTAKE(mesh_odd, a->mesh = BYTE(a->mesh, 2))
MISTAKE(positions_null, a->mesh_record.positions = NULL)
MISTAKE(positions_odd, a->mesh_record.positions = BYTE(a->mesh_record.positions, 1))
MISTAKE(position_stride_0, a->mesh_record.position_stride = 0)
MISTAKE(position_stride_4, a->mesh_record.position_stride = 4)
MISTAKE(position_stride_14, a->mesh_record.position_stride = 14)
MISTAKE(position_stride_huge, a->mesh_record.position_stride = SIZE_MAX - 3)
MISTAKE(position_count_huge, a->mesh_record.position_count = SIZE_MAX)
MISTAKE(position_count_large, a->mesh_record.position_count = (size_t)1 << 33)
MISTAKE(too_few_positions, a->mesh_record.position_count = 7)
MISTAKE(indices_null, a->mesh_record.indices = NULL)
MISTAKE(indices_odd, a->mesh_record.indices = BYTE(a->mesh_record.indices, 2))
MISTAKE(index_stride_0, a->mesh_record.index_stride = 0)
MISTAKE(index_stride_8, a->mesh_record.index_stride = 8)
MISTAKE(index_stride_13, a->mesh_record.index_stride = 13)
MISTAKE(index_stride_huge, a->mesh_record.index_stride = SIZE_MAX - 3)
MISTAKE(triangles_huge, a->mesh_record.triangle_count = SIZE_MAX)
MISTAKE(triangles_many, a->mesh_record.triangle_count = ((size_t)1 << 28) + 1)
MISTAKE(index_out_of_range, a->mesh_record.indices = bad_faces[0])
MISTAKE(no_soup, (a->mesh_record.indices = NULL, a->mesh_record.index_stride = 0))

MISTAKE(rays_null, a->rays = NULL)
MISTAKE(rays_odd, a->rays = BYTE(a->rays, 4))
MISTAKE(origins_null, a->rays_record.origins = NULL)
MISTAKE(origins_odd, a->rays_record.origins = BYTE(a->rays_record.origins, 1))
MISTAKE(origin_stride_0, a->rays_record.origin_stride = 0)
MISTAKE(origin_stride_8, a->rays_record.origin_stride = 8)
MISTAKE(origin_stride_15, a->rays_record.origin_stride = 15)
MISTAKE(directions_null, a->rays_record.directions = NULL)
MISTAKE(directions_odd, a->rays_record.directions = BYTE(a->rays_record.directions, 3))
MISTAKE(direction_stride_0, a->rays_record.direction_stride = 0)
MISTAKE(direction_stride_13, a->rays_record.direction_stride = 13)
MISTAKE(t_min_odd, a->rays_record.t_min = BYTE(a->rays_record.t_min, 2))
MISTAKE(t_min_stride_2, a->rays_record.t_min_stride = 2)
MISTAKE(t_max_odd, a->rays_record.t_max = BYTE(a->rays_record.t_max, 1))
MISTAKE(t_max_stride_6, a->rays_record.t_max_stride = 6)
MISTAKE(ray_count_huge, a->rays_record.count = SIZE_MAX)
MISTAKE(ray_count_overflow, a->rays_record.count = SIZE_MAX / 32 + 2)

MISTAKE(build_odd, a->build = BYTE(a->build, 4))
MISTAKE(build_size_0, a->build_record.size = 0)
MISTAKE(build_size_more, a->build_record.size += 8)
MISTAKE(preset_unknown, a->build_record.preset = 4)
MISTAKE(layout_unknown, a->build_record.layout = 77)
MISTAKE(build_threads, a->build_record.threads = 1025)
MISTAKE(build_reserved, a->build_record.reserved = 1)
MISTAKE(knobs_null, (a->build_record.knobs = NULL, a->build_record.knob_count = 1))
MISTAKE(knobs_odd, (a->build_record.knobs = BYTE(&a->knob, 1), a->build_record.knob_count = 1))
MISTAKE(knobs_many, a->build_record.knob_count = SIZE_MAX)
MISTAKE(knob_unknown, (a->knob.name = "speed", a->build_record.knob_count = 1))
MISTAKE(knob_null, (a->knob.name = NULL, a->build_record.knob_count = 1))
MISTAKE(knob_endless, (a->knob.name = endless, a->build_record.knob_count = 1))
MISTAKE(knob_not_utf8, (a->knob.name = "\xff\xfe", a->build_record.knob_count = 1))
MISTAKE(knob_of_another, (a->knob.name = "bins", a->build_record.knob_count = 1))
MISTAKE(knob_too_great, (a->knob.name = "max_depth", a->knob.value = UINT32_MAX, a->build_record.knob_count = 1))
MISTAKE(clip_2, (a->knob.name = "clip", a->knob.value = 2, a->build_record.knob_count = 1))
MISTAKE(preset_of_load, a->build_record.preset = SPLITPLANE_PRESET_BEST)
MISTAKE(knob_of_load, (a->knob.name = "block_width", a->knob.value = 4, a->build_record.knob_count = 1))
MISTAKE(no_memory, a->build_record.max_memory = 1)

MISTAKE(query_odd, a->query = BYTE(a->query, 2))
MISTAKE(query_size_0, a->query_record.size = 0)
MISTAKE(query_size_less, a->query_record.size -= 8)
MISTAKE(accuracy_unknown, a->query_record.accuracy = 3)
MISTAKE(culling_unknown, a->query_record.culling = UINT32_MAX)
MISTAKE(query_threads, a->query_record.threads = UINT32_MAX)
MISTAKE(query_reserved, a->query_record.reserved = 7)
MISTAKE(distance_nan, a->query_record.max_distance = NAN)
MISTAKE(accuracy_unused, a->query_record.accuracy = SPLITPLANE_ACCURACY_EXACT)
MISTAKE(culling_unused, a->query_record.culling = SPLITPLANE_CULLING_BACK)
MISTAKE(mask_unused, a->query_record.mask = 1)
MISTAKE(instance_unused, a->query_record.ignore_instance = 0)
MISTAKE(distance_unused, a->query_record.max_distance = 1)
MISTAKE(memory_unused, a->query_record.max_memory = 1000000)

MISTAKE(filter_unused, a->query_record.filter = keep_hit)
MISTAKE(point_filter_unused, a->query_record.point_filter = keep_point)
MISTAKE(filter_user_unused, a->query_record.filter_user = &a->number)

MISTAKE(shapes_null, a->shapes = NULL)
MISTAKE(shapes_odd, a->shapes = BYTE(a->shapes, 4))
MISTAKE(shape_kind_unknown, a->shapes_record.kind = 3)
MISTAKE(shapes_reserved, a->shapes_record.reserved = 1)
MISTAKE(shape_numbers_null, a->shapes_record.numbers = NULL)
MISTAKE(shape_numbers_odd, a->shapes_record.numbers = BYTE(a->shapes_record.numbers, 2))
MISTAKE(shape_stride_0, a->shapes_record.stride = 0)
MISTAKE(shape_stride_8, a->shapes_record.stride = 8)
MISTAKE(shape_stride_18, a->shapes_record.stride = 18)
MISTAKE(shape_stride_huge, a->shapes_record.stride = SIZE_MAX - 3)
MISTAKE(shape_count_huge, a->shapes_record.count = SIZE_MAX)
MISTAKE(shape_count_many, a->shapes_record.count = (size_t)1 << 28)
MISTAKE(spheres_have_no_function, a->shapes_record.intersect = no_hit)
MISTAKE(spheres_have_no_user, a->shapes_record.user = a)
MISTAKE(own_shapes_need_a_function, (a->shapes_record.kind = SPLITPLANE_SHAPE_KIND_OWN, a->shapes_record.stride = 24))
MISTAKE(own_shapes_need_a_box, (a->shapes_record.kind = SPLITPLANE_SHAPE_KIND_OWN, a->shapes_record.intersect = no_hit))
MISTAKE(level_13, a->level = 13)
MISTAKE(opacity_words_null, a->opacity_words = NULL)
MISTAKE(opacity_words_odd, a->opacity_words = BYTE(a->opacity_words, 1))
MISTAKE(opacity_words_few, a->opacity_count -= 1)
MISTAKE(opacity_words_many, a->opacity_count += 1)
MISTAKE(opacity_words_huge, a->opacity_count = SIZE_MAX)

MISTAKE(volumes_null, a->volumes = NULL)
MISTAKE(volumes_odd, a->volumes = BYTE(a->volumes, 4))
MISTAKE(volume_kind_unknown, a->volumes_record.kind = 5)
MISTAKE(volumes_reserved, a->volumes_record.reserved = 1)
MISTAKE(volume_numbers_null, a->volumes_record.numbers = NULL)
MISTAKE(volume_numbers_odd, a->volumes_record.numbers = BYTE(a->volumes_record.numbers, 2))
MISTAKE(volume_stride_0, a->volumes_record.stride = 0)
MISTAKE(volume_stride_20, a->volumes_record.stride = 20)
MISTAKE(volume_stride_26, a->volumes_record.stride = 26)
MISTAKE(volume_stride_huge, a->volumes_record.stride = SIZE_MAX - 3)
MISTAKE(volume_count_huge, a->volumes_record.count = SIZE_MAX)
MISTAKE(triangles_are_longer, a->volumes_record.kind = SPLITPLANE_VOLUME_KIND_TRIANGLE)
MISTAKE(boxes_have_no_starts, a->volumes_record.starts = plane_starts)
#define PLANES(name, statement) MISTAKE(name, (a->volumes_record.kind = SPLITPLANE_VOLUME_KIND_PLANES, a->volumes_record.starts = plane_starts, statement))
PLANES(planes_need_starts, a->volumes_record.starts = NULL)
PLANES(plane_starts_odd, a->volumes_record.starts = BYTE(plane_starts, 4))
PLANES(plane_starts_fall, a->volumes_record.starts = falling_starts)
PLANES(plane_starts_late, a->volumes_record.starts = late_starts)
PLANES(planes_many, a->volumes_record.starts = endless_starts)
PLANES(plane_stride_12, a->volumes_record.stride = 12)
PLANES(plane_sets_huge, a->volumes_record.count = SIZE_MAX)
MISTAKE(out_is_volumes, a->out = volume_words)
MISTAKE(out_is_starts, (a->volumes_record.kind = SPLITPLANE_VOLUME_KIND_PLANES, a->volumes_record.starts = plane_starts, a->out = plane_starts))
MISTAKE(volume_memory, a->query_record.max_memory = 16)
MISTAKE(bodies_null, a->bodies = NULL)
MISTAKE(bodies_odd, a->bodies = BYTE(a->bodies, 4))
MISTAKE(radii_null, a->bodies_record.radii = NULL)
MISTAKE(radii_odd, a->bodies_record.radii = BYTE(a->bodies_record.radii, 1))
MISTAKE(one_radius_null, (a->bodies_record.radius_stride = 0, a->bodies_record.radii = NULL))
MISTAKE(radius_stride_2, a->bodies_record.radius_stride = 2)
MISTAKE(radius_stride_huge, a->bodies_record.radius_stride = SIZE_MAX - 3)
MISTAKE(axes_odd, a->bodies_record.axes = BYTE(point_words, 2))
MISTAKE(axis_stride_8, (a->bodies_record.axes = point_words[0], a->bodies_record.axis_stride = 8))
MISTAKE(out_is_radii, a->out = radius_words)
MISTAKE(out_is_axes, (a->bodies_record.axes = point_words[0], a->bodies_record.axis_stride = 16, a->out = point_words))
MISTAKE(lazy_threads, a->build_record.threads = 1)
static int32_t go_on(void *user, const char *stage, uint64_t done, uint64_t total) {
    (void)user, (void)stage, (void)done, (void)total;
    return 0;
}
MISTAKE(lazy_progress, a->build_record.progress = go_on)

MISTAKE(points_null, a->points = NULL)
MISTAKE(points_odd, a->points = BYTE(a->points, 2))
MISTAKE(point_stride_0, a->point_stride = 0)
MISTAKE(point_stride_8, a->point_stride = 8)
MISTAKE(point_stride_18, a->point_stride = 18)
MISTAKE(point_count_huge, a->point_count = SIZE_MAX)
MISTAKE(point_count_overflow, a->point_count = SIZE_MAX / 16 + 2)

MISTAKE(out_null, a->out = NULL)
MISTAKE(out_odd, a->out = BYTE(a->out, 1))
MISTAKE(out_stride_0, a->out_stride = 0)
MISTAKE(out_stride_odd, a->out_stride += 1)
MISTAKE(out_stride_huge, a->out_stride = SIZE_MAX - 7)
MISTAKE(out_is_rays, a->out = ray_words)
MISTAKE(out_is_late_rays, a->out = ray_words[FEW - 1])
MISTAKE(out_is_points, a->out = point_words)
MISTAKE(out_is_late_points, a->out = point_words[FEW - 2])
MISTAKE(room_null, a->room = NULL)
MISTAKE(room_odd, a->room = BYTE(a->room, 1))
MISTAKE(report_odd, a->report = BYTE(a->report, 4))

MISTAKE(path_null, a->path = NULL)
MISTAKE(path_endless, a->path = endless)
MISTAKE(path_not_utf8, a->path = "\xc3\x28")
MISTAKE(path_nowhere, a->path = folder)
MISTAKE(path_folder, a->path = "/")
MISTAKE(path_empty, a->path = "")
MISTAKE(bytes_null, a->bytes = NULL)
MISTAKE(bytes_odd, a->bytes = BYTE(a->bytes, 2))
MISTAKE(bytes_none, a->size = 0)
MISTAKE(bytes_short, a->size -= 1)
MISTAKE(bytes_head, a->size = 12)
MISTAKE(bytes_huge, a->size = SIZE_MAX)
static void bytes_damaged(args *a) {
    memcpy(damaged, a->bytes, a->size);
    ((uint8_t *)damaged)[a->size - 1] ^= 4;
    a->bytes = (const uint8_t *)damaged;
}
static void bytes_of_another(args *a) { a->bytes = (const uint8_t *)memset(damaged, 7, a->size); }

MISTAKE(instance_null, a->instance = NULL)
MISTAKE(instance_odd, a->instance = BYTE(a->instance, 1))
MISTAKE(transform_nan, a->instance_record.transform[5] = NAN)
MISTAKE(transform_infinite, a->instance_record.transform[3] = INFINITY)
MISTAKE(transform_flat, memset(a->instance_record.transform, 0, sizeof a->instance_record.transform))
MISTAKE(instance_culling, a->instance_record.culling = 3)
MISTAKE(instance_geometry, a->instance_record.geometry = 99)
MISTAKE(geometry_unknown, a->geometry = 5)
MISTAKE(number_unknown, a->number = SPLITPLANE_NONE)
MISTAKE(capacity_less, a->capacity = 1)
MISTAKE(k_huge, a->k = SIZE_MAX / 2)
MISTAKE(k_overflow, a->k = SIZE_MAX / FEW)
MISTAKE(nan_mesh, a->mesh_record.positions = (const float *)bad_faces)

#define FIVE(handle, use) \
    {#handle " null", handle##_null, use, 0, SPLITPLANE_STATUS_HANDLE}, \
    {#handle " made up", handle##_made_up, use, 0, SPLITPLANE_STATUS_HANDLE}, \
    {#handle " dead", handle##_dead, use, 0, SPLITPLANE_STATUS_HANDLE}, \
    {#handle " of a later use", handle##_later, use, 0, SPLITPLANE_STATUS_HANDLE}, \
    {#handle " huge", handle##_huge, use, 0, SPLITPLANE_STATUS_HANDLE}
#define ONE(mistake, use, status) {#mistake, mistake, use, 0, SPLITPLANE_STATUS_##status}
#define BUT(mistake, use, without, status) {#mistake, mistake, use, without, SPLITPLANE_STATUS_##status}

static const struct {
    const char *name;
    void (*make)(args *);
    /* Calls that use all of the first and none of the second. */
    uint64_t uses, without;
    splitplane_status status;
} mistakes[] = {
    FIVE(backend, BACKEND),
    FIVE(tree, TREE),
    FIVE(scene, SCENE),
    FIVE(cloud, CLOUD),
    FIVE(lists, LISTS),
    FIVE(met, MET),
    ONE(met_is_crossings, MET, HANDLE),
    ONE(crossings_are_met, LISTS | OUT, HANDLE),
    ONE(tree_is_scene, TREE, HANDLE),
    ONE(scene_is_tree, SCENE, HANDLE),
    ONE(cloud_is_lists, CLOUD, HANDLE),
    ONE(lists_is_cloud, LISTS, HANDLE),
    ONE(backend_is_tree, BACKEND, HANDLE),
    ONE(mesh_null, MESH, NULL_POINTER),
    ONE(mesh_odd, MESH, MISALIGNED),
    ONE(positions_null, MESH, NULL_POINTER),
    ONE(positions_odd, MESH, MISALIGNED),
    ONE(position_stride_0, MESH, STRIDE),
    ONE(position_stride_4, MESH, STRIDE),
    ONE(position_stride_14, MESH, STRIDE),
    ONE(position_stride_huge, MESH, COUNT),
    ONE(position_count_huge, MESH, COUNT),
    ONE(position_count_large, MESH, COUNT),
    ONE(too_few_positions, MESH, MESH),
    ONE(indices_null, MESH, NULL_POINTER),
    ONE(indices_odd, MESH, MISALIGNED),
    ONE(index_stride_0, MESH, STRIDE),
    ONE(index_stride_8, MESH, STRIDE),
    ONE(index_stride_13, MESH, STRIDE),
    ONE(index_stride_huge, MESH, COUNT),
    ONE(triangles_huge, MESH, MESH),
    ONE(triangles_many, MESH, MESH),
    ONE(index_out_of_range, MESH, MESH),
    ONE(no_soup, MESH, COUNT),
    ONE(rays_null, RAYS, NULL_POINTER),
    ONE(rays_odd, RAYS, MISALIGNED),
    ONE(origins_null, RAYS, NULL_POINTER),
    ONE(origins_odd, RAYS, MISALIGNED),
    ONE(origin_stride_0, RAYS, STRIDE),
    ONE(origin_stride_8, RAYS, STRIDE),
    ONE(origin_stride_15, RAYS, STRIDE),
    ONE(directions_null, RAYS, NULL_POINTER),
    ONE(directions_odd, RAYS, MISALIGNED),
    ONE(direction_stride_0, RAYS, STRIDE),
    ONE(direction_stride_13, RAYS, STRIDE),
    ONE(t_min_odd, RAYS, MISALIGNED),
    ONE(t_min_stride_2, RAYS, STRIDE),
    ONE(t_max_odd, RAYS, MISALIGNED),
    ONE(t_max_stride_6, RAYS, STRIDE),
    ONE(ray_count_huge, RAYS, COUNT),
    ONE(ray_count_overflow, RAYS, COUNT),
    ONE(build_odd, BUILD, MISALIGNED),
    ONE(build_size_0, BUILD, OPTION),
    ONE(build_size_more, BUILD, OPTION),
    ONE(preset_unknown, BUILD, OPTION),
    ONE(layout_unknown, BUILD, OPTION),
    ONE(build_threads, BUILD, OPTION),
    ONE(build_reserved, BUILD, OPTION),
    ONE(knobs_null, BUILD, NULL_POINTER),
    ONE(knobs_odd, BUILD, MISALIGNED),
    ONE(knobs_many, BUILD, COUNT),
    ONE(knob_unknown, BUILD, OPTION),
    ONE(knob_null, BUILD, NULL_POINTER),
    ONE(knob_endless, BUILD, TEXT),
    ONE(knob_not_utf8, BUILD, TEXT),
    ONE(knob_of_another, BUILD, OPTION),
    ONE(knob_too_great, BUILD, OPTION),
    ONE(clip_2, BUILD, OPTION),
    ONE(preset_of_load, LOADS, OPTION),
    ONE(knob_of_load, LOADS, OPTION),
    BUT(no_memory, BUILD, SCENE | LAZY, OUT_OF_MEMORY),
    ONE(query_odd, QUERY, MISALIGNED),
    ONE(query_size_0, QUERY, OPTION),
    ONE(query_size_less, QUERY, OPTION),
    ONE(accuracy_unknown, QUERY, OPTION),
    ONE(culling_unknown, QUERY, OPTION),
    ONE(query_threads, QUERY, OPTION),
    ONE(query_reserved, QUERY, OPTION),
    ONE(distance_nan, QUERY, OPTION),
    ONE(accuracy_unused, NO_ACCURACY, OPTION),
    ONE(culling_unused, NO_CULLING, OPTION),
    ONE(mask_unused, NO_MASK, OPTION),
    ONE(instance_unused, QUERY, OPTION),
    ONE(distance_unused, NO_DISTANCE, OPTION),
    ONE(memory_unused, NO_MEMORY, OPTION),
    BUT(filter_unused, QUERY, FILTERS, OPTION),
    BUT(point_filter_unused, QUERY, CLOUD, OPTION),
    BUT(filter_user_unused, QUERY, FILTERS | CLOUD, OPTION),
    ONE(shapes_null, SHAPES, NULL_POINTER),
    ONE(shapes_odd, SHAPES, MISALIGNED),
    ONE(shape_kind_unknown, SHAPES, OPTION),
    ONE(shapes_reserved, SHAPES, OPTION),
    ONE(shape_numbers_null, SHAPES, NULL_POINTER),
    ONE(shape_numbers_odd, SHAPES, MISALIGNED),
    ONE(shape_stride_0, SHAPES, STRIDE),
    ONE(shape_stride_8, SHAPES, STRIDE),
    ONE(shape_stride_18, SHAPES, STRIDE),
    ONE(shape_stride_huge, SHAPES, COUNT),
    ONE(shape_count_huge, SHAPES, COUNT),
    ONE(shape_count_many, SHAPES, COUNT),
    ONE(spheres_have_no_function, SHAPES, OPTION),
    ONE(spheres_have_no_user, SHAPES, OPTION),
    ONE(own_shapes_need_a_function, SHAPES, NULL_POINTER),
    ONE(own_shapes_need_a_box, SHAPES, STRIDE),
    ONE(level_13, OPACITY, OPTION),
    ONE(opacity_words_null, OPACITY, NULL_POINTER),
    ONE(opacity_words_odd, OPACITY, MISALIGNED),
    ONE(opacity_words_few, OPACITY, COUNT),
    ONE(opacity_words_many, OPACITY, COUNT),
    ONE(opacity_words_huge, OPACITY, COUNT),
    ONE(volumes_null, VOLUMES, NULL_POINTER),
    ONE(volumes_odd, VOLUMES, MISALIGNED),
    ONE(volume_kind_unknown, VOLUMES, OPTION),
    ONE(volumes_reserved, VOLUMES, OPTION),
    ONE(volume_numbers_null, VOLUMES, NULL_POINTER),
    ONE(volume_numbers_odd, VOLUMES, MISALIGNED),
    ONE(volume_stride_0, VOLUMES, STRIDE),
    ONE(volume_stride_20, VOLUMES, STRIDE),
    ONE(volume_stride_26, VOLUMES, STRIDE),
    ONE(volume_stride_huge, VOLUMES, COUNT),
    ONE(volume_count_huge, VOLUMES, COUNT),
    ONE(triangles_are_longer, VOLUMES, STRIDE),
    ONE(boxes_have_no_starts, VOLUMES, OPTION),
    ONE(planes_need_starts, VOLUMES, NULL_POINTER),
    ONE(plane_starts_odd, VOLUMES, MISALIGNED),
    ONE(plane_starts_fall, VOLUMES, OPTION),
    ONE(plane_starts_late, VOLUMES, OPTION),
    ONE(planes_many, VOLUMES, COUNT),
    ONE(plane_stride_12, VOLUMES, STRIDE),
    ONE(plane_sets_huge, VOLUMES, COUNT),
    ONE(out_is_volumes, VOLUMES | OUT, OVERLAP),
    ONE(out_is_starts, VOLUMES | OUT, OVERLAP),
    ONE(volume_memory, VOLUMES | ROOM, OUT_OF_MEMORY),
    ONE(bodies_null, BODIES, NULL_POINTER),
    ONE(bodies_odd, BODIES, MISALIGNED),
    ONE(radii_null, BODIES, NULL_POINTER),
    ONE(radii_odd, BODIES, MISALIGNED),
    ONE(one_radius_null, BODIES, NULL_POINTER),
    ONE(radius_stride_2, BODIES, STRIDE),
    ONE(radius_stride_huge, BODIES, COUNT),
    ONE(axes_odd, BODIES, MISALIGNED),
    ONE(axis_stride_8, BODIES, STRIDE),
    ONE(out_is_radii, BODIES | OUT, OVERLAP),
    ONE(out_is_axes, BODIES | OUT, OVERLAP),
    ONE(lazy_threads, LAZY, OPTION),
    ONE(lazy_progress, LAZY, OPTION),
    ONE(points_null, POINTS, NULL_POINTER),
    ONE(points_odd, POINTS, MISALIGNED),
    ONE(point_stride_0, POINTS, STRIDE),
    ONE(point_stride_8, POINTS, STRIDE),
    ONE(point_stride_18, POINTS, STRIDE),
    ONE(point_count_huge, POINTS, COUNT),
    ONE(point_count_overflow, POINTS, COUNT),
    ONE(out_null, OUT, NULL_POINTER),
    ONE(out_odd, WORDS, MISALIGNED),
    ONE(out_stride_0, OUT, STRIDE),
    ONE(out_stride_odd, WORDS, STRIDE),
    ONE(out_stride_huge, OUT, COUNT),
    ONE(out_is_rays, RAYS | OUT, OVERLAP),
    ONE(out_is_late_rays, RAYS | OUT, OVERLAP),
    ONE(out_is_points, POINTS | OUT, OVERLAP),
    ONE(out_is_late_points, POINTS | OUT, OVERLAP),
    ONE(room_null, ROOM, NULL_POINTER),
    ONE(room_odd, ROOM, MISALIGNED),
    ONE(report_odd, REPORT, MISALIGNED),
    ONE(path_null, PATH, NULL_POINTER),
    ONE(path_endless, PATH, TEXT),
    ONE(path_not_utf8, PATH, TEXT),
    ONE(path_nowhere, PATH, IO),
    ONE(path_folder, PATH, IO),
    ONE(path_empty, PATH, IO),
    ONE(bytes_null, BYTES, NULL_POINTER),
    ONE(bytes_odd, BYTES, MISALIGNED),
    ONE(bytes_none, BYTES, FILE),
    ONE(bytes_short, BYTES, FILE),
    ONE(bytes_head, BYTES, FILE),
    ONE(bytes_huge, BYTES, COUNT),
    ONE(bytes_damaged, BYTES, FILE),
    ONE(bytes_of_another, BYTES, FILE),
    ONE(instance_null, INSTANCE, NULL_POINTER),
    ONE(instance_odd, INSTANCE, MISALIGNED),
    ONE(transform_nan, INSTANCE, SCENE),
    ONE(transform_infinite, INSTANCE, SCENE),
    ONE(transform_flat, INSTANCE, SCENE),
    ONE(instance_culling, INSTANCE, OPTION),
    ONE(instance_geometry, INSTANCE, UNKNOWN_ID),
    ONE(geometry_unknown, GEOMETRY, UNKNOWN_ID),
    ONE(number_unknown, NUMBER, UNKNOWN_ID),
    ONE(capacity_less, CAPACITY, CAPACITY),
    ONE(k_huge, NEAREST, COUNT),
    ONE(k_overflow, NEAREST, COUNT),
    ONE(nan_mesh, TREE | MESH | PATH, WRONG_MESH),
};

static void fill(void) {
    for (int i = 0; i < 8; i++) {
        for (int axis = 0; axis < 3; axis++) {
            positions[i][axis] = (float)(i >> axis & 1);
        }
    }
    memcpy(bad_faces, faces, sizeof faces);
    bad_faces[11][2] = 8;
    for (int i = 0; i < FEW; i++) {
        const float words[8] = {-1, 0.5f, 0.25f + 0.01f * (float)i, 0, 1, 0.1f, 0.1f, INFINITY};
        memcpy(ray_words[i], words, sizeof words);
        for (int axis = 0; axis < 4; axis++) {
            point_words[i][axis] = 0.04f * (float)i + 0.1f * (float)axis;
        }
        for (int axis = 0; axis < 6; axis++) {
            volume_words[i][axis] = 0.02f * (float)i + (axis < 3 ? -0.1f : 0.1f);
        }
        radius_words[i] = 0.01f;
    }
    memset(endless, 'a', sizeof endless);
    for (int i = 0; i <= FEW; i++) {
        /* The planes are the first numbers of the boxes. */
        plane_starts[i] = falling_starts[i] = endless_starts[i] = (uint64_t)i;
        late_starts[i] = (uint64_t)i + 1;
    }
    falling_starts[7] = 5;
    endless_starts[FEW] = (uint64_t)1 << 62;

    args *a = &good;
    a->mesh_record = (splitplane_mesh){positions[0], 12, 8, faces[0], 12, 12};
    a->rays_record = (splitplane_rays){ray_words[0], 32, ray_words[0] + 4, 32, ray_words[0] + 3, 32, ray_words[0] + 7, 32, FEW};
    need(splitplane_build_options_init(&a->build_record, sizeof a->build_record));
    need(splitplane_query_options_init(&a->query_record, sizeof a->query_record));
    a->knob = (splitplane_knob){"max_depth", 64};
    a->points = point_words[0];
    a->point_stride = sizeof point_words[0];
    a->point_count = FEW;
    a->k = 2;
    a->capacity = sizeof answers;
    a->out = answers;
    a->room = room_words;
    a->report = &report;
    a->dimensions = 3;
    a->backend_name = "cpu";
    memset(&a->shapes_record, 0, sizeof a->shapes_record);
    a->shapes_record.kind = SPLITPLANE_SHAPE_KIND_SPHERES;
    a->shapes_record.numbers = point_words[0];
    a->shapes_record.stride = sizeof point_words[0];
    a->shapes_record.count = FEW;
    a->volumes_record = (splitplane_volumes){SPLITPLANE_VOLUME_KIND_BOX, 0, volume_words[0], sizeof volume_words[0], FEW, NULL};
    a->bodies_record = (splitplane_bodies){radius_words, sizeof radius_words[0], NULL, 0};
    memset(opacity_bits, 255, 24);
    a->level = 2;
    a->opacity_words = opacity_bits;
    a->opacity_count = 6;
    a->opacity = opaque;
    a->instance_record = (splitplane_instance){{1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0}, 0, UINT32_MAX, 0, 0};
}

/* One of everything. */
static void make(args *a) {
    uint32_t name;
    need(splitplane_backend_open("cpu", NULL, &a->backend));
    need(splitplane_tree_build(a->backend, &a->mesh_record, NULL, &a->tree));
    need(splitplane_scene_create(a->backend, &a->scene));
    need(splitplane_scene_add_geometry(a->scene, &a->mesh_record, &name));
    need(splitplane_scene_add_instance(a->scene, &a->instance_record, &name));
    need(splitplane_scene_add_shapes(a->scene, &a->shapes_record, &name));
    need(splitplane_scene_set_opacity(a->scene, 0, a->level, a->opacity_words, a->opacity_count));
    need(splitplane_scene_update(a->scene, NULL, NULL));
    need(splitplane_point_tree_build(a->backend, a->points, a->point_stride, FEW, 3, 0, NULL, &a->cloud));
    need(splitplane_tree_all_hits(a->tree, &a->rays_record, NULL, &a->lists, NULL));
    need(splitplane_tree_overlaps(a->tree, &a->volumes_record, NULL, &a->met, NULL));
}

static void unmake(const args *a) {
    need(splitplane_lists_free(a->met));
    need(splitplane_lists_free(a->lists));
    need(splitplane_point_tree_free(a->cloud));
    need(splitplane_scene_free(a->scene));
    need(splitplane_tree_free(a->tree));
    need(splitplane_backend_free(a->backend));
}

/* A copy of what is in order, which points into itself. */
static args fresh(void) { return good; }
static void point_into(args *a) {
    a->mesh = &a->mesh_record;
    a->rays = &a->rays_record;
    a->build = &a->build_record;
    a->build_record.knobs = &a->knob;
    a->query = &a->query_record;
    a->instance = &a->instance_record;
    a->shapes = &a->shapes_record;
    a->volumes = &a->volumes_record;
    a->bodies = &a->bodies_record;
}

/* What a call that was to fail has made by mistake, or one that was to succeed. */
static void drop_room(const char *name) {
    const uint64_t id = room_words[0];
    if (strcmp(name, "tree_build") == 0 || strncmp(name, "tree_load", 9) == 0) {
        need(splitplane_tree_free((splitplane_tree){id}));
    } else if (strcmp(name, "backend_open") == 0) {
        need(splitplane_backend_free((splitplane_backend){id}));
    } else if (strncmp(name, "scene_create", 12) == 0 || strncmp(name, "scene_load", 10) == 0) {
        need(splitplane_scene_free((splitplane_scene){id}));
    } else if (strcmp(name, "point_tree_build") == 0) {
        need(splitplane_point_tree_free((splitplane_point_tree){id}));
    } else if (strstr(name, "all_hits") || strcmp(name, "tree_overlaps") == 0 || strcmp(name, "scene_overlaps") == 0 ||
               strcmp(name, "point_tree_within") == 0) {
        need(splitplane_lists_free((splitplane_lists){id}));
    } else if (strcmp(name, "scene_add_geometry") == 0 || strcmp(name, "scene_add_shapes") == 0) {
        need(splitplane_scene_remove_geometry(good.scene, *(uint32_t *)room_words));
    } else if (strcmp(name, "scene_add_instance") == 0) {
        need(splitplane_scene_remove_instance(good.scene, *(uint32_t *)room_words));
    }
}

static void prepare(args *a, size_t call) {
    *a = fresh();
    point_into(a);
    a->out_stride = calls[call].record;
    const int of_scene = (calls[call].uses & SCENE) || strncmp(calls[call].name, "scene_", 6) == 0;
    a->bytes = of_scene ? scene_file : tree_file;
    a->size = of_scene ? scene_size : tree_size;
    a->path = saved;
    if (calls[call].uses & PATH) {
        /* A file that can be read and written. */
        need(of_scene ? splitplane_scene_save(good.scene, saved) : splitplane_tree_save(good.tree, &good.mesh_record, saved));
    }
}

int main(int count, char **words) {
    snprintf(saved, sizeof saved, "%s/misuse.tmp", count > 1 ? words[1] : ".");
    fill();
    make(&good);
    args second = good;
    make(&second);
    dead[0] = second.backend.id, dead[1] = second.tree.id, dead[2] = second.scene.id;
    dead[3] = second.cloud.id, dead[4] = second.lists.id, dead[5] = second.met.id;
    unmake(&second);
    need(splitplane_tree_write(good.tree, &good.mesh_record, NULL, 0, &tree_size));
    need(splitplane_scene_write(good.scene, NULL, 0, &scene_size));
    tree_file = malloc(tree_size);
    scene_file = malloc(scene_size);
    damaged = malloc(tree_size + scene_size);
    if (!tree_file || !scene_file || !damaged) {
        return 1;
    }
    need(splitplane_tree_write(good.tree, &good.mesh_record, tree_file, tree_size, NULL));
    need(splitplane_scene_write(good.scene, scene_file, scene_size, NULL));

    unsigned made = 0, wrong = 0;
    static unsigned per_mistake[COUNT(mistakes)];
    for (size_t call = 0; call < COUNT(calls); call++) {
        static args a;
        /* In order it succeeds: so a failure is that of the mistake. */
        prepare(&a, call);
        splitplane_status status = calls[call].call(&a);
        if (status != SPLITPLANE_STATUS_OK) {
            fprintf(stderr, "%s in order: status %d: %s\n", calls[call].name, (int)status, splitplane_last_message());
            wrong++;
            continue;
        }
        drop_room(calls[call].name);
        need(splitplane_scene_update(good.scene, NULL, NULL));
        for (size_t mistake = 0; mistake < COUNT(mistakes); mistake++) {
            const uint64_t uses = calls[call].uses;
            if ((uses & mistakes[mistake].uses) != mistakes[mistake].uses || (uses & mistakes[mistake].without)) {
                continue;
            }
            prepare(&a, call);
            if (count < 3 || made != 100) {
                mistakes[mistake].make(&a);
            }
            status = calls[call].call(&a);
            made++;
            per_mistake[mistake]++;
            if (status != mistakes[mistake].status || splitplane_last_message()[0] == '\0') {
                fprintf(stderr, "%s, %s: status %d, not %d: %s\n", calls[call].name, mistakes[mistake].name, (int)status,
                        (int)mistakes[mistake].status, splitplane_last_message());
                wrong++;
            }
        }
    }
    for (size_t mistake = 0; mistake < COUNT(mistakes); mistake++) {
        if (per_mistake[mistake] == 0) {
            fprintf(stderr, "%s is made nowhere\n", mistakes[mistake].name);
            wrong++;
        }
    }
    unmake(&good);
    remove(saved);
    free(tree_file);
    free(scene_file);
    free(damaged);
    if (splitplane_live_handles() != 0) {
        fprintf(stderr, "%llu handles are left\n", (unsigned long long)splitplane_live_handles());
        wrong++;
    }
    printf("%u misuses of %zu calls, %u wrong\n", made, COUNT(calls), wrong);
    return wrong == 0 && made >= 500 ? 0 : 1;
}
