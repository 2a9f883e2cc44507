"""Batches and frames over the workers of a cluster of two processes: bytes, order, deaths, mistakes, and how much is under way."""

from __future__ import annotations

import dataclasses
import gc
import os
import pickle
import signal
import sys
import threading
import time
from pathlib import Path
from typing import Any, Iterator

import numpy as np
import pytest
from brute import sphere

pytest.importorskip("distributed", reason="dask[distributed] is not installed")
# What Dask and its threads leave behind is theirs; ours is still an error.
pytestmark = [pytest.mark.filterwarnings("ignore::ResourceWarning", "ignore:.*unraisable.*")]

import dask  # noqa: E402
from distributed import Client, LocalCluster  # noqa: E402

import splitplane  # noqa: E402
import splitplane.dask  # noqa: E402
from splitplane import PointTree, Scene, Tree  # noqa: E402
from splitplane.dask import _flow, frames, share  # noqa: E402

VERTICES, FACES = sphere(24, 16)
ORIGIN = np.array([500_000.0, -3.0, 20.0])


def points_at(count: int, seed: int = 1) -> np.ndarray:
    return (np.random.default_rng(seed).normal(size=(count, 3)) * 0.8).astype(np.float32)


def rays_at(count: int) -> np.ndarray:
    origins, targets = points_at(count, 2) * 2, points_at(count, 3) * 0.4
    return np.concatenate([origins, targets - origins], axis=1)


def wait_for_workers(client: Client, count: int) -> None:
    """Until so many workers answer. Dask's own wait goes by a list that loses its place when workers come and go quickly."""
    deadline = time.monotonic() + 300
    while len(client.run(os.getpid, on_error="ignore")) < count:
        assert time.monotonic() < deadline, "workers that died have not come back"
        time.sleep(0.05)


@pytest.fixture(scope="module")
def client(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Client]:
    where = {"temporary-directory": str(tmp_path_factory.mktemp("dask")), "distributed.scheduler.allowed-failures": 1}
    with dask.config.set(where):
        with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=":0", memory_limit=0) as cluster:
            with Client(cluster) as client:
                client.run(_see_tests, str(Path(__file__).parent))
                yield client


def _see_tests(folder: str) -> None:
    sys.path.insert(0, folder)


def assert_same(found: Any, expected: Any) -> None:
    """The same class, dtypes, shapes and bytes."""
    assert type(found) is type(expected)
    if isinstance(expected, np.ndarray):
        assert (found.dtype, found.shape, found.tobytes()) == (expected.dtype, expected.shape, expected.tobytes())
    elif dataclasses.is_dataclass(expected):
        for field in dataclasses.fields(expected):
            assert_same(getattr(found, field.name), getattr(expected, field.name))
    else:
        assert found == expected


@pytest.fixture(scope="module")
def scene() -> Scene:
    scene = Scene()
    ball = scene.add_geometry(VERTICES, FACES)
    for place in range(3):
        matrix = np.eye(4)
        matrix[:3, 3] = [0.7 * place, 0.1, 0]
        scene.add_instance(ball, matrix, mask=1 << place)
    scene.update()
    return scene


@pytest.mark.parametrize("chunk", [10_000, 1000, 37])
def test_answers_are_those_of_one_machine_whatever_the_chunks(client: Client, chunk: int) -> None:
    tree, few = Tree.build(VERTICES, FACES), 400 if chunk == 37 else 5000
    rays, points = rays_at(few), points_at(few)
    limits = np.linspace(0.5, 2, few).astype(np.float32)
    with share(tree, client, chunk=chunk) as shared:
        assert shared.digest == tree.digest
        assert_same(shared.closest_hits(rays), tree.closest_hits(rays))
        assert_same(shared.closest_hits(rays, t_max=limits, culling="back"), tree.closest_hits(rays, t_max=limits, culling="back"))
        assert_same(shared.any_hits(rays, t_min=0.25), tree.any_hits(rays, t_min=0.25))
        assert_same(shared.all_hits(rays), tree.all_hits(rays))
        assert_same(shared.count_hits(rays), tree.count_hits(rays))
        assert_same(shared.closest_points(points), tree.closest_points(points))
        assert_same(shared.locate(points), tree.locate(points))
        assert_same(shared.contains(points, rule="evenodd"), tree.contains(points, rule="evenodd"))
        assert_same(shared.signed_distance(points), tree.signed_distance(points))


