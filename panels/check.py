"""The section *Check*, with three tabs: loads on the piece, the piece as built, and exploration of other designs."""

from __future__ import annotations

from importlib import import_module
from typing import Any

import bpy

from ..engine.extras import registry
from .rows import tr
from .stages import read_stages

_MISSING = registry.missing_modules("panels")
# tab -> module that draws it; tabs of extras (optional features) that are not installed are left out
MODULES: dict[str, Any] = {
    kind: import_module(f"{__package__}.{name}")
    for kind, name in (("LOADS", "loads"), ("BUILT", "built"), ("EXPLORE", "candidates"))
    if name not in _MISSING
}


def draw(body: Any, context: bpy.types.Context) -> None:
    tab, row = context.window_manager.flexmaps_tab, body.row(align=True)
    for kind in MODULES:
        row.prop_enum(tab, "check", kind)
    if tab.check in MODULES:
        MODULES[tab.check].draw(body, context)


def heading_text(context: bpy.types.Context) -> str:
    """Return the text beside the folded section's heading: the smallest load factor at which the piece gives way.

    For load cases without a failure, the largest load factor examined counts.
    """
    block = read_stages(context).blocks.get("structure")
    if block is None or not block["outcomes"]:
        return ""
    least = min(row["followed_to"] if row["critical"] is None else row["critical"] for row in block["outcomes"])
    return tr("{} times", f"{least:.3g}")


CLASSES = tuple(cls for module in MODULES.values() for cls in module.CLASSES)
