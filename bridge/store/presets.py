"""Where Blender keeps a person's own presets of FlexMaps, and writing one there."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import MISSING, fields
from functools import lru_cache
from operator import attrgetter
from pathlib import Path
from typing import Any

import bpy

from ...engine import files
from ...engine.errors import FlexMapsError
from ...engine.params import ObjectSettings

SUBFOLDER = "flexmaps"  # of Blender's folder of presets
OWN = {"loads", "export.folder", "render.file"}  # settings of the object, not of a way to work
TAKEN = "flexmaps_preset"  # on an object: the preset that it took last, and what that set


def values() -> list[str]:
    """The settings that a preset holds, as expressions."""
    found = []
    for block in fields(ObjectSettings):
        kind = block.default_factory
        if kind is MISSING or block.name in OWN:
            continue
        names = [f"{block.name}.{f.name}" for f in fields(kind)]  # type: ignore[arg-type]
        found += [f"settings.{name}" for name in names if name not in OWN]
    return found


def keep(name: str, values: Mapping[str, Any]) -> Path:
    """Write a preset of that name that sets these settings, "section.name" -> value as shown; returns its file.

    An earlier one of the name is replaced. Raises ``FlexMapsError`` for a name of nothing but signs.
    """
    from ...engine.calibrating.calibrate import preset  # scipy comes with it

    stem = files.named(name.strip()).strip("_")
    if not stem:
        raise FlexMapsError(f"'{name}' is no name for a preset; use letters or numbers")
    folder = bpy.utils.user_resource("SCRIPTS", path=f"presets/{SUBFOLDER}", create=True)
    path = Path(folder) / f"{stem}.py"
    with files.replacing(path) as new:
        new.write_text(preset(values, f"Measured on a calibration sheet: {name}"), encoding="utf-8")
    return path


def note(obj: bpy.types.Object, path: Path) -> None:
    """Keep which preset an object took, and the values that it has of it."""
    names = re.findall(r"^settings\.(\S+) *=", path.read_text(encoding="utf-8"), re.MULTILINE)
    values = {name: _value(obj, name) for name in dict.fromkeys(names)}
    obj[TAKEN] = json.dumps({"file": str(path), "values": {k: v for k, v in values.items() if v is not None}})


def taken(obj: bpy.types.Object) -> tuple[str, str]:
    """Name and file of the preset that an object took last, the name with a star where one of its values was changed since."""
    found = _parsed(str(obj.get(TAKEN, "")))
    if found is None:
        return "", ""
    name = Path(found["file"]).stem.replace("_", " ")
    same = all(_value(obj, setting) == value for setting, value in found["values"].items())
    return name if same else f"{name}*", found["file"]


@lru_cache(maxsize=8)
def _parsed(text: str) -> dict[str, Any] | None:
    try:
        found = json.loads(text)
        return found if isinstance(found["file"], str) and isinstance(found["values"], dict) else None
    except (ValueError, TypeError, KeyError):
        return None


def _value(obj: bpy.types.Object, setting: str) -> Any:
    """The value of "section.name"; None where this version has no such setting."""
    try:
        return attrgetter(setting)(obj.flexmaps)
    except AttributeError:
        return None
