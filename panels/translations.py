"""Translations of the sidebar, its explanations and what stages report: the files ``locale/LANGUAGE.po``, given to Blender."""

from __future__ import annotations

from pathlib import Path

import bpy

from ..bridge.store import catalogue

FOLDER = Path(__file__).parent / "locale"


def register() -> None:
    # "de" serves German wherever it is spoken, "pt_BR" Brazil's Portuguese alone
    bpy.app.translations.register(
        __package__, {file.stem: catalogue.table(file) for file in sorted(FOLDER.glob("*.po"))}
    )


def unregister() -> None:
    bpy.app.translations.unregister(__package__)
