"""Benchmark of scan registration: share of random starting poses from which the scan is aligned with the surface.

python3 tools/dev.py bench make [--starts N] [--only PATTERNS] [--anywhere] [--json FILE]

Each synthetic scan covers three fifths of a surface, with noise, a table below and outliers, rotated by up to 30 degrees, or with
``--anywhere`` by any angle. The error is the RMS distance between the surface and the aligned noise-free points; the pose itself is not
compared, since symmetric surfaces have several right ones. Surfaces take turns, so that an interrupted run covers all of them; it is
resumed from the starts in the file.
"""

from __future__ import annotations

import argparse
import json
import time

import igl
import numpy as np
import zoo
from flexmaps.engine.errors import FlexMapsError
from flexmaps.engine.extras.scanning.compare import compare
from flexmaps.engine.extras.scanning.reading import Scan
from flexmaps.engine.surface import shapes
from flexmaps.engine.surface.checking.check import as_quad_mesh
from flexmaps.engine.surface.mesh import QuadMesh
from harness import Bench
from rows import Row, at_least, note, row
from scipy.spatial.transform import Rotation

WANTED, NEAR = 0.99, 0.001  # share of starts that end within this share of the size
DEGREES, SHOWN, NOISE = 30.0, 0.6, 0.001  # a start's largest turn, share of the surface, noise as a share of the size
# at least one surface of each family of the zoo, with those that can slide along themselves (gable, accordion, barrel, dome)
MADE = (
    "cube", "torus", "dome", "saddle", "vault", "hypar", "barrel", "three_holes", "coil", "elbow", "gable", "accordion", "vase",
    "knot25", "enneper", "monkey", "terrain-gentle", "hill-ratio4", "dome-oculus", "schwarz-p", "star5", "flower3", "tower-leaning",
    "hip-roof", "catenoid",
)  # fmt: skip


def main(arguments: list[str]) -> int:
    """Measure, print the table, write the starts; return 0 whatever the figures."""
    anywhere = (False, "rotated by any angle")
    bench = Bench("make", arguments, 26, only="*", starts=(1000, "starts over all surfaces"), anywhere=anywhere)
    bench.table.add(*measure_starts([name for name in MADE if bench.asked(name)], bench.options))
    bench.table.finish(None)  # the file holds the starts
    return 0


def measure_starts(names: list[str], options: argparse.Namespace) -> list[Row]:
    """Return the share of successful starts, for each surface and in all."""
    known = json.loads(options.json.read_text()) if options.json and options.json.is_file() else {}
    starts = [(name, seed) for seed in range(-(-options.starts // max(1, len(names)))) for name in names]
    starts = starts[: options.starts]
    for name, seed in starts:
        if f"{name} {seed}" in known:
            continue
        begun = time.process_time()
        known[f"{name} {seed}"] = _end(_mesh(name), seed, options.anywhere), time.process_time() - begun
        if options.json:
            beside = options.json.with_suffix(".new")
            beside.write_text(json.dumps(known) + "\n")
            beside.replace(options.json)
    rows = []
    for name in names:
        found = np.array([known[f"{one} {seed}"][0] for one, seed in starts if one == name])
        if len(found):
            rows.append(row(name, "starts that end right", f"of {len(found)}", float(np.mean(found <= NEAR)), None))
            rows.append(note(name, "median distance", float(f"{np.median(found):.2g}")))
            rows.append(note(name, "largest distance", float(f"{found.max():.2g}")))
    if starts:
        ends, seconds = np.array([known[f"{name} {seed}"] for name, seed in starts]).T
        rows.append(note("all", "processor seconds, median", float(np.median(seconds))))
        rows.append(note("all", "starts", len(starts)))
        rows.append(at_least("all", "starts that end right", WANTED, float(np.mean(ends <= NEAR))))
    return rows


def _mesh(name: str) -> QuadMesh:
    """Return a surface of the zoo or a built-in one."""
    return as_quad_mesh(zoo.SURFACES[name].polygons()) if name in zoo.SURFACES else shapes.make(name)


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
        found = compare(mesh, Scan(scan, unit="m", anywhere=anywhere))
    except FlexMapsError:
        return float("inf")
    laid = (true @ turn.T + shift) @ found.turn.T + found.shift
    triangles = np.concatenate([mesh.quads[:, [0, 1, 2]], mesh.quads[:, [0, 2, 3]]])
    squared = igl.point_mesh_squared_distance(laid, mesh.vertices, triangles)[0]
    return float(np.sqrt(np.mean(squared)) / size)
