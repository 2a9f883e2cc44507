"""Trees, scenes and clouds that are shared with the workers of a cluster, and the queries that these answer."""

from __future__ import annotations

import os
import shutil
import uuid
from contextlib import closing
from pathlib import Path
from typing import Any, Generator, Iterator, cast

import numpy as np

from .. import _arrays as arrays
from .. import _native
from .._arrays import F64, I64, Bool, Progress
from ..errors import ConfigError, DeadHandleError, DtypeError
from ..points import PointTree
from ..results import ClosestPoints, Crossings, Hits, Located, NeighbourLists, Neighbours, SceneClosestPoints, SceneCrossings, SceneHits
from ..scene import Scene
from ..tree import Tree
from ._flow import Meter, client_of, in_order, most_under_way
from ._merge import Outputs, Whole
from ._source import LIMITS, Part, source_of
from ._worker import Keeper, answer, parts_of, write

#: Rays or points of a chunk, if nothing else is said.
CHUNK = 1 << 18


def share(
    thing: Any,
    client: Any = None,
    *,
    folder: str | os.PathLike[str] | None = None,
    chunk: int = CHUNK,
    in_flight: int | None = None,
    threads: int | None = 1,
) -> Any:
    """Shares a Tree, a Scene or a PointTree with the workers of a cluster: gives a SharedTree, a SharedScene or a SharedPointTree.

    client: a ``dask.distributed.Client``; none: the one that is open.
    folder: one that this process and all workers see, for the files; none: they are sent to each worker, which keeps them in its own.
    chunk: most rays or points of a task.
    in_flight: most tasks under way, those included whose answers wait for their turn; none: two for each thread of the cluster and two more.
    threads: of each task. 1 is right where workers have as many Dask threads as cores; none: all cores, for workers of one Dask thread.

    It is a context manager; at its end workers give memory and files back. What is shared is the thing as it is now: share it again when it
    has changed.
    """
    kinds = {Tree: SharedTree, Scene: SharedScene, PointTree: SharedPointTree}
    for kind, shared in kinds.items():
        if isinstance(thing, kind):
            return shared(thing, client, folder, chunk, in_flight, threads)
    raise DtypeError(f"a Tree, a Scene or a PointTree can be shared, not {type(thing).__name__}")


