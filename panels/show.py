"""The section *Show*: preview of the assembled piece, animation of its assembly, and rendered pictures."""

from __future__ import annotations

from typing import Any

import bpy

from ..engine.extras import registry
from .rows import button, choice, line, rare, settings_popover, tr, value

SEEN = ("target", "Target"), ("assembled", "Piece"), ("panels", "Panels")
CAMERA = "azimuth", "elevation", "pixels_x", "pixels_y", "samples", "film"


def draw(body: Any, context: bpy.types.Context) -> None:
    wanted = context.object.flexmaps
    column = body.column(align=True)
    value(column, wanted.preview, "colour", tr("Look"))
    value(column, wanted.preview, "detail", tr("Detail"))
    choice(column, tr("Place"), wanted.preview, "place")
    line(column, "").prop(wanted.preview, "joined", text=tr("Connectors"), translate=False)
    button(body, "flexmaps.preview", tr("Show the piece"), "HIDE_OFF")
    if registry.has("film"):
        column = body.column(align=True)
        value(column, wanted.film, "seconds", tr("Seconds"))
        value(column, wanted.film, "film_detail", tr("Detail"))
        button(column, "flexmaps.animate", tr("Animate the assembly"), "RENDER_ANIMATION")
    column = body.column(align=True)
    value(column, wanted.render, "finish", tr("Look"))
    value(column, wanted.render, "file", tr("File"))
    row = line(column, tr("Shows"))
    for name, label in SEEN:
        row.prop(wanted.render, name, text=tr(label), toggle=True, translate=False)
    row = column.row(align=True)
    button(row, "flexmaps.render", tr("Render a picture"), "RENDER_STILL")
    rare(row, "camera")


CLASSES = (settings_popover("camera", "Camera", "render", *CAMERA),)
