"""*Next* from every stage that fails, whatever is pressed: no state comes twice, and it comes to an end."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import bpy
import numpy as np
import pytest
from flexmaps.api import pressing
from flexmaps.bridge.store import checksums, finding_words, guidance, states
from flexmaps.engine.errors import FlexMapsError
from flexmaps.engine.surface import shapes

QUICK = {"quads": 60, "iterations": 1, "patience": 0.02, "nesting": "FAST"}


def _quads(add: Any) -> Any:
    return add(shapes.make("dome"))


def _triangles(add: Any) -> Any:
    piece = _quads(add)
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.select_all(action="SELECT")
    bpy.ops.mesh.quads_convert_to_tris()
    bpy.ops.object.mode_set(mode="OBJECT")
    return piece


def _seamed(add: Any) -> Any:
    """Somebody's own seams, from the border to the middle."""
    piece = _quads(add)
    places = np.array([vertex.co for vertex in piece.data.vertices])
    for edge in piece.data.edges:
        ends = places[list(edge.vertices)]
        edge.use_seam = bool((np.abs(ends[:, 1]) < 1e-6).all() and (ends[:, 0] > -1e-6).all())
    return piece


def _edited(add: Any) -> Any:
    """A layout whose seams were changed by hand."""
    piece = _quads(add)
    bpy.ops.flexmaps.merge()
    inner = next(edge for edge in piece.data.edges if not edge.use_seam)
    inner.use_seam = True
    return piece


STARTS: dict[str, Callable[[Any], Any]] = {
    "quads": _quads, "triangles": _triangles, "seams": _seamed, "edited": _edited,
}  # fmt: skip


def _state(piece: Any, act: Any) -> tuple[Any, ...]:
    """What may not come twice: the mesh, the settings and what is offered."""
    sums = checksums.Checksums(piece, bpy.context.scene)
    kept = ("shape", "seams", *sorted(states.SETTINGS_INPUTS))
    return (*(sums[part] for part in kept), act.idname, tuple(sorted(act.properties.items())))


@pytest.mark.thorough
@pytest.mark.parametrize("broken", finding_words.FAILURE_LABELS)
@pytest.mark.parametrize("start", STARTS)
def test_no_state_comes_twice(
    add: Any, start: str, broken: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Any
) -> None:
    piece = STARTS[start](add)
    piece.flexmaps.export.folder = str(tmp_path)
    piece.flexmaps.remesh.quads, piece.flexmaps.sheet.nesting = QUICK["quads"], QUICK["nesting"]
    piece.flexmaps.optimise.iterations, piece.flexmaps.optimise.patience = QUICK["iterations"], QUICK["patience"]
    operator = getattr(bpy.types, "FLEXMAPS_OT_" + broken.partition(".")[2])
    read = operator._read

    def fails(self: Any, context: Any) -> Any:
        read(self, context)

        def work(progress: Any) -> Any:
            failures.append(broken)
            raise FlexMapsError("There is no room", faces=[1, 2])

        return work

    piece.flexmaps.choose.match = 100.0  # percent: other layouts, which take long to compare, are not wanted
    monkeypatch.setattr(operator, "_read", fails)
    seen: list[tuple[Any, ...]] = []
    failures: list[str] = []
    for _ in range(pressing.MAX_PRESSES):
        piece = bpy.context.view_layer.objects.active
        act = guidance.read_guidance(piece, bpy.context.scene).action
        if act is None or act.idname == "wm.path_open":
            break
        if act.idname == "flexmaps.export" and broken != "flexmaps.export":
            break
        seen.append(_state(piece, act))
        assert seen.count(seen[-1]) == 1, [one[-2:] for one in seen]
        pressing.press(piece)
    else:
        pytest.fail(f"{pressing.MAX_PRESSES} presses lead to no end: {[one[-2:] for one in seen]}")
    if not failures:
        pytest.skip(f"Next never offers {broken} from {start}")
    failed = [one for one in guidance.read_guidance(piece, bpy.context.scene).notices if one.key == f"failed/{broken}"]
    if act is None:
        assert failed and failed[0].faces == (1, 2), "where it ends, one error names the place"
