"""Compares the predicted match of layouts with what the optimiser reaches."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator, Mapping
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from flexmaps.engine.errors import FlexMapsError
from flexmaps.engine.extras.choosing.drawn_cuts import equal_cuts
from flexmaps.engine.extras.choosing.judge import FlatLayout, Idea, LayoutProblem, lay_flat
from flexmaps.engine.extras.choosing.predict import PredictionStart, predict
from flexmaps.engine.optimisation.optimise import optimise
from flexmaps.engine.params import Settings
from flexmaps.engine.patches.merging import merge
from flexmaps.engine.patches.tracing import trace
from flexmaps.engine.runs import job
from flexmaps.engine.spirals.fabricable import curvature_adjusted, make_fabricable
from flexmaps.engine.surface import curvature
from flexmaps.engine.surface.mesh import PolygonMesh, QuadMesh

EDGE = 0.02  # metres, median quad edge of every mesh here
LIMITS = 1.0, 0.4, 0.15, 0.06  # times the usual distortion: layouts of more and more panels
PARTS = 6  # strips, rings and petals where the limits lead to too few layouts
CUTTABLE = 0.1  # percent of the size: nobody tells nearer pieces apart, so that they count as this near
FACTOR = 1.5  # within which a prediction shall be


def compare(surfaces: Mapping[str, PolygonMesh], path: Path, layouts: int, patience: float) -> None:
    """Predict layouts, search those that have no row in the file yet, and print how well both agree."""
    rows: list[dict[str, Any]] = json.loads(path.read_text()) if path.is_file() else []
    found = []
    for name, polygons in surfaces.items():
        try:
            mesh = job.run(polygons, Settings(), edge=EDGE, stop_after="regularise").mesh
            piece = LayoutProblem(mesh, Settings())
            several = list(islice(_layouts(piece), layouts))
            start = PredictionStart.from_layout(piece, several[0].flat)
        except (FlexMapsError, IndexError) as error:
            print(name, "is left out:", error)
            continue
        for laid in several:
            cut = np.flatnonzero(laid.cut).tolist()
            row = next((one for one in rows if one["surface"] == name and one["cut"] == cut), None)
            if row is None:
                reached = _search(piece, laid, patience)
                row = {"surface": name, "cut": cut, "quads": len(mesh.quads), "panels": laid.panels, "reached": reached}
                rows.append(row)
                path.write_text(json.dumps(rows))
            began = time.thread_time()
            percent = 100.0 * predict(piece, laid.flat, start)
            took = time.thread_time() - began
            found.append((name, percent, row["reached"], 1e3 * took / len(mesh.quads)))
            print(
                f"{name:<24}{len(mesh.quads):>6} quads{laid.panels:>4} panels  predicted {percent:7.3f} %  reached {row['reached']:7.3f} %{took:6.1f} s",
                flush=True,
            )
    if len(found) > 2:
        _agreement(found)


def _layouts(piece: LayoutProblem) -> Iterator[FlatLayout]:
    """Layouts of a surface, each once: merged under several limits, then equal parts."""
    seen = set[bytes]()
    for cut in _cuts(piece.mesh, piece.settings):
        laid = lay_flat(piece, Idea(cut & ~piece.mesh.border, ""))
        if laid is not None and laid.cut.tobytes() not in seen:
            seen.add(laid.cut.tobytes())
            yield laid


def _cuts(mesh: QuadMesh, settings: Settings) -> Iterator[np.ndarray]:
    for limit in LIMITS:
        layout = replace(settings.layout, distortion_limit=limit * settings.layout.distortion_limit)
        try:
            yield merge.merge(trace.trace(mesh, layout), layout).layout.cut
        except FlexMapsError:
            continue
    yield from (cut for _, cut in equal_cuts(mesh, PARTS, []))


def _search(piece: LayoutProblem, laid: FlatLayout, patience: float) -> float:
    """Percent of the size, RMS, that a search comes near."""
    settings = piece.settings
    wanted = curvature_adjusted(settings.spiral, curvature.rms_curvature(piece.mesh))
    design = make_fabricable(laid.flat, settings.spiral, *wanted, prove=False)
    params = replace(settings.optimise, patience=patience)
    found = optimise(design, piece.mesh, settings.material.chosen, params, settings.simulate, prove=False)
    return float(found.after.match["rms_percent"])


def _agreement(found: list[tuple[str, float, float, float]]) -> None:
    """Print rank correlations, the share of predictions that are near, and seconds for 1,000 quads."""
    from scipy.stats import spearmanr

    names = np.array([one[0] for one in found])
    percent, reached, seconds = (np.array([one[k] for one in found]) for k in (1, 2, 3))
    percent, reached = np.maximum(percent, CUTTABLE), np.maximum(reached, CUTTABLE)
    each = [
        spearmanr(percent[names == name], reached[names == name])[0]
        for name in np.unique(names)
        if (names == name).sum() > 2
    ]
    near = float((np.abs(np.log(percent / reached)) <= np.log(FACTOR)).mean())
    print(f"{len(found)} layouts of {len(set(names))} surfaces")
    print(
        f"rank correlation {spearmanr(percent, reached)[0]:.2f} (asked .9), among layouts of one surface {np.nanmedian(each):.2f} in the median"
    )
    print(f"within a factor of {FACTOR:g}: {100 * near:.0f} % (asked 80)")
    print(f"seconds for 1,000 quads: {np.median(seconds):.1f} in the median, at most {seconds.max():.1f} (asked 2)")