class _Shared:
    """What all shared things do."""

    #: The queries, what each is asked, and how many numbers that has.
    _queries: dict[str, tuple[str, tuple[int, ...]]] = {}

    def __init__(self, thing: Any, client: Any, folder: Any, chunk: Any, in_flight: Any, threads: Any) -> None:
        self._client, self._empty = client_of(client), _empty_like(thing)
        self._numbers = thing.points.shape[1] if isinstance(thing, PointTree) else 0
        self._chunk, self._in_flight = arrays.whole(chunk, "chunk", 1), in_flight
        self._most = most_under_way(self._client, in_flight)
        self._threads = arrays.maybe_whole(threads, "threads", 1, 1024)
        self._digest = thing.digest
        kind, files, about = parts_of(thing)
        self._name = f"splitplane-{self._digest}-{uuid.uuid4().hex}"
        self._folder: Path | None = None
        if folder is not None:
            self._folder = Path(folder).resolve() / self._name
        place = files if self._folder is None else str(self._folder)
        keeper = Keeper(self._name, _native.VERSION, self._digest, kind, about, place)
        try:
            if self._folder is not None:
                write(self._folder, files)
            self._client.register_plugin(keeper, name=self._name)
        except BaseException:
            self._remove()
            raise
        self._closed = False

    @property
    def digest(self) -> str:
        """16 hexadecimal digits that name what is shared."""
        return str(self._digest)

    def close(self) -> None:
        """Has workers give memory and files back."""
        if not self._closed:
            self._closed = True
            try:
                if self._client.status == "running":
                    self._client.unregister_worker_plugin(self._name)
            finally:
                self._remove()

    def _remove(self) -> None:
        if self._folder is not None:
            shutil.rmtree(self._folder, ignore_errors=True)

    def __enter__(self) -> Any:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __repr__(self) -> str:
        return f"<splitplane.dask.{type(self).__name__}, digest {self._digest}{', closed' if self._closed else ''}>"

    def stream(
        self,
        query: str,
        source: Any,
        *,
        chunk: int | None = None,
        in_flight: int | None = None,
        progress: Progress | None = None,
        **options: Any,
    ) -> Iterator[Any]:
        """The answers chunk by chunk, in order, as the query gives them: for more rays than memory has room for.

        query: the name of a method, as ``closest_hits``. source: an array, which may be a ``np.memmap``; a dask array; or an iterator of
        arrays, which is asked for the next when there is room for another chunk. options: those of the query.
        """
        parts, _, meter, most = self._prepared(query, source, chunk, in_flight, progress, options)
        return self._found(query, parts, meter, most)

    def _found(self, query: str, parts: Iterator[Part], meter: Meter, most: int) -> Iterator[Any]:
        with closing(self._answers(query, parts, None, meter, most)) as answers:
            for _, found in answers:
                yield found

    def _nothing(self, query: str, columns: int, options: dict[str, Any]) -> Any:
        """The answer to no rows. Options that nothing has are refused here, before anything is sent."""
        few = {name: value for name, value in options.items() if name != "keep" and not (name in LIMITS and np.ndim(value))}
        return getattr(self._empty, query)(np.zeros((0, columns), np.float32), **few)

    def _prepared(
        self, query: str, source: Any, chunk: Any, in_flight: Any, progress: Any, options: dict[str, Any]
    ) -> tuple[Iterator[Part], tuple[int, ...] | None, Meter, int]:
        if self._closed:
            raise DeadHandleError(f"this {type(self).__name__} was closed")
        if query not in self._queries:
            raise ConfigError(f"there is no query `{query}`; there are {', '.join(self._queries)}")
        name, columns = self._queries[query]
        columns = columns or (self._numbers,)
        options = {"threads": self._threads, **options}
        self._nothing(query, columns[0], options)
        rows = self._chunk if chunk is None else arrays.whole(chunk, "chunk", 1)
        parts, leading = source_of(source, name, columns, rows, options, self._client)
        most = self._most if in_flight is None else most_under_way(self._client, in_flight)
        total = 0 if leading is None else int(np.prod(leading, dtype=np.int64))
        return parts, leading, Meter(progress, "rays", total), most

    def _answers(
        self, query: str, parts: Iterator[Part], wanted: tuple[str, ...] | None, meter: Meter, most: int
    ) -> Generator[tuple[int, Any], None, None]:
        def submit(part: Part) -> Any:
            key = f"{self._name}-{query}-{uuid.uuid4().hex}"
            return self._client.submit(answer, self._name, query, part.rows, part.options, wanted, key=key, pure=False)

        meter.begin()
        first = 0
        with closing(in_order(self._client, submit, parts, most, meter.waiting)) as answers:
            for part, found in answers:
                count = _rows_of(found) if part.length is None else part.length
                meter.add(count)
                yield first, found
                first += count

    def _ask(
        self, query: str, source: Any, chunk: Any, in_flight: Any, progress: Any, out: Any, options: dict[str, Any]
    ) -> Any:
        columns = self._queries[query][1] or (self._numbers,)
        parts, leading, meter, most = self._prepared(query, source, chunk, in_flight, progress, options)
        nothing = self._nothing(query, columns[0], {"threads": self._threads, **options})
        count = None if leading is None else int(np.prod(leading, dtype=np.int64))
        outputs = None if out is None else Outputs(out, nothing, count)
        whole = Whole(nothing, count) if outputs is None else None
        wanted, done = None if outputs is None else outputs.wanted, 0
        with closing(self._answers(query, parts, wanted, meter, most)) as answers:
            for first, found in answers:
                done += (whole or outputs).put(first, found)  # type: ignore[union-attr]
        if whole is None:
            return out if count is not None else done
        return whole.finish(leading)


def _empty_like(thing: Any) -> Any:
    """One of the same kind with nothing in it: it checks options, and its answers have the shapes and dtypes of others."""
    if isinstance(thing, Tree):
        return Tree.build(np.zeros((0, 3), np.float32), np.zeros((0, 3), np.uint32), origin=thing.origin)
    if isinstance(thing, Scene):
        scene = Scene()
        scene.update()
        return scene
    return PointTree.build(thing.points[:0], origin=thing.origin)


def _rows_of(found: Any) -> int:
    if isinstance(found, dict):
        return len(next(iter(found.values())))
    if hasattr(found, "starts"):
        return len(found.starts) - 1
    if isinstance(found, np.ndarray):
        return len(found)
    return len(next(value for value in vars(found).values() if isinstance(value, np.ndarray)))


_RAYS, _POINTS = ("rays", (6, 8)), ("points", (3,))


