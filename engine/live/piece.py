"""A piece that is brought to rest anew after every change, from where it is, and can be left at any step for the next change."""

from __future__ import annotations

import time
from collections import OrderedDict
from collections.abc import Generator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..arrays import Float, Int
from ..errors import FlexMapsError
from ..mechanics.assembly import Pose
from ..mechanics.equilibrium import Equilibrium, settling
from ..simulation.simulate import carried
from ..threads import one_thread
from .given import Given
from .rig import Rig

# residual at which a live piece counts as at rest: a brush stroke on domes of 400 to 2,400 spirals is within 1e-4 mm of the end then,
# and the step that would square the rest is saved
TOLERANCE = 1e-5
SLICE = 0.015  # seconds of steps before the shape is told: a picture has 16 ms at 60 a second
# distances of neighbours that a spiral moves at least before it is asked whether the piece has snapped; and apart from where it was,
# if it does not come back: as two minima are told from each other in ``equilibrium.other_minima``
FAR, APART = 1.0, 0.1
BACK = 60  # iterations after which a piece counts as not coming back; all else converges in 5 to 60
# shapes at rest that are kept, so that undo and redo find theirs again: a quarter of a megabyte each for 2,400 spirals
KEPT = 24


@dataclass(frozen=True, eq=False)
class Shape:
    """What there is to see and to say.

    vertices : metres, the target's as the hubs carry them; centres : metres, of the hubs; None while there is nothing yet
    quads : the vertices' quads; distance : metres, of every hub from its quad's middle in the target
    resting : nothing is left to do; converged : whether it is a minimum, where it rests
    problem : why the last change could not be followed; "" where it was
    snapped : millimetres that a spiral has jumped by, 0 where none has
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
        """Metres, of the distances to the target; 0 while there is nothing yet."""
        return 0.0 if self.distance is None else float(np.sqrt((self.distance**2).mean()))


@dataclass(frozen=True, eq=False)
class At:
    """A rig, and a pose of its hubs."""

    rig: Rig
    pose: Pose

    @property
    def laid(self) -> Pose:
        """Over the target, as far as nothing holds it."""
        return self.rig.laid(self.pose)

    def settling(self) -> Generator[Any, None, Equilibrium]:
        """The way to rest from here."""
        rig, physics = self.rig, self.rig.given.simulate
        coarse = replace(physics, tolerance=max(physics.tolerance, TOLERANCE))
        return settling(rig.model, self.pose, rig.loads, coarse, system=rig.system)


class LivePiece:
    """Give it changes, then ask for steps until it rests; a change may come at any time."""

    def __init__(self) -> None:
        self._given: Given | None = None
        self._at: At | None = None  # where it is
        self._rest: At | None = None  # where it rested last
        self._work: Generator[None, None, None] | None = None  # what is left to do
        self._kept: OrderedDict[bytes, Pose] = OrderedDict()
        self._refused = ""  # why the last change makes no piece
        self._problem = ""  # why it found no rest
        self._snapped = 0.0

    @one_thread
    def change(self, changes: dict[str, Any], start: Pose | None = None) -> None:
        """Follow changes of what is given (``Given.changes``); start : where a piece rests that is new.

        Where they make no piece, it stays what it was, and the next ``advance`` says why.
        """
        self._given = Given(**changes) if self._given is None else replace(self._given, **changes)
        known, old = self._kept.get(self._given.mark), self._at
        try:
            rig, pose = Rig.of(self._given, None if old is None else old.rig, start if old is None else old.pose)
        except FlexMapsError as error:
            self._refused = str(error)
            return
        if old is not None and old.rig.mesh.quads is not rig.mesh.quads:
            self._kept, self._rest = OrderedDict(), None
        # what rested so before has its hubs in the frames of then, which are those of now
        self._at = At(rig, pose if known is None else known)
        self._refused, self._problem, self._snapped = "", "", 0.0
        self._work = self._brought_to_rest(known is not None)

    @one_thread
    def advance(self) -> Shape:
        """Some steps towards rest, and the shape after them."""
        began = time.perf_counter()
        try:
            while self._work is not None and time.perf_counter() - began < SLICE:
                if next(self._work, self) is self:
                    self._work = None
        except FlexMapsError as error:
            self._fall_back(str(error))
        return self._shape()

    def _brought_to_rest(self, back: bool) -> Generator[None, None, None]:
        """All there is to do after a change, in small parts; back : whether it was like this before, so that nothing is to be told."""
        assert self._at is not None
        while True:
            found = yield from self._settled()
            if not found.converged:
                self._fall_back(found.status)
                return
            if not self._at.rig.refinable:
                break
            # refined only now, so that the first pictures come soon
            self._at = At((yield from self._at.rig.refined()), found.pose)
        self._snapped = 0.0 if back else (yield from self._jumped())
        self._rest = self._at
        mark = self._at.rig.given.mark
        self._kept[mark] = self._at.pose
        self._kept.move_to_end(mark)
        while len(self._kept) > KEPT:
            self._kept.popitem(last=False)

    def _settled(self) -> Generator[None, None, Equilibrium]:
        assert self._at is not None
        rig, steps = self._at.rig, self._at.settling()
        while True:
            try:
                self._at = At(rig, next(steps).pose)
            except StopIteration as end:
                self._at = At(rig, end.value.pose)
                return end.value  # type: ignore[no-any-return]
            yield

    def _fall_back(self, why: str) -> None:
        """The last good shape stays."""
        self._problem, self._work = why, None
        if self._rest is not None:
            self._at = self._rest

    def _jumped(self) -> Generator[None, None, float]:
        """Millimetres by which a spiral has jumped, where the piece does not come back when the change is taken back; else 0."""
        before, now = self._rest, self._at
        assert now is not None
        if before is None:
            return 0.0
        moved = float(np.linalg.norm(now.laid.centres - before.laid.centres, axis=1).max())
        if moved < FAR * now.rig.unit:
            return 0.0
        back = At(before.rig, Rig.of(before.rig.given, now.rig, now.pose)[1])
        steps, found = back.settling(), None
        for _ in range(BACK):
            try:
                next(steps)
            except StopIteration as end:
                found = end.value
                break
            yield
        if found is None or not found.converged:
            return 1e3 * moved
        away = np.linalg.norm(At(before.rig, found.pose).laid.centres - before.laid.centres, axis=1).max()
        return 1e3 * moved if away > APART * now.rig.unit else 0.0

    def _shape(self) -> Shape:
        problem = self._refused or self._problem
        if self._at is None:
            return Shape(None, None, resting=True, problem=problem)
        rig, laid, resting = self._at.rig, self._at.laid, self._work is None
        apart = np.linalg.norm(laid.centres - rig.mesh.centroids, axis=1)
        vertices = carried(rig.design, laid, rig.mesh)
        ends = resting, resting and not problem, problem, self._snapped
        return Shape(vertices, laid.centres, rig.mesh.quads, apart, *ends)
