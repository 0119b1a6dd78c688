"""Among Blender's own ways: transforms, units, modifiers, shared meshes, several pieces in a file."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import bpy
import numpy as np
import pytest
from flexmaps.bridge.hosts import background
from flexmaps.bridge.store import attributes, mesh, states, stored_report
from flexmaps.engine.surface import shapes
from flexmaps.engine.surface.checking import check
from flexmaps.engine.surface.mesh import QuadMesh
from support.buttons import press

EDGE = 0.02


def small(n: int = 4) -> QuadMesh:
    """A dome of 3 n^2 quads of 20 mm."""
    made = shapes.dome(n)
    return QuadMesh(made.vertices * (EDGE / made.median_edge), made.quads)


def bent() -> QuadMesh:
    """A tunnel of 7 x 4 quads of 20 mm: however it is stretched along straight axes, it flattens without distortion."""
    turn = 2 * np.arcsin(0.25)  # of a chord of half the radius
    around = (np.arange(8) - 3.5) * turn
    x, z = 2 * EDGE * np.sin(around), 2 * EDGE * np.cos(around)
    vertices = [(x[i], EDGE * j, z[i]) for i in range(8) for j in range(5)]
    faces = [[5 * i + j, 5 * i + 5 + j, 5 * i + 6 + j, 5 * i + 1 + j] for i in range(7) for j in range(4)]
    return QuadMesh(np.array(vertices), np.array(faces))


@pytest.fixture
def piece(add: Any) -> Any:
    return add(small())


@pytest.fixture
def tunnel(add: Any) -> Any:
    return add(bent())


def activate(obj: Any) -> None:
    for other in bpy.context.selected_objects:
        other.select_set(False)
    bpy.context.view_layer.objects.active = obj
    obj.select_set(True)
    bpy.context.view_layer.update()


def kinds(obj: Any) -> dict[str, str]:
    bpy.context.view_layer.update()
    return {stage: state.kind for stage, state in states.read_states(obj, bpy.context.scene).items()}


def lengths_in_metres(obj: Any) -> np.ndarray:
    """Of the edges, as Blender shows them in the world."""
    world = np.array([obj.matrix_world @ v.co for v in obj.data.vertices])
    pairs = np.array([e.vertices[:] for e in obj.data.edges])
    return (
        np.linalg.norm(world[pairs[:, 0]] - world[pairs[:, 1]], axis=1) * bpy.context.scene.unit_settings.scale_length
    )


def flat_lengths(obj: Any) -> np.ndarray:
    """Of the edges in the flat UV map, which is in millimetres, in metres; the mean of an edge's sides."""
    uv = np.array([d.uv for d in obj.data.uv_layers["flexmaps_flat"].data])
    total, count = np.zeros(len(obj.data.edges)), np.zeros(len(obj.data.edges))
    for face in obj.data.polygons:
        loops = list(face.loop_indices)
        for a, b in zip(loops, loops[1:] + loops[:1], strict=True):
            edge = obj.data.loops[a].edge_index
            total[edge] += np.linalg.norm(uv[a] - uv[b])
            count[edge] += 1
    return total / count * 1e-3


# -- transforms and units ----------------------------------------------------------------------------------------------


FRAMES: dict[str, dict[str, Any]] = {
    "non-uniform": {"scale": (1.0, 1.6, 0.7)},
    "mirrored": {"scale": (-1.0, 1.0, 1.0)},
    "mirrored, turned and squeezed": {
        "scale": (0.8, -1.2, 1.0),
        "rotation_euler": (0.3, 0.7, 1.1),
        "location": (1, 2, 3),
    },
    "inverted": {"scale": (-1.0, -1.0, -1.0)},
}


@pytest.mark.parametrize("frame", FRAMES)
@pytest.mark.parametrize("unit, system", [(1.0, "METRIC"), (0.001, "METRIC"), (0.3048, "IMPERIAL")])
def test_panels_have_the_size_that_is_seen(tunnel: Any, frame: str, unit: float, system: str) -> None:
    """Flattening keeps the lengths of a tunnel: the UV map must agree with those of the world."""
    bpy.context.scene.unit_settings.system, bpy.context.scene.unit_settings.scale_length = system, unit
    for name, value in FRAMES[frame].items():
        setattr(tunnel, name, value)
    tunnel.scale = tuple(s / unit for s in tunnel.scale)
    bpy.context.view_layer.update()
    press("flatten")
    seen, flat = lengths_in_metres(tunnel), flat_lengths(tunnel)
    assert np.median(seen) == pytest.approx(EDGE, rel=0.5)
    assert flat == pytest.approx(seen, rel=2e-3)
    # seen from outside, no panel is a mirror image: the engine flattened what the world shows
    surface = mesh.read_surface(tunnel, bpy.context.scene)
    flat_again = mesh.require_current_flat(surface, check.as_quad_mesh(surface.polygons))
    p = flat_again.corners
    a, b = p[:, 2] - p[:, 0], p[:, 3] - p[:, 1]
    assert (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0] > 0).all()
    assert kinds(tunnel)["layout"] == states.DONE


