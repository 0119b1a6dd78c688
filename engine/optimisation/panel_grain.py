"""A grain direction for every panel: rotate panels on the sheet so that the piece comes nearer to its target.

The grain is one direction in the flat frames of all panels (``SpiralParams.grain``). A panel gets another grain by being rotated in
its frame; nesting, which aligns frames with the grain, keeps the rotation. It changes the compliances of the panel's own arms only. From
an equilibrium with forces g = 0 and Hessian H, other arms cause forces dg at the same pose, and one Newton step -H^-1 dg predicts the
shifts of the hubs. The shifts of all panels add up. Panel by panel the angle is chosen with which the sum is nearest to the target, and
a new equilibrium confirms or refuses the choice.
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

# candidate rotations of a panel, radians; half a turn leaves the grain unchanged
TURNS = {"crossed": (0.5 * np.pi,), "free": tuple(np.radians(np.arange(15.0, 180.0, 15.0)).tolist())}
MAX_ROUNDS = 3  # largest number of rounds, each from the equilibrium of the last; more take longer and may come nearer. Not measured
MAX_SWEEPS = 6  # largest number of passes over all panels in a round; not measured
MIN_GAIN = 1e-3  # share of the mismatch by which a rotation must lower it to be accepted; chosen by eye


@dataclass(frozen=True, eq=False)
class PanelGrain:
    """A design with rotated panels.

    turns : radians by which every panel is rotated
    before, after : RMS distance from the target, metres, with one grain for all panels and with ``turns``
    """

    design: SpiralDesign
    turns: Float[np.ndarray, " patches"]
    before: float
    after: float


def rotate_panels(flat: FlatPatches, turns: Float[np.ndarray, " patches"]) -> FlatPatches:
    """Rotate every patch in its frame by an angle, radians."""
    points = flat.points.copy()
    for quads, turn in zip(flat.layout.patches, turns, strict=True):
        own = np.unique(flat.layout.flat_corners[quads])
        cos, sin = np.cos(turn), np.sin(turn)
        points[own] = points[own] @ np.array([[cos, sin], [-sin, cos]])
    return replace(flat, points=points)


def fits_sheet(flat: FlatPatches, turn: float, grain: float, sheet: SheetParams) -> np.ndarray:
    """Return a mask of the panels that fit the sheet when rotated; panels that do not fit unrotated count as fitting.

    turn : rotation of all panels, radians; grain : direction of the grain in the frames, radians
    """
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
    """Rotate the panels of a design so that its equilibrium comes nearer to the target; the result is never farther from it.

    Parameters
    ----------
    design, target, material, physics, supports, force : as in ``simulate``
    kind : key of ``TURNS``
    sheet : the size of the sheet, which rotated panels must fit
    progress : reports progress and raises Cancelled

    Returns
    -------
    The design with its rotations; unchanged if the material has no grain, the elastic model is of rods, or there is no equilibrium.
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
    for n in range(MAX_ROUNDS):
        progress(0.2 + 0.25 * n, "The grain of every panel")
        here = best.design
        angles = np.array([0.0, *TURNS[kind]])
        able = _allowed_turns(design, turns, angles, sheet)
        chosen = angles[_best_turns(best, angles, able, progress.part(0.2 + 0.25 * n, 0.3 + 0.25 * n))]
        found = _try_turns(here, best, chosen, lambda one, start, n=n: rested(one, start, 0.3 + 0.25 * n))  # type: ignore[misc]
        if found is None:
            break
        best, more = found
        turns = (turns + more) % np.pi
    return PanelGrain(best.design, turns, first, _rms(best))


def _allowed_turns(design: SpiralDesign, turns: np.ndarray, angles: np.ndarray, sheet: SheetParams) -> np.ndarray:
    """Return a mask (angles, patches) of the further rotations with which panels fit the sheet; ``turns`` : their present rotations."""
    rows = [
        [fits_sheet(design.flat, float(t + a), design.params.grain, sheet) for t in np.unique(turns)] for a in angles
    ]
    which = np.searchsorted(np.unique(turns), turns)
    return np.array([[row[which[p]][p] for p in range(len(turns))] for row in rows])


