// Handles that free themselves, and failures as exceptions, over splitplane.h. C++17. Calls are those of C: `splitplane::check(splitplane_tree_...(tree.get(), ...))`.
#ifndef SPLITPLANE_HPP
#define SPLITPLANE_HPP

#include "splitplane.h"

#include <stdexcept>
#include <utility>

namespace splitplane {

// A call that failed: its status, and the library's text.
class error : public std::runtime_error {
public:
    explicit error(splitplane_status status) : std::runtime_error(splitplane_last_message()), status_(status) {}
    splitplane_status status() const noexcept { return status_; }

private:
    splitplane_status status_;
};

// Throws where a call failed.
inline void check(splitplane_status status) {
    if (status != SPLITPLANE_STATUS_OK) {
        throw error(status);
    }
}

// Owns a handle.
template <class Handle, splitplane_status (*Free)(Handle)>
class owner {
public:
    owner() noexcept = default;
    explicit owner(Handle handle) noexcept : handle_(handle) {}
    owner(owner &&other) noexcept : handle_(std::exchange(other.handle_, Handle{})) {}
    owner &operator=(owner &&other) noexcept {
        std::swap(handle_, other.handle_);
        return *this;
    }
    owner(const owner &) = delete;
    owner &operator=(const owner &) = delete;
    ~owner() { Free(handle_); }

    Handle get() const noexcept { return handle_; }
    // Where a call is to put a new handle; frees the old one.
    Handle *put() noexcept {
        Free(std::exchange(handle_, Handle{}));
        return &handle_;
    }

private:
    Handle handle_{};
};

using backend = owner<splitplane_backend, splitplane_backend_free>;
using tree = owner<splitplane_tree, splitplane_tree_free>;
using scene = owner<splitplane_scene, splitplane_scene_free>;
using point_tree = owner<splitplane_point_tree, splitplane_point_tree_free>;
using lists = owner<splitplane_lists, splitplane_lists_free>;

// Settings, with their defaults.
inline splitplane_build_options build_options() {
    splitplane_build_options options;
    check(splitplane_build_options_init(&options, sizeof options));
    return options;
}
inline splitplane_query_options query_options() {
    splitplane_query_options options;
    check(splitplane_query_options_init(&options, sizeof options));
    return options;
}

} // namespace splitplane

#endif // SPLITPLANE_HPP
