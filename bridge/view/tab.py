"""State of the sidebar's tab, such as which section is open; kept in the window manager, never in a file."""

from __future__ import annotations

from collections.abc import Callable

import bpy
from bpy.props import BoolProperty, EnumProperty, PointerProperty

from ..store import guidance, objects
from ..store.i18n import CONTEXT

SECTIONS = ("piece", "layout", "shape", "check", "make", "show", "workshop")
CHECK_ITEMS = (("LOADS", "Loads", "What the piece bears"), ("BUILT", "As built", "The built piece beside the predicted one"),
          ("EXPLORE", "Explore", "Other sizes, sheets and materials beside each other"))  # fmt: skip
WORKSHOP_ITEMS = (("CUT", "Cut", "What the machine takes away"), ("JOINTS", "Joints", "Connectors of the panels"),
          ("SHEET", "Sheet", "How panels lie on their sheets"), ("FILES", "Files", "What the files hold"),
          ("PRICE", "Price", "What sheets and hours cost"), ("SOLVER", "Solver", "Numbers of the searches"))  # fmt: skip
_updating: list[bool] = []  # not empty while the program, not the user, opens and folds sections


def _on_open(key: str) -> Callable[[bpy.types.PropertyGroup, bpy.types.Context], None]:
    def update(self: bpy.types.PropertyGroup, context: bpy.types.Context) -> None:
        if not _updating:
            self.by_hand = True
            if getattr(self, f"open_{key}"):
                _show_only(self, key)

    return update


class Tab(bpy.types.PropertyGroup):
    """Which section is open (a property for each, named open_ and the section), and which tab is open within sections."""

    __annotations__ = {
        "by_hand": BoolProperty(),  # the user opened or folded a section since a stage's button was last pressed
        "check": EnumProperty(items=CHECK_ITEMS, name="Check", translation_context=CONTEXT),
        "habits": EnumProperty(items=WORKSHOP_ITEMS, name="Workshop", translation_context=CONTEXT),
    }


def _show_only(tab: bpy.types.PropertyGroup, key: str) -> None:
    _updating.append(True)
    try:
        for other in SECTIONS:
            setattr(tab, f"open_{other}", other == key)
    finally:
        _updating.pop()


def on_stage_start() -> None:
    """Handle the start of a stage: allow ``open_next_section`` to open another section when the stage ends."""
    bpy.context.window_manager.flexmaps_tab.by_hand = False


def open_next_section(context: bpy.types.Context) -> None:
    """Open the section of the next step, unless the user has opened or folded a section since the last stage began."""
    tab, obj = bpy.context.window_manager.flexmaps_tab, context.object
    if tab.by_hand or objects.usage_problem(obj) is not None:
        return
    act = guidance.read_guidance(obj, context.scene).action
    if act is not None:
        _show_only(tab, act.section)


def register() -> None:
    bpy.utils.register_class(Tab)
    # Blender 4.2 crashes on exit if a property with ``update`` is among the annotations
    for key in SECTIONS:
        setattr(Tab, f"open_{key}", BoolProperty(default=key == "piece", update=_on_open(key)))
    bpy.types.WindowManager.flexmaps_tab = PointerProperty(type=Tab)


def unregister() -> None:
    del bpy.types.WindowManager.flexmaps_tab
    for key in SECTIONS:
        delattr(Tab, f"open_{key}")
    bpy.utils.unregister_class(Tab)
