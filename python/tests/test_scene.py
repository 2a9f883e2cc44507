"""Scenes against trees of the same triangles in the world."""

from __future__ import annotations

import pickle
from pathlib import Path

import numpy as np
import pytest
from brute import closest_brute, hits_brute, sphere

import splitplane
from splitplane import MISS, Scene, Tree

VERTICES, FACES = sphere(10, 7)
PLACES = np.array([[0, 0, 0], [3, 0, 0], [0, 3, 0], [0, 0, 3.0]], np.float32)


def placed(place: np.ndarray, scale: float = 1.0) -> np.ndarray:
    transform = np.eye(4)
    transform[:3, :3] *= scale
    transform[:3, 3] = place
    return transform


@pytest.fixture()
def scene() -> Scene:
    scene = Scene()
    ball = scene.add_geometry(VERTICES, FACES)
    for number, place in enumerate(PLACES):
        scene.add_instance(ball, placed(place), mask=1 << number, id=100 + number)
    assert scene.stale
    report = scene.update()
    assert report["geometries_built"] == 1 and report["instances_changed"] == 4
    return scene


def world(places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    vertices = np.concatenate([VERTICES + place for place in places])
    faces = np.concatenate([FACES + len(VERTICES) * i for i in range(len(places))])
    return vertices, faces


def rays_at(count: int) -> np.ndarray:
    rng = np.random.default_rng(7)
    origins, targets = rng.normal(size=(count, 3)) * 6, rng.uniform(-1, 4, size=(count, 3))
    return np.concatenate([origins, targets - origins], axis=1).astype(np.float32)


def test_hits_are_those_of_the_world(scene: Scene) -> None:
    rays = rays_at(600)
    t, _, count = hits_brute(*world(PLACES), rays)
    hits = scene.closest_hits(rays.reshape(20, 30, 6))
    assert hits.t.shape == (20, 30)
    np.testing.assert_array_equal(hits.hit.reshape(-1), np.isfinite(t))
    clear = np.isfinite(t)
    assert 100 < clear.sum() < 600
    np.testing.assert_allclose(hits.t.reshape(-1)[clear], t[clear], rtol=1e-4)
    assert set(np.unique(hits.instance)) == {0, 1, 2, 3, MISS} and set(np.unique(hits.geometry)) == {0, MISS}
    np.testing.assert_array_equal(scene.any_hits(rays), clear)
    np.testing.assert_array_equal(scene.count_hits(rays), count)
    found = scene.all_hits(rays)
    starts_inside = Tree.build(*world(PLACES)).contains(rays[:, :3]).sum()
    assert len(found.t) == count.sum() == len(found.instance)
    assert 2 * found.front.sum() + starts_inside == count.sum()
    for ray in range(600):
        assert (np.diff(found.t[found.of(ray)]) >= 0).all()


def test_points_are_those_of_the_world(scene: Scene) -> None:
    points = np.random.default_rng(5).uniform(-2, 5, size=(200, 3)).astype(np.float32)
    distance = closest_brute(*world(PLACES), points)
    found = scene.closest_points(points)
    np.testing.assert_allclose(found.distance, distance, rtol=1e-6, atol=1e-6)
    nearest = ((points[:, None] - PLACES) ** 2).sum(axis=2).argmin(axis=1)
    assert (found.instance == nearest).mean() > 0.97
    inside = scene.contains(points)
    np.testing.assert_array_equal(inside, Tree.build(*world(PLACES)).contains(points))
    np.testing.assert_array_equal(scene.signed_distance(points) < 0, inside)
    only = scene.closest_points(points, mask=2)
    assert (only.instance == 1).all() and (only.distance >= found.distance).all()


def test_masks_and_ignored_triangles(scene: Scene) -> None:
    rays = rays_at(200)
    for number in range(4):
        hits = scene.closest_hits(rays, mask=1 << number)
        assert set(np.unique(hits.instance[hits.hit])) <= {number}
    assert not scene.any_hits(rays, mask=16).any()
    scene.set_mask(0, 16)
    scene.update()
    assert (scene.closest_hits(rays, mask=16).instance[scene.any_hits(rays, mask=16)] == 0).all()
    ray = np.array([0.05, 0.07, 9, 0, 0, -1], np.float32)
    first = scene.closest_hits(ray)
    other = scene.closest_hits(ray, ignore=(int(first.instance), int(first.triangle)))
    assert other.t > first.t


def test_edits_are_made_by_update(scene: Scene) -> None:
    ray = np.array([3.02, 0.03, 9, 0, 0, -1], np.float32)
    before = scene.closest_hits(ray)
    assert before.instance == 1
    scene.move_instance(1, placed([30, 0, 0]))
    with pytest.raises(splitplane.StaleError, match="update"):
        scene.closest_hits(ray)
    report = scene.update()
    assert report["geometries_built"] == 0 and report["instances_changed"] == 1
    assert not scene.any_hits(ray)
    scene.replace_geometry(0, VERTICES * 2, FACES)
    scene.update()
    assert scene.closest_hits([30, 0.01, 9, 0, 0.001, -1]).t == pytest.approx(7, abs=0.1)
    scene.remove_instance(1)
    assert scene.instances == [0, 2, 3] and len(scene) == 3
    other = scene.add_geometry(VERTICES[FACES])
    assert scene.add_instance(other) == 1 and scene.geometries == [0, 1] and scene.id(0) == 100
    scene.set_instance(1, geometry=0, transform=placed([0, 0, 0], 0.5), id=7, culling="back")
    scene.remove_geometry(other)
    scene.update()
    assert scene.id(1) == 7 and scene.transform(1)[0, 0] == 0.5
    assert scene.normals([0, MISS], [3, MISS]).shape == (2, 3)


def test_a_scene_edited_is_a_scene_made_anew(scene: Scene) -> None:
    scene.move_instance(2, placed([1, 2, 3]))
    scene.update()
    fresh = Scene()
    ball = fresh.add_geometry(VERTICES, FACES)
    for number, place in enumerate(np.where(np.arange(4)[:, None] == 2, [1, 2, 3], PLACES)):
        fresh.add_instance(ball, placed(place), mask=1 << number, id=100 + number)
    fresh.update()
    assert fresh.digest == scene.digest


def test_files_and_pickles(scene: Scene, tmp_path: Path) -> None:
    rays = rays_at(100)
    scene.save(tmp_path / "scene")
    for other in (Scene.load(tmp_path / "scene"), pickle.loads(pickle.dumps(scene))):
        assert other.digest == scene.digest
        np.testing.assert_array_equal(other.closest_hits(rays).t, scene.closest_hits(rays).t)
        np.testing.assert_array_equal(other.normals(0, np.arange(5)), scene.normals(0, np.arange(5)))
        other.add_instance(0, placed([9, 9, 9]))
        other.update()
        assert len(other) == 5
    scene.move_instance(0, placed([1, 1, 1]))
    with pytest.raises(splitplane.StaleError):
        scene.to_bytes()


def test_failed_updates_leave_the_scene(scene: Scene) -> None:
    digest = scene.digest
    scene.replace_geometry(0, VERTICES * 3, FACES)
    with pytest.raises(splitplane.OutOfMemoryError):
        scene.update(max_memory=500)
    assert scene.stale
    scene.replace_geometry(0, VERTICES, FACES)
    scene.update()
    assert scene.digest == digest
