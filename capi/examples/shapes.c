/* Shapes of your own, a filter of hits, and an opacity mask. C11.
 *
 *     cc -std=c11 shapes.c $(pkg-config --cflags --libs splitplane) -lm && ./a.out
 */
#include <math.h>
#include <splitplane.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static void check(splitplane_status status) {
    if (status != SPLITPLANE_STATUS_OK) {
        fprintf(stderr, "shapes: status %d: %s\n", (int)status, splitplane_last_message());
        exit(1);
    }
}

/* Discs across z: a centre and a radius. */
struct disc {
    float centre[3], radius;
};

struct discs {
    const struct disc *all;
    int released;
};

/* Where a ray meets a disc. It may be called by several threads at a time, so it writes nothing of its own. */
static void intersect(void *user, uint32_t primitive, const float *ray, splitplane_show_hit show, void *to) {
    const struct disc *disc = &((const struct discs *)user)->all[primitive];
    const float *origin = ray, *direction = ray + 4;
    const float t = (disc->centre[2] - origin[2]) / direction[2];
    const float x = origin[0] + t * direction[0] - disc->centre[0], y = origin[1] + t * direction[1] - disc->centre[1];
    if (x * x + y * y <= disc->radius * disc->radius) {
        /* u and v are yours: here the place in the disc. */
        const splitplane_shape_hit hit = {t, x, y, direction[2] < 0};
        show(to, &hit);
    }
}

static void release(void *user) { ((struct discs *)user)->released++; }

/* Keeps what is nearer to the ray's origin than `user`. */
static int32_t is_near(void *user, const splitplane_scene_hit *hit) { return hit->t < *(const float *)user; }

/* A triangle with a hole at its first corner. */
static int32_t is_opaque(void *user, uint32_t triangle, float u, float v) {
    (void)user, (void)triangle;
    return u + v > 0.5f;
}

int main(void) {
    splitplane_backend backend;
    splitplane_scene scene;
    check(splitplane_backend_open("cpu", NULL, &backend));
    check(splitplane_scene_create(backend, &scene));

    /* Three discs above one another, with the boxes that they are in. */
    const struct disc all[] = {{{0, 0, 3}, 1}, {{0, 0, 2}, 2}, {{0, 0, 1}, 3}};
    struct discs discs = {all, 0};
    float boxes[3][6];
    for (int i = 0; i < 3; i++) {
        for (int axis = 0; axis < 3; axis++) {
            const float reach = axis < 2 ? all[i].radius : 0;
            boxes[i][axis] = all[i].centre[axis] - reach;
            boxes[i][3 + axis] = all[i].centre[axis] + reach;
        }
    }
    splitplane_shapes shapes;
    memset(&shapes, 0, sizeof shapes);
    shapes.kind = SPLITPLANE_SHAPE_KIND_OWN;
    shapes.numbers = boxes[0];
    shapes.stride = sizeof boxes[0];
    shapes.count = 3;
    shapes.intersect = intersect;
    shapes.user = &discs;
    shapes.release = release;
    uint32_t geometry, number;
    check(splitplane_scene_add_shapes(scene, &shapes, &geometry));
    splitplane_instance instance = {{1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0}, geometry, UINT32_MAX, 0, SPLITPLANE_CULLING_NONE};
    check(splitplane_scene_add_instance(scene, &instance, &number));

    /* A triangle below them, with a hole. */
    const float corners[3][3] = {{0, 0, 0}, {8, 0, 0}, {0, 8, 0}};
    splitplane_mesh mesh;
    memset(&mesh, 0, sizeof mesh);
    mesh.positions = corners[0];
    mesh.position_stride = sizeof corners[0];
    mesh.position_count = 3;
    mesh.triangle_count = 1;
    check(splitplane_scene_add_geometry(scene, &mesh, &instance.geometry));
    check(splitplane_scene_add_instance(scene, &instance, &number));
    check(splitplane_scene_make_opacity(scene, instance.geometry, 4, is_opaque, NULL));
    check(splitplane_scene_update(scene, NULL, NULL));

    /* Rays down: onto each disc, through the hole and onto the triangle. */
    const float words[5][6] = {{0.5f, 0, 9, 0, 0, -1}, {1.5f, 0, 9, 0, 0, -1}, {2.5f, 0, 9, 0, 0, -1}, {3.2f, 0.3f, 9, 0, 0, -1}, {5, 2, 9, 0, 0, -1}};
    splitplane_rays rays;
    memset(&rays, 0, sizeof rays);
    rays.origins = words[0];
    rays.directions = words[0] + 3;
    rays.origin_stride = rays.direction_stride = sizeof words[0];
    rays.count = 5;
    splitplane_scene_hit hits[5];
    check(splitplane_scene_closest_hits(scene, &rays, NULL, hits, sizeof hits[0], NULL));
    const uint32_t expected[5] = {0, 1, 2, SPLITPLANE_NONE, 0};
    for (int i = 0; i < 5; i++) {
        printf("ray %d: instance %d, primitive %d, t = %g\n", i, (int)hits[i].instance, (int)hits[i].triangle, (double)hits[i].t);
        if (hits[i].triangle != expected[i]) {
            return 1;
        }
    }

    /* Only what is nearer than 7.5: the first two discs. */
    float nearer = 7.5f;
    splitplane_query_options options;
    check(splitplane_query_options_init(&options, sizeof options));
    options.filter = is_near;
    options.filter_user = &nearer;
    uint64_t counts[5];
    check(splitplane_scene_count_hits(scene, &rays, &options, counts, sizeof counts[0], NULL));
    printf("nearer than %g: %d, %d, %d\n", (double)nearer, (int)counts[0], (int)counts[1], (int)counts[2]);
    if (counts[0] != 2 || counts[1] != 1 || counts[2] != 0) {
        return 1;
    }

    check(splitplane_scene_free(scene));
    check(splitplane_backend_free(backend));
    return discs.released == 1 ? 0 : 1;
}
