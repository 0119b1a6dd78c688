"""The Export panel: sheets, connectors, kerf, files, and what was written."""

from __future__ import annotations

from typing import Any

import bpy

from ..bridge.store import notes
from ..bridge.store.settings import unsaved
from ..engine.params import BaseParams, ConnectorParams, CostParams, CutParams, ExportParams, PageParams, SheetParams
from .rows import decimals, duration, fold, more, number, numbers, percent, settings_rows, wrapped
from .stages import StagePanel, button, result

SHEET = ("sheet_width", "sheet_height")  # what is always in sight; the rest is folded away
CONNECT = ("connector",)
# what is asked of every kind of base
BASE = {"none": ("base",), "eyelets": ("base", "eyelet"), "feet": ("base", "base_height", "foot_width", "base_edge")}
CUT = tuple(CutParams.__dataclass_fields__)  # the last one is the width of the holding tabs


class ExportPanel(StagePanel, bpy.types.Panel):
    bl_idname = "FLEXMAPS_PT_export"
    bl_label = "Export"
    stage = "sheets"

    def draw(self, context: bpy.types.Context) -> None:
        layout, obj = self.layout, context.object
        settings = obj.flexmaps
        column = layout.column(align=True)
        settings_rows(column, settings.sheet, SheetParams, SHEET)
        layout.prop(settings.export, "folder", text="")
        if unsaved(settings.export.folder):
            wrapped(
                layout, context, "The folder begins with //: save the file first, or choose another one", icon="INFO"
            )
            button(layout, context, "wm.save_mainfile", icon="FILE_TICK")
        button(layout, context, "flexmaps.export", icon="EXPORT")
        if settings.export.copies > 1 or len(context.selected_objects) > 1:
            layout.operator("flexmaps.export_together", icon="PACKAGE")
        body = fold(layout, "flexmaps_remnants", "Remnants and copies")
        if body is not None:
            settings_rows(body, settings.sheet, SheetParams, ("remnants",))
            body.operator("flexmaps.add_remnant", icon="ADD")
            settings_rows(body, settings.export, ExportParams, ("copies",))
        more(layout, "flexmaps_sheet", settings.sheet, SheetParams, (*SHEET, "remnants"))
        body = fold(layout, "flexmaps_base", "Base")
        if body is not None:
            settings_rows(body, settings.base, BaseParams, BASE.get(settings.base.base, BASE["feet"]))
        body = fold(layout, "flexmaps_connect", "Connectors and kerf")
        if body is not None:
            settings_rows(body, settings.connect, ConnectorParams, CONNECT)
            if settings.connect.connector != "none":
                more_names = tuple(ConnectorParams.__dataclass_fields__)[len(CONNECT) :]
                settings_rows(body, settings.connect, ConnectorParams, more_names)
            body.separator()
            settings_rows(body, settings.cut, CutParams, CUT if settings.cut.tabs else CUT[:-1])
        body = fold(layout, "flexmaps_cost", "Prices")
        if body is not None:
            settings_rows(body, settings.cost, CostParams, tuple(CostParams.__dataclass_fields__))
        body = fold(layout, "flexmaps_calibrate", "Calibrate")
        if body is not None:
            body.operator("flexmaps.calibration_sheet", icon="FILE_NEW")
            body.operator("flexmaps.calibrated", icon="DRIVER_DISTANCE")
        body = fold(layout, "flexmaps_files", "Kinds of files")
        if body is not None:
            settings_rows(
                body,
                settings.export,
                ExportParams,
                tuple(n for n in ExportParams.__dataclass_fields__ if n not in ("folder", "copies")),
            )
        block = notes.read(obj.data).get("sheets")
        if block is not None:
            column = result(layout, context, "sheets")
            # which seams are hard to join, and where connectors bear too much
            for text in notes.read(obj.data).get("assembly", {}).get("warnings", ()):
                wrapped(column.box(), context, text, icon="ERROR")
            _sheets(column, block)
        body = fold(layout, "flexmaps_page", "Page")
        if body is not None:
            settings_rows(body, settings.page, PageParams)
        row = layout.row(align=True)
        row.operator("flexmaps.report", icon="FILE_TEXT").browse = True
        row.operator("flexmaps.share", icon="URL").browse = True


def _sheets(layout: Any, block: dict[str, Any]) -> None:
    grid = numbers(layout)
    number(grid, "Sheets", str(block.get("sheets")))
    number(grid, "Cut length", decimals(block, "cut_length_m", 1, " m"))
    if block.get("joints"):
        number(grid, "Assembly, about", duration(block.get("assembly_minutes", 0)))
    if "cost" in block:
        number(grid, "Cost, about", f"{block['cost']['total']:.2f}")
    if "base" in block:
        for key, name in (("feet", "Feet"), ("plates", "Plates"), ("planks", "Planks"), ("eyelets", "Eyelets")):
            if key in block["base"]:
                number(grid, name, str(block["base"][key]))
    if block.get("glued"):
        number(grid, "For glue", str(len(block["glued"])))
    if block.get("unsolved"):
        number(grid, "Without connector", str(len(block["unsolved"])), alert=True)
    rest = fold(layout, "flexmaps_sheets_rest", "More figures")
    if rest is None:
        return
    number(rest, "Filled", percent(block, "fill"))
    if "cut_minutes" in block:
        number(rest, "Laser, about", duration(block["cut_minutes"]))
    number(rest, "Waste", percent(block, "waste"))
    number(rest, "Mass", decimals(block, "mass_g", 0, " g"))
    number(rest, "Narrowest arm", decimals(block, "bridge_min_mm", 2, " mm"))
    number(rest, "Joints", str(block.get("joints", "-")))
    number(rest, "Files", str(len(block.get("files", ()))))
