"""Register the translations of sidebar, tooltips and reports with Blender, from the files ``locale/LANGUAGE.po``."""

from __future__ import annotations

from pathlib import Path

import bpy

from ..bridge.store import catalogue

FOLDER = Path(__file__).parent / "locale"


def register() -> None:
    # the file names are Blender's locale names: "de" serves all German-speaking countries, "pt_BR" only Brazil
    bpy.app.translations.register(
        __package__, {file.stem: catalogue.read_translations(file) for file in sorted(FOLDER.glob("*.po"))}
    )


def unregister() -> None:
    bpy.app.translations.unregister(__package__)
