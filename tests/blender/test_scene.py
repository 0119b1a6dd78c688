"""Finished jobs as scenes, .blend files as input, the panels as solids, and pictures."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from flexmaps.bridge.store import mesh, settings
from flexmaps.bridge.view import curves, picture, scene
from flexmaps.engine.display import arrange, solids
from flexmaps.engine.errors import FlexMapsError
from flexmaps.engine.fabrication import sheets
from flexmaps.engine.params import ConnectorParams, LayoutParams, ObjectSettings, Settings, SheetParams, SpiralParams
from flexmaps.engine.patches.flattening import flatten
from flexmaps.engine.patches.tracing import trace
from flexmaps.engine.runs import job
from flexmaps.engine.spirals import fabricable
from flexmaps.engine.surface import shapes
from flexmaps.engine.surface.checking import check
from flexmaps.engine.surface.mesh import PolygonMesh, QuadMesh


@pytest.fixture(scope="module")
def result() -> job.Result:
    return job.run(PolygonMesh.from_quads(shapes.strip()), Settings(), edge=0.02)


def test_a_finished_job_can_be_worked_on_in_blender(result: job.Result, tmp_path: Path) -> None:
    used = Settings(spiral=SpiralParams(thickness=0.003))
    obj = scene.show_result(result, "strip", used)
    assert settings.read(obj.flexmaps, ObjectSettings).spiral.thickness == pytest.approx(0.003)
    path = tmp_path / "model.blend"
    scene.save_file(path)
    bpy.ops.wm.open_mainfile(filepath=str(path))
    obj = bpy.data.objects["strip"]
    surface = mesh.read_surface(obj, bpy.context.scene)
    flat = mesh.require_current_flat(surface, check.as_quad_mesh(surface.polygons))
    assert result.flat is not None and result.design is not None
    assert flat.corners == pytest.approx(result.flat.corners, abs=1e-6)
    spirals = mesh.read_design(surface, flat, result.design.params)
    assert spirals is not None and spirals.twist == pytest.approx(result.design.twist, abs=1e-5)
    for button in ("update_from_seams", "spirals"):
        assert getattr(bpy.ops.flexmaps, button)() == {"FINISHED"}


@pytest.mark.parametrize("stage", ["check", "merge"])
def test_a_job_that_was_stopped_early(stage: str) -> None:
    early = job.run(PolygonMesh.from_quads(shapes.make("strip")), Settings(), stop_after=stage)
    obj = scene.show_result(early)
    kinds = {o.get("flexmaps_kind") for o in bpy.data.objects} - {None}
    assert kinds == (set() if stage == "check" else {"panels", "seams"})
    assert ("flexmaps_flat" in obj.data.attributes) == (stage == "merge")


def test_read_blend_takes_what_is_seen(add: Any, tmp_path: Path) -> None:
    obj = add(([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], [(0, 1, 2, 3)]))
    obj.scale, obj.location = (-2.0, 1.0, 1.0), (0.0, 0.0, 3.0)
    obj.modifiers.new("More", "ARRAY").count = 3
    bpy.context.scene.unit_settings.scale_length = 0.01
    path = tmp_path / "piece.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    polygons = mesh.read_evaluated(scene.open_blend(path), bpy.context.scene)
    assert len(polygons.sizes) == 3
    assert np.ptp(polygons.vertices, axis=0) == pytest.approx([0.06, 0.01, 0.0])
    assert polygons.vertices[:, 2] == pytest.approx(np.full(len(polygons.vertices), 0.03))
    p = polygons.vertices[polygons.corners].reshape(-1, 4, 3)
    # mirrored along x: seen from where Blender shows its front
    assert (np.cross(p[:, 2] - p[:, 0], p[:, 3] - p[:, 1])[:, 2] > 0).all()


def test_read_blend_refuses_what_is_no_mesh(tmp_path: Path) -> None:
    with pytest.raises(FlexMapsError, match="no file"):
        mesh.read_evaluated(scene.open_blend(tmp_path / "nothing.blend"), bpy.context.scene)
    broken = tmp_path / "broken.blend"
    broken.write_bytes(b"BLENDER nonsense")
    with pytest.raises(FlexMapsError, match="cannot be opened"):
        mesh.read_evaluated(scene.open_blend(broken), bpy.context.scene)
    empty = tmp_path / "empty.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(empty))
    with pytest.raises(FlexMapsError, match="no object with faces"):
        mesh.read_evaluated(scene.open_blend(empty), bpy.context.scene)


@pytest.mark.parametrize("kind", ["text", "surface", "metaball", "curve"])
def test_what_is_no_mesh_yet_is_read_as_one_and_stays(kind: str, tmp_path: Path) -> None:
    """A text, a NURBS ball, a metaball and a curve with a bevel; the curve without one has no faces."""
    add = {
        "text": bpy.ops.object.text_add,
        "surface": bpy.ops.surface.primitive_nurbs_surface_sphere_add,
        "metaball": bpy.ops.object.metaball_add,
        "curve": bpy.ops.curve.primitive_bezier_circle_add,
    }[kind]
    add(location=(0.0, 0.0, 3.0))
    path = tmp_path / "piece.blend"
    if kind == "curve":
        bpy.ops.wm.save_as_mainfile(filepath=str(path))
        with pytest.raises(FlexMapsError, match="no object with faces"):
            scene.open_blend(path)
        bpy.context.scene.objects[0].data.bevel_depth = 0.2
    given = bpy.context.scene.objects[0]
    bpy.context.view_layer.update()
    size = tuple(given.dimensions)
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    found = scene.open_blend(path)
    assert found.type == "MESH" and tuple(found.dimensions) == pytest.approx(size, rel=1e-5)
    assert found.matrix_world.translation.z == 3.0
    (kept,) = (one for one in bpy.context.scene.objects if one != found)
    assert kept.type != "MESH" and kept.hide_viewport


def _small_sphere() -> QuadMesh:
    """A sphere of 54 quads, 20 mm wide."""
    mesh = shapes.cubesphere(3)
    return mesh.with_vertices(mesh.vertices * (0.02 / mesh.median_edge))


@pytest.mark.parametrize("clockwise", [False, True])
def test_solids_are_closed_and_as_heavy_as_the_sheets_say(clockwise: bool) -> None:
    """Volume of the closed solid (trimesh) against area of the outlines times thickness."""
    import trimesh

    flat = flatten.flatten(trace.trace_layout(shapes.make("cubesphere"), LayoutParams()), LayoutParams())
    made = fabricable.uniform_design(flat, SpiralParams(clockwise=clockwise))
    shape = solids.make_solids(made, arrange.arrange_patches(flat))
    starts = np.cumsum(shape.sizes) - shape.sizes
    fans = [
        [shape.corners[s], shape.corners[s + k], shape.corners[s + k + 1]]
        for s, n in zip(starts, shape.sizes)
        for k in range(1, n - 1)
    ]
    solid = trimesh.Trimesh(shape.vertices, np.array(fans), process=False)
    assert solid.is_watertight and solid.is_winding_consistent
    assert solid.body_count == len(flat.layout.patches)
    plain = sheets.make_sheets(
        made, SheetParams(labels=False, nesting="FAST"), connectors=ConnectorParams(connector="none")
    )
    area = sum(panel.area for panel in plain.panels)
    assert solid.volume == pytest.approx(area * made.params.thickness, rel=0.005)
    quad = np.repeat(shape.quad_of, shape.sizes)
    middle = (flat.corners + arrange.arrange_patches(flat)[flat.layout.patch_of][:, None]).mean(axis=1)
    away = np.linalg.norm(shape.vertices[shape.corners, :2] - middle[quad], axis=1)
    assert (away < 1.5 * made.scale[quad]).all()


def test_solids_of_very_many_spirals_have_longer_steps(monkeypatch: pytest.MonkeyPatch) -> None:
    import trimesh

    flat = flatten.flatten(trace.trace_layout(shapes.make("cubesphere"), LayoutParams()), LayoutParams())
    made, centres = fabricable.uniform_design(flat, SpiralParams()), arrange.arrange_patches(flat)
    faces = len(solids.make_solids(made, centres).sizes)
    monkeypatch.setattr(solids, "MAX_FACES", faces // 2)
    shape = solids.make_solids(made, centres)
    assert 0.3 * faces < len(shape.sizes) < 0.6 * faces
    starts = np.cumsum(shape.sizes) - shape.sizes
    fans = [shape.corners[[s, s + k, s + k + 1]] for s, n in zip(starts, shape.sizes) for k in range(1, n - 1)]
    assert trimesh.Trimesh(shape.vertices, np.array(fans), process=False).is_watertight


@pytest.mark.parametrize(
    "connector", ["tab", *(pytest.param(kind, marks=pytest.mark.thorough) for kind in ("dovetail", "key"))]
)
def test_solids_have_the_connectors_of_the_sheets(connector: str) -> None:
    """Against the outlines that are cut: the same shape from above (shapely), closed (trimesh), in the colours of their seams."""
    import shapely
    import trimesh

    flat = flatten.flatten(trace.trace_layout(_small_sphere(), LayoutParams()), LayoutParams())
    made = fabricable.uniform_design(flat, SpiralParams())
    cut = sheets.make_sheets(
        made, SheetParams(labels=False, nesting="FAST"), connectors=ConnectorParams(connector=connector)
    )
    centres = arrange.arrange_patches(flat)
    shape = solids.make_solids(made, centres, cut.connections.tips)
    starts = np.cumsum(shape.sizes) - shape.sizes
    fans = [
        [shape.corners[s], shape.corners[s + k], shape.corners[s + k + 1]]
        for s, n in zip(starts, shape.sizes)
        for k in range(1, n - 1)
    ]
    solid = trimesh.Trimesh(shape.vertices, np.array(fans), process=False)
    assert solid.is_watertight and solid.is_winding_consistent
    assert solid.body_count == len(flat.layout.patches)
    panels = [p for p in cut.panels if p.patch >= 0]
    assert solid.volume == pytest.approx(sum(p.area for p in panels) * made.params.thickness, rel=0.005)
    # every vertex of a connector lies on the outline that is cut
    heads = np.concatenate([np.arange(s, s + n) for s, n, k in zip(starts, shape.sizes, shape.seam_of) if k >= 0])
    points, quad = shape.vertices[shape.corners[heads], :2], np.repeat(shape.quad_of, shape.sizes)[heads]
    for panel in panels:
        mine = flat.layout.patch_of[quad] == panel.patch
        outline = shapely.LinearRing(panel.outline.sample(1e-6))
        assert shapely.distance(shapely.points(points[mine] - centres[panel.patch]), outline).max() < 3e-5
    seams = {int(k) for k in shape.seam_of} - {-1}
    assert seams == {c.seam for c in cut.connections.connectors}
    upper = solids.make_light_solids(made, centres, cut.connections.tips, max_faces=2000)
    assert upper.is_one_sided and {int(k) for k in upper.seam_of} - {-1} == seams


def test_bezier_curves_are_arcs() -> None:
    """A circle of four arcs: every point of Blender's curve is on it."""
    from flexmaps.engine.spirals.curves.arcs import Curve

    quarter = np.tan(np.pi / 8)
    circle = Curve(np.array([[1.0, 0], [0, 1], [-1, 0], [0, -1]]), np.full(4, quarter))
    knots, left, right = curves.to_bezier(circle)
    t = np.linspace(0, 1, 20)[:, None, None]
    a, b, c, d = knots, right, np.roll(left, -1, axis=0), np.roll(knots, -1, axis=0)
    points = (1 - t) ** 3 * a + 3 * t * (1 - t) ** 2 * b + 3 * t**2 * (1 - t) * c + t**3 * d
    assert np.linalg.norm(points, axis=-1) == pytest.approx(1.0, abs=3e-4)
    straight = Curve(np.array([[0.0, 0], [3, 0], [3, 3]]), np.zeros(3))
    knots, left, right = curves.to_bezier(straight)
    assert right[0] == pytest.approx([1.0, 0.0]) and left[1] == pytest.approx([2.0, 0.0])


