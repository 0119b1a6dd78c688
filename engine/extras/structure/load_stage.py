"""Stage that checks loads: its run function, output and plots."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ... import colours
from ...display import plots
from ...display.drawing import Drawing
from ...display.plots import Colouring
from ...display.run_plots import MapValues
from ...errors import FlexMapsError
from ...fabrication.connectors.connect import Connections, connect
from ...params import Settings
from ...progress import Progress
from ...runs.outputs import SimulatedShape, StageOutput, provenance
from ...runs.result import Result
from ...spirals.design import SpiralDesign
from . import analysis, cases, load_plots
from .analysis import StructuralAnalysis
from .structure_params import StructureParams

PLOTS = ("loads", "utilisation")


@dataclass(frozen=True, eq=False)
class LoadAnalysis(StageOutput):
    """Output of the stage: the response of the piece to its loads."""

    name = "structure"
    structure: StructuralAnalysis

    def map_values(self) -> dict[str, np.ndarray]:
        """Return the values per quad to plot, by name: the largest utilisation of the quad's arms over all loads."""
        used = self.structure.utilisation
        return {} if used is None else {"utilisation": used}


def run(result: Result, shape: SimulatedShape, settings: Settings, progress: Progress) -> Result:
    """Analyse the simulated shape under the load cases.

    Parameters
    ----------
    result : results of the piece so far; ``user.groups`` has the quads of every vertex group that a load may name
    shape : the simulated shape
    settings : settings of all stages
    progress : called with the fraction done; may cancel

    Raises
    ------
    FlexMapsError : a load case cannot be read
    """
    wanted = settings.section(StructureParams)
    plan = cases.parse_plan(wanted.cases, wanted.combinations)
    found = analysis.analyse(
        shape.simulation,
        plan,
        wanted,
        settings.simulate,
        connections=_make_connections(shape.simulation.design, settings, progress.part(0.0, 0.2)),
        groups=result.user.groups,
        progress=progress.part(0.2, 1.0),
    )
    return result.with_outputs(LoadAnalysis(found, **provenance("structure", settings, result.inputs("simulation"))))


def _make_connections(design: SpiralDesign, settings: Settings, progress: Progress) -> Connections | None:
    """Return the connectors of a design; None if they cannot be cut."""
    try:
        return connect(design, settings.connect, settings.sheet.tolerance, progress, settings.cut.mill)
    except FlexMapsError:
        return None


def drawings(shown: MapValues, described: Mapping[str, Any]) -> dict[str, Drawing]:
    """Return the plots of the load analysis by name; empty if there was none.

    Parameters
    ----------
    shown : values per quad
    described : the whole report
    """
    block, used = described.get("structure"), shown.more.get("utilisation")
    if not block:
        return {}
    found = {"loads": load_plots.plot_load_paths(block)}
    if used is not None and shown.shape is not None and shown.sides is not None:
        high = max(100.0, 100.0 * float(used.max()))
        title = "Utilisation: the most that arms carry under any load"
        fills = Colouring.from_values(title, 100.0 * used, "% of limit", colours.ERROR_SCALE, 0.0, high)
        found["utilisation"] = plots.draw_shape_map(shown.shape, shown.mesh.quads, shown.sides, fills)
    return found


def notes(described: Mapping[str, Any]) -> list[tuple[bool, str]]:
    """Return the notes for the top of the report as (is a warning, text)."""
    return [(True, finding["message"]) for finding in described["structure"].get("findings", ())]
