"""The tab in the 3D view's sidebar: one sub-panel a stage, in the order of the walk from mesh to sheets."""

from __future__ import annotations

from typing import Any

import bpy

from ..bridge import equilibrium, job, notes
from ..bridge.objects import changed_by_modifiers, unusable
from ..engine.params import (
    ConnectorParams,
    CutParams,
    ExportParams,
    LayoutParams,
    LoadParams,
    MaterialParams,
    RegulariseParams,
    SheetParams,
    SimulateParams,
    SpiralParams,
)
from . import optimise
from .rows import choice_row, more, number, numbers, settings_rows, wrapped

# what is always in sight; the rest is folded away
SPIRAL = ("thickness", "width_min", "width_max")
LOADS = ("gravity", "clamped")
SHEET = ("sheet_width", "sheet_height")
CONNECT, CONNECTOR_FIT = ("connector",), ("clearance",)


class Sidebar:
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "FlexMaps"


class MainPanel(Sidebar, bpy.types.Panel):
    bl_idname = "FLEXMAPS_PT_main"
    bl_label = "FlexMaps"

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        running = job.current()
        if running is not None:
            text = "stopping" if running.stopping else running.text or "starting"
            layout.progress(factor=running.fraction, text=f"{running.title}: {text}")
            layout.label(text=f"ESC stops it; {running.on_stop}", icon="CANCEL")
            return
        obj = context.object
        problem = unusable(obj)
        if problem is not None:
            wrapped(layout, context, problem, icon="INFO")
            return
        layout.label(text=obj.name, icon="MESH_DATA")
        modifiers = changed_by_modifiers(obj)
        if modifiers is not None:
            wrapped(layout, context, modifiers, icon="MODIFIER")


class StagePanel(Sidebar):
    bl_parent_id = "FLEXMAPS_PT_main"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return unusable(context.object) is None


class MeshPanel(StagePanel, bpy.types.Panel):
    bl_idname = "FLEXMAPS_PT_mesh"
    bl_label = "Mesh"

    def draw(self, context: bpy.types.Context) -> None:
        layout, settings = self.layout, context.object.flexmaps
        column = layout.column(align=True)
        column.prop(settings.remesh, "quads")
        column.prop(settings.remesh, "smooth")
        column.operator("flexmaps.quad_remesh", icon="MOD_REMESH")
        column = layout.column(align=True)
        column.prop(settings.remesh, "edge")
        column.operator("flexmaps.set_size", icon="FULLSCREEN_ENTER")
        column = layout.column(align=True)
        settings_rows(column, settings.regularise, RegulariseParams)
        column.operator("flexmaps.regularise", icon="MOD_SMOOTH")
        layout.operator("flexmaps.check", icon="CHECKMARK")
        checks = notes.read(context.object.data).get("checks")
        if checks == []:
            layout.label(text="Nothing to complain about", icon="CHECKMARK")
        for index, finding in enumerate(checks or ()):
            box = layout.box()
            icon = "ERROR" if finding["severity"] == "warning" else "CANCEL"
            wrapped(box, context, finding["message"], icon=icon)
            if finding["faces"] or finding["edges"]:
                box.operator("flexmaps.show_finding", text="Show", icon="RESTRICT_SELECT_OFF").index = index


