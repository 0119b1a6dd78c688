"""Show a job's progress in the status bar, the cursor and the sidebar, and decide when to redraw."""

from __future__ import annotations

from typing import Any, Protocol

import bpy

from ..store.i18n import button_name, translate

MIN_INTERVAL = 0.2  # shortest time between two redraws of the progress, seconds; smaller is smoother and slower; by eye
# largest fraction of the time spent on redrawing; larger is smoother and slows the job down, above all without a
# graphics card
MAX_SHARE = 0.1


class RunningJob(Protocol):
    """Interface of ``background.Job`` that the sidebar and the status bar use."""

    title: str
    on_stop: str
    fraction: float
    text: str
    displayed: tuple[float, str] | None
    intermediate: Any

    @property
    def time_left(self) -> str: ...

    @property
    def is_stopping(self) -> bool: ...


class RedrawPacer:
    """Decide when to redraw the progress: the longer the last redraw took, the later the next one.

    Blender draws before it sends the next timer event, so the delay until this event is taken as the drawing time.
    """

    def __init__(self) -> None:
        self._asked: float | None = None
        self._next = 0.0

    def is_due(self, now: float) -> bool:
        """Return whether to redraw now; call it at every timer event, and redraw if it returns True.

        ``now`` is the time in seconds of any steady clock.
        """
        if self._asked is not None:
            self._next = self._asked + max(MIN_INTERVAL, (now - self._asked) / MAX_SHARE)
            self._asked = None
        if now < self._next:
            return False
        self._asked = now
        return True


def show_progress(context: bpy.types.Context, running: RunningJob) -> None:
    """Show a job's progress in status bar, cursor and sidebar; redraw the 3D views if the job shows a shape.

    Parameters
    ----------
    context : Blender's context
    running : the job, a ``background.Job``
    """
    running.displayed = running.fraction, running.text
    context.window_manager.progress_update(int(100 * running.fraction))
    if context.workspace is not None:
        context.workspace.status_text_set(progress_line(running) + "    " + translate("ESC: stop"))
    redraw(context, "UI" if running.intermediate is None else "")


def progress_line(running: RunningJob) -> str:
    if running.is_stopping:
        return translate("{}: stopping", button_name(running.title))
    fraction, text = progress_to_show(running)
    line = f"{button_name(running.title)}: {100 * fraction:.0f} % {text}".rstrip()
    return f"{line}, {translate('about {} left', running.time_left)}" if running.time_left else line


def progress_to_show(running: RunningJob) -> tuple[float, str]:
    """Return the fraction done and the step, as the status bar shows them.

    The sidebar is also drawn between two updates of the status bar, and must not be ahead of it.
    """
    return running.displayed or (running.fraction, running.text)


def redraw(context: bpy.types.Context, kind: str = "") -> None:
    """Redraw all 3D views, or only their regions of a type.

    Parameters
    ----------
    context : Blender's context
    kind : type of region, such as "UI" for the sidebar; "" for all
    """
    for window in context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                for region in area.regions:
                    if kind in {"", region.type}:
                        region.tag_redraw()
