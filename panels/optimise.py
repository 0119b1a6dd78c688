"""The Optimise panel: while it runs, and what it found."""

from __future__ import annotations

from typing import Any

import bpy
from bpy.app.translations import pgettext_iface as iface_

from ..bridge.hosts import background
from ..bridge.store import advice, equilibrium, notes, states
from ..bridge.view import plot
from ..engine.optimisation import remedies
from ..engine.params import OptimiseParams
from .rows import choice_row, first_that_fits, fold, more, number, numbers, settings_rows, wrapped
from .stages import StagePanel, button, look, result

ALWAYS = ("arms", "lies")  # what is always in sight
PLOT = 8.0  # size of the plot, in rows


class OptimisePanel(StagePanel, bpy.types.Panel):
    bl_idname = "FLEXMAPS_PT_optimise"
    bl_label = "Optimise"
    stage = "optimise"

    def draw(self, context: bpy.types.Context) -> None:
        layout, obj = self.layout, context.object
        running = background.current()
        history = getattr(running.shown, "history", None) if running is not None else None
        if history:
            seconds, rmse = history[-1]
            step = iface_("Step {}").format(len(history) - 1)
            _progress(layout, [r for _, r in history], step, 1e3 * rmse, seconds)
            return
        settings_rows(layout, obj.flexmaps.optimise, OptimiseParams, ALWAYS)
        button(layout, context, "flexmaps.optimise", icon="SHADERFX")
        more(layout, "flexmaps_optimise", obj.flexmaps.optimise, OptimiseParams, ALWAYS)
        blocks = notes.read(obj.data)
        if "optimise" in blocks:
            _found(result(layout, context, "optimise"), context, blocks["optimise"])
        if "reach" in blocks and look(context).states["reach"].kind == states.DONE:
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


def _found(layout: Any, context: bpy.types.Context, block: dict[str, Any]) -> None:
    history = block["history"]
    before, after = block["laplacian_rmse_mm_before"], block["laplacian_rmse_mm"]
    if history:
        rmse = [before, *(row["rmse_mm"] for row in history)]
        _progress(layout, rmse, iface_("{} steps").format(len(history)), after, history[-1]["seconds"])
    grid = numbers(layout)
    if not block["finished"]:
        number(grid, "Stopped", iface_("press again to go on"))
    number(grid, "RMSE before", f"{before:.3g} mm")
    number(grid, "RMSE now", f"{after:.3g} mm")
    number(grid, "RMS distance", f"{block['rms_percent']:.2f} %")
    if "wished_mm" in block:
        number(grid, "From wishes", f"{block['wished_mm_before']:.3g} \N{RIGHTWARDS ARROW} {block['wished_mm']:.3g} mm")
    if block.get("wish"):
        wrapped(layout, context, block["wish"], icon="INFO")
    strain = block.get("strain_share_max")
    if strain is not None:
        number(
            grid, "Largest strain", iface_("{:.0f} % of limit").format(100 * strain), alert=equilibrium.strained(block)
        )
    if "end" in block and block["finished"]:
        wrapped(layout, context, block["end"])
    rest = fold(layout, "flexmaps_optimise_rest", "More figures")
    if rest is not None:
        number(rest, "Largest distance", f"{block['max_percent']:.2f} %")
        number(rest, "At a bound", f"{100 * block['at_bound']:.0f} %")
        refused = iface_("{}, {} unstable").format(block["rejected"] + block["unstable"], block["unstable"])
        number(rest, "Steps refused", refused)


def _limits(layout: Any, context: bpy.types.Context, block: dict[str, Any]) -> None:
    """What keeps the shape from its target, with the buttons that do what is advised and those that show where."""
    wrapped(layout.box(), context, block["advice"], icon="INFO")
    if advice.BROUGHT in block:
        wrapped(layout, context, advice.said(block[advice.BROUGHT]), icon="CHECKMARK")
    _remedies(layout, context, remedies.of_block(block))
    choice_row(
        layout,
        context.window_manager,
        "flexmaps_overlay",
        (("REACH", "Limits"), ("WIDTH", "Width"), ("ANISOTROPY", "Anisotropy"), ("TWIST", "Twist")),
    )


def _remedies(layout: Any, context: bpy.types.Context, advised: remedies.Amounts) -> None:
    """A button for everything that is advised, which says how much of it is done."""
    column = layout.column(align=True)
    for name, amount in advised.items():
        if name == remedies.CUT:
            button(column, context, "flexmaps.cut_there", icon="MOD_EDGESPLIT")
        elif name == remedies.LARGER:
            text = iface_("Larger: {:g} times").format(amount)
            button(column, context, "flexmaps.make_larger", text=text, translate=False, icon="FULLSCREEN_ENTER")
        elif name == remedies.THINNER:
            now = context.object.flexmaps.spiral.thickness
            whole = iface_("Sheet of {:g} mm instead of {:g} mm").format(amount, now)
            text = first_that_fits(whole, iface_("Sheet of {:g} mm").format(amount))
            button(column, context, "flexmaps.make_thinner", text=text, translate=False, icon="MOD_SOLIDIFY")
        elif name == remedies.FINER:
            text = iface_("Finer: {} quads").format(amount)
            button(column, context, "flexmaps.make_finer", text=text, translate=False, icon="MOD_REMESH")
