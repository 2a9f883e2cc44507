#!/usr/bin/env python3
"""Reads files of others with the program and with trimesh, and compares the triangles.

    python/scripts/foreign_files.py PROGRAM SOURCE... [--list FILE] [--limit-mb N]

PROGRAM is `splitplane`. A SOURCE is a folder, or a bare git repository, whose newest commit is taken; of either every .obj, .ply, .stl,
.gltf and .glb file is read, in a temporary folder, and nothing of it is kept. Folders that many have: the sources of crates
(~/.cargo/registry/src) and of Python packages. Needs trimesh, numpy and scipy.

Triangles are compared as a set, each with its corners in order and any of them first: equal bits, or each within 1e-5 of the size of the
scene of one of trimesh's, and as many. --list writes a line for each file.
"""
import argparse
import collections
import hashlib
import os
import pathlib
import subprocess
import sys
import tempfile

import numpy as np
import trimesh
from scipy.spatial import cKDTree

ENDINGS = (".obj", ".ply", ".stl", ".gltf", ".glb")
# What such files name.
BESIDE = (".bin", ".mtl", ".png", ".jpg", ".jpeg")
SECONDS = 120


def gather(source, place):
    """A folder with the files of a source."""
    path = pathlib.Path(source)
    if not ((path / "HEAD").is_file() and (path / "objects").is_dir()):
        return path
    names = subprocess.run(["git", "-C", source, "ls-tree", "-r", "-z", "HEAD"], check=True, capture_output=True).stdout
    for line in filter(None, names.split(b"\0")):
        about, name = line.split(b"\t", 1)
        name = name.decode(errors="replace")
        if about.split()[1] != b"blob" or not name.lower().endswith(ENDINGS + BESIDE):
            continue
        # A snapshot may lack its largest files.
        done = subprocess.run(["git", "-C", source, "cat-file", "blob", about.split()[2]], capture_output=True)
        to = pathlib.Path(place, name)
        if done.returncode == 0 and to.resolve().is_relative_to(pathlib.Path(place).resolve()):
            to.parent.mkdir(parents=True, exist_ok=True)
            to.write_bytes(done.stdout)
    return pathlib.Path(place)


def ours(program, path, place):
    """The triangles that the program reads, or its message."""
    out = os.path.join(place, "out.ply")
    command = [program, "convert", str(path), out, "--quiet"]
    try:
        done = subprocess.run(command, capture_output=True, timeout=SECONDS)
    except subprocess.TimeoutExpired:
        return None, "no end after two minutes"
    if done.returncode:
        # A panic or a signal is a mistake of ours, whatever the file is.
        return None, f"exit code {done.returncode}: " + done.stderr.decode(errors="replace").strip().replace(str(path), path.name)
    with open(out, "rb") as file:
        data = file.read()
    end = data.index(b"end_header\n") + len(b"end_header\n")
    header = data[:end].decode()
    count = {word[1]: int(word[2]) for word in map(str.split, header.splitlines()) if word[0] == "element"}
    width = header.count("property float")
    floats = np.frombuffer(data, "<f4", count["vertex"] * width, end).reshape(-1, width)
    faces = np.frombuffer(data, [("n", "u1"), ("v", "<u4", 3)], count["face"], end + 4 * floats.size)["v"]
    return floats[:, :3][faces], None


def theirs(path):
    """The triangles that trimesh reads, or its message."""
    try:
        scene = trimesh.load_scene(str(path), process=False, maintain_order=True)
        parts = [mesh.triangles for mesh in scene.dump() if isinstance(mesh, trimesh.Trimesh)]
        parts = [np.asarray(part, np.float64) for part in parts if len(part)]
        if not parts:
            return None, "no triangles"
        return np.concatenate(parts), None
    except BaseException as error:  # Whatever it is, it is trimesh's.
        return None, f"{type(error).__name__}: {error}"[:200].replace("\n", " ")


def key(triangles):
    """Triangles as sorted rows of bits, the least corner first. 0 and -0 are one."""
    words = (np.ascontiguousarray(triangles, np.float32) + np.float32(0)).view(np.uint32).astype(np.uint64)
    corners = [tuple(map(tuple, triangle)) for triangle in words.tolist()]
    return collections.Counter(min(c, c[1:] + c[:1], c[2:] + c[:2]) for c in corners)


def compare(a, b):
    """What the triangles are to one another, in a word or a reason."""
    if len(a) == len(b) and key(a) == key(b):
        return "equal bits"
    if len(a) != len(b):
        return f"differs: {len(a)} triangles, trimesh {len(b)}"
    if not (np.isfinite(a).all() and np.isfinite(b).all()):
        return "differs: numbers that are not finite"
    size = max(np.ptp(b.reshape(-1, 3), axis=0).max(), 1e-30)
    turned = np.concatenate([np.roll(b, k, axis=1).reshape(-1, 9) for k in range(3)])
    far = cKDTree(turned).query(a.reshape(-1, 9))[0].max()
    if far <= 1e-5 * size:
        return "equal within 1e-5"
    mirrored = np.concatenate([turned, np.concatenate([np.roll(b[:, ::-1], k, axis=1).reshape(-1, 9) for k in range(3)])])
    if cKDTree(mirrored).query(a.reshape(-1, 9))[0].max() <= 1e-5 * size:
        return "differs: some triangles run the other way around"
    return f"differs: by {far / size:.1e} of the size"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("program")
    parser.add_argument("source", nargs="+")
    parser.add_argument("--list")
    parser.add_argument("--limit-mb", type=float, default=40)
    arguments = parser.parse_args()
    program = str(pathlib.Path(arguments.program).resolve())
    counts, lines, seen = collections.Counter(), [], set()
    for source in arguments.source:
        with tempfile.TemporaryDirectory() as place:
            folder = gather(source, os.path.join(place, "source"))
            for path in sorted(folder.rglob("*")):
                ending = path.suffix.lower()
                if ending not in ENDINGS or not path.is_file():
                    continue
                if path.stat().st_size > arguments.limit_mb * 1e6:
                    continue
                data = path.read_bytes()
                digest = hashlib.sha256(data).digest()
                if digest in seen or data.startswith(b"version https://git-lfs"):
                    continue
                seen.add(digest)
                a, message = ours(program, path, place)
                b, other = theirs(path)
                if a is not None and b is not None:
                    what = compare(a, b)
                elif a is None and b is None:
                    what = "refused by both"
                elif a is None:
                    what = "refused here, not by trimesh"
                else:
                    what = "refused by trimesh, not here"
                counts[ending, what.split(":")[0]] += 1
                reason = "; ".join(filter(None, [message and f"splitplane: {message}", other and f"trimesh: {other}"]))
                lines.append(f"{path.relative_to(folder)}\t{what}\t{reason}")
                print(lines[-1], file=sys.stderr, flush=True)
    if arguments.list:
        pathlib.Path(arguments.list).write_text("\n".join(lines) + "\n")
    total = collections.Counter()
    for (ending, what), count in sorted(counts.items()):
        print(f"{ending:6} {count:4}  {what}")
        total[what] += count
    print(f"all    {sum(total.values()):4}  " + ", ".join(f"{count} {what}" for what, count in total.most_common()))


if __name__ == "__main__":
    main()
