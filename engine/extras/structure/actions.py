"""Loads as actions on the hubs: forces of fixed direction, follower pressures, and movements of supports.

Exposed areas and lengths of lines are measured on the equilibrium without loads. Forces, wind and snow keep their
direction as the piece deforms; a pressure stays normal to every hub.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ...arrays import Bool, Float, Int
from ...errors import FlexMapsError
from ...mechanics.assembly import Pose
from ...mechanics.loads import GRAVITY
from .cases import Load, LoadCase, LoadCombination, LoadPlan

QuadFinder = Callable[[str], np.ndarray]
HIDING_DISTANCE = 1e-3  # smallest distance, in quad edges, at which one quad hides another; absorbs rounding
MAX_RAYS = 2_000_000  # largest number of pairs (quad, triangle) tested at once (100 MB); larger: more memory


@dataclass(frozen=True, eq=False)
class Action:
    """Loads on n spirals.

    force : forces of fixed direction, N
    pressure : forces along the outer normals of the hubs, N; they rotate with the hubs
    shift : movements of supported hubs, metres
    """

    force: Float[np.ndarray, "spirals 3"]
    pressure: Float[np.ndarray, " spirals"]
    shift: Float[np.ndarray, "spirals 3"]

    @classmethod
    def none(cls, size: int) -> Action:
        """Return an action of zero on ``size`` spirals."""
        return cls(np.zeros((size, 3)), np.zeros(size), np.zeros((size, 3)))

    def __add__(self, other: Action) -> Action:
        return Action(self.force + other.force, self.pressure + other.pressure, self.shift + other.shift)

    def times(self, factor: float) -> Action:
        """Return the action scaled by a factor."""
        return Action(factor * self.force, factor * self.pressure, factor * self.shift)

    def at(self, pose: Pose) -> Float[np.ndarray, "spirals 3"]:
        """Return the forces on the hubs in a pose, N."""
        return self.force + self.pressure[:, None] * pose.rotations[:, :, 2]

    @property
    def follows(self) -> bool:
        """Whether there is a pressure, which rotates with the hubs."""
        return bool(self.pressure.any())

    @property
    def acts(self) -> bool:
        """Whether there is any load or movement."""
        return bool(self.force.any() or self.pressure.any() or self.shift.any())


@dataclass(frozen=True, eq=False)
class UnloadedState:
    """The equilibrium without loads, to which loads are applied.

    pose : pose of the hubs
    corners : corners of the quads in this shape, metres
    flat : corners of the quads in the flat panels, metres
    pairs, sides : the two hubs of every joint, and the sides of their quads
    mass : mass of every spiral, kg
    held : whether the position of a hub is fixed by a support
    where : function that returns the quads that a text names
    """

    pose: Pose
    corners: Float[np.ndarray, "spirals 4 3"]
    flat: Float[np.ndarray, "spirals 4 2"]
    pairs: Int[np.ndarray, "joints 2"]
    sides: Int[np.ndarray, "joints 2"]
    mass: Float[np.ndarray, " spirals"]
    held: Bool[np.ndarray, " spirals"]
    where: QuadFinder

    @property
    def size(self) -> int:
        """Number of spirals."""
        return len(self.mass)

    @property
    def area(self) -> Float[np.ndarray, " spirals"]:
        """Area of the flat quads including their slots, m2."""
        x, y = self.flat[..., 0], self.flat[..., 1]
        return 0.5 * np.abs((x * np.roll(y, -1, axis=1) - y * np.roll(x, -1, axis=1)).sum(axis=1))


def actions_by_name(plan: LoadPlan, ground: UnloadedState) -> dict[str, Action]:
    """Return the action of every load case and combination by name.

    Parameters
    ----------
    plan : load cases and combinations
    ground : equilibrium without loads, to which they are applied
    """
    found = {case.name: _case_action(case, ground, lasting=False) for case in plan.cases}
    return found | {one.name: _combination_action(one, found, ground.size) for one in plan.combinations}


def lasting_action(plan: LoadPlan, ground: UnloadedState) -> Action:
    """Return the sum of all loads, over all cases, that act for years.

    Parameters
    ----------
    plan : load cases
    ground : equilibrium without loads, to which they are applied
    """
    parts = [_case_action(case, ground, lasting=True) for case in plan.cases]
    return sum(parts[1:], parts[0])


def _combination_action(combination: LoadCombination, found: dict[str, Action], size: int) -> Action:
    """Return the action of a combination; ``found`` has the actions of all cases."""
    total = Action.none(size)
    for factor, name in combination.parts:
        total += found[name].times(factor)
    return total


def _case_action(case: LoadCase, ground: UnloadedState, *, lasting: bool) -> Action:
    """Return the action of a case; if ``lasting``, only of its loads that act for years."""
    total = Action.none(ground.size)
    for load in case.loads:
        if load.lasting or not lasting:
            try:
                total += _load_action(load, ground).times(load.factor)
            except FlexMapsError as error:
                raise FlexMapsError(f"Load case '{case.name}': {error}", faces=error.faces) from None
    return total


def _load_action(load: Load, ground: UnloadedState) -> Action:
    """Return the action of a load, not multiplied by its factor."""
    acts = Action.none(ground.size)
    quads = ground.where(load.where) if load.where else np.arange(ground.size)
    value = np.array(load.value)
    if load.kind == "weight":
        acts.force[quads, 2] -= GRAVITY * ground.mass[quads]
    elif load.kind == "point":
        acts.force[quads] += value / len(quads)
    elif load.kind == "line":
        acts.force[quads] += value * _line_lengths(quads, ground)[:, None]
    elif load.kind == "pressure":
        # a positive pressure pushes from outside, against the outer normals
        acts.pressure[quads] -= value * ground.area[quads]
    elif load.kind == "move":
        moved = quads if load.where else np.flatnonzero(ground.held)
        loose = moved[~ground.held[moved]]
        if len(loose) or not len(moved):
            raise FlexMapsError("only supports can be moved, and nothing holds these quads", faces=loose)
        acts.shift[moved] += value
    else:
        acts.force[quads] += _exposed_area_forces(value, quads, ground)
    return acts


def _line_lengths(quads: np.ndarray, ground: UnloadedState) -> Float[np.ndarray, " some"]:
    """Return (k,) the length, metres, over which a line load acts on each of its k quads.

    In each quad the line runs from the middle of one side through the centre to the middle of another side.
    """
    inside = np.zeros(ground.size, dtype=bool)
    inside[quads] = True
    joined = inside[ground.pairs].all(axis=1)
    goes = np.zeros((ground.size, 4), dtype=bool)
    goes[ground.pairs[joined].ravel(), ground.sides[joined].ravel()] = True
    count = goes.sum(axis=1)
    wide = np.flatnonzero(count > 2)
    if len(wide):
        raise FlexMapsError("its quads form no line, for one of them has three neighbours among them", faces=wide)
    middle = 0.5 * (ground.flat + np.roll(ground.flat, -1, axis=1))
    half = np.linalg.norm(middle - ground.flat.mean(axis=1)[:, None], axis=2)
    # at its ends a line extends to the opposite side, on a single quad along the longer direction
    goes |= (count == 1)[:, None] & np.roll(goes, 2, axis=1)
    across = half + np.roll(half, 2, axis=1)
    return np.where(count > 0, (half * goes).sum(axis=1), across.max(axis=1))[quads]


def _exposed_area_forces(value: np.ndarray, quads: np.ndarray, ground: UnloadedState) -> Float[np.ndarray, "some 3"]:
    """Return (k, 3) the forces, N, of wind or snow on k quads, proportional to their areas projected along the axis.

    Quads that other quads hide get no force.

    value : (3,) pressure times direction, N/m2
    """
    axis = value / max(np.linalg.norm(value), 1e-300)
    share = np.abs(ground.pose.rotations[quads, :, 2] @ axis) * ~are_hidden(ground.corners, axis)[quads]
    return value * (share * ground.area[quads])[:, None]


def are_hidden(corners: Float[np.ndarray, "quads 4 3"], axis: Float[np.ndarray, " 3"]) -> Bool[np.ndarray, " quads"]:
    """Return (F,) whether another quad hides the middle of a quad from a viewer who looks along ``axis``.

    Parameters
    ----------
    corners : corners of all quads, metres
    axis : direction of view, a unit vector
    """
    helper = np.eye(3)[np.abs(axis).argmin()]
    right = np.cross(axis, helper) / np.linalg.norm(np.cross(axis, helper))
    frame = np.stack([right, np.cross(axis, right), axis], axis=1)
    points = corners @ frame
    centres, n = points.mean(axis=1), len(corners)
    triangles = np.concatenate([points[:, [0, 1, 2]], points[:, [0, 2, 3]]])
    owner = np.tile(np.arange(n), 2)
    slack = HIDING_DISTANCE * float(
        np.sqrt(np.median(np.linalg.norm(corners[:, 2] - corners[:, 0], axis=1)) ** 2 / 2.0)
    )
    a, ab, ac = triangles[:, 0], triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    area = ab[:, 0] * ac[:, 1] - ab[:, 1] * ac[:, 0]
    safe = np.where(np.abs(area) > 1e-30, area, np.inf)
    out = np.zeros(n, dtype=bool)
    step = max(1, MAX_RAYS // len(triangles))
    for start in range(0, n, step):
        part = slice(start, start + step)
        to = centres[part, None] - a
        u = (to[..., 0] * ac[:, 1] - to[..., 1] * ac[:, 0]) / safe
        v = (to[..., 1] * ab[:, 0] - to[..., 0] * ab[:, 1]) / safe
        depth = a[:, 2] + u * ab[:, 2] + v * ac[:, 2]
        inside = (u >= 0.0) & (v >= 0.0) & (u + v <= 1.0) & (owner != np.arange(n)[part, None]) & np.isfinite(safe)
        out[part] = (inside & (depth < centres[part, 2, None] - slack)).any(axis=1)
    return out
