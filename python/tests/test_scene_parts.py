"""What scenes have besides meshes: shapes, opacity masks, lists of what is ignored, overlaps, and geometries that wait for rays; against brute force in float64."""

from __future__ import annotations

import pickle

import numpy as np
import pytest
from brute import all_hits_brute, capsules_hit, closest_brute, faces_met_by_box, sphere

import splitplane
from splitplane import MISS, Scene

VERTICES, FACES = sphere(10, 7)
PLACES = np.array([[0, 0, 0], [3, 0, 0], [0, 3, 0], [0, 0, 3.0]], np.float32)


def at(place: np.ndarray) -> np.ndarray:
    transform = np.eye(4)
    transform[:3, 3] = place
    return transform


def row(geometries: bool = False, **settings: object) -> Scene:
    """Balls at the places: instances of one geometry, or each a geometry of its own."""
    scene = Scene(**settings)
    ball = scene.add_geometry(VERTICES, FACES)
    for number, place in enumerate(PLACES):
        own = scene.add_geometry(VERTICES, FACES) if geometries and number else ball
        scene.add_instance(own, at(place), mask=1 << number)
    scene.update()
    return scene


def rays_at(count: int) -> np.ndarray:
    rng = np.random.default_rng(7)
    origins, targets = rng.normal(size=(count, 3)) * 6, rng.uniform(-1, 4, size=(count, 3))
    return np.concatenate([origins, targets - origins], axis=1).astype(np.float32)


def test_overlaps_are_those_of_the_world() -> None:
    scene, rng = row(), np.random.default_rng(1)
    middle, half = rng.uniform(-1.3, 4.3, (4, 40, 3)), rng.uniform(0.05, 1.2, (4, 40, 3))
    boxes = np.concatenate([middle - half, middle + half], axis=-1).astype(np.float32)
    found = scene.overlaps(boxes)
    assert found.starts.shape == (161,) and found.starts[-1] == len(found.triangle) == len(found.instance)
    for number, box in enumerate(boxes.reshape(-1, 6)):
        right = [(i, face) for i, place in enumerate(PLACES) for face in faces_met_by_box(VERTICES + place, FACES, box)]
        here = found.of(number)
        assert list(zip(found.instance[here].tolist(), found.triangle[here].tolist())) == right
    some = np.diff(found.starts) > 0
    assert 40 < some.sum() < 150 and len(set(found.instance.tolist())) == 4
    np.testing.assert_array_equal(scene.overlaps_any(boxes), some.reshape(4, 40))
    only = scene.overlaps(boxes, mask=4)
    assert set(only.instance.tolist()) == {2} and (only.triangle == found.triangle[found.instance == 2]).all()
    first = (int(found.instance[0]), int(found.triangle[0]))
    less = scene.overlaps(boxes, ignore=first)
    gone = (found.instance == first[0]) & (found.triangle == first[1])
    assert len(less.triangle) == len(found.triangle) - gone.sum()
    # Balls: what is within their radius.
    points, radius = rng.uniform(-2, 5, (200, 3)).astype(np.float32), rng.uniform(0, 1, 200).astype(np.float32)
    world = np.concatenate([VERTICES + place for place in PLACES])
    faces = np.concatenate([FACES + len(VERTICES) * i for i in range(4)])
    distance = closest_brute(world, faces, points)
    clear = np.abs(distance - radius) > 1e-5
    np.testing.assert_array_equal(scene.overlaps_any(np.column_stack([points, radius]), "ball")[clear], (distance <= radius)[clear])
    planes = [np.array([[1, 0, 0, 1.5]], np.float32), np.array([[-1, 0, 0, -1.5], [0, 0, 1, 9]], np.float32)]
    assert set(scene.overlaps(planes, "planes").instance.tolist()) == {0, 1, 2, 3}
    assert set(scene.overlaps(planes[1:], "planes").instance.tolist()) == {1}
    with pytest.raises(splitplane.OutOfMemoryError):
        scene.overlaps([[-9, -9, -9, 9, 9, 9]], max_memory=100)
    assert scene.overlaps([[-9, -9, -9, 9, 9, 9.1]]).report.rounded == 1


