"""The Simulate panel: material, supports and loads, and the shape that was found."""

from __future__ import annotations

from typing import Any

import bpy
from bpy.app.translations import pgettext_iface as iface_

from ..bridge.store import equilibrium, notes
from ..engine.params import LoadParams, MaterialParams, SimulateParams
from .live import handle_rows, live_rows
from .rows import choice_row, fold, number, numbers, settings_rows, wrapped
from .stages import StagePanel, button, result

LOADS = ("gravity", "clamped")
CUSTOM = ("youngs", "across", "shear", "poisson", "density", "strain_limit", "lasting_share", "lasting_strain")


class SimulatePanel(StagePanel, bpy.types.Panel):
    bl_idname = "FLEXMAPS_PT_simulate"
    bl_label = "Simulate"
    stage = "equilibrium"

    def draw(self, context: bpy.types.Context) -> None:
        layout, obj = self.layout, context.object
        settings = obj.flexmaps
        column = layout.column(align=True)
        column.prop(settings.material, "material", text="")
        if settings.material.material == "custom":
            settings_rows(column, settings.material, MaterialParams, CUSTOM)
        row = layout.row(align=True)
        button(row, context, "flexmaps.simulate", icon="PHYSICS")
        live_rows(layout, row, context)
        body = fold(layout, "flexmaps_loads", "Supports and loads")
        if body is not None:
            _loads(body, obj)
        body = fold(layout, "flexmaps_simulate", "More settings")
        if body is not None:
            names = ("model", "iterations", "tolerance", "restarts")
            settings_rows(body, settings.simulate, SimulateParams, names)
        block = notes.read(obj.data).get("equilibrium")
        if block is not None:
            _equilibrium(result(layout, context, "equilibrium"), context, obj, block)
        body = fold(layout, "flexmaps_scan", "As built")
        if body is not None:
            body.operator("flexmaps.compare_file", icon="POINTCLOUD_DATA")
            block = notes.read(obj.data).get("scan")
            if block is not None:
                body.separator(factor=0.5)
                _scan(result(body, context, "scan"), context, block)


def _loads(layout: Any, obj: bpy.types.Object) -> None:
    settings = obj.flexmaps
    handle_rows(layout, obj)
    layout.prop_search(settings.loads, "supports", obj, "vertex_groups")
    if settings.loads.supports:
        layout.prop(settings.simulate, "clamped")
    layout.prop(settings.simulate, "gravity")
    layout.prop_search(settings.loads, "pulled", obj, "vertex_groups")
    if settings.loads.pulled:
        settings_rows(layout, settings.loads, LoadParams, ("force_x", "force_y", "force_z"))


def _equilibrium(layout: Any, context: bpy.types.Context, obj: bpy.types.Object, block: dict[str, Any]) -> None:
    """What the last simulation found, and the slider between target and result."""
    column = layout.column(align=True)
    for key in equilibrium.keys_of(obj.data):
        name = iface_("equilibrium") if key.name == equilibrium.KEY else key.name.removeprefix("FlexMaps ")
        column.prop(key, "value", text=iface_("Target to {}").format(name), slider=True, translate=False)
    if not equilibrium.sound(block):
        wrapped(layout.box(), context, block["status"], icon="ERROR")
    for text in equilibrium.remarks(block):
        wrapped(layout.box(), context, text, icon="ERROR")
    grid = numbers(layout)
    size = "{:.2f} mm, {:.2f} %"
    number(grid, "RMS distance", size.format(block["rms_mm"], block["rms_percent"]))
    number(grid, "Largest distance", size.format(block["max_mm"], block["max_percent"]))
    strain = block.get("strain_share_max")
    if strain is not None:
        number(
            grid, "Largest strain", iface_("{:.0f} % of limit").format(100 * strain), alert=equilibrium.strained(block)
        )
    others = block.get("other_energies", ())
    if others:
        number(grid, "Energy", f"{1e3 * block['energy']:.4g} mJ")
    for k, energy in enumerate(others):
        number(grid, iface_("Energy, other shape {}").format(k + 1), f"{1e3 * energy:.4g} mJ")
    if not block.get("converged"):
        number(grid, "Iterations", str(block.get("iterations")), alert=True)
    kinds = (("DISTANCE", "Distance"), ("STRAIN_ENERGY", "Energy"), ("SAFETY", "Safety"), ("SLOT", "Slots"))
    choice_row(layout, context.window_manager, "flexmaps_overlay", kinds)


def _scan(layout: Any, context: bpy.types.Context, block: dict[str, Any]) -> None:
    """What the comparison with a scan found."""
    for text in block["remarks"]:
        wrapped(layout, context, text, icon="INFO")
    grid = numbers(layout)
    size = "{:.2f} mm, {:.2f} %"
    number(grid, "RMS distance", size.format(block["rms_mm"], block["rms_percent"]))
    number(grid, "Largest distance", size.format(block["max_mm"], block["max_percent"]))
    number(grid, "Spirals shown", f"{100 * block['covered']:.0f} %")
    number(grid, "Points beside the piece", f"{100 * block['points_beside']:.0f} %")
    choice_row(layout, context.window_manager, "flexmaps_overlay", (("SCAN", "Distance of the scan"),))
