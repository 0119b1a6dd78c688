"""The functions for scripts: on files, arrays and objects, and the example that the guide shows."""

from __future__ import annotations

import contextlib
import html
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from flexmaps import api
from flexmaps.engine.errors import FlexMapsError
from flexmaps.engine.params import ObjectSettings
from flexmaps.engine.surface import shapes
from flexmaps.engine.surface.mesh import PolygonMesh

FEW = {"optimise.iterations": 2, "optimise.codesign": False, "sheet.nesting": "FAST"}


@pytest.fixture(scope="module")
def strip() -> api.Piece:
    return api.simulate(api.load("shape:strip", edge=20, settings=FEW), supports="lowest")


def obj_file(path: Path, mesh: PolygonMesh) -> Path:
    """Written by hand, y up as .obj files are."""
    lines = [f"v {y:.9g} {z:.9g} {x:.9g}" for x, y, z in mesh.vertices]
    ends = np.cumsum(mesh.sizes)
    faces = [mesh.corners[end - size : end] + 1 for end, size in zip(ends, mesh.sizes)]
    path.write_text("\n".join([*lines, *("f " + " ".join(map(str, face)) for face in faces)]) + "\n")
    return path


def triangles(name: str) -> PolygonMesh:
    mesh = shapes.make(name)
    corners = mesh.quads[:, [0, 1, 2, 0, 2, 3]]
    return PolygonMesh(mesh.vertices, corners.ravel(), np.full(2 * len(corners), 3))


# -- loading -------------------------------------------------------------------------------------------------------------


def test_a_file_an_object_and_arrays_are_the_same(tmp_path: Path, add: Any) -> None:
    mesh = shapes.make("strip")
    sources = [
        obj_file(tmp_path / "strip.obj", PolygonMesh.from_quads(mesh)),
        add(mesh),
        mesh,
        PolygonMesh.from_quads(mesh),
    ]
    for source in sources:
        piece = api.load(source)
        assert piece.mesh.vertices == pytest.approx(mesh.vertices, abs=1e-6)
        assert (piece.mesh.quads == mesh.quads).all()


def test_sizes_are_in_millimetres(tmp_path: Path) -> None:
    path = obj_file(tmp_path / "strip.obj", PolygonMesh.from_quads(shapes.make("strip", 3.7)))
    vertices = api.load(path, height=50).mesh.vertices
    assert np.ptp(vertices[:, 2]) == pytest.approx(0.05)
    edges = api.regularise(api.load(path, edge=12)).mesh.edge_lengths
    assert np.median(edges) == pytest.approx(0.012)


def test_what_is_wrong_is_named_and_every_stage_says_so(add: Any) -> None:
    piece = api.load(triangles("strip"))
    assert [f.code for f in api.check(piece) if f.is_error] == ["non-quad"]
    with pytest.raises(api.FlexMapsError, match="not quads"):
        api.layout(piece)


