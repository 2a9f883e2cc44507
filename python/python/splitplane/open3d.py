"""A class of the shape of Open3D's ``t.geometry.RaycastingScene``: methods, keys and dtypes are those, on numpy arrays.

Arrays of anything with ``__dlpack__`` or ``numpy()`` are taken, Open3D's own tensors among them. Signs and occupancy are decided
exactly, so ``nsamples`` is taken and not needed. Rays through edges and vertices cross a surface there once.
"""

from __future__ import annotations

from typing import Any, Tuple

import numpy as np
import numpy.typing as npt

from . import _arrays as arrays
from . import _native
from ._arrays import F32, MISS, U32, Bool
from .errors import ConfigError, DtypeError, MeshError, RangeError, ShapeError
from .tree import Tree, normals_of


def _taken(value: Any, name: str) -> npt.NDArray[Any]:
    """An array of an array, a tensor, or nested lists."""
    if not isinstance(value, np.ndarray) and hasattr(value, "numpy"):
        return np.asarray(value.cpu().numpy() if hasattr(value, "cpu") else value.numpy())
    return arrays.as_array(value, name)


def _float32(value: Any, name: str, columns: int) -> F32:
    """Rows of float32, which Open3D insists on."""
    array = _taken(value, name)
    if array.dtype != np.float32:
        raise DtypeError(f"{name} has dtype {array.dtype}, but must be float32")
    if array.ndim < 2 or array.shape[-1] != columns:
        raise ShapeError(f"{name} has shape {array.shape}, but must have (..., {columns}) with at least 2 dimensions")
    return np.require(array, np.float32, ["C", "A"])


def _threads(count: Any) -> int | None:
    """0 is for all cores."""
    return arrays.whole(count, "nthreads", 0, 1024) or None


Columns = Tuple[U32, U32, F32, F32]


def _columns(count: int) -> Columns:
    """Room for geometries, faces, weights and normals.

    Two and two share an array: the system clears fresh memory page by page, which can take a third as long as the rays; of few large
    arrays that are given back the allocator keeps more for the next call.
    """
    if count == 0:
        # Empty parts of one array count as parts that overlap.
        return arrays.room((0,), np.uint32), arrays.room((0,), np.uint32), arrays.room((0, 2), np.float32), arrays.room((0, 3), np.float32)
    names, numbers = arrays.room((2, count), np.uint32), arrays.room((5 * count,), np.float32)
    return names[0], names[1], numbers[: 2 * count].reshape(count, 2), numbers[2 * count :].reshape(count, 3)


def _shaped(columns: Columns, shape: tuple[int, ...]) -> Columns:
    geometry, face, weights, normals = columns
    return geometry.reshape(shape), face.reshape(shape), weights.reshape(*shape, 2), normals.reshape(*shape, 3)


