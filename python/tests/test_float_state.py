"""Answers do not depend on the rounding mode of the thread that asks, and it is the same afterwards."""

from __future__ import annotations

import ctypes
import ctypes.util
import platform

import numpy as np
import pytest
from brute import sphere

from splitplane import PointTree, Tree

# Of fenv.h on x86-64: to nearest, downwards, upwards, towards zero.
NEAREST, MODES = 0, [0x400, 0x800, 0xC00]

libm = ctypes.util.find_library("m")
pytestmark = pytest.mark.skipif(
    libm is None or platform.machine() not in ("x86_64", "AMD64") or platform.system() != "Linux",
    reason="modes are those of Linux on x86-64",
)


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("threads", [1, 3])
def test_answers_are_those_of_rounding_to_nearest(mode: int, threads: int) -> None:
    assert libm is not None
    fenv = ctypes.CDLL(libm)
    vertices, faces = sphere(24, 16)
    vertices = np.ascontiguousarray(vertices, np.float32)
    rng = np.random.default_rng(3)
    rays = rng.normal(size=(9000, 6)).astype(np.float32)
    cloud = rng.normal(size=(9000, 3)).astype(np.float32)

    def answers() -> tuple[list[str], list[bytes]]:
        tree = Tree.build(vertices, faces, threads=threads)
        hits = [tree.closest_hits(rays, accuracy=accuracy, threads=threads) for accuracy in ("watertight", "exact")]
        one = tree.closest_hits(rays[:1])
        points = PointTree.build(cloud, threads=threads)
        near = points.nearest(rays[:, :3].copy(), 3, threads=threads)
        arrays = [a for hit in [*hits, one] for a in (hit.t, hit.u, hit.v, hit.triangle)]
        return [str(tree.digest), str(points.digest)], [a.tobytes() for a in [*arrays, near.index]]

    expected = answers()
    assert fenv.fesetround(mode) == 0
    try:
        found = answers()
        after = fenv.fegetround()
    finally:
        fenv.fesetround(NEAREST)
    assert after == mode
    assert found == expected
