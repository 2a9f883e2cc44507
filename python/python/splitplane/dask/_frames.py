"""Frames of an animation over the workers of a cluster."""

from __future__ import annotations

import uuid
from contextlib import closing
from typing import Any, Callable, Iterable, Iterator, Sized

import numpy as np

from .. import _arrays as arrays
from .._arrays import Progress
from .._options import build_arguments
from ..errors import ConfigError, DtypeError, ShapeError
from ..tree import Tree
from ._flow import Meter, client_of, in_order, most_under_way
from ._worker import Maker, frame


def frames(
    vertices: Any,
    ask: Callable[[Tree, int], Any],
    indices: Iterable[int] | None = None,
    *,
    faces: Any = None,
    client: Any = None,
    in_flight: int | None = None,
    threads: int | None = 1,
    progress: Progress | None = None,
    **settings: Any,
) -> Iterator[Any]:
    """Answers frame after frame, in order: on a worker, the tree is built over the frame's vertices, and ``ask(tree, frame)`` is called.

    vertices: an array (frames, n, 3), whose frames are sent one by one; or a function of the frame's index, which workers call.
    ask: what is wanted of a tree, for instance ``lambda tree, frame: tree.closest_hits(rays)``; what it returns is sent back. It goes to
    each worker once, with the arrays that it refers to.
    indices: which frames; none: all of the array. Any iterator will do.
    faces: (m, 3); none: vertices are separate triangles, (n, 3, 3) for each frame. They go to each worker once.
    in_flight, threads: as for :func:`share`. settings: those of :meth:`splitplane.Tree.build`, and the same for all frames.

    A worker builds its trees in the memory of the one before. They are those of a single build, bit for bit, on whichever worker.
    """
    own, call = client_of(client), arrays.maybe_whole(threads, "threads", 1, 1024)
    if not callable(ask):
        raise DtypeError(f"ask must be a function of a tree and a frame, not {type(ask).__name__}")
    if isinstance(settings.get("origin"), str):
        raise ConfigError("the origin of frames must be a point: it must not depend on which frame comes first")
    knobs = {name: value for name, value in settings.items() if name not in _BUILD}
    build_arguments(settings.get("preset", "fast"), settings.get("layout", "fast"), settings.get("max_memory"), knobs)
    pose = vertices if callable(vertices) else None
    stack = None if pose is not None else arrays.as_array(vertices, "vertices")
    if stack is not None and stack.ndim not in (3, 4):
        raise ShapeError(f"vertices has shape {stack.shape}, but must have (frames, n, 3) or (frames, n, 3, 3), or be a function of a frame")
    if indices is None:
        if stack is None:
            raise ConfigError("vertices is a function, so indices must say which frames are wanted")
        indices = range(len(stack))
    total = len(indices) if isinstance(indices, Sized) else 0
    index = None if faces is None else np.array(arrays.as_array(faces, "faces"))
    maker = Maker(f"splitplane-frames-{uuid.uuid4().hex}", index, pose, ask, settings, call)
    return _made(own, maker, stack, iter(indices), most_under_way(own, in_flight), Meter(progress, "frames", total))


#: Settings of a build that are not knobs of the builder.
_BUILD = ("preset", "layout", "backend", "adapter", "origin", "max_memory")


def _made(client: Any, maker: Maker, stack: Any, indices: Iterator[int], most: int, meter: Meter) -> Iterator[Any]:
    name = maker.name

    def submit(index: int) -> Any:
        vertices = None
        if stack is not None:
            vertices = np.array(stack[arrays.whole(index, "a frame", 0, len(stack) - 1)])
        return client.submit(frame, name, index, vertices, key=f"{name}-{uuid.uuid4().hex}", pure=False)

    meter.begin()
    client.register_plugin(maker, name=name)
    try:
        with closing(in_order(client, submit, indices, most, meter.waiting)) as answers:
            for _, answer in answers:
                meter.add(1)
                yield answer
    finally:
        client.unregister_worker_plugin(name)
