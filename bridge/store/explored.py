"""The candidates of an exploration that an object keeps: the Pareto front, with what was varied and measured."""

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
    """Keep the front of an exploration's report, the best candidate first.

    Parameters
    ----------
    obj : the mesh object
    report : ``Exploration.report()``
    """
    numbers = dict.fromkeys([*([] if report["best"] is None else [report["best"]]), *report["front"]])
    rows = [{key: report["candidates"][k][key] for key in ("values", "measures")} for k in numbers]
    obj[NAME] = json.dumps({"note": report["note"], "tried": len(report["candidates"]), "rows": rows})


def read(obj: bpy.types.Object) -> dict[str, Any] | None:
    """Return the kept candidates; None where there are none, or the data is damaged."""
    text = obj.get(NAME)
    with suppress(ValueError, TypeError, KeyError, AttributeError):
        kept = json.loads(text)
        sound = isinstance(kept["note"], str) and isinstance(kept["tried"], int)
        for row in kept["rows"]:
            sound &= isinstance(row["values"], dict) and row["measures"].keys() <= MEASURES.keys()
            sound &= all(isinstance(value, int | float) for value in row["measures"].values())
        return kept if sound else None
    return None


def use(obj: bpy.types.Object, scene: bpy.types.Scene, values: Mapping[str, Any]) -> None:
    """Give the object the settings and the size of a candidate.

    Parameters
    ----------
    obj, scene : the mesh object and its scene
    values : "section.name", "edge" or "height" -> value

    Raises
    ------
    FlexMapsError for a value that cannot be set.
    """
    wanted = with_values(
        settings.read(obj.flexmaps, ObjectSettings),
        {name: value for name, value in values.items() if name not in SIZES},
    )
    if "edge" in values:
        obj.scale = obj.scale * (values["edge"] / edge(obj, scene))
    settings.write(obj.flexmaps, wanted)


def edge(obj: bpy.types.Object, scene: bpy.types.Scene) -> float:
    """Return the median edge of the object's quads in millimetres."""
    from ...engine.runs import job
    from . import mesh

    bpy.context.view_layer.update()  # so that a scale set a moment ago counts
    return 1e3 * float(job.begin(mesh.read_surface(obj, scene).polygons).mesh.median_edge)


def describe(name: str, found: object) -> str:
    """Return a value with its unit, in the words of its setting.

    Parameters
    ----------
    name : "section.name", "edge" or "height"
    found : the value, as shown
    """
    setting = dict(every_setting(ObjectSettings)).get("remesh.edge" if name == "edge" else name)
    if setting is None:  # a setting of another version
        return f"{name} {found}"
    meta = setting.metadata
    for key, label, _ in meta["choices"]:
        if key == found:
            return interface(label)
    return f"{found:.4g} {SHOWN[meta['unit']][1]}".rstrip() if isinstance(found, int | float) else str(found)
