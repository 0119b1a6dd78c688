"""Inputs and outputs of the stages; each output holds what it was made from.

An output is never changed; a stage that does better than an earlier one makes an output of its own.
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
from ..optimisation.optimise import Optimisation
from ..optimisation.reach import MatchLimits
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
    findings : errors and warnings of the check
    mesh : the quad mesh
    edge, height : requested median edge and extent along z, metres, which regularising preserves
    regularised : whether that stage has run
    """

    source: PolygonMesh
    findings: list[Finding]
    mesh: QuadMesh
    edge: float | None = None
    height: float | None = None
    regularised: bool = False


@dataclass(frozen=True)
class UserInput:
    """Data that the user sets on single quads or loads from files; None if there are none of a kind.

    supports : quads that are held at their places in the target
    force : newtons on each quad
    wishes : target positions for some spirals in the optimisation
    groups : quads by name, for loads that act on a part of the piece
    protected : quads whose spirals the optimiser must not change
    scanned : a scan of the built piece, a ``Scan`` of the extra that compares with it
    rest : pose at equilibrium for the comparison with the scan, if the simulation itself is not kept
    """

    supports: Int[np.ndarray, " held"] | None = None
    force: Float[np.ndarray, "quads 3"] | None = None
    wishes: Wishes | None = None
    groups: dict[str, Int[np.ndarray, " some"]] = field(default_factory=dict)
    protected: Int[np.ndarray, " kept"] | None = None
    scanned: object = None
    rest: Pose | None = None


NOTHING = UserInput()


# -- outputs of the stages ---------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False, kw_only=True)
class StageOutput:
    """Base of the outputs; ``name`` is that of their main value in ``Stage.needs`` and ``Stage.makes``.

    inputs : the values that it was made from, by their names
    settings : the settings that it was made with, by their entries in ``Stage.settings``
    """

    name: ClassVar[str] = ""
    inputs: Mapping[str, object] = field(default_factory=dict)
    settings: Mapping[str, object] = field(default_factory=dict)

    def differs(self, settings: Settings) -> bool:
        """Return whether some of the settings that it was made with have changed."""
        return values_of(self.settings, settings) != self.settings

    def map_values(self) -> dict[str, np.ndarray]:
        """Return values of an extra's output for ``MapValues.more``: an array over the quads each."""
        return {}


@dataclass(frozen=True, eq=False)
class TracedLayout(StageOutput):
    """The traced patches, or those between the user's seams."""

    name = "layout"
    layout: PatchLayout


@dataclass(frozen=True, eq=False)
class MergedLayout(StageOutput):
    """Flat patches after merging or flattening, before any is cut to the sheet's size; ``origin`` : ``TRACED`` or ``BY_HAND``."""

    name = "merged"
    merged: FlatPatches
    origin: str = TRACED


@dataclass(frozen=True, eq=False)
class FinalLayout(StageOutput):
    """The flat patches that become panels.

    origin : ``TRACED``, ``BY_HAND``, ``CHOSEN`` or ``STORED``
    start : widths (F, 4) metres and twists (F,) radians that a search found for these patches; None if there was none
    """

    name = "flat"
    flat: FlatPatches
    origin: str
    start: tuple[Float[np.ndarray, "quads 4"], Float[np.ndarray, " quads"]] | None = None


@dataclass(frozen=True, eq=False)
class DesignVersion(StageOutput):
    """The spirals; ``origin`` : ``CURVED``, ``CHOSEN``, ``OPTIMISED``, ``BY_HAND`` or ``STORED``."""

    name = "design"
    design: SpiralDesign
    origin: str


@dataclass(frozen=True, eq=False)
class OptimisationRecord(StageOutput):
    """History and outcome of the optimisation that the present spirals came from."""

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


def made_by(stage: str, settings: Settings, inputs: Mapping[str, object]) -> dict[str, Any]:
    """Return the members of ``StageOutput`` for an output that a stage made.

    Parameters
    ----------
    stage : name of the stage
    settings : of the run
    inputs : the values that it was made from
    """
    return {"inputs": inputs, "settings": values_of(STAGES[stage].settings, settings)}
