"""What comes in, as arrays of the form that the compiled part reads; and room for what goes out."""

from __future__ import annotations

import operator
from typing import Any, Callable, Tuple

import numpy as np
import numpy.typing as npt

from .errors import DtypeError, MeshError, OutOfMemoryError, RangeError, ShapeError

F32 = npt.NDArray[np.float32]
F64 = npt.NDArray[np.float64]
U32 = npt.NDArray[np.uint32]
I32 = npt.NDArray[np.int32]
I64 = npt.NDArray[np.int64]
Bool = npt.NDArray[np.bool_]
Progress = Callable[[str, int, int], object]

#: The index of no triangle, geometry, instance or point.
MISS = 0xFFFFFFFF


def as_array(value: Any, name: str) -> npt.NDArray[Any]:
    """An array of what was given: a numpy array, anything with ``__dlpack__``, or nested lists."""
    if isinstance(value, np.ma.MaskedArray):
        raise DtypeError(f"{name} is a masked array; fill or compress it first")
    if isinstance(value, np.ndarray):
        return np.asarray(value)
    if hasattr(value, "__dlpack__"):
        try:
            return np.from_dlpack(value)
        except Exception as error:
            raise DtypeError(f"{name} cannot be taken through DLPack: {error}") from error
    try:
        return np.asarray(value)
    except ValueError as error:
        raise ShapeError(f"{name} is not an array: {error}") from error
    except Exception as error:
        raise DtypeError(f"{name} is not an array: {error}") from error


def floats(
    value: Any, name: str, columns: tuple[int, ...], origin: F64 | None = None, shifted: int | None = None
) -> tuple[F32, tuple[int, ...], int]:
    """Rows of float32 (n, columns), the leading shape, and how many numbers were rounded.

    float32 is taken as it is where it is contiguous. Other kinds of numbers are rounded to it, after ``origin`` was taken
    from the first ``shifted`` columns.
    """
    array = as_array(value, name)
    if array.dtype.kind not in "fiu":
        raise DtypeError(f"{name} has dtype {array.dtype}; numbers are needed: float32 is taken as it is, others are rounded")
    if array.ndim == 0 or array.shape[-1] not in columns:
        wanted = " or ".join(f"(..., {count})" for count in columns)
        raise ShapeError(f"{name} has shape {array.shape}, but must have {wanted}")
    leading = array.shape[:-1]
    count = array.shape[-1]
    if origin is None and array.dtype == np.float32:
        own = np.require(array, np.float32, ["C", "A"])
        return own.reshape(-1, count), leading, 0
    wide = np.asarray(array, dtype=np.float64)
    if origin is not None:
        wide = np.array(wide, dtype=np.float64, order="C")
        wide[..., :shifted] -= origin
    narrow, rounded = narrowed(wide, name)
    return narrow.reshape(-1, count), leading, rounded


def narrowed(wide: F64, name: str) -> tuple[F32, int]:
    """float64 as float32, and how many were not float32 before."""
    try:
        with np.errstate(over="raise", invalid="ignore", under="ignore"):
            narrow = np.ascontiguousarray(wide.astype(np.float32))
    except FloatingPointError:
        raise RangeError(f"{name} has numbers beyond the greatest float32, 3.4e38") from None
    same = (narrow == wide) | np.isnan(wide)
    return narrow, int(same.size - np.count_nonzero(same))


def faces_of(value: Any, vertices: int) -> U32:
    """Faces (n, 3) as uint32; a new array."""
    array = as_array(value, "faces")
    if array.size == 0 and array.dtype.kind == "f" and array.ndim <= 2 and not isinstance(value, np.ndarray):
        return np.zeros((0, 3), np.uint32)
    if array.dtype.kind not in "iu":
        raise DtypeError(f"faces has dtype {array.dtype}, but indices must be whole numbers")
    if array.ndim != 2 or array.shape[1] != 3:
        raise ShapeError(f"faces has shape {array.shape}, but must have (n, 3)")
    if array.size and array.dtype.kind == "i" and int(array.min()) < 0:
        raise MeshError(f"faces has the index {int(array.min())}, but the least is 0")
    if array.size and array.dtype.itemsize > 4 and int(array.max()) > MISS:
        raise MeshError(f"faces has the index {int(array.max())}, but there are {vertices} vertices")
    return np.array(array, dtype=np.uint32, order="C")


