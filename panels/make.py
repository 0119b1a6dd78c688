"""The section *Make*: files for the cutter, the report, and a page to share."""

from __future__ import annotations

from typing import Any

import bpy

from ..bridge.store.i18n import sheets
from ..bridge.store.settings import is_relative_to_unsaved
from ..engine.extras import registry
from .rows import (
    button,
    decimals,
    duration,
    menu,
    options_button,
    percent,
    results_box,
    setting_row,
    settings_popover,
    tr,
)
from .stages import read_stages, results_column

# kinds of files that come in several versions: setting, label, version that the toggle switches on
FILE_TOGGLES = ("dxf", "DXF", "R2010"), ("solids", "3D", "3MF")
BASE_PARTS = ("feet", "Feet"), ("plates", "Plates"), ("planks", "Planks"), ("eyelets", "Eyelets")


def draw(body: Any, context: bpy.types.Context) -> None:
    settings = context.object.flexmaps
    files = settings.export
    row = body.row(align=True)
    row.prop(files, "svg", text="SVG", toggle=True, translate=False)
    for name, words, usual in FILE_TOGGLES:
        switch = row.operator(
            "wm.context_toggle_enum", text=words, depress=getattr(files, name) != "NONE", translate=False
        )
        # this operator sets value_2 ("NONE") unless it is set already; then it sets value_1
        switch.data_path, switch.value_1, switch.value_2 = f"object.flexmaps.export.{name}", usual, "NONE"
    row.prop(files, "pdf", text="PDF", toggle=True, translate=False)
    if registry.has("assembly_sheet"):
        row.prop(files, "guide", text=tr("Guide"), toggle=True, translate=False)
    column = body.column(align=True)
    row = setting_row(column, files, "folder", tr("Folder"))
    row.alert = is_relative_to_unsaved(files.folder)
    setting_row(column, files, "copies", tr("Copies"))
    setting_row(column, settings.sheet, "remnants", tr("Offcuts")).operator("flexmaps.add_remnant", text="", icon="ADD")
    row = body.row(align=True)
    button(row, "flexmaps.export", tr("Write the files"), "EXPORT")
    row.menu("FLEXMAPS_MT_files", text="", icon="DOWNARROW_HLT")
    row = body.row(align=True)
    button(row, "flexmaps.report", tr("Report"), "FILE_TEXT").browse = True
    button(row, "flexmaps.share", tr("Share page"), "URL").browse = True
    options_button(row, "page")
    stored = results_column(body, context, "sheets")
    if stored is not None:
        results_box(stored[0], *_figure_rows(stored[1]))


def _figure_rows(block: dict[str, Any]) -> list[Any]:
    rows: list[Any] = [(tr("Sheets, filled"), f"{block.get('sheets')}, {percent(block, 'fill')}")]
    cut = decimals(block, "cut_length_m", 1, " m")
    rows.append((tr("Cutting"), f"{duration(block['cut_minutes'])}, {cut}" if "cut_minutes" in block else cut))
    if block.get("joints"):
        rows.append((tr("Joints"), f"{block['joints']}, {duration(block.get('assembly_minutes', 0))}"))
    rows.append((tr("Weight"), decimals(block, "mass_g", 0, " g")))
    if "cost" in block:
        rows.append((tr("Cost"), f"{block['cost']['total']:.2f}"))
    for key, name in BASE_PARTS:
        if key in block.get("base", {}):
            rows.append((tr(name), str(block["base"][key])))
    if block.get("glued"):
        rows.append((tr("For glue"), str(len(block["glued"]))))
    if block.get("unsolved"):
        rows.append((tr("Without connector"), str(len(block["unsolved"])), True))
    return rows


def heading_text(context: bpy.types.Context) -> str:
    """Return the text beside the folded section's heading: number of sheets and cutting time."""
    block = read_stages(context).blocks.get("sheets")
    if block is None:
        return ""
    text = sheets(block.get("sheets", 0))
    return f"{text}, {duration(block['cut_minutes'])}" if "cut_minutes" in block else text


def _draw_files_menu(layout: Any, context: bpy.types.Context) -> None:
    if registry.has("together"):
        button(layout, "flexmaps.export_together", tr("All selected on common sheets"), "PACKAGE")
    folder = bpy.path.abspath(context.object.flexmaps.export.folder)
    button(layout, "wm.path_open", tr("Open the folder"), "FILE_FOLDER").filepath = folder


CLASSES = (settings_popover("page", "Pages", "page"), menu("files", "Files", _draw_files_menu))
