"""Apply dabs of the brush in a thread, so that the pointer never waits; queued dabs are merged into one change."""

from __future__ import annotations

from concurrent.futures import Future, ThreadPoolExecutor
from typing import TYPE_CHECKING

import numpy as np

from ...engine.arrays import Float

if TYPE_CHECKING:
    from .paint_session import PaintSession


class DabQueue:
    """Queue of the dabs of one stroke.

    Parameters
    ----------
    session : the painted object
    brush : name of the brush
    inverted : whether to apply the brush's opposite effect
    """

    def __init__(self, session: PaintSession, brush: str, inverted: bool):
        self._session, self._brush, self._inverted = session, brush, inverted
        self._weights: list[np.ndarray] = []
        self._displacement = np.zeros(3)
        self._pool = ThreadPoolExecutor(1, thread_name_prefix="FlexMaps brush")
        self._running: Future[None] | None = None

    def add(self, weights: list[Float[np.ndarray, " quads"]], displacement: Float[np.ndarray, " 3"]) -> None:
        """Add dabs to the queue.

        Parameters
        ----------
        weights : for every dab its weights on the quads (F,), from 0 to 1
        displacement : displacement of the brush during these dabs (3,), in world axes; only its direction matters
        """
        self._weights += weights
        self._displacement = self._displacement + displacement
        self.poll()

    def poll(self) -> bool:
        """Poll the thread: start the queued dabs if it is idle.

        Return whether a run has ended since the last call; raise the run's error, if any.
        """
        done = self._running is not None and self._running.done()
        if done:
            self._join()
        if self._running is None and self._weights and (self._brush != "along" or self._displacement.any()):
            weights, way = self._weights, self._displacement
            self._weights, self._displacement = [], np.zeros(3)
            self._running = self._pool.submit(self._paint, weights, way)
        return done

    def try_finish(self) -> bool:
        """Return whether all dabs are applied and ``PaintSession.prepare_write`` has run; call it after ``poll``."""
        if self._running is None and not self._session.is_prepared:
            self._running = self._pool.submit(self._session.prepare_write)
        return self._running is None

    def wait(self) -> None:
        """Block until all dabs are applied."""
        while True:
            self.poll()
            if self.try_finish():
                return
            self._join()

    def close(self) -> None:
        """Drop the queued dabs, and wait until the running ones end."""
        self._weights = []
        self._pool.shutdown()
        self._running = None

    def _join(self) -> None:
        running, self._running = self._running, None
        if running is not None:
            running.result()

    def _paint(self, weights: list[np.ndarray], displacement: np.ndarray) -> None:
        from ...engine.spirals.brush_weights import combine_weights
        from ...engine.spirals.painting import Stroke

        protect = self._brush == "protect"
        weight = np.max(weights, axis=0) if protect else combine_weights(weights)
        self._session.paint(self._brush, weight, Stroke(self._inverted, None if protect else displacement))
