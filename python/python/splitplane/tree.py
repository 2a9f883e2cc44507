"""A mesh that answers rays and points."""

from __future__ import annotations

import os
from typing import Any

import numpy as np

from . import _arrays as arrays
from . import _native
from ._arrays import F32, F64, U32, Bool, I64, Progress
from ._handle import Handle
from ._options import Backend, BuildArguments, backend_arguments, build_arguments, is_auto, query_arguments
from .errors import ConfigError, DtypeError, FileError, RangeError, ShapeError
from .results import ClosestPoints, Crossings, Hits, Impacts, Located, Overlaps, Report, Some, Summary


class Shifted:
    """Rays (n, 6) float32 whose origins are relative to the tree's origin already."""

    def __init__(self, rows: F32) -> None:
        self.rows = rows


#: The report of what the CPU answered, and nothing was rounded.
PLAIN = Report()
FLOAT32 = np.dtype(np.float32)
#: The limits of rays that were given none.
NO_LIMITS = (0.0, float("inf"))


def rays_of(
    rays: Any, t_min: Any, t_max: Any, origin: F64 | None
) -> tuple[F32, tuple[Any, Any], tuple[int, ...], int]:
    """Rays as rows of 6 or 8 numbers, their limits, their shape, and how many numbers were rounded."""
    if type(rays) is Shifted:
        rays, origin = rays.rows, None
    # What needs no change, first: of a batch that takes less than a millisecond, checks are a part that counts.
    if type(rays) is np.ndarray and rays.dtype is FLOAT32 and origin is None and t_min is None and t_max is None:
        shape, flags = rays.shape, rays.flags
        if len(shape) == 2 and (shape[1] == 6 or shape[1] == 8) and flags.c_contiguous and flags.aligned:
            return rays, NO_LIMITS, shape[:1], 0
    given = arrays.as_array(rays, "rays")
    if given.ndim and given.shape[-1] == 8:
        if t_min is not None or t_max is not None:
            raise ConfigError("rays of 8 numbers have their own limits; t_min and t_max must not be given")
        rows, leading, rounded = arrays.floats(given, "rays", (8,), origin, 3)
        return rows, (0.0, 0.0), leading, rounded
    rows, leading, rounded = arrays.floats(given, "rays", (6, 8), origin, 3)
    least = 0.0 if t_min is None else arrays.limit(t_min, "t_min", leading)
    most = np.inf if t_max is None else arrays.limit(t_max, "t_max", leading)
    return rows, (least, most), leading, rounded


#: Numbers of a volume, and how many of them are coordinates.
VOLUMES = {"box": (6, 6), "ball": (4, 3), "capsule": (7, 6), "triangle": (9, 9)}


