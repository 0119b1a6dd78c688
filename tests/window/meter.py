"""Runs inside a real Blender with a window: how long the window's thread does not answer, and when progress is seen."""

import time

import bpy
import numpy as np

STEP = 0.01


class Meter:
    """Ticks every 10 ms as long as Blender is free to; a longer pause is time in which no click would be answered."""

    def __init__(self, looks_like_progress):
        self.gaps, self.busy = [], []
        self.first_sight = None
        self._sees, self._going = looks_like_progress, True
        self._last, self._cpu = time.perf_counter(), time.thread_time()
        bpy.app.timers.register(self._tick, first_interval=STEP)

    def _tick(self):
        now, cpu = time.perf_counter(), time.thread_time()
        self.gaps.append(now - self._last)
        self.busy.append(cpu - self._cpu)
        if self.first_sight is None and self._sees():
            self.first_sight = time.perf_counter()
        self._last, self._cpu = time.perf_counter(), time.thread_time()
        return STEP if self._going else None

    def stop(self):
        self._going = False

    def figures(self, pressed):
        """Milliseconds: the longest pause, most work of the thread itself between two ticks, and the first sight.

        Where windows are drawn by software, most of a pause is waiting for that; it is no work of this thread.
        """
        gaps = 1e3 * np.array(self.gaps or [0.0])
        worst = int(gaps.argmax())
        return {
            "blocked_ms": round(float(gaps[worst]), 1),
            "at_work_ms": round(1e3 * max(self.busy, default=0.0), 1),
            "blocked_99_percent_ms": round(float(np.percentile(gaps, 99)), 1),
            "over_100_ms": int((gaps > 100).sum()),
            "ticks": len(gaps),
            "first_progress_ms": None if self.first_sight is None else round(1e3 * (self.first_sight - pressed), 1),
        }
