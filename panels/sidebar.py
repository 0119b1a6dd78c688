"""The tab in the 3D view's sidebar: one sub-panel a stage, in the order of the walk from mesh to sheets."""

from __future__ import annotations

from typing import Any

import bpy
from bpy.app.translations import pgettext_iface as iface_

from ..bridge.hosts import background, preload
from ..bridge.store import equilibrium, notes
from ..bridge.store.objects import changed_by_modifiers, shared, unusable
from ..bridge.store.states import DONE
from ..bridge.view import collection, flat_panels
from ..engine import VERSION, versions
from ..engine.params import LayoutParams, RegulariseParams, SpiralParams
from . import brush, choose, explore, optimise, presets, simulate, structure
from .export import ExportPanel
from .rows import choice_row, decimals, fold, more, number, numbers, percent, setting_row, settings_rows, span, wrapped
from .stages import EMPHASIS, Sidebar, StagePanel, button, look, result

LAST = {"flexmaps.export", "wm.save_mainfile"}  # what comes after all that can be known without a sheet
SPIRAL = ("thickness", "width_min", "width_max")  # what is always in sight; the rest is folded away
WELCOME = (
    "FlexMaps turns a surface into flat panels that spring into its shape.",
    "Select any mesh and press the big button that appears here: it always offers the next step.",
    "Or begin with an example:",
)
CONVERTIBLE = {"CURVE", "SURFACE", "FONT", "META"}  # what Blender makes a mesh of at the press of a button
UNDRAWN = "The panels beside it are drawn without connectors yet; Export draws them as they will be cut"


class MainPanel(Sidebar, bpy.types.Panel):
    bl_idname = "FLEXMAPS_PT_main"
    bl_label = "FlexMaps"

    def draw_header_preset(self, context: bpy.types.Context) -> None:
        if unusable(context.object) is None:
            presets.PresetPanel.draw_panel_header(self.layout)

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        running = background.current()
        obj = context.object
        problem = unusable(obj)
        preload.start()
        if problem is None:
            look(context, afresh=True)
        if running is not None:
            text = iface_("stopping") if running.stopping else running.text or iface_("starting")
            layout.progress(factor=running.fraction, text=f"{iface_(running.title, 'Operator')}: {text}")
            if running.left:
                layout.label(text=iface_("about {} left").format(running.left), icon="TIME", translate=False)
            wrapped(layout, context, iface_("ESC stops it; {}").format(iface_(running.on_stop)), icon="CANCEL")
            return
        _left_over(layout, context)
        if problem is not None:
            wrapped(layout, context, problem, icon="INFO")
            if obj is not None and obj.type in CONVERTIBLE:
                layout.operator("object.convert", text="Convert to a mesh", icon="MESH_DATA").target = "MESH"
            _welcome(layout, context)
            return
        layout.label(text=obj.name, icon="MESH_DATA", translate=False)
        _version(layout, context, notes.made_with(obj.data))
        modifiers = changed_by_modifiers(obj)
        if modifiers is not None:
            wrapped(layout, context, modifiers, icon="MODIFIER")
            row = layout.row()
            row.active_default = True
            row.operator("object.convert", text="Apply all modifiers", icon="CHECKMARK").target = "MESH"
        others = shared(obj)
        if others:
            text = iface_("The mesh is shared with {}: seams and results are common to all").format(others)
            wrapped(layout, context, text, icon="LINKED")
        if modifiers is None or look(context).next_button == "flexmaps.quad_remesh":
            _next(layout, context, look(context).next_button)


def _left_over(layout: Any, context: bpy.types.Context) -> None:
    """Whoever deletes a model is asked about its panels: they may be wanted still."""
    found = collection.left_over(context.scene)
    if found:
        box = layout.box().column(align=True)
        names = ", ".join(f"'{one.get('flexmaps_owner')}'" for one in found[:2]) + ", ..." * (len(found) > 2)
        wrapped(box, context, iface_("{} was deleted, its panels are still there").format(names), icon="INFO")
        box.operator("flexmaps.remove_left_over", icon="TRASH")


