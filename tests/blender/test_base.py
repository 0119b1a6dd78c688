"""A base from the sidebar: spirals with feet, the plates in the preview and in the files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
import ezdxf
import numpy as np
import pytest
from flexmaps.bridge.store import attributes, stored_report
from flexmaps.bridge.view import collection, preview
from flexmaps.engine.surface import shapes
from support.buttons import press


def _standing(obj: Any, every: int = 2) -> np.ndarray:
    """Put every so many of the lowest faces, round the dome, into the group of the supports; returns them."""
    mesh = obj.data
    height = np.array([min(mesh.vertices[v].co[2] for v in face.vertices) for face in mesh.polygons])
    low = np.flatnonzero(height < height.min() + 0.2 * np.ptp(height) / 8)
    middle = np.array([mesh.polygons[int(k)].center[:2] for k in low])
    chosen = low[np.argsort(np.arctan2(middle[:, 1], middle[:, 0]))][::every]
    group = obj.vertex_groups.new(name="feet")
    for k in chosen.tolist():
        ground = sorted(mesh.polygons[k].vertices, key=lambda v: mesh.vertices[v].co[2])[:2]
        group.add(ground, 1.0, "REPLACE")
    obj.flexmaps.loads.supports = "feet"
    return chosen


def _base_of(obj: Any) -> Any:
    own = collection.find(obj)
    return next((o for o in own.objects if o.get("flexmaps_kind") == preview.BASE), None)


@pytest.fixture
def piece(add: Any, once: Any) -> Any:
    def make() -> None:
        obj = add(shapes.make("dome"))
        obj.flexmaps.sheet.nesting = "FAST"
        obj.flexmaps.base.base = "feet"
        press("trace")

    return once("based", make)


def test_from_spirals_to_files(piece: Any, tmp_path: Path) -> None:
    held = _standing(piece)
    press("spirals")
    twist = attributes.read(piece.data, "flexmaps_twist")
    assert twist is not None
    assert (np.abs(twist[held]) < 1e-6).all()
    assert (twist > 0.1).any()
    press("simulate")
    press("preview")
    made, below = preview.find_piece(piece), _base_of(piece)
    assert below is not None
    bpy.context.view_layer.update()
    top, low = max(v.co[2] for v in below.data.vertices), min(v.co[2] for v in made.data.vertices)
    assert low < top  # tongues reach into the slots
    piece.flexmaps.export.folder = str(tmp_path)
    press("export")
    block = stored_report.read(piece.data)["sheets"]["base"]
    assert block["feet"] >= len(held)
    read = ezdxf.readfile(next(tmp_path.glob("*.dxf"))).modelspace()  # type: ignore[attr-defined]
    assert len(list(read)) > 0
    # without a base nothing of it stays
    piece.flexmaps.base.base = "none"
    press("preview")
    assert _base_of(piece) is None


def test_without_supports_the_export_says_what_is_missing(piece: Any, tmp_path: Path) -> None:
    press("spirals")
    press("simulate")
    piece.flexmaps.export.folder = str(tmp_path)
    with pytest.raises(RuntimeError, match="choose supports"):
        bpy.ops.flexmaps.export()
    assert not list(tmp_path.iterdir())