def test_the_main_job_makes_quads_of_triangles_and_says_so(tmp_path: Path) -> None:
    path = obj_file(tmp_path / "ball.obj", triangles("cubesphere"))
    small = {"settings": {"remesh.quads": 150}, "stop_after": "regularise", "pictures": False}
    described = api.run(path, tmp_path / "out", edge=15, **small)
    (remeshed,) = [finding["message"] for finding in described["checks"] if finding["code"] == "remeshed"]
    assert html.escape(remeshed) in (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    with pytest.raises(api.FlexMapsError, match="not quads"):
        api.run(path, tmp_path / "other", edge=15, remeshed=False, **small)


def test_any_mesh_gets_quads_of_the_size_that_was_asked_for(add: Any) -> None:
    before = len(bpy.data.objects), len(bpy.data.meshes)
    piece = api.load(triangles("cubesphere"), edge=15, quads=300)
    assert (len(bpy.data.objects), len(bpy.data.meshes)) == before
    assert 150 < len(piece.mesh.quads) < 600
    assert np.median(piece.mesh.edge_lengths) == pytest.approx(0.015)
    assert not [f for f in api.check(piece) if f.is_error]


# -- stages --------------------------------------------------------------------------------------------------------------


def test_a_stage_makes_what_is_missing_and_leaves_the_piece_as_it_was() -> None:
    piece = api.load("shape:strip", edge=20)
    made = api.spirals(piece)
    assert piece.result.flat is None and piece.result.design is None
    assert made.result.flat is not None and made.result.design is not None
    assert {"regularise", "trace", "merge", "split", "spirals"} <= set(made.result.seconds)


def test_supports_stand_on_the_ground_and_stay_there(strip: api.Piece) -> None:
    held, mesh = strip.result.supports, strip.mesh
    assert held is not None and 0 < len(held) < len(mesh.quads)
    height = mesh.vertices[:, 2]
    corners = np.sort(height[mesh.quads], axis=1)[:, :2]  # the two lowest of every quad
    assert (corners[held] < height.min() + 0.5 * mesh.median_edge).all()
    simulation = strip.result.simulation
    assert simulation is not None
    away = np.linalg.norm(simulation.equilibrium.pose.centres - mesh.centroids, axis=1)
    assert away[held].max() < 1e-9 < away.max()


@pytest.mark.parametrize("name, feet", [("vault", 4), ("demo", 3)])
def test_feet_that_stand_on_their_tips(name: str, feet: int) -> None:
    held = api.load(f"shape:{name}", edge=20, supports="lowest").result.supports
    assert held is not None and len(held) == feet


@pytest.mark.parametrize("wrong", ["5,9999", "-1", "feet", "", [3.5, "a"]])
def test_supports_that_name_nothing_are_refused(strip: api.Piece, wrong: Any) -> None:
    with pytest.raises(api.FlexMapsError):
        api.change(strip, supports=wrong)


def test_numbers_of_supports(strip: api.Piece) -> None:
    for which in ("7, 3,3", [3, 7], np.array([7, 3])):
        assert api.change(strip, supports=which).result.supports.tolist() == [3, 7]  # type: ignore[union-attr]


def test_other_settings_drop_what_they_concern_and_no_more(strip: api.Piece) -> None:
    done = api.sheets(api.optimise(strip))
    kept = {
        ("spiral.thickness", 3): ("flat", "design"),  # no outline of a spiral depends on it
        ("spiral.blend", 0.2): ("flat",),
        ("layout.patch_min", 3): (),
        ("material.material", "birch"): ("flat", "design", "sheets"),
        ("sheet.sheet_width", 500): ("flat", "design", "optimisation", "simulation"),
        ("optimise.smoothness", 0.5): ("flat", "design", "optimisation", "simulation", "sheets"),
        ("spiral.thickness", 2): ("flat", "design", "optimisation", "simulation", "sheets"),  # the same as before
    }
    names = ("flat", "design", "optimisation", "simulation", "sheets")
    for (name, value), expected in kept.items():
        result = api.change(done, {name: value}).result
        assert tuple(n for n in names if getattr(result, n) is not None) == expected, name


@pytest.mark.parametrize("wrong", [{"spiral.thicknes": 2}, {"spirals.thickness": 2}, {"thickness": 2},
                                   {"spiral.thickness": "thick"}, {"spiral.thickness": -1}, {"spiral.clockwise": "maybe"},
                                   {"layout.patch_min": 2.5}, {"material.material": "cheese"}])  # fmt: skip
def test_wrong_settings_are_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(api.FlexMapsError):
        api.load("shape:strip", settings=wrong)


def test_settings_as_texts_in_shown_units() -> None:
    given = {"spiral.thickness": "3", "spiral.twist_max": "180", "spiral.clockwise": "on", "layout.patch_min": "9"}
    found = api.load("shape:strip", settings=given).settings
    assert found.spiral.thickness == pytest.approx(0.003)
    assert found.spiral.twist_max == pytest.approx(np.pi)
    assert found.spiral.clockwise is True and found.layout.patch_min == 9


def test_progress_rises_and_can_stop(strip: api.Piece) -> None:
    heard: list[float] = []
    api.spirals(api.load("shape:strip", edge=20), progress=lambda fraction, text: heard.append(fraction))
    assert heard == sorted(heard) and heard[-1] == 1.0

    def stop(fraction: float, text: str) -> None:
        raise api.Cancelled(text)

    with pytest.raises(api.Cancelled):
        api.optimise(strip, progress=stop)


def test_an_optimisation_that_fails_says_so(strip: api.Piece) -> None:
    with pytest.raises(api.FlexMapsError, match="supports"):
        api.optimise(api.load("shape:strip", edge=20, settings={"simulate.gravity": True}))


# -- objects -------------------------------------------------------------------------------------------------------------


def test_what_is_shown_can_be_loaded_again(strip: api.Piece, tmp_path: Path) -> None:
    obj = api.show(strip)
    again = api.load(obj)
    assert again.settings.sheet.nesting == "FAST"
    assert (again.result.supports == strip.result.supports).all()  # type: ignore[operator]  # by a vertex group
    for name in ("width", "twist"):
        stored, made = getattr(again.result.design, name), getattr(strip.result.design, name)
        assert stored == pytest.approx(made, rel=1e-5)
    both = [p.result.simulation for p in (api.simulate(again), strip)]
    centres = [s.equilibrium.pose.centres for s in both if s is not None]
    assert centres[0] == pytest.approx(centres[1], abs=1e-5)
    path = api.save(again, tmp_path / "strip.blend")
    assert api.load(path).result.design is not None


def test_saving_a_piece_leaves_the_open_file_alone(strip: api.Piece, dome: Any, tmp_path: Path) -> None:
    """Somebody has work open that is not saved, and saves a piece that came from elsewhere."""
    kinds = ("objects", "meshes", "scenes", "collections", "materials", "images")
    before = {kind: set(getattr(bpy.data, kind)) for kind in kinds}
    path = api.save(strip, tmp_path / "strip.blend")
    assert {kind: set(getattr(bpy.data, kind)) for kind in kinds} == before
    assert bpy.context.object == dome and len(dome.data.polygons)
    bpy.ops.wm.open_mainfile(filepath=str(path))
    assert "piece" not in bpy.data.objects  # nor is anything of it in the file
    shown = bpy.context.view_layer.objects.active
    assert len(shown.data.polygons) == len(strip.mesh.quads) and "flexmaps_flat" in shown.data.uv_layers
    assert bpy.context.scene.unit_settings.length_unit == "MILLIMETERS"


def test_no_arm_ends_in_the_air_unless_somebody_wants_that(dome: Any) -> None:
    def border(source: Any, **options: Any) -> str:
        return api.load(source, **options).settings.spiral.border

    assert border("shape:dome") == border(shapes.make("dome")) == border(dome) == "left_out"
    assert border("shape:dome", settings={"spiral.border": "stubs"}) == "stubs"
    assert border("shape:cubesphere") == ObjectSettings().spiral.border
    dome.flexmaps.spiral.border = "stubs"
    assert border(dome) == "stubs"


def test_an_object_moves_only_when_it_is_regularised(dome: Any) -> None:
    before = np.array([v.co for v in dome.data.vertices])
    assert api.show(api.layout(api.load(dome))) == dome
    assert np.array([v.co for v in dome.data.vertices]) == pytest.approx(before, abs=0)
    piece = api.regularise(api.load(dome))
    api.show(piece)
    assert np.array([v.co for v in dome.data.vertices]) == pytest.approx(piece.mesh.vertices, abs=1e-6)


def test_seams_of_an_object(dome: Any) -> None:
    across = [e.index for e in dome.data.edges if all(abs(dome.data.vertices[v].co.x) < 1e-6 for v in e.vertices)]
    for index in across:
        dome.data.edges[index].use_seam = True
    piece = api.layout(api.load(dome), keep_seams=True)
    assert int(piece.result.flat.layout.cut.sum()) == len(across) > 3  # type: ignore[union-attr]
    api.show(piece)
    dome.data.edges[across[0]].use_seam = False
    with pytest.raises(api.FlexMapsError, match="seams were edited"):
        api.spirals(api.load(dome))
    api.spirals(api.layout(api.load(dome)))  # traced anew
    with pytest.raises(api.FlexMapsError, match="no seams"):
        api.layout(api.load("shape:dome", edge=20), keep_seams=True)


def test_a_vertex_group_holds(dome: Any) -> None:
    low = min(v.co.z for v in dome.data.vertices)
    group = dome.vertex_groups.new(name="feet")
    group.add([v.index for v in dome.data.vertices if v.co.z < low + 1e-3], 1.0, "REPLACE")
    held = api.load(dome, supports="feet").result.supports
    assert held is not None and set(held) == set(api.load(dome, supports="lowest").result.supports)  # type: ignore[arg-type]


def test_vertices_of_no_face_stay_and_disturb_nothing(strip: api.Piece, add: Any) -> None:
    mesh = strip.mesh
    far = np.array([[9.0, 9.0, 9.0]])
    vertices = np.concatenate([far, mesh.vertices[:70], far, mesh.vertices[70:]])
    moved = mesh.quads + 1 + (mesh.quads >= 70)
    obj = api.show(api.simulate(api.load(add((vertices, moved))), supports="lowest"))
    key = np.array([point.co for point in obj.data.shape_keys.key_blocks["FlexMaps equilibrium"].data])
    assert key[[0, 71]] == pytest.approx(np.repeat(far, 2, axis=0))
    wanted = strip.result.simulation.vertices  # type: ignore[union-attr]
    assert np.delete(key, [0, 71], axis=0) == pytest.approx(wanted, abs=2e-5)


def test_another_object_is_not_written_over(strip: api.Piece, dome: Any, content: Any) -> None:
    before = content(dome)
    with pytest.raises(api.FlexMapsError, match="other faces"):
        api.show(strip, dome)
    assert content(dome) == before


# -- files and examples --------------------------------------------------------------------------------------------------


def test_export_writes_all_or_nothing(strip: api.Piece, tmp_path: Path) -> None:
    written = api.export(strip, tmp_path / "out", formats=("svg", "3mf"))
    assert {path.name for path in written} == {p.name for p in (tmp_path / "out").glob("[!.]*")}
    with pytest.raises(api.FlexMapsError):
        api.export(strip, tmp_path / "other", formats=("svg", "png"))
    assert not (tmp_path / "other").exists()


@pytest.mark.thorough
def test_the_example_of_the_guide(root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text = (root / "docs" / "guide.md").read_text(encoding="utf-8")
    code = re.search(r"```python\n(.*?)```", text, re.DOTALL)
    assert code is not None
    monkeypatch.chdir(tmp_path)
    exec(compile(code.group(1), "guide.md", "exec"), {})
    found = {path.name for path in (tmp_path / "out" / "strip").iterdir()}
    assert {"report.html", "report.json", "model.blend", "sheet-01.svg", "sheet-assembly.pdf"} <= found


def test_import_by_name_from_a_folder_above(root: Path, tmp_path: Path) -> None:
    """As the guide says; and what runs without Blender does not load it."""
    (tmp_path / "flexmaps").symlink_to(root, target_is_directory=True)
    code = (
        "import sys\nimport flexmaps\nassert 'scipy' not in sys.modules\nfrom flexmaps import api\n"
        "piece = api.simulate(api.load('shape:strip', edge=20))\nassert 'bpy' not in sys.modules\n"
        "print(len(piece.mesh.quads))"
    )
    environment = dict(os.environ, PYTHONPATH=str(tmp_path))
    done = subprocess.run([sys.executable, "-c", code], env=environment, cwd=tmp_path, capture_output=True, text=True)
    assert done.stdout.strip() == "108", done.stderr


def test_a_file_name_that_is_no_text(tmp_path: Path) -> None:
    """Names of files are bytes on Linux; the report is text."""
    path = os.path.join(os.fsencode(tmp_path), b"st\xfcck.obj")
    with contextlib.suppress(OSError):  # where names must be text
        Path(os.fsdecode(path)).write_text("v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\n")
        piece = api.load(os.fsdecode(path), edge=20)
        assert piece.name == "st?ck.obj"
        api.report(api.layout(piece), tmp_path)


@pytest.mark.parametrize("size", ["20", True, [20], 1j])
def test_lengths_that_are_none(size: Any) -> None:
    with pytest.raises(FlexMapsError, match="is not a length"):
        api.load("shape:strip", edge=size)
