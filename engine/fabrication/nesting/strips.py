"""Packing of sets of panels into strips with spyrrow, several sets at once, and the shortest strip of one set.

A set fits on a sheet if its strip is no longer than the sheet.
"""

from __future__ import annotations

import queue
import time
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, wait
from threading import Event, Lock

import numpy as np

from ...arrays import Float
from ...params import SheetParams
from ...workers import WAIT, cores
from .outlines import grown
from .packing import least_box, lying_box, turn_that_fits
from .process import PackedStrip, Worker

STEP = 5.0  # degrees between the orientations tried for a panel
BAY = 0.012  # metres; bays narrower than twice this, or than half of the narrowest panel, are closed
# corners per outline; strips of the panels of five sheets are 1.5 % longer with 80 after 4 s, 2.6 % with 60
CORNERS = 120
# metres and corners per outline for the second attempt at a set that only just does not fit; finer outlines cover 3 to
# 4 % less
FINE_BAY, FINE_CORNERS = 0.006, 240
ROUNDING = 2e-5  # metres added to the spacing because spyrrow calculates in single precision
TURN = 1  # seconds for one set of panels in the first pass
GRACE = 1.0  # seconds that spyrrow may exceed its limit before it is stopped with its best strip so far
# Try fine outlines if the strip is at most ``NEAR_FIT`` times as long as the sheet, for 1 / ``FINE`` of the time limit
NEAR_FIT, FINE = 1.03, 12.0
# minimum time in seconds for compacting a whole sheet with fine outlines; with less time left it is skipped; not
# measured
FINE_SECONDS = 1
# Give up a set whose strip is this many times as long as the sheet after half of its time: of 14 sets of 2 to 6 panels
# none shrank by as much after the first half second
HOPELESS = 1.12
SHORTER = 0.999  # an improved strip is at most this many times as long as the last one
# Share of its time after which a strip without improvement is given up: of 146 sets of 13 pieces 73 instead of 78 fit,
# in two thirds of the time
STILL = 0.25
# Starts per core for the shortest strip of a set if time allows; starts differ by 4 %, and three seconds gain 0.3 %
# over one
STARTS = 4
AT_ONCE = 8  # maximum number of sets tried in parallel; it bounds the memory