class RaycastingScene:
    """Meshes that are asked together. The tree is built with the first query after a mesh was added."""

    #: The id of no geometry and no face.
    INVALID_ID = MISS

    def __init__(self, nthreads: int = 0, device: Any = None, *, preset: str = "fast") -> None:
        """nthreads: for building; 0: all cores. device: taken where it is a CPU.

        preset: as in :meth:`splitplane.Tree.build`; Open3D's class has none. ``best`` takes longer to build, and pays with some millions of rays.
        """
        if device is not None and "CPU" not in str(device).upper():
            raise ConfigError(f"device {device} is not a CPU")
        self._nthreads = _threads(nthreads)
        if preset != "fast":
            # An unknown one is an error here, not at the first query.
            Tree.build(np.zeros((0, 3, 3), np.float32), preset=preset, threads=1)
        self._preset = preset
        self._vertices: list[F32] = []
        self._faces: list[U32] = []
        self._tree: Tree | None = None
        self._starts: U32 = np.zeros(1, np.uint32)
        self._normals: F32 | None = None

    def add_triangles(self, vertex_positions: Any = None, triangle_indices: Any = None, *, mesh: Any = None) -> int:
        """Adds vertices (n, 3) float32 and faces (m, 3) uint32, or a mesh with ``vertex.positions`` and ``triangle.indices``; its id."""
        if (vertex_positions is None) == (mesh is None):
            raise TypeError("a mesh is needed, or vertex_positions and triangle_indices")
        if mesh is not None:
            if triangle_indices is not None:
                raise TypeError("a mesh has its own triangle_indices")
            vertex_positions = mesh
        if triangle_indices is None:
            mesh = vertex_positions
            if not hasattr(mesh, "vertex") or not hasattr(mesh, "triangle"):
                raise DtypeError(f"a mesh or two arrays are needed, not {type(mesh).__name__}")
            vertices = _taken(mesh.vertex.positions, "vertex_positions").astype(np.float32)
            triangles = _taken(mesh.triangle.indices, "triangle_indices").astype(np.uint32)
        else:
            vertices, triangles = _taken(vertex_positions, "vertex_positions"), _taken(triangle_indices, "triangle_indices")
            if triangles.dtype != np.uint32:
                raise DtypeError(f"triangle_indices has dtype {triangles.dtype}, but must be uint32")
        vertices = _float32(vertices, "vertex_positions", 3)
        own, faces, _ = arrays.mesh_of(vertices, triangles, None)
        if len(faces) and int(faces.max()) >= len(own):
            raise MeshError(f"triangle_indices names vertex {int(faces.max())}, but there are {len(own)} vertices")
        self._vertices.append(own)
        self._faces.append(faces)
        self._tree = self._normals = None
        return len(self._vertices) - 1

    def _built(self) -> Tree:
        if self._tree is None:
            counts = [len(vertices) for vertices in self._vertices]
            firsts = np.concatenate([[0], np.cumsum(counts)]).astype(np.uint64)
            if firsts[-1] > MISS:
                raise RangeError(f"{firsts[-1]} vertices are more than a scene can name")
            parts = [faces + np.uint32(first) for faces, first in zip(self._faces, firsts)]
            vertices = np.concatenate(self._vertices) if counts else np.zeros((0, 3), np.float32)
            faces = np.concatenate(parts) if parts else np.zeros((0, 3), np.uint32)
            self._tree = Tree.build(vertices, faces, preset=self._preset, threads=self._nthreads)
            self._starts = np.concatenate([[0], np.cumsum([len(part) for part in self._faces])]).astype(np.uint32)
        return self._tree

    def _table(self) -> F32:
        """The unit normals of the tree's faces; 0 for faces that have none."""
        tree = self._built()
        if self._normals is None:
            own = normals_of(tree.vertices, tree.faces, np.arange(len(tree), dtype=np.int64))
            self._normals = np.nan_to_num(own).astype(np.float32)
        return self._normals

    def _named(self, triangle: U32, u: F32, v: F32, nthreads: Any) -> Columns:
        """Geometries, faces, weights and unit normals of faces of the tree; normals are 0 for a miss."""
        table, columns = self._table(), _columns(triangle.size)
        call = (_threads(nthreads), None)
        _native.named(triangle.reshape(-1), u.reshape(-1), v.reshape(-1), self._starts, table, *columns, call)
        return _shaped(columns, triangle.shape)

    def cast_rays(self, rays: Any, nthreads: int = 0) -> dict[str, Any]:
        """The first hit of rays (..., 6) float32: ``t_hit``, ``geometry_ids``, ``primitive_ids``, ``primitive_uvs``, ``primitive_normals``."""
        rows = _float32(rays, "rays", 6)
        leading, rows = rows.shape[:-1], rows.reshape(-1, 6)
        tree, table, columns = self._built()._native, self._table(), _columns(len(rows))
        t = arrays.room((len(rows),), np.float32)
        _native.cast_named(tree, rows, self._starts, table, t, *columns, (_threads(nthreads), None))
        geometry, face, weights, normals = _shaped(columns, leading)
        return {
            "t_hit": t.reshape(leading),
            "geometry_ids": geometry,
            "primitive_ids": face,
            "primitive_uvs": weights,
            "primitive_normals": normals,
        }

    def test_occlusions(self, rays: Any, tnear: float = 0.0, tfar: float = np.inf, nthreads: int = 0) -> Bool:
        """Whether rays (..., 6) hit anything: bool."""
        rows = _float32(rays, "rays", 6)
        return self._built().any_hits(rows, t_min=tnear, t_max=tfar, threads=_threads(nthreads))

    def count_intersections(self, rays: Any, nthreads: int = 0) -> npt.NDArray[np.int32]:
        """How often rays (..., 6) cross surfaces: int32."""
        found = self._built().count_hits(_float32(rays, "rays", 6), threads=_threads(nthreads))
        return found.astype(np.int32)

    def list_intersections(self, rays: Any, nthreads: int = 0) -> dict[str, Any]:
        """All crossings of rays, ray by ray: ``ray_splits`` (rays + 1), ``ray_ids``, and as :meth:`cast_rays` ``t_hit``,
        ``geometry_ids``, ``primitive_ids``, ``primitive_uvs``."""
        found = self._built().all_hits(_float32(rays, "rays", 6), threads=_threads(nthreads))
        geometry, face, weights, _ = self._named(found.triangle, found.u, found.v, nthreads)
        if len(found.t) > MISS or len(found.starts) > MISS:
            raise RangeError("more rays or intersections than uint32 can count; ask for fewer rays at a time")
        return {
            "ray_splits": found.starts.astype(np.uint32),
            "ray_ids": found.ray.astype(np.uint32),
            "t_hit": found.t,
            "geometry_ids": geometry,
            "primitive_ids": face,
            "primitive_uvs": weights,
        }

    def compute_closest_points(self, query_points: Any, nthreads: int = 0) -> dict[str, Any]:
        """The closest points of points (..., 3) float32: ``points``, ``geometry_ids``, ``primitive_ids``, ``primitive_uvs``,
        ``primitive_normals``."""
        found = self._built().closest_points(_float32(query_points, "query_points", 3), threads=_threads(nthreads))
        geometry, face, weights, normals = self._named(found.triangle, found.u, found.v, nthreads)
        return {
            "points": found.point,
            "geometry_ids": geometry,
            "primitive_ids": face,
            "primitive_uvs": weights,
            "primitive_normals": normals,
        }

    def compute_distance(self, query_points: Any, nthreads: int = 0) -> F32:
        """The distances of points (..., 3): float32."""
        found = self._built().closest_points(_float32(query_points, "query_points", 3), threads=_threads(nthreads))
        return found.distance.astype(np.float32)

    def compute_signed_distance(self, query_points: Any, nthreads: int = 0, nsamples: int = 1) -> F32:
        """The same, negative inside."""
        _odd(nsamples)
        rows = _float32(query_points, "query_points", 3)
        return self._built().signed_distance(rows, rule="evenodd", threads=_threads(nthreads)).astype(np.float32)

    def compute_occupancy(self, query_points: Any, nthreads: int = 0, nsamples: int = 1) -> F32:
        """1 for points inside, else 0: float32."""
        _odd(nsamples)
        rows = _float32(query_points, "query_points", 3)
        return self._built().contains(rows, rule="evenodd", threads=_threads(nthreads)).astype(np.float32)

    @staticmethod
    def create_rays_pinhole(*arguments: Any, **named: Any) -> F32:
        """Rays of a pinhole camera, (height_px, width_px, 6) float32.

        Either ``intrinsic_matrix`` (3, 3), ``extrinsic_matrix`` (4, 4, world to camera), ``width_px``, ``height_px``; or ``fov_deg``
        (horizontal), ``center``, ``eye``, ``up``, ``width_px``, ``height_px``.
        """
        if len(arguments) + len(named) == 4:
            return _by_matrices(*arguments, **named)
        return _by_view(*arguments, **named)


