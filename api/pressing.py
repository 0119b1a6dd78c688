"""Press the sidebar's button *Next* from a script, and report every press with findings, cures and figures."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

from ..engine.errors import FlexMapsError

if TYPE_CHECKING:
    import bpy

MAX_PRESSES = 14  # most presses until the files are written; a piece that needs more repeats the same actions


def press(obj: bpy.types.Object, *, cure: bool | str = False) -> dict[str, Any] | None:
    """Press *Next* for an object, or a button (cure) of its open findings.

    Parameters
    ----------
    obj : a mesh object
    cure : False presses *Next*; True presses the first cure of an open finding that was not pressed yet, else *Next*; a
        name such as "make_larger" or "stand_on-lowest" presses the cure of that name, see ``describe_object``

    Returns
    -------
    None where nothing is left to press. Otherwise a dict: ``pressed`` (label), ``call`` (Python call), ``error`` ("" on
    success), ``seconds`` of processor time with child processes, and the entries of ``describe_object`` after the press. The
    resulting object is active.

    Raises
    ------
    FlexMapsError where the object is not a mesh that FlexMaps can use, or no cure of that name is offered.
    """
    import bpy

    from ..bridge.store import failures, guidance

    _require_usable(obj)
    scene, layer = bpy.context.scene, bpy.context.view_layer
    layer.objects.active = obj
    layer.update()
    seen = guidance.read_guidance(obj, scene)
    chosen = None
    if isinstance(cure, str):
        offered = {way.name: way for notice in reversed(seen.notices) for way in reversed(notice.cures)}
        if cure not in offered:
            raise FlexMapsError(
                f"'{obj.name}' is offered no cure '{cure}'; it is offered: {', '.join(sorted(offered))}"
            )
        chosen = offered[cure]
    elif cure:
        ways = [way for notice in seen.objections for way in notice.cures if way.idname != "flexmaps.let_go"]
        tried = failures.read_press_counts(obj.data)
        chosen = next((way for way in ways if way.call not in tried), None)
    act = chosen or seen.action
    if act is None or act.idname == "wm.path_open":
        return None
    began, error = _processor_seconds(), ""
    try:
        if chosen is not None:
            failures.count_press(obj.data, chosen.call)
            group, name = chosen.idname.split(".")
            getattr(getattr(bpy.ops, group), name)(**chosen.properties)
        else:
            bpy.ops.flexmaps.next()
    except RuntimeError as problem:
        error = str(problem).strip().removeprefix("Error: ")
    layer.update()
    spent = round(_processor_seconds() - began, 2)
    call = f"bpy.ops.{act.idname}({', '.join(f'{key}={value!r}' for key, value in act.properties.items())})"
    return {"pressed": act.label, "call": call, "error": error, "seconds": spent} | describe_object(
        layer.objects.active
    )


def presses(
    obj: bpy.types.Object, *, cures: int = 0, named: Sequence[str] = (), most: int = MAX_PRESSES
) -> Iterator[dict[str, Any]]:
    """Press *Next* until nothing is left to press.

    Parameters
    ----------
    obj : a mesh object; None takes the active object
    cures : how often to press the first open cure before files are written
    named : names of cures to press once each as soon as they are offered: before files are written, where *Next* offers
        nothing, or instead of another cure of the same finding
    most : maximum number of presses

    Returns
    -------
    An iterator over the dicts of ``press``.

    Raises
    ------
    FlexMapsError as ``press`` does.
    """
    import bpy

    from ..bridge.store import guidance

    waiting = list(named)
    for _ in range(most):
        obj = bpy.context.view_layer.objects.active if obj is None else obj
        _require_usable(obj)
        seen = guidance.read_guidance(obj, bpy.context.scene)
        last = seen.action is None or seen.action.idname in {"flexmaps.export", "wm.path_open", "wm.save_mainfile"}
        instead = None if seen.action is None else seen.action.cure
        offered = {way.name for one in seen.notices if last or instead in one.cures for way in one.cures}
        name = next((name for name in waiting if name in offered), None)
        if name is not None:
            waiting.remove(name)
        report = press(obj, cure=name or (cures > 0 and last))
        if report is None:
            return
        cures -= cures > 0 and last and name is None
        yield report
        obj = bpy.context.view_layer.objects.active


def describe_object(obj: bpy.types.Object) -> dict[str, Any]:
    """Return an object's name, status line, findings and figures as plain values.

    ``findings`` have a text, a kind, faces and edges, and cures with name, label and call.

    Raises
    ------
    FlexMapsError where the object is not a mesh that FlexMaps can use.
    """
    import bpy

    from ..bridge.store import guidance, stored_report

    _require_usable(obj)
    seen, blocks = guidance.read_guidance(obj, bpy.context.scene), stored_report.read(obj.data)
    shape, sheets = blocks.get("equilibrium", {}), blocks.get("sheets", {})
    figures = {
        "quads": len(obj.data.polygons),
        "panels": blocks.get("layout", {}).get("patches"),
        "rms_percent": shape.get("rms_percent"),
        "strain_share": shape.get("strain_share_max"),
        "sheets": sheets.get("sheets"),
    }
    status = {"text": seen.status.text, "sign": seen.status.icon}
    return {"object": obj.name, "status": status, "findings": seen.findings(), "figures": figures}


def _require_usable(obj: bpy.types.Object | None) -> None:
    """Raise ``FlexMapsError`` unless FlexMaps can work on an object."""
    from ..bridge.store.objects import usage_problem

    problem = usage_problem(obj)
    if problem is not None:
        raise FlexMapsError(problem)


def _processor_seconds() -> float:
    """Return the processor time in seconds of this process and (except on Windows) its finished child processes."""
    try:
        import resource
    except ImportError:  # Windows
        return time.process_time()
    ended = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.process_time() + ended.ru_utime + ended.ru_stime
