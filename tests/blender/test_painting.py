"""Painted spirals in Blender: the session between strokes, weights and colours, protection, and scripts and the command line."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from flexmaps import api
from flexmaps.bridge.store import fields, mesh, states, stored_report
from flexmaps.bridge.view import dab_queue, flat_panels, paint_session
from flexmaps.command.main import main
from flexmaps.engine.display.moving_panels import MovingPanels
from flexmaps.engine.errors import FlexMapsError
from flexmaps.engine.spirals import fabricable
from flexmaps.engine.spirals.painting import Stroke
from support.buttons import press


def _kinds(obj: Any) -> dict[str, str]:
    return {name: state.kind for name, state in states.read_states(obj, bpy.context.scene).items()}


def test_a_stroke_leaves_the_spirals_done_and_later_stages_out_of_date(simulated: Any, attribute: Any) -> None:
    assert _kinds(simulated)["equilibrium"] == "DONE"
    before = attribute(simulated, "flexmaps_twist")
    on = paint_session.get_session(simulated, bpy.context.scene)
    centre = on.brush_surface.centres[12]
    weight = on.brush_surface.dab_weights(centre, on.brush_surface.normals[12], 0.05)
    assert 0 < (weight > 0).sum() < len(weight) and weight[12] == 1.0
    on.paint("stiffer", 0.8 * weight, Stroke())
    on.write(bpy.context.scene)
    after = attribute(simulated, "flexmaps_twist")
    assert (after[weight > 0.3] < before[weight > 0.3]).all() and (after[weight == 0] == before[weight == 0]).all()
    kinds = _kinds(simulated)
    assert kinds["spirals"] == "DONE" and kinds["equilibrium"] == "STALE"
    assert stored_report.read(simulated.data)["spirals"]["painted"]
    assert bpy.context.window_manager.flexmaps_overlay == "STIFFNESS"
    assert paint_session.get_session(simulated, bpy.context.scene) is on, "it stays from stroke to stroke"
    simulated.flexmaps.optimise.iterations, simulated.flexmaps.optimise.codesign = 1, False
    press("optimise")  # from these spirals, and no others
    assert stored_report.read(simulated.data)["optimise"]["start"] == "given"
    on = paint_session.get_session(simulated, bpy.context.scene)  # something else changed the spirals
    np.testing.assert_allclose(np.degrees(on.design.twist), attribute(simulated, "flexmaps_twist"), rtol=1e-6)
    np.testing.assert_allclose(on.design.width.ravel() * 1e3, attribute(simulated, "flexmaps_width"), rtol=1e-6)
    assert not on.changed_spirals.any()
    press("spirals")
    assert "painted" not in stored_report.read(simulated.data)["spirals"]


def test_panels_move_with_strokes_and_an_undo_brings_the_former_spirals(spiralled: Any) -> None:
    scene = bpy.context.scene

    def beside(obj: Any) -> tuple[Any, np.ndarray]:
        (panels,) = flat_panels.panels_of(obj)
        return panels.data, np.array([v.co for v in panels.data.vertices])

    on = paint_session.get_session(spiralled, scene)
    seen, states_of = [], []
    for brush, quad in (("stiffer", 3), ("softer", 20)):
        work = dab_queue.DabQueue(on, brush, inverted=False)
        weight = on.brush_surface.dab_weights(on.brush_surface.centres[quad], on.brush_surface.normals[quad], 0.06)
        for _ in range(3):
            work.add([0.4 * weight], np.zeros(3))
        work.wait()
        work.close()
        on.write(scene)
        bpy.ops.ed.undo_push(message="stroke")
        seen.append(beside(spiralled))
        states_of.append(on.design)
        anew = MovingPanels(on.design).solid
        np.testing.assert_allclose(seen[-1][1], anew.vertices, atol=1e-6)  # single precision
    assert seen[0][0] == seen[1][0] and not np.array_equal(seen[0][1], seen[1][1]), "one mesh, other points"
    bpy.ops.ed.undo()
    obj = bpy.context.object
    assert paint_session.get_session(obj, bpy.context.scene) is on, "only spirals have changed"
    np.testing.assert_allclose(on.design.twist, states_of[0].twist, rtol=1e-6)
    np.testing.assert_array_equal(beside(obj)[1], seen[0][1])
    full = paint_session.PaintSession(obj, bpy.context.scene)
    np.testing.assert_allclose(on.stiffness, full.stiffness, rtol=1e-5)
    full.discard()
    wrong = dab_queue.DabQueue(on, "nothing", inverted=False)
    with pytest.raises(FlexMapsError, match="no brush"):
        wrong.add([np.ones(len(on.design.twist))], np.zeros(3))
        wrong.wait()
    wrong.close()


def test_panels_with_a_rim_follow_strokes_at_the_border(spiralled: Any) -> None:
    spiralled.flexmaps.spiral.border = "rim"
    press("spirals")
    on = paint_session.get_session(spiralled, bpy.context.scene)
    border = on.design.flat.layout.mesh.border[on.design.flat.layout.mesh.quad_edges].any(axis=1)
    before: Any = None
    for brush in ("softer", "stiffer"):
        work = dab_queue.DabQueue(on, brush, inverted=False)
        work.add([0.5 * border], np.zeros(3))
        work.wait()
        work.close()
        assert "colour_arrays" in vars(on._panels._drawing), "beside the window's thread"
        on.write(bpy.context.scene)
        (panels,) = flat_panels.panels_of(spiralled)
        points = np.empty((len(panels.data.vertices), 3))
        panels.data.vertices.foreach_get("co", points.ravel())
        # beside a neck that another width was given, the points of the rim's edge lie where there is room by now
        np.testing.assert_allclose(points, MovingPanels(on.design).solid.vertices, atol=1e-4)
        assert before in (None, panels.data), "one mesh, other points"
        before = panels.data


def test_spirals_that_were_there_before_are_taken_without_asking_whether_they_can_be_cut(
    spiralled: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = []
    monkeypatch.setattr(fabricable, "unfabricable_quads", lambda *given: asked.append(given) or ())
    scene = bpy.context.scene
    on = paint_session.get_session(spiralled, scene)
    first, stiff = on.design, on.stiffness
    on.paint(
        "softer", on.brush_surface.dab_weights(on.brush_surface.centres[3], on.brush_surface.normals[3], 0.06), Stroke()
    )
    on.write(scene)
    mesh.write_design(spiralled, on._surface, first)  # as an undo leaves it
    assert paint_session.get_session(spiralled, scene) is on and not asked
    np.testing.assert_allclose(on.design.twist, first.twist, rtol=1e-6)
    np.testing.assert_array_equal(on.stiffness, stiff)
    mesh.write_design(spiralled, on._surface, replace(first, twist=0.9 * first.twist))
    assert paint_session.get_session(spiralled, scene) is on and len(asked) == 1, "nobody had these before"


def test_a_stroke_taken_back_leaves_everything_as_it_was(spiralled: Any, content: Any) -> None:
    before = content(spiralled)
    on = paint_session.get_session(spiralled, bpy.context.scene)
    on.paint("softer", np.ones(len(on.design.twist)), Stroke())
    on.paint("protect", np.ones(len(on.design.twist)), Stroke())
    assert on.changed_spirals.any() and on.protected.all()
    on.revert()
    assert not on.changed_spirals.any() and not on.protected.any() and content(spiralled) == before


def test_stiffness_from_weights_and_colours(spiralled: Any, attribute: Any) -> None:
    group = spiralled.vertex_groups.new(name="stiff")
    places = np.array([v.co for v in spiralled.data.vertices])
    share = (places[:, 0] - places[:, 0].min()) / np.ptp(places[:, 0])
    for k, weight in enumerate(share.tolist()):
        group.add([k], weight, "REPLACE")
    colour = spiralled.data.color_attributes.new("paint", "BYTE_COLOR", "CORNER")
    corner = np.array([loop.vertex_index for loop in spiralled.data.loops])
    grey = np.repeat(share[corner][:, None], 4, axis=1).astype(np.float32)
    colour.data.foreach_set("color", grey.ravel())
    assert fields.list_fields(spiralled)[:1] == ["stiff"] and "paint" in fields.list_fields(spiralled)
    surface = mesh.read_surface(spiralled, bpy.context.scene)
    exact = share[np.array([f.vertices for f in spiralled.data.polygons])].mean(axis=1)
    np.testing.assert_allclose(fields.read_field(spiralled, surface, "stiff"), exact, atol=1e-6)
    np.testing.assert_allclose(fields.read_field(spiralled, surface, "paint"), exact, atol=0.02)  # 8 bits
    press("paint_from", source="stiff", what="stiffness")
    twist = attribute(spiralled, "flexmaps_twist")
    assert np.corrcoef(exact, twist)[0, 1] < -0.95
    press("paint_from", source="stiff", what="protect")
    np.testing.assert_array_equal(attribute(spiralled, "flexmaps_protect"), exact >= 0.5)
    press("paint_from", source="paint", what="softer")
    assert (attribute(spiralled, "flexmaps_twist")[exact >= 0.5] == twist[exact >= 0.5]).all()
    press("unprotect")
    assert "flexmaps_protect" not in spiralled.data.attributes
    for wrong in ("", "nothing", "flexmaps_seam"):
        with pytest.raises(RuntimeError, match=r"Choose a vertex group|no vertex group|has no numbers"):
            bpy.ops.flexmaps.paint_from(source=wrong)


def test_scripts_paint_and_protect_objects(spiralled: Any, attribute: Any) -> None:
    before = attribute(spiralled, "flexmaps_width")
    piece = api.protect(api.paint(api.load(spiralled), "stiffer", "1,2,3", strength=0.5), "1")
    api.show(piece)
    after = attribute(spiralled, "flexmaps_width").reshape(-1, 4)
    changed = (after != before.reshape(-1, 4)).any(axis=1)
    assert np.flatnonzero(changed).tolist() == [1, 2, 3]
    assert np.flatnonzero(attribute(spiralled, "flexmaps_protect")).tolist() == [1]
    again = api.load(spiralled)
    assert again.result.protected.tolist() == [1] and again.result.design.is_painted
    free = api.protect(again, None)
    api.show(free)
    assert "flexmaps_protect" not in spiralled.data.attributes
    for words in (
        {"where": "nobody"},
        {"where": [1.0, 2.0]},
        {"strength": 2.0},
        {"brush": "along"},
        {"direction": "w"},
    ):
        with pytest.raises(FlexMapsError):
            api.paint(again, **{"brush": "stiffer"} | words)


def test_the_command_paints(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "painted.blend"
    words = ["paint", "shape:dome", "--edge", "30", "--brush", "along", "--along", "x", "--protect", "lowest"]
    assert main([*words, "--out", str(out)]) == 0
    piece = api.load(out)
    assert piece.result.design.is_painted and len(piece.result.protected) > 0
    assert np.ptp(piece.result.design.width, axis=1).max() > 2e-4
    assert main(["paint", "shape:dome", "--edge", "30", "--brush", "along"]) == 2
    assert "direction" in capsys.readouterr().err
