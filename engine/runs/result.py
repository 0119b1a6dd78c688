"""The result of a run: the products of all stages so far."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ..arrays import Bool, Float, Int
from ..assembling.check import AssemblyCheck
from ..choosing.choice import Choice
from ..errors import FlexMapsError
from ..fabrication.estimates import Estimates
from ..fabrication.sheets import CutSheets
from ..mechanics.assembly import Pose
from ..optimisation.optimise import Optimisation
from ..optimisation.reach import MatchLimits
from ..optimisation.wishes import Wishes
from ..patches.flattening.flatten import FlatPatches
from ..patches.layout import PatchLayout
from ..scanning.compare import Comparison
from ..scanning.reading import Scan
from ..simulation.simulate import Simulation
from ..spirals.design import SpiralDesign
from ..structure.structure import Structure
from ..surface.checking.check import Finding
from ..surface.mesh import PolygonMesh, QuadMesh


@dataclass(frozen=True)
class Result:
    """Products of the stages; None for stages that have not run.

    source : the input polygons, scaled to metres
    findings : errors and warnings of the check
    mesh : the quad mesh, regularised if that stage has run
    edge, height : requested median edge and extent along z, metres, which regularising preserves
    supports : quads that are held at their places in the target
    force : newtons on each quad
    wishes : target positions for some spirals in the optimisation
    groups : quads by name, for loads that act on a part of the piece
    seams : edges where the user wants cuts; tracing begins there
    rest : pose at equilibrium, if the simulation itself is not kept
    protected : quads whose spirals the optimiser must not change
    layout : the traced patches
    flat : the flat patches of the present layout, merged and split to the sheet's size
    choice : the proposed layouts, and the number of the present one
    start : flat patches with the widths (F, 4) metres and twists (F,) radians that a search found for them; used if ``choice``
        is not kept
    reached : simulation of the optimised spirals in the layout ``flat``; used if ``optimisation`` is not kept
    design : the spirals, optimised if that stage has run
    optimisation : history and outcome of the optimisation
    simulation : shape of the assembled piece at equilibrium
    limits : reasons why the shape misses the target
    scanned : a scan of the built piece
    scan : comparison of the scan with the simulated shape, or with the target if there is no simulation
    structure : response of the piece to its loads
    sheets : the sheets to cut
    estimates : time, mass and cost of making the piece
    assembly : how hard each seam is to join
    lost : why a former product cannot be used any more, by member; its message replaces "there is none yet"
    undone : why a requested stage failed, by stage; removed when the stage succeeds later
    seconds : wall time of every stage that has run
    """

    source: PolygonMesh
    findings: list[Finding]
    mesh: QuadMesh
    edge: float | None = None
    height: float | None = None
    supports: Int[np.ndarray, " held"] | None = None
    force: Float[np.ndarray, "quads 3"] | None = None
    wishes: Wishes | None = None
    groups: dict[str, Int[np.ndarray, " some"]] = field(default_factory=dict)
    seams: Bool[np.ndarray, " edges"] | None = None
    rest: Pose | None = None
    protected: Int[np.ndarray, " kept"] | None = None
    layout: PatchLayout | None = None
    flat: FlatPatches | None = None
    choice: Choice | None = None
    start: tuple[FlatPatches, Float[np.ndarray, "quads 4"], Float[np.ndarray, " quads"]] | None = None
    reached: Simulation | None = None
    design: SpiralDesign | None = None
    optimisation: Optimisation | None = None
    simulation: Simulation | None = None
    limits: MatchLimits | None = None
    scanned: Scan | None = None
    scan: Comparison | None = None
    structure: Structure | None = None
    sheets: CutSheets | None = None
    estimates: Estimates | None = None
    assembly: AssemblyCheck | None = None
    lost: dict[str, FlexMapsError] = field(default_factory=dict)
    undone: dict[str, Finding] = field(default_factory=dict)
    seconds: dict[str, float] = field(default_factory=dict)
