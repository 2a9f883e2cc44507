"""The class of Open3D's shape: keys, dtypes, shapes, and, where Open3D is installed, its answers."""

from __future__ import annotations

import numpy as np
import pytest
from brute import hits_brute, sphere

import splitplane
from splitplane.open3d import RaycastingScene

BALL = sphere(20, 14)


def scene_of(cls: type, wrap: object = np.asarray) -> object:
    scene = cls()
    for place in (0.0, 3.0):
        scene.add_triangles(wrap(BALL[0] + np.float32(place)), wrap(BALL[1]))  # type: ignore[operator]
    return scene


def rays_at(count: int) -> np.ndarray:
    rng = np.random.default_rng(9)
    origins, targets = rng.normal(size=(count, 3)) * 5, rng.uniform(-1, 4, size=(count, 3))
    return np.concatenate([origins, targets - origins], axis=1).astype(np.float32)


def test_keys_dtypes_and_shapes() -> None:
    scene = scene_of(RaycastingScene)
    rays = rays_at(24).reshape(2, 3, 4, 6)
    cast = scene.cast_rays(rays)
    kinds = {"t_hit": ("float32", ()), "geometry_ids": ("uint32", ()), "primitive_ids": ("uint32", ()),
             "primitive_uvs": ("float32", (2,)), "primitive_normals": ("float32", (3,))}  # fmt: skip
    assert {key: (str(one.dtype), one.shape[3:]) for key, one in cast.items()} == kinds
    found = scene.list_intersections(rays)
    dtypes = {"ray_splits": "uint32", "ray_ids": "uint32", "t_hit": "float32", "geometry_ids": "uint32",
              "primitive_ids": "uint32", "primitive_uvs": "float32"}  # fmt: skip
    assert {key: str(one.dtype) for key, one in found.items()} == dtypes
    assert found["ray_splits"].shape == (25,) and scene.count_intersections(rays).dtype == np.int32
    assert scene.test_occlusions(rays).dtype == np.bool_
    points = rays[..., :3]
    for name in ("compute_distance", "compute_signed_distance", "compute_occupancy"):
        answer = getattr(scene, name)(points)
        assert answer.dtype == np.float32 and answer.shape == (2, 3, 4)
    assert scene.compute_closest_points(points)["points"].shape == (2, 3, 4, 3)


def test_hits_of_several_meshes() -> None:
    scene, rays = scene_of(RaycastingScene), rays_at(400)
    vertices = np.concatenate([BALL[0], BALL[0] + np.float32(3)])
    faces = np.concatenate([BALL[1], BALL[1] + len(BALL[0])])
    t, triangle, count = hits_brute(vertices, faces, rays)
    cast = scene.cast_rays(rays)
    clear = np.isfinite(t)
    np.testing.assert_array_equal(np.isfinite(cast["t_hit"]), clear)
    whole = cast["geometry_ids"].astype(int) * len(BALL[1]) + cast["primitive_ids"]
    assert (whole[clear] == triangle[clear]).mean() > 0.98
    assert (cast["geometry_ids"][~clear] == RaycastingScene.INVALID_ID).all() and RaycastingScene.INVALID_ID == 4294967295
    assert (cast["primitive_normals"][~clear] == 0).all()
    np.testing.assert_allclose(np.linalg.norm(cast["primitive_normals"][clear], axis=1), 1, rtol=1e-5)
    np.testing.assert_array_equal(scene.count_intersections(rays), count)
    assert not scene.test_occlusions(rays, tfar=0.0).any()
    late = scene.add_triangles(BALL[0] - np.float32(9), BALL[1])
    assert late == 2 and scene.cast_rays(np.array([[-9, -9, 0, 0, 0, -1]], np.float32))["geometry_ids"][0] == 2


@pytest.mark.parametrize("meshes", [1, 3])
@pytest.mark.parametrize("count", [0, 1, 16, 17, 4096, 9000])
@pytest.mark.parametrize("preset", ["fast", "best"])
def test_columns_are_the_trees(meshes: int, count: int, preset: str) -> None:
    """However many rays there are, and however the tree is built, columns say what hits of the tree say."""
    scene = RaycastingScene(preset=preset)
    for place in range(meshes):
        scene.add_triangles(BALL[0] + np.float32(2.5 * place), BALL[1])
    corners = np.concatenate([(BALL[0] + np.float32(2.5 * place))[BALL[1]] for place in range(meshes)])
    rays = rays_at(count)
    hits = splitplane.Tree.build(corners).closest_hits(rays)
    face = hits.triangle.astype(np.int64)
    miss = ~hits.hit
    ids, faces = face // len(BALL[1]), face % len(BALL[1])
    ids[miss] = faces[miss] = RaycastingScene.INVALID_ID
    corners = corners.astype(np.float64)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    for threads in (0, 1, 2):
        cast = scene.cast_rays(rays, nthreads=threads)
        np.testing.assert_array_equal(cast["t_hit"], hits.t)
        np.testing.assert_array_equal(cast["geometry_ids"], ids)
        np.testing.assert_array_equal(cast["primitive_ids"], faces)
        np.testing.assert_array_equal(cast["primitive_uvs"], np.stack([hits.u, hits.v], axis=1))
        np.testing.assert_allclose(cast["primitive_normals"][~miss], normals[face[~miss]], atol=1e-6)
        assert not cast["primitive_normals"][miss].any()
        assert all(one.flags.c_contiguous and one.flags.writeable for one in cast.values())
    assert count < 100 or 0 < miss.sum() < count


