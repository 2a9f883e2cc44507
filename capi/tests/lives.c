/* Lives of objects: builds and queries without a leak, counted; several threads on one object; calls from the progress function; cancelled calls.
 *
 *     lives [rounds [leak]]
 *
 * With `leak` every tenth tree is kept, which has to be found out.
 */
#include <pthread.h>
#include <sched.h>
#include <splitplane.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#ifdef __GLIBC__
#include <malloc.h>
#endif

enum { SIDE = 12, VERTICES = (SIDE + 1) * (SIDE + 1), TRIANGLES = 2 * SIDE * SIDE, RAYS = 200, THREADS = 4 };

static float positions[VERTICES][3];
static uint32_t faces[TRIANGLES][3];
static float rays_words[RAYS][6];
static splitplane_mesh mesh;
static splitplane_rays rays;
static int leaks;

static void fail(const char *what, splitplane_status status) {
    fprintf(stderr, "lives: %s: status %d: %s\n", what, (int)status, splitplane_last_message());
    exit(1);
}

static void need(const char *what, splitplane_status status) {
    if (status != SPLITPLANE_STATUS_OK) {
        fail(what, status);
    }
}

static void expect(const char *what, splitplane_status status, splitplane_status expected) {
    if (status != expected) {
        fail(what, status);
    }
}

/* A bumpy square. */
static void shape(unsigned round) {
    for (int i = 0; i < VERTICES; i++) {
        const int x = i % (SIDE + 1), y = i / (SIDE + 1);
        positions[i][0] = (float)x, positions[i][1] = (float)y;
        positions[i][2] = 0.3f * (float)((x * 7 + y * 3 + (int)(round % 11)) % 5);
    }
}

static void fill(void) {
    shape(0);
    for (int i = 0; i < SIDE * SIDE; i++) {
        const uint32_t a = (uint32_t)(i / SIDE * (SIDE + 1) + i % SIDE), b = a + SIDE + 1;
        const uint32_t two[2][3] = {{a, a + 1, b}, {a + 1, b + 1, b}};
        memcpy(faces[2 * i], two, sizeof two);
    }
    for (int i = 0; i < RAYS; i++) {
        const float words[6] = {0.06f * (float)i, 0.055f * (float)i, 9, 0.01f, 0.02f, -1};
        memcpy(rays_words[i], words, sizeof words);
    }
    mesh = (splitplane_mesh){positions[0], 12, VERTICES, faces[0], 12, TRIANGLES};
    memset(&rays, 0, sizeof rays);
    rays.origins = rays_words[0], rays.directions = rays_words[0] + 3;
    rays.origin_stride = rays.direction_stride = sizeof rays_words[0];
    rays.count = RAYS;
}

static atomic_int releases;

static int32_t keep(void *user, const splitplane_scene_hit *hit) {
    (void)user;
    return hit->triangle % 2 == 0;
}

static void plane(void *user, uint32_t primitive, const float *ray, splitplane_show_hit show, void *to) {
    const splitplane_shape_hit hit = {-ray[2] / ray[6], 0, 0, 1};
    (void)user, (void)primitive;
    show(to, &hit);
}

static void released(void *user) {
    (void)user;
    atomic_fetch_add(&releases, 1);
}

static int32_t opaque(void *user, uint32_t triangle, float u, float v) {
    (void)user, (void)triangle;
    return u > v;
}