def _try_turns(
    design: SpiralDesign,
    best: Simulation,
    chosen: Float[np.ndarray, " patches"],
    rested: Callable[[SpiralDesign, Pose], Simulation],
) -> tuple[Simulation, np.ndarray] | None:
    """Return a simulation nearer to the target, and its rotations: all those ``chosen``, or every second; None if neither is nearer.

    rested : simulates a design from a pose
    """
    moving = np.flatnonzero(chosen)
    for some in (moving, moving[::2], moving[1::2]):
        turns = np.zeros(len(chosen))
        turns[some] = chosen[some]
        if not turns.any():
            continue
        again = replace(design, flat=rotate_panels(design.flat, turns))
        found = rested(again, _with_rotated_frames(best.equilibrium.pose, design, turns))
        if found.equilibrium.converged and _rms(found) < (1.0 - MIN_GAIN) * _rms(best):
            return found, turns
    return None


def _rms(found: Simulation) -> float:
    return float(np.sqrt((found.distance**2).mean())) if found.equilibrium.converged else np.inf


def _with_rotated_frames(pose: Pose, design: SpiralDesign, turns: np.ndarray) -> Pose:
    """Return a pose for hubs whose frames are rotated with their panels, so that the piece does not move."""
    turn = turns[design.flat.layout.patch_of]
    back = np.zeros((len(turn), 3, 3))
    back[:, 0, 0] = back[:, 1, 1] = np.cos(turn)
    back[:, 0, 1], back[:, 1, 0], back[:, 2, 2] = np.sin(turn), -np.sin(turn), 1.0
    return Pose(pose.centres, pose.rotations @ back)


def _best_turns(
    found: Simulation, angles: Float[np.ndarray, " angles"], able: np.ndarray, progress: Progress
) -> Int[np.ndarray, " patches"]:
    """Return, for every panel, the index of the angle with which the predicted hubs are nearest to the target.

    angles : radians, the first of them 0; able : mask (angles, patches) of allowed rotations
    """
    moved = predict_shifts(found, angles, progress)
    count = moved.shape[1]
    chosen = np.zeros(count, dtype=int)
    off = found.equilibrium.pose.centres - found.target.centroids
    free = not found.loads.fixed.any()
    for _ in range(MAX_SWEEPS):
        before = chosen.copy()
        for p in range(count):
            rest = off - moved[chosen[p], p]
            tried = rest + moved[:, p]
            if free:
                tried = tried - tried.mean(axis=1, keepdims=True)
            miss = (tried**2).sum(axis=(1, 2))
            miss[~able[:, p]] = np.inf
            best = int(np.argmin(miss))
            best = best if miss[best] < (1.0 - MIN_GAIN) * miss[chosen[p]] else int(chosen[p])
            off, chosen[p] = rest + moved[best, p], best
        if (chosen == before).all():
            break
    return chosen


def predict_shifts(
    found: Simulation, angles: Float[np.ndarray, " angles"], progress: Progress = SILENT
) -> Float[np.ndarray, "angles patches quads 3"]:
    """Return the shifts of all hubs, metres, that one Newton step predicts when one panel is rotated by one angle; angles[0] is 0."""
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
        # rotating a panel by an angle rotates the grain by minus that angle in the panel's frame
        rotated = replace(found.assembly, grain=found.assembly.grain - angle)
        other = arm_compliances(rotated, found.material, slopes=False)
        base = model.joint_gradients(state)
        sides = []
        for which in ((True, True), (True, False), (False, True)):
            mixed = model.with_compliance(_mix_sides(plain, other, which))
            sides.append(mixed.joint_gradients(mixed.start(pose)) - base)
        for p in range(count):
            own = patch == p
            change = np.zeros_like(base)
            for which, blocks in zip(((True, True), (True, False), (False, True)), sides, strict=True):
                rows = (own == which).all(axis=1)
                change[rows] = blocks[rows]
            out[k, p] = system.solve(-summed(change, pairs, found.assembly.size))[:, :3]
    return out


def _mix_sides(plain: ArmCompliances, other: ArmCompliances, which: tuple[bool, bool]) -> ArmCompliances:
    """Replace the compliances of one or both sides of all joints by those of ``other``; which : the sides to replace."""
    values = plain.values.copy()
    for side in (0, 1):
        if which[side]:
            values[:, side] = other.values[:, side]
    return replace(plain, values=values)
