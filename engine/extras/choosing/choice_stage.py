"""The stage that compares layouts: its function, its output, its plot, and taking another proposal."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from ...display import plots
from ...display.drawing import Drawing
from ...display.run_plots import MapValues
from ...errors import FlexMapsError
from ...params import Settings
from ...patches.flattening.flatten import FlatPatches
from ...progress import Progress
from ...runs.outputs import DesignVersion, FinalLayout, SimulatedShape, StageOutput, made_by
from ...runs.result import Result
from ...runs.stage import values_of
from ...runs.stages import CHOSEN, OPTIMISED, STAGES
from ...simulation.simulate import Simulation
from ...surface.symmetry import symmetries
from ...workers import Workers
from . import choose
from .choice import Choice
from .judge import LayoutProblem

PLOTS = ("choices",)


@dataclass(frozen=True, eq=False)
class LayoutChoice(StageOutput):
    """The proposed layouts, and the number of the present one."""

    name = "choice"
    choice: Choice


def run(result: Result, layout: FinalLayout, settings: Settings, progress: Progress) -> Result:
    """Compare many layouts by the shape that their panels take, and take the best.

    Parameters
    ----------
    result : the piece
    layout : its present layout
    settings : of all stages
    progress : reports and cancels

    Raises
    ------
    FlexMapsError : no layout can be compared
    """
    found = symmetries(result.mesh, progress=progress.part(0.0, 0.02)) if settings.layout.symmetric else []
    # layouts near the present one start from its spirals; all others start from those of a long search
    start = layout.start if settings.choose.near else None
    piece = LayoutProblem(result.mesh, settings, result.supports, result.force, tuple(found), start)
    flat = layout.flat if result.design is None else result.design.flat
    with Workers() as together:
        made = choose.choose(piece, flat, settings.choose, progress.part(0.02, 1.0), together, _reached(result))
    return take(result, made, settings, flat)


def _reached(result: Result) -> Simulation | None:
    """Return the simulation of optimised spirals, if it has an equilibrium."""
    version, shape = result.get(DesignVersion), result.get(SimulatedShape)
    if version is None or shape is None or version.origin != OPTIMISED:
        return None
    return shape.simulation if shape.simulation.equilibrium.converged else None


def take(result: Result, choice: Choice, settings: Settings, present: FlatPatches | None = None) -> Result:
    """Return the result with the layout that a choice names, unless that is the present one.

    Parameters
    ----------
    result : the piece
    choice : the proposals
    settings : that they were compared with
    present : the patches of the piece as they are now
    """
    layout, best = result.need(FinalLayout), choice.best
    if best.flat is not present:
        made = {"inputs": result.inputs("mesh"), "settings": values_of(STAGES["merge"].settings, settings)}
        layout = FinalLayout(best.flat, CHOSEN, best.judged.spirals, **made)
    made = made_by("choose", settings, {"flat": layout.flat})
    return result.with_outputs(layout, LayoutChoice(choice, **made))


def take_proposal(result: Result, number: int, settings: Settings) -> Result:
    """Change to the layout of another proposal; outputs made from the former layout are dropped.

    Parameters
    ----------
    result : a piece for which layouts were proposed
    number : index of the proposal, from 0
    settings : of all stages

    Raises
    ------
    FlexMapsError : there are no proposals, or none with this number
    """
    choice = result.need(LayoutChoice).choice
    if not 0 <= number < len(choice.proposals):
        raise FlexMapsError(f"There is no proposal {number}; they are numbered from 0 to {len(choice.proposals) - 1}")
    return take(result, replace(choice, taken=number), settings)


def drawings(shown: MapValues, described: Mapping[str, Any]) -> dict[str, Drawing]:
    """Return the plot of the layouts compared.

    Parameters
    ----------
    shown : values per quad
    described : the report
    """
    block = described.get("choose")
    if not block:
        return {}
    names = ["1 panel" if one["panels"] == 1 else f"{one['panels']} panels" for one in block["proposals"]]
    rows = [(one["joints"], one["rms_percent"], name) for one, name in zip(block["proposals"], names, strict=True)]
    return {"choices": plots.front(rows, block["taken"])}


def notes(described: Mapping[str, Any]) -> list[tuple[bool, str]]:
    """Return no notes for the top of the report's page; its section tells how the choice ended."""
    return []
