"""A scene of many objects."""

from __future__ import annotations

import os
from typing import Any

import numpy as np

from . import _arrays as arrays
from . import _native
from ._arrays import F32, F64, I64, MISS, U32, Bool, Progress
from ._handle import Handle
from ._options import backend_arguments, build_arguments, ignored_instance
from .errors import DtypeError, ShapeError
from .results import Located, Report, SceneClosestPoints, SceneCrossings, SceneHits
from .tree import SCENE_HIT, distances_and_points, file_of, hits_in, hits_of, normals_of, occluded_in, points_of, rays_of


def matrix_of(transform: Any) -> F32:
    """A transform as three rows of four."""
    if transform is None:
        return np.eye(3, 4, dtype=np.float32)
    array = arrays.as_array(transform, "transform")
    if array.dtype.kind not in "fiu":
        raise DtypeError(f"transform has dtype {array.dtype}; numbers are needed")
    if array.shape == (4, 4):
        if not np.array_equal(array[3], [0, 0, 0, 1]):
            raise ShapeError("the last row of a transform (4, 4) must be 0, 0, 0, 1")
        array = array[:3]
    if array.shape != (3, 4):
        raise ShapeError(f"transform has shape {array.shape}, but must have (3, 4) or (4, 4)")
    if array.dtype != np.float32:
        return arrays.narrowed(np.asarray(array, np.float64), "transform")[0]
    return np.require(array, np.float32, ["C", "A"])


