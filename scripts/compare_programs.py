#!/usr/bin/env python3
"""Holds one build of the program against another, byte by byte: trees, hits and pictures.

    scripts/compare_programs.py OLD NEW SCENE... [--backend cpu|wgpu] [--rays N]

OLD and NEW are programs `splitplane`, SCENE what they take for one. For each scene: the tree file of every preset; closest, any and all hits of
the same N rays by every preset, accuracy and layout; and one picture with the default preset and accuracy. Exits with 1 where a byte differs.
"""
import argparse
import hashlib
import pathlib
import random
import struct
import subprocess
import sys
import tempfile

PRESETS = ["fast", "balanced", "best"]
ACCURACIES = ["fast", "watertight", "exact"]


def bounds_of(program, scene):
    """A box to aim rays through: that of the vertices of a file, or one that holds the built-in scenes."""
    if scene.startswith("builtin:"):
        return [-20.0] * 3, [20.0] * 3
    low, high = [float("inf")] * 3, [float("-inf")] * 3
    for line in open(scene, errors="replace"):
        if line.startswith("v "):
            for axis, word in enumerate(line.split()[1:4]):
                low[axis], high[axis] = min(low[axis], float(word)), max(high[axis], float(word))
    return low, high


def rays_through(low, high, count):
    """Rays between points of the box, some along axes, some short."""
    generator = random.Random(1)
    point = lambda: [generator.uniform(a - 0.1 * (b - a), b + 0.1 * (b - a)) for a, b in zip(low, high)]
    data = bytearray()
    for number in range(count):
        start, end = point(), point()
        direction = [b - a for a, b in zip(start, end)]
        if number % 16 == 0:
            direction = [0.0 if axis != number // 16 % 3 else 1.0 for axis in range(3)]
        data += struct.pack("<8f", *start, *direction, 0.0, 1.0 if number % 8 == 1 else float("inf"))
    return bytes(data)


def answers(program, scene, arguments, folder, backend):
    """All that a program gives for a scene, as digests by name."""
    found = {}

    def run(name, verb, options, outputs):
        for output in outputs:
            (folder / output).unlink(missing_ok=True)
        command = [program, verb, scene, "--backend", backend, "--quiet", *options]
        done = subprocess.run(command, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
        found[name] = str(done.returncode) if done.returncode else ""
        for output in outputs:
            file = folder / output
            found[name] += hashlib.sha256(file.read_bytes()).hexdigest() if file.exists() else "no file"

    presets = PRESETS if backend == "cpu" else PRESETS[:2]
    for preset in presets:
        run(f"tree {preset}", "build", ["--preset", preset, "-o", "tree.bin"], ["tree.bin"])
        for kind in ["closest", "any", "all"]:
            for accuracy in ACCURACIES if kind != "all" else ["exact"]:
                for layout in [[], ["--compact"]] if backend == "cpu" else [[]]:
                    name = " ".join(["query", preset, kind, accuracy, *layout])
                    options = ["--preset", preset, "--accuracy", accuracy, "--kind", kind, *layout]
                    outputs = ["hits.bin"] + (["hits.starts.bin"] if kind == "all" else [])
                    run(name, "query", [*options, "--rays", "rays.bin", "--hits", "hits.bin"], outputs)
    run("picture", "render", ["--size", "160x120", "-o", "picture.png"], ["picture.png"])
    run("radiance", "render", ["--size", "96x64", "-o", "picture.exr", "--aov", "depth,normal,triangle"], ["picture.exr"])
    return found


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("old")
    parser.add_argument("new")
    parser.add_argument("scenes", nargs="+")
    parser.add_argument("--backend", default="cpu", choices=["cpu", "wgpu"])
    parser.add_argument("--rays", type=int, default=20_000)
    arguments = parser.parse_args()
    programs = [str(pathlib.Path(program).resolve()) for program in (arguments.old, arguments.new)]
    differences = compared = 0
    for scene in arguments.scenes:
        scene = scene if scene.startswith("builtin:") else str(pathlib.Path(scene).resolve())
        with tempfile.TemporaryDirectory() as folder:
            folder = pathlib.Path(folder)
            low, high = bounds_of(programs[1], scene)
            (folder / "rays.bin").write_bytes(rays_through(low, high, arguments.rays))
            old, new = (answers(program, scene, arguments, folder, arguments.backend) for program in programs)
        unequal = [name for name in old if old[name] != new[name]]
        missing = [name for name in old if "no file" in old[name]]
        print(f"{scene}: {len(old)} answers, {len(unequal)} differ {unequal}, {len(missing)} gave no file {missing}", flush=True)
        differences, compared = differences + len(unequal) + len(missing), compared + len(old)
    print(f"{compared} answers compared, {differences} differ or are missing")
    sys.exit(differences > 0)


if __name__ == "__main__":
    main()
