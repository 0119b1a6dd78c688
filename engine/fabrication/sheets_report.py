"""Figures of the sheets for report.json."""

from __future__ import annotations

from typing import Any

from .nesting.packing import fill_ratio, used_length
from .sheets import CutSheets


def _cuts_report(sheets: CutSheets) -> dict[str, Any]:
    """Return the figures about mill, holding tabs and lead-ins, if they are used."""
    cut, found = sheets.cut, {}
    if cut.mill:
        found["mill_mm"] = round(cut.mill * 1e3, 4)
    if cut.tabs or cut.lead_in:
        runs = [sheets.cuts_on_sheet(k) for k in range(sheets.count)]
        found["holding_tabs"] = sum(r.tab_count for r in runs)
        found["lead_ins_left_out"] = sum(r.lead_ins_left_out for r in runs)
    return found


def sheets_report(sheets: CutSheets) -> dict[str, Any]:
    """Return the ``sheets`` block of report.json without the names of the files."""
    silhouettes = sum(p.outline.area for p in sheets.panels)
    shapes = [p.outline.sample(1e-4) for p in sheets.panels]
    length = sheets.cut_length
    return {
        "panels": sum(p.patch >= 0 for p in sheets.panels),
        "sheets": sheets.count,
        **({"remnants": [r.name for r in sheets.packing.remnants]} if sheets.packing.remnants else {}),
        "sizes_mm": [[round(float(x) * 1e3, 3) for x in size] for size in sheets.packing.sizes],
        "used_mm": [round(1e3 * used_length(sheets.packing, shapes, k), 1) for k in range(sheets.count)],
        "fill": round(fill_ratio(sheets.packing, shapes, silhouettes, sheets.params.margin), 4),
        "area_m2": round(sum(p.area for p in sheets.panels), 6),
        "cut_length_m": round(length, 3),
        "slot_min_mm": round(sheets.slot_min * 1e3, 4),
        "bridge_min_mm": round(sheets.bridge_min * 1e3, 4),
        "nodes": sheets.node_count,
        "nodes_per_m": round(sheets.node_count / length, 1),
        "kerf_mm": [round(x * 1e3, 4) for x in (sheets.cut.kerf_outline, sheets.cut.kerf_holes)],
        **_cuts_report(sheets),
        **sheets.connections.report,
        **({} if sheets.base is None else {"base": sheets.base.report}),
        "labels": sheets.labels_placed,
        "labels_left_out": sheets.labels_left_out,
        "warnings": list(sheets.warnings),
    }
