"""The assembly as an animation: where it begins and ends, what it replaces and refuses."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
import pytest
from flexmaps.bridge.store import pose
from flexmaps.bridge.store.vertex_positions import to_metres
from flexmaps.bridge.view import animation, preview
from flexmaps.engine.extras.film import unfinished_pieces
from flexmaps.engine.surface import shapes
from support.buttons import press


@pytest.fixture
def piece(simulated: Any) -> Any:
    simulated.flexmaps.preview.place = "ON"
    simulated.flexmaps.preview.detail = "COARSE"
    return simulated


@pytest.fixture
def animated(piece: Any, once: Any) -> Any:
    """The piece with its animation, which is made once."""

    def make() -> None:
        again = once("simulated", lambda: None)  # the file that ``piece`` was read from
        again.flexmaps.preview.place, again.flexmaps.preview.detail = "ON", "COARSE"
        press("animate")

    return once("animated", make)


def seen(obj: Any, frame: int) -> np.ndarray:
    """(V, 3) where an object's vertices are seen in a frame."""
    scene = bpy.context.scene
    scene.frame_set(frame)
    evaluated = obj.evaluated_get(bpy.context.evaluated_depsgraph_get())
    points = np.array([tuple(v.co) for v in evaluated.data.vertices])
    matrix = np.array(evaluated.matrix_world)
    return points @ matrix[:3, :3].T + matrix[:3, 3]


def previewed(piece: Any) -> np.ndarray:
    """(V, 3) where the vertices of its preview, which this makes, are seen."""
    press("preview")
    bpy.context.view_layer.update()
    return seen(preview.find_piece(piece), bpy.context.scene.frame_current)


def test_it_begins_flat_and_ends_assembled(piece: Any) -> None:
    points = previewed(piece)
    press("animate")
    assert preview.find_piece(piece) is None
    root, *panels = animation.find_objects(piece)
    assert root.type == "EMPTY" and len(panels) == int(np.max(_patches(piece))) + 1
    scene = bpy.context.scene
    thickness = 1e-3 * piece.flexmaps.spiral.thickness
    first = [seen(o, scene.frame_start) for o in panels]
    heights = np.concatenate(first)[:, 2]
    assert np.ptp(heights) == pytest.approx(thickness, abs=1e-6)  # all of them flat on the table
    boxes = [(p.min(axis=0)[:2], p.max(axis=0)[:2]) for p in first]
    for k, (low, high) in enumerate(boxes):
        for other_low, other_high in boxes[:k]:
            assert (low > other_high).any() or (high < other_low).any()  # none lies upon another
    last = np.concatenate([seen(o, scene.frame_end) for o in panels])
    assert len(last) == len(points)
    size = np.linalg.norm(np.ptp(points, axis=0))
    order, wanted = np.lexsort(np.round(last / size, 4).T), np.lexsort(np.round(points / size, 4).T)
    assert last[order].mean(axis=0) == pytest.approx(points.mean(axis=0), abs=1e-5)
    away = _nearest(last, points)
    assert away.max() < 2e-5 * size and order.shape == wanted.shape


def test_with_connectors(piece: Any) -> None:
    """The film ends with what the preview shows, connectors and all."""
    piece.flexmaps.connect.connector = "dovetail"
    plain = _film_and_preview(piece)
    piece.flexmaps.preview.joined = True
    joined = _film_and_preview(piece)
    assert len(joined) > len(plain) + 10


def _film_and_preview(piece: Any) -> np.ndarray:
    """(V, 3) the film's last frame, which is the preview."""
    points = previewed(piece)
    press("animate")
    last = np.concatenate([seen(o, bpy.context.scene.frame_end) for o in animation.find_objects(piece)[1:]])
    assert len(last) == len(points)
    assert _nearest(last, points).max() < 2e-5 * np.linalg.norm(np.ptp(points, axis=0))
    return last


def test_half_finished_pieces_that_find_no_rest_are_told_of(piece: Any, capsys: Any, monkeypatch: Any) -> None:
    piece.flexmaps.simulate.iterations = 1
    monkeypatch.setattr(unfinished_pieces, "STIFFNESS_SHARES", ())
    press("animate")
    assert "find no rest" in capsys.readouterr().out
    assert len(animation.find_objects(piece)) > 2


def _patches(obj: Any) -> np.ndarray:
    values = np.empty(len(obj.data.polygons), np.int32)
    obj.data.attributes["flexmaps_patch"].data.foreach_get("value", values)
    return values


def _nearest(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    from scipy.spatial import cKDTree

    return cKDTree(b).query(a)[0]


def test_panels_bend_without_being_stretched(animated: Any) -> None:
    """On the way the hubs' plates stay as large as they are, and arms nearly as long."""
    scene = bpy.context.scene
    panel = animation.find_objects(animated)[1]
    edges = np.array([tuple(e.vertices) for e in panel.data.edges])
    flat = None
    for frame in np.linspace(scene.frame_start, scene.frame_end, 9).astype(int).tolist():
        points = seen(panel, frame)
        length = np.linalg.norm(points[edges[:, 0]] - points[edges[:, 1]], axis=1)
        flat = length if flat is None else flat
        assert length == pytest.approx(flat, rel=0.05, abs=2e-5)


def test_pressed_again_it_is_replaced(animated: Any) -> None:
    def counts() -> tuple[int, ...]:
        return len(bpy.data.objects), len(bpy.data.meshes), len(bpy.data.actions), len(bpy.data.shape_keys)

    before = counts()
    press("animate")
    assert counts() == before
    press("preview")
    assert animation.find_objects(animated) == [] and preview.find_piece(animated) is not None


def test_it_needs_a_simulation(add: Any) -> None:
    add(shapes.make("dome"))
    for stage in ("trace", "spirals"):
        press(stage)
    assert not bpy.ops.flexmaps.animate.poll()


def test_scene_units(add: Any) -> None:
    obj = add(shapes.make("dome"))
    bpy.context.scene.unit_settings.scale_length = 0.01
    obj.scale = (100.0,) * 3
    bpy.context.view_layer.update()
    for stage in ("trace", "spirals", "simulate"):
        press(stage)
    obj.flexmaps.preview.place = "ON"
    press("animate")
    ends = np.concatenate([seen(o, bpy.context.scene.frame_end) for o in animation.find_objects(obj)[1:]])
    hubs = pose.read(obj, to_metres(obj, bpy.context.scene))
    assert hubs is not None
    assert np.ptp(ends, axis=0) == pytest.approx(100 * np.ptp(hubs.centres, axis=0), rel=0.3)
