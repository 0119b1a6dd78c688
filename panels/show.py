"""The section *Show*: preview of the assembled piece, animation of its assembly, and rendered pictures."""

from __future__ import annotations

from typing import Any

import bpy

from ..engine.extras import registry
from .rows import button, choice_row, labelled_row, options_button, setting_row, settings_popover, tr

PICTURE_TOGGLES = ("target", "Target"), ("assembled", "Piece"), ("panels", "Panels")
CAMERA_SETTINGS = "azimuth", "elevation", "pixels_x", "pixels_y", "samples", "film"


def draw(body: Any, context: bpy.types.Context) -> None:
    wanted = context.object.flexmaps
    column = body.column(align=True)
    setting_row(column, wanted.preview, "colour", tr("Look"))
    setting_row(column, wanted.preview, "detail", tr("Detail"))
    choice_row(column, tr("Place"), wanted.preview, "place")
    labelled_row(column, "").prop(wanted.preview, "joined", text=tr("Connectors"), translate=False)
    button(body, "flexmaps.preview", tr("Show the piece"), "HIDE_OFF")
    if registry.has("film"):
        column = body.column(align=True)
        setting_row(column, wanted.film, "seconds", tr("Seconds"))
        setting_row(column, wanted.film, "film_detail", tr("Detail"))
        button(column, "flexmaps.animate", tr("Animate the assembly"), "RENDER_ANIMATION")
    column = body.column(align=True)
    setting_row(column, wanted.render, "finish", tr("Look"))
    setting_row(column, wanted.render, "file", tr("File"))
    row = labelled_row(column, tr("Shows"))
    for name, label in PICTURE_TOGGLES:
        row.prop(wanted.render, name, text=tr(label), toggle=True, translate=False)
    row = column.row(align=True)
    button(row, "flexmaps.render", tr("Render a picture"), "RENDER_STILL")
    options_button(row, "camera")


CLASSES = (settings_popover("camera", "Camera", "render", *CAMERA_SETTINGS),)
