"""Measures polygons that are remeshed, sheets of any size, and objects in scenes of others: hidden, keyed, bent, linked, far away.

python3 tools/dev.py bench scenes [--json FILE] [--seed N]

Every kind is made ten times, of other surfaces and by chance; a row counts what came out right. ``refused`` counts those that end with
a sentence instead of a surface: at most a quarter of all.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
from flexmaps.engine.errors import FlexMapsError
from flexmaps.engine.fabrication.nesting.many import refuse_many
from flexmaps.engine.params import Settings, SheetParams, with_values
from flexmaps.engine.patches.splitting import split
from flexmaps.engine.runs import job
from flexmaps.engine.runs.result import Result
from flexmaps.engine.surface import shapes
from flexmaps.engine.surface.mesh import PolygonMesh, QuadMesh
from harness import Bench
from rows import at_least, at_most
from scene_kinds import MADE, WRONG, bent, braces, far_object, hidden, keyed, linked, right
from scipy.spatial import cKDTree

MANY = 10  # of each kind
QUADS = 60  # of a polygon that is remeshed
REFUSED = 0.25  # share of all that may end with a sentence
NAMES = [name for name in shapes.NAMES if name != "quad"]
REFUSAL = "refused"
Kind = Callable[[str, np.random.Generator], str]


def main(arguments: list[str]) -> int:
    """Try every kind, print the table and write the rows; return 0 whatever the figures."""
    bench, refused, whole = Bench("scenes", arguments, 44, seed=(0, "another number makes others")), 0, 0
    for kind in KINDS:
        random = np.random.default_rng(bench.options.seed)
        found = [kind(NAMES[k % len(NAMES)], random) for k in range(MANY)]
        told = (kind.__doc__ or "").rstrip(".")
        bench.table.add(at_least(kind.__name__, told, MANY, float(MANY - found.count(WRONG))))
        refused, whole = refused + found.count(REFUSAL), whole + MANY
    return bench.finish(at_most("all", "share that is refused by name", REFUSED, refused / whole))


def quads(name: str) -> PolygonMesh:
    return PolygonMesh.from_quads(shapes.make(name))


def _polygon(random: np.random.Generator) -> tuple[float, ...]:
    """The angles of the corners of a polygon in a circle."""
    count = int(random.integers(3, 8))
    angle = np.sort(random.uniform(0.0, 2.0 * np.pi, count))
    if np.max(np.diff(np.append(angle, angle[0] + 2.0 * np.pi))) > 0.9 * np.pi:
        angle = 2.0 * np.pi * np.arange(count) / count
    return tuple(angle.tolist())


def _corners(angle: tuple[float, ...]) -> np.ndarray:
    """(count, 3) metres."""
    return 0.1 * np.column_stack([np.cos(angle), np.sin(angle), np.zeros(len(angle))])


@cache
def _remeshed(angle: tuple[float, ...]) -> QuadMesh | str:
    """The quads of a polygon, or what came of it instead."""
    from flexmaps import api

    points, count = _corners(angle), len(angle)
    lines = ["v {:.9f} {:.9f} {:.9f}".format(*p) for p in points]
    lines.append("f " + " ".join(str(k + 1) for k in range(count)))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "a.obj"
        path.write_text("\n".join(lines))
        try:
            made = api.load(path, quads=QUADS, up="z").mesh
        except FlexMapsError as error:
            return REFUSAL if "quads" in str(error) else WRONG
    assert made is not None
    return made


def ngon(name: str, random: np.random.Generator) -> str:
    """flat polygons with sharp corners, remeshed whole"""
    angle = _polygon(random)
    made, points = _remeshed(angle), _corners(angle)
    if isinstance(made, str):
        return made
    area = 0.5 * np.abs(np.cross(points[:, :2], np.roll(points[:, :2], -1, axis=0)).sum())
    return right(abs(made.areas.sum() / area - 1.0) < 0.02)


def coverage(name: str, random: np.random.Generator) -> str:
    """polygons no part of which is far from their quads"""
    angle = _polygon(random)
    made, points = _remeshed(angle), _corners(angle)
    if isinstance(made, str):
        return made
    random = np.random.default_rng(len(angle))  # so that polygons are those of the row before
    share = random.uniform(0.0, 1.0, 1000)[:, None]
    rim = np.concatenate(
        [(1.0 - share) * a + share * b for a, b in zip(points, np.roll(points, 1, axis=0), strict=True)]
    )
    inside = rim * np.sqrt(random.uniform(0.0, 1.0, len(rim)))[:, None]
    # quads are sampled ten times an edge, so that the nearest sample is as near as the quad but for a tenth of an edge
    u, v = (one.ravel()[:, None, None] for one in np.meshgrid(np.linspace(0, 1, 11), np.linspace(0, 1, 11)))
    a, b, c, d = (made.vertices[made.quads[:, k]] for k in range(4))
    sampled = (1 - u) * (1 - v) * a + u * (1 - v) * b + u * v * c + (1 - u) * v * d
    far = cKDTree(sampled.reshape(-1, 3)).query(np.concatenate([rim, inside]))[0] / made.median_edge
    return right(float(np.quantile(far, 0.95)) < 0.6 and float(far.max()) < 1.6)


# -- sheets ----------------------------------------------------------------------------------------------------------------


@cache
def _merged_dome() -> Result:
    """A dome laid out for a sheet that all of its panels fit."""
    return job.run(quads("dome"), Settings(), edge=0.015, stop_after="merge")


def split_fits(name: str, random: np.random.Generator) -> str:
    """every panel fits a sheet of any size"""
    width, height = random.uniform(0.06, 0.4, 2)
    settings = with_values(Settings(), {"sheet.sheet_width": 1e3 * width, "sheet.sheet_height": 1e3 * height})
    try:
        made = job.run_stages(_merged_dome(), settings, ("split",))
    except FlexMapsError as error:
        return REFUSAL if "single quads" in str(error) else WRONG
    assert made.flat is not None
    try:
        split.check_size(made.flat, settings.layout, settings.sheet)
    except FlexMapsError:
        return WRONG
    return MADE


def many_sheets(name: str, random: np.random.Generator) -> str:
    """sheets far too small, with a size that would do"""
    side = float(random.uniform(0.03, 0.2))
    square = side * np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
    size = side * float(random.uniform(1.02, 1.9)) + 0.01
    sheet = replace(SheetParams(), sheet_width=size, sheet_height=size, margin=0.003)
    thin = [square * (1.0, 0.2) if random.random() < 0.1 else square * (1.0, 0.9) for _ in range(40)]
    try:
        refuse_many(thin, sheet)
    except FlexMapsError as error:
        return REFUSAL if "would do" in str(error) else WRONG
    return MADE


KINDS: tuple[Kind, ...] = (ngon, coverage, split_fits, many_sheets, hidden, keyed, bent, far_object, linked, braces)
