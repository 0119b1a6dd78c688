"""The brush that paints spirals: a tool of the 3D view, and its settings."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty, IntProperty, PointerProperty, StringProperty

from ..bridge.store.i18n import translate
from ..bridge.store.objects import unusable

TOOL = "flexmaps.brush"
ICONS = (
    "brush.generic",
    "brush.paint_weight.draw",
    "ops.generic.select_circle",
)  # of newer and older versions of Blender
SETTINGS = "window_manager.flexmaps_brush"  # where Blender's own F and Shift F find them
PAINTS = (
    ("stiffer", "Stiffer", "Wider arms, less wound; with Ctrl softer"),
    ("softer", "Softer", "Thinner arms, more wound; with Ctrl stiffer"),
    ("smooth", "Smooth", "More like the neighbours; with Shift every brush does that"),
    ("twist", "Twist", "More wound; with Ctrl less"),
    ("width", "Width", "Wider arms; with Ctrl thinner"),
    ("along", "Along", "Arms along the stroke wider and those across it thinner: stiff that way, soft the other; with Ctrl the other way round"),
    ("protect", "Protect", "Optimise and every other brush leave these spirals exactly as they are; with Ctrl not any longer"),
)  # fmt: skip
FROM = (("stiffness", "Stiffness", "As stiff as the numbers say: 0 the softest, 1 the stiffest"), *PAINTS)


def sources(self: Any, context: bpy.types.Context, text: str) -> list[str]:
    """Vertex groups, colours and other numbers of the active object, for the field in which one is named."""
    from ..bridge.store import fields

    return [] if unusable(context.object) is not None else fields.names(context.object)


class BrushSettings(bpy.types.PropertyGroup):
    """How the brush paints; of the window, as no file is about it."""

    brush: EnumProperty(name="Brush", items=PAINTS)  # type: ignore[valid-type]
    size: IntProperty(  # type: ignore[valid-type]
        name="Size",
        description="Radius of the brush in pixels; F changes it in the view",
        default=60,
        min=1,
        max=5000,
        soft_max=500,
        subtype="PIXEL",
    )
    strength: FloatProperty(  # type: ignore[valid-type]
        name="Strength",
        description="How much one stroke changes; Shift F changes it in the view",
        default=0.5,
        min=0.0,
        max=1.0,
        subtype="FACTOR",
    )
    pressure_size: BoolProperty(  # type: ignore[valid-type]
        name="Pressure on the size", description="The harder the pen is pressed, the larger the brush"
    )
    pressure_strength: BoolProperty(  # type: ignore[valid-type]
        name="Pressure on the strength",
        description="The harder the pen is pressed, the stronger the brush",
        default=True,
    )
    mirror: BoolProperty(name="Mirror X", description="Paint the other side of the object's x too")  # type: ignore[valid-type]
    what: EnumProperty(name="Sets", items=FROM)  # type: ignore[valid-type]
    source: StringProperty(  # type: ignore[valid-type]
        name="From", description="A vertex group, a colour or other numbers of this object", search=sources
    )
    direction: EnumProperty(  # type: ignore[valid-type]
        name="Along",
        items=(("x", "X", "Along the world's x"), ("y", "Y", "Along the world's y"), ("z", "Z", "Along the world's z")),
    )


def _keys(operator: str, **keys: Any) -> tuple[str, dict[str, Any], Any]:
    properties = keys.pop("properties", [])
    return operator, {"type": "LEFTMOUSE", "value": "PRESS"} | keys, {"properties": properties}


class BrushTool(bpy.types.WorkSpaceTool):
    bl_space_type = "VIEW_3D"
    bl_context_mode = "OBJECT"
    bl_idname = TOOL
    bl_label = "Paint Spirals"
    bl_description = "Paint the spirals of a FlexMaps surface stiffer, softer, smoother, or protect them"
    bl_icon = ""  # chosen when it is registered
    bl_cursor = "CROSSHAIR"
    bl_keymap = (
        _keys("flexmaps.paint_stroke"),
        _keys("flexmaps.paint_stroke", ctrl=True, properties=[("inverted", True)]),
        _keys("flexmaps.paint_stroke", shift=True, properties=[("smooth", True)]),
        _keys("wm.radial_control", type="F", properties=[("data_path_primary", f"{SETTINGS}.size")]),
        _keys("wm.radial_control", type="F", shift=True, properties=[("data_path_primary", f"{SETTINGS}.strength")]),
    )

    @staticmethod
    def draw_settings(context: Any, layout: Any, tool: Any) -> None:
        draw_settings(layout, context)

    @staticmethod
    def draw_cursor(context: Any, tool: Any, xy: tuple[float, float]) -> None:
        from gpu_extras.presets import draw_circle_2d

        draw_circle_2d(xy, (1.0, 1.0, 1.0, 0.8), context.window_manager.flexmaps_brush.size, segments=48)


def draw_settings(layout: Any, context: bpy.types.Context) -> None:
    """In the header of the view, as Blender's own brushes have it."""
    brush = context.window_manager.flexmaps_brush
    layout.prop(brush, "brush", text="")
    for name, pressure in (("size", "pressure_size"), ("strength", "pressure_strength")):
        row = layout.row(align=True)
        row.prop(brush, name)
        row.prop(brush, pressure, text="", icon="STYLUS_PRESSURE")
    layout.prop(brush, "mirror", text="X", toggle=True)
    layout.label(text=translate("Ctrl: the other way. Shift: smooth. F: size"), translate=False)


def register() -> None:
    from ..bridge.view import easel

    bpy.types.WindowManager.flexmaps_brush = PointerProperty(type=BrushSettings)
    handlers = bpy.app.handlers
    handlers.load_pre.append(easel.forget)
    handlers.undo_post.append(easel.renew)
    handlers.redo_post.append(easel.renew)
    if not bpy.app.background:  # without a window there is no toolbar
        icons = Path(bpy.utils.system_resource("DATAFILES"), "icons")
        BrushTool.bl_icon = next((name for name in ICONS if (icons / f"{name}.dat").is_file()), ICONS[-1])
        bpy.utils.register_tool(BrushTool, separator=True)


def unregister() -> None:
    from ..bridge.view import easel

    if not bpy.app.background:
        bpy.utils.unregister_tool(BrushTool)
    handlers = bpy.app.handlers
    handlers.load_pre.remove(easel.forget)
    handlers.undo_post.remove(easel.renew)
    handlers.redo_post.remove(easel.renew)
    easel.forget()
    del bpy.types.WindowManager.flexmaps_brush


CLASSES = (BrushSettings,)
