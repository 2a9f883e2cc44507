"""What is asked, in chunks: of an array, of a dask array, or of whatever gives arrays one after the other."""

from __future__ import annotations

import math
from typing import Any, Iterator, NamedTuple

import numpy as np

from .. import _arrays as arrays
from ..errors import ConfigError, DtypeError, ShapeError

#: Options of rays that may have one number for each.
LIMITS = ("t_min", "t_max")


class Part(NamedTuple):
    """A chunk."""

    #: Rows (m, columns), or a future of them.
    rows: Any
    #: Options of these rows.
    options: dict[str, Any]
    #: How many; none: not known.
    length: int | None


class Source(NamedTuple):
    """Chunks of what is asked."""

    parts: Iterator[Part]
    #: Of the answers; none: not known.
    leading: tuple[int, ...] | None


def is_dask(given: Any) -> bool:
    """Whether it is a collection of Dask's."""
    return callable(getattr(given, "__dask_graph__", None)) and hasattr(given, "rechunk")


def source_of(given: Any, name: str, columns: tuple[int, ...], chunk: int, options: dict[str, Any], client: Any) -> Source:
    """The chunks of what was given."""
    if is_dask(given):
        _without_limits(options, f"{name} is a dask array")
        return _of_dask(given, name, columns, chunk, options, client)
    if hasattr(given, "__next__") or (hasattr(given, "__iter__") and not hasattr(given, "__len__")):
        _without_limits(options, f"{name} comes piece by piece")
        return Source(_of_pieces(iter(given), name, columns, chunk, options), None)
    array = _checked(arrays.as_array(given, name), name, columns)
    leading = array.shape[:-1]
    limits = {key: arrays.as_array(options[key], key) for key in LIMITS if options.get(key) is not None}
    each = {}
    for key, limit in limits.items():
        if limit.ndim:
            try:
                each[key] = np.broadcast_to(limit, leading).reshape(-1)
            except ValueError:
                raise ShapeError(f"{key} has shape {limit.shape}, which does not fit rays of shape {leading}") from None
    return Source(_of_array(array.reshape(-1, array.shape[-1]), chunk, options, each), leading)


def _checked(array: Any, name: str, columns: tuple[int, ...]) -> Any:
    if array.dtype.kind not in "fiu":
        raise DtypeError(f"{name} has dtype {array.dtype}; numbers are needed: float32 is taken as it is, others are rounded")
    if array.ndim == 0 or array.shape[-1] not in columns:
        wanted = " or ".join(f"(..., {count})" for count in columns)
        raise ShapeError(f"{name} has shape {array.shape}, but must have {wanted}")
    return array


def _without_limits(options: dict[str, Any], why: str) -> None:
    for key in LIMITS:
        limit = options.get(key)
        if limit is not None and np.ndim(limit):
            raise ConfigError(f"{why}, so {key} must be one number; rays of 8 numbers have limits of their own")


def _of_array(rows: Any, chunk: int, options: dict[str, Any], each: dict[str, Any]) -> Iterator[Part]:
    for first in range(0, len(rows), chunk):
        here = slice(first, first + chunk)
        # A copy, as what is sent must not be a piece of a file that is mapped, nor change.
        own = np.array(rows[here], order="C")
        yield Part(own, {**options, **{key: np.array(limit[here]) for key, limit in each.items()}}, len(own))


def _of_pieces(
    pieces: Iterator[Any], name: str, columns: tuple[int, ...], chunk: int, options: dict[str, Any]
) -> Iterator[Part]:
    for piece in pieces:
        array = _checked(arrays.as_array(piece, name), name, columns)
        yield from _of_array(array.reshape(-1, array.shape[-1]), chunk, options, {})


def _of_dask(given: Any, name: str, columns: tuple[int, ...], chunk: int, options: dict[str, Any], client: Any) -> Source:
    _checked(given, name, columns)
    leading = given.shape[:-1]
    known = not any(math.isnan(length) for length in leading)
    rows = given.reshape(-1, given.shape[-1]) if given.ndim != 2 else given
    rows = rows.rechunk({0: chunk, 1: -1} if known else {1: -1})

    def parts() -> Iterator[Part]:
        lengths = rows.chunks[0]
        for place, length in enumerate(lengths):
            # Computed on the cluster; again, where the worker that has it dies.
            future = client.compute(rows.blocks[place].to_delayed().reshape(-1)[0])
            yield Part(future, options, int(length) if known else None)

    return Source(parts(), leading if known else None)
