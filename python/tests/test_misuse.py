"""Misuses: each is a typed error that says something, and whatever was misused still works afterwards."""

from __future__ import annotations

import datetime
from typing import Any, Callable, Iterator

import numpy as np
import pytest
from brute import sphere

from splitplane import PointTree, Scene, SplitplaneError, Tree
from splitplane.errors import DeadHandleError

Misuse = tuple[str, Callable[[], object]]
VERTICES, FACES = sphere(8, 6)
RAY = np.array([[3, 0.1, 0.2, -1, 0, 0]], np.float32)
POINT = np.array([[0.5, 2, 0]], np.float32)


class BadTensor:
    """A tensor of a device that numpy cannot reach."""

    def __dlpack__(self, **_: object) -> object:
        raise BufferError("the tensor is on another device")

    def __dlpack_device__(self) -> tuple[int, int]:
        return 2, 0


def not_arrays() -> list[Any]:
    return [
        None,
        "rays",
        b"rays",
        {"a": 1},
        {1, 2},
        lambda: 0,
        object(),
        BadTensor(),
        [[1, 2, 3], [1, 2]],
        np.ma.masked_array(np.zeros((2, 6)), mask=True),
        np.ma.masked_array(np.zeros((2, 3)), mask=False),
        datetime.date(2026, 1, 1),
    ]


def wrong_dtypes(columns: int) -> list[Any]:
    shape = (2, columns)
    kinds = (bool, complex, np.complex64, object, "U4", "S4", "datetime64[s]", "timedelta64[s]", "V8")
    fields = np.zeros(2, dtype=[("x", "f4"), ("y", "f4")])
    return [np.zeros(shape, kind) for kind in kinds] + [fields]


def wrong_shapes(*columns: int) -> list[Any]:
    shapes = [(), (0,), (1,), (4, 0), (2, 1), (2, 4), (2, 5), (2, 7), (3, 9), (6, 2), (2, 2, 2), (5, 5, 5), (1, 1, 1, 4)]
    return [np.zeros(shape, np.float32) for shape in shapes if not shape or shape[-1] not in columns]


def too_large(columns: int) -> list[Any]:
    return [np.full((2, columns), 1e300), np.full((2, columns), -3.5e38), np.full((1, columns), np.finfo(float).max)]


def of_rays(name: str, made: Any) -> Iterator[Misuse]:
    bad = not_arrays() + wrong_dtypes(6) + wrong_shapes(6, 8) + too_large(6)
    for method in ("closest_hits", "any_hits", "all_hits", "count_hits"):
        ask = getattr(made, method)
        for place, rays in enumerate(bad):
            yield f"{name}.{method}, rays {place}", lambda ask=ask, rays=rays: ask(rays)
        settings: list[tuple[str, Any]] = [
            *(("threads", value) for value in (0, -1, 1.5, "2", True, 1025, 10**30, [1], None.__class__)),
            *(("progress", value) for value in (5, "x", [], 0.5)),
            *(("culling", value) for value in ("x", "Back", 5, None, b"back", "")),
            *(("t_min", value) for value in ("a", 1j, [1, 2, 3], np.zeros((2, 2)), np.array([True]), {}, 1e300, object())),
            *(("t_max", value) for value in ("a", 1j, [1, 2, 3], np.zeros((5, 1)), [None], 1e300)),
        ]
        ignored = (-1, 2**32, 1.5, "1", True, [1]) if name == "tree" else ((1,), (1, -1), 3, "ab", (1.5, 2), (2**32, 0))
        if name == "scene":
            rows: tuple[Any, ...] = ([[1, 2, 3]], np.zeros((2, 2)), [[-1, 0]], [[0, 2**32]], np.zeros((2, 2, 2), int), [[True, False]], {}, [[0, 1], [2]])
            ignored += rows
        settings += [("ignore", value) for value in ignored]
        if method in ("closest_hits", "any_hits"):
            settings += [("accuracy", value) for value in ("x", "Exact", 5, None, "")]
        else:
            settings += [("max_memory", value) for value in (-1, 2**64, "1", 1.0, True)]
        if name == "scene":
            settings += [("mask", value) for value in (-1, 2**32, 1.5, "1", None, True)]
        for key, value in settings:
            yield f"{name}.{method}, {key}={value!r}", lambda ask=ask, key=key, value=value: ask(RAY, **{key: value})
        whole = np.zeros((1, 8), np.float32)
        yield f"{name}.{method}, limits twice", lambda ask=ask: ask(whole, t_max=1.0)


