"""Dabs of a brush, worked off beside the window's thread: the pointer never waits for spirals, and what waits becomes one change."""

from __future__ import annotations

from concurrent.futures import Future, ThreadPoolExecutor
from typing import TYPE_CHECKING

import numpy as np

from ...engine.arrays import Float

if TYPE_CHECKING:
    from .easel import Easel


class Dabs:
    """Of one stroke on an easel.

    brush : its name; inverted : the other way round
    """

    def __init__(self, easel: Easel, brush: str, inverted: bool):
        self._easel, self._brush, self._inverted = easel, brush, inverted
        self._weights: list[np.ndarray] = []
        self._way = np.zeros(3)
        self._pool = ThreadPoolExecutor(1, thread_name_prefix="FlexMaps brush")
        self._running: Future[None] | None = None

    def add(self, weights: list[Float[np.ndarray, " quads"]], way: Float[np.ndarray, " 3"]) -> None:
        """Dabs one after the other, and the way that the brush went meanwhile, in the surface's axes."""
        self._weights += weights
        self._way = self._way + way
        self.look()

    def look(self) -> bool:
        """Begin with what waits if nothing runs; whether something has come to its end since the last look. Raises what went wrong there."""
        done = self._running is not None and self._running.done()
        if done:
            self._end()
        if self._running is None and self._weights and (self._brush != "along" or self._way.any()):
            weights, way = self._weights, self._way
            self._weights, self._way = [], np.zeros(3)
            self._running = self._pool.submit(self._paint, weights, way)
        return done

    def over(self) -> bool:
        """Whether all is done, and what the easel writes is computed; call it, with ``look``, until it is."""
        if self._running is None and not self._easel.is_ready:
            self._running = self._pool.submit(self._easel.ready)
        return self._running is None

    def wait(self) -> None:
        """The same at once."""
        while True:
            self.look()
            if self.over():
                return
            self._end()

    def close(self) -> None:
        """Forget what waits, and let what runs come to its end."""
        self._weights = []
        self._pool.shutdown()
        self._running = None

    def _end(self) -> None:
        running, self._running = self._running, None
        if running is not None:
            running.result()

    def _paint(self, weights: list[np.ndarray], way: np.ndarray) -> None:
        from ...engine.spirals.dab import together
        from ...engine.spirals.painting import Stroke

        protect = self._brush == "protect"
        weight = np.max(weights, axis=0) if protect else together(weights)
        self._easel.paint(self._brush, weight, Stroke(self._inverted, None if protect else way))