def _version(layout: Any, context: bpy.types.Context, made_with: str) -> None:
    """Of a piece that another version made: which, and what changed since."""
    changed = versions.since(made_with)
    if versions.order(made_with) > versions.order(VERSION):
        text = iface_("Made with FlexMaps {}, which is newer than this {}: what is new there is not read")
        wrapped(layout, context, text.format(made_with, VERSION), icon="INFO")
    elif changed:
        wrapped(layout, context, iface_("Made with FlexMaps {}; since then:").format(made_with), icon="INFO")
        for text in changed:
            wrapped(layout, context, text, icon="BLANK1")


def _welcome(layout: Any, context: bpy.types.Context) -> None:
    """What this is for and where to begin, where there is nothing to work on yet."""
    box = layout.box().column(align=True)
    for line in WELCOME:
        wrapped(box, context, line)
    button = layout.row()
    button.scale_y = EMPHASIS
    button.operator("flexmaps.example", icon="ADD")
    layout.operator("flexmaps.tutorial", icon="LIGHT")


def _next(layout: Any, context: bpy.types.Context, idname: str) -> None:
    """The button that a person would press now, always in sight; before the files are written, with what speaks against it."""
    if not idname:
        _done(layout, context)
        return
    if idname in LAST:
        block = notes.read(context.object.data).get("equilibrium", {})
        for text in equilibrium.warnings(block):
            wrapped(layout.box(), context, text, icon="ERROR")
    group, name = idname.split(".")
    label = getattr(getattr(bpy.ops, group), name).get_rna_type().name
    row = layout.row()
    row.scale_y = EMPHASIS
    row.active_default = True
    row.operator(idname, text=iface_("Next: {}").format(iface_(label, "Operator")), icon="PLAY", translate=False)


def _done(layout: Any, context: bpy.types.Context) -> None:
    """After the last stage: that nothing is left to do, and where the files are."""
    if look(context).states["sheets"].kind != DONE:
        return
    block = notes.read(context.object.data)["sheets"]
    text = iface_("All is done. Sheets: {}, files: {}").format(block.get("sheets"), len(block.get("files", ())))
    box = layout.box().column(align=True)
    wrapped(box, context, text, icon="CHECKMARK")
    folder = bpy.path.abspath(context.object.flexmaps.export.folder)
    box.operator("wm.path_open", text="Open the folder", icon="FILE_FOLDER").filepath = folder


class MeshPanel(StagePanel, bpy.types.Panel):
    bl_idname = "FLEXMAPS_PT_mesh"
    bl_label = "Mesh"
    stage = "checks"

    def draw(self, context: bpy.types.Context) -> None:
        layout, settings = self.layout, context.object.flexmaps
        button(layout, context, "flexmaps.check", icon="VIEWZOOM")
        _findings(result(layout, context, "checks"), context)
        column = layout.column(align=True)
        setting_row(column, settings.remesh, "quads")
        button(column, context, "flexmaps.quad_remesh", icon="MOD_REMESH")
        column = layout.column(align=True)
        setting_row(column, settings.remesh, "edge")
        button(column, context, "flexmaps.set_size", icon="FULLSCREEN_ENTER")
        button(layout, context, "flexmaps.regularise", icon="MOD_SMOOTH")
        body = fold(layout, "flexmaps_mesh", "More settings")
        if body is not None:
            setting_row(body, settings.remesh, "smooth")
            settings_rows(body, settings.regularise, RegulariseParams)


def _findings(layout: Any, context: bpy.types.Context) -> None:
    checks = notes.read(context.object.data).get("checks")
    if checks == []:
        wrapped(layout, context, "Nothing to complain about", icon="CHECKMARK")
    for index, finding in enumerate(checks or ()):
        row = layout.box().row()
        icon = "ERROR" if finding["severity"] == "warning" else "CANCEL"
        wrapped(row.column(), context, finding["message"], icon=icon, beside=30)
        if finding["faces"] or finding["edges"]:
            row.operator("flexmaps.show_finding", text="", icon="RESTRICT_SELECT_OFF").index = index


