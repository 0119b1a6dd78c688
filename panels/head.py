"""The head of the tab: object, size, button *Next*, status line and three rows.

It always has the same height, so that nothing below it moves.
"""

from __future__ import annotations

from typing import Any

import bpy

from ..bridge.hosts import background, live
from ..bridge.store.finding_words import INFORMATION, STOPS
from ..bridge.store.i18n import quads
from ..bridge.store.notice import Notice
from ..bridge.store.notices import FEW_QUADS
from ..bridge.view import colouring, head_text
from ..bridge.view.progress import progress_to_show
from ..bridge.view.text_layout import break_lines, line_width, text_width
from .rows import button, menu, tr, wrapped_text
from .stages import read_stages

NOTICE_ROWS = 3  # number of rows below the status line
THIN_SEPARATOR = 0.01  # width of an invisible separator, as a fraction of a usual separator
NEXT_HEIGHT = 1.5  # height of the button Next, in rows; larger is more prominent and takes more room; chosen by eye
# line width in pixels below which the label "Size" is dropped, so that Blender does not truncate the three numbers
SIZE_LABEL_WIDTH = 205
CURE, SIGN = 14, 26  # pixels: width of a button beyond its text, and width of a notice's icon
TEXT_SHARE = 0.40, 0.70  # smallest and largest fraction of a row for a notice's text; the rest is for its button
COLOUR_GROUPS = (
    ("PATCH", "ENERGY", "SQUARE"),
    ("STIFFNESS", "WIDTH", "ANISOTROPY", "TWIST"),
    ("DISTANCE", "STRAIN_ENERGY", "SAFETY", "SLOT", "REACH"),
    ("UTILISATION", "SCAN"),
    ("NONE",),
)  # groups of the menu of colours; keys of ``colouring.KINDS``


def draw(layout: Any, context: bpy.types.Context, problem: str | None) -> None:
    """Draw the head.

    Parameters
    ----------
    layout : Blender's layout
    context : Blender's context
    problem : why the active object cannot be used; None if it can
    """
    running, obj = background.current_job(), context.object
    row = layout.row()
    row.label(text=obj.name if obj else tr("No mesh selected"), icon="MESH_DATA" if obj else "BLANK1", translate=False)
    right = row.row(align=True)
    right.alignment = "RIGHT"
    if problem is None:
        right.label(text=_face_count(obj.data), translate=False)
    shown = right.row()
    shown.enabled = problem is None
    shown.menu("FLEXMAPS_MT_colours", text="", icon="OVERLAY")
    _draw_size(layout, context, problem is None and running is None)
    seen = read_stages(context).guidance if problem is None else None
    content = head_text.head_content(context, problem or "", seen, running, live.current_watcher())
    _draw_next(layout, content, running)
    box = layout.box().column(align=True)
    row = box.row()
    row.alert = content.alert
    row.label(text=content.status, icon=content.icon, translate=False)
    if len(content.notices) > 1:
        row.popover("FLEXMAPS_PT_notices", text="", icon="DOWNARROW_HLT")
    if content.notices:
        _draw_notices(box, context, content.notices)
    else:
        words = break_lines(content.hint, line_width(context), NOTICE_ROWS)
        for k in range(NOTICE_ROWS):
            row = box.row()
            row.active = False
            row.label(text=words[k] if k < len(words) else "", translate=False)


def _face_count(mesh: bpy.types.Mesh) -> str:
    count = len(mesh.polygons)
    return quads(count) if len(mesh.loops) == 4 * count else tr("{} face" if count == 1 else "{} faces", count)


def _draw_size(layout: Any, context: bpy.types.Context, editable: bool) -> None:
    narrow = line_width(context) < SIZE_LABEL_WIDTH
    outer = layout if narrow else layout.split(factor=0.17)
    if not narrow:
        outer.label(text=tr("Size"), translate=False)
    row = outer.row(align=True)
    row.enabled = editable
    obj = context.object
    for k in range(3):
        if obj is not None:
            row.prop(obj, "flexmaps_size", index=k, text="")
        else:
            row.label(text="")
    if not narrow:
        unit = row.row()
        unit.ui_units_x = 1.4
        unit.label(text="mm", translate=False)


def _draw_next(layout: Any, content: head_text.HeadContent, running: Any) -> None:
    """Draw the button *Next* with its menu; while a job runs, draw its progress and a stop button in their place."""
    whole = layout.row(align=True)
    row = whole.row(align=True)
    row.scale_y = NEXT_HEIGHT
    if running is not None:
        row.progress(factor=progress_to_show(running)[0], text=content.label)
        row.operator("flexmaps.stop", text="", icon="X")
        _add_thin_separator(whole)
        return
    main = row.row(align=True)
    main.active_default, main.enabled = True, bool(content.operator)
    pressed = button(main, content.operator or "flexmaps.next", content.label, "PLAY")
    for name, value in content.properties:
        setattr(pressed, name, value)
    row.menu("FLEXMAPS_MT_next", text="", icon="DOWNARROW_HLT")
    _add_thin_separator(whole)
    bpy.types.FLEXMAPS_OT_next.note_label(content.label)


