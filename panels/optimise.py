"""Rows of the Optimise panel: while it runs, and what it found."""

from __future__ import annotations

from typing import Any

import bpy

from ..bridge import equilibrium, job, notes, plot
from ..engine.params import OptimiseParams
from .rows import choice_row, more, number, numbers, wrapped

PLOT = 8.0  # size of the plot, in rows


def rows(layout: bpy.types.UILayout, context: bpy.types.Context, obj: bpy.types.Object) -> None:
    """Settings, button, and the last result."""
    more(layout, "flexmaps_optimise", obj.flexmaps.optimise, OptimiseParams)
    running = job.current()
    history = getattr(running.shown, "history", None) if running is not None else None
    if history:
        seconds, rmse = history[-1]
        _progress(layout, [r for _, r in history], f"Step {len(history) - 1}", 1e3 * rmse, seconds)
        return
    layout.operator("flexmaps.optimise", icon="SHADERFX")
    blocks = notes.read(obj.data)
    if "optimise" in blocks:
        if equilibrium.out_of_date(obj, context.scene, "optimise"):
            text = "The mesh or a setting was changed since; press Optimise to go on from here"
            wrapped(layout, context, text, icon="INFO")
        else:
            _found(layout, blocks["optimise"])
    if "reach" in blocks and not equilibrium.out_of_date(obj, context.scene):
        _limits(layout, context, blocks["reach"])


def _progress(layout: Any, rmse: list[float], step: str, now: float, seconds: float) -> None:
    """The plot, and what it says in numbers; RMSE in millimetres."""
    row = layout.box().row()
    row.template_icon(icon_value=plot.icon(rmse), scale=PLOT)
    column = row.column(align=True)
    column.separator(factor=3.0)  # about the plot's middle
    column.label(text=step)
    column.label(text=f"{seconds:.1f} s")
    column.separator()
    column.label(text="RMSE")
    column.label(text=f"{now:.3g} mm")


def _found(layout: Any, block: dict[str, Any]) -> None:
    history = block["history"]
    before, after = block["laplacian_rmse_mm_before"], block["laplacian_rmse_mm"]
    if history:
        rmse = [before, *(row["rmse_mm"] for row in history)]
        _progress(layout, rmse, f"{len(history)} steps", after, history[-1]["seconds"])
    grid = numbers(layout)
    number(grid, "Finished" if block["finished"] else "Stopped", "" if block["finished"] else "press again to go on")
    number(grid, "RMSE before", f"{before:.3g} mm")
    number(grid, "RMSE now", f"{after:.3g} mm")
    number(grid, "RMS distance", f"{block['rms_percent']:.2f} %")
    number(grid, "Largest distance", f"{block['max_percent']:.2f} %")
    number(grid, "Widths, twists at a bound", f"{100 * block['at_bound']:.0f} %")
    number(grid, "Steps refused", f"{block['rejected'] + block['unstable']}, {block['unstable']} unstable")


def _limits(layout: Any, context: bpy.types.Context, block: dict[str, Any]) -> None:
    """What keeps the shape from its target, with the button that shows where."""
    wrapped(layout.box(), context, block["advice"], icon="INFO")
    choice_row(
        layout,
        context.window_manager,
        "flexmaps_overlay",
        (("REACH", "Limits"), ("WIDTH", "Width"), ("TWIST", "Twist")),
    )
