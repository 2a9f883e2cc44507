"""Drop-ins for trimesh's ``RayMeshIntersector`` and ``ProximityQuery``: methods, arguments, dtypes and the order of results are theirs.

>>> import trimesh                                         # doctest: +SKIP
>>> import splitplane.trimesh                              # doctest: +SKIP
>>> mesh = splitplane.trimesh.use(trimesh.load("bunny.ply"))   # doctest: +SKIP
>>> mesh.ray.intersects_first(origins, directions)         # doctest: +SKIP

Trees are built over float32 relative to the middle of the mesh, when they are first needed and after the mesh has changed.
Places and distances are computed in float64 from the mesh's own vertices. Rays through edges and vertices are not lost, and cross
a surface there once.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from trimesh import caching, util
from trimesh import triangles as triangles_of
from trimesh.constants import tol
from trimesh.ray.ray_util import contains_points as contains_by_rays

from . import _arrays as arrays
from . import _native
from ._arrays import F32, F64, I64, MISS, Bool
from .points import PointTree
from .tree import Shifted, Tree


def use(mesh: Any) -> Any:
    """Gives a mesh our ``ray`` and ``nearest`` in place of trimesh's, and returns it."""
    mesh.ray = RayMeshIntersector(mesh)
    mesh.nearest = ProximityQuery(mesh)
    return mesh


def tree_of(mesh: Any) -> Tree:
    """The tree of a mesh as it is now; kept with the mesh until it changes."""
    cache = mesh._cache
    # An entry is dropped when the mesh's hash changes.
    cache.verify()
    tree = cache.cache.get("splitplane_tree")
    if tree is None:
        tree = Tree.build(np.asarray(mesh.vertices), np.asarray(mesh.faces), origin="center")
        cache.cache["splitplane_tree"] = tree
    return tree  # type: ignore[no-any-return]


