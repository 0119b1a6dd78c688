"""Triangles of even size in the shape of others, on which fields and maps are made."""

from __future__ import annotations

import numpy as np

from ...arrays import Int
from .field import Triangles

MANY = 3.0  # times as many triangles as are needed: such surfaces are simplified first


def evened(mesh: Triangles, longest: float, fold: float) -> Triangles:
    """The same surface with no side longer than ``longest`` (metres), and none from one point of ``Triangles.lines`` to
    another that is no part of them.

    fold : radians, of the lines
    """
    vertices, corners = _simplified(mesh, longest)
    for _ in range(40):
        mesh = Triangles(vertices, corners)
        long = np.abs(mesh.sides).ravel() > longest
        if not long.any():
            break
        vertices, corners = _cut(mesh, _both(mesh, long))
    for _ in range(4):
        mesh = Triangles(vertices, corners)
        bad = _between(mesh, mesh.lines(fold))
        if not bad.any():
            break
        vertices, corners = _cut(mesh, bad)
    return Triangles(vertices, corners)


def _simplified(mesh: Triangles, longest: float) -> tuple[np.ndarray, np.ndarray]:
    needed = int(MANY * mesh.areas.sum() / (0.43 * (0.7 * longest) ** 2))
    if len(mesh.corners) <= needed:
        return mesh.vertices, mesh.corners
    import igl

    found = igl.qslim(np.ascontiguousarray(mesh.vertices, float), np.ascontiguousarray(mesh.corners, np.int64), needed)
    v, f = (found[1], found[2]) if isinstance(found[0], bool | np.bool_) else (found[0], found[1])
    return np.asarray(v, float), np.asarray(f, np.int64)


def _both(mesh: Triangles, sides: np.ndarray) -> np.ndarray:
    other = mesh.opposite
    return sides | ((other >= 0) & sides[other])


def _between(mesh: Triangles, lines: np.ndarray) -> np.ndarray:
    """Sides from one point of the lines to another that are no part of them: the map would have no area there."""
    start = mesh.corners.ravel()
    end = np.roll(mesh.corners, -1, axis=1).ravel()
    on = np.zeros(len(mesh.vertices), dtype=bool)
    on[start[lines]] = on[end[lines]] = True
    return on[start] & on[end] & ~lines


def _cut(mesh: Triangles, sides: np.ndarray) -> tuple[np.ndarray, Int[np.ndarray, "triangles 3"]]:
    """Every one of these edges halved, and the triangles at it cut into two, three or four."""
    other, count = mesh.opposite, len(mesh.vertices)
    first = sides & ((other < 0) | (np.arange(len(other)) < other))
    number = np.full(len(other), -1)
    number[first] = count + np.arange(first.sum())
    second = sides & ~first
    number[second] = number[other[second]]
    start, end = mesh.corners.ravel(), np.roll(mesh.corners, -1, axis=1).ravel()
    vertices = np.concatenate([mesh.vertices, 0.5 * (mesh.vertices[start[first]] + mesh.vertices[end[first]])])
    m, how = number.reshape(-1, 3), (number.reshape(-1, 3) >= 0)
    t = mesh.corners
    made = [t[how.sum(axis=1) == 0]]
    three = how.all(axis=1)
    a, b, c = t[three].T
    ab, bc, ca = m[three].T
    made += [np.stack(x, axis=1) for x in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))]
    for k in range(3):
        one = (how.sum(axis=1) == 1) & how[:, k]
        a, b, c = np.roll(t[one], -k, axis=1).T
        ab = m[one, k]
        made += [np.stack([a, ab, c], 1), np.stack([ab, b, c], 1)]
        two = (how.sum(axis=1) == 2) & ~how[:, k]  # halved: sides k + 1 and k + 2
        a, b, c = np.roll(t[two], -k, axis=1).T
        bc, ca = m[two, (k + 1) % 3], m[two, (k + 2) % 3]
        made.append(np.stack([bc, c, ca], axis=1))
        shorter = np.linalg.norm(vertices[a] - vertices[bc], axis=1) < np.linalg.norm(vertices[b] - vertices[ca], axis=1)
        d, e = np.where(shorter, bc, ca), np.where(shorter, a, b)
        made += [
            np.stack([a, b, d], axis=1),
            np.where(shorter[:, None], np.stack([a, bc, ca], 1), np.stack([b, bc, ca], 1)),
        ]
    return vertices, np.concatenate(made)
