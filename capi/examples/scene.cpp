// Many objects, distances and points, with handles that free themselves. C++17.
//
//     c++ -std=c++17 scene.cpp $(pkg-config --cflags --libs splitplane) && ./a.out
#include <array>
#include <cmath>
#include <cstdio>
#include <splitplane.hpp>
#include <vector>

using point = std::array<float, 3>;

int main() try {
    // A cube of edge 2.
    std::vector<point> corners;
    for (int i = 0; i < 8; i++) {
        corners.push_back({float(i & 1) * 2, float(i >> 1 & 1) * 2, float(i >> 2 & 1) * 2});
    }
    const std::vector<std::array<uint32_t, 3>> faces = {{0, 2, 3}, {0, 3, 1}, {4, 5, 7}, {4, 7, 6}, {0, 1, 5}, {0, 5, 4},
                                                        {2, 6, 7}, {2, 7, 3}, {0, 4, 6}, {0, 6, 2}, {1, 3, 7}, {1, 7, 5}};
    splitplane_mesh mesh{};
    mesh.positions = corners[0].data();
    mesh.position_stride = sizeof(point);
    mesh.position_count = corners.size();
    mesh.indices = faces[0].data();
    mesh.index_stride = sizeof faces[0];
    mesh.triangle_count = faces.size();

    splitplane::backend backend;
    splitplane::check(splitplane_backend_open("cpu", nullptr, backend.put()));

    // A row of ten cubes, each with a bit of its own.
    splitplane::scene scene;
    splitplane::check(splitplane_scene_create(backend.get(), scene.put()));
    uint32_t cube, number;
    splitplane::check(splitplane_scene_add_geometry(scene.get(), &mesh, &cube));
    for (uint32_t i = 0; i < 10; i++) {
        const splitplane_instance instance{{1, 0, 0, 5.0f * float(i), 0, 1, 0, 0, 0, 0, 1, 0}, cube, 1u << i, 100 + i, SPLITPLANE_CULLING_NONE};
        splitplane::check(splitplane_scene_add_instance(scene.get(), &instance, &number));
    }
    splitplane::check(splitplane_scene_update(scene.get(), nullptr, nullptr));

    // One ray through all of them, once with the first three masked out.
    const float ray[6] = {-1, 1, 1, 1, 0, 0};
    splitplane_rays rays{};
    rays.origins = ray;
    rays.directions = ray + 3;
    rays.origin_stride = rays.direction_stride = sizeof ray;
    rays.count = 1;
    splitplane_scene_hit hit;
    auto options = splitplane::query_options();
    options.mask = ~7u;
    splitplane::check(splitplane_scene_closest_hits(scene.get(), &rays, &options, &hit, sizeof hit, nullptr));
    std::printf("instance %u at t = %g\n", hit.instance, double(hit.t));
    if (hit.instance != 3 || hit.t != 16) {
        return 1;
    }

    // The same, as if every odd instance were not there: a lambda that captures nothing is a function.
    options = splitplane::query_options();
    options.filter = [](void *, const splitplane_scene_hit *found) { return int32_t(found->instance % 2 == 0); };
    options.mask = ~7u;
    splitplane::check(splitplane_scene_closest_hits(scene.get(), &rays, &options, &hit, sizeof hit, nullptr));
    if (hit.instance != 4 || hit.t != 21) {
        return 1;
    }

    // All crossings: how many there are is known after the query.
    splitplane::lists lists;
    splitplane::check(splitplane_scene_all_hits(scene.get(), &rays, nullptr, lists.put(), nullptr));
    size_t list_count, record_count;
    splitplane::check(splitplane_lists_size(lists.get(), &list_count, &record_count));
    std::vector<splitplane_crossing> crossings(record_count);
    splitplane::check(splitplane_lists_crossings(lists.get(), crossings.data(), sizeof crossings[0], crossings.size()));
    std::printf("%zu crossings, the last at t = %g\n", record_count, double(crossings.back().t));
    if (record_count != 20) {
        return 1;
    }

    // The distance of points from one cube, and neighbours among its corners.
    splitplane::tree tree;
    splitplane::check(splitplane_tree_build(backend.get(), &mesh, nullptr, tree.put()));
    const std::vector<point> asked = {{1, 1, 1.75f}, {1, 1, 4}};
    std::vector<double> distances(asked.size());
    splitplane::check(splitplane_tree_signed_distances(tree.get(), asked[0].data(), sizeof(point), asked.size(), nullptr,
                                                       distances.data(), sizeof(double), nullptr));
    std::printf("distances %g and %g\n", distances[0], distances[1]);
    splitplane::point_tree cloud;
    splitplane::check(splitplane_point_tree_build(backend.get(), corners[0].data(), sizeof(point), corners.size(), 3, SPLITPLANE_POINT_AXES_WIDEST,
                                                  nullptr, cloud.put()));
    std::vector<splitplane_neighbour> nearest(2);
    splitplane::check(splitplane_point_tree_nearest(cloud.get(), asked[1].data(), sizeof(point), 1, 2, nullptr, nearest.data(), sizeof nearest[0]));
    std::printf("nearest corners %u and %u\n", nearest[0].point, nearest[1].point);
    if (distances[0] != -0.25 || distances[1] != 2 || nearest[0].point != 4 || nearest[1].point != 5) {
        return 1;
    }

    // What goes wrong is an exception.
    mesh.position_stride = 0;
    try {
        splitplane::check(splitplane_tree_build(backend.get(), &mesh, nullptr, tree.put()));
        return 1;
    } catch (const splitplane::error &error) {
        std::printf("status %d: %s\n", int(error.status()), error.what());
        return error.status() == SPLITPLANE_STATUS_STRIDE ? 0 : 1;
    }
} catch (const std::exception &error) {
    std::fprintf(stderr, "scene: %s\n", error.what());
    return 1;
}
