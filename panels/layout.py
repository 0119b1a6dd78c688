"""The section *Layout*: where the surface is cut into panels, with cards of the proposed layouts."""

from __future__ import annotations

from typing import Any

import bpy

from ..bridge.store.i18n import panels, quads, sheets
from ..bridge.view import thumbnails
from ..engine.extras import registry
from ..engine.figures import format_figure
from .rows import PER_ROW, TEXT_HEIGHT, button, duration, menu, percent, results_box, setting_row, settings_popover, tr
from .stages import read_stages, results_column

PICTURE_SIZE = 3.2  # size of a card's picture, in rows; with a larger one, three cards would not fit side by side
MAX_CARDS = 6  # largest number of cards; more make the section longer
LIMITS = "distortion_limit", "compactness_limit", "neck_min", "patch_min", "seamless"


def draw(body: Any, context: bpy.types.Context) -> None:
    settings = context.object.flexmaps.choose
    column = body.column(align=True)
    setting_row(column, settings, "goal", tr("Wanted"))
    if settings.goal == "panels":
        setting_row(column, settings, "panels", tr("Panels"))
    else:
        row = setting_row(column, settings, "match", tr("Within (%)"))
        row.enabled = settings.goal == "match"
    row = body.split(factor=0.6, align=True)
    if registry.has("choosing"):
        button(row, "flexmaps.choose", tr("Propose layouts"), "PRESET")
    row.menu("FLEXMAPS_MT_by_hand", text=tr("By hand"), translate=False)
    if registry.has("choosing"):
        _draw_cards(body, context)
    stored = results_column(body, context, "layout")
    if stored is None:
        return
    layout, block = stored
    limit, most = context.object.flexmaps.layout.distortion_limit, block.get("energy_max", 0.0)
    shaped, expected = "equilibrium" in read_stages(context).blocks, block.get("expected_percent")
    match = [] if shaped or expected is None else [(tr("Expected match"), f"~ {format_figure(expected)} %")]
    results_box(
        layout,
        (tr("Panels"), str(block.get("patches"))),
        *match,
        (tr("Distortion, largest"), tr("{} of {}", f"{most:.3f}", f"{limit:.3f}"), past_limit(context)),
        (tr("Seam mismatch"), percent(block, "seam_mismatch_max")),
        (tr("Narrowest"), quads(block.get("neck_min_quads", 0))),
        (tr("Smallest"), quads(block.get("smallest_patch", 0))),
    )


def _draw_cards(body: Any, context: bpy.types.Context) -> None:
    """Draw a card for each proposed layout."""
    stored = results_column(body, context, "choose")
    if stored is None:
        return
    layout, block = stored
    rows = block["proposals"][:MAX_CARDS]
    pictures = thumbnails.icon_numbers(context.object, len(block["proposals"]))
    for first in range(0, len(rows), PER_ROW):
        grid = layout.row(align=True)
        for number in range(first, first + PER_ROW):
            card = grid.box().column(align=True) if number < len(rows) else grid.column()
            if number < len(rows):
                _draw_card(card, number, rows[number], pictures[number], number == block["taken"])


def _draw_card(card: Any, number: int, row: dict[str, Any], picture: int, is_current: bool) -> None:
    """Draw the card of a layout: picture, button to choose it, and lines with match, assembly time and sheets."""
    card.template_icon(icon_value=picture, scale=PICTURE_SIZE)
    taking = button(card, "flexmaps.take_choice", panels(row["panels"]), depress=is_current)
    taking.number, taking.tip = number, _tooltip(row)
    share = f"{'' if row['proved'] else '~ '}{format_figure(row['rms_percent'])} %"
    for text in (share, duration(row["join_minutes"]), sheets(row["sheets"])):
        centred = card.row()
        centred.alignment, centred.scale_y = "CENTER", TEXT_HEIGHT
        centred.label(text=text, translate=False)


def _tooltip(row: dict[str, Any]) -> str:
    """Return the tooltip of a card's button: joints, strain, cutting time and symmetry of the layout."""
    parts = [
        tr("{} joint" if row["joints"] == 1 else "{} joints", row["joints"]),
        tr("strain {} of its limit", f"{100 * row['strain_share_max']:.0f} %"),
        *([tr("{} to cut", duration(row["cut_minutes"]))] if "cut_minutes" in row else []),
        *([tr("symmetric")] if row["symmetries_kept"] > 1 else []),
    ]
    return ", ".join(parts)


def past_limit(context: bpy.types.Context) -> bool:
    """Return whether any quad's distortion is above the limit, with a tolerance for rounding."""
    limit = context.object.flexmaps.layout.distortion_limit
    return bool(read_stages(context).blocks.get("layout", {}).get("energy_max", 0.0) > limit * 1.0001)


def heading_text(context: bpy.types.Context) -> str:
    """Return the text beside the folded section's heading: the number of panels."""
    block = read_stages(context).blocks.get("layout")
    return "" if block is None else panels(block.get("patches", 0))


def _draw_by_hand_menu(layout: Any, context: bpy.types.Context) -> None:
    button(layout, "flexmaps.trace", tr("Trace the cuts"), "GRID")
    button(layout, "flexmaps.merge", tr("Merge panels"), "AUTOMERGE_ON")
    button(layout, "flexmaps.update_from_seams", tr("Update from seams"), "FILE_REFRESH")
    button(layout, "flexmaps.flatten", tr("Flatten all"), "UV")


CLASSES = (
    settings_popover("limits", "Limits of the layout", "layout", *LIMITS),
    menu("by_hand", "By hand", _draw_by_hand_menu),
)