class Mesh:
    """A mesh as Open3D has it."""

    def __init__(self) -> None:
        self.vertex = type("Vertex", (), {"positions": BALL[0]})
        self.triangle = type("Triangle", (), {"indices": BALL[1]})


def test_meshes_and_no_rays() -> None:
    scene = RaycastingScene()
    assert scene.add_triangles(mesh=Mesh()) == 0
    assert scene.add_triangles(vertex_positions=BALL[0], triangle_indices=BALL[1]) == 1
    listed = scene.list_intersections(rays_at(3)[:0])
    assert listed["ray_splits"].tolist() == [0] and len(listed["ray_ids"]) == 0
    for wrong in ({}, {"mesh": Mesh(), "triangle_indices": BALL[1]}, {"mesh": Mesh(), "vertex_positions": BALL[0]}):
        with pytest.raises(TypeError):
            scene.add_triangles(**wrong)


def test_misuses() -> None:
    scene = RaycastingScene()
    assert np.isinf(scene.cast_rays(rays_at(3))["t_hit"]).all()
    wrong = [
        lambda: scene.add_triangles(BALL[0].astype(float), BALL[1]),
        lambda: scene.add_triangles(BALL[0], BALL[1].astype(int)),
        lambda: scene.add_triangles(BALL[0][:5], BALL[1]),
        lambda: scene.add_triangles(object()),
        lambda: scene.cast_rays(rays_at(3).astype(float)),
        lambda: scene.cast_rays(rays_at(1)[0]),
        lambda: scene.cast_rays(rays_at(3)[:, :5]),
        lambda: scene.cast_rays(rays_at(3), nthreads=-1),
        lambda: scene.compute_occupancy(rays_at(3)[:, :3], nsamples=2),
        lambda: RaycastingScene(device="CUDA:0"),
        lambda: RaycastingScene(preset="fastest"),
        lambda: RaycastingScene.create_rays_pinhole(np.zeros((3, 3)), np.eye(4), 4, 4),
        lambda: RaycastingScene.create_rays_pinhole(90, [0, 0, 0], [0, 0, 0], [0, 1, 0], 4, 4),
    ]
    for number, do in enumerate(wrong):
        with pytest.raises(splitplane.SplitplaneError):
            do()
            pytest.fail(f"number {number} was answered")


def test_pinhole_rays() -> None:
    rays = RaycastingScene.create_rays_pinhole(90, [0, 0, 0], [0, 0, 5], [0, 1, 0], 4, 2)
    assert rays.shape == (2, 4, 6) and rays.dtype == np.float32
    np.testing.assert_allclose(rays[..., :3], np.broadcast_to([0, 0, 5], (2, 4, 3)), atol=1e-6)
    # Open3D's choice: right to left, bottom to top.
    assert (np.diff(rays[..., 3], axis=1) < 0).all() and (np.diff(rays[..., 4], axis=0) > 0).all()
    assert (rays[..., 5] < 0).all()


def test_answers_are_open3ds() -> None:
    open3d = pytest.importorskip("open3d", reason="open3d is not installed; scripts/upstream.py needs it too")
    tensor = open3d.core.Tensor.from_numpy
    mine, theirs = scene_of(RaycastingScene), scene_of(open3d.t.geometry.RaycastingScene, tensor)
    rays = rays_at(3000)
    for name in ("cast_rays", "list_intersections", "count_intersections", "test_occlusions"):
        own, other = getattr(mine, name)(rays), getattr(theirs, name)(tensor(rays))
        if name in ("count_intersections", "test_occlusions"):
            assert own.dtype == other.numpy().dtype
            np.testing.assert_array_equal(own, other.numpy())
            continue
        assert set(own) == set(other.keys())
        for key in own:
            assert own[key].dtype == other[key].numpy().dtype, key
            if own[key].dtype == np.float32:
                np.testing.assert_allclose(own[key], other[key].numpy(), atol=1e-4, err_msg=key)
    points = np.ascontiguousarray(rays[:, :3])
    for name in ("compute_distance", "compute_signed_distance", "compute_occupancy"):
        np.testing.assert_allclose(getattr(mine, name)(points), getattr(theirs, name)(tensor(points)).numpy(), atol=1e-5)
    arguments = (60.0, [0, 0, 0], [3, 4, 5], [0, 1, 0], 7, 5)
    other = open3d.t.geometry.RaycastingScene.create_rays_pinhole(*arguments).numpy()
    np.testing.assert_allclose(RaycastingScene.create_rays_pinhole(*arguments), other, atol=1e-5)
