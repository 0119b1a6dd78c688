"""Load path: the equilibria of a piece as its load rises from zero, past the point where it snaps.

The equilibria under factor x load are followed by arc-length continuation (Riks 1979; Crisfield 1991, chapter 9): a
step along the tangent, then Newton steps in the plane perpendicular to it. These solve a bordered system by block
elimination, with the stresses predicted by the last step (Magisano, Leonetti and Garcea 2017). The load is critical
where the tangent stiffness stops being positive definite: at a limit point, where the load has its maximum, or at a
branch point.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.sparse import coo_array, csc_array

from ...arrays import Float
from ...linalg import NotPositiveDefinite, SparseLU
from ...mechanics.assembly import Pose
from ...mechanics.elastic import ElasticModel, Expansion, sum_joint_vectors
from ...mechanics.equilibrium import TURN_CAP, force_scale
from ...mechanics.newton_system import NewtonSystem
from ...mechanics.vectors import skew
from ...newton import NEGLIGIBLE_STEP
from ...progress import SILENT, Progress
from .actions import Action

LIMIT, BRANCH = "limit", "branch"  # kind of the critical point that ends the stable path
# Step lengths are the largest motion of a hub, in radians or quad edges; longer: fewer steps, more of them repeated
FIRST_STEP = 0.05  # first step length; any value converges
MAX_STEP = 0.5 * TURN_CAP  # longest step length: half of the largest rotation in a Newton step; any value converges
# the path is given up if the step length, and the change of the factor as a share of the largest, are below this
MIN_STEP = 1e-6
MAX_FACTOR_CHANGE = (
    0.125  # largest change of the factor per step, as a share of the largest factor; smaller: smoother curves
)
# number of Newton steps at which the step length stays as it is, and largest number, after which the step is halved
USUAL_ITERATIONS, MAX_ITERATIONS = 5, 14
BRACKET_TOL = 1e-3  # relative width of the bracket around the critical factor; smaller: more exact, slower
MAX_HALVINGS = 24  # largest number of bisections of the bracket around the critical factor
STEPS_BEYOND = 12  # number of steps followed after the critical load; larger: the curve shows more of the snapping
MAX_STEPS = 400  # largest number of steps; a dome that snaps takes about 40. Larger: more time before giving up


@dataclass(frozen=True, eq=False)
class PathPoint:
    """An equilibrium on the load path.

    factor : load factor
    state : state of the elastic model
    unstable : number of directions in which the equilibrium is unstable: negative pivots of the tangent stiffness
    way, rises : tangent of the path: motion of the n hubs and change of the factor, scaled so that the largest
        motion of a hub is one radian or one quad edge
    """

    factor: float
    state: Any = field(repr=False)
    unstable: int
    way: Float[np.ndarray, "spirals 6"] = field(repr=False)
    rises: float

    @property
    def pose(self) -> Pose:
        """Pose of the hubs."""
        pose: Pose = self.state.pose
        return pose


@dataclass(frozen=True, eq=False)
class LoadPath:
    """The load path.

    points : the equilibria in order, the first without load
    marks : equilibria by load factor, for the requested factors that were reached before the critical point
    critical : critical load factor, at which the piece snaps; None if none was reached
    kind : kind of the critical point, ``LIMIT`` or ``BRANCH``; "" if ``critical`` is None
    ended : reason why the path was given up early, else ""
    """

    points: tuple[PathPoint, ...]
    marks: dict[float, PathPoint]
    critical: float | None
    kind: str
    ended: str

    @property
    def last(self) -> PathPoint:
        """The last equilibrium before the first unstable one."""
        first = next((k for k, one in enumerate(self.points) if one.unstable), len(self.points))
        return self.points[max(first - 1, 0)]


@dataclass(eq=False)
class PathFollower:
    """Follows the equilibria of an elastic model whose load is a factor times ``action``.

    system : linear system of the model with supported unknowns eliminated
    tolerance : largest residual force, as a share of the internal forces and the load
    edge : mean edge length of a quad, metres; scale : norm of the load, N
    """

    model: ElasticModel
    system: NewtonSystem
    action: Action
    tolerance: float
    edge: float = field(init=False)
    scale: float = field(init=False, default=0.0)

    def __post_init__(self) -> None:
        assembly = self.model.assembly
        self.edge = float(assembly.radius.mean() * 2.0)
        self.scale = float(np.linalg.norm(self.action.force) + np.linalg.norm(self.action.pressure))

    # -- linear systems ------------------------------------------------------------------------------------------------

    def residual(self, here: Expansion, pose: Pose, factor: float) -> Float[np.ndarray, "spirals 6"]:
        """Return the residual forces and moments (n, 6) of the hubs, N and N m: internal minus external.

        Parameters
        ----------
        here : expansion of the elastic energy at the pose
        pose, factor : pose of the hubs, and load factor
        """
        out = here.gradient.copy()
        out[: len(self.action.force), :3] -= factor * self.action.at(pose)
        return out

    def pull(self, here: Expansion, pose: Pose) -> Float[np.ndarray, "spirals 6"]:
        """Return the negative derivative (n, 6) of the residual by the load factor, including the motion of supports.

        Parameters
        ----------
        here, pose : expansion of the elastic energy at the pose, and the pose
        """
        out, hubs = np.zeros_like(here.gradient), len(self.action.force)
        out[:hubs, :3] = self.action.at(pose)
        if self.action.shift.any():
            moved = np.zeros_like(out)
            moved[:hubs, :3] = self.action.shift
            ends = moved[self.model.pairs].reshape(-1, 12)
            forces = np.einsum("mij,mj->mi", here.hessian, ends)
            out -= sum_joint_vectors(forces, self.model.pairs, len(out))
        return out

    def follows(self, pose: Pose, factor: float) -> csc_array:
        """Return the load stiffness: derivative of the residual by hub rotations due to follower pressures.

        Its rows and columns are those of the free (unsupported) unknowns.

        Parameters
        ----------
        pose, factor : pose of the hubs, and load factor
        """
        return load_stiffness(self.system, self.action, pose, factor)

    def factor_tangent(
        self, here: Expansion, pose: Pose, factor: float
    ) -> tuple[Callable[[np.ndarray], np.ndarray], int]:
        """Factorise the tangent stiffness.

        Parameters
        ----------
        here : expansion of the elastic energy at the pose
        pose, factor : pose of the hubs, and load factor

        Returns
        -------
        function that solves the linear system of the tangent stiffness for a right-hand side (n, 6), and the number of
        negative pivots
        """
        values = self.system.values(here.hessian)
        if not self.action.follows and self.system.factor(values):
            return self.system.solve, 0
        matrix = self.system.pattern.matrix(values)
        if self.action.follows:
            matrix = (matrix + self.follows(pose, factor)).tocsc()
        lu = SparseLU(matrix)
        return lambda field: self.system.expand(lu.solve(self.system.free_entries(field))), lu.negative

    def with_support_motion(self, way: Float[np.ndarray, "spirals 6"], factor: float) -> Float[np.ndarray, "spirals 6"]:
        """Return increments (n, 6) of the hubs plus the motion of the supports.

        Parameters
        ----------
        way : increments of the free hubs
        factor : change of the load factor, to which the motion of the supports is proportional
        """
        out = way.copy()
        out[: len(self.action.shift), :3] += factor * self.action.shift
        return out

    def size(self, way: np.ndarray) -> float:
        """Return the largest entry of the hubs' increments ``way`` (n, 6), in radians or quad edges."""
        return float((np.abs(way) * np.repeat([1.0 / self.edge, 1.0], 3)).max(initial=0.0))

    # -- points --------------------------------------------------------------------------------------------------------

    def point(self, state: Any, factor: float, before: PathPoint | None) -> PathPoint:
        """Return an equilibrium with the tangent of the path there, oriented in the direction followed so far.

        Parameters
        ----------
        state, factor : state of the elastic model and load factor at the equilibrium
        before : the previous equilibrium, or None
        """
        here = self.model.expand(state)
        solve, unstable = self.factor_tangent(here, state.pose, factor)
        way = self.with_support_motion(solve(self.pull(here, state.pose)), 1.0)
        length = self.size(way)
        sign = 1.0
        if before is not None:
            weight = np.repeat([1.0 / self.edge**2, 1.0], 3)
            sign = 1.0 if (weight * way * before.way).sum() >= 0.0 else -1.0
        if length == 0.0:
            return PathPoint(factor, state, unstable, way, np.inf)
        return PathPoint(factor, state, unstable, sign * way / length, sign / length)

    def step(self, point: PathPoint, length: float, fixed: float | None = None) -> tuple[PathPoint, int] | None:
        """Return the next equilibrium and its number of Newton steps; None if these do not converge.

        Parameters
        ----------
        point : the present equilibrium
        length : step length, radians or quad edges
        fixed : load factor of the next equilibrium; by default it is sought in the plane perpendicular to the tangent
        """
        factor = point.factor + length * point.rises
        state = self.model.moved(point.state, length * point.way)
        weight = np.repeat([1.0 / self.edge**2, 1.0], 3) * point.way
        for count in range(MAX_ITERATIONS):
            here = self.model.expand(state, ahead=True)
            if not np.isfinite(here.energy):
                return None
            left = self.residual(here, state.pose, factor)
            ease, inner = force_scale(self.model, here, state.pose)
            if np.linalg.norm((left * ease)[~self.system.held]) <= self.tolerance * max(inner, self.scale) and (
                count or not length
            ):
                return self.point(state, factor, point), count
            try:
                solve, _ = self.factor_tangent(here, state.pose, factor)
            except NotPositiveDefinite:
                return None
            free, along = -solve(left), self.with_support_motion(solve(self.pull(here, state.pose)), 1.0)
            if fixed is None:
                # stay in the plane perpendicular to the tangent
                across = float((weight * along).sum())
                change = -float((weight * free).sum()) / (across or 1e-300)
            else:
                change = fixed - factor
            way = free + change * along
            if count and np.abs(way).max(initial=0.0) <= NEGLIGIBLE_STEP:
                # steps are negligible, so the residual is rounding error
                return self.point(state, factor, point), count
            cap = min(1.0, TURN_CAP / max(float(np.abs(way[:, 3:]).max(initial=0.0)), 1e-300))
            state, factor = self.model.moved(state, cap * way), factor + cap * change
        return None