def mesh_of(vertices: Any, faces: Any, origin: F64 | None) -> tuple[F32, U32, int]:
    """Vertices and faces, copied and read-only, and how many coordinates were rounded."""
    if faces is None:
        soup = as_array(vertices, "vertices")
        if soup.ndim != 3 or soup.shape[1:] != (3, 3):
            raise ShapeError(f"without faces, vertices must have shape (n, 3, 3), not {soup.shape}")
        own, _, rounded = floats(soup, "vertices", (3,), origin, 3)
        index = np.arange(len(own), dtype=np.uint32).reshape(-1, 3)
    else:
        array = as_array(vertices, "vertices")
        if array.size == 0 and array.ndim == 1:
            array = np.zeros((0, 3), np.float32)
        if array.ndim != 2:
            raise ShapeError(f"vertices has shape {array.shape}, but must have (n, 3)")
        own, _, rounded = floats(array, "vertices", (3,), origin, 3)
        index = faces_of(faces, len(own))
    own = np.array(own, dtype=np.float32, order="C")
    own.flags.writeable = False
    index.flags.writeable = False
    return own, index, rounded


def origin_of(origin: Any, vertices: Any) -> F64 | None:
    """The shift: none, the middle of the vertices' box ('center'), or a point."""
    if origin is None:
        return None
    if isinstance(origin, str):
        if origin != "center":
            from .errors import ConfigError

            raise ConfigError(f"there is no origin `{origin}`; there are 'center', a point, and None")
        array = as_array(vertices, "vertices")
        if array.dtype.kind not in "fiu":
            raise DtypeError(f"vertices has dtype {array.dtype}; numbers are needed")
        if array.ndim < 2 or array.size == 0 or array.shape[-1] > 4:
            return None
        flat = np.asarray(array, dtype=np.float64).reshape(-1, array.shape[-1])
        flat = flat[np.isfinite(flat).all(axis=1)]
        if len(flat) == 0:
            return None
        return np.asarray(flat.min(axis=0) / 2 + flat.max(axis=0) / 2, dtype=np.float64)
    point = as_array(origin, "origin")
    if point.dtype.kind not in "fiu" or point.ndim != 1:
        raise ShapeError(f"origin must be a point, not an array of {point.dtype} of shape {point.shape}")
    if not np.isfinite(point).all():
        raise RangeError("origin must be finite")
    return np.asarray(point, dtype=np.float64)


Limit = Any


def limit(value: Any, name: str, leading: tuple[int, ...]) -> float | F32:
    """A limit of t: a number, or an array of the rays' leading shape."""
    array = as_array(value, name)
    if array.dtype.kind not in "fiu":
        raise DtypeError(f"{name} has dtype {array.dtype}; numbers are needed")
    if array.ndim == 0:
        return float(narrowed(np.asarray(array, np.float64), name)[0].reshape(-1)[0])
    if array.dtype != np.float32:
        array = narrowed(np.asarray(array, np.float64), name)[0]
    try:
        whole = np.broadcast_to(array, leading)
    except ValueError:
        raise ShapeError(f"{name} has shape {array.shape}, which does not fit rays of shape {leading}") from None
    return np.require(whole, np.float32, ["C", "A"]).reshape(-1)


