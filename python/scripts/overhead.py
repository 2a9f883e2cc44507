#!/usr/bin/env python3
"""What a call from Python costs beyond the Rust call: overhead.py DIRECTORY [--rays N] [--threads N] [--rounds N] [--clock wall|cpu] [--program FILE]

Runs the program `rust_call` (`cargo build --release --example rust_call`, with the wheel that is installed built by --release) and the same
batch through the package, in turns, each in a process that is held to the same CPUs. A figure is the least time of a turn, or with `--clock cpu` the mean CPU
time of its calls, for machines that are busy; the overhead the median over turns, and the spread its quartiles.
"""

from __future__ import annotations

import argparse
import os
import statistics
import subprocess
import sys
from pathlib import Path

PROGRAM = Path(__file__).resolve().parents[1] / "target/release/examples/rust_call"
#: Columns of the rays, and whether results are written over earlier ones.
FORMS = {"(n, 8)": ("8", ""), "(n, 8), out": ("8", "out"), "(n, 6)": ("6", ""), "(n, 6), out": ("6", "out")}

PYTHON = """
import sys, time
import numpy as np, splitplane
folder, name, count, threads, repeats, form, reuse = sys.argv[1:]
vertices = np.fromfile(f"{folder}/verts.f32", "<f4").reshape(-1, 3)
faces = np.fromfile(f"{folder}/index.u32", "<u4").reshape(-1, 3)
rays = np.fromfile(f"{folder}/{name}.rays", "<f4").reshape(-1, 8)[:int(count), :6].copy()
if form == "8":
    whole = np.zeros((len(rays), 8), np.float32)
    whole[:, :3], whole[:, 4:7], whole[:, 7] = rays[:, :3], rays[:, 3:], np.inf
    rays = whole
tree = splitplane.Tree.build(vertices, faces, threads=int(threads))
out = tree.closest_hits(rays) if reuse else None
tree.closest_hits(rays, threads=int(threads), out=out)
seconds, before = [], time.process_time()
for _ in range(int(repeats)):
    begun = time.perf_counter()
    tree.closest_hits(rays, threads=int(threads), out=out)
    seconds.append(time.perf_counter() - begun)
cpu = (time.process_time() - before) / int(repeats)
for one in seconds:
    print("python", one)
print("python-cpu", cpu)
"""


def least(command: list[str], cpus: list[int]) -> dict[str, float]:
    hold = (lambda: os.sched_setaffinity(0, cpus)) if hasattr(os, "sched_setaffinity") else None
    done = subprocess.run(command, capture_output=True, text=True, check=True, preexec_fn=hold)
    best: dict[str, float] = {}
    for line in done.stdout.splitlines():
        name, seconds = line.split()
        best[name] = min(float(seconds), best.get(name, float("inf")))
    return best


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("scenes", nargs="+")
    parser.add_argument("--rays", type=int, default=100_000)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--repeats", type=int, default=25)
    parser.add_argument("--clock", choices=("wall", "cpu"), default="wall")
    parser.add_argument("--program", type=Path, default=PROGRAM)
    arguments = parser.parse_args()
    cpus = sorted(os.sched_getaffinity(0))[: arguments.threads] if hasattr(os, "sched_getaffinity") else []
    clock = "-cpu" if arguments.clock == "cpu" else ""
    common = [str(arguments.rays), str(arguments.threads), str(arguments.repeats)]
    for scene in arguments.scenes:
        for name in ("primary", "bounce", "chords"):
            over: dict[str, list[float]] = {form: [] for form in FORMS}
            rust = []
            for _ in range(arguments.rounds):
                plain = least([str(arguments.program), scene, name, *common], cpus)
                rust.append(plain["plain" + clock])
                for form, own in over.items():
                    took = least([sys.executable, "-c", PYTHON, scene, name, *common, *FORMS[form]], cpus)["python" + clock]
                    own.append(took / rust[-1] - 1)
            shown = []
            for form, own in over.items():
                low, _, high = statistics.quantiles(own, n=4)
                shown.append(f"rays {form} {100 * statistics.median(own):+.1f} % ({100 * low:+.1f} to {100 * high:+.1f})")
            print(f"{Path(scene).name} {name}, {arguments.rays} rays, {arguments.threads} threads: Rust "
                  f"{1e3 * statistics.median(rust):.2f} ms; {'; '.join(shown)} | load {os.getloadavg()[0]:.1f}", flush=True)  # fmt: skip


if __name__ == "__main__":
    main()