def test_scenes_and_clouds(client: Client, scene: Scene) -> None:
    rays, points = rays_at(1500), points_at(1500)
    with share(scene, client, chunk=400) as shared:
        for query, asked in [("closest_hits", rays), ("any_hits", rays), ("all_hits", rays), ("count_hits", rays), ("locate", points), ("closest_points", points), ("signed_distance", points)]:  # fmt: skip
            assert_same(getattr(shared, query)(asked), getattr(scene, query)(asked))
        assert_same(shared.closest_hits(rays, mask=2, ignore=(1, 3)), scene.closest_hits(rays, mask=2, ignore=(1, 3)))
    for cloud in [points_at(500), points_at(500)[:, :2]]:
        tree, queries = PointTree.build(cloud, origin="center"), cloud[::-1] + np.float32(0.01)
        keep = np.arange(500) % 3 > 0
        with share(tree, client, chunk=93) as shared:
            assert_same(shared.nearest(queries, 4, keep=keep), tree.nearest(queries, 4, keep=keep))
            assert_same(shared.within(queries, 0.3), tree.within(queries, 0.3))


def test_shapes_origins_and_nothing(client: Client) -> None:
    tree = Tree.build(VERTICES + ORIGIN, FACES, origin=ORIGIN)
    rays = rays_at(600).astype(np.float64) / 3
    rays[:, :3] += ORIGIN
    image = rays.reshape(20, 30, 6)
    with share(tree, client, chunk=101) as shared:
        hits = shared.closest_hits(image)
        assert hits.t.shape == (20, 30) and hits.report.rounded > 0
        assert_same(hits, tree.closest_hits(image))
        assert_same(shared.closest_hits(image[0, 0]), tree.closest_hits(image[0, 0]))
        for query in ("closest_hits", "all_hits", "any_hits"):
            assert_same(getattr(shared, query)(rays[:0]), getattr(tree, query)(rays[:0]))


def test_sources_and_outputs(client: Client, tmp_path: Path) -> None:
    array = pytest.importorskip("dask.array", reason="dask.array is not there")
    tree, rays = Tree.build(VERTICES, FACES), rays_at(4000)
    expected = tree.closest_hits(rays)
    np.save(tmp_path / "rays.npy", rays)
    mapped = np.load(tmp_path / "rays.npy", mmap_mode="r")
    out = {"t": np.lib.format.open_memmap(tmp_path / "t.npy", "w+", np.float32, (4000,)), "triangle": np.empty(4000, np.uint32)}
    with share(tree, client, chunk=600) as shared:
        assert shared.closest_hits(mapped, out=out) is out
        out["t"].flush()
        assert np.load(tmp_path / "t.npy").tobytes() == expected.t.tobytes() and (out["triangle"] == expected.triangle).all()
        lazy = array.from_array(rays, chunks=(900, 3))
        assert_same(shared.closest_hits(lazy), expected)
        unknown = lazy[lazy[:, 0] > 0]
        assert_same(shared.closest_hits(unknown), tree.closest_hits(rays[rays[:, 0] > 0]))
        pieces = [rays[:1700], rays[1700:1701], rays[1701:]]
        assert_same(shared.closest_hits(iter(pieces)), expected)
        some = np.empty(4000, np.bool_)
        assert shared.any_hits(iter(pieces), out=some) == 4000 and (some == tree.any_hits(rays)).all()
        streamed = list(shared.stream("closest_hits", iter(pieces)))
        assert [len(hits.t) for hits in streamed] == [600, 600, 500, 1, 600, 600, 600, 499]
        assert np.concatenate([hits.t for hits in streamed]).tobytes() == expected.t.tobytes()
        with pytest.raises(splitplane.ShapeError, match="room for 10"):
            shared.any_hits(iter(pieces), out=some[:10])
        wrong: list[tuple[type, str, Any]] = [
            (splitplane.DtypeError, "float64", {"t": np.empty(4000)}),
            (splitplane.ShapeError, "3999 answers, but 4000", {"t": np.empty(3999, np.float32)}),
            (splitplane.ConfigError, "there are t, triangle, u, v", {"T": np.empty(4000, np.float32)}),
            (splitplane.ConfigError, "must be a dict", np.empty(4000, np.float32)),
        ]
        for error, text, given in wrong:
            with pytest.raises(error, match=text):
                shared.closest_hits(rays, out=given)


