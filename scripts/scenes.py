#!/usr/bin/env python3
"""Six scenes that nothing here was tuned on, as .obj files: python3 scripts/scenes.py FOLDER

crowd      two boxes, every triangle split at its edges' midpoints four times: crowds of coplanar triangles
terrain    a height field of 11 km with a sphere of 11 cm on it that has half of all triangles
degenerate a soup of which every sixth triangle has no area
prisms     long thin prisms in all directions
noise      a sphere whose vertices are moved in and out at random
exploded   a sphere whose 27,000 triangles have flown apart and turned

python3 scripts/scenes.py FOLDER --million MESH.obj [SIDE]
writes million.json in place of them: a scene file that places the mesh on a grid of SIDE by SIDE places, 1,000 by
1,000 where left out, each turned about y, scaled and moved at random.
"""

import json
import math
import os
import random
import sys
from pathlib import Path


def write(folder, name, vertices, triangles):
    """Writes one scene; triangles name vertices from 0 on."""
    with open(folder / f"{name}.obj", "w") as file:
        for vertex in vertices:
            file.write("v %.9g %.9g %.9g\n" % tuple(vertex))
        for triangle in triangles:
            file.write("f %d %d %d\n" % tuple(i + 1 for i in triangle))
    print(f"{name}.obj: {len(vertices)} vertices, {len(triangles)} triangles")


def box(lo, hi):
    """The corners and the twelve triangles of a box."""
    corners = [[(lo, hi)[i >> axis & 1][axis] for axis in range(3)] for i in range(8)]
    quads = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
    return corners, [t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))]


