"""The section *Workshop*: settings of the machine, the sheets, the files and the prices, which presets store."""

from __future__ import annotations

from typing import Any

import bpy

from ..bridge.store import presets
from ..bridge.view.tab import WORKSHOP_ITEMS
from ..engine.extras import registry
from .rows import button, setting_row, settings_row, tr

# tab -> rows: label, then "section.name" of one or two settings
SETTING_ROWS: dict[str, tuple[tuple[str, ...], ...]] = {
    "CUT": (
        ("Kerf, inside", "cut.kerf_outline", "cut.kerf_holes"),
        ("Mill", "cut.mill"),
        ("Lead-in", "cut.lead_in"),
        ("Tabs", "cut.tabs", "cut.tab_width"),
        ("Gap, at seams", "spiral.slot_min", "spiral.slot_seam"),
        ("Fillet", "spiral.fillet"),
        ("Nozzle", "cut.nozzle"),
    ),
    "JOINTS": (
        ("Connectors", "connect.connector"),
        ("Clearance", "connect.clearance"),
        ("Neck", "connect.neck"),
        ("Thinnest part", "connect.thinnest"),
        ("Rounding", "connect.rounding"),
    ),
    "SHEET": (
        ("Margin, space", "sheet.margin", "sheet.spacing"),
        ("Turn panels", "sheet.rotation"),
        ("Nesting", "sheet.nesting"),
        ("Too large", "sheet.oversize"),
        ("Offcuts in", "sheet.remnant_unit"),
        ("Many sheets", "sheet.many_sheets"),
    ),
    "FILES": (
        ("DXF", "export.dxf"),
        ("Solids", "export.solids"),
        ("SVG in", "cut.svg_unit"),
        ("SVG lines", "cut.line_width"),
        ("Labels", "sheet.labels"),
        ("Letters", "sheet.label_min", "sheet.label_height"),
        ("Sheet outline", "sheet.frame"),
    ),
    "PRICE": (
        ("A sheet", "cost.sheet_price"),
        ("Machine hour", "cost.machine_rate"),
        ("Labour hour", "cost.labour_rate"),
    ),
}
# settings of the solvers, shown in the tab SOLVER: section -> names
SOLVER_SETTINGS = {
    "regularise": ("iterations",),
    "spiral": ("blend", "curvature_top"),
    "simulate": ("model", "iterations", "tolerance"),
    "optimise": (
        "iterations", "restart", "distortion_limit", "strain_share", "patience", "stop",
    ),
    "sheet": ("tolerance", "nesting_seconds", "seed"),
}  # fmt: skip


def draw(body: Any, context: bpy.types.Context) -> None:
    tab, wanted = context.window_manager.flexmaps_tab, context.object.flexmaps
    row = body.row(align=True)
    for kind, *_ in WORKSHOP_ITEMS:
        if kind != "SOLVER" or shows_expert_settings(context):
            row.prop_enum(tab, "habits", kind)
    column = body.column(align=True)
    for label, *names in SETTING_ROWS.get(tab.habits, ()):
        section, _, _ = names[0].partition(".")
        shorts = [name.partition(".")[2] for name in names]
        owner = getattr(wanted, section)
        if len(shorts) > 1:
            settings_row(column, tr(label), owner, *shorts)
        else:
            setting_row(column, owner, shorts[0], tr(label))
    if tab.habits == "SOLVER":
        for section, named in SOLVER_SETTINGS.items():
            for name in named:
                column.prop(getattr(wanted, section), name)
    if tab.habits == "CUT" and registry.has("calibrating"):
        row = body.row(align=True)
        button(row, "flexmaps.calibration_sheet", tr("Calibration"), "FILE_NEW")
        button(row, "flexmaps.calibrated", tr("Results"), "DRIVER_DISTANCE")
    row = body.row(align=True)
    row.popover("FLEXMAPS_PT_presets", text=tr("Keep in preset"), translate=False)
    file = presets.read_last_preset(context.object)[1]
    back = row.row(align=True)
    back.enabled = bool(file)
    button(back, "flexmaps.apply_preset", tr("Back to preset")).filepath = file


def heading_text(context: bpy.types.Context) -> str:
    """Return the text beside the folded section's heading: the mill's diameter, or the kerf."""
    cut = context.object.flexmaps.cut
    if cut.mill > 0:
        return tr("Mill of {} mm", f"{cut.mill:.2g}")
    return tr("Kerf {}", f"{cut.kerf_outline:.2g}") if cut.kerf_outline else tr("No kerf")


# -- preferences -------------------------------------------------------------------------------------------------------


class Preferences(bpy.types.AddonPreferences):
    bl_idname = __package__.rpartition(".")[0]

    expert: bpy.props.BoolProperty(  # type: ignore[valid-type]
        name="Expert settings",
        description="Show the solvers' settings in a tab of Workshop; hiding them keeps their values",
    )

    def draw(self, context: bpy.types.Context) -> None:
        self.layout.prop(self, "expert")


def shows_expert_settings(context: bpy.types.Context) -> bool:
    """Return whether the user has chosen to see the solvers' settings, in the add-on's preferences."""
    addon = context.preferences.addons.get(Preferences.bl_idname)
    return addon is not None and addon.preferences.expert


CLASSES = (Preferences,)