def of_points(name: str, made: Any) -> Iterator[Misuse]:
    bad = not_arrays() + wrong_dtypes(3) + wrong_shapes(3) + too_large(3)
    for method in ("locate", "contains", "closest_points", "signed_distance"):
        ask = getattr(made, method)
        for place, points in enumerate(bad):
            yield f"{name}.{method}, points {place}", lambda ask=ask, points=points: ask(points)
        settings: list[tuple[str, Any]] = [("threads", value) for value in (0, -1, 1.5, "2", True)]
        settings += [("progress", value) for value in (5, "x")]
        if method == "closest_points":
            settings += [("max_distance", value) for value in ("a", [1, 2], None, True, 1j, 1e300, object())]
            settings += [("accuracy", value) for value in ("x", "Exact", 5, None, "")]
        if method in ("contains", "signed_distance"):
            settings += [("rule", value) for value in ("odd", "", None, 5)]
        if method == "locate":
            settings += [("max_memory", value) for value in (-1, 2**64, "1", 1.0)]
        for key, value in settings:
            yield f"{name}.{method}, {key}={value!r}", lambda ask=ask, key=key, value=value: ask(POINT, **{key: value})


def of_volumes(name: str, made: Any) -> Iterator[Misuse]:
    bad = not_arrays() + wrong_dtypes(6) + wrong_shapes(6) + too_large(6)
    box = [[0, 0, 0, 1, 1, 1]]
    for method in ("overlaps", "overlaps_any"):
        ask = getattr(made, method)
        for place, volumes in enumerate(bad):
            yield f"{name}.{method}, volumes {place}", lambda ask=ask, volumes=volumes: ask(volumes)
        for kind, volumes in (("cube", box), (None, box), (5, box), ("ball", box), ("capsule", box), ("triangle", box), ("planes", box), ("planes", 5)):
            yield f"{name}.{method}, kind {kind!r}", lambda ask=ask, kind=kind, volumes=volumes: ask(volumes, kind)
        settings: list[tuple[str, Any]] = [("threads", value) for value in (0, -1, 1.5, "2", True)]
        settings += [("progress", value) for value in (5, "x")]
        settings += [("ignore", value) for value in ((-1, "1", 1.5, True) if name == "tree" else ((1,), (1, -1), 3, "ab", [[0, 1]]))]
        if name == "scene":
            settings += [("mask", value) for value in (-1, 2**32, 1.5, "1", None, True)]
        if method == "overlaps":
            settings += [("max_memory", value) for value in (-1, 2**64, "1", 1.0, True, 0)]
        for key, value in settings:
            yield f"{name}.{method}, {key}={value!r}", lambda ask=ask, key=key, value=value: ask([[-2, -2, -2, 2, 2, 2]], **{key: value})


def of_parts(scene: Scene) -> Iterator[Misuse]:
    faces = len(FACES)
    for place, shapes in enumerate(not_arrays() + wrong_dtypes(4) + wrong_shapes(4, 7) + too_large(4)):
        yield f"spheres {place}", lambda shapes=shapes: scene.add_shapes(shapes)
        yield f"capsules {place}", lambda shapes=shapes: scene.add_shapes(shapes, "capsules")
        yield f"replaced {place}", lambda shapes=shapes: scene.replace_shapes(0, shapes)
    masks: list[Any] = [bad for bad in not_arrays() if bad is not None] + wrong_dtypes(4)[1:] + [np.zeros((faces, 4), int)]
    masks += [np.zeros(shape, bool) for shape in ((), (faces,), (faces, 0), (faces, 2), (faces, 3), (faces + 1, 4), (faces, 4, 4), (1, 4**13))]
    for place, mask in enumerate(masks):
        yield f"opacity {place}", lambda mask=mask: scene.set_opacity(0, mask)
    for name in (99, -1, 2**32, 1.5, "0", None, True):
        yield f"set_opacity({name!r})", lambda name=name: scene.set_opacity(name, np.zeros((faces, 1), bool))
        yield f"clear opacity({name!r})", lambda name=name: scene.set_opacity(name, None)
        yield f"opacity({name!r})", lambda name=name: scene.opacity(name)
        yield f"kind({name!r})", lambda name=name: scene.kind(name)
        yield f"replace_shapes({name!r})", lambda name=name: scene.replace_shapes(name, [[0, 0, 0, 1]])
    yield "shapes in place of a mesh", lambda: scene.replace_shapes(0, [[0, 0, 0, 1]])
    for value in (-1, 13, 1.5, "1", None, True):
        yield f"opacity_cells({value!r})", lambda value=value: Scene.opacity_cells(value)
    for key, value in (("threads", 0), ("threads", "2"), ("progress", 5)):
        yield f"complete, {key}={value!r}", lambda key=key, value=value: scene.complete(**{key: value})
    for value in (None, 1, 0, "yes", []):
        yield f"lazy={value!r}", lambda value=value: Scene(lazy=value)