def volumes_of(volumes: Any, kind: str, origin: F64 | None) -> tuple[F32, I64, tuple[int, ...], int]:
    """Volumes as rows of numbers, where those of each set of planes begin, the leading shape, and how many numbers were rounded."""
    if kind == "planes":
        if not isinstance(volumes, (list, tuple)):
            raise DtypeError(f"planes must be a list of arrays (m, 4), not {type(volumes).__name__}")
        sets, total, starts = [np.zeros((0, 4), np.float32)], 0, [0]
        for number, planes in enumerate(volumes):
            array = arrays.as_array(planes, f"planes {number}")
            if array.ndim != 2 or array.shape[1] != 4 or array.dtype.kind not in "fiu":
                raise ShapeError(f"planes {number} have shape {array.shape} of {array.dtype}, but must be numbers (m, 4)")
            if origin is not None:
                array = np.array(array, np.float64)
                array[:, 3] -= array[:, :3] @ origin
            own, _, rounded = arrays.floats(array, f"planes {number}", (4,))
            sets.append(own)
            starts.append(starts[-1] + len(own))
            total += rounded
        return np.concatenate(sets), np.array(starts, np.int64), (len(volumes),), total
    if kind not in VOLUMES:
        raise ConfigError(f"there is no volume `{kind}`; there are {', '.join(VOLUMES)} and planes")
    count, coordinates = VOLUMES[kind]
    shift = None if origin is None else np.tile(origin, coordinates // 3)
    rows, leading, rounded = arrays.floats(volumes, "volumes", (count,), shift, coordinates)
    return rows, np.zeros(1, np.int64), leading, rounded


def points_of(points: Any, origin: F64 | None) -> tuple[F32, tuple[int, ...], int]:
    """Points as rows of 3 numbers."""
    return arrays.floats(points, "points", (3,), origin, 3)


class Tree(Handle[_native.Tree]):
    """A SAH kd-tree over a triangle mesh, and the queries that it answers.

    Made by :meth:`build` or :meth:`load`. The same mesh and settings give the same tree and the same answers, bit for bit, on
    any machine and number of threads.

    Rays have shape (..., 6): origin x, y, z and direction x, y, z; or (..., 8): origin, least t, direction, greatest t, which
    is the library's own record. Both are read where they lie by closest and any hits on the CPU; records are made of (..., 6)
    where an array of limits is given, and by other queries. A ray is ``origin + t * direction`` with ``t_min <= t <= t_max``; t is in
    units of the direction's length, which need not be 1. Points have shape (..., 3), in the unit of the mesh. Answers have the
    leading shape.

    float32 is taken as it is. Other numbers are rounded to it, and reports count how many were (``rounded``). Far from the
    origin of coordinates that costs digits: give ``origin``, and float64 is first taken relative to that point.

    All queries take ``threads`` (1 to 1024; none: all cores) and ``progress``, a function of (stage, done, total) that the calling
    thread calls now and then; what it raises ends the work, and so does Ctrl-C. The GIL is released meanwhile. Do not write to
    arrays that a call is reading.
    """

    _vertices: F32
    _faces: U32
    _origin: F64 | None
    _rounded: int
    _arguments: BuildArguments
    _backend: Backend
    _preset_reason: str | None

    def __init__(self) -> None:
        raise TypeError("make trees with Tree.build() or Tree.load()")

    @classmethod
    def build(
        cls,
        vertices: Any,
        faces: Any = None,
        *,
        preset: str = "fast",
        layout: str = "fast",
        backend: str = "cpu",
        adapter: str | None = None,
        origin: Any = None,
        max_memory: int | None = None,
        threads: int | None = None,
        progress: Progress | None = None,
        rays: int | None = None,
        **knobs: Any,
    ) -> Tree:
        """Builds the tree of a mesh.

        vertices: (n, 3) numbers, or without faces (n, 3, 3): separate triangles.
        faces: (m, 3) whole numbers. Answers name faces by their place here.
        preset: ``fast``, ``narrow``, ``balanced`` or ``best``, by time to build; or ``builder=``: ``median``, ``binned``, ``sweep``.
            ``auto``, with ``rays``: the one that is expected to take the least time for the build and so many rays on the CPU, by
            measurements; ``preset_reason`` says why. It may differ between machines, and so may the tree.
        rays: how many rays the tree is to answer; of ``preset="auto"`` only.
        layout: ``fast``, or ``compact`` for a third to a half of the memory and slower rays.
        backend: ``cpu``; ``wgpu``, a GPU or an error; ``auto``, a GPU that is hardware and gives the CPU's bits, else the CPU.
        adapter: part of a GPU's name.
        origin: a point (3,) or ``center``: coordinates are taken relative to it in float64 before they are rounded.
        max_memory: most bytes of the build, the tree and what queries read; or it ends in OutOfMemoryError.
        knobs: fields of the library's BuildConfig, such as ``max_depth=32`` or ``bins=16``.

        Faces with a coordinate that is not finite, or with two equal corners, are left out; ``summary.dropped`` counts them.
        """
        auto = is_auto(preset, rays, backend, knobs)
        arguments = build_arguments("fast" if auto else preset, layout, max_memory, knobs)
        # Presets were measured on the CPU.
        device = backend_arguments("cpu" if auto and backend == "auto" else backend, adapter)
        call = arrays.call(threads, progress)
        shift = checked_origin(arrays.origin_of(origin, vertices))
        own, index, rounded = arrays.mesh_of(vertices, faces, shift)
        reason = None
        if auto and rays is not None:
            chosen, reason = _native.choose_preset(own, index, int(rays), call[0])
            arguments = (chosen, *arguments[1:])
        native = _native.Tree.build(own, index, arguments, device, call)
        tree = cls._of(native, own, index, shift, rounded, arguments, device)
        tree._preset_reason = reason
        return tree

    @classmethod
    def _of(
        cls,
        native: _native.Tree,
        vertices: F32,
        faces: U32,
        origin: F64 | None,
        rounded: int,
        arguments: BuildArguments,
        backend: Backend,
    ) -> Tree:
        tree = cls.__new__(cls)
        tree._own = native
        tree._vertices, tree._faces, tree._origin = vertices, faces, origin
        tree._rounded, tree._arguments, tree._backend = rounded, arguments, backend
        tree._preset_reason = None
        return tree

    def rebuild(
        self,
        vertices: Any,
        faces: Any = None,
        *,
        max_memory: int | None = None,
        threads: int | None = None,
        progress: Progress | None = None,
    ) -> None:
        """Builds again in the same memory, with the same settings: for meshes that move.

        vertices: (n, 3). faces: (m, 3); none: those that there are. After an error or Ctrl-C the tree is what it was.
        """
        native = self._native
        preset, knobs, layout, _ = self._arguments
        arguments = (preset, knobs, layout, arrays.memory(max_memory))
        call = arrays.call(threads, progress)
        if faces is None and arrays.as_array(vertices, "vertices").ndim == 2:
            faces = self._faces
        own, index, rounded = arrays.mesh_of(vertices, faces, self._origin)
        native.rebuild(own, index, arguments, call)
        self._vertices, self._faces, self._rounded, self._arguments = own, index, rounded, arguments

    # What it is.

    @property
    def vertices(self) -> F32:
        """The vertices as they were taken, (n, 3) float32, relative to the origin; read-only."""
        self._native
        return self._vertices

    @property
    def faces(self) -> U32:
        """The faces, (m, 3) uint32; read-only."""
        self._native
        return self._faces

    @property
    def origin(self) -> F64 | None:
        """What coordinates are relative to; none: as given."""
        self._native
        return self._origin

    @property
    def digest(self) -> str:
        """16 hexadecimal digits that name the tree: equal on every machine."""
        return self._native.digest()

    @property
    def summary(self) -> Summary:
        """What the build did."""
        numbers = self._native.summary()
        return Summary(rounded=self._rounded, **numbers)

    @property
    def bounds(self) -> F64:
        """The box of all triangles that were kept: its lower and its upper corner, (2, 3) float64."""
        box = np.asarray(self._native.bounds(), dtype=np.float64)
        return box if self._origin is None else box + self._origin

    @property
    def preset_reason(self) -> str | None:
        """Why ``preset="auto"`` chose this preset; none where it was named."""
        self._native
        return self._preset_reason

    @property
    def backend(self) -> str:
        """``cpu`` or ``wgpu``."""
        return self._native.backend()[0]

    @property
    def backend_reason(self) -> str:
        """Why it is this backend."""
        return self._native.backend()[1]

    def __len__(self) -> int:
        return len(self.faces)

    def __repr__(self) -> str:
        if self.closed:
            return "<splitplane.Tree, closed>"
        return f"<splitplane.Tree of {len(self._faces)} triangles on {self.backend}, digest {self.digest}>"

    # Rays.

    def closest_hits(
        self,
        rays: Any,
        *,
        t_min: Any = None,
        t_max: Any = None,
        accuracy: str = "watertight",
        culling: str = "none",
        ignore: int | None = None,
        out: Hits | None = None,
        threads: int | None = None,
        progress: Progress | None = None,
    ) -> Hits:
        """The closest hit of each ray, that of least (t, triangle).

        t_min, t_max: limits of t, both included: numbers, or arrays of the leading shape. 0 and infinity if not given.
        accuracy: ``watertight``: no ray slips between two faces that share an edge; ``exact``: the hit of real arithmetic;
        ``fast``: may leak at edges.
        culling: ``back`` or ``front``: the side of faces that is ignored. ignore: one face that all rays ignore.
        out: hits of an earlier call of the same shape, whose arrays are written over: no memory is taken.
        """
        native = self._native
        options = query_arguments(accuracy, culling, ignore)
        call = arrays.call(threads, progress)
        rows, limits, leading, rounded = rays_of(rays, t_min, t_max, self._origin)
        records, columns = hits_in(out, Hits, leading, rows)
        counts = native.closest_hits(rows, limits, options, records, call)
        report = PLAIN if rounded == 0 and not any(counts) else Report(*counts, rounded)
        return hits_of(Hits, records, columns, leading, report)

    def any_hits(
        self,
        rays: Any,
        *,
        t_min: Any = None,
        t_max: Any = None,
        accuracy: str = "watertight",
        culling: str = "none",
        ignore: int | None = None,
        out: Bool | None = None,
        threads: int | None = None,
        progress: Progress | None = None,
    ) -> Bool:
        """Whether each ray hits anything: bool, of the leading shape. Cheaper than the closest hit.

        out: an array of that shape, which is written over and returned.
        """
        native = self._native
        options = query_arguments(accuracy, culling, ignore)
        call = arrays.call(threads, progress)
        rows, limits, leading, _ = rays_of(rays, t_min, t_max, self._origin)
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
        ignore: int | None = None,
        max_memory: int | None = None,
        threads: int | None = None,
        progress: Progress | None = None,
    ) -> Crossings:
        """Every crossing of each ray with a surface, in order along it. Exact; edges and vertices count once."""
        native = self._native
        options = (arrays.text(culling, "culling"), arrays.maybe_whole(ignore, "ignore"), arrays.memory(max_memory))
        call = arrays.call(threads, progress)
        rows, limits, _, rounded = rays_of(rays, t_min, t_max, self._origin)
        (starts, t, triangle), (u, v, front), _, counts = native.all_hits(rows, limits, options, call)
        return Crossings(starts, t, triangle, u, v, front, Report(*counts, rounded))

    def count_hits(
        self,
        rays: Any,
        *,
        t_min: Any = None,
        t_max: Any = None,
        culling: str = "none",
        ignore: int | None = None,
        max_memory: int | None = None,
        threads: int | None = None,
        progress: Progress | None = None,
    ) -> I64:
        """How many crossings each ray has: int64, of the leading shape. As :meth:`all_hits`, without keeping them.

        A GPU counts them itself. max_memory: of the crossings of some thousands of rays, which the CPU holds while it counts.
        """
        native = self._native
        options = (arrays.text(culling, "culling"), arrays.maybe_whole(ignore, "ignore"), arrays.memory(max_memory))
        call = arrays.call(threads, progress)
        rows, limits, leading, _ = rays_of(rays, t_min, t_max, self._origin)
        found = arrays.room((len(rows),), np.int64)
        native.count_hits(rows, limits, options, found, call)
        return found.reshape(leading)

    # Bodies.

    def impacts(
        self,
        rays: Any,
        radius: Any,
        axis: Any = None,
        *,
        t_min: Any = None,
        t_max: Any = None,
        ignore: int | None = None,
        threads: int | None = None,
        progress: Progress | None = None,
    ) -> Impacts:
        """What each ball or capsule that moves along a ray touches first: least (t, triangle).

        rays: the way of the ball's middle, or of one end of the capsule's segment. radius: at least 0, a number or an array of the
        leading shape. axis: (..., 3), from that end of the segment to the other; none: balls. ``t`` is ``t_min`` where they touch from the start.
        """
        native = self._native
        face, call = arrays.maybe_whole(ignore, "ignore"), arrays.call(threads, progress)
        rows, limits, leading, rounded = rays_of(rays, t_min, t_max, self._origin)
        radii = arrays.limit(radius, "radius", leading)
        if isinstance(radii, float):
            radii = np.full(len(rows), radii, np.float32)
        axes = np.zeros((len(rows), 3), np.float32)
        if axis is not None:
            own, around, more = arrays.floats(axis, "axis", (3,))
            try:
                axes = np.broadcast_to(own.reshape(*around, 3), (*leading, 3)).reshape(-1, 3)
            except ValueError:
                raise ShapeError(f"axis has shape {(*around, 3)}, which does not fit rays of shape {leading}") from None
            axes, rounded = np.require(axes, np.float32, ["C", "A"]), rounded + more
        t, triangle = arrays.room((len(rows),), np.float32), arrays.room((len(rows),), np.uint32)
        counts = _native.impacts(native, rows, limits, radii, axes, face, t, triangle, call)
        return Impacts(t.reshape(leading), triangle.reshape(leading), Report(*counts, rounded))

    def overlaps(
        self,
        volumes: Any,
        kind: str = "box",
        *,
        ignore: int | None = None,
        max_memory: int | None = None,
        threads: int | None = None,
        progress: Progress | None = None,
    ) -> Overlaps:
        """The faces that each volume meets, decided exactly, also where they only touch.

        kind, and what a volume is: ``box``: (..., 6), lower and upper corner; ``ball``: (..., 4), middle and radius; ``capsule``: (..., 7),
        both ends of the segment and the radius; ``triangle``: (..., 9), such as those of another mesh; ``planes``: a list of arrays (m, 4),
        each a set of half-spaces ``n . x <= offset``, such as a frustum: what is in all of them.
        """
        native = self._native
        face, limit, call = arrays.maybe_whole(ignore, "ignore"), arrays.memory(max_memory), arrays.call(threads, progress)
        rows, starts, _, rounded = volumes_of(volumes, arrays.text(kind, "kind"), self._origin)
        ends, met, counts = _native.overlaps(native, kind, rows, starts, face, limit, call)
        return Overlaps(ends, met, Report(*counts, rounded))

    def overlaps_any(
        self,
        volumes: Any,
        kind: str = "box",
        *,
        ignore: int | None = None,
        threads: int | None = None,
        progress: Progress | None = None,
    ) -> Bool:
        """Whether each volume meets any face: bool, of the leading shape. As :meth:`overlaps`."""
        native = self._native
        face, call = arrays.maybe_whole(ignore, "ignore"), arrays.call(threads, progress)
        rows, starts, leading, _ = volumes_of(volumes, arrays.text(kind, "kind"), self._origin)
        found = arrays.room((len(starts) - 1 if kind == "planes" else len(rows),), np.bool_)
        _native.overlaps_any(native, kind, rows, starts, face, found, call)
        return found.reshape(leading)

    # Points.

    def locate(
        self,
        points: Any,
        *,
        max_memory: int | None = None,
        threads: int | None = None,
        progress: Progress | None = None,
    ) -> Located:
        """Where points lie: how often the surface winds around each, decided exactly. Means something for closed surfaces."""
        native = self._native
        limit, call = arrays.memory(max_memory), arrays.call(threads, progress)
        rows, leading, rounded = points_of(points, self._origin)
        winding, boundary = arrays.room((len(rows),), np.int32), arrays.room((len(rows),), np.bool_)
        counts = native.locate(rows, limit, winding, boundary, call)
        return Located(winding.reshape(leading), boundary.reshape(leading), Report(*counts, rounded))

    def contains(
        self,
        points: Any,
        *,
        rule: str = "nonzero",
        threads: int | None = None,
        progress: Progress | None = None,
    ) -> Bool:
        """Which points are inside: bool, of the leading shape. Those on the surface are not."""
        return self.locate(points, threads=threads, progress=progress).inside(rule)

    def closest_points(
        self,
        points: Any,
        *,
        max_distance: float = np.inf,
        accuracy: str = "watertight",
        ignore: int | None = None,
        threads: int | None = None,
        progress: Progress | None = None,
    ) -> ClosestPoints:
        """The closest point of the surface to each point: least (distance, triangle).

        max_distance: farther ones are not looked for, in the unit of the mesh; a small one makes the search faster.
        accuracy: with ``exact``, ``triangle`` is the nearest one in real arithmetic, of equal ones the lowest; with ``watertight`` and ``fast``,
        that of the least distance as computed in float64. Distance, point and weights are computed in float64 by each.
        """
        native = self._native
        options = (
            arrays.number(max_distance, "max_distance"),
            arrays.maybe_whole(ignore, "ignore"),
            arrays.text(accuracy, "accuracy"),
        )
        call = arrays.call(threads, progress)
        rows, leading, rounded = points_of(points, self._origin)
        count = (len(rows),)
        distance, triangle = arrays.room(count, np.float64), arrays.room(count, np.uint32)
        u, v = arrays.room(count, np.float32), arrays.room(count, np.float32)
        point = arrays.room((len(rows), 3), np.float32)
        counts = native.closest_points(rows, options, distance, point, triangle, u, v, call)
        distance, where = distances_and_points(distance, point, triangle, self._origin)
        return ClosestPoints(
            distance.reshape(leading),
            where.reshape(*leading, 3),
            triangle.reshape(leading),
            u.reshape(leading),
            v.reshape(leading),
            Report(*counts, rounded),
        )

    def signed_distance(
        self,
        points: Any,
        *,
        rule: str = "nonzero",
        threads: int | None = None,
        progress: Progress | None = None,
    ) -> F64:
        """The distance from the surface, negative inside: float64, of the leading shape. The sign is decided exactly."""
        closest = self.closest_points(points, threads=threads, progress=progress)
        located = self.locate(points, threads=threads, progress=progress)
        distance: F64 = np.where(located.inside(rule), -closest.distance, closest.distance)
        return np.where(located.boundary, 0.0, distance)

    # From faces and weights to places.

    def points_at(self, triangle: Any, u: Any, v: Any) -> F64:
        """The points (1 - u - v) a + u b + v c of faces: float64 (..., 3); NaN where the face is a miss."""
        return points_at(self.vertices, self._faces, triangle, u, v, self._origin)

    def normals(self, triangle: Any) -> F64:
        """Unit normals of faces: float64 (..., 3), by the right hand around the corners; NaN for a miss or a face without area."""
        return normals_of(self.vertices, self._faces, triangle)

    # Files.

    def to_bytes(self) -> bytes:
        """The tree as the bytes of a tree file. It does not hold the mesh."""
        return self._native.to_bytes(self._vertices, self._faces)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Writes a tree file. Keep the mesh too: :meth:`load` wants it."""
        data = self.to_bytes()
        with open(path, "wb") as file:
            file.write(data)

    @classmethod
    def load(
        cls,
        source: Any,
        vertices: Any,
        faces: Any = None,
        *,
        layout: str = "fast",
        backend: str = "cpu",
        adapter: str | None = None,
        origin: Any = None,
        max_memory: int | None = None,
        threads: int | None = None,
        progress: Progress | None = None,
    ) -> Tree:
        """A tree of a file, which is mapped, or of bytes; over the mesh that it was built over, with the same origin.

        Nothing is trusted: length, checksum, structure, digest, and whether it belongs to the mesh.
        """
        arguments = build_arguments("fast", layout, max_memory, {})
        device = backend_arguments(backend, adapter)
        call = arrays.call(threads, progress)
        shift = checked_origin(arrays.origin_of(origin, vertices))
        own, index, rounded = arrays.mesh_of(vertices, faces, shift)
        native = _native.Tree.load(file_of(source), own, index, arguments, device, call)
        return cls._of(native, own, index, shift, rounded, arguments, device)

    def __reduce__(self) -> tuple[Any, ...]:
        state = (self.to_bytes(), self._vertices, self._faces, self._origin, self._rounded, self._arguments, self._backend)
        return _restored, state


def _restored(
    data: bytes, vertices: F32, faces: U32, origin: F64 | None, rounded: int, arguments: BuildArguments, backend: Backend
) -> Tree:
    native = _native.Tree.load(file_of(data), vertices, faces, arguments, backend, (None, None))
    return Tree._of(native, vertices, faces, origin, rounded, arguments, backend)


def checked_origin(origin: F64 | None) -> F64 | None:
    """An origin of three coordinates."""
    if origin is not None and origin.shape != (3,):
        raise ShapeError(f"origin has shape {origin.shape}, but must have (3,)")
    return origin


def columns_of(records: F32, fields: dict[str, Any]) -> list[Any]:
    """The columns of records, which share their memory."""
    return [records.view(dtype)[:, place] for place, dtype in enumerate(fields.values())]


def hits_in(out: Any, kind: type[Hits], leading: tuple[int, ...], rows: F32) -> tuple[F32, dict[str, Any] | None]:
    """Room for records of hits, (n, 4) or (n, 6): new, or that of earlier hits; and columns of the caller's into which they are copied then."""
    fields = kind._columns
    shape = (len(rows), len(fields))
    if out is None:
        return arrays.room(shape, np.float32), None
    if not isinstance(out, kind):
        raise DtypeError(f"out must be a {kind.__name__}, not {type(out).__name__}")
    records = out._records_for(leading) if type(out) is kind else None
    if records is not None and not np.may_share_memory(records, rows):
        return records, None
    given = {name: getattr(out, name) for name in fields}
    records = records_of(given, fields, leading, shape)
    if records is not None and not np.may_share_memory(records, rows):
        return records, None
    checked = arrays.given({f"out.{name}": array for name, array in given.items()}, leading, tuple(fields.values()), rows, True)
    return arrays.room(shape, np.float32), dict(zip(fields, checked))


