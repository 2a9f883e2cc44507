"""Answers of chunks as one."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from .. import _arrays as arrays
from ..errors import ConfigError, DtypeError, ShapeError
from ..results import Report

#: Fields of answers that are counts, and that which says where lists begin. All others are columns.
_COUNTS, _STARTS = ("report", "rounded"), "starts"


def columns_of(answer: Any) -> list[str]:
    """The names of the columns of an answer; none where it is an array."""
    if not dataclasses.is_dataclass(answer):
        return []
    return [field.name for field in dataclasses.fields(answer) if field.name not in (*_COUNTS, _STARTS)]


def has_lists(answer: Any) -> bool:
    """Whether rows have as many answers as they like."""
    return hasattr(answer, _STARTS)


class Outputs:
    """Arrays of the caller's that take answers."""

    def __init__(self, out: Any, nothing: Any, count: int | None) -> None:
        """nothing: the answer to no rows. count: of the rows, if it is known."""
        if has_lists(nothing):
            raise ConfigError("this query gives lists of any length, which no array can be made for: use stream()")
        names = columns_of(nothing)
        if names and not isinstance(out, dict):
            raise ConfigError(f"out must be a dict of arrays, by some of the names {', '.join(names)}")
        given = out if names else {"": out}
        unknown = [name for name in given if names and name not in names]
        if not given:
            raise ConfigError(f"out names no column; there are {', '.join(names)}")
        if unknown:
            raise ConfigError(f"there is no column {', '.join(map(str, unknown))}; there are {', '.join(names)}")
        self.out, self.wanted = out, tuple(given) if names else None
        self._rows: dict[str, Any] = {}
        for name, array in given.items():
            shape = getattr(nothing, name).shape[1:] if name else nothing.shape[1:]
            dtype = getattr(nothing, name).dtype if name else nothing.dtype
            self._rows[name] = _row_view(array, name or "out", shape, dtype, count)
        self.count = count if count is not None else min(len(rows) for rows in self._rows.values())

    def put(self, first: int, answer: Any) -> int:
        """Writes the answers of a chunk; how many there were."""
        length = 0
        for name, rows in self._rows.items():
            column = answer[name] if name else answer
            length = len(column)
            if first + length > len(rows):
                raise ShapeError(f"{name or 'out'} has room for {len(rows)} answers, but there are more")
            rows[first : first + length] = column
        return length


def _row_view(array: Any, name: str, shape: tuple[int, ...], dtype: Any, count: int | None) -> Any:
    if not isinstance(array, np.ndarray):
        raise DtypeError(f"{name} must be a numpy array, not {type(array).__name__}")
    if array.dtype != dtype:
        raise DtypeError(f"{name} has dtype {array.dtype}, but must have {dtype}")
    if array.ndim <= len(shape) or array.shape[array.ndim - len(shape) :] != shape:
        wanted = ", ".join(["...", *map(str, shape)])
        raise ShapeError(f"{name} has shape {array.shape}, but must have ({wanted})")
    if not array.flags.c_contiguous:
        raise ShapeError(f"{name} must be contiguous")
    if not array.flags.writeable:
        raise DtypeError(f"{name} is read-only")
    rows = array.reshape(-1, *shape)
    if count is not None and len(rows) != count:
        raise ShapeError(f"{name} has room for {len(rows)} answers, but {count} are asked for")
    return rows


class Whole:
    """Puts answers of chunks together."""

    def __init__(self, nothing: Any, count: int | None) -> None:
        self._nothing, self._count = nothing, count
        self._names = columns_of(nothing)
        self._kept: Any = None if count is None or has_lists(nothing) else self._room(count)
        self._parts: list[Any] = []
        self._counts: dict[str, Any] = {}

    def _column(self, answer: Any, name: str) -> Any:
        return getattr(answer, name) if name else answer

    def _room(self, count: int) -> dict[str, Any]:
        room = {}
        for name in self._names or [""]:
            like = self._column(self._nothing, name)
            room[name] = arrays.room((count, *like.shape[1:]), like.dtype)
        return room

    def put(self, first: int, answer: Any) -> int:
        """Takes the answers of a chunk; how many rows it had."""
        self._add(answer)
        if self._kept is None:
            self._parts.append(answer)
            if has_lists(answer):
                return len(answer.starts) - 1
            return len(self._column(answer, self._names[0] if self._names else ""))
        length = 0
        for name, room in self._kept.items():
            column = self._column(answer, name)
            length = len(column)
            room[first : first + length] = column
        return length

    def _add(self, answer: Any) -> None:
        for name in _COUNTS:
            own = getattr(answer, name, None)
            if own is not None:
                before = self._counts.get(name)
                if name == "report":
                    self._counts[name] = Report(*map(sum, zip(before or Report(), own)))
                else:
                    self._counts[name] = (before or 0) + own

    def finish(self, leading: tuple[int, ...] | None) -> Any:
        """The answer of all."""
        columns: dict[str, Any] = {}
        parts = [self._nothing, *self._parts]
        if has_lists(self._nothing):
            ends = np.cumsum([0, *(part.starts[-1] for part in parts)])
            starts = [part.starts[1:] + end for part, end in zip(parts, ends)]
            columns[_STARTS] = np.concatenate([np.zeros(1, np.int64), *starts])
        for name in self._names or [""]:
            if self._kept is not None:
                columns[name] = self._kept[name]
            else:
                columns[name] = np.concatenate([self._column(part, name) for part in parts])
            if leading is not None and not has_lists(self._nothing):
                columns[name] = columns[name].reshape((*leading, *columns[name].shape[1:]))
        if not self._names:
            return columns[""]
        return dataclasses.replace(self._nothing, **columns, **self._counts)