def test_lists_of_what_is_ignored() -> None:
    scene, rng = row(), np.random.default_rng(3)
    gone = rng.random((4, len(FACES))) < 0.4
    gone[3] = True
    pairs = [(i, face) for i, face in zip(*np.nonzero(gone)) if i != 3] + [(3, MISS)]
    rays = rays_at(300)
    hits = scene.closest_hits(rays, ignore=np.array(pairs))
    counted = scene.count_hits(rays, ignore=pairs)
    all_hits = scene.all_hits(rays, ignore=np.array(pairs, np.uint32))
    every = scene.all_hits(rays)
    kept = ~gone[every.instance, every.triangle]
    first = every.first(kept)
    for number, ray in enumerate(rays):
        best, crossings = (np.inf, MISS, MISS), 0
        for i, place in enumerate(PLACES):
            t, _, _, hit = all_hits_brute(VERTICES + place, FACES, ray)
            hit &= ~gone[i]
            crossings += int(hit.sum())
            t = np.where(hit, t, np.inf)
            best = min(best, (t.min(), i if hit.any() else MISS, int(t.argmin()) if hit.any() else MISS))
        np.testing.assert_allclose(hits.t[number], best[0], rtol=1e-4)
        assert (hits.instance[number], hits.triangle[number]) == best[1:]
        assert counted[number] == crossings == len(all_hits.t[all_hits.of(number)])
        # The same by all crossings and a mask over them.
        if first[number] < 0:
            assert not hits.hit[number]
        else:
            assert (every.instance[first[number]], every.triangle[first[number]]) == best[1:]
    np.testing.assert_array_equal(scene.any_hits(rays, ignore=pairs), hits.hit)
    assert 50 < hits.hit.sum() < scene.any_hits(rays).sum()
    # One pair is the same as a list of it, and an empty list is none.
    one = scene.closest_hits(rays[:1])
    pair = (int(one.instance[0]), int(one.triangle[0]))
    np.testing.assert_array_equal(scene.closest_hits(rays, ignore=pair).t, scene.closest_hits(rays, ignore=[pair]).t)
    # All of an instance, as a pair and as a list; what is near takes one triangle.
    mask_out = scene.any_hits(rays, ignore=[(1, MISS)])
    np.testing.assert_array_equal(scene.any_hits(rays, ignore=(1, MISS)), mask_out)
    assert mask_out.sum() < scene.any_hits(rays).sum()
    with pytest.raises(splitplane.RangeError, match="all of an instance"):
        scene.closest_points(rays[:, :3], ignore=(1, MISS))
    for empty in ([], (), np.zeros((0, 2), np.int64)):
        np.testing.assert_array_equal(scene.closest_hits(rays, ignore=empty).t, scene.closest_hits(rays).t)
    plain = every.first()
    np.testing.assert_array_equal(plain >= 0, np.diff(every.starts) > 0)
    np.testing.assert_array_equal(every.first(np.zeros(len(every.t), bool)), np.full(300, -1))
    for bad in (np.zeros(len(every.t)), np.zeros(3, bool), "x", None.__class__):
        with pytest.raises(splitplane.SplitplaneError):
            every.first(bad)


