"""What an installed splitplane must do at least: run by wheel.sh, outside of the checkout."""

import pathlib
import sys
import tempfile

import numpy as np

import splitplane

# Not the sources beside this script.
assert sys.prefix in str(pathlib.Path(splitplane.__file__).resolve()), splitplane.__file__

# A cube by its twelve triangles, and rays through its middle from all sides.
corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], np.float32)
faces = [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]]
tree = splitplane.Tree.build(corners, faces)
rng = np.random.default_rng(7)
towards = rng.normal(size=(1000, 3))
towards /= np.abs(towards).max(axis=1, keepdims=True)
rays = np.concatenate([towards * 3, -towards], axis=1).astype(np.float32)
for accuracy in ("fast", "watertight", "exact"):
    hits = tree.closest_hits(rays, accuracy=accuracy)
    np.testing.assert_allclose(hits.t, 2, rtol=1e-5)
assert tree.any_hits(rays).all() and tree.contains(rays[:, :3] / 4).all() and not tree.contains(rays[:, :3]).any()
np.testing.assert_allclose(tree.signed_distance(np.zeros((1, 3), np.float32)), -1, rtol=1e-6)

with tempfile.TemporaryDirectory() as folder:
    path = pathlib.Path(folder) / "cube.tree"
    tree.save(path)
    again = splitplane.Tree.load(path, corners, faces)
assert again.digest == tree.digest

cloud = rng.normal(size=(500, 3)).astype(np.float32)
found = splitplane.PointTree.build(cloud).nearest(cloud, 1)
assert (found.index[:, 0] == np.arange(500)).all()

scene = splitplane.Scene()
scene.add_instance(scene.add_geometry(corners, faces))
scene.update()
np.testing.assert_allclose(scene.closest_hits(rays).t, 2, rtol=1e-5)

try:
    splitplane.Tree.build(corners, [[0, 1, 99]])
except ValueError as error:
    assert "99" in str(error), error
else:
    raise AssertionError("a face of a vertex that is not there was taken")
print(f"splitplane {splitplane.__version__}, Python {sys.version.split()[0]}, numpy {np.__version__}: it works")