def number(value: Any, name: str) -> float:
    """A distance as a float32 can hold it; infinity is one."""
    if value is None or isinstance(value, (bool, str, bytes)):
        raise DtypeError(f"{name} must be a number, not {value!r}")
    try:
        wide = np.float64(value)
    except Exception:
        raise DtypeError(f"{name} must be a number, not {type(value).__name__}") from None
    if wide.ndim:
        raise ShapeError(f"{name} must be one number")
    return float(narrowed(np.asarray(wide), name)[0].reshape(-1)[0])


def whole(value: Any, name: str, least: int = 0, most: int = MISS) -> int:
    """A whole number within a range."""
    if isinstance(value, (bool, np.bool_)):
        raise DtypeError(f"{name} must be a whole number, not {value!r}")
    try:
        index = operator.index(value)
    except TypeError:
        raise DtypeError(f"{name} must be a whole number, not {type(value).__name__}") from None
    if not least <= index <= most:
        raise RangeError(f"{name} is {index}, but must be from {least} to {most}")
    return index


def maybe_whole(value: Any, name: str, least: int = 0, most: int = MISS) -> int | None:
    """The same, or none."""
    return None if value is None else whole(value, name, least, most)


def text(value: Any, name: str) -> str:
    """A name."""
    if not isinstance(value, str):
        raise DtypeError(f"{name} must be a string, not {type(value).__name__}")
    return value


def memory(value: Any) -> int | None:
    """A limit of bytes, or none."""
    return maybe_whole(value, "max_memory", 0, 2**64 - 1)


Call = Tuple["int | None", "Progress | None"]


def call(threads: Any, progress: Any) -> Call:
    """How a long call is done."""
    if progress is None and (threads is None or (type(threads) is int and 1 <= threads <= 1024)):
        return threads, None
    if progress is not None and not callable(progress):
        raise DtypeError(f"progress must be callable, not {type(progress).__name__}")
    return maybe_whole(threads, "threads", 1, 1024), progress


def room(shape: tuple[int, ...], dtype: Any) -> npt.NDArray[Any]:
    """An array for results."""
    try:
        return np.empty(shape, dtype)
    except (MemoryError, ValueError) as error:
        raise OutOfMemoryError(f"there is no memory for results of shape {shape}: {error}") from error


def _share(one: npt.NDArray[Any], other: npt.NDArray[Any]) -> bool:
    """Whether strided arrays share memory. Where finding out takes long, whether their ranges overlap."""
    # Numpy takes any number; its types know two.
    max_work: Any = 10_000
    try:
        return bool(np.shares_memory(one, other, max_work=max_work))
    except RuntimeError:
        return bool(np.may_share_memory(one, other))


def given(
    columns: dict[str, Any], leading: tuple[int, ...], dtypes: tuple[Any, ...], asked: npt.NDArray[Any], strided: bool = False
) -> list[npt.NDArray[Any]]:
    """Arrays of the caller's that take results of a shape, flat unless they may be strided. They must not overlap, nor what is asked."""
    own: list[npt.NDArray[Any]] = []
    shares = _share if strided else np.may_share_memory
    for (name, array), dtype in zip(columns.items(), dtypes):
        if not isinstance(array, np.ndarray) or array.dtype != dtype:
            found = array.dtype if isinstance(array, np.ndarray) else type(array).__name__
            raise DtypeError(f"{name} must be an array of {np.dtype(dtype)}, not {found}")
        if array.shape != leading:
            raise ShapeError(f"{name} has shape {array.shape}, but results have {leading}")
        if not array.flags.aligned or not array.flags.writeable or not (strided or array.flags.c_contiguous):
            wanted = "aligned and writeable" if strided else "contiguous in the order of C, aligned, and writeable"
            raise ShapeError(f"{name} must be {wanted}")
        if any(stride == 0 and length > 1 for stride, length in zip(array.strides, array.shape)):
            raise ShapeError(f"{name} has elements that are one in memory")
        if any(shares(array, other) for other in (asked, *own)):
            raise ShapeError(f"{name} overlaps another array of this call")
        own.append(array if strided else array.reshape(-1))
    return own
