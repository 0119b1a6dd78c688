"""Seams edited by hand, and flattened again."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
import pytest
from flexmaps.engine.surface import shapes
from support.buttons import faces_of, press, report


@pytest.fixture
def sphere(add: Any) -> Any:
    return add(shapes.make("cubesphere"))


def line_across(obj: Any) -> list[int]:
    """Edges of a straight line of a grid-like patch, found by their positions: those nearest to the plane x = 0."""
    middles = np.array(
        [(obj.data.vertices[e.vertices[0]].co + obj.data.vertices[e.vertices[1]].co) / 2 for e in obj.data.edges]
    )
    along = np.array(
        [
            abs((obj.data.vertices[e.vertices[0]].co - obj.data.vertices[e.vertices[1]].co).normalized().x)
            for e in obj.data.edges
        ]
    )
    steep = along < 0.3
    nearest = np.abs(middles[steep, 0]).min()
    return np.flatnonzero(steep & (np.abs(middles[:, 0]) < nearest + 1e-4)).tolist()


def test_update_from_seams_flattens_what_changed_and_nothing_else(sphere: Any, attribute: Any, seams_of: Any) -> None:
    press("trace")
    patches = report(sphere)["layout"]["patches"]
    flat = attribute(sphere, "flexmaps_flat", "vector", 2).reshape(-1, 4, 2)
    patch = attribute(sphere, "flexmaps_patch").astype(int)
    seam = next(e for e in np.flatnonzero(seams_of(sphere)) if _between_two(sphere, patch, e))
    joined = set(faces_of(sphere, seam))
    pair = {patch[f] for f in joined}
    for edge in np.flatnonzero(seams_of(sphere)):  # clear the whole seam between these two
        if {patch[f] for f in faces_of(sphere, edge)} == pair:
            sphere.data.edges[int(edge)].use_seam = False
    press("update_from_seams")
    assert report(sphere)["layout"]["patches"] == patches - 1
    again = attribute(sphere, "flexmaps_flat", "vector", 2).reshape(-1, 4, 2)
    for other in set(patch.tolist()) - pair:
        faces = patch == other
        shape, before = again[faces] - again[faces].mean(axis=(0, 1)), flat[faces] - flat[faces].mean(axis=(0, 1))
        assert shape == pytest.approx(before, abs=1e-2)  # only laid elsewhere


def _between_two(obj: Any, patch: np.ndarray, edge: int) -> bool:
    return len({patch[f] for f in faces_of(obj, edge)}) == 2


def test_a_seam_marked_in_edit_mode(dome: Any, seams_of: Any) -> None:
    press("merge")
    patches = report(dome)["layout"]["patches"]
    before = seams_of(dome)
    wanted = [e for e in line_across(dome) if not before[e]]
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.select_mode(type="EDGE")
    bpy.ops.mesh.select_all(action="DESELECT")
    bpy.ops.object.mode_set(mode="OBJECT")
    for edge in wanted:
        dome.data.edges[edge].select = True
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.mark_seam(clear=False)
    press("update_from_seams")
    assert dome.mode == "EDIT"
    assert report(dome)["layout"]["patches"] > patches
    assert seams_of(dome)[wanted].all()


def test_spirals_ask_for_an_update_after_an_edit(dome: Any, content: Any) -> None:
    press("merge")
    inner = next(e.index for e in dome.data.edges if not e.use_seam and len(faces_of(dome, e.index)) == 2)
    dome.data.edges[inner].use_seam = True
    before = content(dome)
    with pytest.raises(RuntimeError, match="Update from seams"):
        bpy.ops.flexmaps.spirals()
    assert content(dome) == before
    assert [e.index for e in dome.data.edges if e.select] == [inner]
