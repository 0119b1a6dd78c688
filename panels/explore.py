"""The panel of the candidates that were tried: what is varied, what they shall hold, and the best of them."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

import bpy
from bpy.app.translations import pgettext_iface as iface_

from ..bridge.store import explored
from ..engine.params import SHOWN, ExploreParams, ObjectSettings
from .rows import settings_rows, wrapped
from .stages import StagePanel

MOST = 8  # candidates in sight; by eye


class ExplorePanel(StagePanel, bpy.types.Panel):
    bl_idname = "FLEXMAPS_PT_explore"
    bl_label = "Explore"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        layout, obj = self.layout, context.object
        settings_rows(layout.column(align=True), obj.flexmaps.explore, ExploreParams)
        layout.operator("flexmaps.explore", icon="VIEWZOOM")
        found = explored.read(obj)
        if found is None:
            return
        wrapped(layout, context, found["note"], icon="INFO")
        for number, row in enumerate(found["rows"][:MOST]):
            _candidate(layout.box().column(align=True), number, row)


def _candidate(layout: Any, number: int, row: dict[str, Any]) -> None:
    """One candidate: what it has, its figures, and the button that takes it."""
    for name, value in row["values"].items():
        layout.label(text=_said(name, value), translate=False)
    measures = row["measures"]
    match, strain = measures.get("rms_percent", 0.0), 100 * measures.get("strain_share", 0.0)
    share = iface_("strain {} of its limit").format(f"{strain:.0f} %")
    layout.label(text=iface_("RMS distance {}, {}").format(f"{match:.2g} %", share), translate=False)
    layout.label(text=iface_("about {} sheets").format(int(measures.get("sheets", 0))), translate=False)
    layout.operator("flexmaps.use_candidate").number = number


def _said(name: str, value: Any) -> str:
    """A value as the sidebar says it where it is set."""
    if name == "edge":
        name = "remesh.edge"
    section, _, short = name.partition(".")
    block = {f.name: f.default_factory for f in fields(ObjectSettings)}.get(section)
    found = [f for f in fields(block) if f.name == short] if block is not None else []  # type: ignore[arg-type]
    if not found:  # of another version
        return f"{name} {value}"
    meta = found[0].metadata
    told = next((iface_(choice[1]) for choice in meta["choices"] if choice[0] == value), value)
    return f"{iface_(meta['label'])}: {told} {SHOWN[meta['unit']][1]}".rstrip()


CLASSES = (ExplorePanel,)