/* One of everything, asked and freed. */
static void live_once(splitplane_backend backend, unsigned round) {
    splitplane_hit hits[RAYS];
    splitplane_scene_hit scene_hits[RAYS];
    splitplane_neighbour nearest[RAYS * 2];
    splitplane_tree tree;
    splitplane_lists lists;
    shape(round);
    need("build", splitplane_tree_build(backend, &mesh, NULL, &tree));
    need("hits", splitplane_tree_closest_hits(tree, &rays, NULL, hits, sizeof hits[0], NULL));
    if (hits[50].triangle == SPLITPLANE_NONE) {
        fail("no hit", SPLITPLANE_STATUS_OK);
    }
    need("all hits", splitplane_tree_all_hits(tree, &rays, NULL, &lists, NULL));
    need("free lists", splitplane_lists_free(lists));
    expect("free twice", splitplane_lists_free(lists), SPLITPLANE_STATUS_HANDLE);
    if (round % 8 == 0) {
        const float box[6] = {1, 1, 0, 4, 4, 2}, radius = 0.25f;
        const splitplane_volumes volumes = {SPLITPLANE_VOLUME_KIND_BOX, 0, box, sizeof box, 1, NULL};
        const splitplane_bodies bodies = {&radius, 0, NULL, 0};
        splitplane_impact impacts[RAYS];
        need("overlaps", splitplane_tree_overlaps(tree, &volumes, NULL, &lists, NULL));
        need("free lists", splitplane_lists_free(lists));
        need("impacts", splitplane_tree_impacts(tree, &rays, &bodies, NULL, impacts, sizeof impacts[0], NULL));
        if (impacts[50].triangle == SPLITPLANE_NONE || impacts[50].t >= hits[50].t) {
            fail("no impact", SPLITPLANE_STATUS_OK);
        }
        const splitplane_instance instance = {{1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0}, 0, UINT32_MAX, 0, 0};
        splitplane_scene scene;
        splitplane_point_tree cloud;
        uint32_t name;
        need("rebuild", splitplane_tree_rebuild(tree, &mesh, NULL));
        need("scene", splitplane_scene_create(backend, &scene));
        need("geometry", splitplane_scene_add_geometry(scene, &mesh, &name));
        need("instance", splitplane_scene_add_instance(scene, &instance, &name));
        need("update", splitplane_scene_update(scene, NULL, NULL));
        need("scene hits", splitplane_scene_closest_hits(scene, &rays, NULL, scene_hits, sizeof scene_hits[0], NULL));
        need("scene overlaps", splitplane_scene_overlaps(scene, &volumes, NULL, &lists));
        need("free lists", splitplane_lists_free(lists));
        /* The same, built when rays reach it. */
        splitplane_scene lazy;
        need("lazy scene", splitplane_scene_create_lazy(backend, NULL, &lazy));
        need("geometry", splitplane_scene_add_geometry(lazy, &mesh, &name));
        need("instance", splitplane_scene_add_instance(lazy, &instance, &name));
        need("update", splitplane_scene_update(lazy, NULL, NULL));
        need("lazy hits", splitplane_scene_closest_hits(lazy, &rays, NULL, scene_hits, sizeof scene_hits[0], NULL));
        need("free lazy", splitplane_scene_free(lazy));
        /* The same with shapes, an opacity mask and a filter. */
        const float flat[6] = {-99, -99, 0, 99, 99, 0};
        const splitplane_shapes shapes = {SPLITPLANE_SHAPE_KIND_OWN, 0, flat, sizeof flat, 1, plane, NULL, released};
        splitplane_query_options filtered;
        need("options", splitplane_query_options_init(&filtered, sizeof filtered));
        filtered.filter = keep;
        need("opacity", splitplane_scene_make_opacity(scene, 0, 2, opaque, NULL));
        need("shapes", splitplane_scene_add_shapes(scene, &shapes, &name));
        splitplane_instance other = instance;
        other.geometry = name;
        need("instance", splitplane_scene_add_instance(scene, &other, &name));
        need("update", splitplane_scene_update(scene, NULL, NULL));
        need("filtered hits", splitplane_scene_closest_hits(scene, &rays, &filtered, scene_hits, sizeof scene_hits[0], NULL));
        if (scene_hits[0].triangle == SPLITPLANE_NONE || scene_hits[0].triangle % 2 != 0) {
            fail("the filter", SPLITPLANE_STATUS_OK);
        }
        const int before = atomic_load(&releases);
        need("free scene", splitplane_scene_free(scene));
        if (atomic_load(&releases) != before + 1) {
            fail("shapes are not released", SPLITPLANE_STATUS_OK);
        }
        need("cloud", splitplane_point_tree_build(backend, positions[0], 12, VERTICES, 3, 0, NULL, &cloud));
        need("nearest", splitplane_point_tree_nearest(cloud, rays_words[0], 24, RAYS, 2, NULL, nearest, sizeof nearest[0]));
        need("free cloud", splitplane_point_tree_free(cloud));
        /* What fails leaves nothing either. */
        splitplane_mesh bad = mesh;
        bad.position_count = 3;
        expect("bad mesh", splitplane_tree_build(backend, &bad, NULL, &tree), SPLITPLANE_STATUS_MESH);
    }
    if (!leaks || round % 10 != 0) {
        need("free tree", splitplane_tree_free(tree));
    }
}

/* Bytes that are allocated; 0 where allocations are not the C library's. */
static size_t held(void) {
#if defined(__GLIBC__) && (__GLIBC__ > 2 || __GLIBC_MINOR__ >= 33)
    const struct mallinfo2 info = mallinfo2();
    return info.uordblks + info.hblkhd;
#else
    return 0;
#endif
}

static splitplane_tree shared;
static atomic_int answered, busy, gone;

