"""Settings of the brush that paints spirals, stored in Blender's window manager."""

from __future__ import annotations

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty, IntProperty, PointerProperty, StringProperty

from ..store.objects import usage_problem

BRUSH_ITEMS = (
    ("stiffer", "Stiffer", "Wider arms, less wound; with Ctrl softer"),
    ("softer", "Softer", "Thinner arms, more wound; with Ctrl stiffer"),
    ("smooth", "Smooth", "More like the neighbours; with Shift every brush does that"),
    ("twist", "Twist", "More wound; with Ctrl less"),
    ("width", "Width", "Wider arms; with Ctrl thinner"),
    ("along", "Along", "Arms along the stroke wider and those across it thinner: stiff that way, soft the other; with Ctrl the other way round"),
    ("protect", "Protect", "Optimise and every other brush leave these spirals exactly as they are; with Ctrl not any longer"),
)  # fmt: skip
QUANTITY_ITEMS = (
    ("stiffness", "Stiffness", "Stiffness relative to the allowed range: 0 is the softest, 1 the stiffest"),
    *BRUSH_ITEMS,
)


def search_sources(self: bpy.types.PropertyGroup, context: bpy.types.Context, text: str) -> list[str]:
    """List vertex groups, colours and other attributes of the active object, as choices of the field *From*.

    Parameters
    ----------
    context : context with the active object
    text : the typed text; unused, because Blender filters the names itself
    """
    from ..store import fields

    return [] if usage_problem(context.object) is not None else fields.list_fields(context.object)


class BrushSettings(bpy.types.PropertyGroup):
    """Settings of the brush, stored in the window manager because they do not belong to a file."""

    brush: EnumProperty(name="Brush", items=BRUSH_ITEMS)  # type: ignore[valid-type]
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
        description="Change by one stroke; Shift F adjusts it in the view",
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
    what: EnumProperty(name="Sets", items=QUANTITY_ITEMS)  # type: ignore[valid-type]
    source: StringProperty(  # type: ignore[valid-type]
        name="From", description="A vertex group, a colour or other numbers of this object", search=search_sources
    )
    direction: EnumProperty(  # type: ignore[valid-type]
        name="Along",
        items=(("x", "X", "Along the world's x"), ("y", "Y", "Along the world's y"), ("z", "Z", "Along the world's z")),
    )


def register() -> None:
    bpy.types.WindowManager.flexmaps_brush = PointerProperty(type=BrushSettings)


def unregister() -> None:
    del bpy.types.WindowManager.flexmaps_brush
