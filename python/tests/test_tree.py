"""Trees against brute force in float64."""

from __future__ import annotations

import copy
import dataclasses
import pickle
from pathlib import Path

import numpy as np
import pytest
from brute import closest_brute, hits_brute, sphere

import splitplane
from splitplane import MISS, Scene, Tree

RAYS = np.random.default_rng(1)


@pytest.fixture(scope="module")
def ball() -> tuple[np.ndarray, np.ndarray]:
    return sphere(24, 16)


@pytest.fixture(scope="module")
def tree(ball: tuple[np.ndarray, np.ndarray]) -> Tree:
    return Tree.build(*ball)


def rays_at(count: int, seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    origins = rng.normal(size=(count, 3)) * 2
    targets = rng.normal(size=(count, 3)) * 0.5
    return np.concatenate([origins, targets - origins], axis=1).astype(np.float32)


def test_one_triangle() -> None:
    tree = Tree.build([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    hits = tree.closest_hits([[0.25, 0.25, 5, 0, 0, -1], [5, 5, 5, 0, 0, -1]])
    assert hits.t.tolist() == [5.0, np.inf]
    assert hits.triangle.tolist() == [0, MISS]
    assert hits.hit.tolist() == [True, False]
    assert tree.any_hits([0.25, 0.25, 5, 0, 0, -1]).item() is True


def test_closest_hits_are_those_of_brute_force(tree: Tree, ball: tuple[np.ndarray, np.ndarray]) -> None:
    rays = rays_at(2000)
    t, triangle, count = hits_brute(*ball, rays)
    hits = tree.closest_hits(rays)
    clear = np.isfinite(t)
    assert 500 < clear.sum() < 2000
    np.testing.assert_array_equal(hits.hit, clear)
    np.testing.assert_allclose(hits.t[clear], t[clear], rtol=1e-5)
    assert (hits.triangle[clear] == triangle[clear]).mean() > 0.99
    np.testing.assert_array_equal(tree.any_hits(rays), clear)
    np.testing.assert_array_equal(tree.count_hits(rays), count)
    points = tree.points_at(hits.triangle, hits.u, hits.v)
    expected = rays[:, :3] + t[:, None] * rays[:, 3:].astype(float)
    np.testing.assert_allclose(points[clear], expected[clear], atol=2e-6)
    assert np.isnan(points[~clear]).all()


def test_a_planted_fault_is_found(ball: tuple[np.ndarray, np.ndarray]) -> None:
    """The oracle notices a triangle that is missing."""
    vertices, faces = ball
    rays = rays_at(2000)
    t, _, _ = hits_brute(vertices, faces, rays)
    damaged = Tree.build(vertices, faces[faces[:, 0] != faces[100, 0]]).closest_hits(rays)
    assert (damaged.hit != np.isfinite(t)).any() or not np.allclose(damaged.t, t, rtol=1e-5)


def test_all_hits_are_in_order(tree: Tree, ball: tuple[np.ndarray, np.ndarray]) -> None:
    rays = rays_at(500)
    found = tree.all_hits(rays)
    t, _, count = hits_brute(*ball, rays)
    assert np.diff(found.starts).tolist() == count.tolist()
    assert found.ray.tolist() == np.repeat(np.arange(500), count).tolist()
    for ray in range(500):
        own = found.t[found.of(ray)]
        assert (np.diff(own) >= 0).all()
        if len(own):
            assert own[0] == pytest.approx(t[ray], rel=1e-5)
            # Outside of a convex body a ray comes in through a front.
            assert found.front[found.of(ray)][-1].item() is False


def test_shapes_are_those_of_the_rays(tree: Tree) -> None:
    rays = rays_at(60)
    flat = tree.closest_hits(rays)
    cube = tree.closest_hits(rays.reshape(3, 4, 5, 6))
    assert cube.t.shape == (3, 4, 5)
    np.testing.assert_array_equal(cube.t.reshape(-1), flat.t)
    whole = np.zeros((60, 8), np.float32)
    whole[:, :3], whole[:, 4:7], whole[:, 7] = rays[:, :3], rays[:, 3:], np.inf
    np.testing.assert_array_equal(tree.closest_hits(whole).t, flat.t)
    assert tree.closest_hits(rays[:0]).t.shape == (0,)
    assert tree.closest_hits(np.zeros((4, 0, 6), np.float32)).t.shape == (4, 0)
    for view in (rays[::-1], rays[::2], np.asfortranarray(rays), rays[:, ::-1][:, ::-1]):
        np.testing.assert_array_equal(
            tree.closest_hits(view).t, tree.closest_hits(np.ascontiguousarray(view)).t
        )
    unaligned = np.frombuffer(b"\0" + rays.tobytes(), dtype=np.uint8)[1:].view(np.float32).reshape(-1, 6)
    np.testing.assert_array_equal(tree.closest_hits(unaligned).t, flat.t)
    np.testing.assert_array_equal(tree.closest_hits(rays.astype(">f4")).t, flat.t)


COLUMNS = ("t", "triangle", "u", "v")


def strange_rays(count: int) -> np.ndarray:
    """Rays of which some hit nothing, whatever the mesh: not finite, without a direction; and some that are moved before they are traced."""
    rays = rays_at(count, count)
    for first, kind in enumerate((np.nan, np.inf, -np.inf, 0, 1e-45)):
        rays[20 + first :: 23, 3:] = kind
    rays[3::31, 2] = np.nan
    rays[7::37, :3] -= rays[7::37, 3:] * np.float32(1e6)
    return rays


@pytest.mark.parametrize("count", [0, 1, 16, 17, 31, 32, 33, 34, 4095, 4096, 4097, 9000])
def test_rays_of_six_and_of_eight_numbers_give_the_same_bits(tree: Tree, count: int) -> None:
    rays = strange_rays(count)
    wide = np.full((count, 13), np.nan, np.float32)
    wide[:, 4:10] = rays
    frozen = rays.copy()
    frozen.flags.writeable = False
    unaligned = np.frombuffer(b"\0" + rays.tobytes(), dtype=np.uint8)[1:].view(np.float32).reshape(-1, 6)
    # Whatever lies around them, and in whichever order they lie.
    forms = [rays, frozen, unaligned, wide[:, 4:10], wide[::-1, 4:10][::-1], rays[:, ::-1].copy()[:, ::-1], np.asfortranarray(rays), np.repeat(rays, 2, axis=0)[::2],
             rays.astype(np.float64), rays.astype(">f4"), list(map(list, rays)) or rays]  # fmt: skip
    for least, most in ((None, None), (0.25, 3.5), (-2.0, np.inf), (2.0, 1.0), (np.nan, 1.0)):
        whole = np.zeros((count, 8), np.float32)
        whole[:, :3], whole[:, 4:7] = rays[:, :3], rays[:, 3:]
        whole[:, 3], whole[:, 7] = 0 if least is None else least, np.inf if most is None else most
        limits = {} if least is None else {"t_min": least, "t_max": most}
        for accuracy in ("watertight", "exact", "fast"):
            right, occluded = tree.closest_hits(whole, accuracy=accuracy), tree.any_hits(whole, accuracy=accuracy)
            np.testing.assert_array_equal(occluded, right.hit)
            if count > 4000 and (least is None or least < 1):
                assert 100 < right.hit.sum() < count - 100
            for threads, form in enumerate(forms if accuracy == "watertight" else forms[:1]):
                found = tree.closest_hits(form, accuracy=accuracy, threads=threads % 3 or None, **limits)
                for name in COLUMNS:
                    assert getattr(found, name).tobytes() == getattr(right, name).tobytes(), (name, threads, limits)
                np.testing.assert_array_equal(tree.any_hits(form, accuracy=accuracy, **limits), occluded)
            # Another number is other bits.
            if count > 4000 and least is None:
                moved = tree.closest_hits(rays * np.float32([1, 1, 1.001, 1, 1, 1]), accuracy=accuracy)
                assert (moved.t != right.t)[right.hit].mean() > 0.9
            # Limits of each ray's own are another way in.
            if least is not None:
                each = {name: np.full(count, value, np.float32) for name, value in limits.items()}
                found = tree.closest_hits(rays, accuracy=accuracy, **each)
                assert all(getattr(found, name).tobytes() == getattr(right, name).tobytes() for name in COLUMNS)
                found = tree.closest_hits(rays, accuracy=accuracy, t_min=each["t_min"], t_max=limits["t_max"])
                assert all(getattr(found, name).tobytes() == getattr(right, name).tobytes() for name in COLUMNS)


def test_limits_are_numbers_or_arrays(tree: Tree) -> None:
    rays = rays_at(200)
    t = tree.closest_hits(rays).t
    beyond = tree.closest_hits(rays, t_min=np.nextafter(t, np.float32(np.inf)))
    assert ((beyond.t > t) | ~np.isfinite(beyond.t)).all()
    short = tree.any_hits(rays, t_max=np.where(np.isfinite(t), t, 1) * np.float32(0.5))
    assert not short.any()
    at = tree.any_hits(rays, t_max=t)
    np.testing.assert_array_equal(at, np.isfinite(t))
    assert not tree.any_hits(rays, t_min=0.0, t_max=0.0).any()


def test_one_ray_and_many_give_the_same_bits(tree: Tree) -> None:
    rays = rays_at(300)
    many = tree.closest_hits(rays, threads=2)
    for place in range(300):
        one = tree.closest_hits(rays[place])
        assert one.t.shape == ()
        assert (one.t, one.triangle, one.u, one.v) == tuple(
            column[place] for column in (many.t, many.triangle, many.u, many.v)
        )


@pytest.mark.parametrize("threads", [1, 2, 5])
def test_threads_do_not_matter(tree: Tree, ball: tuple[np.ndarray, np.ndarray], threads: int) -> None:
    rays = rays_at(5000)
    assert Tree.build(*ball, threads=threads).digest == tree.digest
    np.testing.assert_array_equal(tree.closest_hits(rays, threads=threads).t, tree.closest_hits(rays).t)


@pytest.mark.parametrize(
    "options",
    [
        {"preset": "fast"},
        {"preset": "narrow"},
        {"preset": "balanced"},
        {"preset": "best"},
        {"builder": "binned", "bins": 8},
        {"builder": "sweep", "bad_splits": 2},
        {"max_depth": 4, "clip": False},
        {"layout": "compact"},
    ],
)
def test_options_change_trees_but_not_hits(tree: Tree, ball: tuple[np.ndarray, np.ndarray], options: dict) -> None:
    other = Tree.build(*ball, **options)
    assert (other.digest == tree.digest) == (options in ({"preset": "fast"}, {"layout": "compact"}))
    rays = rays_at(1000)
    for accuracy in ("watertight", "exact"):
        mine, own = (one.closest_hits(rays, accuracy=accuracy) for one in (tree, other))
        np.testing.assert_array_equal(mine.t, own.t)
        np.testing.assert_array_equal(mine.triangle, own.triangle)


def test_vertices_are_not_missed() -> None:
    vertices, faces = sphere(64, 32)
    tree = Tree.build(vertices, faces)
    origins = (vertices * 3).astype(np.float32)
    rays = np.concatenate([origins, vertices.astype(np.float32) - origins], axis=1)
    assert tree.closest_hits(rays).hit.all()
    assert tree.closest_hits(rays, accuracy="exact").hit.mean() > 0.9


def test_closest_points_are_those_of_brute_force(tree: Tree, ball: tuple[np.ndarray, np.ndarray]) -> None:
    points = np.random.default_rng(3).normal(size=(400, 3)).astype(np.float32)
    distance = closest_brute(*ball, points)
    found = tree.closest_points(points)
    np.testing.assert_allclose(found.distance, distance, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(found.point - points, axis=1), distance, atol=1e-6)
    signed = tree.signed_distance(points)
    inside = np.linalg.norm(points, axis=1) < 0.97
    assert (signed[inside] < 0).all() and (signed[np.linalg.norm(points, axis=1) > 1] > 0).all()
    np.testing.assert_array_equal(np.abs(signed), found.distance)
    assert tree.contains(points)[inside].all()
    near = tree.closest_points(points, max_distance=0.25)
    np.testing.assert_array_equal(near.found, found.distance <= 0.25)
    assert np.isinf(near.distance[~near.found]).all() and np.isnan(near.point[~near.found]).all()


def test_the_nearest_face_is_exact_if_asked() -> None:
    """Of faces that are as near the lowest, where roundings prefer another; and the greatest distance is compared exactly."""
    a = np.float32([[0.1, 0.2, 0.7], [0.9, 0.3, 0.1], [0.4, 0.8, 0.5]])
    turned = [a, a[:, [1, 2, 0]], a[:, [2, 0, 1]]]
    vertices, faces = np.concatenate(turned), np.arange(9).reshape(3, 3)
    orders = ([0, 1, 2], [1, 2, 0], [2, 0, 1])
    middle = np.float32([[x, x, x] for x in np.linspace(-2, 2, 101)])
    for order in orders:
        for made in (Tree.build(vertices, faces[order]), scene_of(vertices, faces[order])):
            found = made.closest_points(middle, accuracy="exact")
            assert (found.triangle == 0).all()
            usual = made.closest_points(middle)
            np.testing.assert_allclose(found.distance, usual.distance, rtol=1e-12)
    square = Tree.build([[3, 4, 0], [9, 4, 0], [3, 9, 0]], [[0, 1, 2]])
    for limit, some in ((5, True), (np.nextafter(np.float32(5), np.float32(0)), False)):
        assert square.closest_points([0, 0, 0], accuracy="exact", max_distance=float(limit)).found == some


def scene_of(vertices: np.ndarray, faces: np.ndarray) -> Scene:
    scene = Scene()
    scene.add_instance(scene.add_geometry(vertices, faces))
    scene.update()
    return scene


def test_points_on_the_surface_are_known(tree: Tree) -> None:
    on = tree.vertices[:5]
    located = tree.locate(on)
    assert located.boundary.all() and not located.inside().any()
    assert (tree.signed_distance(on) == 0).all()
    assert tree.locate([0, 0, 0]).winding == 1


def test_float64_says_what_it_rounds() -> None:
    far = np.array([1e7, -2e7, 3e7])
    vertices, faces = sphere(24, 16)
    vertices = np.asarray(vertices, np.float32).astype(np.float64)
    assert Tree.build(vertices, faces).summary.rounded == 0
    moved = vertices + far
    coarse = Tree.build(moved, faces)
    assert coarse.summary.rounded > 100
    fine = Tree.build(moved, faces, origin=far)
    assert fine.summary.rounded < coarse.summary.rounded
    rays = rays_at(500).astype(np.float64)
    rays[:, :3] += far
    near = Tree.build(vertices, faces).closest_hits(rays_at(500))
    hits = fine.closest_hits(rays)
    np.testing.assert_array_equal(hits.hit, near.hit)
    np.testing.assert_allclose(hits.t[hits.hit], near.t[hits.hit], rtol=1e-4)
    assert fine.closest_hits(np.full((2, 6), 1 / 3)).report.rounded == 12
    point = fine.closest_points(far + [0, 0, 3.0]).point
    assert point.dtype == np.float64
    np.testing.assert_allclose(point, far + [0, 0, 1.0], atol=1e-6)
    np.testing.assert_allclose(fine.bounds, [far - 1, far + 1], atol=0.02)
    centered = Tree.build(moved, faces, origin="center")
    assert centered.origin is not None and np.abs(centered.origin - far).max() < 0.1


def test_soups_and_dlpack(ball: tuple[np.ndarray, np.ndarray], tree: Tree) -> None:
    class Tensor:
        """What torch and others hand over."""

        def __init__(self, array: np.ndarray) -> None:
            self.array = array

        def __dlpack__(self, **options: object) -> object:
            return self.array.__dlpack__(**options)

        def __dlpack_device__(self) -> tuple:
            return self.array.__dlpack_device__()

    vertices, faces = ball
    soup = Tree.build(vertices[faces])
    rays = rays_at(100)
    np.testing.assert_array_equal(soup.closest_hits(rays).t, tree.closest_hits(Tensor(rays)).t)
    assert np.from_dlpack(tree.closest_hits(rays).t).shape == (100,)


def test_rebuild_follows_the_vertices(ball: tuple[np.ndarray, np.ndarray]) -> None:
    vertices, faces = ball
    tree = Tree.build(vertices, faces, preset="balanced")
    digest = tree.digest
    tree.rebuild(np.asarray(vertices) * 2)
    assert tree.digest == Tree.build(np.asarray(vertices) * 2, faces, preset="balanced").digest != digest
    with pytest.raises(splitplane.OutOfMemoryError, match="raise the limit"):
        tree.rebuild(vertices, max_memory=1000)
    assert tree.bounds[1, 0] == pytest.approx(2, abs=0.01)


def test_files_and_pickles(ball: tuple[np.ndarray, np.ndarray], tree: Tree, tmp_path: Path) -> None:
    path = tmp_path / "ball.kd"
    tree.save(path)
    rays = rays_at(100)
    for other in (Tree.load(path, *ball), Tree.load(path.read_bytes(), *ball), pickle.loads(pickle.dumps(tree))):
        assert other.digest == tree.digest
        np.testing.assert_array_equal(other.closest_hits(rays).t, tree.closest_hits(rays).t)
    with pytest.raises(splitplane.WrongMeshError):
        Tree.load(path, np.asarray(ball[0]) * 2, ball[1])
    data = bytearray(path.read_bytes())
    data[200] ^= 1
    with pytest.raises(splitplane.FileError, match="checksum"):
        Tree.load(bytes(data), *ball)


def test_backends_by_name(ball: tuple[np.ndarray, np.ndarray], tree: Tree) -> None:
    info = splitplane.backend_info("cpu")
    assert info.name == "cpu" and info.threads
    auto = Tree.build(*ball, backend="auto")
    assert auto.digest == tree.digest and auto.backend_reason.startswith("auto:")
    with pytest.raises(splitplane.ConfigError, match="not a backend"):
        Tree.build(*ball, backend="gpu")
    with pytest.raises(splitplane.OpenError):
        Tree.build(*ball, backend="wgpu", adapter="no adapter has this name")


def test_what_it_says(tree: Tree) -> None:
    assert repr(tree).startswith("<splitplane.Tree of ")
    assert tree.summary.triangles == len(tree) == len(tree.faces)
    assert len(tree.digest) == 16 and not tree.vertices.flags.writeable
    assert Tree.build(np.zeros((0, 3), np.float32), np.zeros((0, 3), np.uint32)).summary.triangles == 0


def test_the_order_of_points_does_not_matter(tree: Tree) -> None:
    """Many points are asked for in another order than few."""
    points = np.random.default_rng(8).normal(size=(5000, 3)).astype(np.float32)
    points[17] = np.nan
    points[18, 1] = np.inf
    many = tree.closest_points(points.reshape(50, 100, 3))
    for place in (0, 17, 18, 19, 2500, 4999):
        one = tree.closest_points(points[place])
        np.testing.assert_array_equal(one.distance, many.distance.reshape(-1)[place])
        np.testing.assert_array_equal(one.triangle, many.triangle.reshape(-1)[place])
        np.testing.assert_array_equal(one.point, many.point.reshape(-1, 3)[place])
    assert (~many.found).sum() == 2
    assert tree.closest_points(np.ones((3000, 3))).found.all()


def test_a_gpu_gives_the_same_bits(ball: tuple[np.ndarray, np.ndarray], tree: Tree) -> None:
    if not splitplane.GPU:
        with pytest.raises(splitplane.OpenError, match="no GPU backend"):
            Tree.build(*ball, backend="wgpu")
        pytest.skip("this wheel was built without the GPU backend")
    try:
        info = splitplane.backend_info("wgpu")
    except splitplane.OpenError as error:
        pytest.skip(str(error))
    assert info.name == "wgpu" and info.adapter
    device = Tree.build(*ball, backend="wgpu")
    assert (device.backend, device.digest) == ("wgpu", tree.digest)
    rays = rays_at(2000)
    mine, own = tree.closest_hits(rays), device.closest_hits(rays)
    for column in ("t", "triangle", "u", "v"):
        np.testing.assert_array_equal(getattr(mine, column), getattr(own, column))
    np.testing.assert_array_equal(device.any_hits(rays), mine.hit)
    assert device.closest_points([0, 0, 3]).report.answered_by_cpu == 1


def test_counting_holds_the_crossings_of_few_rays_at_a_time() -> None:
    vertices, faces = sphere(32, 24)
    rays = np.tile(np.array([0.1, 0.2, -3, 0, 0, 1], np.float32), (50_000, 1))
    tree, scene = Tree.build(vertices, faces), splitplane.Scene()
    scene.add_instance(scene.add_geometry(vertices, faces))
    scene.update()
    for thing in (tree, scene):
        # Two crossings a ray: 3 MB or more of all rays.
        with pytest.raises(splitplane.OutOfMemoryError):
            thing.all_hits(rays, max_memory=1_000_000)
        assert (thing.count_hits(rays, max_memory=1_000_000) == 2).all()
        # Of a tree those of some thousands of rays, of a scene those of one.
        with pytest.raises(splitplane.OutOfMemoryError):
            thing.count_hits(rays, max_memory=10)
        seen: list[int] = []
        thing.count_hits(rays, progress=lambda stage, done, total: seen.append(done))
        assert seen == sorted(seen) and seen[-1] == 50_000


def test_results_are_written_over_earlier_ones(tree: Tree) -> None:
    scene = splitplane.Scene()
    scene.add_instance(scene.add_geometry(tree.vertices, tree.faces))
    scene.update()
    for thing in (tree, scene):
        rays, others = rays_at(600, 1).reshape(20, 30, 6), rays_at(600, 2).reshape(20, 30, 6)
        hits, expected = thing.closest_hits(others), thing.closest_hits(rays)
        again = thing.closest_hits(rays, out=hits)
        for name in ("t", "triangle", "u", "v"):
            assert np.shares_memory(getattr(again, name), getattr(hits, name))
            assert getattr(hits, name).tobytes() == getattr(expected, name).tobytes()
        # Arrays of the caller's take them too, with whatever between their items.
        wide = np.zeros((20, 30, 2, 6), np.float32)
        fields = ("t", "triangle", "u", "v", "geometry", "instance")[: 4 if thing is tree else 6]
        own = {name: wide[..., 1, place].view(getattr(hits, name).dtype) for place, name in enumerate(fields)}
        other = thing.closest_hits(rays, out=dataclasses.replace(hits, **own))
        for name in fields:
            assert getattr(other, name) is own[name] and own[name].tobytes() == getattr(expected, name).tobytes()
        assert not wide[..., 0, :].any()
        occluded = thing.any_hits(others)
        assert thing.any_hits(rays, out=occluded) is occluded
        assert (occluded == expected.hit).all()
        with pytest.raises(splitplane.ShapeError, match=r"out.t has shape \(20, 30\)"):
            thing.closest_hits(rays[:3], out=hits)
        with pytest.raises(splitplane.DtypeError, match="out must be a"):
            thing.closest_hits(rays, out=occluded)
        with pytest.raises(splitplane.DtypeError, match="out must be an array of bool, not uint8"):
            thing.any_hits(rays, out=occluded.view(np.uint8))
        with pytest.raises(splitplane.ShapeError, match="contiguous"):
            thing.any_hits(rays, out=np.zeros((30, 20), bool).T)
        occluded.flags.writeable = False
        with pytest.raises(splitplane.ShapeError, match="writeable"):
            thing.any_hits(rays, out=occluded)
        twice = dataclasses.replace(hits, v=hits.u)
        with pytest.raises(splitplane.ShapeError, match="out.v overlaps"):
            thing.closest_hits(rays, out=twice)


def test_hits_are_what_they_were_when_copied(tree: Tree) -> None:
    """Columns are made when they are asked for: copies, pickles and hits that are written over must not tell."""
    rays = rays_at(70, 3)
    expected = tree.closest_hits(rays)
    values = tuple(getattr(expected, field.name) for field in dataclasses.fields(expected))
    for form in (copy.copy, copy.deepcopy, lambda hits: pickle.loads(pickle.dumps(hits)), dataclasses.replace):
        for asked in ((), ("t",), ("v", "triangle")):
            hits = tree.closest_hits(rays)
            for name in asked:
                getattr(hits, name)
            other = form(hits)
            assert type(other) is splitplane.Hits and other.report == expected.report
            for field, value in zip(dataclasses.fields(other), values):
                assert np.array_equal(getattr(other, field.name), value)
            # All columns of a copy are written over, not only some.
            away = tree.closest_hits(rays + np.float32(100), out=other)
            assert not other.hit.any() and not away.hit.any() and not other.v.any() and np.isinf(other.t).all()
    hits = tree.closest_hits(rays)
    assert hits.t is hits.t and hits.t.base is hits.v.base and repr(hits).startswith("Hits(t=array(")
    for name in ("geometry", "_nothing", "nothing", "__array__"):
        with pytest.raises(AttributeError, match=name):
            getattr(hits, name)
    assert not hasattr(splitplane.Hits.__new__(splitplane.Hits), "t")
    with pytest.raises(dataclasses.FrozenInstanceError):
        hits.t = expected.t
    hits.t.flags.writeable = False
    with pytest.raises(splitplane.ShapeError, match="out.t must be aligned and writeable"):
        tree.closest_hits(rays, out=hits)


def test_auto_chooses_a_preset_and_says_why(ball: tuple[np.ndarray, np.ndarray]) -> None:
    """The tree is that of the preset that was chosen, and few rays take the fastest build."""
    few = Tree.build(*ball, preset="auto", rays=0, threads=1)
    assert few.digest == Tree.build(*ball).digest
    assert few.preset_reason is not None
    assert " on 1 thread, a build over " in few.preset_reason and " and 0 rays are expected to take " in few.preset_reason
    many = Tree.build(*ball, preset="auto", rays=np.int64(2**62), backend="auto")
    assert many.preset_reason is not None and many.backend == "cpu"
    # The first preset that is named is the one that was taken.
    least = many.preset_reason.split(" by ")[1].split(",")[0]
    assert many.digest == Tree.build(*ball, preset=least).digest
    many.rebuild(ball[0] * 2)
    assert many.digest == Tree.build(ball[0] * 2, ball[1], preset=least).digest
    assert Tree.build(*ball).preset_reason is None
    empty = Tree.build(np.zeros((0, 3), np.float32), np.zeros((0, 3), np.int32), preset="auto", rays=5)
    assert empty.preset_reason == "auto: fast, since there are no triangles"


@pytest.mark.parametrize(
    ("options", "error"),
    [
        ({"preset": "auto"}, splitplane.ConfigError),
        ({"rays": 5}, splitplane.ConfigError),
        ({"preset": "best", "rays": 5}, splitplane.ConfigError),
        ({"preset": "auto", "rays": 5, "backend": "wgpu"}, splitplane.ConfigError),
        ({"preset": "auto", "rays": 5, "bins": 8}, splitplane.ConfigError),
        ({"preset": "auto", "rays": 5, "builder": "sweep"}, splitplane.ConfigError),
        ({"preset": "auto", "rays": -1}, splitplane.RangeError),
        ({"preset": "auto", "rays": 2**64}, splitplane.RangeError),
        ({"preset": "auto", "rays": 1e6}, splitplane.DtypeError),
        ({"preset": "auto", "rays": True}, splitplane.DtypeError),
    ],
)
def test_auto_without_what_it_chooses_by_is_refused(
    ball: tuple[np.ndarray, np.ndarray], options: dict[str, object], error: type[Exception]
) -> None:
    with pytest.raises(error):
        Tree.build(*ball, **options)  # type: ignore[arg-type]