def test_a_worker_that_dies_costs_no_answer(client: Client) -> None:
    tree, rays = Tree.build(*sphere(64, 48)), rays_at(60_000)
    expected = tree.closest_hits(rays, accuracy="exact")
    before = set(client.run(os.getpid).values())
    killed: list[int] = []

    def progress(stage: str, done: int, total: int) -> None:
        if done >= 12_000 and not killed:
            killed.append(next(iter(client.run(os.getpid).values())))
            os.kill(killed[0], signal.SIGKILL)

    with share(tree, client, chunk=2000) as shared:
        assert_same(shared.closest_hits(rays, accuracy="exact", progress=progress), expected)
        wait_for_workers(client, 2)
        assert killed and killed[0] in before and killed[0] not in client.run(os.getpid).values()
        # Whoever came in its place has the tree too.
        assert_same(shared.closest_hits(rays, accuracy="exact"), expected)


class Deadly:
    """Asked for on a worker, it kills it."""

    def __call__(self, tree: Tree, frame: int) -> int:
        os.kill(os.getpid(), signal.SIGKILL)
        return frame


def test_a_chunk_that_kills_its_workers_ends_in_a_typed_error(client: Client) -> None:
    with pytest.raises(splitplane.ClusterError, match="2 workers died one after the other"):
        list(frames(VERTICES[None], Deadly(), faces=FACES, client=client))
    wait_for_workers(client, 2)


def test_a_tree_goes_once_to_a_worker_and_is_loaded_once(client: Client, tmp_path: Path) -> None:
    tree, rays = Tree.build(VERTICES, FACES), rays_at(4000)
    for folder in (None, tmp_path):
        with share(tree, client, chunk=100, folder=folder) as shared:
            shared.closest_hits(rays)
            name = shared._name
            assert set(client.run(_loads, name).values()) == {1}
            kept = [Path(path) for path in client.run(_folder, name).values()]
            assert all((path / "tree").is_file() for path in kept)
            assert len(set(kept)) == (2 if folder is None else 1)
        assert not any(path.exists() for path in kept) and name not in client.run(_names).popitem()[1]
        with pytest.raises(splitplane.DeadHandleError, match="closed"):
            shared.closest_hits(rays)


def _loads(name: str, dask_worker: Any) -> int:
    return int(dask_worker.plugins[name].loads)


def _folder(name: str, dask_worker: Any) -> str:
    return str(dask_worker.plugins[name]._folder)


def _names(dask_worker: Any) -> list[str]:
    return list(dask_worker.plugins)


def test_another_tree_in_the_files_is_found_by_its_digest(client: Client, tmp_path: Path) -> None:
    tree, other = Tree.build(VERTICES, FACES), Tree.build(VERTICES * 2, FACES)
    with share(tree, client, folder=tmp_path / "a") as shared, share(other, client, folder=tmp_path / "b") as wrong:
        for file in shared._folder.iterdir():
            file.write_bytes((wrong._folder / file.name).read_bytes())
        with pytest.raises(splitplane.DigestError, match=f"{other.digest}, not {tree.digest}"):
            shared.closest_hits(rays_at(10))
    # A tree over another mesh, and one that is damaged, are found by the library.
    with share(tree, client, folder=tmp_path) as shared:
        np.save(shared._folder / "vertices.npy", VERTICES.astype(np.float32) * 3)
        with pytest.raises(splitplane.WrongMeshError):
            shared.closest_hits(rays_at(10))
    with share(tree, client, folder=tmp_path) as shared:
        data = bytearray((shared._folder / "tree").read_bytes())
        data[200] ^= 1
        (shared._folder / "tree").write_bytes(data)
        with pytest.raises(splitplane.FileError):
            shared.closest_hits(rays_at(10))


