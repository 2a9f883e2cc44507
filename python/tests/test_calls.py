"""Threads, Ctrl-C, progress, processes, and what is left behind."""

from __future__ import annotations

import gc
import multiprocessing
import os
import subprocess
import sys
import threading
import time

import numpy as np
import pytest
from brute import sphere

import splitplane
from splitplane import PointTree, Scene, Tree

VERTICES, FACES = sphere(64, 48)


def rays_at(count: int) -> np.ndarray:
    rng = np.random.default_rng(2)
    origins, targets = rng.normal(size=(count, 3)) * 2, rng.normal(size=(count, 3)) * 0.4
    return np.concatenate([origins, targets - origins], axis=1).astype(np.float32)


def hard() -> tuple[Tree, np.ndarray]:
    """Work of many seconds, on any machine: every point asks a thousand faces, all as near."""
    tree = Tree.build(*sphere(128, 96))
    return tree, np.zeros((20_000_000, 3), np.float32)


def hard_rays(count: int) -> tuple[Tree, np.ndarray]:
    """The same for rays: each crosses two thousand faces that are one in space. Exact hits take some 0.1 ms."""
    faces = np.broadcast_to(np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], np.float32), (2000, 3, 3))
    return Tree.build(faces), np.broadcast_to(np.array([0.2, 0.2, 5, 0, 0, -1], np.float32), (count, 6)).copy()


@pytest.mark.parametrize("threads", [None, 1, 2])
def test_progress_is_called_by_the_caller(threads: int | None) -> None:
    calls: list[tuple[str, int, int, int]] = []

    def progress(stage: str, done: int, total: int) -> None:
        calls.append((stage, done, total, threading.get_ident()))

    tree = Tree.build(VERTICES, FACES, progress=progress)
    assert {call[3] for call in calls} == {threading.get_ident()} and calls[0][0] == "start"
    calls.clear()
    tree.closest_hits(rays_at(600_000), progress=progress, threads=threads)
    assert calls[-1][:3] == ("rays", 600_000, 600_000)
    done = [call[1] for call in calls]
    assert done == sorted(done)
    assert {call[3] for call in calls} == {threading.get_ident()} and calls[0][0] == "start"


@pytest.mark.parametrize("threads", [None, 1])
@pytest.mark.parametrize("kind", ["points", "rays"])
def test_what_progress_raises_ends_the_work(kind: str, threads: int | None) -> None:
    tree, asked = hard() if kind == "points" else hard_rays(2_000_000)

    class Enough(Exception):
        pass

    told = [0]

    def progress(stage: str, done: int, total: int) -> None:
        told[0] = done
        if done:
            raise Enough

    # CPU time, which other processes do not lengthen; the whole work takes minutes of it.
    begun = time.process_time()
    with pytest.raises(Enough):
        (tree.closest_points if kind == "points" else tree.closest_hits)(asked, progress=progress, threads=threads)
    assert time.process_time() - begun < 10 and 0 < told[0] < len(asked)
    assert tree.closest_points([0, 0, 3]).found.all()


@pytest.mark.parametrize("call", ["closest_points(asked)", "closest_hits(asked, accuracy='exact')", "closest_hits(asked, accuracy='exact', threads=1)"])
def test_ctrl_c_ends_the_work(call: str) -> None:
    code = f"""
import os, signal, sys, threading, time
sys.path.insert(0, sys.argv[1])
from test_calls import hard, hard_rays
tree, asked = hard() if "points" in {call!r} else hard_rays(2_000_000)
signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background jobs ignore it
try:
    threading.Timer(0.3, lambda: os.kill(os.getpid(), signal.SIGINT)).start()
    tree.{call}
except KeyboardInterrupt:
    print("interrupted", tree.closest_points([0, 0, 3]).found)
else:
    print("finished")
"""
    here = os.path.dirname(__file__)
    done = subprocess.run([sys.executable, "-c", code, here], capture_output=True, text=True, timeout=100)
    assert done.stdout.strip() == "interrupted True", done.stdout + done.stderr


def test_the_gil_is_released() -> None:
    tree, rays = Tree.build(VERTICES, FACES), rays_at(1_500_000)
    stop, ticks = threading.Event(), []

    def tick() -> None:
        while not stop.is_set():
            ticks.append(time.monotonic())
            time.sleep(0.005)

    other = threading.Thread(target=tick)
    other.start()
    begun = time.monotonic()
    tree.closest_hits(rays)
    ended = time.monotonic()
    stop.set()
    other.join()
    within = [at for at in ticks if begun < at < ended]
    assert len(within) >= 3 or ended - begun < 0.05


