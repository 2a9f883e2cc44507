"""What queries answer: arrays, by name. Shapes are those of the rays or points that were asked for."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any, ClassVar, Dict, NamedTuple, TypeVar

import numpy as np
import numpy.typing as npt

from ._arrays import F32, F64, I32, I64, MISS, U32, Bool


class Report(NamedTuple):
    """How a batch was answered."""

    #: Rays that a device's bounds of error left undecided, and that the CPU answered. 0 on the CPU.
    undecided: int = 0
    #: Rays that a device's driver did not follow to their end. 0 on the CPU.
    unfinished: int = 0
    #: Rays or points that the CPU answered for a device.
    answered_by_cpu: int = 0
    #: Rays through scenes that the CPU took from instance to instance, for a device that does not hold the scene: it answers in each. 0 on the CPU.
    placed_by_cpu: int = 0
    #: How many of the numbers that were given are not float32 and were rounded to it.
    rounded: int = 0


class Summary(NamedTuple):
    """What a build did."""

    #: Triangles of the mesh.
    triangles: int
    #: Triangles left out: a coordinate that is not finite, or two equal corners.
    dropped: int
    #: Triangles with a coordinate that counts as 0: -0, or less than 2^-126.
    snapped: int
    #: Coordinates that are not float32 and were rounded to it.
    rounded: int
    #: Most bytes that the build held at once.
    peak_bytes: int
    #: Bytes that queries read.
    query_bytes: int
    #: Nodes of the tree.
    nodes: int
    #: References to triangles in its leaves.
    references: int


class BackendInfo(NamedTuple):
    """A backend."""

    #: ``cpu`` or ``wgpu``.
    name: str
    #: The GPU's name; none on the CPU.
    adapter: str | None
    #: Threads; none on a GPU.
    threads: int | None
    #: For instance the instruction set.
    detail: str
    #: Why it is this one.
    reason: str


Some = TypeVar("Some", bound="Hits")


@dataclass(frozen=True)
class Hits:
    """The closest hit of each ray: the one of least (t, triangle).

    The arrays are columns of one array of records, as the library writes them, so a column is not contiguous:
    ``np.ascontiguousarray`` makes a copy that is.
    """

    #: Columns of the library's records, of 32 bits each, in their order, and their dtypes.
    _columns: ClassVar[Dict[str, Any]] = {"t": np.float32, "triangle": np.uint32, "u": np.float32, "v": np.float32}

    #: Distance in units of the ray's direction, float32; infinity for a miss.
    t: F32
    #: Index of the face, uint32; :data:`splitplane.MISS` for a miss.
    triangle: U32
    #: Weight of the face's second corner, float32 in [0, 1]: the point is (1 - u - v) a + u b + v c.
    u: F32
    #: Weight of the third corner.
    v: F32
    report: Report

    @property
    def hit(self) -> Bool:
        """Which rays hit something."""
        return np.asarray(self.triangle != np.uint32(MISS))

    # Columns are made when they are first asked for: for a batch that takes less than a millisecond, making all of them counts.
    @classmethod
    def _of(cls: type[Some], records: F32, leading: tuple[int, ...], report: Report) -> Some:
        """The hits of records (n, columns), in the shape of the rays."""
        hits = cls.__new__(cls)
        own = hits.__dict__
        own["_records"], own["_leading"], own["report"] = records, leading, report
        return hits

    if not TYPE_CHECKING:

        def __getattr__(self, name: str) -> Any:
            own = self.__dict__
            if name not in type(self)._columns or "_records" not in own:
                raise AttributeError(f"'{type(self).__name__}' object has no attribute '{name}'")
            made = own[name] = self._column(name)
            return made

    def _column(self, name: str) -> Any:
        own, columns = self.__dict__, type(self)._columns
        return own["_records"].view(columns[name])[:, list(columns).index(name)].reshape(own["_leading"])

    def _records_for(self, leading: tuple[int, ...]) -> F32 | None:
        """The records that these hits are columns of, for others of this shape to be written over; none where it is not so simple."""
        own = self.__dict__
        records: F32 | None = own.get("_records")
        if records is None or own["_leading"] != leading or not records.flags.writeable:
            return None
        made = (own[name] for name in type(self)._columns if name in own)
        return records if all(column.flags.writeable for column in made) else None

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), tuple(getattr(self, field.name) for field in fields(self))


@dataclass(frozen=True)
class SceneHits(Hits):
    """The closest hit of each ray in a scene: the one of least (t, instance, triangle)."""

    _columns: ClassVar[Dict[str, Any]] = {
        "t": np.float32, "u": np.float32, "v": np.float32, "triangle": np.uint32, "geometry": np.uint32, "instance": np.uint32
    }  # fmt: skip
    #: Names of geometries, uint32; :data:`splitplane.MISS` for a miss.
    geometry: U32
    #: Names of instances, uint32; :data:`splitplane.MISS` for a miss.
    instance: U32


@dataclass(frozen=True)
class Crossings:
    """All crossings of rays with surfaces, ray by ray in the order of the rays, each ray's nearest first.

    They are exact, and a ray through an edge or a vertex crosses the surface there once.
    """

    #: Where those of each ray begin, and the number of all: int64 (rays + 1,).
    starts: I64
    t: F32
    triangle: U32
    u: F32
    v: F32
    #: Whether the ray comes from the side from which the corners run counter-clockwise.
    front: Bool
    report: Report

    @property
    def ray(self) -> I64:
        """The ray of each crossing: its place among all rays, int64."""
        return np.repeat(np.arange(len(self.starts) - 1, dtype=np.int64), np.diff(self.starts))

    def of(self, ray: int) -> slice:
        """Where the crossings of a ray stand."""
        return slice(int(self.starts[ray]), int(self.starts[ray + 1]))

    def first(self, keep: Any = None) -> I64:
        """The place of the first crossing of each ray, int64 (rays,), of those where ``keep``, a bool for each crossing, is true; -1 where there is none.

        So any function of hits decides which count: ``crossings.t[crossings.first(keep)]``, where the place is not -1.
        """
        from . import _arrays as arrays
        from .errors import DtypeError, ShapeError

        if keep is None:
            return np.where(np.diff(self.starts) > 0, self.starts[:-1], -1)
        kept = arrays.as_array(keep, "keep")
        if kept.dtype != np.bool_:
            raise DtypeError(f"keep has dtype {kept.dtype}, but must be bool")
        if kept.shape != self.t.shape:
            raise ShapeError(f"keep has shape {kept.shape}, but there are {len(self.t)} crossings")
        places = np.append(np.nonzero(kept)[0], len(self.t))
        next_kept = places[np.searchsorted(places, self.starts[:-1])]
        return np.where(next_kept < self.starts[1:], next_kept, -1)


@dataclass(frozen=True)
class SceneCrossings(Crossings):
    """The same in a scene."""

    geometry: U32
    instance: U32


@dataclass(frozen=True)
class ClosestPoints:
    """The closest point of the surface to each point: least (distance, triangle)."""

    #: Distance, float64; infinity where none is within ``max_distance``. NaN nowhere.
    distance: F64
    #: Where it is: (..., 3), float32, or float64 where the tree has an origin. NaN where there is none.
    point: npt.NDArray[np.floating]
    #: Index of the face, uint32; :data:`splitplane.MISS` where there is none.
    triangle: U32
    u: F32
    v: F32
    report: Report

    @property
    def found(self) -> Bool:
        """Which points have one."""
        return np.asarray(self.triangle != np.uint32(MISS))


@dataclass(frozen=True)
class SceneClosestPoints(ClosestPoints):
    """The same in a scene: least (distance, instance, triangle)."""

    geometry: U32
    instance: U32


@dataclass(frozen=True)
class Impacts:
    """What each moving ball or capsule touches first."""

    #: When, in units of the ray's direction, float32; infinity where nothing is touched.
    t: F32
    #: Index of the face, uint32; :data:`splitplane.MISS` where nothing is touched.
    triangle: U32
    report: Report

    @property
    def hit(self) -> Bool:
        """Which of them touch something."""
        return np.asarray(self.triangle != np.uint32(MISS))


@dataclass(frozen=True)
class Overlaps:
    """The faces that each volume meets, volume by volume, each volume's in ascending order."""

    #: Where those of each volume begin, and the number of all: int64 (volumes + 1,).
    starts: I64
    triangle: U32
    report: Report

    def of(self, volume: int) -> slice:
        """Where the faces of a volume stand."""
        return slice(int(self.starts[volume]), int(self.starts[volume + 1]))


