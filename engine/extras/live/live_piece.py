"""A piece whose equilibrium is solved again after every change, from its present pose; a new change can interrupt."""

from __future__ import annotations

import time
from collections import OrderedDict
from collections.abc import Generator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ...arrays import Float, Int
from ...errors import FlexMapsError
from ...mechanics.assembly import Pose
from ...mechanics.equilibrium import Equilibrium, solve_stepwise
from ...simulation.simulate import move_vertices
from ...threads import one_thread
from .live_input import LiveInput
from .live_state import LiveState

# relative residual at which a live piece counts as at rest; larger: fewer steps, less exact (errors on domes: 1e-4 mm)
TOLERANCE = 1e-5
SLICE_SECONDS = 0.015  # computing time before ``advance`` returns a shape, seconds; larger: fewer frames per second
# Unit: mean distance of neighbouring hubs. A motion beyond JUMP_DISTANCE may be a snap; it is one if the piece stays
# farther than SNAP_DISTANCE from its earlier shape when the change is undone. Larger: fewer snaps are reported
JUMP_DISTANCE, SNAP_DISTANCE = 1.0, 0.1
RETURN_STEPS = 60  # largest number of Newton steps for the return to the earlier shape; pieces that return need 5 to 60
STORED_POSES = 24  # number of stored equilibria for immediate undo and redo; larger: more memory


@dataclass(frozen=True, eq=False)
class LiveEquilibrium:
    """Present shape of a live piece.

    vertices : vertices of the target, moved with the hubs, metres; None before the first shape
    centres : centres of the hubs, metres; None before the first shape
    quads : vertex indices of the quads
    distance : distance of every hub from its quad's centre in the target, metres
    resting : whether ``LivePiece.advance`` has nothing left to compute
    converged : whether the piece is at an equilibrium
    problem : why there is no equilibrium after the last change, else ""
    snapped : largest motion of a spiral if the piece snapped, millimetres, else 0
    """

    vertices: Float[np.ndarray, "vertices 3"] | None
    centres: Float[np.ndarray, "spirals 3"] | None
    quads: Int[np.ndarray, "quads 4"] | None = None
    distance: Float[np.ndarray, " quads"] | None = None
    resting: bool = False
    converged: bool = False
    problem: str = ""
    snapped: float = 0.0

    @property
    def rms(self) -> float:
        """RMS distance from the target, metres; 0 before the first shape."""
        return 0.0 if self.distance is None else float(np.sqrt((self.distance**2).mean()))


@dataclass(frozen=True, eq=False)
class RigPose:
    """State of a live piece (``LiveState``) with a pose of its hubs."""

    rig: LiveState
    pose: Pose

    @property
    def aligned_pose(self) -> Pose:
        """The pose, aligned with the target by a rigid motion as far as supports allow."""
        return self.rig.align(self.pose)

    def settling(self) -> Generator[Any, None, Equilibrium]:
        """Return a generator that makes one solver step at a time and finally returns the equilibrium."""
        rig, physics = self.rig, self.rig.given.simulate
        coarse = replace(physics, tolerance=max(physics.tolerance, TOLERANCE))
        return solve_stepwise(rig.model, self.pose, rig.loads, coarse, system=rig.system)


