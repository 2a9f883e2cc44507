"""What a scene consists of."""

from __future__ import annotations

from typing import Any

import numpy as np

from . import _arrays as arrays
from . import _native
from ._arrays import F32, MISS, U32, Bool, Progress
from ._handle import Handle
from ._meshes import Meshes
from ._options import Backend, BuildArguments
from .errors import ConfigError, DtypeError, ShapeError

#: Numbers of a shape, by kind.
SHAPES = {"spheres": 4, "capsules": 7}


def shapes_of(shapes: Any, kind: Any) -> F32:
    """Shapes as rows of numbers."""
    name = arrays.text(kind, "kind")
    if name not in SHAPES:
        raise ConfigError(f"there are no shapes `{name}`; there are spheres and capsules")
    rows, leading, _ = arrays.floats(shapes, "shapes", (SHAPES[name],))
    if len(leading) != 1:
        raise ShapeError(f"shapes has shape {(*leading, SHAPES[name])}, but must have (n, {SHAPES[name]})")
    return rows


def matrix_of(transform: Any) -> F32:
    """A transform as three rows of four."""
    if transform is None:
        return np.eye(3, 4, dtype=np.float32)
    array = arrays.as_array(transform, "transform")
    if array.dtype.kind not in "fiu":
        raise DtypeError(f"transform has dtype {array.dtype}; numbers are needed")
    if array.shape == (4, 4):
        if not np.array_equal(array[3], [0, 0, 0, 1]):
            raise ShapeError("the last row of a transform (4, 4) must be 0, 0, 0, 1")
        array = array[:3]
    if array.shape != (3, 4):
        raise ShapeError(f"transform has shape {array.shape}, but must have (3, 4) or (4, 4)")
    if array.dtype != np.float32:
        return arrays.narrowed(np.asarray(array, np.float64), "transform")[0]
    return np.require(array, np.float32, ["C", "A"])