def _add_thin_separator(row: Any) -> None:
    """Draw an invisible separator, so that Blender does not highlight the box below.

    When a job ends while the pointer is on its stop button, Blender highlights the next item without an operator:
    this separator.
    """
    row.separator(factor=THIN_SEPARATOR)


# -- notices -----------------------------------------------------------------------------------------------------------


def _draw_notices(box: Any, context: bpy.types.Context, notices: tuple[Notice, ...]) -> None:
    """Draw three rows: up to three notices, or two notices and a link to the full list.

    A single notice shows up to three remedies ("cures", drawn as buttons), several notices show one each. If the
    notices other than information need more than three rows, only these are listed and counted, so that their number
    agrees with the status line.
    """
    serious = tuple(notice for notice in notices if notice.severity != INFORMATION)
    many = len(serious) > NOTICE_ROWS
    notices = serious if many else notices[:NOTICE_ROWS]
    shown = notices[: NOTICE_ROWS - many]
    factor = _text_share(context, shown)
    alone = len(shown) == 1 and not many
    for k in range(NOTICE_ROWS):
        notice, cures = (shown[k], shown[k].cures[:1]) if k < len(shown) else (None, ())
        if alone:
            cures = shown[0].cures[k : k + 1]
        row = box.split(factor=factor, align=True) if cures else box
        if notice is not None:
            _draw_notice(row, notice)
        elif k < len(notices):
            row = box.split(factor=TEXT_SHARE[1], align=True)
            row.label(text=tr("and {} more", len(notices) - k), icon="BLANK1", translate=False)
            row.popover("FLEXMAPS_PT_notices", text=tr("All"), translate=False)
        else:
            row.label(text="")
        if cures:
            draw_cure(row, cures[0])


def _text_share(context: bpy.types.Context, notices: tuple[Notice, ...]) -> float:
    """Return the fraction of a row for the text of a notice, common to all rows, so that the buttons line up.

    Room that neither text nor buttons need is split evenly between them.
    """
    words = max((text_width(notice.label) for notice in notices), default=0) + SIGN
    cures = max((text_width(cure.label) for notice in notices for cure in notice.cures[:NOTICE_ROWS]), default=0) + CURE
    free = max(0.0, line_width(context) - words - cures)
    return max(TEXT_SHARE[0], min(TEXT_SHARE[1], (words + 0.5 * free) / line_width(context)))


def _draw_notice(layout: Any, notice: Notice) -> None:
    """Draw the short text of a notice; a click selects the place, the tooltip gives the whole sentence."""
    row = layout.row()
    row.alignment, row.alert = "LEFT", notice.severity == STOPS
    icon = "INFO" if notice.severity == INFORMATION else "ERROR"
    if "/" not in notice.key and notice.key != FEW_QUADS:  # the notice concerns no place on the object: no button
        row.label(text=notice.label, icon=icon, translate=False)
        return
    button(row, "flexmaps.show_notice", notice.label, icon, emboss=False).key = notice.key


def draw_cure(layout: Any, cure: Any) -> None:
    """Draw the button of a remedy (``Cure``: operator, label and properties)."""
    pressed = button(layout, cure.idname, cure.label)
    for name, value in cure.properties.items():
        setattr(pressed, name, value)


class AllNotices(bpy.types.Panel):
    bl_idname = "FLEXMAPS_PT_notices"
    bl_label = "To look at"
    bl_space_type, bl_region_type = "VIEW_3D", "HEADER"
    bl_ui_units_x = 20

    def draw(self, context: bpy.types.Context) -> None:
        for notice in (*read_stages(context).guidance.notices, *head_text.general_notices(context)):
            box = self.layout.box().column(align=True)
            _draw_notice(box, notice)
            wrapped_text(box, context, notice.sentence, units=self.bl_ui_units_x)
            row = box.row(align=True)
            for cure in notice.cures:
                draw_cure(row, cure)


def _draw_steps_menu(layout: Any, context: bpy.types.Context) -> None:
    for idname, words, icon in (
        ("flexmaps.quad_remesh", "Quads", "MOD_REMESH"),
        ("flexmaps.set_size", "Scale to quad edge", "FULLSCREEN_ENTER"),
        ("flexmaps.merge", "Lay out the panels", "AUTOMERGE_ON"),
        ("flexmaps.fit", "Make it fit", "SHADERFX"),
        ("flexmaps.export", "Write the files", "EXPORT"),
        ("flexmaps.check", "Check the mesh", "VIEWZOOM"),
    ):
        button(layout, idname, tr(words), icon)


def _draw_colours_menu(layout: Any, context: bpy.types.Context) -> None:
    shown, names = context.window_manager.flexmaps_overlay, {kind: name for kind, name, _ in colouring.OVERLAY_ITEMS}
    for number, group in enumerate(COLOUR_GROUPS):
        if number:
            layout.separator()
        for kind in group:
            icon = "LAYER_ACTIVE" if kind == shown else "BLANK1"
            button(layout, "flexmaps.overlay", tr(names[kind]), icon).kind = kind


CLASSES = (AllNotices, menu("next", "Next", _draw_steps_menu), menu("colours", "Colours", _draw_colours_menu))
