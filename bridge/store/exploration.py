"""Results of an exploration, stored on the object: the Pareto front with each candidate's settings and measures."""

from __future__ import annotations

import json
from collections.abc import Mapping
from contextlib import suppress
from typing import Any

import bpy

from ...engine.extras.exploring.space import MEASURES, SIZES
from ...engine.params import SHOWN, ObjectSettings, every_setting, with_values
from . import settings
from .i18n import interface

NAME = "flexmaps_explored"


def write(obj: bpy.types.Object, report: Mapping[str, Any]) -> None:
    """Store the Pareto front from an exploration's report, the best candidate first.

    Parameters
    ----------
    obj : the mesh object
    report : ``Exploration.report()``
    """
    numbers = dict.fromkeys([*([] if report["best"] is None else [report["best"]]), *report["front"]])
    rows = [{key: report["candidates"][k][key] for key in ("values", "measures")} for k in numbers]
    obj[NAME] = json.dumps({"note": report["note"], "tried": len(report["candidates"]), "rows": rows})


def read(obj: bpy.types.Object) -> dict[str, Any] | None:
    """Return the stored candidates; None if there are none, or the data is damaged."""
    text = obj.get(NAME)
    with suppress(ValueError, TypeError, KeyError, AttributeError):
        kept = json.loads(text)
        sound = isinstance(kept["note"], str) and isinstance(kept["tried"], int)
        for row in kept["rows"]:
            sound &= isinstance(row["values"], dict) and row["measures"].keys() <= MEASURES.keys()
            sound &= all(isinstance(value, int | float) for value in row["measures"].values())
        return kept if sound else None
    return None


def apply_candidate(obj: bpy.types.Object, scene: bpy.types.Scene, values: Mapping[str, Any]) -> None:
    """Give the object the settings and the size of a candidate.

    Parameters
    ----------
    obj, scene : the mesh object and its scene
    values : "section.name", "edge" or "height" -> value; edge in millimetres

    Raises
    ------
    FlexMapsError for a value that cannot be set.
    """
    wanted = with_values(
        settings.read(obj.flexmaps, ObjectSettings),
        {name: value for name, value in values.items() if name not in SIZES},
    )
    if "edge" in values:
        obj.scale = obj.scale * (values["edge"] / median_edge_mm(obj, scene))
    settings.write(obj.flexmaps, wanted)


def median_edge_mm(obj: bpy.types.Object, scene: bpy.types.Scene) -> float:
    """Return the median edge of the object's quads in millimetres."""
    from ...engine.runs import job
    from . import mesh

    bpy.context.view_layer.update()  # update ``matrix_world`` after a change of the scale
    return 1e3 * float(job.check_input(mesh.read_surface(obj, scene).polygons).mesh.median_edge)


def describe_value(name: str, value: object) -> str:
    """Return a setting's value as text with its unit, or the label of a choice.

    Parameters
    ----------
    name : "section.name", "edge" or "height"
    value : the value, in the unit of the user interface
    """
    setting = dict(every_setting(ObjectSettings)).get("remesh.edge" if name == "edge" else name)
    if setting is None:  # a setting of another version
        return f"{name} {value}"
    meta = setting.metadata
    for key, label, _ in meta["choices"]:
        if key == value:
            return interface(label)
    return f"{value:.4g} {SHOWN[meta['unit']][1]}".rstrip() if isinstance(value, int | float) else str(value)