@pytest.mark.parametrize("level", [0, 1, 3])
def test_opacity_masks_let_rays_pass(level: int) -> None:
    scene, rng = row(), np.random.default_rng(level)
    opaque = rng.random((len(FACES), 4**level)) < 0.5
    scene.set_opacity(0, opaque)
    assert scene.stale and (scene.opacity(0) == opaque).all()
    scene.update()
    # Cells of a face that is made equilateral are the places nearest to their middles.
    even = np.array([[1.0, 0.0], [0.5, np.sqrt(0.75)]])
    middles = Scene.opacity_cells(level).astype(float) @ even
    assert middles.shape == (4**level, 2)
    rays = rays_at(200)
    hits, clear = scene.closest_hits(rays), 0
    for number, ray in enumerate(rays):
        best, doubtful = (np.inf, MISS, MISS), False
        for i, place in enumerate(PLACES):
            t, u, v, hit = all_hits_brute(VERTICES + place, FACES, ray)
            for face in np.nonzero(hit)[0]:
                far = np.linalg.norm(np.array([u[face], v[face]]) @ even - middles, axis=1)
                near = np.sort(far)[:2]
                doubtful |= len(near) == 2 and near[1] - near[0] < 1e-3 / 2**level
                if opaque[face, far.argmin()]:
                    best = min(best, (t[face], i, int(face)))
        if not doubtful:
            clear += 1
            np.testing.assert_allclose(hits.t[number], best[0], rtol=1e-4)
            assert (hits.instance[number], hits.triangle[number]) == best[1:]
    assert clear > 150 and 50 < hits.hit.sum() <= scene.any_hits(rays).sum() < 200
    kept = pickle.loads(pickle.dumps(scene))
    assert (kept.opacity(0) == opaque).all()
    scene.set_opacity(0, None)
    scene.update()
    assert scene.opacity(0) is None
    np.testing.assert_array_equal(scene.closest_hits(rays).t, row().closest_hits(rays).t)


def test_opacity_masks_that_are_none_are_refused() -> None:
    scene = row()
    balls = scene.add_shapes([[0, 0, 0, 1]])
    faces = len(FACES)
    for name, bad, error in [
        (0, np.zeros((faces, 4)), splitplane.DtypeError),
        (0, "x", splitplane.DtypeError),
        (0, np.zeros((faces, 3), bool), splitplane.ShapeError),
        (0, np.zeros((faces, 8), bool), splitplane.ShapeError),
        (0, np.zeros((faces, 0), bool), splitplane.ShapeError),
        (0, np.zeros(faces, bool), splitplane.ShapeError),
        (0, np.zeros((faces - 1, 1), bool), splitplane.ShapeError),
        (0, np.zeros((1, 4**13), bool), splitplane.ShapeError),
        (balls, np.zeros((1, 1), bool), splitplane.SceneError),
        (99, np.zeros((1, 1), bool), splitplane.UnknownNameError),
        (99, None, splitplane.UnknownNameError),
        (-1, None, splitplane.RangeError),
    ]:
        with pytest.raises(error):
            scene.set_opacity(name, bad)
    for level in (-1, 13, 1.5, "1", None):
        with pytest.raises(splitplane.SplitplaneError):
            Scene.opacity_cells(level)
    with pytest.raises(splitplane.UnknownNameError):
        scene.opacity(99)


