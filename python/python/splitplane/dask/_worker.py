"""What runs on workers."""

from __future__ import annotations

import asyncio
import shutil
import threading
import uuid
from pathlib import Path
from typing import Any, Callable

import distributed
import numpy as np
from distributed.diagnostics.plugin import WorkerPlugin

from .. import _native
from .._meshes import Meshes
from ..errors import CancelledError, ClusterError, DigestError, FileError
from ..points import _restored as points_restored
from ..scene import Scene
from ..tree import Tree, file_of


def parts_of(thing: Any) -> tuple[str, dict[str, Any], dict[str, Any]]:
    """A kind, what goes into files, and what else is to be known."""
    if isinstance(thing, Tree):
        files = {"tree": thing.to_bytes(), "vertices": thing.vertices, "faces": thing.faces}
        about = {
            "origin": thing.origin,
            "rounded": thing._rounded,
            "arguments": thing._arguments,
            "backend": thing._backend,
        }
        return "tree", files, about
    if isinstance(thing, Scene):
        return "scene", {"scene": thing.to_bytes()}, {"arguments": thing._arguments, "backend": thing._backend}
    return "points", {"points": thing.points}, {"origin": thing.origin, "axes": thing._axes}


def write(folder: Path, files: dict[str, Any]) -> None:
    """Writes files: bytes as they are, arrays as .npy."""
    folder.mkdir(parents=True)
    for name, content in files.items():
        if isinstance(content, np.ndarray):
            np.save(folder / f"{name}.npy", content)
        else:
            (folder / name).write_bytes(content)


def load(folder: Path, kind: str, about: dict[str, Any]) -> Any:
    """What was shared, from files, which are mapped."""

    def mapped(name: str) -> Any:
        array = np.load(folder / f"{name}.npy", mmap_mode="r")
        return array if array.size else np.array(array)

    if kind == "scene":
        scene = Scene.__new__(Scene)
        scene._own = _native.Scene.load(file_of(folder / "scene"), about["arguments"], about["backend"], (None, None))
        scene._arguments, scene._backend = about["arguments"], about["backend"]
        scene._meshes = Meshes({name: scene._own.mesh(name) for name in scene._own.geometries()})
        return scene
    if kind == "points":
        return points_restored(mapped("points"), about["origin"], about["axes"])
    vertices, faces = mapped("vertices"), mapped("faces")
    arguments, backend = about["arguments"], about["backend"]
    native = _native.Tree.load(file_of(folder / "tree"), vertices, faces, arguments, backend, (None, None))
    return Tree._of(native, vertices, faces, about["origin"], about["rounded"], arguments, backend)


class Keeper(WorkerPlugin):
    """Brings files to a worker, once, and whatever starts later; has them loaded once, when they are first needed."""

    def __init__(self, name: str, version: str, digest: str, kind: str, about: dict[str, Any], files: Any) -> None:
        """files: what to write in the worker's own folder, or the path of a folder that all workers see."""
        self.name = name
        self._version, self._digest, self._kind, self._about = version, digest, kind, about
        self._files = files
        self._folder: Path | None = None
        self._thing: Any = None
        self._lock: Any = None
        self.loads = 0

    async def setup(self, worker: Any) -> None:
        """Puts the files in place."""
        self._lock = threading.Lock()
        if isinstance(self._files, str):
            self._folder = Path(self._files)
            return
        folder = Path(worker.local_directory) / f"splitplane-{uuid.uuid4().hex}"
        await asyncio.to_thread(write, folder, self._files)
        self._folder, self._files = folder, None

    def teardown(self, worker: Any) -> None:
        """Gives memory and files back."""
        own = self._folder is not None and not isinstance(self._files, str)
        self._thing = None
        if own and self._folder is not None:
            shutil.rmtree(self._folder, ignore_errors=True)

    def thing(self) -> Any:
        """What was shared."""
        with self._lock:
            if self._thing is None:
                self._thing = self._loaded()
                self.loads += 1
            return self._thing

    def _loaded(self) -> Any:
        here, folder = distributed.get_worker().address, self._folder
        if self._version != _native.VERSION:
            text = f"the worker {here} has splitplane {_native.VERSION}, but {self._version} was shared from"
            raise ClusterError(text)
        assert folder is not None
        try:
            thing = load(folder, self._kind, self._about)
        except OSError as error:
            text = f"the worker {here} cannot read the files in {folder}: {error}. Does it see the folder that was given?"
            raise FileError(text) from error
        if thing.digest != self._digest:
            text = f"on the worker {here} the files in {folder} give the digest {thing.digest}, not {self._digest}, which was shared"
            raise DigestError(text)
        return thing


def keeper(name: str) -> Any:
    """The keeper of this worker."""
    plugin = distributed.get_worker().plugins.get(name)
    if plugin is None:
        raise ClusterError(f"the worker {distributed.get_worker().address} was not given what is shared as {name}; it may have been closed")
    return plugin


def until_cancelled() -> Callable[[str, int, int], None]:
    """A progress that ends the work when its task is no longer wanted."""
    worker = distributed.get_worker()
    key = worker.get_current_task()

    def progress(stage: str, done: int, total: int) -> None:
        task = worker.state.tasks.get(key)
        if task is None or task.state == "cancelled":
            raise CancelledError(f"the chunk {key} is no longer wanted")

    return progress


def answer(name: str, query: str, rows: Any, options: dict[str, Any], wanted: tuple[str, ...] | None) -> Any:
    """Answers a chunk. wanted: the columns that are sent back; none: all of the answer."""
    thing = keeper(name).thing()
    found = getattr(thing, query)(np.asarray(rows), progress=until_cancelled(), **options)
    return found if wanted is None else {column: getattr(found, column) for column in wanted}


class Maker(WorkerPlugin):
    """Brings what makes the frames of an animation to a worker."""

    def __init__(self, name: str, faces: Any, pose: Any, ask: Any, settings: dict[str, Any], threads: int | None) -> None:
        self.name = name
        self.faces, self.pose, self.ask, self.settings, self.threads = faces, pose, ask, settings, threads
        #: A tree for each thread of the worker that makes frames.
        self.trees: dict[int, Tree] = {}

    def teardown(self, worker: Any) -> None:
        """Gives memory back."""
        self.faces = self.pose = self.ask = None
        self.trees = {}


def frame(name: str, index: int, vertices: Any) -> Any:
    """Makes a frame: the tree of this thread is built again, over the frame's vertices."""
    maker, progress = keeper(name), until_cancelled()
    if maker.pose is not None:
        vertices = maker.pose(index)
    tree = maker.trees.get(threading.get_ident())
    if tree is None:
        tree = Tree.build(vertices, maker.faces, threads=maker.threads, progress=progress, **maker.settings)
        maker.trees[threading.get_ident()] = tree
    else:
        tree.rebuild(vertices, maker.faces, max_memory=maker.settings.get("max_memory"), threads=maker.threads, progress=progress)
    return maker.ask(tree, index)

