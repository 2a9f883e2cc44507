"""Volumes that faces meet, and bodies that move until they touch one, against brute force in float64."""

from __future__ import annotations

import numpy as np
import pytest
from brute import closest_brute, faces_met_by_box, sphere

import splitplane
from splitplane import MISS, Tree

VERTICES, FACES = sphere(16, 10)


def test_faces_that_boxes_meet_are_those_of_brute_force() -> None:
    rng = np.random.default_rng(1)
    tree = Tree.build(VERTICES, FACES)
    middle, half = rng.uniform(-1.3, 1.3, (4, 50, 3)), rng.uniform(0.01, 0.4, (4, 50, 3))
    boxes = np.concatenate([middle - half, middle + half], axis=-1).astype(np.float32)
    found = tree.overlaps(boxes)
    flat = boxes.reshape(-1, 6)
    assert found.starts.shape == (201,) and found.starts[-1] == len(found.triangle)
    for number, box in enumerate(flat):
        np.testing.assert_array_equal(found.triangle[found.of(number)], faces_met_by_box(VERTICES, FACES, box))
    some = np.diff(found.starts) > 0
    assert 50 < some.sum() < 190
    np.testing.assert_array_equal(tree.overlaps_any(boxes), some.reshape(4, 50))
    # A box is what is in six half-spaces, of which the sixth is left away for every other one.
    planes = []
    for number, box in enumerate(flat):
        own = [[*-axis, -box[k]] for k, axis in enumerate(np.eye(3))] + [[*axis, box[3 + k]] for k, axis in enumerate(np.eye(3))]
        planes.append(np.array(own, np.float32)[: 6 - number % 2])
    sets = tree.overlaps(planes, "planes")
    for number in range(0, 200, 2):
        np.testing.assert_array_equal(sets.triangle[sets.of(number)], found.triangle[found.of(number)])
    assert sets.starts[-1] > found.starts[-1]
    np.testing.assert_array_equal(tree.overlaps_any(planes, "planes"), np.diff(sets.starts) > 0)
    # Far away, with an origin.
    far = np.array([1e7, -3e6, 2e7])
    moved = Tree.build(VERTICES.astype(float) + far, FACES, origin=far)
    same = moved.overlaps(boxes.astype(float) + np.tile(far, 2))
    assert np.abs(np.diff(same.starts) - np.diff(found.starts)).sum() <= 3


def test_balls_and_capsules_meet_what_is_within_their_radius() -> None:
    rng = np.random.default_rng(2)
    tree = Tree.build(VERTICES, FACES)
    points = rng.uniform(-1.5, 1.5, (300, 3)).astype(np.float32)
    radius = rng.uniform(0, 0.5, 300).astype(np.float32)
    distance = closest_brute(VERTICES, FACES, points)
    clear = np.abs(distance - radius) > 1e-6
    any_met = tree.overlaps_any(np.column_stack([points, radius]), "ball")
    np.testing.assert_array_equal(any_met[clear], (distance <= radius)[clear])
    alone = tree.overlaps(np.column_stack([points, points, radius]), "capsule")
    np.testing.assert_array_equal(np.diff(alone.starts) > 0, any_met)
    # A segment is within a radius where one of its points is.
    ends = rng.uniform(-1.5, 1.5, (40, 3)).astype(np.float32)
    along = np.linspace(0, 1, 201)[:, None, None]
    near = closest_brute(VERTICES, FACES, (points[:40] * (1 - along) + ends * along).reshape(-1, 3)).reshape(201, 40).min(0)
    met = tree.overlaps_any(np.column_stack([points[:40], ends, radius[:40]]), "capsule")
    clear = np.abs(near - radius[:40]) > 0.02
    np.testing.assert_array_equal(met[clear], (near <= radius[:40])[clear])
    # Faces meet themselves and their neighbours, of which 12 share a corner away from the poles.
    own = tree.overlaps(VERTICES[FACES].reshape(-1, 9), "triangle")
    shared = (FACES[:, None, :, None] == FACES[None, :, None, :]).any((2, 3))
    np.testing.assert_array_equal(np.diff(own.starts), shared.sum(1))
    less = tree.overlaps(VERTICES[FACES[:1]].reshape(-1, 9), "triangle", ignore=0)
    assert 0 not in less.triangle and len(less.triangle) == shared[0].sum() - 1


