"""Settings by name."""

from __future__ import annotations

from typing import Any, Dict, Tuple

import numpy as np

from ._arrays import MISS, U32, as_array, maybe_whole, memory, text, whole
from .errors import ConfigError, DtypeError, RangeError, ShapeError

#: Builders, and the preset that has each.
BUILDERS = {"median": "fast", "binned": "balanced", "sweep": "best"}

BuildArguments = Tuple[str, Dict[str, int], str, "int | None"]
Backend = Tuple[str, "str | None"]


def is_auto(preset: Any, rays: Any, backend: Any, knobs: dict[str, Any]) -> bool:
    """Whether the preset is to be chosen, and nothing speaks against it."""
    if not isinstance(preset, str) or preset != "auto":
        if rays is not None:
            raise ConfigError("rays is what preset auto chooses by; leave it out")
        return False
    if rays is None:
        raise ConfigError("preset auto chooses by the number of rays; give it as rays")
    whole(rays, "rays", 0, 2**64 - 1)
    if backend == "wgpu":
        raise ConfigError("preset auto chooses by measurements of the CPU; name a preset for a GPU")
    if knobs:
        raise ConfigError("preset auto chooses a preset as it is; name one to change its knobs")
    return True


def build_arguments(preset: Any, layout: Any, max_memory: Any, knobs: dict[str, Any]) -> BuildArguments:
    """A preset, knobs, a layout and a limit of memory."""
    if isinstance(preset, str) and preset == "auto":
        raise ConfigError("preset auto is of Tree.build, for one mesh and its rays; name a preset")
    builder = knobs.pop("builder", None)
    if builder is not None:
        if builder not in BUILDERS:
            raise ConfigError(f"there is no builder `{builder}`; there are median, binned and sweep")
        if preset not in ("fast", BUILDERS[builder]):
            raise ConfigError(f"preset {preset} has another builder than {builder}")
        preset = BUILDERS[builder]
    numbers = {}
    for name, value in knobs.items():
        if name == "clip" and isinstance(value, (bool, np.bool_)):
            numbers[name] = int(value)
        else:
            numbers[name] = whole(value, name)
    return text(preset, "preset"), numbers, text(layout, "layout"), memory(max_memory)


def backend_arguments(backend: Any, adapter: Any) -> Backend:
    """A backend and perhaps a device, by name."""
    return text(backend, "backend"), None if adapter is None else text(adapter, "adapter")


def query_arguments(accuracy: Any, culling: Any, ignore: Any) -> tuple[str, str, int | None]:
    """The settings of a query of a tree."""
    if type(accuracy) is str and type(culling) is str and ignore is None:
        return accuracy, culling, None
    return text(accuracy, "accuracy"), text(culling, "culling"), maybe_whole(ignore, "ignore")


def ignored_instance(ignore: Any) -> tuple[int, int] | None:
    """A triangle of an instance, or none."""
    if ignore is None:
        return None
    if not isinstance(ignore, (tuple, list)) or len(ignore) != 2:
        raise DtypeError("ignore must be a pair: an instance and a triangle of it")
    instance, triangle = whole(ignore[0], "ignore"), whole(ignore[1], "ignore")
    if triangle == MISS:
        raise RangeError("ignore names all of an instance, which lists for rays can; here it names one triangle. To leave an instance out, take mask")
    return instance, triangle


def ignored_list(ignore: Any) -> tuple[int, int] | U32 | None:
    """A triangle of an instance, rows of such pairs, or none."""
    if ignore is None:
        return None
    if isinstance(ignore, (tuple, list)) and len(ignore) == 2 and all(np.ndim(part) == 0 for part in ignore):
        instance, triangle = (whole(part, "ignore") for part in ignore)
        # A list, since one pair names a triangle: none has this name.
        return np.array([(instance, MISS)], np.uint32) if triangle == MISS else (instance, triangle)
    pairs = as_array(ignore, "ignore")
    if pairs.size == 0 and pairs.ndim == 1 and not isinstance(ignore, np.ndarray):
        return np.zeros((0, 2), np.uint32)
    if pairs.dtype.kind not in "iu":
        raise DtypeError(f"ignore has dtype {pairs.dtype}, but names must be whole numbers")
    if pairs.ndim != 2 or pairs.shape[1] != 2:
        raise ShapeError(f"ignore has shape {pairs.shape}, but must be a pair or have (k, 2): an instance and a triangle of it")
    if pairs.size and (int(pairs.min()) < 0 or int(pairs.max()) > MISS):
        raise RangeError(f"ignore has numbers from {int(pairs.min())} to {int(pairs.max())}, but names are from 0 to {MISS}")
    return np.require(pairs.astype(np.uint32), np.uint32, ["C", "A"])
