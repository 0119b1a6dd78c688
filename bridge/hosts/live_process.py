"""A process beside Blender that computes the equilibrium of a live piece.

It always works on the newest input and drops older ones, so that neither a queue nor a blocked window arises.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

from ...engine.errors import Cancelled, FlexMapsError
from ...engine.extras.live.live_input import LiveInput
from ...engine.extras.live.live_piece import LiveEquilibrium
from ...engine.extras.live.session import LiveRequest, step_piece
from ...engine.mechanics.assembly import Pose
from ...engine.workers import Workers

MAX_ATTEMPTS = 2  # attempts to compute a shape if the process ends and loses the piece; more attempts delay the error


class LiveProcess:
    """Handle of the process and of the thread that talks to it.

    Call ``follow`` with each new input; ``latest`` is the newest shape with the picture to draw.

    Parameters
    ----------
    make_picture : function that makes the picture of a shape; called in this class's thread
    """

    def __init__(self, make_picture: Callable[[LiveEquilibrium], Any]):
        self.latest: tuple[LiveEquilibrium, Any] | None = None
        self.answer_count = 0  # number of shapes received so far
        self.error = ""
        self._make_picture = make_picture
        self._workers = Workers(1)
        self._change = threading.Condition()
        self._wanted: LiveInput | None = None
        self._start: Pose | None = None
        self._sent: LiveInput | None = None
        self._resting, self._closed = True, False
        self._thread = threading.Thread(target=self._run, name="FlexMaps live", daemon=True)
        self._thread.start()

    @property
    def is_resting(self) -> bool:
        """Return whether the newest input's shape is computed, so that it moves no further."""
        with self._change:
            return self._resting and self._wanted is self._sent

    def follow(self, state: LiveInput, start: Pose | None = None) -> None:
        """Replace the input.

        Parameters
        ----------
        state : newest input of the piece
        start : equilibrium pose from which a new piece starts, if known
        """
        with self._change:
            self._wanted, self._start = state, start
            self._change.notify()

    def close(self) -> None:
        """End the process at once."""
        with self._change:
            self._closed = True
            self._change.notify()
        self._workers.shutdown(cancel_futures=True)
        self._thread.join()

    def _run(self) -> None:
        try:
            while self._next():
                pass
        except Cancelled:
            pass
        except Exception as error:
            with self._change:
                # add the type of unexpected errors, which helps to debug them
                self.error = str(error) if isinstance(error, FlexMapsError) else f"{type(error).__name__}: {error}"
                self._resting, self._sent = True, self._wanted

    def _next(self) -> bool:
        """Wait for work, then compute one shape; return False when the process is closed."""
        with self._change:
            self._change.wait_for(lambda: self._closed or not self._resting or self._wanted is not self._sent)
            if self._closed:
                return False
            state, start = self._wanted, self._start
        assert state is not None
        shape = self._compute_shape(state, start)
        drawn = self._make_picture(shape)
        with self._change:
            self._sent, self._resting = state, shape.resting
            self.latest, self.answer_count = (shape, drawn), self.answer_count + 1
        return not self._closed

    def _compute_shape(self, state: LiveInput, start: Pose | None) -> LiveEquilibrium:
        for _ in range(MAX_ATTEMPTS):
            whole = self._sent is None
            changes = None if state is self._sent else state.changes(self._sent)
            shape: LiveEquilibrium | None = self._workers.submit(
                step_piece, LiveRequest("piece", changes, whole, start)
            ).result()
            if shape is not None:
                return shape
            self._sent = None  # the process ended and lost the piece: send the whole input next
        raise FlexMapsError("Live stopped: its background process ended twice; switch Live off and on again")
