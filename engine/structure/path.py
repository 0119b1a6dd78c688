"""How a piece gives way as a load rises from nothing, past the point where it snaps: the load path.

The path of equilibria of elastic forces less factor x load is followed by its length (Riks 1979; Crisfield 1991, chapter 9): a
step along its tangent, then Newton's steps on the plane across it, which solve a bordered system by block elimination. Their
stresses are those that the last step predicted (Magisano, Leonetti and Garcea 2017, who made them for this). The load at which the
tangent stiffness stops being positive definite is critical: a limit point where the load itself can rise no more, else a branching.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.sparse import coo_array, csc_array

from ..arrays import Float
from ..linalg import NotPositiveDefinite, SparseLU
from ..mechanics.assembly import Pose
from ..mechanics.elastic import ElasticModel, Expansion, summed
from ..mechanics.equilibrium import force_measure
from ..mechanics.newton_system import NewtonSystem
from ..mechanics.vectors import skew
from ..newton import STILL
from ..progress import SILENT, Progress
from .actions import Action

LIMIT, BRANCH = "limit", "branch"  # how a critical load ends the path that was stable
FIRST, LONGEST = (
    0.05,
    0.25,
)  # radians, or edges, that a hub moves in the first and in the longest step: both by eye, any converge
SHORTEST = 1e-6  # of the same, and of the largest factor: what is shorter leads nowhere
SHARE = 0.125  # of the largest factor that one step may add, so that a curve has points
USUAL, MOST = 5, 14  # Newton steps that leave a step's length as it is, and after which it is halved
TURN_CAP = 0.5  # radians that a hub may turn in one Newton step, as in ``equilibrium``
SHARP = 1e-3  # of the critical factor: how narrowly it is enclosed
HALVINGS = 24  # of a step, until it is
BEYOND = 12  # steps that are followed after the critical load
STEPS = 400  # at most; a dome that snaps takes some 40


@dataclass(frozen=True, eq=False)
class Point:
    """An equilibrium on the path.

    factor : of the load; state : of the elastic model; unstable : number of ways in which it gives way by itself
    way, rises : how the hubs (n, 6) and the factor go on from there, for a hub that moves by one radian or edge at most
    """

    factor: float
    state: Any = field(repr=False)
    unstable: int
    way: Float[np.ndarray, "spirals 6"] = field(repr=False)
    rises: float

    @property
    def pose(self) -> Pose:
        pose: Pose = self.state.pose
        return pose


@dataclass(frozen=True, eq=False)
class Path:
    """The equilibria that were found, in their order.

    points : the first without load; marks : those at the factors that were asked for, where they were reached in a stable state
    critical : the factor at which it gives way, None where none was found; kind : ``LIMIT`` or ``BRANCH``
    ended : why it was not followed further, "" where nothing was left to be asked
    """

    points: tuple[Point, ...]
    marks: dict[float, Point]
    critical: float | None
    kind: str
    ended: str

    @property
    def last(self) -> Point:
        """The last one before the piece gives way."""
        first = next((k for k, one in enumerate(self.points) if one.unstable), len(self.points))
        return self.points[max(first - 1, 0)]


@dataclass(eq=False)
class Follower:
    """Follows the equilibria of a model under factor x action.

    system : the joints' linear system, what holds the piece left out; tolerance : forces left, relative to those within and the load
    """

    model: ElasticModel
    system: NewtonSystem
    action: Action
    tolerance: float
    edge: float = field(init=False)
    scale: float = field(init=False, default=0.0)

    def __post_init__(self) -> None:
        # what holds a piece that floats is no support: it carries nothing
        assembly = self.model.assembly
        self.edge = float(assembly.radius.mean() * 2.0)
        self.scale = float(np.linalg.norm(self.action.force) + np.linalg.norm(self.action.pressure))

    # -- linear systems ------------------------------------------------------------------------------------------------

    def residual(self, here: Expansion, pose: Pose, factor: float) -> Float[np.ndarray, "spirals 6"]:
        out = here.gradient.copy()
        out[: len(self.action.force), :3] -= factor * self.action.at(pose)
        return out

    def pull(self, here: Expansion, pose: Pose) -> Float[np.ndarray, "spirals 6"]:
        """Less the derivative of the residual by the factor; supports that move along count."""
        out, hubs = np.zeros_like(here.gradient), len(self.action.force)
        out[:hubs, :3] = self.action.at(pose)
        if self.action.shift.any():
            moved = np.zeros_like(out)
            moved[:hubs, :3] = self.action.shift
            ends = moved[self.model.pairs].reshape(-1, 12)
            forces = np.einsum("mij,mj->mi", here.hessian, ends)
            out -= summed(forces, self.model.pairs, len(out))
        return out

    def follows(self, pose: Pose, factor: float) -> csc_array:
        """The derivative of the residual by the turns of the hubs through a pressure that turns with them; free increments."""
        return following(self.system, self.action, pose, factor)

    def factored(self, here: Expansion, pose: Pose, factor: float) -> tuple[Callable[[np.ndarray], np.ndarray], int]:
        """What solves with the tangent, and its number of negative pivots."""
        values = self.system.values(here.hessian)
        if not self.action.follows and self.system.factor(values):
            return self.system.solve, 0
        matrix = self.system.pattern.matrix(values)
        if self.action.follows:
            matrix = (matrix + self.follows(pose, factor)).tocsc()
        lu = SparseLU(matrix)
        return lambda field: self.system.full(lu.solve(self.system.reduced(field))), lu.negative

    def moved(self, way: Float[np.ndarray, "spirals 6"], factor: float) -> Float[np.ndarray, "spirals 6"]:
        """Increments with those of the supports that a change of the factor moves."""
        out = way.copy()
        out[: len(self.action.shift), :3] += factor * self.action.shift
        return out

    def size(self, way: np.ndarray) -> float:
        """The largest motion of a hub, in radians or edges."""
        return float((np.abs(way) * np.repeat([1.0 / self.edge, 1.0], 3)).max(initial=0.0))

    # -- points --------------------------------------------------------------------------------------------------------

    def point(self, state: Any, factor: float, before: Point | None) -> Point:
        """An equilibrium with the way on from it, in the direction in which the path was followed so far."""
        here = self.model.expand(state)
        solve, unstable = self.factored(here, state.pose, factor)
        way = self.moved(solve(self.pull(here, state.pose)), 1.0)
        length = self.size(way)
        sign = 1.0
        if before is not None:
            weight = np.repeat([1.0 / self.edge**2, 1.0], 3)
            sign = 1.0 if (weight * way * before.way).sum() >= 0.0 else -1.0
        if length == 0.0:
            return Point(factor, state, unstable, way, np.inf)
        return Point(factor, state, unstable, sign * way / length, sign / length)

    def step(self, point: Point, length: float, fixed: float | None = None) -> tuple[Point, int] | None:
        """The next equilibrium and how many Newton steps it took; None where they do not lead to one.

        fixed : the factor that it shall have, instead of lying on the plane across the tangent
        """
        factor = point.factor + length * point.rises
        state = self.model.moved(point.state, length * point.way)
        weight = np.repeat([1.0 / self.edge**2, 1.0], 3) * point.way
        for count in range(MOST):
            here = self.model.expand(state, ahead=True)
            if not np.isfinite(here.energy):
                return None
            left = self.residual(here, state.pose, factor)
            ease, inner = force_measure(self.model, here, state.pose)
            if np.linalg.norm((left * ease)[~self.system.held]) <= self.tolerance * max(inner, self.scale) and (
                count or not length
            ):
                return self.point(state, factor, point), count
            try:
                solve, _ = self.factored(here, state.pose, factor)
            except NotPositiveDefinite:
                return None
            free, along = -solve(left), self.moved(solve(self.pull(here, state.pose)), 1.0)
            if fixed is None:
                # across the tangent
                across = float((weight * along).sum())
                change = -float((weight * free).sum()) / (across or 1e-300)
            else:
                change = fixed - factor
            way = free + change * along
            if count and np.abs(way).max(initial=0.0) <= STILL:
                # the forces that are left are rounding
                return self.point(state, factor, point), count
            cap = min(1.0, TURN_CAP / max(float(np.abs(way[:, 3:]).max(initial=0.0)), 1e-300))
            state, factor = self.model.moved(state, cap * way), factor + cap * change
        return None


def following(system: NewtonSystem, action: Action, pose: Pose, factor: float) -> csc_array:
    """(free, free): the derivative of -factor x pressure x normal by the turns of the hubs, which is not symmetric."""
    blocks = factor * action.pressure[:, None, None] * skew(pose.rotations[:, :, 2])
    hub, size = 6 * np.arange(len(action.pressure))[:, None, None], len(system.held)
    rows = np.broadcast_to(hub + np.arange(3)[:, None], blocks.shape).ravel()
    cols = np.broadcast_to(hub + 3 + np.arange(3), blocks.shape).ravel()
    whole = coo_array((blocks.ravel(), (rows, cols)), shape=(6 * size,) * 2).tocsr()
    return whole[system.free][:, system.free].tocsc()


def follow(
    follower: Follower,
    rest: Pose,
    *,
    marks: Sequence[float] = (1.0,),
    most: float = 10.0,
    beyond: int = BEYOND,
    progress: Progress = SILENT,
) -> Path:
    """The path from an equilibrium without load to the factor ``most``, or ``beyond`` steps past where it gives way."""
    point = follower.point(follower.model.start(rest), 0.0, None)
    points, found, left, length = [point], dict[float, Point](), sorted(marks), FIRST
    critical, kind, ended = None, "", "the search took too many steps"
    if point.unstable:
        return Path((point,), {}, None, "", "the piece is in no stable equilibrium without load")
    if not np.isfinite(point.rises):  # nothing moves
        still = {mark: Point(mark, point.state, 0, point.way, point.rises) for mark in marks}
        return Path((point, *still.values()), still, None, "", "")
    while len(points) < STEPS:
        progress(min(0.99, max(point.factor / most, len(points) / STEPS)), f"Load factor {point.factor:.3g}")
        progress.show(point.pose)
        aim = next((mark for mark in left if mark > point.factor), most) if critical is None else None
        step = _clipped(point, length, aim, most)
        exact = aim if aim is not None and point.factor + step * point.rises >= aim * (1.0 - 1e-9) else None
        found_next = follower.step(point, step, exact)
        if found_next is None or _leaps(follower, point, found_next[0], step):
            length = 0.5 * step
            if length < SHORTEST and length * abs(point.rises) < SHORTEST * most:
                ended = "no equilibrium was found any further"
                break
            continue
        new, count = found_next
        if critical is None and new.unstable:
            (last, new), kind = enclosed(follower, point, new, step), ""
            points += [last] if last is not point else []
            critical, kind = _critical(follower, last, new)
            step = FIRST
        elif exact is not None and exact in left:
            found[exact] = new
            left.remove(exact)
        points.append(new)
        length = min(LONGEST, step * float(np.clip(np.sqrt(USUAL / max(count, 1)), 0.5, 2.0)))
        length = max(length, FIRST) if exact is not None else length
        point, beyond = new, beyond - (critical is not None)
        if (critical is None and point.factor >= most) or (critical is not None and (beyond <= 0 or point.factor < 0)):
            ended = ""
            break
    return Path(tuple(points), found, critical, kind, ended)


def _clipped(point: Point, length: float, aim: float | None, most: float) -> float:
    """The length of a step that adds no more than a share of the largest factor, and does not go past its aim."""
    rises = abs(point.rises)
    if aim is not None and point.rises > 0.0:
        length = min(length, (aim - point.factor) / rises)
    return min(length, SHARE * most / max(rises, 1e-300))


def _leaps(follower: Follower, point: Point, new: Point, step: float) -> bool:
    """Whether a step ended on another part of the path: it went far beyond its length, or came back the way it went."""
    shift = new.pose.centres - point.pose.centres
    far = float(np.abs(shift).max()) / follower.edge
    return far > 4.0 * step + 1e-9


def enclosed(follower: Follower, stable: Point, unstable: Point, step: float) -> tuple[Point, Point]:
    """The last stable and the first unstable point, as near to each other as wanted, between two that are a step apart."""
    for _ in range(HALVINGS):
        if abs(unstable.factor - stable.factor) <= SHARP * abs(stable.factor) and step < FIRST:
            break
        step *= 0.5
        found = follower.step(stable, step)
        if found is None:
            break
        if found[0].unstable:
            unstable = found[0]
        else:
            stable = found[0]
    return stable, unstable


def _critical(follower: Follower, stable: Point, unstable: Point) -> tuple[float, str]:
    """The critical factor between two points, and of which kind it is."""
    if unstable.rises > 0.0:
        return 0.5 * (stable.factor + unstable.factor), BRANCH
    # the parabola through the first point with its rise, whose rise falls to that of the second
    gap = unstable.pose.centres - stable.pose.centres
    length = float(np.abs(gap).max()) / follower.edge
    rise = stable.rises**2 * length / (2.0 * max(stable.rises - unstable.rises, 1e-300))
    return max(stable.factor, unstable.factor, min(stable.factor + rise, (1.0 + SHARP) * stable.factor)), LIMIT
