"""Generate Blender properties from the dataclasses of settings in ``engine/params``, and convert values both ways.

Settings belong to the object: two pieces in one file differ in size and sheet, and a copied or appended object keeps
its settings. Lengths are plain numbers in millimetres and angles plain numbers in degrees, whatever the scene's units:
they are dimensions of a cut piece, and Blender's own length properties clamp wrongly unless the unit scale is 1.
"""

from __future__ import annotations

from dataclasses import Field, fields, is_dataclass
from functools import cache
from typing import Any, TypeVar, get_type_hints

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty, IntProperty, PointerProperty, StringProperty

from ...engine.params import SHOWN, ObjectSettings
from .i18n import CONTEXT

T = TypeVar("T")
# default lengths in mm: from LARGE on, one decimal is shown; below FINE four decimals; between them two
ONE_DECIMAL_FROM, FOUR_DECIMALS_BELOW = 100.0, 0.05

_groups: dict[type, type[bpy.types.PropertyGroup]] = {}


def _make_property(f: Field) -> Any:
    """Return the Blender property of a setting."""
    meta = f.metadata
    unit = SHOWN[meta["unit"]][1]
    label = f"{meta['label']} ({unit})" if unit else meta["label"]
    common = {"name": label, "description": meta["help"], "translation_context": CONTEXT}
    default: Any = f.default
    if meta["choices"]:
        return EnumProperty(items=[tuple(choice) for choice in meta["choices"]], default=default, **common)
    if isinstance(default, bool):
        return BoolProperty(default=default, **common)
    if isinstance(default, str):
        if meta["folder"]:
            # Blender 4.5 and later need this option to accept a path that begins with //
            options = {"PATH_SUPPORTS_BLEND_RELATIVE"} if bpy.app.version >= (4, 5, 0) else set()
            return StringProperty(default=default, subtype="DIR_PATH", options=options, **common)
        return StringProperty(default=default, **common)
    factor = SHOWN[meta["unit"]][0]
    bounds = {name: meta[key] * factor for name, key in (("min", "low"), ("max", "high")) if meta[key] is not None}
    if isinstance(default, int):
        return IntProperty(default=default, **{k: int(v) for k, v in bounds.items()}, **common)
    step = {"mm": 10, "\N{DEGREE SIGN}": 500}.get(unit, 1)
    # show a number from 0 to 1 as a slider
    subtype = "FACTOR" if (meta["low"], meta["high"]) == (0.0, 1.0) else "NONE"
    shown = default * factor
    precision = (
        3
        if not unit
        else 1
        if unit != "mm" or shown >= ONE_DECIMAL_FROM
        else 2
        if shown >= FOUR_DECIMALS_BELOW or not shown
        else 4
    )
    return FloatProperty(default=shown, precision=precision, step=step, subtype=subtype, **bounds, **common)


def property_group(cls: type) -> type[bpy.types.PropertyGroup]:
    """Return the registered PropertyGroup class of a settings dataclass; nested dataclasses become nested groups."""
    if cls not in _groups:
        hints = get_type_hints(cls)
        annotations: dict[str, Any] = {}
        for f in fields(cls):
            inner: type = hints[f.name]
            annotations[f.name] = (
                PointerProperty(type=property_group(inner)) if is_dataclass(inner) else _make_property(f)
            )
        # keep settings of earlier versions for old files and presets; read() prefers their successors where set
        for name in getattr(cls, "WERE", {}):
            annotations[name] = BoolProperty(default=True, options={"HIDDEN"})
        made = type(f"FLEXMAPS_PG_{cls.__name__}", (bpy.types.PropertyGroup,), {"__annotations__": annotations})
        bpy.utils.register_class(made)
        _groups[cls] = made
    return _groups[cls]


@cache
def _field_types(cls: Any) -> dict[str, Any]:
    """Return the types of a dataclass's fields; cached, because the live simulation reads them at every change."""
    return get_type_hints(cls)


def _round_float32(value: float) -> float:
    """Round a float32 to the decimal number that was typed in: 0.30000001192 to 0.3."""
    return float(f"{value:.7g}")


def read(properties: bpy.types.PropertyGroup, cls: type[T]) -> T:
    """Return the engine's settings from a property group made by ``property_group(cls)``.

    Parameters
    ----------
    properties : a property group
    cls : dataclass of settings

    Raises
    ------
    FlexMapsError for a value out of bounds.
    """
    hints = _field_types(cls)  # type: ignore[arg-type]
    values: dict[str, Any] = {}
    for f in fields(cls):  # type: ignore[arg-type]
        value = getattr(properties, f.name)
        if is_dataclass(hints[f.name]):
            values[f.name] = read(value, hints[f.name])
        elif hints[f.name] is float:
            values[f.name] = _round_float32(value) / SHOWN[f.metadata["unit"]][0]
        else:
            values[f.name] = value
    for name, instead in getattr(cls, "WERE", {}).items():
        if not getattr(properties, name):
            values |= {key: value for key, value in instead.items() if not properties.is_property_set(key)}
    return cls(**values)


def write(properties: bpy.types.PropertyGroup, settings: Any) -> None:
    """Store the engine's settings in a property group made by ``property_group(type(settings))``.

    Parameters
    ----------
    properties : a property group
    settings : instance of a dataclass of settings
    """
    for f in fields(settings):
        value = getattr(settings, f.name)
        if is_dataclass(value):
            write(getattr(properties, f.name), value)
        elif isinstance(value, float):
            setattr(properties, f.name, value * SHOWN[f.metadata["unit"]][0])
        else:
            setattr(properties, f.name, value)


def format_changed(properties: bpy.types.PropertyGroup, excluded: tuple[str, ...] = ()) -> str:
    """Return the settings of a group that differ from their defaults, as text for checksums; fast enough for a redraw.

    Parameters
    ----------
    properties : a property group
    excluded : names of settings to leave out
    """
    texts = []
    for name, prop in properties.bl_rna.properties.items():
        if name in {"rna_type", "name", *excluded} or prop.type == "POINTER":
            continue
        value = getattr(properties, name)
        if value != prop.default:
            texts.append(f"{name}={value:.6g}" if prop.type == "FLOAT" else f"{name}={value}")
    return " ".join(texts)


def is_relative_to_unsaved(path: str) -> bool:
    """Return whether a path is relative to a .blend file that was never saved."""
    return path.startswith("//") and not bpy.data.filepath


def register() -> None:
    bpy.types.Object.flexmaps = PointerProperty(type=property_group(ObjectSettings), name="FlexMaps")


def unregister() -> None:
    del bpy.types.Object.flexmaps
    for made in reversed(list(_groups.values())):
        bpy.utils.unregister_class(made)
    _groups.clear()