class Strips:
    """Shapes prepared for spyrrow, and the processes that run it.

    shapes : closed outlines (M, 2), metres
    end : value of ``time.monotonic`` at which the search ends
    tick : called for every shape during preparation
    tell : called repeatedly with the number of panels being laid; an exception raised by ``tick`` or ``tell`` ends the
        search
    simple : simplified shapes grown by half of the separation, so that they may touch
    turns : for each shape the angles in degrees in which it fits on a sheet; none if it is too large
    free, room : (2,) metres of a sheet within its margins, for the shapes and for the grown shapes
    count : number of sets tried at once
    seconds : time per set
    answered : whether spyrrow has returned any strip; it returns none where it cannot run
    """

    def __init__(
        self,
        shapes: list[Float[np.ndarray, "_ 2"]],
        params: SheetParams,
        end: float,
        tick: Callable[[], None],
        tell: Callable[[int], None],
    ):
        self.end, self.answered = end, False
        self.shapes, self.params, self.tell = shapes, params, tell
        self.free = np.array([params.sheet_width, params.sheet_height]) - 2.0 * params.margin
        self.separation = params.spacing + ROUNDING
        self.room = self.free + self.separation
        bay = min(BAY, 0.25 * min(float(least_box(s)[1].min()) for s in shapes))
        self.simple: dict[int, np.ndarray] = {}
        self.turns: list[list[float]] = []
        for i, shape in enumerate(shapes):
            tick()
            self.simple[i] = grown(shape, 0.5 * self.separation, max(bay, 0.5 * params.spacing), CORNERS)
            self.turns.append(self._turns(self.simple[i]))
        self.fine: dict[int, np.ndarray] = {}
        self.seconds = TURN
        self.count = min(cores(), AT_ONCE)
        self._workers = [Worker() for _ in range(self.count)]
        self._idle: queue.SimpleQueue[Worker] = queue.SimpleQueue()
        for worker in self._workers:
            self._idle.put(worker)
        self._threads = ThreadPoolExecutor(self.count, "FlexMaps nesting")
        self._over, self._lock = Event(), Lock()

    def harder(self) -> bool:
        """Double the time per set; return whether that is worthwhile, which it is not with the usual time limit."""
        self.seconds *= 2
        return self.seconds <= self.params.nesting_seconds / FINE

    def finish(self) -> None:
        """Stop all running work."""
        self._over.set()
        for worker in self._workers:
            worker.stop()
        self._threads.shutdown()

    def _turns(self, shape: np.ndarray) -> list[float]:
        """Return the angles in degrees in which a grown shape fits on a sheet."""
        base = np.degrees(lying_box(shape, self.params.rotation)[0])
        step = {"FREE": STEP, "QUARTER": 90.0, "GRAIN": 180.0}[self.params.rotation]
        angles = base + np.arange(0.0, 360.0, step)
        turn = turn_that_fits(shape, tuple(self.room), 0.0, self.params.rotation)
        if turn is not None:
            angles = np.concatenate([angles, np.degrees(turn) + np.array([0.0, 180.0])])
        wide, high = self._sizes(shape, angles)
        return angles[(wide <= self.room[0]) & (high <= self.room[1])].tolist()

    def alone(self, i: int) -> tuple[float, float]:
        """Return the angle in degrees at which a panel is narrowest along a strip, and its width there in metres."""
        wide = self._sizes(self.simple[i], np.array(self.turns[i]))[0]
        best = int(wide.argmin())
        return self.turns[i][best], float(wide[best]) - self.separation

    @staticmethod
    def _sizes(shape: np.ndarray, degrees: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return width and height in metres of a shape turned by each of some angles."""
        cos, sin = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
        wide = np.ptp(shape[:, :1] * cos - shape[:, 1:] * sin, axis=0)
        return wide, np.ptp(shape[:, :1] * sin + shape[:, 1:] * cos, axis=0)

    def on_a_sheet(self, sets: Sequence[frozenset[int]]) -> dict[frozenset[int], PackedStrip | None]:
        """Return the shortest strip found for each set of panels, None where there is none.

        As soon as a strip fits on a sheet, later sets are given up and left out of the result.
        """
        stops = [Event() for _ in sets]
        futures = [
            self._threads.submit(self._lay_on_one_sheet, members, stop)
            for members, stop in zip(sets, stops, strict=True)
        ]
        self._wait(futures, stops, max(map(len, sets), default=0))
        return {
            members: future.result()
            for members, future, stop in zip(sets, futures, stops, strict=True)
            if not stop.is_set() or self.fits(future.result())
        }

    def fits(self, strip: PackedStrip | None) -> bool:
        """Return whether there is a strip and it is no longer than a sheet."""
        return strip is not None and strip.width <= float(self.free[0])

    def shortest(self, members: frozenset[int], seconds: int, fine: bool = False) -> PackedStrip | None:
        """Return the shortest strip of some panels that all cores find in some seconds; it begins at 0.

        ``fine`` selects the fine outlines. Every core restarts repeatedly, because starts differ by more than a longer
        search gains.
        """
        end, stops = time.monotonic() + seconds, [Event() for _ in range(self.count)]
        turn = max(TURN, seconds // STARTS)
        futures = [
            self._threads.submit(self._best_of_starts, members, end, turn, stop, k, fine)
            for k, stop in enumerate(stops)
        ]
        self._wait(futures, stops, len(members), one=False)
        found = (future.result() for future in futures)
        return min((strip for strip in found if strip is not None), key=lambda strip: strip.width, default=None)

    def _best_of_starts(
        self, members: frozenset[int], end: float, turn: int, stop: Event, start: int, fine: bool
    ) -> PackedStrip | None:
        """Return the shortest strip of repeated starts of ``turn`` seconds while time is left and starts improve it."""
        shapes, best, gained = self._fine_outlines(members) if fine else self.simple, None, True
        while gained and (best is None or time.monotonic() + turn <= end) and not stop.is_set():
            found = self._solve(members, 0.0, turn, stop, shapes, start=start)
            gained = found is not None and (best is None or found.width < SHORTER * best.width)
            best, start = found if gained else best, start + self.count
        return best

    def _wait(
        self, futures: Sequence[Future[PackedStrip | None]], stops: Sequence[Event], panels: int, one: bool = True
    ) -> None:
        """Wait for all sets or, with ``one``, for all sets before the first that fits; stop them if the user cancels."""
        try:
            while any(not future.done() for future in futures):
                self.tell(panels)
                wait(futures, timeout=WAIT)
                found = (k for k, future in enumerate(futures) if one and future.done() and self.fits(future.result()))
                first = next(found, len(stops))
                for future, stop in zip(futures[first + 1 :], stops[first + 1 :], strict=True):
                    if not future.done():
                        stop.set()
        except BaseException:
            for stop in stops:
                stop.set()
            raise

    def _lay_on_one_sheet(self, members: frozenset[int], stop: Event) -> PackedStrip | None:
        """Return a strip of panels with simplified outlines, or with fine ones if those only just do not fit."""
        length, fine = float(self.free[0]), int(self.params.nesting_seconds / FINE)
        found = self._solve(
            members, length, max(self._at_most_left(self.seconds), TURN), stop, self.simple, HOPELESS * length
        )
        seconds = self._at_most_left(max(fine, self.seconds)) if fine else 0
        if found is not None and length < found.width <= NEAR_FIT * length and seconds and not stop.is_set():
            found = self._solve(members, length, seconds, stop, self._fine_outlines(members))
        return found

    def _at_most_left(self, seconds: int) -> int:
        """Return these seconds, or the whole seconds left if fewer."""
        return max(min(seconds, int(self.end - time.monotonic())), 0)

    def _fine_outlines(self, members: frozenset[int]) -> dict[int, np.ndarray]:
        """Return fine outlines of some panels, computed on first use."""
        with self._lock:
            for i in members - set(self.fine):
                bay = max(FINE_BAY, 0.5 * self.params.spacing)
                self.fine[i] = grown(self.shapes[i], 0.5 * self.separation, bay, FINE_CORNERS)
            return {i: self.fine[i] for i in members}

    def _solve(
        self,
        members: frozenset[int],
        enough: float,
        seconds: int,
        stop: Event,
        shapes: dict[int, np.ndarray],
        hopeless: float = np.inf,
        start: int = 0,
    ) -> PackedStrip | None:
        """Return spyrrow's shortest feasible strip for some panels, which begins at 0; None without one.

        It stops when a strip is shorter than ``enough`` metres, is longer than ``hopeless`` metres after half of its
        time, or has not improved for the share ``STILL`` of its time.
        """
        task = {
            "items": [(str(i), (shapes[i] * 1e3).tolist(), self.turns[i]) for i in sorted(members)],
            "high": float(self.room[1]) * 1e3,
            "seconds": seconds,
            "seed": self.params.seed + start,
        }
        if stop.is_set() or self._over.is_set():
            return None
        best, worker, length, mark = None, self._idle.get(), np.inf, np.inf
        begun = gained = np.inf
        try:
            for solution in worker.solutions(task, seconds + GRACE):
                now = time.monotonic()
                if solution is not None:
                    begun = min(begun, now)
                    best, length = solution, solution.width - self.separation
                    if length < SHORTER * mark:
                        mark, gained = length, now
                late = now - begun > 0.5 * seconds and length > hopeless
                stalled = now - gained > STILL * seconds
                if length <= enough or late or stalled or stop.is_set() or self._over.is_set():
                    worker.stop()
                    break
        finally:
            self._idle.put(worker)
        if best is None:
            return None
        self.answered = True
        places = {i: (turn, shift - 0.5 * self.separation) for i, (turn, shift) in best.places.items()}
        return PackedStrip(best.width - self.separation, places)
