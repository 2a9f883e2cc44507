"""The meshes of a scene's geometries: as they are described, and as they were when it was built."""

from __future__ import annotations

from collections.abc import Iterator

from ._arrays import F32, U32

Mesh = tuple[F32, U32]


class Meshes:
    """Vertices and faces by the names of geometries. ``updates`` is always how many updates of the scene have succeeded."""

    def __init__(self, described: dict[int, Mesh]) -> None:
        self.described = described
        #: What a geometry was before it was edited; none where it was no mesh, or not there.
        self._before: dict[int, Mesh | None] = {}
        self._updates = 0

    def change(self, name: int, mesh: Mesh | None, updates: int) -> None:
        """Another mesh of a geometry, or none."""
        self._look_at(updates)
        self._before.setdefault(name, self.described.get(name))
        if mesh is None:
            self.described.pop(name, None)
        else:
            self.described[name] = mesh

    def built(self, updates: int) -> Iterator[tuple[int, Mesh]]:
        """Those that answer: of the last update that succeeded."""
        self._look_at(updates)
        for name in self.described.keys() | self._before.keys():
            mesh = self._before[name] if name in self._before else self.described[name]
            if mesh is not None:
                yield name, mesh

    def _look_at(self, updates: int) -> None:
        """After an update that succeeded, what was before it is gone."""
        if updates != self._updates:
            self._before.clear()
            self._updates = updates
