"""Strips of panels by spyrrow: whether sets of panels lie on a sheet, of which several are tried at once, and the shortest strip of one.

A set lies on a sheet if spyrrow's strip of it is no longer than the sheet.
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
from .process import Strip, Worker

STEP = 5.0  # degrees between the directions in which a panel is tried
BAY = 0.012  # metres; bays narrower than twice this are closed, and those narrower than half of the narrowest panel
CORNERS = 120  # of an outline; with 80 strips of five sheets' panels are 1.5 % longer after 4 s, with 60 they are 2.6 %
# metres and corners of the outlines with which a set is tried again that just does not fit; they cover 3 to 4 % less
FINE_BAY, FINE_CORNERS = 0.006, 240
ROUNDING = 2e-5  # metres added to the spacing, for spyrrow reckons with single precision
TURN = 1  # seconds for one set of panels at first
GRACE = 1.0  # seconds that spyrrow may take longer than it was told; it is stopped then, and the best that it told of counts
# by how much a strip may be too long for fine outlines to be worth a try, and the time limit over the seconds for it
NEAR, FINE = 1.03, 12.0
FINE_SECONDS = 1  # least for fine outlines of all panels of a sheet; not measured, it bounds the time
# a strip that is so much too long after half of its time hardly becomes short enough: of 14 sets of 2 to 6 panels none came down by as
# much after the first half second
HOPELESS = 1.12
SHORTER = 0.999  # a strip is so many times as long as the last one at most, or it counts as no gain
# share of its time after which a strip that gains nothing is given up: of 146 sets of 13 pieces 73 instead of 78 fit, in two thirds of the time
STILL = 0.25
# starts of each core for the shortest strip of a set, if the time is long; starts differ by 4 %, and three seconds gain .3 % over one
STARTS = 4
AT_ONCE = 8  # most sets that are tried side by side; it bounds the memory


class Strips:
    """Shapes made ready for spyrrow, and processes that run it.

    shapes : closed outlines (M, 2), metres; end : of ``time.monotonic``, when the search is over
    tick : called for every shape while they are made ready; tell : called now and then with the number of panels that are being laid;
        what either raises ends the search
    simple : the shapes as spyrrow gets them, grown by half of the separation, so that they may touch
    turns : of each the degrees in which it fits on a sheet, none for one that is too large
    free, room : (2,) metres of a sheet within its margins, for the shapes and for grown ones
    count : how many sets are tried at once; seconds : for each
    answered : whether spyrrow has told of any strip, which it does not where it cannot run
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
        """From now on try sets for twice as long; whether that is worth it, which it is not for the usual few seconds in all."""
        self.seconds *= 2
        return self.seconds <= self.params.nesting_seconds / FINE

    def finish(self) -> None:
        """End what still runs."""
        self._over.set()
        for worker in self._workers:
            worker.stop()
        self._threads.shutdown()

    def _turns(self, shape: np.ndarray) -> list[float]:
        base = np.degrees(lying_box(shape, self.params.rotation)[0])
        step = {"FREE": STEP, "QUARTER": 90.0, "GRAIN": 180.0}[self.params.rotation]
        angles = base + np.arange(0.0, 360.0, step)
        turn = turn_that_fits(shape, tuple(self.room), 0.0, self.params.rotation)
        if turn is not None:
            angles = np.concatenate([angles, np.degrees(turn) + np.array([0.0, 180.0])])
        wide, high = self._sizes(shape, angles)
        return angles[(wide <= self.room[0]) & (high <= self.room[1])].tolist()

    def alone(self, i: int) -> tuple[float, float]:
        """The degrees by which a panel is turned that takes the least of a sheet's width, and metres of it."""
        wide = self._sizes(self.simple[i], np.array(self.turns[i]))[0]
        best = int(wide.argmin())
        return self.turns[i][best], float(wide[best]) - self.separation

    @staticmethod
    def _sizes(shape: np.ndarray, degrees: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Width and height, metres, of a shape once it is turned by each of some angles."""
        cos, sin = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
        wide = np.ptp(shape[:, :1] * cos - shape[:, 1:] * sin, axis=0)
        return wide, np.ptp(shape[:, :1] * sin + shape[:, 1:] * cos, axis=0)

    def on_a_sheet(self, sets: Sequence[frozenset[int]]) -> dict[frozenset[int], Strip | None]:
        """The shortest strip that is found of each of some sets of panels, None where there is none.

        Once one is no longer than a sheet, those after it are given up and are not in the answer.
        """
        stops = [Event() for _ in sets]
        futures = [self._threads.submit(self._placed, members, stop) for members, stop in zip(sets, stops, strict=True)]
        self._wait(futures, stops, max(map(len, sets), default=0))
        return {
            members: future.result()
            for members, future, stop in zip(sets, futures, stops, strict=True)
            if not stop.is_set() or self.fits(future.result())
        }

    def fits(self, strip: Strip | None) -> bool:
        """Whether there is a strip and it is no longer than a sheet."""
        return strip is not None and strip.width <= float(self.free[0])

    def shortest(self, members: frozenset[int], seconds: int, fine: bool = False) -> Strip | None:
        """As short a strip of some panels as is found in some seconds by all cores, which begins at 0; by the simple or the fine outlines.

        Every core begins anew again and again, for strips of several starts differ by more than a longer search gains.
        """
        end, stops = time.monotonic() + seconds, [Event() for _ in range(self.count)]
        turn = max(TURN, seconds // STARTS)
        futures = [self._threads.submit(self._drawn, members, end, turn, stop, k, fine) for k, stop in enumerate(stops)]
        self._wait(futures, stops, len(members), one=False)
        found = (future.result() for future in futures)
        return min((strip for strip in found if strip is not None), key=lambda strip: strip.width, default=None)

    def _drawn(
        self, members: frozenset[int], end: float, turn: int, stop: Event, start: int, fine: bool
    ) -> Strip | None:
        """The shortest strip of some starts, a turn in seconds for each, as long as there is time and one more gains."""
        shapes, best, gained = self._finer(members) if fine else self.simple, None, True
        while gained and (best is None or time.monotonic() + turn <= end) and not stop.is_set():
            found = self._solve(members, 0.0, turn, stop, shapes, start=start)
            gained = found is not None and (best is None or found.width < SHORTER * best.width)
            best, start = found if gained else best, start + self.count
        return best

    def _wait(
        self, futures: Sequence[Future[Strip | None]], stops: Sequence[Event], panels: int, one: bool = True
    ) -> None:
        """Wait until all are done, or, if one is enough, until all before the first that fits are; when the user wants to stop, end them."""
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

    def _placed(self, members: frozenset[int], stop: Event) -> Strip | None:
        """Panels on one sheet, by coarse outlines or, where those just do not fit, by fine ones."""
        length, fine = float(self.free[0]), int(self.params.nesting_seconds / FINE)
        found = self._solve(
            members, length, max(self._within(self.seconds), TURN), stop, self.simple, HOPELESS * length
        )
        seconds = self._within(max(fine, self.seconds)) if fine else 0
        if found is not None and length < found.width <= NEAR * length and seconds and not stop.is_set():
            found = self._solve(members, length, seconds, stop, self._finer(members))
        return found

    def _within(self, seconds: int) -> int:
        """So many seconds, or as many whole ones as are left."""
        return max(min(seconds, int(self.end - time.monotonic())), 0)

    def _finer(self, members: frozenset[int]) -> dict[int, np.ndarray]:
        """Finer outlines of some panels among those of others."""
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
    ) -> Strip | None:
        """spyrrow's shortest feasible strip for some panels, which begins at 0; ``None`` without one.

        It ends once a strip is short ``enough``, or longer than ``hopeless`` after half of its time; both in metres. And once strips
        have not become shorter for ``STILL`` of its time.
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
        return Strip(best.width - self.separation, places)
