"""Benchmark of scan registration: share of random starting poses from which the scan is aligned with the surface.

Each synthetic scan covers three fifths of a surface, with noise, a table below and outliers, rotated by up to 30 degrees, or with
``--anywhere`` by any angle. The error is the RMS distance between the surface and the aligned noise-free points, since symmetric surfaces
have several right poses. Surfaces take turns, so that an interrupted run covers all of them.
"""

from __future__ import annotations

from collections import Counter
from functools import partial

import igl
import numpy as np
import zoo
from flexmaps.engine.errors import FlexMapsError
from flexmaps.engine.extras.scanning.compare import compare_scan
from flexmaps.engine.extras.scanning.scan_reader import Scan
from flexmaps.engine.surface import shapes
from flexmaps.engine.surface.checking.check import as_quad_mesh
from flexmaps.engine.surface.mesh import QuadMesh
from harness import Bench, Cases, Options, Row, Rows, at_least, matches, note
from scipy.spatial.transform import Rotation

WANTED, NEAR = 0.99, 0.001  # share of starts that end within this share of the size
DEGREES, SHOWN, NOISE = 30.0, 0.6, 0.001  # a start's largest turn, share of the surface, noise as a share of the size
# at least one surface of each family of the zoo, with those that can slide along themselves (gable, accordion, barrel, dome)
MADE = (
    "cube", "torus", "dome", "saddle", "vault", "hypar", "barrel", "three_holes", "coil", "elbow", "gable", "accordion", "vase",
    "knot25", "enneper", "monkey", "terrain-gentle", "hill-ratio4", "dome-oculus", "schwarz-p", "star5", "flower3", "tower-leaning",
    "hip-roof", "catenoid",
)  # fmt: skip


def cases(options: Options) -> Cases:
    """Return the starts, surface by surface in turns."""
    names = [name for name in MADE if matches(name, options.only.split(","))]
    seeds = range(-(-options.starts // max(1, len(names))))
    starts = [(name, seed) for seed in seeds for name in names][: options.starts]
    return {f"{name} {seed}": partial(_start, name, seed) for name, seed in starts}


def _start(name: str, seed: int) -> tuple[QuadMesh, int]:
    """Return a surface of the zoo or a built-in one, and the number of the start."""
    return (as_quad_mesh(zoo.SURFACES[name].polygons()) if name in zoo.SURFACES else shapes.make(name)), seed


def measure(name: str, start: tuple[QuadMesh, int], options: Options) -> Rows:
    """Lay a scan on its surface, and tell how far from it the true points come to lie."""
    return [note(name, "distance over size", _end(*start, options.anywhere))]


def sum_up(rows: list[Row], _: Options) -> Rows:
    """Return the share of successful starts, and the surfaces on which one fails."""
    right = [one["measured"] <= NEAR for one in rows]
    failed = Counter(one["mesh"].rpartition(" ")[0] for one in rows if one["measured"] > NEAR)
    return [at_least("all", "starts that end right", WANTED, float(np.mean(right or [0.0])), {"failed": failed})]


def _sample_scan(mesh: QuadMesh, count: int, random: np.random.Generator) -> tuple[np.ndarray, float]:
    """Sample a surface and return the points on one side of a random plane, which the scan covers, and the surface's size."""
    of = random.choice(len(mesh.quads), count, p=mesh.areas / mesh.areas.sum())
    corners = mesh.quads[of][:, [0, 1, 2]]
    corners[::2] = mesh.quads[of][::2][:, [0, 2, 3]]
    true = np.einsum("nk,nki->ni", random.dirichlet(np.ones(3), count), mesh.vertices[corners])
    size = float(np.linalg.norm(np.ptp(true, axis=0)))
    side = true @ random.normal(size=3)
    return true[side < np.quantile(side, SHOWN)], size


def _end(mesh: QuadMesh, seed: int, anywhere: bool) -> float:
    """RMS distance of the true points from the surface where they were laid, as a share of the size; infinite if refused."""
    random = np.random.default_rng(seed)
    true, size = _sample_scan(mesh, 8000, random)
    low, middle = true.min(axis=0), true.mean(axis=0)
    table = np.column_stack([middle[:2] + 0.6 * size * (random.random((1500, 2)) - 0.5), np.full(1500, low[2])])
    others = np.concatenate([table, middle + size * (random.random((200, 3)) - 0.5)])
    axis = random.normal(size=3)
    degrees = (180.0 if anywhere else DEGREES) * random.random()
    turn = Rotation.from_rotvec(np.radians(degrees) * axis / np.linalg.norm(axis)).as_matrix()
    shift = 0.1 * size * random.normal(size=3)
    scan = np.concatenate([true + NOISE * size * random.normal(size=true.shape), others]) @ turn.T + shift
    try:
        found = compare_scan(mesh, Scan(scan, unit="m", anywhere=anywhere))
    except FlexMapsError:
        return float("inf")
    laid = (true @ turn.T + shift) @ found.turn.T + found.shift
    triangles = np.concatenate([mesh.quads[:, [0, 1, 2]], mesh.quads[:, [0, 2, 3]]])
    squared = igl.point_mesh_squared_distance(laid, mesh.vertices, triangles)[0]
    return float(np.sqrt(np.mean(squared)) / size)


main = Bench(
    "make", cases, measure, summary=sum_up, resume=True,
    starts=(1000, "starts over all surfaces"), anywhere=(False, "rotated by any angle"),
)  # fmt: skip