def records_of(given: dict[str, Any], fields: dict[str, Any], leading: tuple[int, ...], shape: tuple[int, ...]) -> F32 | None:
    """The records of which these arrays are the columns; none where they are others."""
    first = next(iter(given.values()))
    records = getattr(first, "base", None)
    while isinstance(records, np.ndarray) and isinstance(records.base, np.ndarray):
        records = records.base
    if not isinstance(records, np.ndarray) or records.dtype != np.float32 or records.shape != shape:
        return None
    if not records.flags.c_contiguous or not records.flags.aligned or not records.flags.writeable:
        return None
    for array, column in zip(given.values(), columns_of(records, fields)):
        if not isinstance(array, np.ndarray) or array.shape != leading or not array.flags.writeable:
            return None
        own = column.reshape(leading)
        same = array.__array_interface__["data"] == own.__array_interface__["data"] and array.strides == own.strides
        if array.dtype != column.dtype or not same:
            return None
    return records


def hits_of(kind: type[Some], records: F32, columns: dict[str, Any] | None, leading: tuple[int, ...], report: Report) -> Some:
    """The records that were filled as hits; or the caller's columns, into which they are copied."""
    if columns is None:
        return kind._of(records, leading, report)
    for own, column in zip(columns.values(), columns_of(records, kind._columns)):
        own[...] = column.reshape(leading)
    return kind(**columns, report=report)


