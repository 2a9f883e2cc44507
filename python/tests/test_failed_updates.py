"""After an update that failed a scene answers as before it, bit for bit; with its edits mended it is a scene made anew."""

from __future__ import annotations

import os
import pickle
import signal
import threading
import time
from typing import Any, Callable

import numpy as np
import pytest
from brute import sphere

import splitplane
from splitplane import MISS, Scene
from splitplane._meshes import Meshes

VERTICES, FACES = sphere(10, 7)


def at(place: Any, scale: float = 1.0) -> np.ndarray:
    transform = np.eye(4) * scale
    transform[:3, 3], transform[3, 3] = place, 1
    return transform


def made(**options: Any) -> Scene:
    """Balls of two geometries, one of which has holes, with masks."""
    scene = Scene(**options)
    ball, other = scene.add_geometry(VERTICES, FACES), scene.add_geometry(VERTICES * 0.5, FACES)
    scene.set_opacity(other, np.arange(len(FACES))[:, None] % 3 != 0)
    for number in range(6):
        scene.add_instance((ball, other)[number % 2], at([1.5 * number, 0.1, 0]), mask=1 << number, id=100 + number)
    scene.update()
    return scene


def edit(scene: Scene) -> None:
    """Edits of everything; geometries and instances take names that others had."""
    scene.replace_geometry(0, VERTICES[:, [1, 2, 0]] * 2, FACES[::-1])
    scene.set_opacity(1, None)
    scene.set_mask(2, 64)
    scene.move_instance(4, at([0, 3, 0], 0.5))
    for instance in (1, 3, 5):
        scene.remove_instance(instance)
    scene.remove_geometry(1)
    shapes = scene.add_shapes([[0, 0, 0, 0.7]])
    assert shapes == 1 and scene.add_instance(shapes, at([4, 4, 0])) == 5


def answers(scene: Scene) -> dict[str, bytes]:
    rng = np.random.default_rng(3)
    origins, targets = rng.normal(size=(300, 3)) * 6, rng.uniform([-1, -1, -1], [9, 1, 1], size=(300, 3))
    rays = np.concatenate([origins, targets - origins], axis=1).astype(np.float32)
    points = targets.astype(np.float32)
    boxes = np.concatenate([points - 0.2, points + 0.2], axis=1)
    found: dict[str, Any] = {}
    for name, own in {"all": {}, "masked": {"mask": 0b110110}, "ignoring": {"ignore": [[0, MISS], [3, 7]]}}.items():
        hits, crossings = scene.closest_hits(rays, **own), scene.all_hits(rays, **own)
        for column in ("t", "u", "v", "triangle", "geometry", "instance"):
            found[f"{name} {column}"] = getattr(hits, column)
            found[f"{name} all {column}"] = getattr(crossings, column)
        found[f"{name} starts"], found[f"{name} front"] = crossings.starts, crossings.front
        found[f"{name} any"], found[f"{name} count"] = scene.any_hits(rays, **own), scene.count_hits(rays, **own)
        found[f"{name} normals"] = scene.normals(hits.geometry, hits.triangle)
    assert scene.any_hits(rays).any()
    located = scene.locate(points)
    found["winding"], found["boundary"] = located.winding, located.boundary
    closest = scene.closest_points(points, mask=0b110110)
    for column in ("distance", "point", "triangle", "geometry", "instance", "u", "v"):
        found[f"closest {column}"] = getattr(closest, column)
    found["signed"] = scene.signed_distance(points)
    found["digest"], found["file"] = np.array(scene.digest), np.frombuffer(scene.to_bytes(), np.uint8)
    return {name: array.tobytes() for name, array in found.items()} | overlaps(scene, boxes)


def overlaps(scene: Scene, boxes: np.ndarray) -> dict[str, bytes]:
    """Those of shapes are refused."""
    try:
        met = scene.overlaps(boxes)
    except splitplane.UnsupportedError as error:
        return {"overlaps": str(error).encode()}
    return {"overlaps": met.triangle.tobytes() + met.instance.tobytes(), "any": scene.overlaps_any(boxes).tobytes()}


class Mine(Exception):
    pass


def raises(stage: str, done: int, total: int) -> None:
    raise Mine


def too_little(scene: Scene) -> None:
    with pytest.raises(splitplane.OutOfMemoryError, match="the scene answers as before the update$"):
        scene.update(max_memory=500)


def raised(scene: Scene) -> None:
    with pytest.raises(Mine):
        scene.update(progress=raises)


