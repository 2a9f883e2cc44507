#!/usr/bin/env python3
"""Runs trimesh's and Open3D's own tests with our classes in place of theirs.

    upstream.py [--trimesh DIRECTORY] [--open3d FILE] [--only trimesh|open3d] [pytest's arguments]

DIRECTORY: a checkout of trimesh with `tests` and `models`, of the version that is installed; FILE: Open3D's
`python/test/t/geometry/test_raycasting_scene.py`. Without them each is fetched by git, shallowly. Where that is not possible
trimesh's tests come from its source package by pip. That package has neither the tests' module `generic` nor the models: a stand-in
takes the module's place, and tests that need a model other than a cube and a sphere are skipped and counted. Open3D has no source
package. What cannot be had is said and counts as a failure. Nothing of theirs is copied into this repository. Needs trimesh, scipy,
rtree and, for one test each, shapely and manifold3d; for the second, open3d.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tarfile
import tempfile
from pathlib import Path

TRIMESH = """
import trimesh
from trimesh import proximity, ray
import splitplane.trimesh as ours

ray.ray_triangle.RayMeshIntersector = ours.RayMeshIntersector
if ray.has_embree:
    ray.ray_pyembree.RayMeshIntersector = ours.RayMeshIntersector
proximity.ProximityQuery = ours.ProximityQuery

used = {}
def counted(cls):
    for name, method in list(vars(cls).items()):
        if callable(method) and not name.startswith("_"):
            def call(self, *args, _name=name, _method=method, **kwargs):
                used[_name] = used.get(_name, 0) + 1
                return _method(self, *args, **kwargs)
            setattr(cls, name, call)
counted(ours.RayMeshIntersector)
counted(ours.ProximityQuery)

def pytest_sessionfinish(session, exitstatus):
    print("\\ncalls of our classes:", used)
    if not used:
        session.exitstatus = 1
"""

OPEN3D = """
import numpy as np
import open3d as o3d
import splitplane.open3d as ours

def tensor(value):
    return o3d.core.Tensor.from_numpy(np.ascontiguousarray(value))

class RaycastingScene(ours.RaycastingScene):
    # Only what goes out: Open3D's tensors in place of arrays.
    used = {}
def handed_on(name):
    method = getattr(ours.RaycastingScene, name)
    def call(self, *args, **kwargs):
        RaycastingScene.used[name] = RaycastingScene.used.get(name, 0) + 1
        answer = method(self, *args, **kwargs)
        if isinstance(answer, dict):
            return {key: tensor(value) for key, value in answer.items()}
        return tensor(answer)
    setattr(RaycastingScene, name, call)
for name in ("cast_rays", "test_occlusions", "count_intersections", "list_intersections", "compute_closest_points",
             "compute_distance", "compute_signed_distance", "compute_occupancy"):
    handed_on(name)
o3d.t.geometry.RaycastingScene = RaycastingScene

def pytest_sessionfinish(session, exitstatus):
    print("\\ncalls of our class:", RaycastingScene.used)
    if not RaycastingScene.used:
        session.exitstatus = 1
"""

# In place of what trimesh's tests import and its source package does not have.
GENERIC = """
import logging as _logging
import time
import unittest
from collections import deque

import numpy as np
import pytest as _pytest
import trimesh
from trimesh import Trimesh, transformations
from trimesh.constants import tol

try:
    from shapely.geometry import Point, Polygon
except ImportError:
    def __getattr__(name):
        if name in ("Point", "Polygon"):
            _pytest.skip("shapely is not installed")
        raise AttributeError(name)

log = _logging.getLogger("trimesh")
random = np.random.default_rng(0).random
transforms = [transformations.random_rotation_matrix(random(3)) for _ in range(20)]
_made = {"unit_cube.STL": trimesh.creation.box, "unit_sphere.STL": lambda: trimesh.creation.icosphere(2)}

def get_mesh(name, **kwargs):
    if name not in _made:
        _pytest.skip("the source package of trimesh does not have the model " + name)
    made = _made[name]()
    return Trimesh(made.vertices, made.faces, **kwargs)

def get_meshes(count):
    return [get_mesh(name) for name in list(_made)[:count]]

class _Data:
    def __getitem__(self, name):
        _pytest.skip("the source package of trimesh does not have the data " + name)
