"""A scene of many objects."""

from __future__ import annotations

import os
from typing import Any

import numpy as np

from . import _arrays as arrays
from . import _native
from ._arrays import F32, F64, I64, MISS, U32, Bool, Progress
from ._edits import Edits
from ._meshes import Meshes
from ._options import backend_arguments, build_arguments, ignored_instance, ignored_list
from .errors import DtypeError
from .results import Located, Report, SceneClosestPoints, SceneCrossings, SceneHits, SceneOverlaps
from .tree import distances_and_points, file_of, hits_in, hits_of, normals_of, occluded_in, points_of, rays_of, volumes_of


class Scene(Edits):
    """Geometries, which are meshes or shapes, and instances, which place them in the world.

    Edit it, call :meth:`update`, ask. An update makes anew only what changed. Queries of a scene that was edited, and for which
    :meth:`update` was not called since, raise StaleError. After an update that failed they answer as before it. Rays, points, ``threads`` and ``progress`` are those of :class:`splitplane.Tree`; ``mask``: an instance
    answers where its mask and that of the query have a bit in common.

    ``ignore`` of rays: an instance and a face of it, or an array (k, 2) of such pairs, whole numbers; :data:`splitplane.MISS` in place of a
    face: all of the instance. A hit that is ignored is as if it were not there. To decide hit by hit, take :meth:`all_hits` and
    :meth:`~splitplane.results.Crossings.first`.

    preset, layout, backend, adapter: as for :meth:`splitplane.Tree.build`, for all geometries.
    lazy: a geometry is built when the first ray reaches the box of an instance of it, and nothing that is built hides it: answers are the
    same, and queries may take memory and fail as builds do. Points, overlaps, files, digests and pickles build all of it; a pickle's copy is not lazy.
    """

    def __init__(
        self,
        *,
        preset: str = "fast",
        layout: str = "fast",
        backend: str = "cpu",
        adapter: str | None = None,
        lazy: bool = False,
        **knobs: Any,
    ) -> None:
        self._arguments = build_arguments(preset, layout, None, knobs)
        self._backend = backend_arguments(backend, adapter)
        if not isinstance(lazy, (bool, np.bool_)):
            raise DtypeError(f"lazy must be True or False, not {lazy!r}")
        self._own = _native.Scene(self._arguments, self._backend, bool(lazy))
        self._meshes = Meshes({})

    # Queries.

    def _options(self, accuracy: Any, culling: Any, mask: Any, ignore: Any) -> Any:
        return (
            arrays.text(accuracy, "accuracy"),
            arrays.text(culling, "culling"),
            arrays.whole(mask, "mask"),
            ignored_list(ignore),
        )

    def closest_hits(
        self,
        rays: Any,
        *,
        t_min: Any = None,
        t_max: Any = None,
        accuracy: str = "watertight",
        culling: str = "none",
        mask: int = MISS,
        ignore: Any = None,
        out: SceneHits | None = None,
        threads: int | None = None,
        progress: Progress | None = None,
    ) -> SceneHits:
        """The hit of least (t, instance, triangle) of each ray. out: hits to write over."""
        native = self._native
        options, call = self._options(accuracy, culling, mask, ignore), arrays.call(threads, progress)
        rows, limits, leading, rounded = rays_of(rays, t_min, t_max, None)
        records, columns = hits_in(out, SceneHits, leading, rows)
        counts = native.closest_hits(rows, limits, options, records, call)
        return hits_of(SceneHits, records, columns, leading, Report(*counts, rounded))

    def any_hits(
        self,
        rays: Any,
        *,
        t_min: Any = None,
        t_max: Any = None,
        accuracy: str = "watertight",
        culling: str = "none",
        mask: int = MISS,
        ignore: Any = None,
        out: Bool | None = None,
        threads: int | None = None,
        progress: Progress | None = None,
    ) -> Bool:
        """Whether each ray hits anything: bool, of the leading shape. out: an array of that shape to write over."""
        native = self._native
        options, call = self._options(accuracy, culling, mask, ignore), arrays.call(threads, progress)
        rows, limits, leading, _ = rays_of(rays, t_min, t_max, None)
        occluded = occluded_in(out, leading, rows)
        native.any_hits(rows, limits, options, occluded, call)
        return occluded.reshape(leading) if out is None else out

    def all_hits(
        self,
        rays: Any,
        *,
        t_min: Any = None,
        t_max: Any = None,
        culling: str = "none",
        mask: int = MISS,
        ignore: Any = None,
        max_memory: int | None = None,
        threads: int | None = None,
        progress: Progress | None = None,
    ) -> SceneCrossings:
        """Every crossing of each ray with a surface of an instance, in order of (t, instance, triangle)."""
        native = self._native
        options, call = self._options("exact", culling, mask, ignore), arrays.call(threads, progress)
        limit = arrays.memory(max_memory)
        rows, limits, _, rounded = rays_of(rays, t_min, t_max, None)
        (starts, t, triangle), (u, v, front), (geometry, instance), counts = native.all_hits(
            rows, limits, options, limit, call
        )
        return SceneCrossings(starts, t, triangle, u, v, front, Report(*counts, rounded), geometry, instance)

    def count_hits(
        self,
        rays: Any,
        *,
        t_min: Any = None,
        t_max: Any = None,
        culling: str = "none",
        mask: int = MISS,
        ignore: Any = None,
        max_memory: int | None = None,
        threads: int | None = None,
        progress: Progress | None = None,
    ) -> I64:
        """How many crossings each ray has: int64, of the leading shape. As :meth:`all_hits`, without keeping them.

        max_memory: of the crossings of one ray, which are held while they are counted.
        """
        native = self._native
        options, call = self._options("exact", culling, mask, ignore), arrays.call(threads, progress)
        limit = arrays.memory(max_memory)
        rows, limits, leading, _ = rays_of(rays, t_min, t_max, None)
        found = arrays.room((len(rows),), np.int64)
        native.count_hits(rows, limits, options, limit, found, call)
        return found.reshape(leading)

    def overlaps(
        self,
        volumes: Any,
        kind: str = "box",
        *,
        mask: int = MISS,
        ignore: tuple[int, int] | None = None,
        max_memory: int | None = None,
        threads: int | None = None,
        progress: Progress | None = None,
    ) -> SceneOverlaps:
        """The faces of instances that each volume meets in the world, decided exactly, also where they only touch.

        kind, and what a volume is: as for :meth:`splitplane.Tree.overlaps`. ignore: an instance and a face of it.
        """
        native = self._native
        own = (arrays.whole(mask, "mask"), ignored_instance(ignore))
        limit, call = arrays.memory(max_memory), arrays.call(threads, progress)
        rows, starts, _, rounded = volumes_of(volumes, arrays.text(kind, "kind"), None)
        ends, met, instance = _native.scene_overlaps(native, kind, rows, starts, own, limit, call)
        return SceneOverlaps(ends, met, Report(rounded=rounded), instance)

    def overlaps_any(
        self,
        volumes: Any,
        kind: str = "box",
        *,
        mask: int = MISS,
        ignore: tuple[int, int] | None = None,
        threads: int | None = None,
        progress: Progress | None = None,
    ) -> Bool:
        """Whether each volume meets any face of an instance: bool, of the leading shape. As :meth:`overlaps`."""
        native = self._native
        own, call = (arrays.whole(mask, "mask"), ignored_instance(ignore)), arrays.call(threads, progress)
        rows, starts, leading, _ = volumes_of(volumes, arrays.text(kind, "kind"), None)
        found = arrays.room((len(starts) - 1 if kind == "planes" else len(rows),), np.bool_)
        _native.scene_overlaps_any(native, kind, rows, starts, own, found, call)
        return found.reshape(leading)

    def locate(
        self,
        points: Any,
        *,
        max_memory: int | None = None,
        threads: int | None = None,
        progress: Progress | None = None,
    ) -> Located:
        """How often the surfaces of all instances wind around each point."""
        native = self._native
        limit, call = arrays.memory(max_memory), arrays.call(threads, progress)
        rows, leading, rounded = points_of(points, None)
        winding, boundary = arrays.room((len(rows),), np.int32), arrays.room((len(rows),), np.bool_)
        counts = native.locate(rows, limit, winding, boundary, call)
        return Located(winding.reshape(leading), boundary.reshape(leading), Report(*counts, rounded))

    def contains(self, points: Any, *, rule: str = "nonzero", threads: int | None = None, progress: Progress | None = None) -> Bool:
        """Which points are inside of an instance: bool, of the leading shape. Those on a surface are not."""
        return self.locate(points, threads=threads, progress=progress).inside(rule)

    def closest_points(
        self,
        points: Any,
        *,
        max_distance: float = np.inf,
        accuracy: str = "watertight",
        mask: int = MISS,
        ignore: tuple[int, int] | None = None,
        threads: int | None = None,
        progress: Progress | None = None,
    ) -> SceneClosestPoints:
        """The closest point to each point, in the world: least (distance, instance, triangle).

        accuracy: as for :meth:`Tree.closest_points`; ``exact`` is of the instances' matrices as they are, in float32, and not for shapes.
        """
        native = self._native
        options = (
            arrays.number(max_distance, "max_distance"),
            arrays.whole(mask, "mask"),
            ignored_instance(ignore),
            arrays.text(accuracy, "accuracy"),
        )
        call = arrays.call(threads, progress)
        rows, leading, rounded = points_of(points, None)
        count = (len(rows),)
        distance, point = arrays.room(count, np.float64), arrays.room((len(rows), 3), np.float32)
        triangle, geometry, instance = (arrays.room(count, np.uint32) for _ in range(3))
        u, v = arrays.room(count, np.float32), arrays.room(count, np.float32)
        counts = native.closest_points(rows, options, distance, point, (triangle, geometry, instance), (u, v), call)
        distance, where = distances_and_points(distance, point, triangle, None)
        return SceneClosestPoints(
            distance.reshape(leading),
            where.reshape(*leading, 3),
            triangle.reshape(leading),
            u.reshape(leading),
            v.reshape(leading),
            Report(*counts, rounded),
            geometry.reshape(leading),
            instance.reshape(leading),
        )

    def signed_distance(
        self, points: Any, *, rule: str = "nonzero", threads: int | None = None, progress: Progress | None = None
    ) -> F64:
        """The distance from all surfaces, negative inside: float64, of the leading shape."""
        closest = self.closest_points(points, threads=threads, progress=progress)
        located = self.locate(points, threads=threads, progress=progress)
        distance: F64 = np.where(located.inside(rule), -closest.distance, closest.distance)
        return np.where(located.boundary, 0.0, distance)

    def normals(self, geometry: Any, triangle: Any) -> F64:
        """Unit normals of faces in their geometries' own spaces: float64 (..., 3); NaN for a miss, and for shapes. Of geometries as queries meet them."""
        native = self._native
        names, faces = np.broadcast_arrays(arrays.as_array(geometry, "geometry"), arrays.as_array(triangle, "triangle"))
        normals = np.full((*names.shape, 3), np.nan)
        for name, (vertices, index) in self._meshes.built(native.updates()):
            here = names == name
            normals[here] = normals_of(vertices, index, faces[here])
        return normals

    # Files.

    def to_bytes(self) -> bytes:
        """The scene as the bytes of a scene file: meshes, trees and instances."""
        return self._native.to_bytes()

    def save(self, path: str | os.PathLike[str]) -> None:
        """Writes a scene file."""
        data = self.to_bytes()
        with open(path, "wb") as file:
            file.write(data)

    @classmethod
    def load(
        cls,
        source: Any,
        *,
        layout: str = "fast",
        backend: str = "cpu",
        adapter: str | None = None,
        max_memory: int | None = None,
        threads: int | None = None,
        progress: Progress | None = None,
    ) -> Scene:
        """A scene of a file, which is mapped, or of bytes. Builds no tree of a geometry; nothing is trusted.

        Geometries that change later are built by preset "fast", with this layout and within max_memory.
        """
        arguments = build_arguments("fast", layout, max_memory, {})
        device, call = backend_arguments(backend, adapter), arrays.call(threads, progress)
        scene = cls.__new__(cls)
        scene._own = _native.Scene.load(file_of(source), arguments, device, call)
        scene._arguments, scene._backend = arguments, device
        scene._meshes = Meshes(meshes_of(scene._own))
        return scene

    def __reduce__(self) -> tuple[Any, ...]:
        return _restored, (self.to_bytes(), self._arguments, self._backend)


def meshes_of(native: _native.Scene) -> dict[int, tuple[F32, U32]]:
    """Vertices and faces of the geometries that have some."""
    return {name: native.mesh(name) for name in native.geometries() if _native.kind_of(native, name) == "triangles"}


def _restored(data: bytes, arguments: Any, backend: Any) -> Scene:
    scene = Scene.__new__(Scene)
    scene._own = _native.Scene.load(file_of(data), arguments, backend, (None, None))
    scene._arguments, scene._backend = arguments, backend
    scene._meshes = Meshes(meshes_of(scene._own))
    return scene