def split(vertices, triangles):
    """Each triangle into four, at the midpoints of its edges, which neighbours share."""
    middles, out = {}, []

    def middle(i, j):
        key = (min(i, j), max(i, j))
        if key not in middles:
            middles[key] = len(vertices)
            vertices.append([(a + b) / 2 for a, b in zip(vertices[i], vertices[j])])
        return middles[key]

    for a, b, c in triangles:
        ab, bc, ca = middle(a, b), middle(b, c), middle(c, a)
        out += [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
    return out


def crowd():
    vertices, triangles = [], []
    for lo, hi in (([-10, -10, -10], [10, 10, 10]), ([-3, -10, -2], [4, 1, 5])):
        corners, faces = box(lo, hi)
        triangles += [tuple(i + len(vertices) for i in face) for face in faces]
        vertices += corners
    for _ in range(4):
        triangles = split(vertices, triangles)
    return vertices, triangles


def sphere(columns, rows, radius):
    """A sphere around (0, 0, 0): radius(random) may differ from vertex to vertex."""
    vertices = [[0, radius(), 0]]
    for row in range(1, rows):
        for column in range(columns):
            up, around = math.pi * row / rows, 2 * math.pi * column / columns
            r = radius()
            vertices.append(
                [r * math.sin(up) * math.cos(around), r * math.cos(up), r * math.sin(up) * math.sin(around)]
            )
    vertices.append([0, -radius(), 0])
    ring = lambda row, column: 1 + (row - 1) * columns + column % columns
    triangles = []
    for column in range(columns):
        triangles.append((0, ring(1, column + 1), ring(1, column)))
        triangles.append((len(vertices) - 1, ring(rows - 1, column), ring(rows - 1, column + 1)))
        for row in range(1, rows - 1):
            a, b = ring(row, column), ring(row, column + 1)
            c, d = ring(row + 1, column), ring(row + 1, column + 1)
            triangles += [(a, b, c), (b, d, c)]
    return vertices, triangles


def terrain():
    side = 150
    height = lambda x, z: 300 * math.sin(x / 900) * math.cos(z / 700) + 40 * math.sin(x / 61 + z / 83)
    vertices = []
    for i in range(side + 1):
        for j in range(side + 1):
            x, z = (i / side - 0.5) * 11000, (j / side - 0.5) * 11000
            vertices.append([x, height(x, z), z])
    triangles = []
    for i in range(side):
        for j in range(side):
            a, b = i * (side + 1) + j, (i + 1) * (side + 1) + j
            triangles += [(a, a + 1, b), (b, a + 1, b + 1)]
    ball, faces = sphere(200, 113, lambda: 0.055)
    first = len(vertices)
    vertices += [[x + 100, y + height(100, 40) + 0.5, z + 40] for x, y, z in ball]
    triangles += [tuple(i + first for i in face) for face in faces]
    return vertices, triangles


def degenerate(chance):
    vertices, triangles = [], []
    for number in range(40000):
        at = [chance.uniform(-10, 10) for _ in range(3)]
        corners = [[x + chance.gauss(0, 0.2) for x in at] for _ in range(3)]
        if number % 6 == 0:
            # Two equal corners, three equal corners, or three on a line.
            kind = number // 6 % 3
            if kind == 2:
                corners[2] = [2 * b - a for a, b in zip(corners[0], corners[1])]
            else:
                corners[2] = corners[0]
                corners[1] = corners[0] if kind else corners[1]
        triangles.append(tuple(range(len(vertices), len(vertices) + 3)))
        vertices += corners
    return vertices, triangles


def prisms(chance):
    vertices, triangles = [], []
    for _ in range(4000):
        along = [chance.gauss(0, 1) for _ in range(3)]
        length = math.sqrt(sum(x * x for x in along))
        along = [x / length for x in along]
        other = [1.0 if abs(along[axis]) == min(map(abs, along)) else 0.0 for axis in range(3)]
        cross = lambda a, b: [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
        u = cross(along, other)
        size = math.sqrt(sum(x * x for x in u))
        u = [x / size for x in u]
        v = cross(along, u)
        at = [chance.uniform(-10, 10) for _ in range(3)]
        half = chance.uniform(1, 8)
        first = len(vertices)
        for end in (-half, half):
            for corner in range(3):
                turn = 2 * math.pi * corner / 3
                vertices.append(
                    [
                        at[k] + end * along[k] + 0.01 * (math.cos(turn) * u[k] + math.sin(turn) * v[k])
                        for k in range(3)
                    ]
                )
        a, b, c, d, e, f = range(first, first + 6)
        triangles += [(a, c, b), (d, e, f)]
        for p, q, r, s in ((a, b, e, d), (b, c, f, e), (c, a, d, f)):
            triangles += [(p, q, r), (p, r, s)]
    return vertices, triangles


def exploded(chance):
    vertices, triangles = sphere(165, 83, lambda: 10)
    pieces = []
    for triangle in triangles:
        corners = [vertices[i] for i in triangle]
        centre = [sum(corner[axis] for corner in corners) / 3 for axis in range(3)]
        # Most stay near, some fly far, and all turn about an axis of the box.
        flight, angle, axis = 1 + 1.5 * chance.random() ** 3, chance.uniform(0, 2 * math.pi), chance.randrange(3)
        other, third = (axis + 1) % 3, (axis + 2) % 3
        for corner in corners:
            off = [corner[i] - centre[i] for i in range(3)]
            turned = list(off)
            turned[other] = off[other] * math.cos(angle) - off[third] * math.sin(angle)
            turned[third] = off[other] * math.sin(angle) + off[third] * math.cos(angle)
            pieces.append([flight * centre[i] + turned[i] for i in range(3)])
    return pieces, [(i, i + 1, i + 2) for i in range(0, len(pieces), 3)]


def million(folder, mesh, side):
    """Writes a scene file of side * side instances, line by line, since all of it would take much memory."""
    with open(mesh) as file:
        vertices = [[float(x) for x in line.split()[1:4]] for line in file if line.startswith("v ")]
    lo, hi = ([pick(p[axis] for p in vertices) for axis in range(3)] for pick in (min, max))
    # An instance is at most 1.25 times as large, and turned: a place is as wide as it is then from corner to corner.
    step = 1.25 * math.hypot(hi[0] - lo[0], hi[2] - lo[2])
    middle, height, chance = (side - 1) / 2, hi[1] - lo[1], random.Random(69451)
    path = os.path.relpath(mesh, folder).replace(os.sep, "/")
    head = {
        "format": "splitplane-scene",
        "version": 1,
        "geometries": [{"name": "mesh", "obj": path}],
        # From above one edge of the grid, across it.
        "cameras": [
            {"eye": [0, 6 * height, (middle + 6) * step], "at": [0, 0, (middle - 6) * step], "fov_degrees": 50}
        ],
        "lights": [{"sun": {"towards": [1, 2, 1], "irradiance": [3, 3, 3]}}],
    }
    with open(folder / "million.json", "w") as file:
        file.write(json.dumps(head, indent=1)[:-2] + ',\n "instances": [')
        for place in range(side * side):
            x, z = ((i - middle + chance.uniform(-0.25, 0.25)) * step for i in (place % side, place // side))
            turn, scale = chance.uniform(0, 360), chance.uniform(0.75, 1.25)
            file.write(",\n" if place else "\n")
            file.write(
                '{"geometry": "mesh", "translate": [%.7g, 0, %.7g], "rotate": {"axis": [0, 1, 0], "degrees": %.5g},'
                ' "scale": %.5g}' % (x, z, turn, scale)
            )
        file.write("\n]}\n")
    print(f"million.json: {side * side} instances")


def main():
    to_place = sys.argv[2:3] == ["--million"] and len(sys.argv) in (4, 5)
    if (len(sys.argv) != 2 and not to_place) or sys.argv[1].startswith("-"):
        sys.exit(__doc__)
    folder = Path(sys.argv[1])
    folder.mkdir(parents=True, exist_ok=True)
    if to_place:
        million(folder, sys.argv[3], int(sys.argv[4]) if len(sys.argv) == 5 else 1000)
        return
    chance = random.Random(2008)
    write(folder, "crowd", *crowd())
    write(folder, "terrain", *terrain())
    write(folder, "degenerate", *degenerate(chance))
    write(folder, "prisms", *prisms(chance))
    write(folder, "noise", *sphere(300, 150, lambda: 10 + chance.uniform(-0.5, 0.5)))
    # With numbers of its own, so that the scenes above stay what they are.
    write(folder, "exploded", *exploded(random.Random(27)))


if __name__ == "__main__":
    main()
