/* A picture of a square pyramid and the ground below it, in characters: one ray each, and a shadow ray from each hit. C11.
 *
 *     cc -std=c11 picture.c $(pkg-config --cflags --libs splitplane) -lm && ./a.out
 */
#include <math.h>
#include <splitplane.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { WIDTH = 64, HEIGHT = 24, RAYS = WIDTH * HEIGHT };

/* A vertex as a program may have it: positions are read from among the rest. */
struct vertex {
    float position[3];
    unsigned char color[4];
};

/* Records of eight floats are what the library reads where they lie. */
struct ray {
    float origin[3], t_min, direction[3], t_max;
};

static void check(splitplane_status status) {
    if (status != SPLITPLANE_STATUS_OK) {
        fprintf(stderr, "picture: status %d: %s\n", (int)status, splitplane_last_message());
        exit(1);
    }
}

/* Ends nothing, and remembers the last stage. */
static int32_t note(void *user, const char *stage, uint64_t done, uint64_t total) {
    (void)done, (void)total;
    *(const char **)user = stage;
    return 0;
}

static splitplane_rays rays_of(const struct ray *rays) {
    splitplane_rays view = {0};
    view.origins = rays->origin;
    view.t_min = &rays->t_min;
    view.directions = rays->direction;
    view.t_max = &rays->t_max;
    view.origin_stride = view.t_min_stride = view.direction_stride = view.t_max_stride = sizeof *rays;
    view.count = RAYS;
    return view;
}

int main(void) {
    if (strcmp(splitplane_version(), SPLITPLANE_VERSION) != 0) {
        fprintf(stderr, "picture: header and library differ in version\n");
        return 1;
    }
    const struct vertex vertices[] = {
        {{-9, -9, 0}, {0}}, {{9, -9, 0}, {0}}, {{9, 9, 0}, {0}}, {{-9, 9, 0}, {0}}, {{-2, -2, 0}, {0}},
        {{2, -2, 0}, {0}},  {{2, 2, 0}, {0}},  {{-2, 2, 0}, {0}}, {{0, 0, 3}, {0}},
    };
    const uint32_t triangles[][3] = {{0, 1, 2}, {0, 2, 3}, {4, 5, 8}, {5, 6, 8}, {6, 7, 8}, {7, 4, 8}};
    splitplane_mesh mesh = {0};
    mesh.positions = vertices[0].position;
    mesh.position_stride = sizeof vertices[0];
    mesh.position_count = sizeof vertices / sizeof vertices[0];
    mesh.indices = triangles[0];
    mesh.index_stride = sizeof triangles[0];
    mesh.triangle_count = sizeof triangles / sizeof triangles[0];

    splitplane_backend backend;
    check(splitplane_backend_open("cpu", NULL, &backend));
    const char *stage = "nothing";
    splitplane_build_options build;
    check(splitplane_build_options_init(&build, sizeof build));
    build.preset = SPLITPLANE_PRESET_BALANCED;
    build.progress = note;
    build.user = &stage;
    splitplane_tree tree;
    check(splitplane_tree_build(backend, &mesh, &build, &tree));
    check(splitplane_backend_free(backend));
    uint64_t digest;
    check(splitplane_tree_digest(tree, &digest));
    printf("tree %016llx, last stage: %s\n", (unsigned long long)digest, stage);

    /* One ray for each character, from the eye. */
    struct ray *rays = malloc(2 * RAYS * sizeof *rays), *shadows = rays + RAYS;
    splitplane_hit *hits = malloc(RAYS * sizeof *hits);
    uint8_t *occluded = malloc(RAYS);
    if (!rays || !hits || !occluded) {
        return 1;
    }
    for (int i = 0; i < RAYS; i++) {
        const float x = (float)(i % WIDTH) / WIDTH - 0.5f, z = 0.5f - (float)(i / WIDTH) / HEIGHT;
        rays[i] = (struct ray){{0.4f, -12, 5}, 0, {x, 1, z * 0.8f - 0.36f}, INFINITY};
    }
    splitplane_rays view = rays_of(rays);
    splitplane_query_options exact;
    check(splitplane_query_options_init(&exact, sizeof exact));
    exact.accuracy = SPLITPLANE_ACCURACY_EXACT;
    check(splitplane_tree_closest_hits(tree, &view, &exact, hits, sizeof *hits, NULL));

    /* From each hit towards the sun. Where nothing was hit the ray has no direction, which is no mistake: it hits nothing. */
    for (int i = 0; i < RAYS; i++) {
        struct ray *shadow = &shadows[i];
        memset(shadow, 0, sizeof *shadow);
        if (hits[i].triangle != SPLITPLANE_NONE) {
            for (int axis = 0; axis < 3; axis++) {
                shadow->origin[axis] = rays[i].origin[axis] + hits[i].t * rays[i].direction[axis];
            }
            *shadow = (struct ray){{shadow->origin[0], shadow->origin[1], shadow->origin[2]}, 1e-3f, {-1, -0.6f, 0.9f}, INFINITY};
        }
    }
    view = rays_of(shadows);
    check(splitplane_tree_any_hits(tree, &view, NULL, occluded, 1, NULL));
    for (int i = 0; i < RAYS; i++) {
        const uint32_t triangle = hits[i].triangle;
        putchar(triangle == SPLITPLANE_NONE ? ' ' : occluded[i] ? '#' : triangle < 2 ? '.' : (int)"+-*o"[triangle - 2]);
        if (i % WIDTH == WIDTH - 1) {
            putchar('\n');
        }
    }
    check(splitplane_tree_free(tree));
    free(occluded);
    free(hits);
    free(rays);
    return splitplane_live_handles() == 0 ? 0 : 1;
}
