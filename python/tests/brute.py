"""Answers by brute force in float64, which share nothing with the library."""

from __future__ import annotations

import numpy as np


def sphere(around: int, down: int) -> tuple[np.ndarray, np.ndarray]:
    """A closed unit sphere of (down - 1) * around * 2 faces, corners counter-clockwise as seen from outside."""
    rows = [[0.0, 0.0, 1.0]]
    for i in range(1, down):
        for j in range(around):
            theta, phi = np.pi * i / down, 2 * np.pi * j / around
            rows.append([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)])
    rows.append([0.0, 0.0, -1.0])
    last, faces = len(rows) - 1, []
    for j in range(around):
        k = (j + 1) % around
        faces.append([0, 1 + j, 1 + k])
        for i in range(down - 2):
            a, b = 1 + i * around, 1 + (i + 1) * around
            faces += [[a + j, b + j, b + k], [a + j, b + k, a + k]]
        bottom = 1 + (down - 2) * around
        faces.append([last, bottom + k, bottom + j])
    return np.asarray(rows, np.float32), np.asarray(faces, np.uint32)


def hits_brute(vertices: np.ndarray, faces: np.ndarray, rays: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """t and triangle of the closest hits, and the number of hits, of each ray."""
    a, b, c = (np.asarray(vertices, float)[faces[:, k]] for k in range(3))
    e, f = b - a, c - a
    ts, triangles, counts = [], [], []
    for ray in np.asarray(rays, float):
        o, d = ray[:3], ray[3:]
        p = np.cross(d, f)
        det = (e * p).sum(1)
        with np.errstate(divide="ignore", invalid="ignore"):
            s = o - a
            u = (s * p).sum(1) / det
            q = np.cross(s, e)
            v = (q @ d) / det
            t = (f * q).sum(1) / det
        hit = (det != 0) & (u >= 0) & (v >= 0) & (u + v <= 1) & (t >= 0)
        counts.append(int(hit.sum()))
        t = np.where(hit, t, np.inf)
        triangles.append(int(t.argmin()))
        ts.append(t.min())
    return np.array(ts), np.array(triangles), np.array(counts)


def closest_brute(vertices: np.ndarray, faces: np.ndarray, points: np.ndarray) -> np.ndarray:
    """The distance of each point from the nearest triangle: to its plane where the foot is within, else to its edges."""
    a, b, c = (np.asarray(vertices, float)[faces[:, k]] for k in range(3))
    best = []
    for point in np.asarray(points, float):
        normal = np.cross(b - a, c - a)
        squared = (normal**2).sum(1)
        with np.errstate(divide="ignore", invalid="ignore"):
            height = ((point - a) * normal).sum(1) / squared
            foot = point - height[:, None] * normal
            within = squared > 0
            for p, q in ((a, b), (b, c), (c, a)):
                within &= (np.cross(q - p, foot - p) * normal).sum(1) >= 0
        distance = np.where(within, np.abs(height) * np.sqrt(squared), np.inf)
        for p, q in ((a, b), (b, c), (c, a)):
            edge = q - p
            with np.errstate(divide="ignore", invalid="ignore"):
                s = np.nan_to_num(((point - p) * edge).sum(1) / (edge**2).sum(1)).clip(0, 1)
            distance = np.minimum(distance, np.linalg.norm(p + s[:, None] * edge - point, axis=1))
        best.append(distance.min())
    return np.array(best)


def faces_met_by_box(vertices: np.ndarray, faces: np.ndarray, box: np.ndarray) -> np.ndarray:
    """The faces that a box meets, by separating axes (Akenine-Moeller 2001)."""
    lo, hi = box[:3].astype(float), box[3:].astype(float)
    middle, half = (lo + hi) / 2, (hi - lo) / 2
    corners = vertices.astype(float)[faces] - middle
    edges = np.roll(corners, -1, axis=1) - corners
    apart = np.zeros(len(faces), bool)
    axes = [np.tile(axis, (len(faces), 1)) for axis in np.eye(3)] + [np.cross(edges[:, 0], edges[:, 1])]
    axes += [np.cross(edges[:, k], axis) for k in range(3) for axis in np.eye(3)]
    for axis in axes:
        along = np.einsum("fij,fj->fi", corners, axis)
        reach = np.abs(axis) @ half
        apart |= (along.min(1) > reach) | (along.max(1) < -reach)
    return np.nonzero(~apart)[0]


def all_hits_brute(vertices: np.ndarray, faces: np.ndarray, ray: np.ndarray) -> tuple[np.ndarray, ...]:
    """t, u and v of a ray and each face, and whether it is hit."""
    a, b, c = (np.asarray(vertices, float)[faces[:, k]] for k in range(3))
    o, d = np.asarray(ray, float)[:3], np.asarray(ray, float)[3:]
    e, f = b - a, c - a
    p = np.cross(d, f)
    det = (e * p).sum(1)
    with np.errstate(divide="ignore", invalid="ignore"):
        s = o - a
        u = (s * p).sum(1) / det
        q = np.cross(s, e)
        v, t = (q @ d) / det, (f * q).sum(1) / det
    return t, u, v, (det != 0) & (u >= 0) & (v >= 0) & (u + v <= 1) & (t >= 0)


def capsules_hit(ends: np.ndarray, radius: np.ndarray, rays: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """t of the first surface of each ray, and which capsule: the nearest roots of both balls, and of the tube between them. Ends alike: spheres."""
    ts = []
    for ray in np.asarray(rays, float):
        o, d = ray[:3], ray[3:]
        found = []
        for (a, b), r in zip(np.asarray(ends, float), np.asarray(radius, float)):
            own = [np.inf]
            n = b - a
            length = np.linalg.norm(n)
            n = n / length if length > 0 else n
            for middle in (a, b):
                s = o - middle
                roots = np.roots([d @ d, 2 * s @ d, s @ s - r * r])
                own += [t.real for t in roots if abs(t.imag) < 1e-12 and t.real >= 0 and outside(o + t.real * d, a, b, n, length)]
            if length > 0:
                s = o - a
                across, sideways = d - (d @ n) * n, s - (s @ n) * n
                roots = np.roots([across @ across, 2 * sideways @ across, sideways @ sideways - r * r])
                own += [t.real for t in roots if abs(t.imag) < 1e-12 and t.real >= 0 and 0 <= (o + t.real * d - a) @ n <= length]
            found.append(min(own))
        ts.append(found)
    ts = np.array(ts)
    return ts.min(1), ts.argmin(1)


def outside(place: np.ndarray, a: np.ndarray, b: np.ndarray, n: np.ndarray, length: float) -> bool:
    """Whether a place of an end's ball is of the capsule's surface: not beside the segment."""
    return length == 0 or not 0 < (place - a) @ n < length