def of_builds() -> Iterator[Misuse]:
    vertices = not_arrays() + wrong_dtypes(3) + [np.zeros(shape, np.float32) for shape in ((5, 2), (5, 4), (3,), (1, 2, 3, 3))]
    for place, bad in enumerate(vertices + too_large(3)):
        yield f"build, vertices {place}", lambda bad=bad: Tree.build(bad, FACES)
        yield f"soup {place}", lambda bad=bad: Tree.build(bad)
    faces: list[Any] = [bad for bad in not_arrays() if bad is not None]
    faces += [np.zeros((2, 3)), np.zeros((2, 3), bool), np.zeros((2, 4), int), np.zeros((2, 2), int), np.zeros(3, int)]
    faces += [np.zeros((1, 2, 3), int), [[0, 1, len(VERTICES)]], [[-1, 0, 1]], [[0, 1, 2**32]], [[0, 1, 2**63 - 1]]]
    faces += [np.array([[0, 1, 2**64 - 1]], np.uint64), np.array([[0, 1, 255]], np.uint8), 5, 1.5]
    for place, bad in enumerate(faces):
        yield f"build, faces {place}", lambda bad=bad: Tree.build(VERTICES, bad)
        yield f"add_geometry, faces {place}", lambda bad=bad: Scene().add_geometry(VERTICES, bad)
    knobs: list[dict[str, Any]] = [{"preset": value} for value in ("x", "", None, 5, "Fast")]
    knobs += [{"layout": value} for value in ("x", "", None, 5)]
    knobs += [{"backend": value} for value in ("x", "CPU", "", None, 5, "wgpu ")]
    knobs += [{"adapter": value} for value in ("any", 5, b"x")]
    knobs += [{"builder": value} for value in ("x", None.__class__, 5, "Median")]
    knobs += [{"builder": "median", "preset": "best"}, {"builder": "sweep", "preset": "narrow"}]
    knobs += [{"origin": value} for value in ("middle", 5, [1, 2], np.zeros((3, 3)), [np.nan, 0, 0], [np.inf] * 3, ["a"] * 3)]
    knobs += [{"max_memory": value} for value in (-1, 2**64, "1", 1.0, True, 0, 100)]
    knobs += [{"threads": value} for value in (0, -1, 1.5, "2", True, 4096)]
    knobs += [{"progress": value} for value in (5, "x")]
    knobs += [{"max_depth": value} for value in (0, 97, -1, 1.5, "8", None, 2**40, True)]
    knobs += [{"clip": "yes"}, {"no_such_knob": 1}, {"bins": 8}, {"bad_splits": 1}, {"preset": "best", "empty_cutoff": 5}]
    knobs += [{"traversal_cost": 0}, {"intersection_cost": 10**6}, {"block_width": 65}, {"references_per_triangle": 0}]
    knobs += [{"preset": "balanced", "bins": 1}, {"preset": "balanced", "bins": 65}, {"small_node_limit": 65}]
    knobs += [{"preset": "best", "bad_splits": 9}, {"preset": "best", "empty_bonus": 256}, {"empty_cutoff": 0}]
    for settings in knobs:
        yield f"build, {settings}", lambda settings=settings: Tree.build(VERTICES, FACES, **settings)