def load_stiffness(system: NewtonSystem, action: Action, pose: Pose, factor: float) -> csc_array:
    """Return the load stiffness: derivative of -factor x pressure x normal with respect to rotations of the hubs.

    Parameters
    ----------
    system : linear system of the model, which lists the free (unsupported) unknowns
    action : the load, of which only the pressures count
    pose, factor : pose of the hubs, and load factor

    Returns
    -------
    sparse matrix (free, free), not symmetric
    """
    blocks = factor * action.pressure[:, None, None] * skew(pose.rotations[:, :, 2])
    hub, size = 6 * np.arange(len(action.pressure))[:, None, None], len(system.held)
    rows = np.broadcast_to(hub + np.arange(3)[:, None], blocks.shape).ravel()
    cols = np.broadcast_to(hub + 3 + np.arange(3), blocks.shape).ravel()
    whole = coo_array((blocks.ravel(), (rows, cols)), shape=(6 * size,) * 2).tocsr()
    return whole[system.free][:, system.free].tocsc()


def follow_path(
    follower: PathFollower,
    rest: Pose,
    *,
    marks: Sequence[float] = (1.0,),
    most: float = 10.0,
    beyond: int = STEPS_BEYOND,
    progress: Progress = SILENT,
) -> LoadPath:
    """Follow the load path from the equilibrium without load.

    Parameters
    ----------
    follower : model and load
    rest : pose without load
    marks : load factors at which the path must have an equilibrium
    most : load factor at which the path ends if no critical point was reached
    beyond : number of steps to follow after the critical point
    progress : called with the fraction done; may cancel
    """
    point = follower.point(follower.model.start(rest), 0.0, None)
    points, found, left, length = [point], dict[float, PathPoint](), sorted(marks), FIRST_STEP
    critical, kind, ended = None, "", "the search took too many steps"
    if point.unstable:
        return LoadPath((point,), {}, None, "", "the piece is in no stable equilibrium without load")
    if not np.isfinite(point.rises):  # nothing moves under this load
        still = {mark: PathPoint(mark, point.state, 0, point.way, point.rises) for mark in marks}
        return LoadPath((point, *still.values()), still, None, "", "")
    while len(points) < MAX_STEPS:
        progress(min(0.99, max(point.factor / most, len(points) / MAX_STEPS)), f"Load factor {point.factor:.3g}")
        progress.show(point.pose)
        aim = next((mark for mark in left if mark > point.factor), most) if critical is None else None
        step = _limit_step(point, length, aim, most)
        exact = aim if aim is not None and point.factor + step * point.rises >= aim * (1.0 - 1e-9) else None
        found_next = follower.step(point, step, exact)
        if found_next is None or _is_jump(follower, point, found_next[0], step):
            length = 0.5 * step
            if length < MIN_STEP and length * abs(point.rises) < MIN_STEP * most:
                ended = "no equilibrium was found any further"
                break
            continue
        new, count = found_next
        if critical is None and new.unstable:
            (last, new), kind = bracket_critical(follower, point, new, step), ""
            points += [last] if last is not point else []
            critical, kind = _critical_factor(follower, last, new)
            step = FIRST_STEP
        elif exact is not None and exact in left:
            found[exact] = new
            left.remove(exact)
        points.append(new)
        length = min(MAX_STEP, step * float(np.clip(np.sqrt(USUAL_ITERATIONS / max(count, 1)), 0.5, 2.0)))
        length = max(length, FIRST_STEP) if exact is not None else length
        point, beyond = new, beyond - (critical is not None)
        if (critical is None and point.factor >= most) or (critical is not None and (beyond <= 0 or point.factor < 0)):
            ended = ""
            break
    return LoadPath(tuple(points), found, critical, kind, ended)