class Edits(Handle[_native.Scene]):
    """What :class:`splitplane.Scene` consists of, and how it is edited."""

    _arguments: BuildArguments
    _backend: Backend
    _meshes: Meshes

    # Edits.

    def add_geometry(self, vertices: Any, faces: Any = None) -> int:
        """Adds a mesh, (n, 3) and (m, 3), or (n, 3, 3); its name."""
        native = self._native
        own, index, _ = arrays.mesh_of(vertices, faces, None)
        name = native.add_geometry(own, index)
        self._meshes.change(name, (own, index), native.updates())
        return name

    def replace_geometry(self, geometry: int, vertices: Any, faces: Any = None) -> None:
        """Gives a geometry another mesh; its instances stay."""
        native, name = self._native, arrays.whole(geometry, "geometry")
        own, index, _ = arrays.mesh_of(vertices, faces, None)
        native.replace_geometry(name, own, index)
        self._meshes.change(name, (own, index), native.updates())

    def add_shapes(self, shapes: Any, kind: str = "spheres") -> int:
        """Adds a geometry of shapes; its name. Hits name a shape as they do a face.

        kind: ``spheres``: (n, 4), centre and radius; ``capsules``: (n, 7), both ends of a segment and the radius: all points within
        that distance of it. In the unit of the scene; float32, other numbers are rounded. A shape whose numbers are not finite,
        or whose radius is not more than 0, is met by no ray. ``u`` of a capsule's hit is how far along its segment it is.
        Overlaps with instances of shapes are refused: UnsupportedError.
        """
        native, numbers = self._native, shapes_of(shapes, kind)
        return _native.add_shapes(native, kind, numbers)

    def replace_shapes(self, geometry: int, shapes: Any, kind: str = "spheres") -> None:
        """Gives a geometry of shapes others, of any kind; its instances stay. As :meth:`add_shapes`."""
        native, name, numbers = self._native, arrays.whole(geometry, "geometry"), shapes_of(shapes, kind)
        _native.replace_shapes(native, name, kind, numbers)

    def kind(self, geometry: int) -> str:
        """What a geometry consists of: ``triangles``, ``spheres`` or ``capsules``."""
        return _native.kind_of(self._native, arrays.whole(geometry, "geometry"))

    # Parts of faces that rays pass.

    def set_opacity(self, geometry: int, opaque: Any) -> None:
        """Says which parts of a geometry's faces rays meet, as a texture with holes does; ``None``: all of them.

        opaque: bool (faces, 4**level): whether rays meet each cell of each face. A face is divided into ``4**level`` congruent cells, its edges
        into ``2**level`` parts, level 0 to 12; :meth:`opacity_cells` says where they are. A mask is not built into a tree, and costs
        no calls when rays are traced. Points inside, closest points and overlaps are those of the whole mesh.
        """
        native, name = self._native, arrays.whole(geometry, "geometry")
        if opaque is None:
            _native.set_opacity(native, name, None)
            return
        cells = arrays.as_array(opaque, "opaque")
        if cells.dtype != np.bool_:
            raise DtypeError(f"opaque has dtype {cells.dtype}, but must be bool")
        level = (int(cells.shape[1]).bit_length() - 1) // 2 if cells.ndim == 2 and cells.shape[1] else -1
        if cells.ndim != 2 or cells.shape[1] != 4 ** max(level, 0):
            raise ShapeError(f"opaque has shape {cells.shape}, but must have (faces, 4**level)")
        if self.kind(name) == "triangles":
            faces = len(self._meshes.described[name][1])
            if len(cells) != faces:
                raise ShapeError(f"opaque has {len(cells)} rows, but geometry {name} has {faces} faces")
        bits = np.packbits(cells.reshape(-1), bitorder="little")
        words = np.zeros((len(bits) + 3) // 4, "<u4")
        words.view(np.uint8)[: len(bits)] = bits
        _native.set_opacity(native, name, (level, words.astype(np.uint32)))

    def opacity(self, geometry: int) -> Bool | None:
        """The opacity mask of a geometry, bool (faces, 4**level); none where all of it counts."""
        found = _native.opacity(self._native, arrays.whole(geometry, "geometry"))
        if found is None:
            return None
        level, faces, words = found
        cells = np.unpackbits(words.astype("<u4").view(np.uint8), bitorder="little", count=faces * 4**level)
        return cells.astype(np.bool_).reshape(faces, 4**level)

    @staticmethod
    def opacity_cells(level: int) -> F32:
        """The middles of a face's cells in the order of :meth:`set_opacity`: float32 (4**level, 2), u and v, the weights of the face's second and third
        corner. So ``a + u (b - a) + v (c - a)`` with texture coordinates for corners says what a texture has there."""
        return _native.opacity_cells(arrays.whole(level, "level", 0, 12)).reshape(-1, 2)

    def remove_geometry(self, geometry: int) -> None:
        """Removes a geometry that has no instances."""
        name = arrays.whole(geometry, "geometry")
        self._native.remove_geometry(name)
        self._meshes.change(name, None, self._native.updates())

    def add_instance(self, geometry: int, transform: Any = None, *, mask: int = MISS, id: int = 0, culling: str = "none") -> int:
        """Places a geometry; the instance's name.

        transform: (3, 4) or (4, 4), from the object to the world; none: where it is. mask: 32 bits. id: a number of the caller's.
        culling: the side of its faces that it ignores, seen in the world.
        """
        return self._native.add_instance(
            arrays.whole(geometry, "geometry"),
            matrix_of(transform),
            arrays.whole(mask, "mask"),
            arrays.whole(id, "id"),
            arrays.text(culling, "culling"),
        )

    def set_instance(
        self,
        instance: int,
        *,
        transform: Any = None,
        geometry: int | None = None,
        mask: int | None = None,
        id: int | None = None,
        culling: str | None = None,
    ) -> None:
        """Changes what is given of an instance."""
        self._native.set_instance(
            arrays.whole(instance, "instance"),
            arrays.maybe_whole(geometry, "geometry"),
            None if transform is None else matrix_of(transform),
            arrays.maybe_whole(mask, "mask"),
            arrays.maybe_whole(id, "id"),
            None if culling is None else arrays.text(culling, "culling"),
        )

    def move_instance(self, instance: int, transform: Any) -> None:
        """Moves an instance: from now on this is its transform."""
        self._native.set_instance(arrays.whole(instance, "instance"), None, matrix_of(transform), None, None, None)

    def set_mask(self, instance: int, mask: int) -> None:
        """Gives an instance another mask."""
        self._native.set_instance(
            arrays.whole(instance, "instance"), None, None, arrays.whole(mask, "mask"), None, None
        )

    def remove_instance(self, instance: int) -> None:
        """Removes an instance."""
        self._native.remove_instance(arrays.whole(instance, "instance"))

    def update(
        self, *, max_memory: int | None = None, threads: int | None = None, progress: Progress | None = None
    ) -> dict[str, int]:
        """Brings what answers up to date, and says what was done.

        After an error, a cancellation or Ctrl-C queries answer as they did before, whatever was edited since the last update that succeeded; before the
        first one the scene is empty. The edits stay: mend them or undo them, and update again. An exception of ``progress`` that comes when all is
        done already is raised, and undoes nothing; :attr:`stale` says so.

        Of a lazy scene it builds no geometry; ``max_memory`` then holds for what queries build, and another one than before begins anew.
        """
        native = self._native
        preset, knobs, layout, _ = self._arguments
        arguments = (preset, knobs, layout, arrays.memory(max_memory))
        return native.update(arguments, arrays.call(threads, progress))

    def complete(self, *, threads: int | None = None, progress: Progress | None = None) -> None:
        """Builds the geometries of a lazy scene that no ray has reached."""
        self._native.complete(arrays.call(threads, progress))

    # What it is.

    @property
    def instances(self) -> list[int]:
        """The names of all instances."""
        return self._native.instances()

    @property
    def geometries(self) -> list[int]:
        """The names of all geometries."""
        return self._native.geometries()

    def transform(self, instance: int) -> F32:
        """The transform of an instance, (3, 4) float32."""
        return np.asarray(self._native.instance(arrays.whole(instance, "instance"))[1], dtype=np.float32)

    def id(self, instance: int) -> int:
        """The caller's number of an instance."""
        return self._native.instance(arrays.whole(instance, "instance"))[3]

    @property
    def stale(self) -> bool:
        """Whether it was edited since the last update that succeeded."""
        return self._native.edited()

    @property
    def waiting(self) -> int:
        """How many geometries of a lazy scene are not built yet; 0 for others."""
        return self._native.waiting()

    @property
    def query_bytes(self) -> int:
        """Bytes that are held for queries: trees, what rays read, and placements. Those of geometries that wait are not among them."""
        return self._native.query_bytes()

    @property
    def digest(self) -> str:
        """16 hexadecimal digits that name geometries and instances. Builds all of a lazy scene."""
        return self._native.digest()

    @property
    def backend(self) -> str:
        """``cpu`` or ``wgpu``."""
        return self._native.backend()[0]

    def __len__(self) -> int:
        return len(self.instances)

    def __repr__(self) -> str:
        if self.closed:
            return "<splitplane.Scene, closed>"
        return f"<splitplane.Scene of {len(self)} instances of {len(self.geometries)} geometries on {self.backend}>"
