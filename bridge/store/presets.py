"""The user's own presets in Blender's preset folder, and the preset that was last applied to an object."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from functools import lru_cache
from operator import attrgetter
from pathlib import Path
from typing import Any

import bpy

from ...engine import files
from ...engine.errors import FlexMapsError
from ...engine.params import ObjectSettings, every_setting

SUBFOLDER = "flexmaps"  # within Blender's folder of presets
PER_OBJECT = {
    "loads",
    "export.folder",
    "render.file",
}  # settings that belong to a single object and are left out of presets
LAST_PRESET = "flexmaps_preset"  # custom property of an object: the preset last applied, and the values that it set


def list_expressions() -> list[str]:
    """Return the settings that a preset holds, as Python expressions such as "settings.spiral.thickness"."""
    names = (name for name, _ in every_setting(ObjectSettings))
    return [f"settings.{name}" for name in names if PER_OBJECT.isdisjoint((name, name.partition(".")[0]))]


def write_preset(name: str, values: Mapping[str, Any]) -> Path:
    """Write a preset file, replacing a preset of the same name, and return its path.

    Parameters
    ----------
    name : name of the preset
    values : "section.name" -> value in the unit of the user interface

    Raises
    ------
    FlexMapsError for a name without letters and digits.
    """
    from ...engine.extras.calibrating.calibrate import preset_script

    stem = files.safe_file_name(name.strip()).strip("_")
    if not stem:
        raise FlexMapsError(f"'{name}' cannot be the name of a preset; use letters or digits")
    folder = bpy.utils.user_resource("SCRIPTS", path=f"presets/{SUBFOLDER}", create=True)
    path = Path(folder) / f"{stem}.py"
    with files.write_atomically(path) as new:
        new.write_text(preset_script(values, f"Measured on a calibration sheet: {name}"), encoding="utf-8")
    return path


def write_last_preset(obj: bpy.types.Object, path: Path) -> None:
    """Store on an object which preset was applied to it, and the values that the preset set.

    Parameters
    ----------
    obj : the mesh object
    path : file of the preset
    """
    names = re.findall(r"^settings\.(\S+) *=", path.read_text(encoding="utf-8"), re.MULTILINE)
    values = {name: _read_value(obj, name) for name in dict.fromkeys(names)}
    obj[LAST_PRESET] = json.dumps({"file": str(path), "values": {k: v for k, v in values.items() if v is not None}})


def read_last_preset(obj: bpy.types.Object) -> tuple[str, str]:
    """Return name and file of the preset last applied to an object.

    The name ends with a star where the user changed a value since; both are "" without a preset.
    """
    stored = _parse(str(obj.get(LAST_PRESET, "")))
    if stored is None:
        return "", ""
    name = Path(stored["file"]).stem.replace("_", " ")
    same = all(_read_value(obj, setting) == value for setting, value in stored["values"].items())
    return name if same else f"{name}*", stored["file"]


@lru_cache(maxsize=8)
def _parse(text: str) -> dict[str, Any] | None:
    try:
        stored = json.loads(text)
        return stored if isinstance(stored["file"], str) and isinstance(stored["values"], dict) else None
    except (ValueError, TypeError, KeyError):
        return None


def _read_value(obj: bpy.types.Object, setting: str) -> object:
    """Return the object's value of a setting "section.name"; None where this version has no such setting."""
    try:
        return attrgetter(setting)(obj.flexmaps)
    except AttributeError:
        return None