class PatchPanel(StagePanel, bpy.types.Panel):
    bl_idname = "FLEXMAPS_PT_patches"
    bl_label = "Patches"

    def draw(self, context: bpy.types.Context) -> None:
        layout, obj = self.layout, context.object
        more(layout, "flexmaps_layout", obj.flexmaps.layout, LayoutParams)
        row = layout.row(align=True)
        row.operator("flexmaps.trace", icon="GRID")
        row.operator("flexmaps.merge", icon="AUTOMERGE_ON")
        column = layout.column(align=True)
        column.operator("flexmaps.update_from_seams", icon="FILE_REFRESH")
        column.operator("flexmaps.flatten", text="Flatten all", icon="UV")
        block = notes.read(obj.data).get("layout")
        if block is None:
            return
        limit = obj.flexmaps.layout.distortion_limit
        grid = numbers(layout)
        number(grid, "Patches", f"{block.get('patches')}")
        number(grid, "Largest E", _decimals(block, "energy_max", 4), alert=block.get("energy_max", 0) > limit * 1.0001)
        number(grid, "Seam mismatch", _percent(block, "seam_mismatch_max"))
        number(grid, "Smallest neck", f"{block.get('neck_min_quads')} quads")
        for name in ("flips", "overlaps"):
            if block.get(name):
                number(grid, name.capitalize(), str(block[name]), alert=True)
        choice_row(
            layout,
            context.window_manager,
            "flexmaps_overlay",
            (("ENERGY", "E"), ("SQUARE", "Esq"), ("PATCH", "Patches")),
        )


class SpiralPanel(StagePanel, bpy.types.Panel):
    bl_idname = "FLEXMAPS_PT_spirals"
    bl_label = "Spirals"

    def draw(self, context: bpy.types.Context) -> None:
        layout, obj = self.layout, context.object
        settings_rows(layout.column(align=True), obj.flexmaps.spiral, SpiralParams, SPIRAL)
        more(layout, "flexmaps_spiral", obj.flexmaps.spiral, SpiralParams, SPIRAL)
        layout.operator("flexmaps.spirals", icon="FORCE_VORTEX")
        block = notes.read(obj.data).get("spirals")
        if block is None:
            return
        grid = numbers(layout)
        number(grid, "Spirals", str(block.get("count")))
        number(grid, "Width", _range(block, "width_mm", " mm"))
        number(grid, "Twist", _range(block, "twist_deg", "\N{DEGREE SIGN}"))
        number(grid, "Smallest slot", _decimals(block, "slot_min_mm", 2, " mm"))
        choice_row(layout, context.window_manager, "flexmaps_overlay", (("WIDTH", "Width"), ("TWIST", "Twist")))


class SimulatePanel(StagePanel, bpy.types.Panel):
    bl_idname = "FLEXMAPS_PT_simulate"
    bl_label = "Simulate"

    def draw(self, context: bpy.types.Context) -> None:
        layout, obj = self.layout, context.object
        settings = obj.flexmaps
        column = layout.column(align=True)
        column.prop(settings.material, "material", text="")
        if settings.material.material == "custom":
            settings_rows(column, settings.material, MaterialParams, ("youngs", "poisson", "density", "strain_limit"))
        column = layout.column(align=True)
        column.prop_search(settings.loads, "supports", obj, "vertex_groups")
        if settings.loads.supports:
            column.prop(settings.simulate, "clamped")
        column.prop(settings.simulate, "gravity")
        column.prop_search(settings.loads, "pulled", obj, "vertex_groups")
        if settings.loads.pulled:
            settings_rows(column, settings.loads, LoadParams, ("force_x", "force_y", "force_z"))
        more(layout, "flexmaps_simulate", settings.simulate, SimulateParams, LOADS)
        layout.operator("flexmaps.simulate", icon="PLAY")
        block = notes.read(obj.data).get("equilibrium")
        if block is None:
            return
        if equilibrium.out_of_date(obj, context.scene):
            wrapped(layout, context, "The mesh or a setting was changed since; press Simulate again", icon="ERROR")
            return
        _equilibrium(layout, context, obj, block)