def _limit_step(point: PathPoint, length: float, aim: float | None, most: float) -> float:
    """Return a step length of at most ``length`` with which the factor neither changes too much nor passes ``aim``.

    aim : next requested factor, or None; most : largest factor of the path
    """
    rises = abs(point.rises)
    if aim is not None and point.rises > 0.0:
        length = min(length, (aim - point.factor) / rises)
    return min(length, MAX_FACTOR_CHANGE * most / max(rises, 1e-300))


def _is_jump(follower: PathFollower, point: PathPoint, new: PathPoint, step: float) -> bool:
    """Return whether a step moved a hub much farther than the step length, probably onto another part of the path."""
    shift = new.pose.centres - point.pose.centres
    far = float(np.abs(shift).max()) / follower.edge
    return far > 4.0 * step + 1e-9


def bracket_critical(
    follower: PathFollower, stable: PathPoint, unstable: PathPoint, step: float
) -> tuple[PathPoint, PathPoint]:
    """Bracket the critical factor: return a stable and an unstable point, close to each other.

    Parameters
    ----------
    follower : model and load
    stable, unstable : consecutive points of the path
    step : step length between them, radians or quad edges
    """
    for _ in range(MAX_HALVINGS):
        if abs(unstable.factor - stable.factor) <= BRACKET_TOL * abs(stable.factor) and step < FIRST_STEP:
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


def _critical_factor(follower: PathFollower, stable: PathPoint, unstable: PathPoint) -> tuple[float, str]:
    """Return the critical factor between a stable and an unstable point, and its kind, ``LIMIT`` or ``BRANCH``."""
    if unstable.rises > 0.0:
        return 0.5 * (stable.factor + unstable.factor), BRANCH
    # maximum of a parabola that begins at the stable point and whose slope falls to the slope at the unstable point
    gap = unstable.pose.centres - stable.pose.centres
    length = float(np.abs(gap).max()) / follower.edge
    rise = stable.rises**2 * length / (2.0 * max(stable.rises - unstable.rises, 1e-300))
    return max(stable.factor, unstable.factor, min(stable.factor + rise, (1.0 + BRACKET_TOL) * stable.factor)), LIMIT