def test_mistakes_are_the_library_s_typed_errors(client: Client) -> None:
    tree, rays = Tree.build(VERTICES, FACES), rays_at(1000)
    far = rays.astype(np.float64)
    far[700, 1] = 1e300
    with share(tree, client, chunk=300) as shared:
        cases: list[tuple[type[Exception], str, Any, dict[str, Any]]] = [
            (splitplane.ShapeError, r"\(1000, 5\)", rays[:, :5], {}),
            (splitplane.DtypeError, "complex", rays.astype(complex), {}),
            (splitplane.RangeError, "greatest float32", far, {}),
            (splitplane.ConfigError, "no accuracy `best`", rays, {"accuracy": "best"}),
            (splitplane.ShapeError, "t_max has shape", rays, {"t_max": np.zeros(3)}),
            (splitplane.ConfigError, "piece by piece", iter([rays]), {"t_max": np.zeros(1000)}),
            (splitplane.RangeError, "chunk is 0", rays, {"chunk": 0}),
            (splitplane.RangeError, "in_flight is 0", rays, {"in_flight": 0}),
            (splitplane.ShapeError, r"\(2, 7\)", iter([rays, np.zeros((2, 7))]), {}),
        ]
        for error, text, asked, options in cases:
            with pytest.raises(error, match=text):
                shared.closest_hits(asked, **options)
        with pytest.raises(splitplane.OutOfMemoryError, match="limit of 100"):
            shared.all_hits(rays, max_memory=100)
        with pytest.raises(splitplane.ConfigError, match="there are closest_hits, any_hits"):
            shared.stream("refit", rays)
        assert_same(shared.closest_hits(rays), tree.closest_hits(rays))
    kinds = [getattr(splitplane, name) for name in splitplane.__all__ if name.endswith("Error")]
    assert len(kinds) > 20 and splitplane.DigestError in kinds and splitplane.ClusterError in kinds
    for kind in kinds:
        for copy in (pickle.loads(pickle.dumps(kind("what"))), kind.__new__(kind, "what")):
            assert type(copy) is kind and copy.args == ("what",)
    with pytest.raises(splitplane.DtypeError, match="not int"):
        share(3, client)
    with pytest.raises(splitplane.DtypeError, match="client must be"):
        share(tree, object())


def test_only_so_many_chunks_are_under_way(client: Client) -> None:
    tree, pulled = Tree.build(VERTICES, FACES), 0

    def pieces() -> Iterator[np.ndarray]:
        nonlocal pulled
        for _ in range(40):
            pulled += 1
            yield rays_at(50)

    with share(tree, client) as shared:
        for given, _ in enumerate(shared.stream("any_hits", pieces(), in_flight=5)):
            time.sleep(0.01)
            assert pulled <= given + 1 + 5
            keys = client.run_on_scheduler(_tasks, shared._name)
            assert keys <= 6, keys
        assert pulled == 40


def _tasks(name: str, dask_scheduler: Any) -> int:
    return sum(str(key).startswith(name) for key in dask_scheduler.tasks)


def _states(name: str, dask_scheduler: Any) -> list[str]:
    return [repr(task) for key, task in dask_scheduler.tasks.items() if str(key).startswith(name)]


def test_progress_and_what_ends_the_work(client: Client) -> None:
    tree, rays = Tree.build(VERTICES, FACES), rays_at(3000)
    seen: list[tuple[str, int, int]] = []
    threads: set[int] = set()

    def progress(stage: str, done: int, total: int) -> None:
        seen.append((stage, done, total))
        threads.add(threading.get_ident())

    class Enough(Exception):
        pass

    def enough(stage: str, done: int, total: int) -> None:
        if done >= 500:
            raise Enough

    with share(tree, client, chunk=250) as shared:
        shared.closest_hits(rays, progress=progress)
        assert seen[0] == ("start", 0, 0) and seen[-1] == ("rays", 3000, 3000) and threads == {threading.get_ident()}
        assert [done for _, done, _ in seen] == sorted(done for _, done, _ in seen)
        for end in (lambda: shared.closest_hits(rays, progress=enough), lambda: shared.any_hits(rays, progress=enough)):
            with pytest.raises(Enough):
                end()
        stream = shared.stream("closest_hits", rays, chunk=10)
        next(stream)
        stream.close()  # type: ignore[attr-defined]
        assert_nothing_is_left(client, shared._name)
        assert_same(shared.closest_hits(rays), tree.closest_hits(rays))


def assert_nothing_is_left(client: Client, name: str) -> None:
    """The cluster forgets all chunks, within a time that a busy machine may need."""
    deadline = time.monotonic() + 300
    while client.run_on_scheduler(_tasks, name):
        left = time.monotonic() < deadline or client.run_on_scheduler(_states, name)
        assert left is True, f"chunks are still there: {left}"
        time.sleep(0.02)


