"""The grain of every panel for itself: how panels are turned on the sheet so that the piece comes nearer to its target.

A panel's grain is a direction in its flat frame, the same in all (``SpiralParams.grain``); so a panel gets another one by being turned
in its frame, and whatever lays frames along the grain keeps it. What a turn changes are the compliances of the panel's own arms. From
an equilibrium with forces g = 0 and Hessian H, other arms leave forces dg at the same pose, and one Newton step -H^-1 dg tells where the
hubs go. All panels' steps are added, and the turns chosen that bring the sum nearest to the target, panel by panel; the equilibrium
then tells whether it did.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ..arrays import Float, Int
from ..materials import Material
from ..mechanics.arms.compliances import ArmCompliances, arm_compliances
from ..mechanics.arms.model import ArmModel
from ..mechanics.assembly import Pose
from ..mechanics.elastic import summed
from ..mechanics.newton_system import NewtonSystem
from ..params import SheetParams, SimulateParams
from ..patches.flattening.flatten import FlatPatches
from ..progress import SILENT, Progress
from ..simulation.simulate import Simulation, simulate
from ..spirals.design import SpiralDesign
from ..surface.mesh import QuadMesh

# radians that panels may be turned; a sheet with a grain is the same after half a turn
TURNS = {"crossed": (0.5 * np.pi,), "free": tuple(np.radians(np.arange(15.0, 180.0, 15.0)).tolist())}
ROUNDS = 3  # how often panels are turned anew from the equilibrium that was found; it ends where nothing gets nearer. Not measured
SWEEPS = 6  # over all panels, or until none changes; not measured
WORTH = 1e-3  # share of the mismatch that a turn has to bring to be taken; by eye


@dataclass(frozen=True, eq=False)
class PanelGrain:
    """turns : radians that every panel was turned; before, after : metres RMS from the target, with one grain for all and with these"""

    design: SpiralDesign
    turns: Float[np.ndarray, " patches"]
    before: float
    after: float


def turned(flat: FlatPatches, turns: Float[np.ndarray, " patches"]) -> FlatPatches:
    """The same patches, every one turned by radians in its frame."""
    points = flat.points.copy()
    for quads, turn in zip(flat.layout.patches, turns, strict=True):
        own = np.unique(flat.layout.flat_corners[quads])
        cos, sin = np.cos(turn), np.sin(turn)
        points[own] = points[own] @ np.array([[cos, sin], [-sin, cos]])
    return replace(flat, points=points)


def allowed(flat: FlatPatches, turn: float, grain: float, sheet: SheetParams) -> np.ndarray:
    """(patches,) bool: which panels still fit the sheet when they are turned, of those that fit as they are; nothing else is laid worse."""
    free = np.array([sheet.sheet_width, sheet.sheet_height]) - 2.0 * sheet.margin
    fits = []
    for angle in (-grain, turn - grain):
        cos, sin = np.cos(angle), np.sin(angle)
        points = flat.points @ np.array([[cos, sin], [-sin, cos]])
        sizes = [np.ptp(points[np.unique(flat.layout.flat_corners[quads])], axis=0) for quads in flat.layout.patches]
        fits.append((np.array(sizes) <= free + 1e-9).all(axis=1))
    return fits[1] | ~fits[0]


def choose_grain(
    design: SpiralDesign,
    target: QuadMesh,
    material: Material,
    kind: str,
    physics: SimulateParams,
    sheet: SheetParams,
    *,
    supports: Int[np.ndarray, " some"] | None = None,
    force: Float[np.ndarray, "quads 3"] | None = None,
    progress: Progress = SILENT,
) -> PanelGrain:
    """The design with its panels turned to where the equilibrium is nearest to the target; never farther than the given one.

    kind : one of ``TURNS``; other arguments as in ``simulate``
    """
    count = len(design.flat.layout.patches)
    once = replace(physics, restarts=0)

    def rested(one: SpiralDesign, start: Pose | None, share: float) -> Simulation:
        within = progress.part(share, share + 0.2)
        return simulate(
            one, target, material, once, supports=supports, force=force, start=start, quick=True, progress=within
        )

    best, turns = rested(design, None, 0.0), np.zeros(count)
    first = _rms(best)
    if material.orthotropy is None or not isinstance(best.model, ArmModel) or not best.equilibrium.converged:
        return PanelGrain(design, turns, first, first)
    for n in range(ROUNDS):
        progress(0.2 + 0.25 * n, "The grain of every panel")
        here = best.design
        angles = np.array([0.0, *TURNS[kind]])
        able = _able(design, turns, angles, sheet)
        chosen = angles[_nearest(best, angles, able, progress.part(0.2 + 0.25 * n, 0.3 + 0.25 * n))]
        found = _better(here, best, chosen, lambda one, start, n=n: rested(one, start, 0.3 + 0.25 * n))  # type: ignore[misc]
        if found is None:
            break
        best, more = found
        turns = (turns + more) % np.pi
    return PanelGrain(best.design, turns, first, _rms(best))


def _able(design: SpiralDesign, turns: np.ndarray, angles: np.ndarray, sheet: SheetParams) -> np.ndarray:
    """(angles, patches) bool: what panels may be turned further by; ``turns`` is what they are turned by already."""
    rows = [[allowed(design.flat, float(t + a), design.params.grain, sheet) for t in np.unique(turns)] for a in angles]
    which = np.searchsorted(np.unique(turns), turns)
    return np.array([[row[which[p]][p] for p in range(len(turns))] for row in rows])


def _better(
    design: SpiralDesign,
    best: Simulation,
    chosen: Float[np.ndarray, " patches"],
    rested: Callable[[SpiralDesign, Pose], Simulation],
) -> tuple[Simulation, np.ndarray] | None:
    """The simulation with the panels turned so, or half of them where all together are no better; None where neither is."""
    moving = np.flatnonzero(chosen)
    for some in (moving, moving[::2], moving[1::2]):
        turns = np.zeros(len(chosen))
        turns[some] = chosen[some]
        if not turns.any():
            continue
        again = replace(design, flat=turned(design.flat, turns))
        found = rested(again, _carried(best.equilibrium.pose, design, turns))
        if found.equilibrium.converged and _rms(found) < (1.0 - WORTH) * _rms(best):
            return found, turns
    return None


def _rms(found: Simulation) -> float:
    return float(np.sqrt((found.distance**2).mean())) if found.equilibrium.converged else np.inf


def _carried(pose: Pose, design: SpiralDesign, turns: np.ndarray) -> Pose:
    """The same pose of hubs whose frames are turned."""
    turn = turns[design.flat.layout.patch_of]
    back = np.zeros((len(turn), 3, 3))
    back[:, 0, 0] = back[:, 1, 1] = np.cos(turn)
    back[:, 0, 1], back[:, 1, 0], back[:, 2, 2] = np.sin(turn), -np.sin(turn), 1.0
    return Pose(pose.centres, pose.rotations @ back)


def _nearest(
    found: Simulation, angles: Float[np.ndarray, " angles"], able: np.ndarray, progress: Progress
) -> Int[np.ndarray, " patches"]:
    """For every panel the angle, of which the first is none, with which the predicted hubs are nearest to the target."""
    moved = predicted(found, angles, progress)
    count = moved.shape[1]
    chosen = np.zeros(count, dtype=int)
    off = found.equilibrium.pose.centres - found.target.centroids
    free = not found.loads.fixed.any()
    for _ in range(SWEEPS):
        before = chosen.copy()
        for p in range(count):
            rest = off - moved[chosen[p], p]
            tried = rest + moved[:, p]
            if free:
                tried = tried - tried.mean(axis=1, keepdims=True)
            miss = (tried**2).sum(axis=(1, 2))
            miss[~able[:, p]] = np.inf
            best = int(np.argmin(miss))
            best = best if miss[best] < (1.0 - WORTH) * miss[chosen[p]] else int(chosen[p])
            off, chosen[p] = rest + moved[best, p], best
        if (chosen == before).all():
            break
    return chosen


def predicted(
    found: Simulation, angles: Float[np.ndarray, " angles"], progress: Progress = SILENT
) -> Float[np.ndarray, "angles patches quads 3"]:
    """Metres that one Newton step moves every hub when one panel is turned by an angle; those of the first, which is none, are 0."""
    model, pose, pairs = found.model, found.equilibrium.pose, found.assembly.pairs
    assert isinstance(model, ArmModel)
    patch = found.design.flat.layout.patch_of[pairs]
    count = len(found.design.flat.layout.patches)
    state = model.start(pose)
    system = NewtonSystem(pairs, found.loads.held(pairs, pose.centres))
    out = np.zeros((len(angles), count, found.assembly.size, 3))
    if not system.factor(system.values(model.expand(state).hessian)):
        return out
    plain = model.compliance
    for k, angle in enumerate(angles.tolist()):
        progress(k / len(angles), "The grain of every panel")
        if k == 0:
            continue
        # turning a panel by an angle turns the grain back by it in the panel's frame
        turned = replace(found.assembly, grain=found.assembly.grain - angle)
        other = arm_compliances(turned, found.material, slopes=False)
        base = model.joint_gradients(state)
        sides = []
        for which in ((True, True), (True, False), (False, True)):
            mixed = model.with_compliance(_mixed(plain, other, which))
            sides.append(mixed.joint_gradients(mixed.start(pose)) - base)
        for p in range(count):
            own = patch == p
            change = np.zeros_like(base)
            for which, blocks in zip(((True, True), (True, False), (False, True)), sides, strict=True):
                rows = (own == which).all(axis=1)
                change[rows] = blocks[rows]
            out[k, p] = system.solve(-summed(change, pairs, found.assembly.size))[:, :3]
    return out


def _mixed(plain: ArmCompliances, other: ArmCompliances, which: tuple[bool, bool]) -> ArmCompliances:
    """The compliances of one or both sides of all joints from another model."""
    values = plain.values.copy()
    for side in (0, 1):
        if which[side]:
            values[:, side] = other.values[:, side]
    return replace(plain, values=values)