def test_a_parent_counts_too(tunnel: Any) -> None:
    parent = bpy.data.objects.new("parent", None)
    bpy.context.scene.collection.objects.link(parent)
    parent.scale, parent.rotation_euler = (2.0, 1.0, 1.0), (0.0, 0.5, 0.0)
    tunnel.parent = parent
    tunnel.rotation_euler = (0.4, 0.3, 0.2)  # under a squeezed parent that is a shear
    bpy.context.view_layer.update()
    press("set_size")
    bpy.context.view_layer.update()
    assert np.median(lengths_in_metres(tunnel)) == pytest.approx(EDGE, rel=1e-4)
    press("flatten")
    assert flat_lengths(tunnel) == pytest.approx(lengths_in_metres(tunnel), rel=2e-3)


def test_lengths_typed_in_are_millimetres_whatever_the_units(piece: Any) -> None:
    bpy.context.scene.unit_settings.system = "IMPERIAL"
    bpy.context.scene.unit_settings.scale_length = 0.3048
    piece.flexmaps.remesh.edge = 30.0
    press("set_size")
    bpy.context.view_layer.update()
    assert np.median(lengths_in_metres(piece)) == pytest.approx(0.030, rel=1e-4)


# -- modifiers ---------------------------------------------------------------------------------------------------------


def test_modifiers_are_named_and_applied_by_the_button_beside(piece: Any) -> None:
    count = len(piece.data.polygons)
    piece.modifiers.new("Finer", "SUBSURF")
    assert not bpy.ops.flexmaps.flatten.poll()
    press("to_mesh")
    assert not piece.modifiers and len(piece.data.polygons) == 4 * count
    press("flatten")


def test_what_is_hidden_or_harmless_does_not_disturb(piece: Any) -> None:
    piece.modifiers.new("Finer", "SUBSURF").show_viewport = False
    piece.modifiers.new("Shading", "WEIGHTED_NORMAL")
    press("flatten")
    assert len(piece.data.attributes["flexmaps_patch"].data) == len(piece.data.polygons)


def test_quads_are_made_of_what_the_modifiers_show(piece: Any) -> None:
    piece.modifiers.new("Wide", "CAST").factor = 0.5
    piece.flexmaps.remesh.quads = 100
    seen = tuple(piece.evaluated_get(bpy.context.evaluated_depsgraph_get()).dimensions)
    press("quad_remesh")
    made = bpy.context.object
    assert made != piece and not made.modifiers
    assert tuple(made.dimensions) == pytest.approx(seen, rel=0.2)


def test_nothing_is_made_of_what_is_squeezed_flat(piece: Any) -> None:
    piece.scale = (0.0, 1.0, 1.0)
    bpy.context.view_layer.update()
    with pytest.raises(RuntimeError, match="squeezed flat"):
        bpy.ops.flexmaps.quad_remesh()
    assert [o.name for o in bpy.data.objects] == ["piece"]


# -- several objects ---------------------------------------------------------------------------------------------------


def test_linked_duplicates(tunnel: Any) -> None:
    """The mesh holds the results: they are those of both, as far as both have one size."""
    piece = tunnel
    twin = piece.copy()
    bpy.context.scene.collection.objects.link(twin)
    twin.location.x = 1.0
    press("flatten")
    press("spirals")
    assert kinds(twin) == kinds(piece)
    assert kinds(twin)["spirals"] == states.DONE
    twin.scale = (2.0, 2.0, 2.0)
    assert kinds(piece)["layout"] == states.DONE and kinds(twin)["layout"] == states.STALE
    activate(twin)
    with pytest.raises(RuntimeError):
        bpy.ops.flexmaps.spirals()
    press("flatten")
    assert kinds(twin)["layout"] == states.DONE and kinds(piece)["layout"] == states.STALE
    assert flat_lengths(twin) == pytest.approx(lengths_in_metres(twin), rel=2e-3)
    press("regularise")
    assert piece.data == twin.data
    assert "layout" not in stored_report.read(piece.data)


