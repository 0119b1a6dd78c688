"""One candidate: a piece with other settings or of another size, laid out, searched for a moment, and measured."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..arrays import Bool, Float, Int
from ..choosing import choose
from ..choosing.choice import proposal
from ..choosing.judge import Judged, Laid, Piece, judge
from ..display import plots
from ..display.drawing import svg
from ..errors import FlexMapsError
from ..materials import Material
from ..params import Settings, changed
from ..runs import job
from ..runs.result import Result
from ..surface.mesh import PolygonMesh, QuadMesh
from ..workers import Workers
from .space import SIZES, Values

# Share of the optimiser's patience that a candidate gets, as a layout gets that is compared with others (``judge.SHORT``)
EFFORT = 0.15
PICTURE = 220.0  # pixels across


@dataclass(frozen=True, eq=False)
class Start:
    """A surface that candidates begin with: its mesh, and the edges (E,) bool where it is cut unless the layout is varied."""

    mesh: QuadMesh
    cut: Bool[np.ndarray, " edges"]


@dataclass(frozen=True, eq=False)
class Base:
    """What all candidates have in common.

    starts : by the number of quads that was asked for; 0 where that is not varied
    supports : (k,) int quads that stand, or None; force : (F, 3) newtons on the quads, or None
    effort : share of the optimiser's patience that a candidate gets
    """

    starts: Mapping[int, Start]
    settings: Settings
    supports: Int[np.ndarray, " held"] | None = None
    force: Float[np.ndarray, "quads 3"] | None = None
    effort: float = EFFORT


@dataclass(frozen=True)
class Candidate:
    """What was tried, in shown units, and what came of it.

    measures : by the names of ``space.MEASURES``; empty where it could not be made, and ``fault`` says why
    advice : what limits its match, in a sentence; picture : the surface with its panels, as SVG
    """

    values: Values
    measures: dict[str, float] = field(default_factory=dict)
    advice: str = ""
    fault: str = ""
    picture: str = ""

    def row(self) -> dict[str, Any]:
        """It as one line of a table, without its picture."""
        return {**self.values, **self.measures, "advice": self.advice, "fault": self.fault}


def evaluate(base: Base, values: Values) -> Candidate:
    """Try some values. What cannot be made is told in ``Candidate.fault``; faults of the program propagate."""
    try:
        settings = changed(base.settings, {name: value for name, value in values.items() if name not in SIZES})
        start = base.starts[values.get("quads", 0)]
        mesh = _sized(start.mesh, values)
        laid = _laid(base, start, mesh, settings, values)
        piece = Piece(mesh, settings, base.supports, base.force)
        judged = judge(piece, laid, base.effort, thorough=True)
        if judged is None:
            return Candidate(values, fault="No shape was found that its panels come to rest in")
        return Candidate(
            values, _measured(judged, settings, settings.material.chosen), judged.advice, "", _picture(laid)
        )
    except FlexMapsError as error:
        return Candidate(values, fault=str(error))


def _sized(mesh: QuadMesh, values: Values) -> QuadMesh:
    """The mesh in the size that is tried."""
    if "edge" in values:
        return mesh.moved(mesh.vertices * (values["edge"] / 1e3 / mesh.median_edge))
    if "height" in values:
        tall = float(np.ptp(mesh.vertices[:, 2]))
        if tall <= 0.0:
            raise FlexMapsError("The piece lies flat and has no height; vary edge instead")
        return mesh.moved(mesh.vertices * (values["height"] / 1e3 / tall))
    return mesh


def _laid(base: Base, start: Start, mesh: QuadMesh, settings: Settings, values: Values) -> Laid:
    """Its flat patches, in the layout that the piece has unless that is varied."""
    result = Result(PolygonMesh.of(mesh), [], mesh, supports=base.supports, force=base.force)
    if any(name.startswith("layout.") for name in values):
        result = job.go_on(result, settings, ("trace", "merge", "split"))
    else:
        result = job.go_on(job.flattened(result, start.cut, settings.layout), settings, ("split",))
    flat = result.flat
    assert flat is not None
    if any(name.startswith("choose.") for name in values):
        piece = Piece(mesh, settings, base.supports, base.force)
        flat = choose.choose(piece, flat, settings.choose, together=Workers(1)).best.flat
    return Laid(flat, "", 1)


def _measured(judged: Judged, settings: Settings, material: Material) -> dict[str, float]:
    made, mesh = proposal(judged, settings, material), judged.laid.flat.layout.mesh
    found = {
        "rms_percent": 100.0 * judged.rms,
        "max_percent": 100.0 * judged.largest,
        "strain_share": judged.strain,
        **({} if judged.closed is None else {"slots_closed": judged.closed}),
        "panels": made.panels,
        "joints": judged.laid.joints,
        "sheets": made.sheets,
        "quads": len(mesh.quads),
        "edge_mm": 1e3 * mesh.median_edge,
        "size_mm": 1e3 * float(np.ptp(mesh.vertices, axis=0).max()),
        **({} if made.cut is None else {"cut_minutes": made.cut / 60.0}),
        "join_minutes": made.join / 60.0,
    }
    return {name: float(f"{value:.4g}") for name, value in found.items() if math.isfinite(value)}


def _picture(laid: Laid) -> str:
    """The surface in the colours of its panels."""
    layout = laid.flat.layout
    sides = layout.cut[layout.mesh.quad_edges]
    return svg(plots.thumbnail(layout.mesh.vertices, layout.mesh.quads, sides, layout.patch_of, PICTURE))


def with_values(settings: Settings, values: Mapping[str, Any]) -> Settings:
    """The settings of a candidate, without its size."""
    return changed(settings, {name: value for name, value in values.items() if name not in SIZES})


def lost(values: Values, error: Exception) -> Candidate:
    """A candidate at which the program failed, or its process ended."""
    what = (
        str(error) if isinstance(error, FlexMapsError) else f"A fault of the program, {type(error).__name__}: {error}"
    )
    return Candidate(values, fault=" ".join(what.split()))
