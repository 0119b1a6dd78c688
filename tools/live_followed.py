"""Live mode in the same process, for benches: time to equilibrium, and distance of the final shape from a simulation."""

from __future__ import annotations

import pickle
import time
from dataclasses import replace
from typing import Any

import numpy as np
from flexmaps.engine.extras.live.live_input import LiveInput
from flexmaps.engine.extras.live.live_piece import LiveEquilibrium
from flexmaps.engine.extras.live.session import LiveRequest, step_piece
from flexmaps.engine.simulation.simulate import simulate
from flexmaps.engine.spirals.design import SpiralDesign


class FollowedPiece:
    """A piece whose work all counts; what goes through the pipe is written and read as there."""

    def __init__(self, given: LiveInput):
        self.given = given
        self.rest = self.told(given.changes(None), whole=True)

    def told(self, changes: dict[str, Any] | None, whole: bool = False) -> LiveEquilibrium:
        while not (shape := self._step(LiveRequest("piece", changes, whole))).resting:
            changes, whole = None, False
        return shape

    def follow(self, wanted: LiveInput) -> tuple[float, float, LiveEquilibrium]:
        """Seconds of processor to the first picture and to rest, and the shape."""
        began, first = time.process_time(), 0.0
        changes: dict[str, Any] | None = wanted.changes(self.given)
        while True:
            shape = self._step(LiveRequest("piece", changes))
            first, changes = first or time.process_time() - began, None
            if shape.resting:
                self.given, self.rest = wanted, shape
                return first, time.process_time() - began, shape

    def _step(self, call: LiveRequest) -> LiveEquilibrium:
        from flexmaps.bridge.view.live_mode_shape import LiveModeShape as Picture

        shape = step_piece(pickle.loads(pickle.dumps(call)))
        assert shape is not None
        shape = pickle.loads(pickle.dumps(shape))
        Picture.from_shape(shape, 1.0)
        return shape


def distance(given: LiveInput, made: SpiralDesign, shape: LiveEquilibrium) -> float:
    """Millimetres between a live shape and what is simulated of the same spirals, to its own tolerance, begun where they rest."""
    from flexmaps.engine.extras.live.session import _pieces

    at = _pieces["piece"]._now
    assert at is not None and shape.vertices is not None
    design = replace(made, width=given.width, twist=given.twist)
    found = simulate(design, made.flat.layout.mesh, given.material, given.simulate, start=at.pose)
    return 1e3 * float(np.abs(found.vertices - shape.vertices).max())
