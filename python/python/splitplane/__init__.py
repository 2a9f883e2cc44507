"""Ray queries, closest points and nearest neighbours on SAH kd-trees.

The same mesh gives the same tree and the same answers, bit for bit, on any machine and number of threads. By default no ray
slips between two triangles, and exact answers are one option away.

>>> import splitplane
>>> tree = splitplane.Tree.build([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
>>> hits = tree.closest_hits([0.25, 0.25, 5, 0, 0, -1])
>>> float(hits.t), int(hits.triangle)
(5.0, 0)

``Tree`` is a mesh, ``Scene`` many objects, ``PointTree`` a cloud of points. ``splitplane.trimesh`` and ``splitplane.open3d`` have the
classes of those libraries.
"""

from __future__ import annotations

from . import _native, errors
from ._arrays import MISS
from ._options import backend_arguments
from .errors import *  # noqa: F403
from .points import PointTree
from .results import (
    BackendInfo,
    ClosestPoints,
    Crossings,
    Hits,
    Impacts,
    Located,
    NeighbourLists,
    Neighbours,
    Overlaps,
    Report,
    SceneClosestPoints,
    SceneCrossings,
    SceneHits,
    SceneOverlaps,
    Summary,
)
from .scene import Scene
from .tree import Tree

#: Whether this build can use GPUs.
GPU: bool = _native.GPU
__version__: str = _native.VERSION


def backend_info(backend: str = "cpu", adapter: str | None = None) -> BackendInfo:
    """Opens a backend and says what it is: ``cpu``, ``wgpu`` or ``auto``."""
    return BackendInfo(*_native.describe(*backend_arguments(backend, adapter)))


__all__ = [
    "BackendInfo",
    "ClosestPoints",
    "Crossings",
    "GPU",
    "Hits",
    "Impacts",
    "Located",
    "MISS",
    "NeighbourLists",
    "Neighbours",
    "Overlaps",
    "PointTree",
    "Report",
    "Scene",
    "SceneClosestPoints",
    "SceneCrossings",
    "SceneHits",
    "SceneOverlaps",
    "Summary",
    "Tree",
    "backend_info",
    "errors",
]
__all__ += [name for name in dir(errors) if name.endswith("Error")]