def test_shapes_are_hit_where_they_are() -> None:
    rng = np.random.default_rng(11)
    ends = rng.uniform(-3, 3, (12, 2, 3)).astype(np.float32)
    ends[:6, 1] = ends[:6, 0]
    radius = rng.uniform(0.2, 0.8, 12).astype(np.float32)
    scene = Scene()
    spheres = scene.add_shapes(np.column_stack([ends[:6, 0], radius[:6]]))
    capsules = scene.add_shapes(np.column_stack([ends[6:].reshape(6, 6), radius[6:]]), "capsules")
    assert (scene.kind(spheres), scene.kind(capsules)) == ("spheres", "capsules")
    for own in (spheres, capsules):
        scene.add_instance(own)
    scene.update()
    rays = rays_at(400)
    rays[:, :3] *= 2
    t, which = capsules_hit(ends, radius, rays)
    for asked in (scene, pickle.loads(pickle.dumps(scene))):
        hits = asked.closest_hits(rays)
        np.testing.assert_array_equal(hits.hit, np.isfinite(t))
        here = hits.hit
        assert 40 < here.sum() < 390
        np.testing.assert_allclose(hits.t[here], t[here], rtol=1e-4, atol=1e-5)
        assert (hits.triangle[here] + 6 * (hits.instance[here] == 1) == which[here]).all()
        assert np.isnan(asked.normals(hits.geometry, hits.triangle)).all()
    points = rng.uniform(-4, 4, (50, 3)).astype(np.float32)
    a, n = ends[:, 0].astype(float), (ends[:, 1] - ends[:, 0]).astype(float)
    along = np.nan_to_num(((points[:, None] - a) * n).sum(-1) / np.maximum((n * n).sum(-1), 1e-30)).clip(0, 1)
    axis = np.linalg.norm(points[:, None] - (a + along[..., None] * n), axis=-1)
    np.testing.assert_allclose(scene.closest_points(points).distance, np.abs(axis - radius).min(1), atol=1e-5)
    with pytest.raises(splitplane.UnsupportedError):
        scene.overlaps([[-1, -1, -1, 1, 1, 1]])
    with pytest.raises(splitplane.UnsupportedError):
        scene.overlaps_any([[-1, -1, -1, 1, 1, 1]])
    scene.replace_shapes(spheres, [[0, 0, 50, 2]])
    scene.update()
    assert scene.closest_hits([0, 0, 90, 0, 0, -1]).t == 38
    scene.replace_shapes(spheres, [[0, 0, 50, 0, 0, 60, 2]], "capsules")
    scene.update()
    top = scene.closest_hits([0, 0, 90, 0, 0, -1])
    assert top.t == 28 and scene.kind(spheres) == "capsules" and top.u == 1
    for bad, kind, error in [
        ([[0, 0, 0]], "spheres", splitplane.ShapeError),
        ([[0, 0, 0, 1]], "capsules", splitplane.ShapeError),
        ([0, 0, 0, 1], "spheres", splitplane.ShapeError),
        (np.zeros((1, 1, 4)), "spheres", splitplane.ShapeError),
        ([[0, 0, 0, 1]], "balls", splitplane.ConfigError),
        ([[0, 0, 0, 1]], None, splitplane.DtypeError),
        ([["a", 0, 0, 1]], "spheres", splitplane.DtypeError),
        ([[0, 0, 0, 1e300]], "spheres", splitplane.RangeError),
    ]:
        with pytest.raises(error):
            scene.add_shapes(bad, kind)
        with pytest.raises(error):
            scene.replace_shapes(spheres, bad, kind)
    with pytest.raises(splitplane.SceneError, match="triangles"):
        scene.replace_shapes(scene.add_geometry(VERTICES, FACES), [[0, 0, 0, 1]])
    with pytest.raises(splitplane.SceneError, match="capsules"):
        scene.replace_geometry(spheres, VERTICES, FACES)
    # What is no shape is met by nothing, and is no error.
    odd = Scene()
    odd.add_instance(odd.add_shapes([[0, 0, 0, -1], [0, 0, 0, 0], [np.nan, 0, 0, 1], [0, 0, 9, 1]]))
    odd.update()
    assert odd.closest_hits([0, 0, -5, 0, 0, 1]).triangle == 3


def test_lazy_scenes_build_what_rays_reach() -> None:
    lazy, whole = row(geometries=True, lazy=True), row(geometries=True)
    assert lazy.waiting == 4 and whole.waiting == 0 and not lazy.stale
    hit = lazy.closest_hits([20, 0.1, 0.2, -1, 0, 0])
    assert hit.instance == 1 and lazy.waiting == 3
    assert not lazy.any_hits([20, 20, 20, 1, 0, 0]) and lazy.waiting == 3
    rays = rays_at(300)
    mine, right = lazy.closest_hits(rays), whole.closest_hits(rays)
    for name in ("t", "u", "v", "triangle", "geometry", "instance"):
        np.testing.assert_array_equal(getattr(mine, name), getattr(right, name))
    assert lazy.waiting == 0 and 50 < mine.hit.sum() < 300
    # Edits: what is as it was stays built.
    far = lazy.add_geometry(VERTICES, FACES)
    lazy.add_instance(far, at(np.array([0, 0, 50])))
    assert lazy.stale
    with pytest.raises(splitplane.StaleError):
        lazy.closest_hits(rays)
    assert lazy.update() == {"geometries_kept": 4, "geometries_waiting": 1}
    seen: list[str] = []
    lazy.complete(threads=1, progress=lambda stage, done, total: seen.append(stage))
    assert lazy.waiting == 0 and seen
    # What has no way builds all.
    boxes = [[-1, -1, -1, 5, 5, 5]]
    for ask in (
        lambda scene: scene.overlaps(boxes).triangle,
        lambda scene: scene.overlaps_any(boxes),
        lambda scene: scene.closest_points(rays[:, :3]).distance,
        lambda scene: scene.locate(rays[:, :3]).winding,
        lambda scene: np.array([scene.digest]),
        lambda scene: np.frombuffer(scene.to_bytes(), np.uint8),
    ):
        fresh = row(geometries=True, lazy=True)
        np.testing.assert_array_equal(ask(fresh), ask(whole))
        assert fresh.waiting == 0
    for ask in (lambda scene: scene.all_hits(rays).t, lambda scene: scene.count_hits(rays)):
        np.testing.assert_array_equal(ask(row(geometries=True, lazy=True)), ask(whole))
    kept = pickle.loads(pickle.dumps(row(geometries=True, lazy=True)))
    assert kept.digest == whole.digest and kept.waiting == 0


