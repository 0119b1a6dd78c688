"""Scans of built pieces: how many of random starts end with the scan over the surface.

python3 tools/dev.py bench make [--starts N] [--only PATTERNS] [--json FILE]

Every start shows three fifths of a surface, with noise, a table below and outliers, turned by up to 30 degrees. It is judged by
the root mean square distance between the surface and the scan's true points where they were laid, not by the pose: symmetric
surfaces have several right ones. No noise is in what is judged.
"""

from __future__ import annotations

import argparse
import fnmatch
import json
from pathlib import Path

import igl
import numpy as np
import zoo
from flexmaps.engine.errors import FlexMapsError
from flexmaps.engine.scanning.compare import compare
from flexmaps.engine.surface.checking.check import as_quad_mesh
from flexmaps.engine.surface.mesh import QuadMesh
from rows import Table, at_least, row
from scipy.spatial.transform import Rotation

WANTED, NEAR = 0.99, 0.001  # share of starts that end within this share of the size
DEGREES, SHOWN, NOISE = 30.0, 0.6, 0.001  # a start's largest turn, share of the surface, noise as a share of the size
MADE = ("cube", "torus", "dome", "saddle", "vault", "hypar", "barrel", "three-holes", "rounded-l", "potato")


def main(arguments: list[str]) -> int:
    """Measure, print the table, write the rows; 0 whatever was measured."""
    parser = argparse.ArgumentParser(prog="dev.py bench make")
    parser.add_argument("--starts", type=int, default=1000, help="starts over all surfaces")
    parser.add_argument("--only", default="*", help="patterns of names, with commas")
    parser.add_argument("--json", type=Path, help="write the rows here too, and go on from those that are there")
    options = parser.parse_args(arguments)
    names = [name for name in MADE if name in zoo.SURFACES]
    names = [name for name in names if any(fnmatch.fnmatch(name, one) for one in options.only.split(","))]
    table = Table(26)
    known = json.loads(options.json.read_text()) if options.json and options.json.is_file() else []
    table.rows = [one for one in known if one["mesh"] != "all"]
    for name in names:
        if name not in {one["mesh"] for one in table.rows}:
            mesh = as_quad_mesh(zoo.SURFACES[name].polygons())
            ends = [_end(mesh, seed) for seed in range(-(-options.starts // len(names)))]
            table.add(row(name, "starts that end right", "", float(np.mean(np.array(ends) <= NEAR)), None))
            table.add(row(name, "median distance", "", float(f"{np.median(ends):.2g}"), None))
        if options.json:
            options.json.write_text(json.dumps(table.rows, indent=1) + "\n")
    shares = [one["measured"] for one in table.rows if one["row"] == "starts that end right"]
    if shares:
        table.add(at_least("all", "starts that end right", WANTED, float(np.mean(shares))))
    table.finish(options.json)
    return 0


def _end(mesh: QuadMesh, seed: int) -> float:
    """RMS distance of the true points from the surface where they were laid, as a share of the size; infinite if refused."""
    random = np.random.default_rng(seed)
    of = random.choice(len(mesh.quads), 8000, p=mesh.areas / mesh.areas.sum())
    corners = mesh.quads[of][:, [0, 1, 2]]
    corners[::2] = mesh.quads[of][::2][:, [0, 2, 3]]
    true = np.einsum("nk,nki->ni", random.dirichlet(np.ones(3), 8000), mesh.vertices[corners])
    size = float(np.linalg.norm(np.ptp(true, axis=0)))
    side = true @ random.normal(size=3)
    true = true[side < np.quantile(side, SHOWN)]
    low, middle = true.min(axis=0), true.mean(axis=0)
    table = np.column_stack([middle[:2] + 0.6 * size * (random.random((1500, 2)) - 0.5), np.full(1500, low[2])])
    others = np.concatenate([table, middle + size * (random.random((200, 3)) - 0.5)])
    axis = random.normal(size=3)
    turn = Rotation.from_rotvec(np.radians(DEGREES) * random.random() * axis / np.linalg.norm(axis)).as_matrix()
    shift = 0.1 * size * random.normal(size=3)
    scan = np.concatenate([true + NOISE * size * random.normal(size=true.shape), others]) @ turn.T + shift
    try:
        found = compare(mesh, scan, scale=1.0, anywhere=False)
    except FlexMapsError:
        return float("inf")
    laid = (true @ turn.T + shift) @ found.turn.T + found.shift
    triangles = np.concatenate([mesh.quads[:, [0, 1, 2]], mesh.quads[:, [0, 2, 3]]])
    squared = igl.point_mesh_squared_distance(laid, mesh.vertices, triangles)[0]
    return float(np.sqrt(np.mean(squared)) / size)