class RayMeshIntersector:
    """Ray queries of a mesh, as ``trimesh.ray.ray_pyembree.RayMeshIntersector``."""

    def __init__(self, geometry: Any = None, scale_to_box: bool = True, mesh: Any = None) -> None:
        """geometry: a Trimesh. scale_to_box: taken and not needed: no tree depends on the scale."""
        self.mesh = mesh if geometry is None else geometry
        self._scale_to_box = scale_to_box
        self._cache = caching.Cache(id_function=self.mesh.__hash__)

    def intersects_location(
        self, ray_origins: Any, ray_directions: Any, multiple_hits: bool = True, **kwargs: Any
    ) -> tuple[F64, I64, I64]:
        """Where rays hit: locations (m, 3) float64, rays (m,) int64, faces (m,) int64."""
        faces, rays, places = self.intersects_id(
            ray_origins, ray_directions, multiple_hits=multiple_hits, return_locations=True, **kwargs
        )
        return places, rays, faces

    def intersects_id(
        self,
        ray_origins: Any,
        ray_directions: Any,
        multiple_hits: bool = True,
        max_hits: int = 100,
        return_locations: bool = False,
    ) -> Any:
        """Faces (m,) and rays (m,) of all hits, or of the first of each ray; and their locations (m, 3) if asked for.

        First hits come first, in the order of the rays, then second ones, and so on; at most ``max_hits`` of a ray.
        """
        origins, directions, rows = self._rays(ray_origins, ray_directions)
        tree = tree_of(self.mesh)
        if multiple_hits:
            all_hits = tree.all_hits(rows)
            rays = all_hits.ray
            depth = np.arange(len(rays)) - all_hits.starts[rays]
            # They are in the order of the rays already; numbers of 16 bits are sorted by digits.
            narrow = depth.astype(np.uint16 if depth.max(initial=0) <= 0xFFFF else np.int64)
            order = np.argsort(narrow, kind="stable")
            order = order[: int(np.count_nonzero(depth < max_hits))]
            rays, faces = rays[order], all_hits.triangle[order].astype(np.int64)
            u, v = all_hits.u[order], all_hits.v[order]
        else:
            hits = tree.closest_hits(rows)
            rays = np.flatnonzero(hits.hit)
            faces = hits.triangle[rays].astype(np.int64)
            u, v = hits.u[rays], hits.v[rays]
        if return_locations:
            return faces, rays, self._places(faces, u, v, origins[rays], directions[rays])
        return faces, rays

    def intersects_first(self, ray_origins: Any, ray_directions: Any, **kwargs: Any) -> I64:
        """The face that each ray hits first, (n,) int64; -1 for a miss."""
        _, _, rows = self._rays(ray_origins, ray_directions, kwargs.get("threads"))
        tree = tree_of(self.mesh)
        triangle = tree.closest_hits(rows, **kwargs).triangle
        if len(tree) < 1 << 31:
            # As int32 the mark of a miss is -1.
            return triangle.view(np.int32).astype(np.int64)
        return np.where(triangle != np.uint32(MISS), triangle.astype(np.int64), -1)

    def intersects_any(self, ray_origins: Any, ray_directions: Any, **kwargs: Any) -> Bool:
        """Whether each ray hits the surface, (n,) bool."""
        _, _, rows = self._rays(ray_origins, ray_directions, kwargs.get("threads"))
        return tree_of(self.mesh).any_hits(rows, **kwargs)

    def contains_points(self, points: Any) -> Bool:
        """Whether each point is inside, (n,) bool: exactly for closed meshes, by trimesh's rays for open ones."""
        points = checked_points(points)
        if not self.mesh.is_watertight:
            return contains_by_rays(self, points)  # type: ignore[no-any-return]
        return tree_of(self.mesh).contains(points, rule="evenodd")

    def _rays(self, origins: Any, directions: Any, threads: Any = None) -> tuple[F64, F64, Shifted]:
        """Origins and directions in float64 as given, and rays as the tree takes them, with directions of length 1."""
        given = np.asarray(origins), np.asarray(directions)
        origins, directions = (np.require(one, np.float64, ["C", "A"]) for one in given)
        if origins.shape != directions.shape:
            raise ValueError("Ray origin and direction don't match!")
        if origins.ndim != 2 or origins.shape[1] != 3:
            if origins.size:
                raise ValueError("rays must be (n, 3)!")
            origins, directions = origins.reshape(0, 3), directions.reshape(0, 3)
        rows = arrays.room((len(origins), 6), np.float32)
        shift = tree_of(self.mesh).origin
        around = (0.0, 0.0, 0.0) if shift is None else (float(shift[0]), float(shift[1]), float(shift[2]))
        _native.unit_rays(origins, directions, around, rows, arrays.call(threads, None))
        return origins, directions, Shifted(rows)

    def _places(self, faces: I64, u: F32, v: F32, origins: F64, directions: F64) -> F64:
        """Where rays meet the planes of faces; where a ray is nearly in the plane, what the weights say."""
        length = np.sqrt(util.diagonal_dot(directions, directions))
        directions = directions / np.where(length > 0, length, 1.0)[:, None]
        a, b, c = (self.mesh.triangles.view(np.ndarray)[faces, corner] for corner in range(3))
        normal = np.cross(b - a, c - a)
        fall = util.diagonal_dot(normal, directions)
        size = np.sqrt(util.diagonal_dot(normal, normal))
        weights = a + u[:, None] * (b - a) + v[:, None] * (c - a)
        with np.errstate(invalid="ignore", divide="ignore"):
            t = util.diagonal_dot(normal, a - origins) / fall
            along = origins + t[:, None] * directions
        steep = np.abs(fall) > 1e-4 * size
        return np.asarray(np.where(steep[:, None], along, weights), dtype=np.float64)

    def __getstate__(self) -> dict[str, Any]:
        state = self.__dict__.copy()
        state.pop("_cache", None)
        return state

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._cache = caching.Cache(id_function=self.mesh.__hash__)

    def __deepcopy__(self, *_: Any) -> RayMeshIntersector:
        return self.__copy__()

    def __copy__(self, *_: Any) -> RayMeshIntersector:
        return RayMeshIntersector(self.mesh, self._scale_to_box)