class Scene(Handle[_native.Scene]):
    """Geometries, which are meshes, and instances, which place them in the world.

    Edit it, call :meth:`update`, ask. An update makes anew only what changed. Queries of a scene that was edited and not
    updated raise StaleError. Rays, points, ``threads`` and ``progress`` are those of :class:`splitplane.Tree`; ``mask``: an instance
    answers where its mask and that of the query have a bit in common.

    preset, backend, adapter: as for :meth:`splitplane.Tree.build`, for all geometries.
    """

    def __init__(self, *, preset: str = "fast", layout: str = "fast", backend: str = "cpu", adapter: str | None = None, **knobs: Any) -> None:
        self._arguments = build_arguments(preset, layout, None, knobs)
        self._backend = backend_arguments(backend, adapter)
        self._own = _native.Scene(self._arguments[0], self._backend)
        self._meshes: dict[int, tuple[F32, U32]] = {}

    # Edits.

    def add_geometry(self, vertices: Any, faces: Any = None) -> int:
        """Adds a mesh, (n, 3) and (m, 3), or (n, 3, 3); its name."""
        native = self._native
        own, index, _ = arrays.mesh_of(vertices, faces, None)
        name = native.add_geometry(own, index)
        self._meshes[name] = own, index
        return name

    def replace_geometry(self, geometry: int, vertices: Any, faces: Any = None) -> None:
        """Gives a geometry another mesh; its instances stay."""
        native, name = self._native, arrays.whole(geometry, "geometry")
        own, index, _ = arrays.mesh_of(vertices, faces, None)
        native.replace_geometry(name, own, index)
        self._meshes[name] = own, index

    def remove_geometry(self, geometry: int) -> None:
        """Removes a geometry that has no instances."""
        name = arrays.whole(geometry, "geometry")
        self._native.remove_geometry(name)
        self._meshes.pop(name, None)

    def add_instance(self, geometry: int, transform: Any = None, *, mask: int = MISS, id: int = 0, culling: str = "none") -> int:
        """Places a geometry; the instance's name.

        transform: (3, 4) or (4, 4), from the object to the world; none: where it is. mask: 32 bits. id: a number of the caller's.
        culling: the side of its faces that it ignores, seen in the world.
        """
        return self._native.add_instance(
            arrays.whole(geometry, "geometry"),
            matrix_of(transform),
            arrays.whole(mask, "mask"),
            arrays.whole(id, "id"),
            arrays.text(culling, "culling"),
        )

    def set_instance(
        self,
        instance: int,
        *,
        transform: Any = None,
        geometry: int | None = None,
        mask: int | None = None,
        id: int | None = None,
        culling: str | None = None,
    ) -> None:
        """Changes what is given of an instance."""
        self._native.set_instance(
            arrays.whole(instance, "instance"),
            arrays.maybe_whole(geometry, "geometry"),
            None if transform is None else matrix_of(transform),
            arrays.maybe_whole(mask, "mask"),
            arrays.maybe_whole(id, "id"),
            None if culling is None else arrays.text(culling, "culling"),
        )

    def move_instance(self, instance: int, transform: Any) -> None:
        """Moves an instance: from now on this is its transform."""
        self._native.set_instance(arrays.whole(instance, "instance"), None, matrix_of(transform), None, None, None)

    def set_mask(self, instance: int, mask: int) -> None:
        """Gives an instance another mask."""
        self._native.set_instance(
            arrays.whole(instance, "instance"), None, None, arrays.whole(mask, "mask"), None, None
        )

    def remove_instance(self, instance: int) -> None:
        """Removes an instance."""
        self._native.remove_instance(arrays.whole(instance, "instance"))

    def update(
        self, *, max_memory: int | None = None, threads: int | None = None, progress: Progress | None = None
    ) -> dict[str, int]:
        """Brings what answers up to date, and says what was done. After an error it is what it was."""
        native = self._native
        preset, knobs, layout, _ = self._arguments
        arguments = (preset, knobs, layout, arrays.memory(max_memory))
        return native.update(arguments, arrays.call(threads, progress))

    # What it is.

    @property
    def instances(self) -> list[int]:
        """The names of all instances."""
        return self._native.instances()

    @property
    def geometries(self) -> list[int]:
        """The names of all geometries."""
        return self._native.geometries()

    def transform(self, instance: int) -> F32:
        """The transform of an instance, (3, 4) float32."""
        return np.asarray(self._native.instance(arrays.whole(instance, "instance"))[1], dtype=np.float32)

    def id(self, instance: int) -> int:
        """The caller's number of an instance."""
        return self._native.instance(arrays.whole(instance, "instance"))[3]

    @property
    def stale(self) -> bool:
        """Whether it was edited since the last update."""
        return self._native.edited()

    @property
    def digest(self) -> str:
        """16 hexadecimal digits that name geometries and instances."""
        return self._native.digest()

    @property
    def backend(self) -> str:
        """``cpu`` or ``wgpu``."""
        return self._native.backend()[0]

    def __len__(self) -> int:
        return len(self.instances)

    def __repr__(self) -> str:
        if self.closed:
            return "<splitplane.Scene, closed>"
        return f"<splitplane.Scene of {len(self)} instances of {len(self.geometries)} geometries on {self.backend}>"

    # Queries.

    def _options(self, accuracy: Any, culling: Any, mask: Any, ignore: Any) -> Any:
        return (
            arrays.text(accuracy, "accuracy"),
            arrays.text(culling, "culling"),
            arrays.whole(mask, "mask"),
            ignored_instance(ignore),
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
        ignore: tuple[int, int] | None = None,
        out: SceneHits | None = None,
        threads: int | None = None,
        progress: Progress | None = None,
    ) -> SceneHits:
        """The hit of least (t, instance, triangle) of each ray. ignore: an instance and a face of it. out: hits to write over."""
        native = self._native
        options, call = self._options(accuracy, culling, mask, ignore), arrays.call(threads, progress)
        rows, limits, leading, rounded = rays_of(rays, t_min, t_max, None)
        records, columns = hits_in(out, SceneHits, leading, rows)
        counts = native.closest_hits(rows, limits, options, records, call)
        t, u, v, triangle, geometry, instance = hits_of(records, columns, SCENE_HIT, leading)
        return SceneHits(t, triangle, u, v, Report(*counts, rounded), geometry, instance)

    def any_hits(
        self,
        rays: Any,
        *,
        t_min: Any = None,
        t_max: Any = None,
        accuracy: str = "watertight",
        culling: str = "none",
        mask: int = MISS,
        ignore: tuple[int, int] | None = None,
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
        ignore: tuple[int, int] | None = None,
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
        ignore: tuple[int, int] | None = None,
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
        mask: int = MISS,
        ignore: tuple[int, int] | None = None,
        threads: int | None = None,
        progress: Progress | None = None,
    ) -> SceneClosestPoints:
        """The closest point to each point, in the world: least (distance, instance, triangle)."""
        native = self._native
        options = (arrays.number(max_distance, "max_distance"), arrays.whole(mask, "mask"), ignored_instance(ignore))
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
        """Unit normals of faces in their geometries' own spaces: float64 (..., 3); NaN for a miss."""
        self._native
        names, faces = np.broadcast_arrays(arrays.as_array(geometry, "geometry"), arrays.as_array(triangle, "triangle"))
        normals = np.full((*names.shape, 3), np.nan)
        for name, (vertices, index) in self._meshes.items():
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
        scene._meshes = {name: scene._own.mesh(name) for name in scene._own.geometries()}
        return scene

    def __reduce__(self) -> tuple[Any, ...]:
        return _restored, (self.to_bytes(), self._arguments, self._backend)


def _restored(data: bytes, arguments: Any, backend: Any) -> Scene:
    scene = Scene.__new__(Scene)
    scene._own = _native.Scene.load(file_of(data), arguments, backend, (None, None))
    scene._arguments, scene._backend = arguments, backend
    scene._meshes = {name: scene._own.mesh(name) for name in scene._own.geometries()}
    return scene
