"""A cloud of points that answers which of them are nearest."""

from __future__ import annotations

from typing import Any

import numpy as np

from . import _arrays as arrays
from . import _native
from ._arrays import F32, F64, Progress
from ._handle import Handle
from ._options import Backend, backend_arguments
from .errors import DtypeError, ShapeError
from .results import NeighbourLists, Neighbours


class PointTree(Handle[_native.PointTree]):
    """A kd-tree over points of 1 to 4 dimensions. Made by :meth:`build`.

    Points and queries have shape (..., N), in a unit of the caller's. float32 is taken as it is; other numbers are rounded to
    it, after ``origin`` was taken from them where that is given. Points with a coordinate that is not finite are left out.
    ``threads`` and ``progress`` are those of :class:`splitplane.Tree`.
    """

    _points: F32
    _origin: F64 | None
    _axes: str
    _backend: Backend

    def __init__(self) -> None:
        raise TypeError("make point trees with PointTree.build()")

    @classmethod
    def build(
        cls,
        points: Any,
        *,
        axes: str = "widest",
        backend: str = "cpu",
        adapter: str | None = None,
        origin: Any = None,
        max_memory: int | None = None,
        threads: int | None = None,
        progress: Progress | None = None,
    ) -> PointTree:
        """Builds the tree of points (..., N), N from 1 to 4.

        axes: ``widest``: along which points reach farthest; ``cycle``: one after the other.
        backend: what builds and answers, as of :meth:`splitplane.Tree.build`; answers are the same on all. adapter: part of a GPU's name.
        origin: a point (N,), or ``center``.
        max_memory: most bytes that the build may hold.
        """
        limit, call = arrays.memory(max_memory), arrays.call(threads, progress)
        device = backend_arguments(backend, adapter)
        shift = arrays.origin_of(origin, points)
        given = arrays.as_array(points, "points")
        if shift is not None and (given.ndim == 0 or shift.shape != given.shape[-1:]):
            raise ShapeError(f"origin has shape {shift.shape}, which does not fit points of shape {given.shape}")
        rows, _, _ = arrays.floats(given, "points", (1, 2, 3, 4), shift, None)
        rows = np.array(rows, dtype=np.float32, order="C")
        rows.flags.writeable = False
        native = _native.PointTree.build(rows, arrays.text(axes, "axes"), limit, device, call)
        return cls._of(native, rows, shift, axes, device)

    @classmethod
    def _of(cls, native: _native.PointTree, points: F32, origin: F64 | None, axes: str, backend: Backend) -> PointTree:
        tree = cls.__new__(cls)
        tree._own = native
        tree._points, tree._origin, tree._axes, tree._backend = points, origin, axes, backend
        return tree

    @property
    def points(self) -> F32:
        """The points as they were taken, (n, N) float32, relative to the origin; read-only."""
        self._native
        return self._points

    @property
    def origin(self) -> F64 | None:
        """What coordinates are relative to; none: as given."""
        return self._origin

    @property
    def dropped(self) -> int:
        """Points that were left out."""
        return self._native.summary()["dropped"]

    @property
    def backend(self) -> str:
        """``cpu`` or ``wgpu``."""
        return self._native.backend()[0]

    @property
    def backend_reason(self) -> str:
        """Why it is this backend."""
        return self._native.backend()[1]

    @property
    def digest(self) -> str:
        """16 hexadecimal digits that name the tree: equal on every machine."""
        return self._native.digest()

    def __len__(self) -> int:
        return len(self.points)

    def _queries(self, queries: Any) -> tuple[F32, tuple[int, ...], int]:
        return arrays.floats(queries, "queries", (self._points.shape[1],), self._origin, None)

    def _keep(self, keep: Any) -> Any:
        if keep is None:
            return None
        mask = arrays.as_array(keep, "keep")
        if mask.dtype != np.bool_:
            raise DtypeError(f"keep has dtype {mask.dtype}, but must be bool")
        if mask.shape != (len(self._points),):
            raise ShapeError(f"keep has shape {mask.shape}, but must have ({len(self._points)},)")
        return np.require(mask, np.bool_, ["C", "A"])

    def nearest(
        self,
        queries: Any,
        k: int = 1,
        *,
        max_distance: float = np.inf,
        keep: Any = None,
        max_memory: int | None = None,
        threads: int | None = None,
        progress: Progress | None = None,
    ) -> Neighbours:
        """The k nearest points of each query, least (distance, index) first: arrays (..., k).

        max_distance: farther points do not count. keep: bool (n,): points that count.
        """
        native = self._native
        count = arrays.whole(k, "k", 0, 2**40)
        limits = (arrays.number(max_distance, "max_distance"), arrays.memory(max_memory))
        call = arrays.call(threads, progress)
        rows, leading, rounded = self._queries(queries)
        squared = arrays.room((len(rows), count), np.float64).reshape(-1)
        index = arrays.room((len(rows), count), np.uint32).reshape(-1)
        native.nearest(rows, count, limits, self._keep(keep), squared, index, call)
        np.sqrt(squared, out=squared)
        return Neighbours(squared.reshape(*leading, count), index.reshape(*leading, count), rounded)

    def within(
        self,
        queries: Any,
        radius: float,
        *,
        keep: Any = None,
        max_memory: int | None = None,
        threads: int | None = None,
        progress: Progress | None = None,
    ) -> NeighbourLists:
        """All points within a distance of each query, that distance included, least (distance, index) first."""
        native = self._native
        limits = (arrays.number(radius, "radius"), arrays.memory(max_memory))
        call = arrays.call(threads, progress)
        rows, _, rounded = self._queries(queries)
        starts, index, squared = native.within(rows, limits, self._keep(keep), call)
        np.sqrt(squared, out=squared)
        return NeighbourLists(starts, index, squared, rounded)

    def __repr__(self) -> str:
        if self.closed:
            return "<splitplane.PointTree, closed>"
        return f"<splitplane.PointTree of {len(self)} points of {self._points.shape[1]} dimensions, digest {self.digest}>"

    def __reduce__(self) -> tuple[Any, ...]:
        self._native
        return _restored, (self._points, self._origin, self._axes, self._backend)


def _restored(points: F32, origin: F64 | None, axes: str, backend: Backend = ("cpu", None)) -> PointTree:
    native = _native.PointTree.build(points, axes, None, backend, (None, None))
    return PointTree._of(native, points, origin, axes, backend)
