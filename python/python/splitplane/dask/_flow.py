"""Chunks under way: so many at a time, results in order, and what becomes of them when something fails."""

from __future__ import annotations

from collections import deque
from concurrent.futures import CancelledError as FutureCancelled
from typing import Any, Callable, Generator, Iterator

import dask
import distributed
from distributed.comm import CommClosedError
from distributed.scheduler import KilledWorker

from .._arrays import Progress, whole
from ..errors import ClusterError, DtypeError, SplitplaneError

#: How often the caller's progress is called while nothing arrives, in seconds.
BETWEEN = 0.2


def client_of(client: Any) -> distributed.Client:
    """The client that was given, or the one that is open."""
    if client is None:
        try:
            client = distributed.default_client()
        except ValueError as error:
            raise ClusterError("no client of a Dask cluster is open; open a dask.distributed.Client, or give one") from error
    if not isinstance(client, distributed.Client):
        raise DtypeError(f"client must be a dask.distributed.Client, not {type(client).__name__}")
    if client.asynchronous:
        raise ClusterError("the client is asynchronous; splitplane.dask needs one that waits")
    return client


def most_under_way(client: distributed.Client, in_flight: Any) -> int:
    """How many chunks may be under way: as given, or two for each thread of the cluster and two more."""
    if in_flight is not None:
        return whole(in_flight, "in_flight", 1)
    return 2 * int(sum(client.nthreads().values())) + 2


def in_order(
    client: distributed.Client,
    submit: Callable[[Any], distributed.Future],
    parts: Iterator[Any],
    most: int,
    waiting: Callable[[], object] | None,
) -> Generator[tuple[Any, Any], None, None]:
    """Each part with its result, in order. Not more than ``most`` are asked for and not yet given out.

    A worker that dies costs what it had: the scheduler gives that to others. What a part raises ends all, and so does whatever ends the
    caller: parts that are under way are then cancelled.
    """
    under_way: deque[tuple[Any, distributed.Future]] = deque()

    def fill() -> None:
        while len(under_way) < most:
            try:
                part = next(parts)
            except StopIteration:
                return
            # A chunk is larger than what Dask has in mind for the description of a task.
            with dask.config.set({"distributed.admin.large-graph-warning-threshold": "1 TB"}):
                under_way.append((part, submit(part)))

    try:
        fill()
        while under_way:
            result = _result(under_way[0][1], waiting)
            part, future = under_way.popleft()
            # A wait that timed out leaves references to the future in a cycle: workers would keep the answer until that is collected.
            future.release()
            fill()
            yield part, result
    finally:
        if under_way:
            client.cancel([future for _, future in under_way], force=True)


def _result(future: distributed.Future, waiting: Callable[[], object] | None) -> Any:
    try:
        while waiting is not None and not future.done():
            try:
                distributed.wait([future], timeout=BETWEEN)
            except TimeoutError:
                waiting()
        return future.result()
    except SplitplaneError:
        raise
    except KilledWorker as error:
        raise ClusterError(
            f"{error.allowed_failures + 1} workers died one after the other while they had the same chunk; the last was "
            f"{error.last_worker.address}. Workers that run out of memory end so: try a smaller chunk"
        ) from error
    except (FutureCancelled, CommClosedError) as error:
        raise ClusterError(f"the cluster gave no answer: {error}") from error


class Meter:
    """Calls the caller's progress: from where parts were asked for, so what it raises ends the work."""

    def __init__(self, progress: Progress | None, stage: str, total: int) -> None:
        if progress is not None and not callable(progress):
            raise DtypeError(f"progress must be callable, not {type(progress).__name__}")
        self._progress, self._stage, self._total, self._done = progress, stage, total, 0

    @property
    def waiting(self) -> Callable[[], object] | None:
        """What is called while nothing arrives."""
        return None if self._progress is None else lambda: self.add(0)

    def begin(self) -> None:
        """Nothing is done yet."""
        if self._progress is not None:
            self._progress("start", 0, 0)

    def add(self, count: int) -> None:
        """So many more are done."""
        self._done += count
        if self._progress is not None:
            self._progress(self._stage, self._done, self._total)
