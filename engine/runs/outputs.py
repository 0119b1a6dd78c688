"""Inputs and outputs of the stages; each output records the inputs and settings that it was made from.

An output is never changed in place; a stage that improves on an earlier output makes a new one.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np

from ..arrays import Float, Int
from ..fabrication.assembly_check import AssemblyCheck
from ..fabrication.estimates import Estimates
from ..fabrication.sheets import CutSheets
from ..mechanics.assembly import Pose
from ..optimisation.match_limits import MatchLimits
from ..optimisation.optimise import Optimisation
from ..optimisation.wishes import Wishes
from ..params import Settings
from ..patches.flattening.flatten import FlatPatches
from ..patches.layout import PatchLayout
from ..simulation.simulate import Simulation
from ..spirals.design import SpiralDesign
from ..surface.checking.check import Finding
from ..surface.mesh import PolygonMesh, QuadMesh
from .stage import values_of
from .stages import STAGES, TRACED


@dataclass(frozen=True)
class Surface:
    """The surface to make.

    source : the input polygons, scaled to metres
    findings : errors and warnings from checking the mesh
    mesh : the quad mesh
    edge, height : requested median edge length and extent along z, metres, which the stage "regularise" restores
    regularised : whether the stage "regularise" has run
    """

    source: PolygonMesh
    findings: list[Finding]
    mesh: QuadMesh
    edge: float | None = None
    height: float | None = None
    regularised: bool = False


@dataclass(frozen=True)
class UserInput:
    """Data that the user sets on single quads or loads from files; None if not set.

    supports : indices of quads that are held at their positions in the target
    force : force on each quad, newtons
    wishes : target positions that the user sets for some spirals
    groups : indices of quads by the name of their vertex group, for loads that act on a part of the piece
    protected : indices of quads whose spirals the optimiser must not change
    scanned : scan of the built piece, a ``Scan`` of the extra ``scanning``
    rest : pose at equilibrium to compare with the scan, if the simulation itself is not stored
    """

    supports: Int[np.ndarray, " held"] | None = None
    force: Float[np.ndarray, "quads 3"] | None = None
    wishes: Wishes | None = None
    groups: dict[str, Int[np.ndarray, " some"]] = field(default_factory=dict)
    protected: Int[np.ndarray, " kept"] | None = None
    scanned: object = None
    rest: Pose | None = None


NO_USER_INPUT = UserInput()


# -- outputs of the stages ---------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False, kw_only=True)
class StageOutput:
    """Base class of the outputs.

    name : name of the output's main value, as in ``Stage.needs`` and ``Stage.makes``
    inputs : values that the output was made from, by name
    settings : values of the settings that the output was made with, by entry of ``Stage.settings``
    """

    name: ClassVar[str] = ""
    inputs: Mapping[str, object] = field(default_factory=dict)
    settings: Mapping[str, object] = field(default_factory=dict)

    def differs(self, settings: Settings) -> bool:
        """Return whether a setting differs from the value that this output was made with."""
        return values_of(self.settings, settings) != self.settings

    def map_values(self) -> dict[str, np.ndarray]:
        """Return an extra's values per quad, for ``MapValues.more``: arrays over the quads, by name."""
        return {}


@dataclass(frozen=True, eq=False)
class TracedLayout(StageOutput):
    """Patches from tracing, or patches between seams that the user marked."""

    name = "layout"
    layout: PatchLayout


@dataclass(frozen=True, eq=False)
class MergedLayout(StageOutput):
    """Flat patches after merging or flattening, before those larger than the sheet are split.

    origin : ``TRACED`` or ``BY_HAND``
    """

    name = "merged"
    merged: FlatPatches
    origin: str = TRACED


@dataclass(frozen=True, eq=False)
class FinalLayout(StageOutput):
    """The flat patches that become panels.

    origin : ``TRACED``, ``BY_HAND``, ``CHOSEN`` or ``STORED``
    start : widths (F, 4), metres, and twists (F,), radians, from a search on these patches; None without a search
    """

    name = "flat"
    flat: FlatPatches
    origin: str
    start: tuple[Float[np.ndarray, "quads 4"], Float[np.ndarray, " quads"]] | None = None


@dataclass(frozen=True, eq=False)
class DesignVersion(StageOutput):
    """The spirals.

    origin : how they were made: ``CURVED`` (adjusted to the curvature), ``CHOSEN`` (from a search for a layout),
        ``OPTIMISED``, ``BY_HAND``, or ``STORED`` (read from a .blend file that does not say)
    """

    name = "design"
    design: SpiralDesign
    origin: str


@dataclass(frozen=True, eq=False)
class OptimisationRecord(StageOutput):
    """History and outcome of the optimisation that made the present spirals."""

    name = "optimisation"
    optimisation: Optimisation


@dataclass(frozen=True, eq=False)
class SimulatedShape(StageOutput):
    """Shape of the assembled piece at equilibrium, and why it misses the target; ``limits`` is None after a cancel."""

    name = "simulation"
    simulation: Simulation
    limits: MatchLimits | None = None


@dataclass(frozen=True, eq=False)
class SheetPlan(StageOutput):
    """The sheets to cut."""

    name = "sheets"
    sheets: CutSheets


@dataclass(frozen=True, eq=False)
class MakingEstimate(StageOutput):
    """Time, mass and cost of making the piece, and how hard each seam is to join."""

    name = "estimates"
    estimates: Estimates
    assembly: AssemblyCheck


LAYOUTS = (TracedLayout.name, MergedLayout.name, FinalLayout.name)
OUTPUTS: dict[str, type[StageOutput]] = {kind.name: kind for kind in StageOutput.__subclasses__()}


def provenance(stage: str, settings: Settings, inputs: Mapping[str, object]) -> dict[str, Any]:
    """Return the arguments ``inputs`` and ``settings`` for an output of a stage.

    Parameters
    ----------
    stage : name of the stage
    settings : all settings of the run
    inputs : values that the output was made from, by name
    """
    return {"inputs": inputs, "settings": values_of(STAGES[stage].settings, settings)}