@pytest.mark.parametrize("preset", ["fast", "balanced", "best"])
def test_lazy_scenes_keep_their_layout(preset: str) -> None:
    def held(scene: Scene) -> int:
        scene.complete()
        return scene.query_bytes

    rays = rays_at(200)
    sizes, answers = {}, []
    for layout in ("fast", "compact"):
        whole, lazy = (row(geometries=True, preset=preset, layout=layout, lazy=lazy) for lazy in (False, True))
        empty = lazy.query_bytes
        assert empty < whole.query_bytes / 4
        answers += [whole.closest_hits(rays), lazy.closest_hits(rays)]
        assert lazy.waiting == 0 and lazy.query_bytes == whole.query_bytes
        sizes[layout] = lazy.query_bytes
        # What is built later is laid out in the same way: after an edit, under another limit, and in a copy.
        lazy.add_geometry(VERTICES, FACES)
        lazy.update()
        assert lazy.waiting == 1 and held(lazy) > sizes[layout] * 1.1
        lazy.remove_geometry(4)
        lazy.update(max_memory=1 << 30)
        assert lazy.waiting == 4 and lazy.query_bytes == empty
        assert held(lazy) == sizes[layout]
        assert pickle.loads(pickle.dumps(lazy)).query_bytes == sizes[layout]
    assert sizes["compact"] < 0.9 * sizes["fast"]
    for other in answers[1:]:
        for name in ("t", "u", "v", "triangle", "geometry", "instance"):
            np.testing.assert_array_equal(getattr(answers[0], name), getattr(other, name))
    assert answers[0].hit.any()


def test_lazy_scenes_keep_limits_and_end_builds() -> None:
    lazy = Scene(lazy=True)
    lazy.add_instance(lazy.add_geometry(*sphere(100, 60)))
    # The limit is one of a query that builds; another limit begins anew.
    assert lazy.update(max_memory=300_000) == {"geometries_kept": 0, "geometries_waiting": 1}
    rays = rays_at(50)
    with pytest.raises(splitplane.OutOfMemoryError, match="not built when it was needed: geometry 0"):
        lazy.closest_hits(rays)
    assert lazy.waiting == 1
    lazy.update()
    assert lazy.closest_hits(rays).hit.any() and lazy.waiting == 0
    lazy.update()
    assert lazy.waiting == 0
    lazy.update(max_memory=1 << 30)
    assert lazy.waiting == 1

    class Enough(Exception):
        pass

    def stop(stage: str, done: int, total: int) -> None:
        raise Enough

    fresh = row(geometries=True, lazy=True)
    with pytest.raises(Enough):
        fresh.complete(progress=stop)
    assert fresh.closest_hits(rays).hit.any()
    for bad in (None, 1, "yes", []):
        with pytest.raises(splitplane.DtypeError):
            Scene(lazy=bad)
    fresh.close()
    for ask in (fresh.complete, lambda: fresh.waiting, lambda: fresh.opacity(0), lambda: fresh.kind(0), lambda: fresh.overlaps([[0] * 6])):
        with pytest.raises(splitplane.DeadHandleError):
            ask()