def test_workers_keep_no_answer_that_was_given_out(client: Client, monkeypatch: pytest.MonkeyPatch) -> None:
    # Waits that time out leave their futures in cycles of references, and nothing collects those here.
    monkeypatch.setattr(_flow, "BETWEEN", 1e-6)
    tree, rays, waits = Tree.build(*sphere(128, 96)), rays_at(100_000), 0

    def progress(stage: str, done: int, total: int) -> None:
        nonlocal waits
        waits += 1

    gc.collect()
    gc.disable()
    try:
        with share(tree, client, chunk=10_000) as shared:
            shared.closest_hits(rays, progress=progress)
            assert waits > 12, "no wait has timed out"
            assert_nothing_is_left(client, shared._name)
    finally:
        gc.enable()


def test_ctrl_c_ends_chunks_that_workers_have(client: Client) -> None:
    # Work of many seconds: every point asks a thousand faces, all as near.
    tree = Tree.build(*sphere(128, 96))
    points = np.zeros((4_000_000, 3), np.float32)
    # A shell's background jobs ignore it.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    with share(tree, client, chunk=2_000_000) as shared:
        begun = time.monotonic()
        threading.Timer(0.7, lambda: os.kill(os.getpid(), signal.SIGINT)).start()
        with pytest.raises(KeyboardInterrupt):
            shared.closest_points(points)
        # Workers are free again: they do not finish what nobody waits for.
        assert_same(shared.any_hits(rays_at(100)), tree.any_hits(rays_at(100)))
        assert time.monotonic() - begun < 60


def test_frames(client: Client) -> None:
    rays = rays_at(300)

    def pose(frame: int) -> np.ndarray:
        return (VERTICES * (1 + 0.02 * frame)).astype(np.float32)

    def ask(tree: Tree, frame: int) -> tuple[int, str, bytes]:
        return frame, tree.digest, tree.closest_hits(rays).t.tobytes()

    def alone(frame: int) -> tuple[int, str, bytes]:
        return ask(Tree.build(pose(frame), FACES, preset="balanced"), frame)

    expected = [alone(frame) for frame in range(12)]
    seen: list[tuple[str, int, int]] = []
    made = frames(pose, ask, range(12), faces=FACES, client=client, preset="balanced", in_flight=3, progress=lambda *of: seen.append(of))
    assert list(made) == expected and seen[-1] == ("frames", 12, 12)
    stack = np.stack([pose(frame) for frame in range(12)])
    assert list(frames(stack, ask, faces=FACES, client=client, preset="balanced")) == expected
    assert list(frames(stack, ask, iter([7, 2, 2]), faces=FACES, client=client, preset="balanced")) == [expected[i] for i in (7, 2, 2)]
    soup = [ask(Tree.build(pose(frame)[FACES]), frame) for frame in range(3)]
    assert list(frames(stack[:3][:, FACES], ask, client=client)) == soup
    with pytest.raises(splitplane.MeshError):
        list(frames(stack, ask, faces=FACES + 10_000, client=client))
    with pytest.raises(ZeroDivisionError):
        list(frames(stack, lambda tree, frame: 1 // (3 - frame), faces=FACES, client=client))
    for error, text, call in [
        (splitplane.ConfigError, "must be a point", lambda: frames(stack, ask, origin="center", client=client)),
        (splitplane.ConfigError, "indices must say", lambda: frames(pose, ask, client=client)),
        (splitplane.ConfigError, "builder", lambda: frames(stack, ask, builder="quick", client=client)),
        (splitplane.RangeError, "a frame is 12", lambda: list(frames(stack, ask, [12], faces=FACES, client=client))),
        (splitplane.ShapeError, "must have .frames, n, 3.", lambda: frames(VERTICES, ask, client=client)),
    ]:
        with pytest.raises(error, match=text):
            call()


def test_without_dask_the_import_says_what_to_install() -> None:
    code = "import sys; sys.modules['distributed'] = None\ntry:\n    import splitplane.dask\nexcept ImportError as error:\n    print(error)"
    import subprocess

    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert "pip install 'splitplane[dask]'" in done.stdout, done.stdout + done.stderr