def _odd(samples: Any) -> None:
    if arrays.whole(samples, "nsamples", 1) % 2 == 0:
        raise ConfigError("nsamples must be odd")


def _matrix(value: Any, name: str, shape: tuple[int, ...]) -> npt.NDArray[np.float64]:
    matrix = np.asarray(_taken(value, name), dtype=np.float64)
    if matrix.shape != shape:
        raise ShapeError(f"{name} has shape {matrix.shape}, but must have {shape}")
    return matrix


def _by_matrices(intrinsic_matrix: Any, extrinsic_matrix: Any, width_px: int, height_px: int) -> F32:
    inner = _matrix(intrinsic_matrix, "intrinsic_matrix", (3, 3))
    outer = _matrix(extrinsic_matrix, "extrinsic_matrix", (4, 4))
    width, height = arrays.whole(width_px, "width_px", 1, 1 << 20), arrays.whole(height_px, "height_px", 1, 1 << 20)
    rotation, shift = outer[:3, :3], outer[:3, 3]
    eye = -rotation.T @ shift
    try:
        to_world = rotation.T @ np.linalg.inv(inner)
    except np.linalg.LinAlgError:
        raise ConfigError("intrinsic_matrix has no inverse") from None
    x, y = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    directions = np.stack([x, y, np.ones_like(x)], axis=-1) @ to_world.T
    rays = arrays.room((height, width, 6), np.float32)
    rays[..., :3], rays[..., 3:] = eye, directions
    return rays


def _by_view(fov_deg: float, center: Any, eye: Any, up: Any, width_px: int, height_px: int) -> F32:
    middle, place, above = (_matrix(value, name, (3,)) for value, name in ((center, "center"), (eye, "eye"), (up, "up")))
    width, height = arrays.whole(width_px, "width_px", 1, 1 << 20), arrays.whole(height_px, "height_px", 1, 1 << 20)
    focal = 0.5 * width / np.tan(0.5 * np.deg2rad(arrays.number(fov_deg, "fov_deg")))
    inner = np.array([[focal, 0, 0.5 * width], [0, focal, 0.5 * height], [0, 0, 1]])
    forward = middle - place
    # Open3D's choice: the first row of pixels is the lowest, the first column the rightmost.
    left = np.cross(above, forward)
    upwards = np.cross(forward, left)
    with np.errstate(invalid="ignore", divide="ignore"):
        axes = np.array([axis / np.linalg.norm(axis) for axis in (left, upwards, forward)])
    if not np.isfinite(axes).all():
        raise ConfigError("center, eye and up do not make a view")
    outer = np.eye(4)
    outer[:3, :3], outer[:3, 3] = axes, -axes @ place
    return _by_matrices(inner, outer, width, height)


def get_version() -> str:
    """The version of splitplane."""
    from . import __version__

    return __version__
