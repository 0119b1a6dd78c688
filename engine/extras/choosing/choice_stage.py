"""Stage that compares layouts: its run function, output and plot, and the change to another proposal."""

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
from ...runs.outputs import DesignVersion, FinalLayout, SimulatedShape, StageOutput, provenance
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
    """Output of the stage: the proposed layouts, and which of them is chosen."""

    name = "choice"
    choice: Choice


def run(result: Result, layout: FinalLayout, settings: Settings, progress: Progress) -> Result:
    """Compare many layouts by the shape that their panels take, and change to the best.

    Parameters
    ----------
    result : results of the piece so far
    layout : present layout of the piece
    settings : settings of all stages
    progress : called with the fraction done; may cancel

    Raises
    ------
    FlexMapsError : no layout has an equilibrium
    """
    found = symmetries(result.mesh, progress=progress.part(0.0, 0.02)) if settings.layout.symmetric else []
    # small changes of the present layout start from its spirals; other layouts start from those of a long search
    start = layout.start if settings.choose.near else None
    piece = LayoutProblem(result.mesh, settings, result.supports, result.force, tuple(found), start)
    flat = layout.flat if result.design is None else result.design.flat
    with Workers() as together:
        made = choose.choose(
            piece, flat, settings.choose, progress.part(0.02, 1.0), together, _optimised_simulation(result)
        )
    return apply_choice(result, made, settings, flat)


def _optimised_simulation(result: Result) -> Simulation | None:
    """Return the simulation of the present layout if its spirals are optimised and it converged; else return None."""
    version, shape = result.get(DesignVersion), result.get(SimulatedShape)
    if version is None or shape is None or version.origin != OPTIMISED:
        return None
    return shape.simulation if shape.simulation.equilibrium.converged else None


def apply_choice(result: Result, choice: Choice, settings: Settings, present: FlatPatches | None = None) -> Result:
    """Return the results with a choice stored, and with the chosen layout in place of the present one.

    Parameters
    ----------
    result : results of the piece so far
    choice : the proposals, and which of them is chosen
    settings : settings with which they were compared
    present : flat patches of the present layout, which stays if it is the chosen one; default: replace it always
    """
    layout, best = result.need(FinalLayout), choice.best
    if best.flat is not present:
        made = {"inputs": result.inputs("mesh"), "settings": values_of(STAGES["merge"].settings, settings)}
        layout = FinalLayout(best.flat, CHOSEN, best.judged.spirals, **made)
    made = provenance("choose", settings, {"flat": layout.flat})
    return result.with_outputs(layout, LayoutChoice(choice, **made))


def take_proposal(result: Result, number: int, settings: Settings) -> Result:
    """Change to the layout of another proposal; outputs made from the former layout are dropped.

    Parameters
    ----------
    result : results of a piece for which layouts were compared
    number : index of the proposal, from 0
    settings : settings of all stages

    Raises
    ------
    FlexMapsError : there are no proposals, or none has this number
    """
    choice = result.need(LayoutChoice).choice
    if not 0 <= number < len(choice.proposals):
        raise FlexMapsError(f"There is no proposal {number}; they are numbered from 0 to {len(choice.proposals) - 1}")
    return apply_choice(result, replace(choice, taken=number), settings)


def drawings(shown: MapValues, described: Mapping[str, Any]) -> dict[str, Drawing]:
    """Return the plot of the compared layouts, number of joints against RMS distance; empty if none were compared.

    Parameters
    ----------
    shown : values per quad, unused here
    described : the whole content of report.json
    """
    block = described.get("choose")
    if not block:
        return {}
    names = ["1 panel" if one["panels"] == 1 else f"{one['panels']} panels" for one in block["proposals"]]
    rows = [(one["joints"], one["rms_percent"], name) for one, name in zip(block["proposals"], names, strict=True)]
    return {"choices": plots.plot_proposals(rows, block["taken"])}


def notes(described: Mapping[str, Any]) -> list[tuple[bool, str]]:
    """Return an empty list: this stage has its own section in the report and adds no notes to the top."""
    return []