@dataclass(frozen=True)
class SceneOverlaps(Overlaps):
    """The same in a scene, each volume's in ascending order of (instance, triangle)."""

    #: Names of instances, uint32.
    instance: U32


@dataclass(frozen=True)
class Located:
    """Where points lie, decided exactly."""

    #: How often the surface winds around each point, int32: 1 within a closed surface whose corners run counter-clockwise
    #: as seen from outside. 0 on the surface.
    winding: I32
    #: Which points lie on a triangle.
    boundary: Bool
    report: Report

    def inside(self, rule: str = "nonzero") -> Bool:
        """Which points are inside: a winding other than 0 (``nonzero``), or an odd one (``evenodd``). Not those on the surface."""
        from .errors import ConfigError

        if rule == "nonzero":
            return np.asarray(self.winding != 0)
        if rule == "evenodd":
            return np.asarray(self.winding % 2 != 0)
        raise ConfigError(f"there is no rule `{rule}`; there are nonzero and evenodd")


@dataclass(frozen=True)
class Neighbours:
    """The nearest points, least (distance, index) first."""

    #: float64 (..., k); infinity where there is no further point.
    distance: F64
    #: uint32 (..., k); :data:`splitplane.MISS` where there is no further point.
    index: U32
    #: How many of the numbers that were given are not float32 and were rounded to it.
    rounded: int


@dataclass(frozen=True)
class NeighbourLists:
    """All points within a radius, query by query, each query's least (distance, index) first."""

    #: Where those of each query begin, and the number of all: int64 (queries + 1,).
    starts: I64
    index: U32
    distance: F64
    rounded: int

    def of(self, query: int) -> slice:
        """Where those of a query stand."""
        return slice(int(self.starts[query]), int(self.starts[query + 1]))