def occluded_in(out: Any, leading: tuple[int, ...], rows: F32) -> Any:
    """Room for whether rays hit, flat."""
    if out is None:
        return arrays.room((len(rows),), np.bool_)
    return arrays.given({"out": out}, leading, (np.bool_,), rows)[0]


def distances_and_points(squared: F64, point: F32, triangle: U32, origin: F64 | None) -> tuple[F64, Any]:
    """Distances of their squares, and points in the caller's coordinates; NaN where there is none."""
    np.sqrt(squared, out=squared)
    point[triangle == np.uint32(arrays.MISS)] = np.nan
    return squared, point if origin is None else point.astype(np.float64) + origin


def file_of(source: Any) -> Any:
    """The bytes of a file, which is mapped, or those given."""
    if isinstance(source, (str, os.PathLike)):
        if os.path.getsize(source) == 0:
            raise FileError(f"{os.fspath(source)} is empty")
        return np.memmap(source, dtype=np.uint8, mode="r")
    try:
        data = np.frombuffer(source, dtype=np.uint8)
    except (TypeError, ValueError, BufferError) as error:
        raise DtypeError(f"a path or bytes are needed: {error}") from error
    return np.array(data) if data.ctypes.data % 4 else data


def corners_of(vertices: F32, faces: U32, triangle: Any) -> tuple[Any, Any, Any, Any]:
    """The corners of faces in float64, and which of them are there."""
    index = arrays.as_array(triangle, "triangle")
    if index.dtype.kind not in "iu":
        raise DtypeError(f"triangle has dtype {index.dtype}, but indices must be whole numbers")
    there = (index >= 0) & (index < len(faces))
    if not np.all(there | (index == arrays.MISS)):
        raise RangeError(f"a triangle is not below {len(faces)}, nor a miss")
    if len(faces) == 0:
        nothing = np.full((*index.shape, 3), np.nan)
        return nothing, nothing, nothing, there
    corners = vertices[faces[np.where(there, index, 0)]].astype(np.float64)
    return corners[..., 0, :], corners[..., 1, :], corners[..., 2, :], there


def points_at(vertices: F32, faces: U32, triangle: Any, u: Any, v: Any, origin: F64 | None) -> F64:
    """Points of faces by their weights."""
    a, b, c, there = corners_of(vertices, faces, triangle)
    u, v = np.asarray(u, np.float64)[..., None], np.asarray(v, np.float64)[..., None]
    point = (1 - u - v) * a + u * b + v * c
    if origin is not None:
        point = point + origin
    return np.asarray(np.where(there[..., None], point, np.nan))


def normals_of(vertices: F32, faces: U32, triangle: Any) -> F64:
    """Unit normals of faces."""
    a, b, c, there = corners_of(vertices, faces, triangle)
    normal = np.cross(b - a, c - a)
    with np.errstate(invalid="ignore", divide="ignore"):
        normal = normal / np.linalg.norm(normal, axis=-1, keepdims=True)
    return np.asarray(np.where(there[..., None], normal, np.nan))
