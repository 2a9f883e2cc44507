#!/usr/bin/env python3
"""Many rays over a local Dask cluster, from a generator into files that are mapped, and what memory that takes.

    dask_billion.py SCENE_DIRECTORY [--rays N] [--workers N] [--chunk N] [--in-flight N] [--check N]

SCENE_DIRECTORY has verts.f32 and index.u32, as `splitplane` scenes of the peers' harness have; none: a sphere of 20,000 faces.
Rays come from a generator, chunk by chunk, and are never in memory all at once. `t` and `triangle` go to two .npy files in a
temporary folder (8 bytes a ray). Afterwards --check rays, evenly spread, are answered here, and must be the same bytes.
Reported: rays a second, and the peak resident set of this process and of each worker; files that are mapped count in it.
"""

from __future__ import annotations

import argparse
import os
import resource
import tempfile
import threading
import time
from pathlib import Path
from typing import Any, Iterator

import dask
import numpy as np
from dask.distributed import Client, LocalCluster

import splitplane
import splitplane.dask


def peak() -> int:
    """The peak resident set of this process, in bytes."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024


def anonymous() -> int:
    """Memory of this process that is no file's, in bytes, where Linux says so; else 0."""
    try:
        lines = Path("/proc/self/status").read_text().splitlines()
    except OSError:
        return 0
    return next((int(line.split()[1]) * 1024 for line in lines if line.startswith("RssAnon")), 0)


def mesh_of(folder: str | None) -> tuple[np.ndarray, np.ndarray]:
    if folder is not None:
        vertices = np.fromfile(f"{folder}/verts.f32", "<f4").reshape(-1, 3)
        return vertices, np.fromfile(f"{folder}/index.u32", "<u4").reshape(-1, 3)
    down, around = np.mgrid[0:101, 0:101]
    theta, phi = np.pi * down / 100, 2 * np.pi * (around % 100) / 100
    places = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=-1)
    corner = (down * 101 + around)[:-1, :-1].reshape(-1)
    faces = np.concatenate([np.stack([corner, corner + 101, corner + 102], 1), np.stack([corner, corner + 102, corner + 1], 1)])
    return places.reshape(-1, 3).astype(np.float32), faces


def rays_at(number: int, count: int, lower: np.ndarray, upper: np.ndarray) -> np.ndarray:
    """A chunk: lines between random places of a box around the mesh, by the number of the chunk."""
    rng = np.random.default_rng(number)
    ends = rng.random((count, 2, 3), np.float32) * np.float32(1.4) - np.float32(0.2)
    ends = ends * (upper - lower) + lower
    return np.concatenate([ends[:, 0], ends[:, 1] - ends[:, 0]], axis=1).astype(np.float32)


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("scene", nargs="?")
    parser.add_argument("--rays", type=int, default=100_000_000)
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--chunk", type=int, default=splitplane.dask.CHUNK)
    parser.add_argument("--in-flight", type=int)
    parser.add_argument("--check", type=int, default=100_000)
    arguments = parser.parse_args()
    vertices, faces = mesh_of(arguments.scene)
    lower, upper = vertices.min(axis=0), vertices.max(axis=0)
    tree = splitplane.Tree.build(vertices, faces)
    count, chunk = arguments.rays, arguments.chunk

    def rays() -> Iterator[np.ndarray]:
        for first in range(0, count, chunk):
            yield rays_at(first // chunk, min(chunk, count - first), lower, upper)

    halves: list[tuple[int, int]] = []
    most = [0]
    ended = threading.Event()

    def look() -> None:
        while not ended.wait(0.2):
            most[0] = max(most[0], anonymous())

    def progress(stage: str, done: int, total: int) -> None:
        if done * 10 >= count * (len(halves) + 1):
            halves.append((done, anonymous()))
            print(f"{done:>12,} rays in, {anonymous() / 2**20:.0f} MiB held", flush=True)

    with tempfile.TemporaryDirectory() as folder, dask.config.set({"temporary-directory": folder}):
        with LocalCluster(arguments.workers, threads_per_worker=1, dashboard_address=":0") as cluster, Client(cluster) as client:
            out: dict[str, Any] = {}
            for name, dtype in (("t", np.float32), ("triangle", np.uint32)):
                out[name] = np.lib.format.open_memmap(os.path.join(folder, f"{name}.npy"), "w+", dtype, (count,))
            watcher = threading.Thread(target=look)
            watcher.start()
            begun = time.perf_counter()
            with splitplane.dask.share(tree, client, chunk=chunk, in_flight=arguments.in_flight) as shared:
                done = shared.closest_hits(rays(), out=out, progress=progress)
                took = time.perf_counter() - begun
                workers = client.run(peak)
                limit = shared._most
            ended.set()
            watcher.join()
        assert done == count
        checked = 0
        step = max(1, count // max(1, arguments.check))
        for first in range(0, count, chunk):
            here = np.arange((-first) % step, min(chunk, count - first), step)
            if len(here):
                own = tree.closest_hits(rays_at(first // chunk, min(chunk, count - first), lower, upper)[here])
                assert own.t.tobytes() == out["t"][first + here].tobytes()
                assert own.triangle.tobytes() == out["triangle"][first + here].tobytes()
                checked += len(here)
        hit = int(np.count_nonzero(out["triangle"] != splitplane.MISS))
        del out
    mib = 2**20
    print(f"{count:,} rays over {len(faces):,} faces in {took:.1f} s, {count / took / 1e6:.2f} million a second; {arguments.workers} "
          f"workers, chunks of {chunk:,}, {limit} under way; {hit:,} hit; {checked:,} checked, none differs")  # fmt: skip
    print(f"peak resident: this process {peak() / mib:.0f} MiB (with the answers' files, {8 * count / mib:.0f} MiB, mapped), of which "
          f"{most[0] / mib:.0f} MiB are no file's; workers {', '.join(f'{own / mib:.0f}' for own in workers.values())} MiB | "
          f"load {os.getloadavg()[0]:.1f}")  # fmt: skip


if __name__ == "__main__":
    main()
