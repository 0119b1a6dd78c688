"""Fuzzing of the checks with small faulty quad meshes, each generated from its number; meshes that pass are made into sheets."""

from __future__ import annotations

import warnings

import numpy as np
from flexmaps.engine.errors import FlexMapsError
from flexmaps.engine.params import LayoutParams, Settings, SheetParams
from flexmaps.engine.runs import job
from flexmaps.engine.surface import shapes
from flexmaps.engine.surface.checking import check
from flexmaps.engine.surface.mesh import PolygonMesh

SETTINGS = Settings(layout=LayoutParams(symmetric=False), sheet=SheetParams(nesting="FAST"))
EDGE = 0.02  # metres


def _good(rng: np.random.Generator) -> tuple[np.ndarray, list[list[int]]]:
    """Vertices in units of a quad, and faces."""
    kind = rng.integers(6)
    if kind == 0:
        n, m = rng.integers(1, 5, 2)
        x, y = np.meshgrid(np.arange(n + 1.0), np.arange(m + 1.0), indexing="ij")
        at = np.arange((n + 1) * (m + 1)).reshape(n + 1, m + 1)
        quads = np.stack([at[:-1, :-1], at[1:, :-1], at[1:, 1:], at[:-1, 1:]], axis=-1).reshape(-1, 4)
        return np.stack([x.ravel(), y.ravel(), 0.3 * np.sin(x * y).ravel()], axis=1), quads.tolist()
    if kind == 1:  # spokes about a vertex
        k = int(rng.integers(3, 10))
        angle = np.pi * np.arange(2 * k) / k
        rim = (
            np.stack([np.cos(angle), np.sin(angle), 0.2 * np.cos(3 * angle)], axis=1)
            * np.where(np.arange(2 * k) % 2, 1.5, 1.0)[:, None]
        )
        return np.vstack([[0, 0, 0.5], rim]), [[0, 2 * i + 1, 2 * i + 2, (2 * i + 2) % (2 * k) + 1] for i in range(k)]
    if kind == 2:  # a tube
        n, m = int(rng.integers(3, 8)), int(rng.integers(1, 4))
        angle = 2 * np.pi * np.arange(n) / n
        radius = 0.5 / np.sin(np.pi / n)
        p = [(radius * np.cos(a), radius * np.sin(a), float(z)) for z in range(m + 1) for a in angle]
        return np.array(p), [
            [z * n + k, z * n + (k + 1) % n, (z + 1) * n + (k + 1) % n, (z + 1) * n + k]
            for z in range(m)
            for k in range(n)
        ]
    mesh = (
        shapes.cubesphere(int(rng.integers(1, 4))),
        shapes.torus(int(rng.integers(3, 8)), int(rng.integers(3, 6))),
        shapes.strip(int(rng.integers(2, 10)), 1),
    )[kind - 3]
    return mesh.vertices / mesh.median_edge, mesh.quads.tolist()


def _spoilt(rng: np.random.Generator, p: np.ndarray, faces: list[list[int]]) -> None:
    """Add one fault, in place."""
    f, v, w = int(rng.integers(len(faces))), int(rng.integers(len(p))), int(rng.integers(len(p)))
    face = faces[f]
    a, b = rng.permutation(len(face))[:2]
    match int(rng.integers(14)):
        case 0:
            p[v] += rng.normal(0, 10.0 ** rng.uniform(-8, 1), 3)
        case 1:
            p += rng.normal(0, 10.0 ** rng.uniform(-3, -0.3), p.shape)
        case 2:
            p[v] = p[w] + rng.choice([0, 1e-12, 1e-7, 1e-4, 1e-2])
        case 3:
            face[a], face[b] = face[b], face[a]
        case 4:
            face.reverse()
        case 5 if len(faces) > 1:
            del faces[f]
        case 6:
            faces.append(list(face) if rng.random() < 0.5 else [int(i) for i in rng.permutation(face)])
        case 7:
            face[a] = v
        case 8:
            p[:, int(rng.integers(3))] *= 10.0 ** rng.uniform(-9, 2)
        case 9:
            p[face[a]] = p[face].mean(axis=0)
        case 10:
            p[face[a]] = 2 * p[face[b]] - p[face[a]]
        case 11:
            p[v] *= rng.choice([0.0, 1e3, 1e9, 1e200, np.nan, -1.0])
        case 12:
            p += rng.choice([1e3, 1e6, 1e9, 1e15])
        case 13:  # a roll or a fold about an axis
            p[:, 0], p[:, 2] = np.abs(p[:, 0] - p[v, 0]), p[:, 2] + 10.0 ** rng.uniform(-9, 0) * p[:, 0]


def mutant(number: int) -> PolygonMesh:
    """The mesh of a number."""
    rng = np.random.default_rng(number)
    p, faces = _good(rng)
    for _ in range(int(rng.choice([0, 1, 1, 1, 2, 3]))):
        with np.errstate(all="ignore"):
            _spoilt(rng, p, faces)
    return PolygonMesh(
        p, np.array([v for f in faces for v in f], np.int64), np.array([len(f) for f in faces], np.int64)
    )


def play(number: int, whole: bool) -> str:
    """Return the error that stops it, or "made"."""
    mesh = mutant(number)
    with warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)
        scaled = check.scale_to_metres(mesh, edge=EDGE)
        found = check.findings(scaled)
    errors = [f for f in found if f.is_error]
    if errors:
        assert all(f.faces or f.code in {"no-faces", "size", "far-from-origin"} for f in errors)
        return "faulty"
    try:
        job.run(mesh, SETTINGS, edge=EDGE)
    except FlexMapsError as error:
        assert "\n" not in str(error)
        return "not made"
    return "made"


def described(number: int) -> str:
    """The mesh and what is found in it."""
    mesh = mutant(number)
    faces = np.split(mesh.corners, np.cumsum(mesh.sizes)[:-1])
    return f"{mesh.vertices.tolist()}\n{[f.tolist() for f in faces]}\n{[f.message for f in check.findings(check.scale_to_metres(mesh, edge=EDGE))]}"