class SharedTree(_Shared):
    """A tree on the workers of a cluster. Made by :func:`share`.

    Queries take what those of :class:`splitplane.Tree` take, and answer the same, byte for byte; and ``chunk``, ``in_flight`` and
    ``progress`` (called by the calling thread with what is in, and while it waits; what it raises ends the work, and so does Ctrl-C; chunks
    under way are then cancelled). ``source`` is an array of any leading shape, a ``np.memmap`` too; a dask array; or an iterator of
    arrays.

    out: where answers go: an array, or where there are several columns a dict of some of them, by name, for instance
    ``{"t": np.memmap(...)}``. It is returned; or where the source does not know its length, how many answers there are.
    """

    _queries = {
        "closest_hits": _RAYS,
        "any_hits": _RAYS,
        "all_hits": _RAYS,
        "count_hits": _RAYS,
        "locate": _POINTS,
        "contains": _POINTS,
        "closest_points": _POINTS,
        "signed_distance": _POINTS,
    }

    def closest_hits(self, source: Any, *, chunk: int | None = None, in_flight: int | None = None, out: Any = None, progress: Progress | None = None, **options: Any) -> Hits:  # fmt: skip
        """See :meth:`splitplane.Tree.closest_hits`."""
        return cast(Hits, self._ask("closest_hits", source, chunk, in_flight, progress, out, options))

    def any_hits(self, source: Any, *, chunk: int | None = None, in_flight: int | None = None, out: Any = None, progress: Progress | None = None, **options: Any) -> Bool:  # fmt: skip
        """See :meth:`splitplane.Tree.any_hits`."""
        return cast(Bool, self._ask("any_hits", source, chunk, in_flight, progress, out, options))

    def all_hits(self, source: Any, *, chunk: int | None = None, in_flight: int | None = None, progress: Progress | None = None, **options: Any) -> Crossings:  # fmt: skip
        """See :meth:`splitplane.Tree.all_hits`. ``max_memory`` is that of a chunk."""
        return cast(Crossings, self._ask("all_hits", source, chunk, in_flight, progress, None, options))

    def count_hits(self, source: Any, *, chunk: int | None = None, in_flight: int | None = None, out: Any = None, progress: Progress | None = None, **options: Any) -> I64:  # fmt: skip
        """See :meth:`splitplane.Tree.count_hits`."""
        return cast(I64, self._ask("count_hits", source, chunk, in_flight, progress, out, options))

    def locate(self, source: Any, *, chunk: int | None = None, in_flight: int | None = None, out: Any = None, progress: Progress | None = None, **options: Any) -> Located:  # fmt: skip
        """See :meth:`splitplane.Tree.locate`."""
        return cast(Located, self._ask("locate", source, chunk, in_flight, progress, out, options))

    def contains(self, source: Any, *, chunk: int | None = None, in_flight: int | None = None, out: Any = None, progress: Progress | None = None, **options: Any) -> Bool:  # fmt: skip
        """See :meth:`splitplane.Tree.contains`."""
        return cast(Bool, self._ask("contains", source, chunk, in_flight, progress, out, options))

    def closest_points(self, source: Any, *, chunk: int | None = None, in_flight: int | None = None, out: Any = None, progress: Progress | None = None, **options: Any) -> ClosestPoints:  # fmt: skip
        """See :meth:`splitplane.Tree.closest_points`."""
        return cast(ClosestPoints, self._ask("closest_points", source, chunk, in_flight, progress, out, options))

    def signed_distance(self, source: Any, *, chunk: int | None = None, in_flight: int | None = None, out: Any = None, progress: Progress | None = None, **options: Any) -> F64:  # fmt: skip
        """See :meth:`splitplane.Tree.signed_distance`."""
        return cast(F64, self._ask("signed_distance", source, chunk, in_flight, progress, out, options))


class SharedScene(SharedTree):
    """A scene on the workers of a cluster, as it was at its last update. Made by :func:`share`. As :class:`SharedTree`."""

    def closest_hits(self, source: Any, **options: Any) -> SceneHits:
        """See :meth:`splitplane.Scene.closest_hits`."""
        return cast(SceneHits, super().closest_hits(source, **options))

    def all_hits(self, source: Any, **options: Any) -> SceneCrossings:
        """See :meth:`splitplane.Scene.all_hits`. ``max_memory`` is that of a chunk."""
        return cast(SceneCrossings, super().all_hits(source, **options))

    def closest_points(self, source: Any, **options: Any) -> SceneClosestPoints:
        """See :meth:`splitplane.Scene.closest_points`."""
        return cast(SceneClosestPoints, super().closest_points(source, **options))


class SharedPointTree(_Shared):
    """A tree of points on the workers of a cluster. Made by :func:`share`. Workers build it again from its points. As :class:`SharedTree`."""

    _queries = {"nearest": ("queries", ()), "within": ("queries", ())}

    def nearest(self, source: Any, k: int = 1, *, chunk: int | None = None, in_flight: int | None = None, out: Any = None, progress: Progress | None = None, **options: Any) -> Neighbours:  # fmt: skip
        """See :meth:`splitplane.PointTree.nearest`. ``keep`` goes along with every chunk."""
        options = {"k": k, **options}
        return cast(Neighbours, self._ask("nearest", source, chunk, in_flight, progress, out, options))

    def within(self, source: Any, radius: float, *, chunk: int | None = None, in_flight: int | None = None, progress: Progress | None = None, **options: Any) -> NeighbourLists:  # fmt: skip
        """See :meth:`splitplane.PointTree.within`. ``keep`` goes along with every chunk, and ``max_memory`` is that of a chunk."""
        options = {"radius": radius, **options}
        return cast(NeighbourLists, self._ask("within", source, chunk, in_flight, progress, None, options))
