"""What a piece is made of so far: the members that the stages fill in."""

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
from ..optimisation.reach import Reach
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
    """What the stages that ran have made; ``None`` where a stage has not run.

    source : the mesh as it came in, scaled to metres
    findings : what the check found, warnings included
    mesh : the quad mesh, regularised if that stage ran
    edge, height : the size that was asked for, metres, which regularising keeps
    supports : quads that are held where they lie in the target; force : newtons on the quads
    wishes : places where some spirals shall come to when it is optimised
    groups : quads by the names that loads may use beside numbers
    seams : where somebody wants the surface to be cut; tracing then begins there
    rest : the pose of a simulation that is not kept itself
    protected : quads whose spirals the optimiser leaves exactly as they are
    layout : the patches as they were traced; flat : the flat patches, of the last layout: merged, cut to the sheet's size
    choice : the layouts that were compared, if that was asked for, and which of them flat is
    start : flat patches, and the widths (F, 4) metres and twists (F,) radians that were found while they were chosen, where ``choice``
        is not kept
    reached : the optimised spirals in the layout flat, simulated, where ``optimisation`` is not kept
    design : the spirals, optimised if that stage ran; optimisation : how they became so
    simulation : the shape that the assembled object takes; limits : what keeps it from the target
    scanned : a scan of the built piece to compare with; scan : it laid over the simulated shape, or the target
    structure : what the piece bears, if that was asked for
    sheets : the sheets to cut; estimates : what making them takes; assembly : how hard every seam is to join
    lost : why a member that was there once cannot be used, by its name; reported instead of "there is none yet"
    undone : stages that were asked for and could not be done, with the reason; a later success takes them out again
    seconds : wall time of every stage that ran
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
    limits: Reach | None = None
    scanned: Scan | None = None
    scan: Comparison | None = None
    structure: Structure | None = None
    sheets: CutSheets | None = None
    estimates: Estimates | None = None
    assembly: AssemblyCheck | None = None
    lost: dict[str, FlexMapsError] = field(default_factory=dict)
    undone: dict[str, Finding] = field(default_factory=dict)
    seconds: dict[str, float] = field(default_factory=dict)