def test_pictures_show_something_and_leave_the_scene_alone(result: job.Result, tmp_path: Path) -> None:
    obj = scene.show_result(result)
    scenes, objects = len(bpy.data.scenes), {o.name for o in bpy.data.objects}
    folder = tmp_path / "{blend_name} a{b {{x}}"  # Blender reads braces as templates
    folder.mkdir()
    for draw in (picture.render_layout, picture.render_panels, picture.render_shape):
        path = folder / f"{draw.__name__}.png"
        draw(obj, path, size=(320, 180), samples=1)
        image = bpy.data.images.load(str(path))
        assert tuple(image.size) == (320, 180)
        pixels = np.array(image.pixels).reshape(180, 320, 4)[..., :3]
        bpy.data.images.remove(image)
        colourful = np.ptp(pixels, axis=2) > 0.1
        assert 0.02 < colourful.mean() < 0.9
        border = np.concatenate([pixels[0], pixels[-1], pixels[:, 0], pixels[:, -1]])
        # white ground and grey shadows all round: nothing is cut off
        assert np.ptp(border, axis=1).max() < 0.15 and np.median(border) > 0.9
    assert len(bpy.data.scenes) == scenes and {o.name for o in bpy.data.objects} == objects


def test_a_picture_of_nothing_is_refused(dome: Any, tmp_path: Path) -> None:
    with pytest.raises(FlexMapsError, match="no flat panels"):
        picture.render_panels(dome, tmp_path / "x.png")
    with pytest.raises(FlexMapsError, match="no simulated shape"):
        picture.render_shape(dome, tmp_path / "x.png")


def test_panels_of_a_deleted_model_can_be_removed(spiralled: Any) -> None:
    from flexmaps.bridge.view import collection

    scene = bpy.context.scene
    assert collection.find_orphans(scene) == []
    assert bpy.ops.flexmaps.remove_left_over() == {"CANCELLED"}
    other = bpy.data.objects.new("other", bpy.data.meshes.new("other"))
    scene.collection.objects.link(other)
    bpy.data.objects.remove(spiralled)
    assert [one.name for one in collection.find_orphans(scene)] == ["FlexMaps piece"]
    assert bpy.ops.flexmaps.remove_left_over() == {"FINISHED"}
    assert collection.find_orphans(scene) == [] and list(scene.objects) == [other]
    assert not [c for c in bpy.data.collections if c.name.startswith("FlexMaps")]
    assert not [m for m in bpy.data.meshes if m.users == 0 and "panels" in m.name]
