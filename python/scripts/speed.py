#!/usr/bin/env python3
"""splitplane, embreex (through trimesh) and Open3D from Python, on the same arrays.

    speed.py DIRECTORY [DIRECTORY ...] [--threads N] [--repeats N] [--clock wall|cpu] [--preset NAME] [--json FILE]

A DIRECTORY has `verts.f32`, `index.u32` and sets of rays as the `peers` harness writes them: `primary.rays`, `shadow.rays`,
`bounce.rays`, `chords.rays`, 8 float32 a ray. All libraries get rays (n, 6) float32 without limits, so shadow rays go on beyond
their lights. The process is held to N CPUs. Libraries take turns, so that what else the machine does falls on all; a figure is the
median, and a ratio the median of ratios of a turn. Answers are compared: hits that only one has, and distances.

splitplane tells t, face, weights; Open3D these, geometries and normals; embreex faces only. So there are two columns: `Tree` and
the class of Open3D's shape, whose answers have as much in them as Open3D's.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import sys
import time
from pathlib import Path

import numpy as np

SETS = ["primary", "shadow", "bounce", "chords"]


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("scenes", nargs="+", type=Path)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--points", type=int, default=1 << 17)
    parser.add_argument("--preset", default="fast")
    parser.add_argument("--clock", choices=["wall", "cpu"], default="wall", help="cpu: of all threads of the process")
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[: arguments.threads])

    import open3d
    import trimesh
    from embreex import rtcore_scene
    from embreex.mesh_construction import TriangleMesh

    import splitplane
    import splitplane.open3d

    now = time.process_time if arguments.clock == "cpu" else time.perf_counter

    def tensor(array: np.ndarray) -> object:
        return open3d.core.Tensor.from_numpy(array)

    rows = []

    def measure(scene: str, name: str, count: int, calls: dict) -> dict:
        times: dict = {key: [] for key in calls}
        answers = {key: call() for key, call in calls.items()}
        for _ in range(arguments.repeats):
            for key, call in calls.items():
                begun = now()
                call()
                times[key].append(now() - begun)
        rates = {key: count / statistics.median(own) / 1e6 for key, own in times.items()}
        # By the turn, against the faster of the others in that turn.
        others = [key for key in calls if not key.startswith("splitplane")]
        ratios = {
            key: statistics.median(min(times[o][i] for o in others) / times[key][i] for i in range(arguments.repeats))
            for key in calls
            if key.startswith("splitplane")
        }
        load = os.getloadavg()[0]
        rows.append({"scene": scene, "set": name, "count": count, "threads": arguments.threads, "rates": rates,
                     "ratios": ratios, "load": load, "clock": arguments.clock, "seconds": times})  # fmt: skip
        shown = "  ".join(f"{key} {rate:.2f}" for key, rate in rates.items())
        against = "  ".join(f"{key} x{ratio:.2f}" for key, ratio in ratios.items())
        print(f"{scene} {name} ({count}), M/s: {shown} | against the faster: {against} | load {load:.1f}", flush=True)
        return answers

    print(f"trimesh {trimesh.__version__}, open3d {open3d.__version__}, splitplane {splitplane.__version__}, "
          f"{splitplane.backend_info('cpu').detail}, {arguments.threads} threads, preset {arguments.preset}, clock {arguments.clock}")  # fmt: skip
    for folder in arguments.scenes:
        vertices = np.fromfile(folder / "verts.f32", "<f4").reshape(-1, 3)
        faces = np.fromfile(folder / "index.u32", "<u4").reshape(-1, 3)
        threads = arguments.threads
        tree = splitplane.Tree.build(vertices, faces, threads=threads, preset=arguments.preset)
        ours = splitplane.open3d.RaycastingScene(nthreads=threads, preset=arguments.preset)
        ours.add_triangles(vertices, faces)
        theirs = open3d.t.geometry.RaycastingScene(nthreads=threads)
        theirs.add_triangles(tensor(vertices), tensor(faces))
        embree = rtcore_scene.EmbreeScene()
        TriangleMesh(scene=embree, vertices=vertices, indices=faces.astype(np.int32))
        for name in SETS:
            whole = np.fromfile(folder / f"{name}.rays", "<f4").reshape(-1, 8)
            rays = np.ascontiguousarray(whole[:1_000_000, :6])
            count = len(rays)
            origins, directions = rays[:, :3].copy(), rays[:, 3:].copy()
            as_tensor = tensor(rays)
            answers = measure(folder.name, f"{name} closest", count, {
                "splitplane": lambda: tree.closest_hits(rays, threads=threads),
                "splitplane.open3d": lambda: ours.cast_rays(rays, nthreads=threads),
                "open3d": lambda: theirs.cast_rays(as_tensor, nthreads=threads),
                "embreex": lambda: embree.run(origins, directions),
            })  # fmt: skip
            mine, other = answers["splitplane"], answers["open3d"]["t_hit"].numpy()
            third = answers["embreex"]
            both = mine.hit & np.isfinite(other)
            far = np.abs(mine.t[both] - other[both]) > 1e-4 * np.maximum(1, np.abs(other[both]))
            print(f"  {both.sum()} hits of both; only splitplane {np.sum(mine.hit & ~np.isfinite(other))}, only Open3D "
                  f"{np.sum(~mine.hit & np.isfinite(other))}, only embreex {np.sum(~mine.hit & (third >= 0))}, "
                  f"not embreex {np.sum(mine.hit & (third < 0))}, other t {far.sum()}")  # fmt: skip
            shadowed = measure(folder.name, f"{name} any", count, {
                "splitplane": lambda: tree.any_hits(rays, threads=threads),
                "open3d": lambda: theirs.test_occlusions(as_tensor, nthreads=threads),
            })  # fmt: skip
            differ = np.sum(shadowed["splitplane"] != shadowed["open3d"].numpy())
            print(f"  any: {differ} answers differ from Open3D's")
        box = vertices[np.unique(faces)]
        middle, half = (box.min(axis=0) + box.max(axis=0)) / 2, (box.max(axis=0) - box.min(axis=0)) * 0.75
        points = np.random.default_rng(45).uniform(middle - half, middle + half, (arguments.points, 3)).astype(np.float32)
        skin = tree.points_at(np.random.default_rng(46).integers(0, len(faces), arguments.points), 0.25, 0.25)
        shift = np.random.default_rng(47).normal(size=skin.shape) * np.linalg.norm(half) * 0.003
        for name, asked in (("box", points), ("skin", (skin + shift).astype(np.float32))):
            as_points = tensor(asked)
            answers = measure(folder.name, f"{name} closest points", len(asked), {
                "splitplane": lambda: tree.closest_points(asked, threads=threads),
                "splitplane.open3d": lambda: ours.compute_closest_points(asked, nthreads=threads),
                "open3d": lambda: theirs.compute_closest_points(as_points, nthreads=threads),
            })  # fmt: skip
            distance = np.linalg.norm(answers["open3d"]["points"].numpy().astype(float) - asked, axis=1)
            off = np.abs(answers["splitplane"].distance - distance) > 1e-5 * np.linalg.norm(half)
            print(f"  distances that differ: {off.sum()}")
    if arguments.json:
        arguments.json.write_text(json.dumps(rows, indent=1))


if __name__ == "__main__":
    sys.exit(main())