def of_files(tree: Tree, scene: Scene) -> Iterator[Misuse]:
    for name, data, load in (
        ("tree", tree.to_bytes(), lambda data: Tree.load(data, VERTICES, FACES)),
        ("scene", scene.to_bytes(), Scene.load),
    ):
        for length in (0, 1, 7, 8, 64, 127, len(data) // 2, len(data) - 1):
            yield f"{name} file cut at {length}", lambda load=load, data=data, length=length: load(data[:length])
        for place in range(0, len(data), max(1, len(data) // 24)):
            damaged = bytearray(data)
            damaged[place] ^= 0x10
            yield f"{name} file damaged at {place}", lambda load=load, damaged=damaged: load(bytes(damaged))
        for bad in (None, 5, [1], np.zeros(3), bytes(1000), np.zeros((4, 4), np.uint8)[::2, ::2]):
            yield f"{name} file {bad!r}"[:60], lambda load=load, bad=bad: load(bad)
    yield "another mesh", lambda: Tree.load(tree.to_bytes(), VERTICES * 2, FACES)
    yield "fewer faces", lambda: Tree.load(tree.to_bytes(), VERTICES, FACES[1:])


def of_edits(scene: Scene) -> Iterator[Misuse]:
    names: list[Any] = [99, -1, 2**32, 1.5, "0", None, True]
    for name in names:
        yield f"add_instance({name!r})", lambda name=name: scene.add_instance(name)
        yield f"remove_geometry({name!r})", lambda name=name: scene.remove_geometry(name)
        yield f"replace_geometry({name!r})", lambda name=name: scene.replace_geometry(name, VERTICES, FACES)
        yield f"remove_instance({name!r})", lambda name=name: scene.remove_instance(name)
        yield f"move_instance({name!r})", lambda name=name: scene.move_instance(name, np.eye(4))
        yield f"set_mask({name!r})", lambda name=name: scene.set_mask(name, 1)
        yield f"transform({name!r})", lambda name=name: scene.transform(name)
    yield "in use", lambda: scene.remove_geometry(scene.geometries[0])
    singular = np.zeros((3, 4))
    broken = np.eye(3, 4)
    broken[1, 2] = np.nan
    matrices: list[Any] = [singular, broken, np.eye(3), np.zeros((4, 3)), "x", np.eye(4, dtype=complex), np.full((4, 4), 2.0)]
    matrices += [np.eye(3, 4) * 1e300, np.eye(3, 4)[None], 5, object()]
    for place, matrix in enumerate(matrices):
        yield f"instance, transform {place}", lambda matrix=matrix: scene.add_instance(0, matrix)
        yield f"move, transform {place}", lambda matrix=matrix: scene.move_instance(0, matrix)
    for key, value in (("mask", -1), ("mask", 2**32), ("id", -1), ("id", "x"), ("culling", "x"), ("culling", 5)):
        yield f"instance, {key}", lambda key=key, value=value: scene.add_instance(0, **{key: value})
        yield f"set, {key}", lambda key=key, value=value: scene.set_instance(0, **{key: value})


def of_clouds(cloud: PointTree) -> Iterator[Misuse]:
    clouds = not_arrays() + wrong_dtypes(3) + too_large(3)
    clouds += [np.zeros(shape, np.float32) for shape in ((), (0,), (5, 0), (5, 5), (7,))]
    for place, bad in enumerate(clouds):
        yield f"cloud {place}", lambda bad=bad: PointTree.build(bad)
    for place, bad in enumerate(not_arrays() + wrong_dtypes(3) + wrong_shapes(3) + too_large(3)):
        yield f"nearest, queries {place}", lambda bad=bad: cloud.nearest(bad)
        yield f"within, queries {place}", lambda bad=bad: cloud.within(bad, 1.0)
    for value in (-1, 1.5, "1", None, True, 2**41, 2**40):
        yield f"nearest, k={value!r}", lambda value=value: cloud.nearest(POINT, value)
    for value in ("a", [1, 2], None, True, 1j, 1e300):
        yield f"within, radius={value!r}", lambda value=value: cloud.within(POINT, value)
        yield f"nearest, max_distance={value!r}", lambda value=value: cloud.nearest(POINT, max_distance=value)
    for keep in (np.zeros(3, bool), np.zeros(len(cloud)), "x", np.zeros((len(cloud), 1), bool), 5, None.__class__):
        yield f"keep {keep!r}"[:60], lambda keep=keep: cloud.nearest(POINT, keep=keep)
    for settings in ({"axes": "x"}, {"axes": 5}, {"max_memory": 10}, {"threads": 0}, {"origin": [1, 2]}, {"origin": "x"}):
        yield f"cloud, {settings}", lambda settings=settings: PointTree.build(VERTICES, **settings)
    yield "within, memory", lambda: cloud.within(POINT, 10.0, max_memory=10)


def of_dead_handles() -> Iterator[Misuse]:
    made: list[Any] = [Tree.build(VERTICES, FACES), Scene(), PointTree.build(VERTICES)]
    for one in made:
        one.close()
    made += [Tree.__new__(Tree), Scene.__new__(Scene), PointTree.__new__(PointTree)]
    for number, one in enumerate(made):
        for name in ("closest_hits", "any_hits", "all_hits", "count_hits"):
            if hasattr(type(one), name):
                yield f"dead {number}.{name}", lambda one=one, name=name: getattr(one, name)(RAY)
        for name in ("locate", "contains", "closest_points", "signed_distance", "nearest"):
            if hasattr(type(one), name):
                yield f"dead {number}.{name}", lambda one=one, name=name: getattr(one, name)(POINT)
        for name in ("overlaps", "overlaps_any"):
            if hasattr(type(one), name):
                yield f"dead {number}.{name}", lambda one=one, name=name: getattr(one, name)([[0] * 6])
        for name, given in (("opacity", (0,)), ("set_opacity", (0, None)), ("kind", (0,)), ("add_shapes", ([[0, 0, 0, 1]],)), ("complete", ())):
            if hasattr(type(one), name):
                yield f"dead {number}.{name}", lambda one=one, name=name, given=given: getattr(one, name)(*given)
        for name in ("waiting", "digest", "summary", "bounds", "vertices", "faces", "points", "instances", "stale", "backend"):
            if hasattr(type(one), name):
                yield f"dead {number}.{name}", lambda one=one, name=name: getattr(one, name)
        for name in ("to_bytes", "update", "__len__", "__reduce__"):
            if hasattr(type(one), name):
                yield f"dead {number}.{name}()", lambda one=one, name=name: getattr(one, name)()


def misuses() -> Iterator[Misuse]:
    tree, scene, cloud = Tree.build(VERTICES, FACES), Scene(), PointTree.build(VERTICES)
    scene.add_instance(scene.add_geometry(VERTICES, FACES))
    scene.update()
    yield from of_rays("tree", tree)
    yield from of_rays("scene", scene)
    yield from of_points("tree", tree)
    yield from of_points("scene", scene)
    yield from of_volumes("tree", tree)
    yield from of_volumes("scene", scene)
    yield from of_parts(scene)
    yield from of_builds()
    yield from of_files(tree, scene)
    yield from of_edits(scene)
    yield from of_clouds(cloud)
    yield from of_dead_handles()
    # All of them still answer.
    assert not scene.stale and scene.closest_hits(RAY).hit.all() and tree.closest_hits(RAY).hit.all()
    assert cloud.nearest(POINT).index.shape == (1, 1)


def test_misuses_are_typed_errors() -> None:
    wrong, number = [], 0
    for name, do in misuses():
        number += 1
        try:
            answer = do()
        except SplitplaneError as error:
            if len(str(error)) < 8:
                wrong.append(f"{name}: says only {str(error)!r}")
            if name.startswith("dead") and not isinstance(error, DeadHandleError):
                wrong.append(f"{name}: {type(error).__name__}: {error}")
        except BaseException as error:
            wrong.append(f"{name}: {type(error).__name__}: {error}")
        else:
            wrong.append(f"{name}: answered {str(answer)[:60]}")
    assert not wrong, "\n".join(wrong)
    assert number >= 1500, number


def test_odd_numbers_are_answered() -> None:
    """Rays and points that are no numbers meet nothing; nothing else changes."""
    tree = Tree.build(VERTICES, FACES)
    odd = [np.nan, np.inf, -np.inf, 0.0, -0.0, 1e-45, 3.4e38]
    for value in odd:
        for place in range(6):
            rays = np.repeat(RAY, 3, axis=0)
            rays[1, place] = value
            for accuracy in ("fast", "watertight", "exact"):
                hits = tree.closest_hits(rays, accuracy=accuracy)
                assert hits.hit[[0, 2]].all()
                assert np.isfinite(value) or not hits.hit[1]
            assert tree.count_hits(rays)[0] == 2
        for place in range(3):
            points = np.repeat(POINT, 2, axis=0)
            points[0, place] = value
            assert tree.closest_points(points).found[1]
            assert tree.closest_points(points).found[0] == np.isfinite(value)
            assert PointTree.build(VERTICES).nearest(points).index.shape == (2, 1)
    vertices = VERTICES.copy()
    vertices[3] = np.nan
    assert Tree.build(vertices, FACES).summary.dropped == (FACES == 3).any(axis=1).sum()


def test_constructors_say_what_to_call() -> None:
    for cls in (Tree, PointTree):
        with pytest.raises(TypeError, match="build"):
            cls()