def test_threads_may_ask_one_tree() -> None:
    tree, rays = Tree.build(VERTICES, FACES), rays_at(20_000)
    expected = tree.closest_hits(rays)
    wrong: list[object] = []

    def ask(number: int) -> None:
        try:
            for _ in range(5):
                hits = tree.closest_hits(rays, threads=1 + number % 3)
                if not (np.array_equal(hits.t, expected.t) and np.array_equal(hits.triangle, expected.triangle)):
                    wrong.append(number)
        except BaseException as error:
            wrong.append(error)

    threads = [threading.Thread(target=ask, args=(number,)) for number in range(6)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not wrong


def test_changes_while_others_ask_are_refused_or_done() -> None:
    """A rebuild beside queries, edits and closing: answers of one of both meshes, or BusyError, or DeadHandleError."""
    tree, rays = Tree.build(VERTICES, FACES), rays_at(50_000)
    small, large = tree.closest_hits(rays).t, Tree.build(VERTICES * 2, FACES).closest_hits(rays).t
    busy, wrong = [0], []
    stop = threading.Event()

    def ask() -> None:
        while not stop.is_set():
            try:
                t = tree.closest_hits(rays).t
                if not (np.array_equal(t, small) or np.array_equal(t, large)):
                    wrong.append("neither")
            except splitplane.BusyError:
                busy[0] += 1
            except BaseException as error:
                wrong.append(repr(error))

    threads = [threading.Thread(target=ask) for _ in range(3)]
    for thread in threads:
        thread.start()
    for number in range(30):
        try:
            tree.rebuild(VERTICES * (1 + number % 2), FACES)
        except splitplane.BusyError:
            busy[0] += 1
    stop.set()
    for thread in threads:
        thread.join()
    assert not wrong, wrong[:3]


def test_a_callback_that_changes_its_own_tree_is_refused() -> None:
    tree = Tree.build(VERTICES, FACES)
    seen: list[type] = []

    def progress(stage: str, done: int, total: int) -> None:
        try:
            tree.rebuild(VERTICES)
        except splitplane.BusyError as error:
            seen.append(type(error))

    tree.closest_hits(rays_at(100_000), progress=progress)
    assert seen and set(seen) == {splitplane.BusyError}


def _in_child(queue: object, tree: Tree, rays: np.ndarray) -> None:
    hits = tree.closest_hits(rays)
    other = Tree.build(VERTICES, FACES)
    queue.put((hits.t.tobytes(), other.digest))  # type: ignore[attr-defined]


@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system does not fork")
@pytest.mark.filterwarnings("ignore::DeprecationWarning")
@pytest.mark.parametrize("method", ["fork", "spawn"])
def test_processes_that_are_forked_have_threads_of_their_own(method: str) -> None:
    tree, rays = Tree.build(VERTICES, FACES), rays_at(5000)
    expected = tree.closest_hits(rays)
    context = multiprocessing.get_context(method)
    queue = context.Queue()
    child = context.Process(target=_in_child, args=(queue, tree, rays))
    child.start()
    assert queue.get(timeout=60) == (expected.t.tobytes(), tree.digest)
    child.join(60)
    assert child.exitcode == 0


def resident() -> int:
    with open("/proc/self/statm") as file:
        return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE")


@pytest.mark.skipif(not os.path.exists("/proc/self/statm"), reason="this system does not tell its memory")
def test_nothing_is_left_of_ten_thousand_builds() -> None:
    vertices, faces = sphere(10, 7)
    rays, points = rays_at(40), rays_at(40)[:, :3]

    def do(count: int) -> None:
        scene = Scene()
        name = scene.add_geometry(vertices, faces)
        scene.add_instance(name)
        for number in range(count):
            tree = Tree.build(vertices, faces, threads=1)
            tree.closest_hits(rays, threads=1)
            tree.any_hits(rays[0])
            if number % 4 == 0:
                tree.all_hits(rays, threads=1)
                tree.closest_points(points, threads=1)
                tree.locate(points[:4], threads=1)
                cloud = PointTree.build(points, threads=1)
                cloud.nearest(points, 3, threads=1)
                cloud.within(points, 0.3, threads=1)
                scene.move_instance(0, np.eye(4) + np.eye(4, k=3) * number)
                scene.update(threads=1)
                scene.closest_hits(rays, threads=1)
                Tree.load(tree.to_bytes(), vertices, faces, threads=1)
                try:
                    tree.closest_hits(rays, accuracy="none")
                except splitplane.ConfigError:
                    pass

    do(500)
    gc.collect()
    objects, bytes_before = len(gc.get_objects()), resident()
    do(10_000)
    gc.collect()
    assert len(gc.get_objects()) - objects < 100
    # A tree and its answers are 50 KB: a hundredth of them left would be five megabytes.
    assert resident() - bytes_before < 4_000_000


def test_references_are_given_back() -> None:
    rays = rays_at(100)
    tree = Tree.build(VERTICES, FACES)

    def progress(stage: str, done: int, total: int) -> None:
        pass

    before = sys.getrefcount(rays), sys.getrefcount(progress), sys.getrefcount(VERTICES)
    for _ in range(50):
        tree.closest_hits(rays, progress=progress)
        Tree.build(VERTICES, FACES, progress=progress)
        with pytest.raises(splitplane.ConfigError):
            tree.closest_hits(rays, accuracy="none", progress=progress)
    assert (sys.getrefcount(rays), sys.getrefcount(progress), sys.getrefcount(VERTICES)) == before


