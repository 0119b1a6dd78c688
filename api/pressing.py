"""*Next* without a window: what it offers is pressed, and every press is told with its findings, cures and figures."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import bpy

MOST = 14  # presses to sheets at most; whatever needs more goes in circles


def press(obj: bpy.types.Object, *, cure: bool = False) -> dict[str, Any] | None:
    """Press what *Next* offers for an object, or with ``cure`` the first cure of what speaks against cutting it.

    Returns None where nothing is left to press, else ``pressed`` (its label), ``call``, ``error`` ("" where it went well), ``seconds`` of
    processors, other processes included, and what ``told`` tells afterwards. The object that it ends with is the active one.
    """
    import bpy

    from ..bridge.store import failures, guidance

    scene, layer = bpy.context.scene, bpy.context.view_layer
    layer.objects.active = obj
    layer.update()
    seen = guidance.of(obj, scene)
    ways = [way for notice in seen.open for way in notice.cures if way.idname != "flexmaps.let_go"] if cure else []
    tried = failures.tried(obj.data)
    chosen = next((way for way in ways if way.call not in tried), None)
    act = chosen or seen.act
    if act is None or act.idname == "wm.path_open":
        return None
    began, error = _seconds(), ""
    try:
        if chosen is not None:
            failures.note_tried(obj.data, chosen.call)
            group, name = chosen.idname.split(".")
            getattr(getattr(bpy.ops, group), name)(**chosen.properties)
        else:
            bpy.ops.flexmaps.next()
    except RuntimeError as problem:
        error = str(problem).strip().removeprefix("Error: ")
    layer.update()
    spent = round(_seconds() - began, 2)
    call = f"bpy.ops.{act.idname}({', '.join(f'{key}={value!r}' for key, value in act.properties.items())})"
    return {"pressed": act.label, "call": call, "error": error, "seconds": spent} | told(layer.objects.active)


def presses(obj: bpy.types.Object, *, cures: int = 0, most: int = MOST) -> Iterator[dict[str, Any]]:
    """Press *Next* until nothing is left to press; before files are written, so many cures of what speaks against it."""
    import bpy

    from ..bridge.store import guidance

    for _ in range(most):
        obj = bpy.context.view_layer.objects.active if obj is None else obj
        act = guidance.of(obj, bpy.context.scene).act
        last = act is None or act.idname in {"flexmaps.export", "wm.path_open"}
        found = press(obj, cure=cures > 0 and last)
        if found is None:
            return
        cures -= cures > 0 and last
        yield found
        obj = bpy.context.view_layer.objects.active


def told(obj: bpy.types.Object) -> dict[str, Any]:
    """How an object stands: ``object``, ``status``, ``findings`` (text, kind, place, cures with label and call) and ``figures``."""
    import bpy

    from ..bridge.store import guidance, notes

    seen, blocks = guidance.of(obj, bpy.context.scene), notes.read(obj.data)
    shape, sheets = blocks.get("equilibrium", {}), blocks.get("sheets", {})
    figures = {
        "quads": len(obj.data.polygons),
        "panels": blocks.get("layout", {}).get("patches"),
        "rms_percent": shape.get("rms_percent"),
        "strain_share": shape.get("strain_share_max"),
        "sheets": sheets.get("sheets"),
    }
    found = [notice.as_dict() for notice in seen.notices]
    status = {"text": seen.status.text, "sign": seen.status.sign}
    return {"object": obj.name, "status": status, "findings": found, "figures": figures}


def _seconds() -> float:
    """Processor seconds of this process and those that it started and that have ended."""
    try:
        import resource
    except ImportError:  # Windows
        return time.process_time()
    ended = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.process_time() + ended.ru_utime + ended.ru_stime