class LivePiece:
    """Piece whose shape follows changes: call ``change`` at any time, and ``advance`` until ``resting`` is True."""

    def __init__(self) -> None:
        self._given: LiveInput | None = None
        self._now: RigPose | None = None
        self._rest: RigPose | None = None  # last equilibrium, before the present change
        self._work: Generator[None, None, None] | None = None  # remaining work
        # equilibrium poses by ``LiveInput.mark``, the latest last
        self._rest_poses: OrderedDict[bytes, Pose] = OrderedDict()
        self._refusal = ""  # why no valid piece results from the last change
        self._problem = ""  # why no equilibrium was found
        self._snapped = 0.0

    @one_thread
    def change(self, changes: dict[str, Any], start: Pose | None = None) -> None:
        """Apply changes of the input; if no valid piece results, keep the present one, and ``advance`` reports why.

        Parameters
        ----------
        changes : changed fields of ``LiveInput``; all fields the first time
        start : equilibrium pose of a new piece, if known
        """
        self._given = LiveInput(**changes) if self._given is None else replace(self._given, **changes)
        stored, old = self._rest_poses.get(self._given.mark), self._now
        try:
            rig, pose = LiveState.from_input(
                self._given, None if old is None else old.rig, start if old is None else old.pose
            )
        except FlexMapsError as error:
            self._refusal = str(error)
            return
        if old is not None and old.rig.mesh.quads is not rig.mesh.quads:
            self._rest_poses, self._rest = OrderedDict(), None
        # the pose stored for an equal input is used as it is, because its flat frames are equal too
        self._now = RigPose(rig, pose if stored is None else stored)
        self._refusal, self._problem, self._snapped = "", "", 0.0
        self._work = self._solve(stored is not None)

    @one_thread
    def advance(self) -> LiveEquilibrium:
        """Compute steps towards the equilibrium for about ``SLICE_SECONDS`` seconds and return the shape after them."""
        began = time.perf_counter()
        try:
            while self._work is not None and time.perf_counter() - began < SLICE_SECONDS:
                if next(self._work, self) is self:
                    self._work = None
        except FlexMapsError as error:
            self._fall_back(str(error))
        return self._shape()

    def _solve(self, known: bool) -> Generator[None, None, None]:
        """Do all work after a change in small parts.

        known : whether this input had an equilibrium before, so that no snap is reported
        """
        assert self._now is not None
        while True:
            equilibrium = yield from self._settle()
            if not equilibrium.converged:
                self._fall_back(equilibrium.status)
                return
            if not self._now.rig.refinable:
                break
            # refine only now, so that the first shapes appear soon
            self._now = RigPose((yield from self._now.rig.refine()), equilibrium.pose)
        self._snapped = 0.0 if known else (yield from self._measure_snap())
        self._rest = self._now
        mark = self._now.rig.given.mark
        self._rest_poses[mark] = self._now.pose
        self._rest_poses.move_to_end(mark)
        while len(self._rest_poses) > STORED_POSES:
            self._rest_poses.popitem(last=False)

    def _settle(self) -> Generator[None, None, Equilibrium]:
        """Solve the equilibrium in steps, and update the present pose after every step."""
        assert self._now is not None
        rig, steps = self._now.rig, self._now.settling()
        while True:
            try:
                self._now = RigPose(rig, next(steps).pose)
            except StopIteration as end:
                self._now = RigPose(rig, end.value.pose)
                return end.value  # type: ignore[no-any-return]
            yield

    def _fall_back(self, why: str) -> None:
        """Stop working and return to the last equilibrium; ``why`` is the problem to report."""
        self._problem, self._work = why, None
        if self._rest is not None:
            self._now = self._rest

    def _measure_snap(self) -> Generator[None, None, float]:
        """Return the largest motion of a spiral, millimetres, if the piece snapped, else 0.

        A piece has snapped if a spiral moved far and does not return when the change is undone.
        """
        before, now = self._rest, self._now
        assert now is not None
        if before is None:
            return 0.0
        moved = float(np.linalg.norm(now.aligned_pose.centres - before.aligned_pose.centres, axis=1).max())
        if moved < JUMP_DISTANCE * now.rig.unit:
            return 0.0
        undone = RigPose(before.rig, LiveState.from_input(before.rig.given, now.rig, now.pose)[1])
        steps, equilibrium = undone.settling(), None
        for _ in range(RETURN_STEPS):
            try:
                next(steps)
            except StopIteration as end:
                equilibrium = end.value
                break
            yield
        if equilibrium is None or not equilibrium.converged:
            return 1e3 * moved
        returned = RigPose(before.rig, equilibrium.pose).aligned_pose
        away = np.linalg.norm(returned.centres - before.aligned_pose.centres, axis=1).max()
        return 1e3 * moved if away > SNAP_DISTANCE * now.rig.unit else 0.0

    def _shape(self) -> LiveEquilibrium:
        """Return the present shape for the display."""
        problem = self._refusal or self._problem
        if self._now is None:
            return LiveEquilibrium(None, None, resting=True, problem=problem)
        rig, pose, resting = self._now.rig, self._now.aligned_pose, self._work is None
        apart = np.linalg.norm(pose.centres - rig.mesh.centroids, axis=1)
        vertices = move_vertices(rig.design, pose, rig.mesh)
        ends = resting, resting and not problem, problem, self._snapped
        return LiveEquilibrium(vertices, pose.centres, rig.mesh.quads, apart, *ends)
