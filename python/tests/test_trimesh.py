"""The classes of trimesh's shape, beside trimesh's own."""

from __future__ import annotations

import copy
import pickle

import numpy as np
import pytest

trimesh = pytest.importorskip("trimesh", reason="trimesh is not installed")
pytest.importorskip("scipy", reason="scipy is not installed")
pytest.importorskip("rtree", reason="rtree is not installed")

import splitplane  # noqa: E402
import splitplane.trimesh as ours  # noqa: E402
from trimesh.proximity import ProximityQuery  # noqa: E402
from trimesh.ray.ray_triangle import RayMeshIntersector  # noqa: E402


@pytest.fixture(scope="module", params=[0.0, 1e6])
def mesh(request: pytest.FixtureRequest) -> "trimesh.Trimesh":
    mesh = trimesh.creation.torus(2.0, 0.7, major_sections=24, minor_sections=12)
    mesh.apply_translation([request.param, 0, 0])
    return mesh


@pytest.fixture(scope="module")
def rays(mesh: "trimesh.Trimesh") -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(3)
    origins = rng.normal(size=(300, 3)) * 4
    directions = rng.normal(size=(300, 3)) * [2, 2, 0.5] - origins
    return origins + mesh.centroid, directions


def test_rays_are_answered_alike(mesh: "trimesh.Trimesh", rays: tuple[np.ndarray, np.ndarray]) -> None:
    mine, theirs = ours.RayMeshIntersector(mesh), RayMeshIntersector(mesh)
    np.testing.assert_array_equal(mine.intersects_any(*rays), theirs.intersects_any(*rays))
    first, other = mine.intersects_first(*rays), theirs.intersects_first(*rays)
    assert first.dtype == np.int64 and first.shape == other.shape
    np.testing.assert_array_equal(first == -1, other == -1)
    assert (first == other).mean() > 0.99 and 20 < (other >= 0).sum() < 280
    for several in (True, False):
        places, ray, face = mine.intersects_location(*rays, multiple_hits=several)
        expected, of_ray, of_face = theirs.intersects_location(*rays, multiple_hits=several)
        assert places.dtype == expected.dtype and ray.dtype == face.dtype == np.int64
        assert sorted(zip(ray, face)) == sorted(zip(of_ray, of_face))
        order, theirs_order = np.lexsort((face, ray)), np.lexsort((of_face, of_ray))
        np.testing.assert_allclose(places[order], expected[theirs_order], atol=1e-6)
    faces, ray = mine.intersects_id(*rays)
    _, of_first = mine.intersects_id(*rays, multiple_hits=False)
    assert ray[: len(of_first)].tolist() == of_first.tolist() == sorted(of_first)
    assert len(mine.intersects_id(*rays, max_hits=1)[0]) == len(of_first) < len(faces)
    assert mine.intersects_id(*(one[:0] for one in rays), return_locations=True)[2].shape == (0, 3)
    with pytest.raises(ValueError, match="match"):
        mine.intersects_any(rays[0], rays[1][:5])


def test_rays_are_made_as_numpy_makes_them(mesh: "trimesh.Trimesh") -> None:
    """Rows of many rays: relative to the middle in float64, directions of length 1, whatever the numbers and their layout."""
    rng = np.random.default_rng(5)
    origins, directions = rng.normal(size=(20_000, 3)) * 4 + mesh.centroid, rng.normal(size=(20_000, 3)) * 10.0 ** rng.uniform(-9, 9, (20_000, 1))
    directions[:4] = [[0, 0, 0], [np.nan, 0, 1], [np.inf, 0, 0], [1e-300, 0, 0]]
    origins[4:6] = [[np.nan, 0, 0], [-np.inf, 0, 0]]
    shift = ours.tree_of(mesh).origin
    with np.errstate(invalid="ignore"):
        length = np.sqrt((directions**2).sum(axis=1))
        unit = directions / np.where(length > 0, length, 1)[:, None]
    for threads in (None, 1, 2):
        for given in ((origins, directions), (np.asfortranarray(origins), directions[:, ::-1].copy()[:, ::-1]), (origins.tolist(), directions.tolist())):
            rows = ours.RayMeshIntersector(mesh)._rays(*given, threads=threads)[2].rows
            assert rows[:, :3].tobytes() == (origins - shift).astype(np.float32).tobytes()
            np.testing.assert_allclose(rows[:, 3:], unit.astype(np.float32), rtol=2e-7)
    first = ours.RayMeshIntersector(mesh).intersects_first(origins, directions)
    assert (first[:6] == -1).all() and (first >= 0).sum() > 1000
    for place in (0, 19_999):
        far = origins.copy()
        far[place, 1] = 1e39
        with pytest.raises(splitplane.RangeError, match="beyond the greatest float32"):
            ours.RayMeshIntersector(mesh).intersects_any(far, directions)


def test_points_are_answered_alike(mesh: "trimesh.Trimesh") -> None:
    points = np.random.default_rng(4).uniform(-3, 3, size=(200, 3)) + mesh.centroid
    mine, theirs = ours.ProximityQuery(mesh), ProximityQuery(mesh)
    places, distance, face = mine.on_surface(points)
    expected, far, of_face = theirs.on_surface(points)
    assert face.dtype == np.int64
    np.testing.assert_allclose(distance, far, atol=1e-9)
    np.testing.assert_allclose(places, expected, atol=1e-6)
    assert (face == of_face).mean() > 0.9
    # Where it is another one, ours faces the point as squarely: theirs looks at two candidates only.
    square = [((points - places) * mesh.face_normals[one]).sum(axis=1) for one in (face, of_face)]
    assert (square[0] >= square[1] - 1e-9).all()
    np.testing.assert_allclose(mine.signed_distance(points), theirs.signed_distance(points), atol=1e-9)
    distance, vertex = mine.vertex(points)
    np.testing.assert_allclose(distance, theirs.vertex(points)[0], atol=1e-9)
    assert vertex.dtype == np.int64 and (vertex == theirs.vertex(points)[1]).mean() > 0.99
    assert mine.vertex(points[0])[1] == vertex[0]
    np.testing.assert_array_equal(
        ours.RayMeshIntersector(mesh).contains_points(points), RayMeshIntersector(mesh).contains_points(points)
    )


def test_vertices_are_hit() -> None:
    ball = trimesh.creation.icosphere(4)
    origins = ball.vertices * 3
    hits = ours.RayMeshIntersector(ball).intersects_first(origins, -origins)
    assert (hits >= 0).all()
    _, ray, _ = ours.RayMeshIntersector(ball).intersects_location(ball.vertices * 0, ball.vertices)
    assert np.bincount(ray, minlength=len(origins)).tolist() == [1] * len(origins)


def test_meshes_that_change_and_copies() -> None:
    box = ours.use(trimesh.creation.box())
    assert isinstance(box.ray, ours.RayMeshIntersector) and isinstance(box.nearest, ours.ProximityQuery)
    assert box.contains([[0.4, 0, 0]])[0] and not box.contains([[0.6, 0, 0]])[0]
    tree = ours.tree_of(box)
    assert ours.tree_of(box) is tree
    box.apply_scale(2)
    assert ours.tree_of(box) is not tree and box.contains([[0.6, 0, 0]])[0]
    for other in (copy.copy(box.ray), copy.deepcopy(box.ray), pickle.loads(pickle.dumps(box.ray))):
        assert other.intersects_any([[0, 0, 5]], [[0, 0, -1]]).all()
