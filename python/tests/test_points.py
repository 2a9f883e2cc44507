"""Point trees against brute force in float64."""

from __future__ import annotations

import os
import pickle
import subprocess
import sys

import numpy as np
import pytest

import splitplane
from splitplane import MISS, PointTree


@pytest.mark.parametrize("dimensions", [1, 2, 3, 4])
@pytest.mark.parametrize("axes", ["widest", "cycle"])
def test_nearest_are_those_of_brute_force(dimensions: int, axes: str) -> None:
    rng = np.random.default_rng(dimensions)
    points = rng.normal(size=(500, dimensions)).astype(np.float32)
    queries = rng.normal(size=(6, 10, dimensions)).astype(np.float32)
    tree = PointTree.build(points, axes=axes)
    distance = np.linalg.norm(queries[..., None, :].astype(float) - points, axis=-1)
    found = tree.nearest(queries, 7)
    assert found.distance.shape == found.index.shape == (6, 10, 7)
    np.testing.assert_allclose(found.distance, np.sort(distance, axis=-1)[..., :7], rtol=1e-5)
    np.testing.assert_allclose(np.take_along_axis(distance, found.index.astype(int), -1), found.distance, rtol=1e-5)
    lists = tree.within(queries, 0.5)
    flat = distance.reshape(60, 500)
    assert np.abs(np.diff(lists.starts) - (flat <= 0.5).sum(axis=1)).sum() <= 1
    assert lists.starts[-1] == len(lists.index)
    for query in range(60):
        own = lists.distance[lists.of(query)]
        assert (np.diff(own) >= 0).all() and (own <= 0.5 + 1e-6).all()


def test_limits_filters_and_missing_points() -> None:
    points = np.array([[0, 0, 0], [1, 0, 0], [np.nan, 0, 0], [5, 0, 0]], np.float32)
    tree = PointTree.build(points)
    assert tree.dropped == 1 and len(tree) == 4
    found = tree.nearest([0.1, 0, 0], 5)
    assert found.index.tolist() == [0, 1, 3, MISS, MISS] and np.isinf(found.distance[3:]).all()
    assert tree.nearest([0.1, 0, 0], 5, max_distance=2).index.tolist() == [0, 1, MISS, MISS, MISS]
    keep = np.array([False, True, True, True])
    assert tree.nearest([0.1, 0, 0], 2, keep=keep).index.tolist() == [1, 3]
    assert tree.within([0.1, 0, 0], 2, keep=keep).index.tolist() == [1]
    assert tree.nearest([0.1, 0, 0], 0).index.shape == (0,)
    assert tree.nearest(np.zeros((0, 3)), 3).index.shape == (0, 3)
    assert tree.nearest([np.nan, 0, 0]).index.tolist() == [MISS]


def test_ties_go_to_the_lower_index() -> None:
    tree = PointTree.build(np.zeros((50, 2), np.float32))
    assert tree.nearest([0, 0], 50).index.tolist() == list(range(50))


def test_a_backend_is_chosen_by_name() -> None:
    points = np.random.default_rng(5).normal(size=(3000, 3)).astype(np.float32)
    tree = PointTree.build(points)
    assert (tree.backend, tree.backend_reason) == ("cpu", "asked for")
    assert PointTree.build(points, backend="auto").digest == tree.digest
    with pytest.raises(splitplane.ConfigError, match="`gpu` is not a backend"):
        PointTree.build(points, backend="gpu")
    with pytest.raises(splitplane.OpenError):
        PointTree.build(points, backend="cpu", adapter="0")
    with pytest.raises(splitplane.OpenError):
        PointTree.build(points, backend="wgpu", adapter="no adapter has this name")


def test_a_gpu_gives_the_same_neighbours() -> None:
    points = np.random.default_rng(6).normal(size=(3000, 3)).astype(np.float32)
    queries = np.random.default_rng(7).normal(size=(200, 3)).astype(np.float32)
    if not splitplane.GPU:
        with pytest.raises(splitplane.OpenError, match="no GPU backend"):
            PointTree.build(points, backend="wgpu")
        return
    try:
        device = PointTree.build(points, backend="wgpu")
    except splitplane.OpenError as error:
        pytest.skip(f"no GPU: {error}")
    tree = PointTree.build(points)
    keep = np.arange(3000) % 3 > 0
    for own in (device, pickle.loads(pickle.dumps(device))):
        assert (own.backend, own.digest) == ("wgpu", tree.digest)
        for asked in ({}, {"keep": keep}):
            expected, found = tree.nearest(queries, 5, **asked), own.nearest(queries, 5, **asked)
            assert found.distance.tobytes() == expected.distance.tobytes() and (found.index == expected.index).all()
            few, lists = tree.within(queries, 0.3, **asked), own.within(queries, 0.3, **asked)
            assert (lists.starts == few.starts).all() and (lists.index == few.index).all() and len(few.index) > 0
            assert lists.distance.tobytes() == few.distance.tobytes()


def test_far_clouds_have_an_origin() -> None:
    far = np.array([1e8, 1e8, -1e8])
    points = np.random.default_rng(0).normal(size=(200, 3)) + far
    tree = PointTree.build(points, origin="center")
    found = tree.nearest(points)
    assert found.index[:, 0].tolist() == list(range(200)) and found.rounded > 0
    assert (PointTree.build(points).nearest(points).index[:, 0] != np.arange(200)).any()


def test_digests_and_pickles() -> None:
    points = np.random.default_rng(1).normal(size=(1000, 3)).astype(np.float32)
    tree = PointTree.build(points)
    assert PointTree.build(points, threads=1).digest == tree.digest != PointTree.build(points, axes="cycle").digest
    other = pickle.loads(pickle.dumps(tree))
    assert other.digest == tree.digest and repr(other) == repr(tree)
    np.testing.assert_array_equal(other.nearest(points[:20], 3).index, tree.nearest(points[:20], 3).index)


@pytest.mark.skipif(not os.path.exists("/proc/self/statm"), reason="this system does not tell its memory")
def test_a_limit_is_for_all_lists_that_wait() -> None:
    code = """
import resource, numpy as np, splitplane
points = np.random.default_rng(1).normal(size=(30_000, 3)).astype(np.float32)
tree = splitplane.PointTree.build(points)
tree.within(points[:4], 1e-3)
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
try:
    tree.within(np.zeros((4000, 3), np.float32), 99.0, max_memory=5_000_000)
except splitplane.OutOfMemoryError as error:
    print("refused", resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=100)
    said, grown = done.stdout.split()
    # In KiB. Each list for itself would be within the limit, 4000 of them take more than a gigabyte.
    assert said == "refused" and int(grown) < 40_000, done.stdout + done.stderr


def test_a_limit_refuses_the_same_on_any_number_of_threads() -> None:
    points = np.random.default_rng(1).normal(size=(2000, 3)).astype(np.float32)
    tree = PointTree.build(points)
    whole = tree.within(points, 0.5)
    # What is kept, and the last list beside it.
    counts = np.diff(whole.starts)
    held = np.cumsum(8 + 12 * counts)
    least = int(max((held - (8 + 12 * counts) + 24 * counts).max(), (held + 16 * counts).max()))
    for threads in (1, 2, 3):
        found = tree.within(points, 0.5, max_memory=least, threads=threads)
        assert found.index.tobytes() == whole.index.tobytes() and found.distance.tobytes() == whole.distance.tobytes()
        with pytest.raises(splitplane.OutOfMemoryError):
            tree.within(points, 0.5, max_memory=least - 1, threads=threads)
