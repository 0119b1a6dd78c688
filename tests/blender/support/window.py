"""A window whose events are played to the operators by hand."""

from __future__ import annotations

import time
from types import SimpleNamespace
from typing import Any

import bpy

TIMER = SimpleNamespace(type="TIMER", value="NOTHING")

ESCAPE = SimpleNamespace(type="ESC", value="PRESS")

MOUSE = SimpleNamespace(type="MOUSEMOVE", value="NOTHING")


class Manager:
    """A window manager that notes what is asked of it."""

    def __init__(self) -> None:
        self.timers: list[Any] = []
        self.handlers: list[Any] = []
        self.cursor: list[float] = []
        self.windows: list[Any] = []

    def event_timer_add(self, step: float, window: Any) -> Any:
        self.timers.append(object())
        return self.timers[-1]

    def event_timer_remove(self, timer: Any) -> None:
        self.timers.remove(timer)

    def modal_handler_add(self, operator: Any) -> None:
        self.handlers.append(operator)

    def progress_begin(self, low: float, high: float) -> None:
        self.cursor = [low]

    def progress_update(self, value: float) -> None:
        self.cursor.append(value)

    def progress_end(self) -> None:
        self.cursor = []


class Window:
    """A context as a window has it, around Blender's own data."""

    def __init__(self) -> None:
        self.window_manager = Manager()
        self.window = None
        self.status: list[str | None] = []
        self.workspace = SimpleNamespace(status_text_set=self.status.append)

    def __getattr__(self, name: str) -> Any:
        return getattr(bpy.context, name)


def drive(operator: Any, window: Window) -> set[str]:
    """Timer ticks until the operator ends; what takes a second on a free machine may take a minute on a busy one."""
    until = time.monotonic() + 120.0
    while time.monotonic() < until:
        result = operator.modal(window, TIMER)
        if result != {"PASS_THROUGH"}:
            return result
        time.sleep(0.01)
    raise AssertionError("the job does not end")


def clean(window: Window) -> bool:
    return not window.window_manager.timers and not window.window_manager.cursor and window.status[-1] is None