def test_a_duplicate_of_its_own_goes_its_own_way(piece: Any, content: Any) -> None:
    press("flatten")
    press("spirals")
    before = content(piece)
    copy = piece.copy()
    copy.data = piece.data.copy()
    bpy.context.scene.collection.objects.link(copy)
    assert kinds(copy) == kinds(piece)  # it brings its results along
    copy.flexmaps.spiral.width_max = 3.0
    activate(copy)
    press("spirals")
    assert content(piece) == before and kinds(piece)["spirals"] == states.DONE
    assert attributes.read(copy.data, "flexmaps_width").max() > attributes.read(piece.data, "flexmaps_width").max()


def test_two_pieces_in_one_file(add: Any, content: Any, tmp_path: Path) -> None:
    first, second = add(small(), "first"), add(small(3), "second")
    second.flexmaps.spiral.thickness = 3.0
    for obj in (first, second):
        obj.flexmaps.export.folder, obj.flexmaps.sheet.nesting = str(tmp_path), "FAST"
    activate(first)
    press("flatten")
    press("spirals")
    before = content(first)
    activate(second)
    for button in ("flatten", "spirals", "export"):
        press(button)
    assert content(first) == before and kinds(first)["spirals"] == states.DONE
    assert kinds(first)["sheets"] == states.TODO
    activate(first)
    press("export")
    names = {path.name.split("-")[0].split(".")[0] for path in tmp_path.glob("[!.]*")}
    assert names == {"first", "second"}
    owned = {c.name: {o.name.split()[0] for o in c.objects} for c in bpy.data.collections}
    assert owned == {"FlexMaps first": {"first"}, "FlexMaps second": {"second"}}


def test_the_collection_beside_may_be_excluded_or_unlinked(piece: Any) -> None:
    press("flatten")
    collection = bpy.data.collections["FlexMaps piece"]
    bpy.context.view_layer.layer_collection.children[collection.name].exclude = True
    press("spirals")
    bpy.context.scene.collection.children.unlink(collection)
    press("spirals")
    assert [c.name for c in bpy.data.collections] == ["FlexMaps piece"]
    assert collection.name in bpy.context.scene.collection.children


def test_an_appended_piece_goes_on_where_it_was(piece: Any, tmp_path: Path) -> None:
    piece.flexmaps.spiral.thickness = 3.0
    press("flatten")
    press("spirals")
    before, source = kinds(piece), tmp_path / "piece.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(source))
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    with bpy.data.libraries.load(str(source)) as (_, here):
        here.objects = ["piece"]
    obj = here.objects[0]
    bpy.context.scene.collection.objects.link(obj)
    activate(obj)
    assert kinds(obj) == before and obj.flexmaps.spiral.thickness == pytest.approx(3.0)
    press("spirals")


def test_a_linked_piece_is_refused_by_name(piece: Any, tmp_path: Path) -> None:
    source = tmp_path / "piece.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(source))
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    with bpy.data.libraries.load(str(source), link=True) as (_, here):
        here.objects = ["piece"]
    bpy.context.scene.collection.objects.link(here.objects[0])
    activate(here.objects[0])
    assert not bpy.ops.flexmaps.flatten.poll() and not bpy.ops.flexmaps.quad_remesh.poll()


# -- while a job runs --------------------------------------------------------------------------------------------------


@pytest.fixture
def running(piece: Any) -> Iterator[background.Job]:
    """Spirals, computed in the background; nothing is written before the test does it."""
    from flexmaps.bridge.store import settings
    from flexmaps.engine.params import ObjectSettings
    from flexmaps.operators.spirals import Spirals

    press("flatten")
    surface = mesh.read_surface(piece, bpy.context.scene)
    operator = SimpleNamespace(
        required_output=Spirals.required_output, reads_loads=False, continuation=partial(Spirals.continuation, None)
    )
    work = Spirals.prepare(operator, surface, settings.read(piece.flexmaps, ObjectSettings))
    made = background.Job("Spirals", work)
    made.start()
    yield made
    made.end()


def test_saving_meanwhile_keeps_the_file_as_it_was(
    running: background.Job, piece: Any, tmp_path: Path, content: Any
) -> None:
    before, found = content(piece), kinds(piece)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "meanwhile.blend"))
    running._thread.join()
    assert running.error is None and running.result is not None
    running.end()
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "meanwhile.blend"))
    again = bpy.data.objects["piece"]
    assert content(again) == before and kinds(again) == found
    assert background.current_job() is None
    press("spirals")


def test_every_button_says_why_it_waits(running: background.Job, piece: Any) -> None:
    for name in ("check", "quad_remesh", "set_size", "regularise", "trace", "merge", "flatten", "spirals", "export"):
        assert not getattr(bpy.ops.flexmaps, name).poll()
    with pytest.raises(RuntimeError, match="is running"):
        bpy.ops.flexmaps.quad_remesh()
