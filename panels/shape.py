"""The section *Shape*: optimise the spirals so that the piece takes the target's shape, or change them by hand."""

from __future__ import annotations

from typing import Any

import bpy

from ..bridge.hosts import background, live
from ..bridge.store import equilibrium, fields, handles
from ..bridge.store.i18n import format_range
from ..bridge.view import history_plot, paint_session
from ..engine.extras import registry
from ..engine.figures import format_figure
from .rows import (
    add_settings,
    button,
    decimals,
    labelled_row,
    menu,
    popover,
    results_box,
    setting_row,
    settings_row,
    tr,
)
from .stages import read_stages, results_column

PLOT_SIZE = 5.0  # size of the plot of an optimisation's progress, in rows


def draw(body: Any, context: bpy.types.Context) -> None:
    obj = context.object
    settings, blocks = obj.flexmaps, read_stages(context).blocks
    column = body.column(align=True)
    settings_row(column, tr("Arm width"), settings.spiral, "width_min", "width_max")
    setting_row(column, settings.optimise, "arms", tr("Arms"))
    row = body.row(align=True)
    button(row, "flexmaps.fit", tr("Make it fit"), "SHADERFX")
    row.menu("FLEXMAPS_MT_steps", text="", icon="DOWNARROW_HLT")
    if registry.has("live"):
        row.separator()
        following = live.current_watcher()
        own = following is not None and following.uid == obj.session_uid
        button(row, "flexmaps.live", tr("Live"), "PAUSE" if own else "PLAY", depress=own)
    row = body.row(align=True)
    in_hand = paint_session.is_brush_active(context)
    button(row, "flexmaps.pick_brush", tr("Brush"), "BRUSH_DATA", depress=in_hand)
    row.separator()
    button(row, "flexmaps.use_handles", tr("Handles"), "GIZMO")
    if any(name in obj.data.attributes for name in handles.PREFIXED.values()):
        row.operator("flexmaps.clear_handles", text="", icon="X")
    if in_hand:
        _draw_brush(body.column(align=True), context)
    running = background.current_job()
    history = getattr(running.intermediate, "history", None) if running is not None else None
    if history:
        _draw_search(body, history)
    elif "spirals" in blocks:
        _draw_results(body, context)


def _draw_brush(column: Any, context: bpy.types.Context) -> None:
    """Draw the brush's settings while it is the active tool."""
    brush = context.window_manager.flexmaps_brush
    setting_row(column, brush, "brush", tr("Paints"))
    for name, label in (("size", tr("Size")), ("strength", tr("Strength"))):
        setting_row(column, brush, name, label).prop(brush, f"pressure_{name}", text="", icon="STYLUS_PRESSURE")
    row = labelled_row(column, "")
    row.prop(brush, "mirror", text=tr("Mirror X"), toggle=True, translate=False)
    row.popover("FLEXMAPS_PT_paint_from", text=tr("From"), translate=False)
    marked = fields.count_protected(context.object)
    if marked:
        row = labelled_row(column, tr("Protected"))
        row.label(text=str(marked), icon="LOCKED", translate=False)
        row.operator("flexmaps.unprotect", text="", icon="X")


def _draw_search(body: Any, history: Any) -> None:
    """Draw a plot of the distance to the target over the steps of the running optimisation.

    ``history`` lists (seconds, distance in metres) for every step.
    """
    seconds, distance = history[-1]
    row = body.box().row()
    row.template_icon(icon_value=history_plot.icon_number([away for _, away in history]), scale=PLOT_SIZE)
    column = row.column(align=True)
    column.separator(factor=2.0)  # centres the text beside the plot
    for text in (tr("Step {}", len(history) - 1), f"{seconds:.1f} s", tr("Distance {}", f"{1e3 * distance:.3g} mm")):
        column.label(text=text, translate=False)


