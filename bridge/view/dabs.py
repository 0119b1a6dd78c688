"""Apply dabs of the brush in a thread, so that the pointer never waits; queued dabs are merged into one change."""

from __future__ import annotations

from concurrent.futures import Future, ThreadPoolExecutor
from typing import TYPE_CHECKING

import numpy as np

from ...engine.arrays import Float

if TYPE_CHECKING:
    from .easel import Easel


class Dabs:
    """Queue of the dabs of one stroke.

    Parameters
    ----------
    easel : the painted object
    brush : name of the brush
    inverted : whether to apply the brush's opposite effect
    """

    def __init__(self, easel: Easel, brush: str, inverted: bool):
        self._easel, self._brush, self._inverted = easel, brush, inverted
        self._weights: list[np.ndarray] = []
        self._way = np.zeros(3)
        self._pool = ThreadPoolExecutor(1, thread_name_prefix="FlexMaps brush")
        self._running: Future[None] | None = None

    def add(self, weights: list[Float[np.ndarray, " quads"]], way: Float[np.ndarray, " 3"]) -> None:
        """Add dabs to the queue.

        Parameters
        ----------
        weights : for every dab its weights on the quads (F,), from 0 to 1
        way : displacement of the brush during these dabs (3,), in world axes; only its direction matters
        """
        self._weights += weights
        self._way = self._way + way
        self.look()

    def look(self) -> bool:
        """Poll the thread: start the queued dabs if it is idle.

        Return whether a run has ended since the last call; raise the run's error, if any.
        """
        done = self._running is not None and self._running.done()
        if done:
            self._end()
        if self._running is None and self._weights and (self._brush != "along" or self._way.any()):
            weights, way = self._weights, self._way
            self._weights, self._way = [], np.zeros(3)
            self._running = self._pool.submit(self._paint, weights, way)
        return done

    def over(self) -> bool:
        """Return whether all dabs are applied and ``Easel.ready`` has run; call it after ``look``."""
        if self._running is None and not self._easel.is_ready:
            self._running = self._pool.submit(self._easel.ready)
        return self._running is None

    def wait(self) -> None:
        """Block until all dabs are applied."""
        while True:
            self.look()
            if self.over():
                return
            self._end()

    def close(self) -> None:
        """Drop the queued dabs, and wait until the running ones end."""
        self._weights = []
        self._pool.shutdown()
        self._running = None

    def _end(self) -> None:
        running, self._running = self._running, None
        if running is not None:
            running.result()

    def _paint(self, weights: list[np.ndarray], way: np.ndarray) -> None:
        from ...engine.spirals.brush_weights import combine_weights
        from ...engine.spirals.painting import Stroke

        protect = self._brush == "protect"
        weight = np.max(weights, axis=0) if protect else combine_weights(weights)
        self._easel.paint(self._brush, weight, Stroke(self._inverted, None if protect else way))