@pytest.mark.parametrize("fail", [too_little, raised])
def test_a_scene_whose_update_failed_answers_as_before(fail: Callable[[Scene], None]) -> None:
    scene = made()
    before = answers(scene)
    edit(scene)
    with pytest.raises(splitplane.StaleError):
        scene.any_hits([0, 0, 9, 0, 0, -1])
    for _ in range(2):
        fail(scene)
        assert scene.stale
        after = answers(scene)
        assert [name for name in before if before[name] != after[name]] == []
    copy = pickle.loads(pickle.dumps(scene))
    assert copy.digest == scene.digest and not copy.stale
    # An edit that is refused is none; the others are kept.
    with pytest.raises(splitplane.SceneError):
        scene.move_instance(0, np.zeros((3, 4)))
    assert answers(scene) == before and scene.instances == [0, 2, 4, 5]
    scene.update()
    fresh = made()
    edit(fresh)
    fresh.update()
    assert not scene.stale and answers(scene) == answers(fresh) != before


def test_edits_that_are_mended_after_a_failure() -> None:
    scene = made()
    before = answers(scene)
    scene.replace_geometry(0, VERTICES * 3, FACES)
    too_little(scene)
    scene.replace_geometry(0, VERTICES, FACES)
    # Edited again, and not tried.
    with pytest.raises(splitplane.StaleError):
        scene.digest
    scene.update()
    assert answers(scene) == before


def test_before_the_first_update_a_scene_is_empty() -> None:
    scene = Scene()
    scene.add_instance(scene.add_geometry(VERTICES, FACES))
    too_little(scene)
    assert scene.closest_hits([0, 0, 9, 0, 0, -1]).triangle == MISS
    assert np.isnan(scene.normals(0, 3)).all()
    scene.update()
    assert scene.closest_hits([0, 0, 9, 0, 0, -1]).triangle != MISS
    assert np.isfinite(scene.normals(0, 3)).all()


def test_lazy_scenes_whose_limit_is_too_small_answer_as_before() -> None:
    scene = made(lazy=True)
    before = answers(scene)
    edit(scene)
    too_little(scene)
    assert answers(scene) == before
    scene.update()
    fresh = made()
    edit(fresh)
    fresh.update()
    assert answers(scene) == answers(fresh)


def test_ctrl_c_leaves_the_scene() -> None:
    scene = made()
    before = answers(scene)
    size = 500
    x, y = np.meshgrid(np.arange(size), np.arange(size))
    corners = np.stack([x, y, np.sin(x * y)], axis=-1).reshape(-1, 3).astype(np.float32)
    first = (x[:-1, :-1] + size * y[:-1, :-1]).reshape(-1)
    scene.add_instance(scene.add_geometry(corners, np.stack([first, first + 1, first + size], axis=1)))

    def interrupt() -> None:
        time.sleep(0.05)
        os.kill(os.getpid(), signal.SIGINT)

    thread = threading.Thread(target=interrupt)
    thread.start()
    with pytest.raises(KeyboardInterrupt):
        scene.update(threads=1)
        time.sleep(10)
    thread.join()
    assert scene.stale and answers(scene) == before


def test_an_exception_after_the_last_step_undoes_nothing() -> None:
    scene = made()
    edit(scene)

    def late(stage: str, done: int, total: int) -> None:
        if stage != "start":
            raise Mine

    with pytest.raises(Mine):
        scene.update(progress=late)
    # Small scenes are done before anybody looks; should this one not be, it is what it was.
    fresh = made()
    if not scene.stale:
        edit(fresh)
        fresh.update()
    assert answers(scene) == answers(fresh)


def test_vertices_that_are_not_finite_are_met_by_nothing() -> None:
    broken = VERTICES.copy()
    broken[0] = np.nan
    scene, fresh = made(), made()
    before = answers(scene)
    scene.replace_geometry(0, broken, FACES)
    scene.update()
    fresh.replace_geometry(0, broken, FACES)
    too_little(fresh)
    assert answers(fresh) == before != answers(scene)
    scene.replace_geometry(0, VERTICES, FACES)
    scene.update()
    assert answers(scene) == before


def test_normals_of_what_was_only_edited_are_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = made()
    before = answers(scene)
    scene.replace_geometry(0, VERTICES[:, [1, 2, 0]] * 2, FACES[::-1])
    too_little(scene)
    monkeypatch.setattr(Meshes, "built", lambda self, updates: self.described.items())
    after = answers(scene)
    assert {name for name in before if before[name] != after[name]} == {"all normals", "masked normals", "ignoring normals"}
