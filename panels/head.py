"""The head of the tab: object, size, *Next*, a status line and three rows. It is as high in every state, so that nothing below moves."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import bpy

from ..bridge.hosts import background, live
from ..bridge.store import notes
from ..bridge.store.cures import Cure
from ..bridge.store.guidance import LOOK, NEUTRAL, REDO, STOPPED, TICK
from ..bridge.store.notices import INFORMATION, KEPT, STOPS, Notice
from ..bridge.store.objects import shared, unusable
from ..bridge.view import collection
from ..engine import VERSION, versions
from .rows import button, lines, menu, quads, room, sentence, tr, wide
from .stages import look

SLOTS = 3  # rows below the status line, always as many
EMPHASIS = 1.5  # height of Next, in rows; by eye
NARROW = (
    205  # pixels for words of a line below which the size stands without its words, or Blender would cut its numbers
)
CURE, SIGN = 14, 26  # pixels that a button has beside its words, and that the sign of a notice takes
WORDS = 0.40, 0.70  # least and largest share of a row for the words of a notice
SIGNS = {NEUTRAL: "INFO", TICK: "CHECKMARK", LOOK: "ERROR", STOPPED: "CANCEL", REDO: "FILE_REFRESH"}
REMOVE = "flexmaps.remove_left_over"
WELCOME = "Welcome to FlexMaps"
ABOUT = "It turns a surface into flat panels that spring into its shape. Select a mesh, or press Next for an example."
# what Next does where there is no mesh to work on: the object's type -> operator, words, its properties
CONVERTIBLE = {"CURVE", "SURFACE", "FONT", "META"}
GROUPS = (
    ("PATCH", "Panels"), ("ENERGY", "Distortion"), ("SQUARE", "Squareness"), None,
    ("STIFFNESS", "Stiffness"), ("WIDTH", "Arm width"), ("ANISOTROPY", "Anisotropy"), ("TWIST", "Twist"), None,
    ("DISTANCE", "Distance"), ("STRAIN_ENERGY", "Energy"), ("SAFETY", "Strain"), ("SLOT", "Gaps"), ("REACH", "Limits"), None,
    ("UTILISATION", "Loads"), ("SCAN", "Scan"), None, ("NONE", "No colours"),
)  # fmt: skip


@dataclass(frozen=True)
class Head:
    """What the head says: the button, the status line with its icon, and either notices or a sentence.

    press : what *Next* runs, with its properties; "" where nothing can be pressed
    """

    label: str
    press: str
    icon: str
    status: str
    about: str = ""
    notices: tuple[Notice, ...] = ()
    properties: tuple[tuple[str, Any], ...] = ()
    alert: bool = False


def draw(layout: Any, context: bpy.types.Context, problem: str | None) -> None:
    """All rows of the head; ``problem``: why there is nothing to work on."""
    running, obj = background.current(), context.object
    row = layout.row()
    row.label(text=obj.name if obj else tr("No mesh selected"), icon="MESH_DATA" if obj else "BLANK1", translate=False)
    right = row.row(align=True)
    right.alignment = "RIGHT"
    if problem is None:
        right.label(text=_faces(obj.data), translate=False)
    shown = right.row()
    shown.enabled = problem is None
    shown.menu("FLEXMAPS_MT_colours", text="", icon="OVERLAY")
    _size(layout, context, problem is None and running is None)
    said = _running(running) if running else _live(context) or _idle(context, problem)
    _next(layout, said, running)
    box = layout.box().column(align=True)
    row = box.row()
    row.alert = said.alert
    row.label(text=said.status, icon=said.icon, translate=False)
    if len(said.notices) > 1:
        row.popover("FLEXMAPS_PT_notices", text="", icon="DOWNARROW_HLT")
    if said.notices:
        _rows(box, context, said.notices)
    else:
        words = lines(said.about, room(context), SLOTS)
        for k in range(SLOTS):
            row = box.row()
            row.active = False
            row.label(text=words[k] if k < len(words) else "", translate=False)


def _faces(mesh: bpy.types.Mesh) -> str:
    count = len(mesh.polygons)
    return quads(count) if len(mesh.loops) == 4 * count else tr("{} faces", count)


def _size(layout: Any, context: bpy.types.Context, editable: bool) -> None:
    narrow = room(context) < NARROW
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


def _next(layout: Any, said: Head, running: Any) -> None:
    """*Next* and its menu, or the progress of what runs and a cross: the same two rectangles."""
    row = layout.row(align=True)
    row.scale_y = EMPHASIS
    if running is not None:
        row.progress(factor=running.fraction, text=said.label)
        row.operator("flexmaps.stop", text="", icon="X")
        return
    main = row.row(align=True)
    main.active_default, main.enabled = True, bool(said.press)
    pressed = button(main, said.press or "flexmaps.next", said.label, "PLAY")
    for name, value in said.properties:
        setattr(pressed, name, value)
    row.menu("FLEXMAPS_MT_next", text="", icon="DOWNARROW_HLT")
    bpy.types.FLEXMAPS_OT_next.see(said.label)


# -- what it says ------------------------------------------------------------------------------------------------------


def _running(job: Any) -> Head:
    name = bpy.app.translations.pgettext_iface(job.title, "Operator")
    label = tr("{}, {} %", name, f"{100 * job.fraction:.0f}")
    left = tr("About {} left", job.left) if job.left else tr("Begun")
    step = tr(job.text) if job.text else tr("starting")
    said = tr("Stopping") if job.stopping else left
    return Head(label, "", "SORTTIME", said, f"{step}. {tr('Esc or the cross stops; {}.', tr(job.on_stop))}")


def _live(context: bpy.types.Context) -> Head | None:
    """Of an object that live mode follows."""
    following, obj = live.current(), context.object
    if following is None or obj is None or following.uid != obj.session_uid:
        return None
    seen = look(context).guidance
    label = seen.act.label if seen.act else tr("Next")
    press, shape = "flexmaps.next" if seen.act else "", following.shape
    if following.problem:
        return Head(label, press, "ERROR", tr("Live: stopped short"), tr(following.problem), alert=True)
    if shape is None or not following.resting:
        return Head(label, press, "SORTTIME", tr("Live: on its way"), tr("The shape follows what you change."))
    if shape.snapped:
        jumped = tr("Snapped by up to {} mm", f"{shape.snapped:.0f}")
        return Head(label, press, "ERROR", jumped, tr("Spirals jumped to another shape. Undo brings the piece back."))
    final = "" if following.final else tr("Press Simulate for the final shape and its figures.")
    return Head(label, press, "CHECKMARK", tr("Live: at rest"), final)


def _idle(context: bpy.types.Context, problem: str | None) -> Head:
    obj = context.object
    if problem is not None:
        return _nothing(context, problem)
    seen = look(context).guidance
    notices = (*seen.notices, *_around(context))
    act, (status, sign) = seen.act, (seen.status.text, seen.status.sign)
    about = act.tooltip if act else tr("Only you can mend this mesh. The rows tell where.")
    others = sum(other.type == "MESH" for other in context.selected_objects if other != obj)
    if others and not seen.open:
        status = tr("{} selected; works on the active one", others + 1)
    label = act.label if act else tr("Next")
    return Head(label, "flexmaps.next" if act else "", SIGNS[sign], status, about, notices, alert=sign == STOPPED)


def _nothing(context: bpy.types.Context, problem: str) -> Head:
    """Where there is no mesh to work on."""
    obj = context.object
    if obj is None:
        label = tr("Next: {}", tr("Add an example"))
        return Head(label, "flexmaps.example", "INFO", tr(WELCOME), tr(ABOUT), _around(context))
    said = tr(problem)
    if obj.type in CONVERTIBLE:
        label = tr("Next: {}", tr("Convert to a mesh"))
        return Head(label, "object.convert", "INFO", tr("Not a mesh yet"), said, properties=(("target", "MESH"),))
    if obj.type == "MESH" and obj.library is None and obj.data.library is None:
        label = tr("Next: {}", tr("Object Mode"))
        return Head(label, "object.mode_set", "INFO", tr("In another mode"), said, properties=(("mode", "OBJECT"),))
    return Head(tr("Next"), "", "INFO", tr("Nothing to work on"), said)


def _around(context: bpy.types.Context) -> tuple[Notice, ...]:
    """What is to be known beside the object itself, as information."""
    obj, found = context.object, []
    left = collection.left_over(context.scene)
    if left:
        names = ", ".join(f"'{one.get('flexmaps_owner')}'" for one in left[:2]) + ", ..." * (len(left) > 2)
        said = tr("{} was deleted, its panels are still there", names)
        found.append(Notice("left", tr("Left-over panels"), said, INFORMATION, cures=(Cure(tr("Remove"), REMOVE),)))
    if unusable(obj) is not None:
        return tuple(found)
    others, version = shared(obj), notes.made_with(obj.data)
    if others:
        said = tr("The mesh is shared with {}: seams and results are common to all", others)
        found.append(Notice("shared", tr("Shared mesh"), said, INFORMATION))
    changed = versions.since(version)
    if versions.order(version) > versions.order(VERSION):
        said = tr("Made with FlexMaps {}, which is newer than this {}: what is new there is not read", version, VERSION)
        found.append(Notice("version", tr("Made with {}", version), said, INFORMATION))
    elif changed:
        said = " ".join((tr("Made with FlexMaps {}; since then:", version), *(f"{tr(text)}." for text in changed)))
        found.append(Notice("version", tr("Made with {}", version), said, INFORMATION))
    return tuple(found)


# -- notices -----------------------------------------------------------------------------------------------------------


def _rows(box: Any, context: bpy.types.Context, notices: tuple[Notice, ...]) -> None:
    """Three rows: as many notices, or two and the way to the others; the cures of one alone below each other."""
    many = len(notices) > SLOTS
    shown = notices[: SLOTS - many]
    factor = _share(context, shown)
    alone = len(shown) == 1 and not many
    for k in range(SLOTS):
        notice, cures = (shown[k], shown[k].cures[:1]) if k < len(shown) else (None, ())
        if alone:
            cures = shown[0].cures[k : k + 1]
        row = box.split(factor=factor, align=True) if cures else box
        if notice is not None:
            _words(row, notice)
        elif k < len(notices):
            row = box.split(factor=WORDS[1], align=True)
            row.label(text=tr("and {} more", len(notices) - k), icon="BLANK1", translate=False)
            row.popover("FLEXMAPS_PT_notices", text=tr("All"), translate=False)
        else:
            row.label(text="")
        if cures:
            cured(row, cures[0])


def _share(context: bpy.types.Context, notices: tuple[Notice, ...]) -> float:
    """Share of a row for the words, so that buttons stand below each other: what the words need, as far as the cures leave it."""
    words = max((wide(notice.words) for notice in notices), default=0) + SIGN
    cures = max((wide(cure.label) for notice in notices for cure in notice.cures[:SLOTS]), default=0) + CURE
    free = max(0.0, room(context) - words - cures)
    return max(WORDS[0], min(WORDS[1], (words + 0.5 * free) / room(context)))


def _words(layout: Any, notice: Notice) -> None:
    """The words of a notice; a click shows the place, a rest the whole sentence."""
    row = layout.row()
    row.alignment, row.alert = "LEFT", notice.kind == STOPS
    icon = "INFO" if notice.kind == INFORMATION else "ERROR"
    if "/" not in notice.key and notice.key != KEPT:  # nothing of the object that could be shown
        row.label(text=notice.words, icon=icon, translate=False)
        return
    button(row, "flexmaps.show_notice", notice.words, icon, emboss=False).key = notice.key


def cured(layout: Any, cure: Any) -> None:
    """The button of a cure."""
    pressed = button(layout, cure.idname, cure.label)
    for name, value in cure.properties.items():
        setattr(pressed, name, value)


class AllNotices(bpy.types.Panel):
    bl_idname = "FLEXMAPS_PT_notices"
    bl_label = "To look at"
    bl_space_type, bl_region_type = "VIEW_3D", "HEADER"
    bl_ui_units_x = 20

    def draw(self, context: bpy.types.Context) -> None:
        for notice in (*look(context).guidance.notices, *_around(context)):
            box = self.layout.box().column(align=True)
            _words(box, notice)
            sentence(box, context, notice.sentence, units=self.bl_ui_units_x)
            row = box.row(align=True)
            for cure in notice.cures:
                cured(row, cure)


# -- menus -------------------------------------------------------------------------------------------------------------


def _steps(layout: Any, context: bpy.types.Context) -> None:
    for idname, words, icon in (
        ("flexmaps.quad_remesh", "Quads", "MOD_REMESH"),
        ("flexmaps.set_size", "Scale to quad edge", "FULLSCREEN_ENTER"),
        ("flexmaps.merge", "Lay out the panels", "AUTOMERGE_ON"),
        ("flexmaps.fit", "Make it fit", "SHADERFX"),
        ("flexmaps.export", "Write the files", "EXPORT"),
        ("flexmaps.check", "Check the mesh", "VIEWZOOM"),
    ):
        button(layout, idname, tr(words), icon)


def _colours(layout: Any, context: bpy.types.Context) -> None:
    shown = context.window_manager.flexmaps_overlay
    for entry in GROUPS:
        if entry is None:
            layout.separator()
        else:
            kind, label = entry
            icon = "LAYER_ACTIVE" if kind == shown else "BLANK1"
            button(layout, "flexmaps.overlay", tr(label), icon).kind = kind


CLASSES = (AllNotices, menu("next", "Next", _steps), menu("colours", "Colours", _colours))