static void *ask(void *nothing) {
    splitplane_hit hits[RAYS];
    (void)nothing;
    for (;;) {
        const splitplane_status status = splitplane_tree_closest_hits(shared, &rays, NULL, hits, sizeof hits[0], NULL);
        switch (status) {
        case SPLITPLANE_STATUS_OK: atomic_fetch_add(&answered, 1); break;
        case SPLITPLANE_STATUS_BUSY: atomic_fetch_add(&busy, 1), sched_yield(); break;
        case SPLITPLANE_STATUS_HANDLE: atomic_fetch_add(&gone, 1); return NULL;
        default: fail("a thread", status);
        }
    }
}

/* Many threads ask a tree that is rebuilt and then freed under them: answers, BUSY and at last HANDLE, nothing else. */
static void threads(splitplane_backend backend) {
    pthread_t all[THREADS];
    need("build", splitplane_tree_build(backend, &mesh, NULL, &shared));
    for (int i = 0; i < THREADS; i++) {
        if (pthread_create(&all[i], NULL, ask, NULL) != 0) {
            exit(1);
        }
    }
    /* Neither side may keep the other out for ever: tries are counted, and after each the others have their turn. */
    for (int attempt = 0; attempt < 200; attempt++) {
        const int before = atomic_load(&answered);
        const splitplane_status status = splitplane_tree_rebuild(shared, &mesh, NULL);
        if (status != SPLITPLANE_STATUS_OK && status != SPLITPLANE_STATUS_BUSY) {
            fail("rebuild", status);
        }
        while (atomic_load(&answered) == before) {
            sched_yield();
        }
    }
    need("free", splitplane_tree_free(shared));
    for (int i = 0; i < THREADS; i++) {
        pthread_join(all[i], NULL);
    }
    if (atomic_load(&gone) != THREADS) {
        fail("threads", SPLITPLANE_STATUS_OK);
    }
}

static int calls_in_progress;

/* Uses the tree that is being rebuilt, and cancels the call the fifth time. */
static int32_t meddle(void *user, const char *stage, uint64_t done, uint64_t total) {
    const splitplane_tree tree = *(const splitplane_tree *)user;
    splitplane_hit hit;
    splitplane_rays one = rays;
    (void)stage, (void)done, (void)total;
    one.count = 1;
    expect("ask while rebuilt", splitplane_tree_closest_hits(tree, &one, NULL, &hit, sizeof hit, NULL), SPLITPLANE_STATUS_BUSY);
    expect("rebuild while rebuilt", splitplane_tree_rebuild(tree, &mesh, NULL), SPLITPLANE_STATUS_BUSY);
    return ++calls_in_progress == 5;
}

static void progress(splitplane_backend backend) {
    splitplane_tree tree;
    splitplane_build_options options;
    uint64_t before, after;
    need("options", splitplane_build_options_init(&options, sizeof options));
    need("build", splitplane_tree_build(backend, &mesh, NULL, &tree));
    need("digest", splitplane_tree_digest(tree, &before));
    options.progress = meddle;
    options.user = &tree;
    shape(3);
    expect("cancelled", splitplane_tree_rebuild(tree, &mesh, &options), SPLITPLANE_STATUS_CANCELLED);
    need("digest", splitplane_tree_digest(tree, &after));
    if (before != after) {
        fail("a cancelled rebuild changed the tree", SPLITPLANE_STATUS_OK);
    }
    need("free", splitplane_tree_free(tree));
}

int main(int count, char **words) {
    const unsigned rounds = count > 1 ? (unsigned)atoi(words[1]) : 10000;
    splitplane_backend backend;
    leaks = count > 2 && strcmp(words[2], "leak") == 0;
    fill();
    need("open", splitplane_backend_open("cpu", NULL, &backend));
    threads(backend);
    progress(backend);
    /* What is kept for the next build is there after some. */
    const unsigned warm = rounds / 10 + 8;
    for (unsigned round = 0; round < warm; round++) {
        live_once(backend, round);
    }
    const size_t before = held();
    for (unsigned round = 0; round < rounds; round++) {
        live_once(backend, round);
    }
    const size_t after = held();
    need("free backend", splitplane_backend_free(backend));
    const unsigned long long handles = (unsigned long long)splitplane_live_handles();
    printf("%u rounds: %llu handles left, %zu bytes before, %zu after; %d answers of threads, %d times busy\n", rounds, handles, before, after,
           atomic_load(&answered), atomic_load(&busy));
    /* Threads' own caches come and go. A leak of one small object a round would be far more. */
    const int grown = after > before + 32 * (size_t)rounds / 10 + (1 << 16);
    if (leaks) {
        /* Both counts see it; that of bytes where there is one. */
        return handles > 0 && (grown || before == 0) ? 1 : 2;
    }
    return handles == 0 && !grown ? 0 : 1;
}
