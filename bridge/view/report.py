"""Build the report and the plots of an object in Blender."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ...engine.display import run_plots
from ...engine.display.drawing import Drawing
from ...engine.params import ObjectSettings
from ...engine.progress import SILENT, Progress
from ...engine.runs import report, report_page
from ...engine.runs.outputs import FinalLayout
from ...engine.runs.page_data import ViewContent
from ...engine.runs.result import Result

if TYPE_CHECKING:
    import bpy

    from ...engine.mechanics.assembly import Pose
    from ..store.snapshot import Snapshot

SIMULATED_BLOCKS = ("equilibrium", "reach", "optimise", "structure")


@dataclass(frozen=True, eq=False)
class ReportInput:
    """Input of a report, read from an object in Blender: plain arrays and texts, which other threads may use.

    snapshot : the object's surface, settings and stored results
    blocks : report blocks of the stages that are up to date, by stage
    shape : simulated vertices (V, 3) in the object's own frame; None without an up-to-date simulation
    values : arrays (F,) of the simulation, or None, by field of ``MapValues``
    more : arrays (F,) of optional features, by key of ``MapValues.more``
    pose : the hubs' pose in the simulation; None if it is missing
    findings : the notices, each with its remedies
    """

    snapshot: Snapshot
    blocks: dict[str, Any]
    shape: np.ndarray | None = None
    values: dict[str, Any] = field(default_factory=dict)
    more: dict[str, Any] = field(default_factory=dict)
    pose: Pose | None = None
    findings: list[dict[str, Any]] = field(default_factory=list)


def read_input(obj: bpy.types.Object) -> ReportInput:
    """Read the input of an object's report, on Blender's main thread; raise ``FlexMapsError`` if it cannot be used."""
    import bpy

    from ..store import mesh, snapshot
    from ..store import settings as properties

    surface = mesh.read_surface(obj, bpy.context.scene)
    return complete_input(obj, snapshot.take_snapshot(obj, surface, properties.read(obj.flexmaps, ObjectSettings)))


def complete_input(obj: bpy.types.Object, stored: Snapshot) -> ReportInput:
    """Complete a snapshot of an object to the input of its report; runs on Blender's main thread, in milliseconds.

    Parameters
    ----------
    obj : the mesh object
    stored : snapshot of the object
    """
    import bpy

    from ..store import attributes, guidance, pose, scans, shape_keys, states
    from ..store.columns import column

    if obj.data.is_editmode:
        obj.update_from_editmode()
    now = states.read_states(obj, bpy.context.scene)
    blocks = states.current_blocks(obj, now)
    if not scans.is_current(obj, bpy.context.scene):
        blocks.pop("scan", None)
    more = {"scan": attributes.read(obj.data, scans.NAME)} if "scan" in blocks else {}
    findings = guidance.read_guidance(obj, bpy.context.scene, now).findings()
    content = ReportInput(stored, blocks, more=more, findings=findings)
    if "equilibrium" not in blocks:
        return content
    key = shape_keys.equilibrium_key(obj.data)
    shape = stored.surface.positions if key is None else column(key.data, "co")
    if not np.isfinite(shape).all():
        return replace(content, blocks={name: block for name, block in blocks.items() if name not in SIMULATED_BLOCKS})
    names = {"distance": "distance", "strain": "strain", "slot": "slot", "kind": "reach"}
    values = {name: attributes.read(obj.data, attributes.PREFIX + kept) for name, kept in names.items()}
    more["utilisation"] = attributes.read(obj.data, attributes.PREFIX + "utilisation")
    return replace(content, shape=shape, values=values, more=more, pose=pose.read(obj, stored.surface.to_metres))


def build_from_input(
    result: Result, content: ReportInput, progress: Progress = SILENT
) -> tuple[dict[str, Any], dict[str, Drawing]]:
    """Return the report and the plots of an object from its input; touches no Blender data.

    Parameters
    ----------
    result : result of the object's snapshot
    content : input of the report, read from the object
    progress : called with a fraction and a text

    Raises
    ------
    FlexMapsError : there is no layout yet
    """
    stored = content.snapshot
    result.need(FinalLayout)
    described = report.build_report(result, source=stored.name, settings=stored.settings, progress=progress)
    measured = _measured_values(result, content)
    described |= {name: block for name, block in content.blocks.items() if name != "checks"}
    described["checks"] = content.blocks.get("checks", described["checks"])
    described["findings"] = content.findings
    return described, report_page.all_drawings(measured, described, stored.settings.layout.distortion_limit)


def view_content(result: Result, content: ReportInput) -> ViewContent | None:
    """Return the content of the HTML page's 3D view; None without spirals.

    Parameters
    ----------
    result : result of the object's snapshot
    content : input of the report, read from the object
    """
    if result.design is None:
        return None
    return ViewContent(result.design, _measured_values(result, content), content.pose)


def _measured_values(result: Result, content: ReportInput) -> run_plots.MapValues:
    more = {name: values for name, values in content.more.items() if values is not None}
    measured = replace(report_page.collect_values(result), more=more)
    if content.shape is None:
        return measured
    to_metres = content.snapshot.surface.to_metres
    world = content.shape.astype(float) @ to_metres[:3, :3].T + to_metres[:3, 3]
    used = np.unique(content.snapshot.surface.polygons.corners)  # the engine's mesh has no loose vertices
    return replace(measured, shape=world[used], **content.values)
