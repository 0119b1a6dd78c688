"""Where Blender keeps a person's own presets of FlexMaps, and writing one there."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import bpy

from ...engine import files
from ...engine.errors import FlexMapsError

SUBFOLDER = "flexmaps"  # of Blender's folder of presets


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
