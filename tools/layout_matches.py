"""Compares the match that *Merge* expects of layouts with what the optimiser reaches."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from itertools import islice

import numpy as np
from flexmaps.engine.errors import FlexMapsError
from flexmaps.engine.extras.choosing.drawn_cuts import equal_part_cuts
from flexmaps.engine.extras.choosing.judge import CutPlan, FlatLayout, LayoutProblem, flatten_cuts
from flexmaps.engine.extras.choosing.predict import PredictionStart, predict
from flexmaps.engine.extras.choosing.refine_merged import EXTRA_STEPS
from flexmaps.engine.optimisation.optimise import optimise
from flexmaps.engine.params import Settings
from flexmaps.engine.patches.merging import merge
from flexmaps.engine.patches.tracing import trace
from flexmaps.engine.spirals.fabricable import curvature_adjusted, make_fabricable
from flexmaps.engine.surface import curvature
from flexmaps.engine.surface.mesh import PolygonMesh, QuadMesh
from harness import Options, Row, StoredResults, at_least, at_most, measure_time, note, run_job
from scipy.stats import spearmanr

LIMITS = 1.0, 0.4, 0.15, 0.06  # times the usual distortion: layouts of more and more panels
PARTS = 6  # strips, rings and petals where the limits lead to too few layouts
CUTTABLE = 0.1  # percent of the size: nobody tells nearer pieces apart, so that they count as this near
FACTOR = 1.5  # within which a prediction shall be
LEAST = 3  # layouts of which a correlation says anything
PREDICTED = ": predicted, %"  # end of the rows' names


def measure(name: str, polygons: PolygonMesh, options: Options) -> Iterator[Row]:
    """Predict layouts, search those of which the file has no answer yet, and yield both."""
    piece, answers = LayoutProblem(run_job(polygons, "regularise").mesh, Settings()), StoredResults(options.match)
    several = list(islice(_layouts(piece), options.layouts))
    start = PredictionStart.from_layout(piece, several[0].flat) if several else None
    for laid in several:
        key = f"{name} {hashlib.sha256(laid.cut.tobytes()).hexdigest()[:16]}"
        reached = answers.answer(key, partial(_search, piece, laid, options.patience))
        seconds, share = measure_time(partial(predict, piece, laid.flat, start, further=EXTRA_STEPS), time.thread_time)
        peer = {"reached": reached, "s for 1,000 quads": round(1e3 * seconds / len(piece.mesh.quads), 2)}
        yield note(name, f"{laid.panels} panels{PREDICTED}", float(f"{100.0 * share:.4g}"), peer)


def _layouts(piece: LayoutProblem) -> Iterator[FlatLayout]:
    """Layouts of a surface, each once: merged under several limits, then equal parts."""
    seen = set[bytes]()
    for cut in _cuts(piece.mesh, piece.settings):
        laid = flatten_cuts(piece, CutPlan(cut & ~piece.mesh.border, ""))
        if laid is not None and laid.cut.tobytes() not in seen:
            seen.add(laid.cut.tobytes())
            yield laid


def _cuts(mesh: QuadMesh, settings: Settings) -> Iterator[np.ndarray]:
    for limit in LIMITS:
        layout = replace(settings.layout, distortion_limit=limit * settings.layout.distortion_limit)
        try:
            yield merge.merge(trace.trace_layout(mesh, layout), layout).layout.cut
        except FlexMapsError:
            continue
    yield from (cut for _, cut in equal_part_cuts(mesh, PARTS, []))


def _search(piece: LayoutProblem, laid: FlatLayout, patience: float) -> float:
    """Percent of the size, RMS, that a search comes near."""
    settings = piece.settings
    wanted = curvature_adjusted(settings.spiral, curvature.rms_curvature(piece.mesh))
    design = make_fabricable(laid.flat, settings.spiral, *wanted, check_outlines=False)
    params = replace(settings.optimise, patience=patience)
    found = optimise(design, piece.mesh, settings.material.chosen, params, settings.simulate, prove=False)
    return float(found.after.target_distances["rms_percent"])


def sum_up(rows: list[Row], options: Options) -> list[Row]:
    """Return rank correlations, the share of predictions that are near, and seconds for 1,000 quads."""
    found = [one for one in rows if one["row"].endswith(PREDICTED)]
    if len(found) < LEAST:
        return []
    names = np.array([one["mesh"] for one in found])
    percent = np.maximum([one["measured"] for one in found], CUTTABLE)
    reached = np.maximum([one["peer"]["reached"] for one in found], CUTTABLE)
    seconds = [one["peer"]["s for 1,000 quads"] for one in found]
    several = [names == name for name in np.unique(names) if (names == name).sum() >= LEAST]
    each = [spearmanr(percent[some], reached[some])[0] for some in several]
    near = 100.0 * float((np.abs(np.log(percent / reached)) <= np.log(FACTOR)).mean())
    own = {"of one surface, median": f"{np.nanmedian(each):.2f}"} if each else {}
    return [
        at_least("all", "rank correlation", 0.9, float(spearmanr(percent, reached)[0]), own),
        at_least("all", f"within a factor of {FACTOR:g}, %", 80.0, near),
        at_most("all", "seconds for 1,000 quads, median", 2.0, float(np.median(seconds)), {"most": max(seconds)}),
    ]