def test_bodies_stop_where_they_touch() -> None:
    rng = np.random.default_rng(3)
    tree = Tree.build(VERTICES, FACES)
    aim = rng.uniform(-1, 1, (200, 3))
    start = 3 * aim / np.linalg.norm(aim, axis=1, keepdims=True)
    rays = np.concatenate([start, rng.uniform(-0.5, 0.5, (200, 3)) - start], axis=1).astype(np.float32)
    radius = rng.uniform(0.05, 0.5, 200).astype(np.float32)
    found = tree.impacts(rays.reshape(10, 20, 6), radius.reshape(10, 20))
    assert found.hit.all() and found.t.shape == (10, 20)
    t = found.t.reshape(-1).astype(float)
    place = lambda t: rays[:, :3] + t[:, None] * rays[:, 3:]  # noqa: E731
    np.testing.assert_allclose(closest_brute(VERTICES, FACES, place(t)), radius, atol=1e-5)
    for part in (0.25, 0.5, 0.75, 0.98):
        assert (closest_brute(VERTICES, FACES, place(part * t)) > radius).all()
    # A capsule without length is a ball; a long one touches no later.
    np.testing.assert_array_equal(tree.impacts(rays, radius, np.zeros(3)).t, t.astype(np.float32))
    longer = tree.impacts(rays, radius, rays[:, 3:] * 0.2)
    assert (longer.t <= t * (1 + 1e-6)).all() and (longer.t < t).any()
    assert tree.impacts(rays, 0.1, t_max=1e-3).triangle.tolist() == [MISS] * 200
    first = tree.impacts(rays[:1], radius[:1])
    assert tree.impacts(rays[:1], radius[:1], ignore=int(first.triangle[0])).triangle[0] != first.triangle[0]


def test_what_is_no_volume_is_refused() -> None:
    tree = Tree.build(VERTICES, FACES)
    box = np.zeros((3, 6), np.float32)
    for kind, value, error in [
        ("cube", box, splitplane.ConfigError),
        (None, box, splitplane.DtypeError),
        ("ball", box, splitplane.ShapeError),
        ("box", box.astype(complex), splitplane.DtypeError),
        ("planes", box, splitplane.DtypeError),
        ("planes", [box], splitplane.ShapeError),
        ("planes", [np.zeros(4)], splitplane.ShapeError),
        ("planes", [np.zeros((2, 4), bool)], splitplane.ShapeError),
    ]:
        for ask in (tree.overlaps, tree.overlaps_any):
            with pytest.raises(error):
                ask(value, kind)
    with pytest.raises(splitplane.OutOfMemoryError):
        tree.overlaps([[-2, -2, -2, 2, 2, 2]], max_memory=100)
    with pytest.raises(splitplane.RangeError):
        tree.overlaps(box, ignore=-1)
    rays = np.zeros((3, 6), np.float32)
    with pytest.raises(splitplane.ShapeError):
        tree.impacts(rays, [0.1, 0.2])
    with pytest.raises(splitplane.ShapeError):
        tree.impacts(rays, 0.1, np.zeros((2, 3)))
    with pytest.raises(splitplane.ShapeError):
        tree.impacts(rays, 0.1, [1, 2])
    with pytest.raises(splitplane.DtypeError):
        tree.impacts(rays, "thick")
    # What is empty or not a number meets nothing.
    odd = [[1, 1, 1, -1, -1, -1], [np.nan] * 6]
    assert tree.overlaps(odd).starts.tolist() == [0, 0, 0] and not tree.overlaps_any(odd).any()
    assert tree.overlaps(np.zeros((0, 6))).starts.tolist() == [0] and tree.overlaps([], "planes").starts.tolist() == [0]
    assert not tree.impacts([[0, 0, 9, 0, 0, -1]], -1.0).hit.any()
    tree.close()
    with pytest.raises(splitplane.DeadHandleError):
        tree.overlaps(box)