class PatchPanel(StagePanel, bpy.types.Panel):
    bl_idname = "FLEXMAPS_PT_patches"
    bl_label = "Patches"
    stage = "layout"

    def draw(self, context: bpy.types.Context) -> None:
        layout, obj = self.layout, context.object
        row = layout.row(align=True)
        button(row, context, "flexmaps.trace", icon="GRID")
        button(row, context, "flexmaps.merge", icon="AUTOMERGE_ON")
        column = layout.column(align=True)
        button(column, context, "flexmaps.update_from_seams", icon="FILE_REFRESH")
        column.operator("flexmaps.flatten", text="Flatten all", icon="UV")
        more(layout, "flexmaps_layout", obj.flexmaps.layout, LayoutParams)
        block = notes.read(obj.data).get("layout")
        if block is None:
            return
        limit = obj.flexmaps.layout.distortion_limit
        layout = result(layout, context, "layout")
        grid = numbers(layout)
        number(grid, "Patches", f"{block.get('patches')}")
        number(
            grid,
            "Largest distortion",
            decimals(block, "energy_max", 4),
            alert=block.get("energy_max", 0) > limit * 1.0001,
        )
        number(grid, "Seam mismatch", percent(block, "seam_mismatch_max"))
        for name, label in (("flips", "Flipped triangles"), ("overlaps", "Overlapping patches")):
            if block.get(name):
                number(grid, label, str(block[name]), alert=True)
        first, *others = block.get("remarks") or [""]
        if first:
            wrapped(layout, context, first, icon="ERROR")
        if others:
            wrapped(layout, context, iface_("and {} more; Report tells them all").format(len(others)), icon="BLANK1")
        rest = fold(layout, "flexmaps_layout_rest", "More figures")
        if rest is not None:
            number(rest, "Smallest neck", iface_("{} quads").format(block.get("neck_min_quads", "-")))
            number(rest, "Smallest patch", iface_("{} quads").format(block.get("smallest_patch", "-")))
            number(rest, "Least compact patch", decimals(block, "compactness_max", 2))
            number(rest, "Edges cut", str(block.get("cut_edges", "-")))
        kinds = (("ENERGY", "Distortion"), ("SQUARE", "Square"), ("PATCH", "Patches"))
        choice_row(layout, context.window_manager, "flexmaps_overlay", kinds)


class SpiralPanel(StagePanel, bpy.types.Panel):
    bl_idname = "FLEXMAPS_PT_spirals"
    bl_label = "Spirals"
    stage = "spirals"

    def draw(self, context: bpy.types.Context) -> None:
        layout, obj = self.layout, context.object
        settings_rows(layout.column(align=True), obj.flexmaps.spiral, SpiralParams, SPIRAL)
        button(layout, context, "flexmaps.spirals", icon="FORCE_VORTEX")
        more(layout, "flexmaps_spiral", obj.flexmaps.spiral, SpiralParams, SPIRAL)
        block = notes.read(obj.data).get("spirals")
        if block is None:
            return
        brush.draw(layout, context)
        layout = result(layout, context, "spirals")
        grid = numbers(layout)
        number(grid, "Spirals", str(block.get("count")))
        number(grid, "Width", span(block, "width_mm", " mm"))
        if block.get("unlike_percent", [0.0])[-1] > 0:
            number(grid, "Unlike arms", span(block, "unlike_percent", " %"))
        number(grid, "Twist", span(block, "twist_deg", "\N{DEGREE SIGN}"))
        if "slot_min_mm" in block:  # measured with the finished outlines, not after every stroke of a brush
            number(grid, "Smallest slot", decimals(block, "slot_min_mm", 2, " mm"))
        if any(panels.get(flat_panels.LOOK) == flat_panels.PLAIN for panels in flat_panels.panels_of(obj)):
            wrapped(layout, context, UNDRAWN, icon="INFO")
        kinds = (("STIFFNESS", "Stiffness"), ("WIDTH", "Width"), ("ANISOTROPY", "Anisotropy"), ("TWIST", "Twist"))
        choice_row(layout, context.window_manager, "flexmaps_overlay", kinds)


CLASSES = (
    MainPanel,
    presets.PresetPanel,
    MeshPanel,
    PatchPanel,
    *choose.CLASSES,
    SpiralPanel,
    simulate.SimulatePanel,
    *structure.CLASSES,
    optimise.OptimisePanel,
    *explore.CLASSES,
    ExportPanel,
)