def _draw_results(body: Any, context: bpy.types.Context) -> None:
    """Draw sliders between the target and each simulated shape, and the box of results."""
    rows: list[Any] = []
    stored = results_column(body, context, "equilibrium")
    if stored is not None:
        layout, block = stored
        for key in equilibrium.simulated_keys(context.object.data):
            name = (
                tr("result")
                if key.name == equilibrium.EQUILIBRIUM_KEY
                else tr("other shape {}", key.name.rpartition(" ")[2])
            )
            layout.prop(key, "value", text=tr("Target to {}", name), slider=True, translate=False)
        mean, most = (
            f"{format_figure(block[f'{kind}_percent'])} %, {format_figure(block[f'{kind}_mm'])} mm"
            for kind in ("rms", "max")
        )
        rows = [(tr("Distance, mean"), mean, not equilibrium.is_reliable(block)), (tr("Distance, largest"), most)]
        if block.get("strain_share_max") is not None:
            share = tr("{} % of limit", f"{100 * block['strain_share_max']:.0f}")
            rows.append((tr("Strain, largest"), share, equilibrium.is_overstrained(block)))
        if "fillet_strain_share_max" in block:
            share = tr("about {} % of limit", f"{100 * block['fillet_strain_share_max']:.0f}")
            rows.append((tr("Strain at fillets"), share))
        for number, energy in enumerate(block.get("other_energies", ()), 1):
            more = 100 * (energy / block["energy"] - 1) if block["energy"] else 0.0
            sign = "+" if more > 0.0 and format_figure(more) != "0" else ""
            rows.append((tr("Energy, other shape {}", number), f"{sign}{format_figure(more)} %"))
    searched = read_stages(context).blocks.get("optimise", {})
    if "wished_mm" in searched:
        arrow = "{:.3g} \N{RIGHTWARDS ARROW} {:.3g} mm"
        rows.append((tr("From drag targets"), arrow.format(searched["wished_mm_before"], searched["wished_mm"])))
    stored = stored or results_column(body, context, "spirals")
    layout, block = body if stored is None else stored[0], read_stages(context).blocks["spirals"]
    if "slot_min_mm" in block:  # measured on finished outlines, so missing after a stroke of the brush
        rows.append((tr("Narrowest gap"), decimals(block, "slot_min_mm", 2, " mm")))
    rows += [(tr(label), _span(block, name, form)) for name, label, form in RANGES if block.get(name)]
    results_box(layout, *rows)


# key in the block "spirals", label, (format of the numbers, unit)
RANGES = ("width_mm", "Arm width", (".2f", " mm")), ("twist_deg", "Twist", (".0f", "\N{DEGREE SIGN}"))


def _span(block: dict[str, Any], key: str, number_format: tuple[str, str]) -> str:
    """Format a block's entry [smallest, mean, largest] as a range; ``number_format``: format specification and unit."""
    digits, unit = number_format
    return format_range(f"{block[key][0]:{digits}}", f"{block[key][-1]:{digits}}", unit)


def heading_text(context: bpy.types.Context) -> str:
    """Return the text beside the folded section's heading: distance from the target, and strain if known."""
    block = read_stages(context).blocks.get("equilibrium", {})
    if not block:
        return ""
    text = f"{format_figure(block['rms_percent'])} %"
    share = block.get("strain_share_max")
    return text if share is None else f"{text}, {tr('strain {}', f'{100 * share:.0f} %')}"


# -- popovers and menus ------------------------------------------------------------------------------------------------


def _draw_options(layout: Any, settings: Any) -> None:
    add_settings(layout, settings.spiral, "twist_min", "twist_max", "clockwise", "grain")
    layout.separator()
    add_settings(layout, settings.optimise, "lies", "urge", "smoothness", "open_slots", "codesign")


def _draw_paint_from(layout: Any, settings: Any) -> None:
    brush = bpy.context.window_manager.flexmaps_brush
    layout.prop(brush, "source", icon="GROUP_VERTEX")
    layout.prop(brush, "what")
    if brush.what == "along":
        layout.row(align=True).prop(brush, "direction", expand=True)
    making = button(layout, "flexmaps.paint_from", tr("Paint from it"), "IMPORT")
    making.source, making.what, making.direction = brush.source, brush.what, brush.direction


def _draw_steps_menu(layout: Any, context: bpy.types.Context) -> None:
    button(layout, "flexmaps.spirals", tr("Spirals only"), "FORCE_VORTEX")
    button(layout, "flexmaps.simulate", tr("Simulate only"), "PHYSICS")
    button(layout, "flexmaps.optimise", tr("Optimise from here"), "SHADERFX")
    layout.separator()
    layout.prop(context.object.flexmaps.simulate, "restarts")


CLASSES = (
    popover("shape", "Spirals and search", _draw_options),
    popover("paint_from", "From weights or colours", _draw_paint_from),
    menu("steps", "Steps", _draw_steps_menu),
)