def _equilibrium(layout: Any, context: bpy.types.Context, obj: bpy.types.Object, block: dict[str, Any]) -> None:
    """What the last simulation found, and the slider between target and result."""
    column = layout.column(align=True)
    for key in equilibrium.keys_of(obj.data):
        name = "equilibrium" if key.name == equilibrium.KEY else key.name.removeprefix("FlexMaps ")
        column.prop(key, "value", text=f"Target to {name}", slider=True)
    if not equilibrium.sound(block):
        wrapped(layout.box(), context, block["status"], icon="ERROR")
    grid = numbers(layout)
    number(grid, "Iterations", str(block.get("iterations")), alert=not block.get("converged"))
    size = "{:.2f} mm, {:.2f} %"
    number(grid, "RMS distance", size.format(block["rms_mm"], block["rms_percent"]))
    number(grid, "Largest distance", size.format(block["max_mm"], block["max_percent"]))
    strain = block.get("strain_share_max")
    if strain is not None:
        number(grid, "Largest strain", f"{100 * strain:.0f} % of limit", alert=strain > 1.0)
    others = block.get("other_energies", ())
    if others:
        number(grid, "Energy", f"{1e3 * block['energy']:.4g} mJ")
    for k, energy in enumerate(others):
        number(grid, f"Energy, other shape {k + 1}", f"{1e3 * energy:.4g} mJ")
    choice_row(
        layout,
        context.window_manager,
        "flexmaps_overlay",
        (("DISTANCE", "Distance"), ("STRAIN_ENERGY", "Energy"), ("SAFETY", "Safety")),
    )


class OptimisePanel(StagePanel, bpy.types.Panel):
    bl_idname = "FLEXMAPS_PT_optimise"
    bl_label = "Optimise"

    def draw(self, context: bpy.types.Context) -> None:
        optimise.rows(self.layout, context, context.object)


class ExportPanel(StagePanel, bpy.types.Panel):
    bl_idname = "FLEXMAPS_PT_export"
    bl_label = "Export"

    def draw(self, context: bpy.types.Context) -> None:
        layout, obj = self.layout, context.object
        settings = obj.flexmaps
        settings_rows(layout.column(align=True), settings.sheet, SheetParams, SHEET)
        more(layout, "flexmaps_sheet", settings.sheet, SheetParams, SHEET)
        column = layout.column(align=True)
        settings_rows(column, settings.connect, ConnectorParams, CONNECT)
        if settings.connect.connector != "none":
            settings_rows(column, settings.connect, ConnectorParams, CONNECTOR_FIT)
            more(layout, "flexmaps_connect", settings.connect, ConnectorParams, CONNECT + CONNECTOR_FIT)
        settings_rows(layout.column(align=True), settings.cut, CutParams)
        settings_rows(layout.column(align=True), settings.export, ExportParams)
        layout.operator("flexmaps.export", icon="EXPORT")
        block = notes.read(obj.data).get("sheets")
        if block is None:
            return
        grid = numbers(layout)
        number(grid, "Sheets", str(block.get("sheets")))
        number(grid, "Filled", _percent(block, "fill"))
        number(grid, "Cut length", _decimals(block, "cut_length_m", 1, " m"))
        if "cut_minutes" in block:
            number(grid, "Laser, about", _duration(block["cut_minutes"]))
        number(grid, "Mass", _decimals(block, "mass_g", 0, " g"))
        number(grid, "Narrowest arm", _decimals(block, "bridge_min_mm", 2, " mm"))
        number(grid, "Joints", str(block.get("joints", "-")))
        if block.get("unsolved"):
            number(grid, "Without connector", str(len(block["unsolved"])), alert=True)
        if block.get("joints"):
            number(grid, "Assembly, about", _duration(block.get("assembly_minutes", 0)))
        number(grid, "Files", str(len(block.get("files", ()))))


def _duration(minutes: float) -> str:
    return f"{max(minutes, 1):.0f} min" if minutes < 90 else f"{minutes / 60:.1f} h"


def _decimals(block: dict[str, Any], key: str, digits: int, unit: str = "") -> str:
    value = block.get(key)
    return "-" if value is None else f"{value:.{digits}f}{unit}"


def _percent(block: dict[str, Any], key: str) -> str:
    value = block.get(key)
    return "-" if value is None else f"{100 * value:.1f} %"


def _range(block: dict[str, Any], key: str, unit: str) -> str:
    values = block.get(key)
    return "-" if not values else f"{values[0]:.3g} to {values[-1]:.3g}{unit}"


CLASSES = (MainPanel, MeshPanel, PatchPanel, SpiralPanel, SimulatePanel, OptimisePanel, ExportPanel)