data = _Data()
"""

DEVICES = """
def list_devices(**_):
    import open3d as o3d
    return [o3d.core.Device("CPU:0")]
"""


def fetched(repository: str, tag: str, where: Path) -> Path | None:
    """A shallow checkout, or none."""
    url = f"https://github.com/{repository}"
    command = ["git", "clone", "-q", "--depth", "1", "--branch", tag, url, str(where)]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=300)
    except (OSError, subprocess.TimeoutExpired) as error:
        print(f"upstream.py: {repository} at {tag} cannot be had: {error}")
        return None
    if done.returncode:
        print(f"upstream.py: {repository} at {tag} cannot be had: {done.stderr.strip()}")
        return None
    return where


def from_source_package(name: str, version: str, where: Path) -> Path | None:
    """What is in the source package of a version, by pip, or none."""
    where.mkdir(parents=True)
    pip = [sys.executable, "-m", "pip", "download", "-q", "--no-deps", "--no-binary", name, "-d", str(where), f"{name}=={version}"]
    done = subprocess.run(pip, capture_output=True, text=True)
    found = list(where.glob("*.tar.gz"))
    if done.returncode or len(found) != 1:
        said = (done.stderr.strip().splitlines() or ["nothing was loaded"])[-1]
        print(f"upstream.py: the source package of {name} {version} cannot be had: {said}")
        return None
    with tarfile.open(found[0]) as archive:
        archive.extractall(where, filter="data")
    return found[0].with_name(found[0].name.removesuffix(".tar.gz"))


def of_trimesh(version: str, scratch: Path) -> Path | None:
    """trimesh's tests with their models; else those of its source package, beside a stand-in for what it lacks."""
    root = fetched("mikedh/trimesh", version, scratch / "trimesh")
    if root is not None:
        return root
    root = from_source_package("trimesh", version, scratch / "trimesh_source")
    if root is None:
        return None
    if not (root / "tests/test_ray.py").exists():
        print(f"upstream.py: the source package of trimesh {version} has no tests")
        return None
    (root / "tests/generic.py").write_text(GENERIC)
    print(f"upstream.py: trimesh's tests are those of the source package of {version}; those that need its models are skipped")
    return root


def run(plugin: str, name: str, scratch: Path, tests: list[str], cwd: Path, more: list[str]) -> int:
    """pytest with a plugin that puts our classes in place."""
    (scratch / f"{name}.py").write_text(plugin)
    (scratch / "open3d_test.py").write_text(DEVICES)
    code = "import sys, pytest; sys.path.insert(0, sys.argv.pop(1)); sys.exit(pytest.main(sys.argv[1:]))"
    command = [sys.executable, "-c", code, str(scratch), "-p", name, "-p", "no:cacheprovider", "-q", "-s", "-rs", *more, *tests]
    return subprocess.run(command, cwd=cwd).returncode


def main() -> int:
    parser = argparse.ArgumentParser()
    parser.add_argument("--trimesh", type=Path)
    parser.add_argument("--open3d", type=Path)
    parser.add_argument("--only", choices=["trimesh", "open3d"])
    arguments, more = parser.parse_known_args()
    failed = 0
    with tempfile.TemporaryDirectory() as folder:
        scratch = Path(folder)
        if arguments.only != "open3d":
            import trimesh

            root = arguments.trimesh or of_trimesh(trimesh.__version__, scratch)
            if root is None:
                failed = 1
            else:
                tests = ["tests/test_ray.py", "tests/test_proximity.py"]
                failed |= run(TRIMESH, "with_our_trimesh", scratch, tests, root.resolve(), more)
        if arguments.only != "trimesh":
            try:
                import open3d
            except ImportError as error:
                print(f"upstream.py: Open3D's tests need open3d: {error}")
                return 1
            file = arguments.open3d
            if file is None:
                root = fetched("isl-org/Open3D", f"v{open3d.__version__}", scratch / "open3d_source")
                file = root and root / "python/test/t/geometry/test_raycasting_scene.py"
            if file is None:
                print("upstream.py: Open3D's tests are in its repository alone: give the file by --open3d")
                failed = 1
            else:
                failed |= run(OPEN3D, "with_our_open3d", scratch, [str(file.resolve())], scratch, more)
    return failed


if __name__ == "__main__":
    sys.exit(main())
