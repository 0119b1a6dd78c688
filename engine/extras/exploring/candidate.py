"""Candidates: variants of a piece (settings, size), each laid out, briefly optimised and measured."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ...arrays import Bool, Float, Int
from ...display import plots
from ...display.drawing import to_svg
from ...errors import FlexMapsError
from ...materials import Material
from ...params import Settings, with_values
from ...runs import job, manual_changes
from ...runs.outputs import FinalLayout, Surface, UserInput
from ...runs.result import Result
from ...surface.mesh import PolygonMesh, QuadMesh
from ...workers import Workers
from ..choosing import choose
from ..choosing.choice import make_proposal
from ..choosing.judge import FlatLayout, JudgedLayout, LayoutProblem, judge
from .space import SIZES, Values

DECIMALS = 9  # decimals to which measures are rounded, so that rounding errors of flat pieces become 0
# duration of a candidate's search, as a share of the optimiser's patience; larger: better designs, slower
EFFORT = 0.15
PICTURE_WIDTH = 220.0  # width of a candidate's picture, pixels


@dataclass(frozen=True, eq=False)
class StartSurface:
    """Quad mesh from which candidates are made, and its layout.

    cut : (E,) whether an edge is cut; unused if settings of the layout are varied
    """

    mesh: QuadMesh
    cut: Bool[np.ndarray, " edges"]


@dataclass(frozen=True, eq=False)
class ExplorationInput:
    """Inputs that all candidates share.

    starts : surfaces by the requested number of quads; under the key 0 if that number is not varied
    settings : settings of the piece, before variables are changed
    supports : indices of supported quads, or None; force : (F, 3) force on every quad, newtons, or None
    effort : duration of a candidate's search, as a share of the optimiser's patience
    """

    starts: Mapping[int, StartSurface]
    settings: Settings
    supports: Int[np.ndarray, " held"] | None = None
    force: Float[np.ndarray, "quads 3"] | None = None
    effort: float = EFFORT


@dataclass(frozen=True)
class Candidate:
    """A variant of a piece and its result.

    values : values of the variables, in the units shown to users
    measures : values by the names of ``space.MEASURES``; empty if the candidate failed
    advice : sentence on what limits the match; fault : why the candidate failed, else ""
    picture : the surface with its panels, as SVG
    """

    values: Values
    measures: dict[str, float] = field(default_factory=dict)
    advice: str = ""
    fault: str = ""
    picture: str = ""

    def row(self) -> dict[str, Any]:
        """Return the candidate as a row of a table, without its picture."""
        return {**self.values, **self.measures, "advice": self.advice, "fault": self.fault}


def evaluate_candidate(base: ExplorationInput, values: Values) -> Candidate:
    """Make and measure a candidate; a FlexMapsError is recorded as ``Candidate.fault``, other errors propagate.

    Parameters
    ----------
    base : inputs that all candidates share
    values : values of the variables, in the units shown to users
    """
    try:
        settings = with_values(base.settings, {name: value for name, value in values.items() if name not in SIZES})
        start = base.starts[values.get("quads", 0)]
        mesh = _scale_mesh(start.mesh, values)
        laid = _flatten_candidate(base, start, mesh, settings, values)
        piece = LayoutProblem(mesh, settings, base.supports, base.force)
        judged = judge(piece, laid, base.effort, thorough=True)
        if judged is None:
            return Candidate(values, fault="No equilibrium of its panels was found")
        return Candidate(
            values, _measure(judged, settings, settings.material.chosen), judged.advice, "", _draw_panels(laid)
        )
    except FlexMapsError as error:
        return Candidate(values, fault=str(error))


def _scale_mesh(mesh: QuadMesh, values: Values) -> QuadMesh:
    """Return the mesh scaled to the median edge or the height, millimetres, in ``values``; unchanged without either."""
    if "edge" in values:
        return mesh.with_vertices(mesh.vertices * (values["edge"] / 1e3 / mesh.median_edge))
    if "height" in values:
        tall = float(np.ptp(mesh.vertices[:, 2]))
        if tall <= 0.0:
            raise FlexMapsError("The piece lies flat and has no height; vary edge instead")
        return mesh.with_vertices(mesh.vertices * (values["height"] / 1e3 / tall))
    return mesh


def _flatten_candidate(
    base: ExplorationInput, start: StartSurface, mesh: QuadMesh, settings: Settings, values: Values
) -> FlatLayout:
    """Return the flat patches of a candidate, in the layout of ``start`` unless the layout is varied."""
    surface = Surface(PolygonMesh.from_quads(mesh), [], mesh)
    result = Result(surface, UserInput(supports=base.supports, force=base.force))
    if any(name.startswith("layout.") for name in values):
        result = job.run_stages(result, settings, ("trace", "merge", "split"))
    else:
        result = job.run_stages(manual_changes.flatten_by_hand(result, start.cut, settings), settings, ("split",))
    flat = result.need(FinalLayout).flat
    if any(name.startswith("choose.") for name in values):
        piece = LayoutProblem(mesh, settings, base.supports, base.force)
        flat = choose.choose(piece, flat, settings.choose, together=Workers(1)).best.flat
    return FlatLayout(flat, "", 1)


def _measure(judged: JudgedLayout, settings: Settings, material: Material) -> dict[str, float]:
    """Return the measures of a candidate by name, with four significant digits; infinite values are left out."""
    made, mesh = make_proposal(judged, settings, material), judged.laid.flat.layout.mesh
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
    return {name: float(f"{round(value, DECIMALS):.4g}") for name, value in found.items() if math.isfinite(value)}


def _draw_panels(laid: FlatLayout) -> str:
    """Draw the surface in the colours of its panels, as SVG."""
    layout = laid.flat.layout
    sides = layout.cut[layout.mesh.quad_edges]
    return to_svg(plots.draw_thumbnail(layout.mesh.vertices, layout.mesh.quads, sides, layout.patch_of, PICTURE_WIDTH))


def failed_candidate(values: Values, error: Exception) -> Candidate:
    """Return a candidate that failed because of an error of the program, or because its process ended.

    Parameters
    ----------
    values : values of the variables
    error : the exception
    """
    what = (
        str(error) if isinstance(error, FlexMapsError) else f"A fault of the program, {type(error).__name__}: {error}"
    )
    return Candidate(values, fault=" ".join(what.split()))