class ProximityQuery:
    """Closest points of a mesh, as ``trimesh.proximity.ProximityQuery``."""

    def __init__(self, mesh: Any) -> None:
        self._mesh = mesh

    def on_surface(self, points: Any) -> tuple[F64, F64, I64]:
        """The closest point of each point: places (n, 3) float64, distances (n,) float64, faces (n,) int64.

        Where two faces are as near, the one whose front the point is before more squarely is named.
        """
        points = checked_points(points)
        tree = tree_of(self._mesh)
        found = tree.closest_points(points)
        faces = found.triangle.astype(np.int64)
        known = faces != MISS
        if not known.all():
            raise ValueError("a point is not finite, or the mesh has no faces")
        corners = self._mesh.triangles.view(np.ndarray)
        places = np.asarray(triangles_of.closest_point(corners[faces], points))
        distances = np.linalg.norm(points - places, axis=1)
        self._prefer_fronts(tree, points, places, distances, faces)
        return places, distances, faces

    def _prefer_fronts(self, tree: Tree, points: F64, places: F64, distances: F64, faces: I64) -> None:
        """Of two faces that are as near, names the one whose normal goes more towards the point."""
        normals = self._mesh.face_normals
        towards = points - places
        with np.errstate(invalid="ignore", divide="ignore"):
            square = util.diagonal_dot(normals[faces], towards) / distances
        # Straight above a face nothing else is as near.
        oblique = np.nonzero((distances**2 > tol.merge) & (square < 1 - 1e-6))[0]
        neighbours: Any = self._mesh.vertex_faces
        for corner in range(3) if len(oblique) else ():
            vertices = self._mesh.faces[faces[oblique], corner]
            for other in neighbours[vertices].T:
                there = np.nonzero(other >= 0)[0]
                here, other = oblique[there], other[there]
                at = triangles_of.closest_point(self._mesh.triangles.view(np.ndarray)[other], points[here])
                squared = ((at - points[here]) ** 2).sum(axis=1)
                near = np.abs(squared - distances[here] ** 2) < tol.merge
                better = util.diagonal_dot(normals[other], towards[here]) / distances[here]
                wins = near & (better > square[here] + 1e-12)
                faces[here[wins]], square[here[wins]] = other[wins], better[wins]

    def vertex(self, points: Any) -> tuple[Any, Any]:
        """The closest vertex of each point: distances (n,) float64 and vertices (n,) int64; numbers for one point."""
        points = np.asanyarray(points, dtype=np.float64)
        cache = self._mesh._cache
        cache.verify()
        tree = cache.cache.get("splitplane_vertices")
        if tree is None:
            tree = PointTree.build(np.asarray(self._mesh.vertices), origin="center")
            cache.cache["splitplane_vertices"] = tree
        found = tree.nearest(points, 1).index[..., 0].astype(np.int64)
        distance = np.linalg.norm(np.asarray(self._mesh.vertices)[found] - points, axis=-1)
        return distance, found if found.ndim else int(found)

    def signed_distance(self, points: Any) -> F64:
        """The distance of each point, (n,) float64: positive inside, negative outside. Exact signs for closed meshes."""
        points = checked_points(points)
        _, distance, _ = self.on_surface(points)
        away = distance > tol.merge
        inside = self._mesh.ray if hasattr(self._mesh.ray, "contains_points") else RayMeshIntersector(self._mesh)
        sign = np.where(inside.contains_points(points[away]), 1.0, -1.0)
        distance[away] *= sign
        return distance


def checked_points(points: Any) -> F64:
    """Points (n, 3) in float64."""
    own: F64 = np.asarray(points, dtype=np.float64)
    if own.ndim != 2 or own.shape[1] != 3:
        raise ValueError("points must be (n,3)!")
    return own


__all__ = ["ProximityQuery", "RayMeshIntersector", "tree_of", "use"]
