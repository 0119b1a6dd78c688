"""The Optimise button: what it writes, how it goes on, what it refuses, and that it can be stopped at any moment."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from flexmaps.bridge.hosts import background
from flexmaps.bridge.store import equilibrium, mesh, notes, settings
from flexmaps.bridge.view import colouring, designing, plot
from flexmaps.command import main as command
from flexmaps.engine.display import arrange, solids
from flexmaps.engine.errors import Cancelled
from flexmaps.engine.optimisation import optimise as engine
from flexmaps.engine.optimisation.reach import NAMES
from flexmaps.engine.params import LayoutParams, ObjectSettings, SpiralParams
from flexmaps.engine.patches.flattening.flatten import flatten
from flexmaps.engine.patches.tracing.trace import make_disks
from flexmaps.engine.spirals.design import outside, uniform
from flexmaps.engine.surface import shapes
from flexmaps.engine.surface.checking import check
from flexmaps.engine.surface.mesh import QuadMesh
from flexmaps.operators import optimise as operators

QUADS, EDGE = 45, 0.02


def bowl() -> QuadMesh:
    """A cube without its bottom, blown up to a ball, three by three quads a side: five patches."""
    steps = np.tan(np.linspace(-np.pi / 4, np.pi / 4, 4))
    u, v = (x.ravel() for x in np.meshgrid(steps, steps, indexing="ij"))
    index = np.arange(16).reshape(4, 4)
    face = np.stack([index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]], axis=-1).reshape(-1, 4)
    points, quads = [], []
    for axis, sign in ((0, 1), (0, -1), (1, 1), (1, -1), (2, 1)):
        quads.append((face if sign > 0 else face[:, ::-1]) + 16 * len(points))
        points.append(np.roll(np.stack([np.full(16, sign), u, v], axis=1), axis, axis=1))
    every, same = np.unique(np.round(np.concatenate(points), 9), axis=0, return_inverse=True)
    ball = QuadMesh(every / np.linalg.norm(every, axis=1, keepdims=True), same.ravel()[np.concatenate(quads)])
    return ball.moved(ball.vertices * (EDGE / ball.median_edge))


def press(name: str, **properties: Any) -> None:
    assert getattr(bpy.ops.flexmaps, name)(**properties) == {"FINISHED"}


@pytest.fixture
def piece(add: Any) -> Any:
    """A bowl with its spirals, ready to be optimised."""
    obj = add(bowl())
    press("trace")
    press("spirals")
    return obj


@pytest.fixture
def all_of(content: Callable[[Any], dict[str, bytes]]) -> Callable[[Any], dict[str, bytes]]:
    """What the mesh holds, shape keys included."""

    def found(obj: Any) -> dict[str, bytes]:
        keys = obj.data.shape_keys
        blocks = () if keys is None else keys.key_blocks
        return content(obj) | {f"key {b.name}": np.array([p.co[:] for p in b.data]).tobytes() for b in blocks}

    return found


def block(obj: Any, name: str = "optimise") -> dict[str, Any]:
    found: dict[str, Any] = notes.read(obj.data)[name]
    return found


def design(obj: Any) -> Any:
    """The spirals as the mesh holds them, read anew."""
    surface = mesh.read_surface(obj, bpy.context.scene)
    flat = mesh.current_flat(surface, check.as_quad_mesh(surface.polygons))
    return mesh.design_of(surface, flat, settings.read(obj.flexmaps.spiral, SpiralParams))


# -- what is written ---------------------------------------------------------------------------------------------------


def test_the_piece_comes_nearer_to_its_target(piece: Any, attribute: Any) -> None:
    before = attribute(piece, "flexmaps_twist")
    press("simulate")
    start = block(piece, "equilibrium")["laplacian_rmse_mm"]
    press("optimise")
    found = block(piece)
    assert found["finished"] and found["laplacian_rmse_mm_before"] == pytest.approx(start, rel=1e-3)
    assert found["laplacian_rmse_mm"] < 0.9 * start
    assert len(found["history"]) == found["iterations"] > 1
    assert np.abs(attribute(piece, "flexmaps_twist") - before).max() > 1.0
    # what is on the mesh is a design that can be cut, and what was simulated
    made = design(piece)
    assert not len(outside(made))
    assert block(piece, "spirals")["twist_deg"][0] == pytest.approx(np.degrees(made.twist.min()), abs=1e-3)
    assert not equilibrium.out_of_date(piece, bpy.context.scene, "optimise")
    assert equilibrium.key_of(piece.data).value == 1.0
    distance = attribute(piece, "flexmaps_distance")
    press("simulate")
    assert block(piece, "equilibrium")["laplacian_rmse_mm"] == pytest.approx(found["laplacian_rmse_mm"], rel=1e-3)
    assert attribute(piece, "flexmaps_distance") == pytest.approx(distance, abs=0.01)
    assert "optimise" in notes.read(piece.data)  # still true of these spirals
    press("spirals")
    assert "optimise" not in notes.read(piece.data) and "reach" not in notes.read(piece.data)


def test_pressed_again_it_goes_on(piece: Any) -> None:
    piece.flexmaps.optimise.codesign = False  # with it nothing would be left to gain
    piece.flexmaps.optimise.iterations = 2
    press("optimise")
    first = block(piece)
    piece.flexmaps.optimise.iterations = 60
    press("optimise")
    second = block(piece)
    assert second["start"] == "given"
    assert second["laplacian_rmse_mm_before"] == pytest.approx(first["laplacian_rmse_mm"], rel=1e-3)
    assert second["laplacian_rmse_mm"] < first["laplacian_rmse_mm"]


def test_changed_settings_are_kept_to(piece: Any, attribute: Any) -> None:
    press("optimise")
    assert attribute(piece, "flexmaps_width").max() > 1.5
    piece.flexmaps.spiral.width_max, piece.flexmaps.optimise.restart = 1.4, False
    assert equilibrium.out_of_date(piece, bpy.context.scene, "optimise")
    press("optimise")
    assert block(piece)["start"] == "given"
    assert attribute(piece, "flexmaps_width").max() <= 1.4 + 1e-5
    assert not len(outside(design(piece)))


def test_changed_seams_begin_with_the_last_spirals(piece: Any, attribute: Any) -> None:
    press("optimise")
    width = attribute(piece, "flexmaps_width")
    press("merge")
    assert block(piece, "layout")["patches"] == 1
    assert "flexmaps_width" not in piece.data.attributes
    assert not bpy.ops.flexmaps.simulate.poll()  # these spirals are not the new patches'
    assert attribute(piece, "flexmaps_last_width") == pytest.approx(width)
    seen = []
    real = engine.optimise

    def optimise(start: Any, *args: Any, **named: Any) -> Any:
        seen.append(start)
        return real(start, *args, **named)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(engine, "optimise", optimise)
        press("optimise")
    assert seen[0].width * 1e3 == pytest.approx(width, abs=0.3) and len(seen[0].flat.layout.patches) == 1
    assert "flexmaps_last_width" not in piece.data.attributes
    assert len(design(piece).flat.layout.patches) == 1


@pytest.mark.parametrize("mode", ["OBJECT", "EDIT"])
def test_undo_and_redo_in_one_step(piece: Any, all_of: Any, mode: str) -> None:
    name = piece.name
    bpy.ops.object.mode_set(mode=mode)
    bpy.ops.ed.undo_push(message="before")
    before = all_of(piece)
    press("optimise")
    bpy.ops.ed.undo_push(message="optimise")
    after = all_of(bpy.data.objects[name])
    bpy.ops.ed.undo()
    assert all_of(bpy.data.objects[name]) == before
    bpy.ops.ed.redo()
    assert all_of(bpy.data.objects[name]) == after


# -- stopped -----------------------------------------------------------------------------------------------------------


class Button(operators.Optimise.__mro__[1]):  # type: ignore[misc, name-defined]  # ContinuedStage without bpy.types.Operator
    """The operator without Blender's part of it."""

    bl_label = "Optimise"
    needs, loaded = operators.Optimise.needs, operators.Optimise.loaded
    continuation, finish, after = (getattr(operators.Optimise, name) for name in ("continuation", "finish", "after"))

    def __init__(self) -> None:
        self.said: list[tuple[str, str]] = []

    def report(self, kind: set[str], text: str) -> None:
        self.said.append((*kind, text))


def in_background(obj: Any, enough: Callable[[Any], bool]) -> tuple[Button, background.Job]:
    """Press it, and stop it as soon as ``enough`` of it was seen; what it has made is written."""
    button = Button()
    running = background.Job("Optimise", button._read(bpy.context))
    running.start()
    try:
        while not running.finished and not enough(running):
            time.sleep(0.001)
    finally:
        running.end()
    if running.error is None:
        for _ in button._write(bpy.context, running.result):
            pass
    return button, running


def test_stopping_keeps_the_best_so_far(piece: Any) -> None:
    button, running = in_background(piece, lambda job: job.shown is not None and len(job.shown.history) > 2)
    found = block(piece)
    assert not found["finished"] and "best so far" in button.said[-1][1]
    assert found["laplacian_rmse_mm"] < found["laplacian_rmse_mm_before"]
    assert not len(outside(design(piece)))
    assert running.shown.history[-1][0] >= running.shown.history[0][0] > 0.0
    press("optimise")
    assert block(piece)["finished"]
    assert block(piece)["laplacian_rmse_mm"] <= found["laplacian_rmse_mm"] * (1 + 1e-3)


def test_who_stops_it_does_not_wait_for_the_true_panels(
    piece: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from flexmaps.bridge.view import flat_panels
    from flexmaps.engine.fabrication.connectors import connect as connectors

    def unwanted(*_: Any, **__: Any) -> None:
        raise AssertionError("drawn after the stop")

    with monkeypatch.context() as patch:
        patch.setattr(connectors, "connect", unwanted)
        in_background(piece, lambda job: job.shown is not None and len(job.shown.history) > 2)
    (plain,) = flat_panels.panels_of(piece)
    # they stand where the new spirals are, and tell that they are not the last word
    assert plain[flat_panels.LOOK] == flat_panels.PLAIN
    assert not [o for o in bpy.data.objects if o.get("flexmaps_kind") == "outlines"]
    assert "slot_min_mm" not in block(piece, "spirals") and "reach" not in notes.read(piece.data)
    light = solids.light(design(piece), arrange.side_by_side(design(piece).flat))
    assert len(plain.data.vertices) == len(light.vertices)
    press("report")  # with what is known
    piece.flexmaps.export.folder = str(tmp_path)
    press("export")
    (drawn,) = flat_panels.panels_of(piece)
    assert drawn[flat_panels.LOOK] != flat_panels.PLAIN
    assert [o for o in bpy.data.objects if o.get("flexmaps_kind") == "outlines"]


def test_stopped_at_any_moment_the_scene_is_sound(piece: Any, all_of: Any, tmp_path: Path) -> None:
    piece.flexmaps.optimise.iterations = 6
    began = time.monotonic()
    in_background(piece, lambda running: False)
    whole = time.monotonic() - began
    random = np.random.default_rng(5)
    kept = 0
    for k in range(20):
        piece.flexmaps.optimise.smoothness = 0.01 * (k % 3)  # so that there is always something to do
        before, start, wait = all_of(piece), time.monotonic(), random.uniform(0.0, whole)
        _, running = in_background(piece, lambda _, until=start + wait: time.monotonic() > until)
        if running.error is not None:
            assert isinstance(running.error, Cancelled)
            assert all_of(piece) == before
        else:
            kept += 1
        assert background.current() is None
        assert not piece.data.validate(verbose=False)
        assert not len(outside(design(piece)))
        assert len(equilibrium.keys_of(piece.data)) == 1
        bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "piece.blend"), copy=True)
    assert kept > 0


# -- refused -----------------------------------------------------------------------------------------------------------


def test_patches_and_spirals_come_first(dome: Any) -> None:
    assert not bpy.ops.flexmaps.optimise.poll()
    press("flatten")
    assert not bpy.ops.flexmaps.optimise.poll()


def too_wide(obj: Any) -> None:
    obj.data.attributes["flexmaps_width"].data[7].value = 15.0


def too_wound(obj: Any) -> None:
    obj.data.attributes["flexmaps_twist"].data[7].value = 4000.0


def no_number(obj: Any) -> None:
    obj.data.attributes["flexmaps_twist"].data[7].value = np.nan


def missing(obj: Any) -> None:
    obj.data.attributes.remove(obj.data.attributes["flexmaps_width"])


def edited_seams(obj: Any) -> None:
    for edge in obj.data.edges:
        edge.use_seam = True


def unconverged(obj: Any) -> None:
    obj.flexmaps.simulate.iterations = 1


def falling(obj: Any) -> None:
    obj.flexmaps.simulate.gravity = True


@pytest.mark.parametrize(
    "mistake, says, culprits",
    [
        (too_wide, "1 spirals were changed by hand.*press Spirals", [7]),
        (too_wound, "cannot be cut", [7]),
        (no_number, "cannot be cut", [7]),
        (missing, "no spirals yet", []),
        (edited_seams, "Update from seams", None),
        (unconverged, "No equilibrium was found", []),
        (falling, "nothing holds", None),
    ],
    ids=lambda x: getattr(x, "__name__", ""),
)
def test_a_mistake_is_named_and_the_design_stays(
    piece: Any, all_of: Any, mistake: Callable[[Any], None], says: str, culprits: list[int] | None
) -> None:
    mistake(piece)
    before = all_of(piece)
    with pytest.raises(RuntimeError, match=says) as error:
        bpy.ops.flexmaps.optimise()
    assert str(error.value).count("Error: ") == 1
    assert all_of(piece) == before and piece.data.shape_keys is None
    if culprits:
        assert [p.index for p in piece.data.polygons if p.select] == culprits


# -- what is seen --------------------------------------------------------------------------------------------------------


def test_arms_are_drawn_where_they_are() -> None:
    """On flat squares: straight arms are rectangles from the middle of the sides to the centre; wound ones turn."""
    points = np.array([[0, 0], [1, 0], [1, 1], [0, 1], [2, 0], [2, 1]]) * EDGE
    quads = np.array([[0, 1, 2, 3], [1, 4, 5, 2]])
    vertices = np.c_[points, np.zeros(6)]
    width, twist = np.array([0.001, 0.002]), np.array([0.0, np.pi / 2])
    look = engine.Look(vertices, width, twist, 0.0012, 3)
    shape = designing.Designing(look, quads, SpiralParams(), ((0.0, 0.003), (0.1, 0.0012)))
    for unit in (1.0, 0.001):
        found, triangles = shape.bands(unit)
        pieces = len(found) // (2 * 4 * 2) - 1
        bands = found.reshape(2, 4, pieces + 1, 2, 3) * unit
        assert triangles.shape == (2 * 4 * pieces * 2, 3) and triangles.max() == len(found) - 1
        across = np.linalg.norm(bands[..., 0, :] - bands[..., 1, :], axis=-1)
        assert across == pytest.approx(np.broadcast_to(width[:, None, None], across.shape), rel=1e-4)
        line = bands.mean(axis=3)
        corners = vertices[quads]
        middles = 0.5 * (corners + np.roll(corners, -1, axis=1))
        assert line[:, :, 0, :2] == pytest.approx(middles[..., :2], abs=1e-6)
        assert line[:, :, -1, :2] == pytest.approx(
            np.broadcast_to(corners.mean(axis=1)[:, None, :2], (2, 4, 2)), abs=1e-6
        )
        # half way in, the second one's arms have turned by half of a quarter turn, counter-clockwise
        middle = pieces // 2
        out, now = middles[1] - corners[1].mean(axis=0), line[1, :, middle] - corners[1].mean(axis=0)
        turned = np.arctan2(np.cross(out, now)[:, 2], (out[:, :2] * now[:, :2]).sum(axis=1))
        assert turned == pytest.approx(np.full(4, twist[1] * middle / pieces), abs=1e-4)
        area = 0.5 * np.linalg.norm(
            np.cross(found[triangles[:, 1]] - found[triangles[:, 0]], found[triangles[:, 2]] - found[triangles[:, 0]]),
            axis=1,
        ).reshape(2, -1)
        assert area[0].sum() * unit**2 == pytest.approx(4 * 0.5 * EDGE * width[0], rel=1e-4)
    light = shape.colours.sum(axis=1)
    assert light[1] < light[0]  # the more wound, the darker
    assert "RMSE 1.2 mm" in shape.legend.title and "step 1" in shape.legend.title


def test_arms_lie_on_warped_quads() -> None:
    """Everywhere as high above the triangles that are drawn as on a flat quad."""
    vertices = np.array([[0, 0, 0.2], [1, 0, -0.15], [1.2, 1, 0.25], [0, 1, -0.2]]) * EDGE
    quads = np.array([[0, 1, 2, 3]])
    look = engine.Look(vertices, np.array([0.001]), np.array([4.0]), 0.001, 0)
    shape = designing.Designing(look, quads, SpiralParams(), ((0.0, 0.001),))
    triangles = shape.drawn(1.0)[0].reshape(-1, 3, 3).astype(float)
    corners, normal = shape.frame(1.0)
    found = shape.bands(1.0)[0].astype(float)
    heights = []
    for point in found:
        for a, b, c in triangles:  # where the line through the point along the quad's normal meets the triangle
            u, v, height = np.linalg.solve(np.stack([b - a, c - a, normal[0]], axis=1), point - a)
            if min(u, v, 1 - u - v) > -1e-6:
                heights.append(height)
                break
    assert len(heights) > 0.9 * len(found)  # but for the corners of the tips
    lift = designing.LIFT * float(np.linalg.norm(corners[0, 1] - corners[0, 0]))
    assert heights == pytest.approx([lift] * len(heights), rel=0.01)


def test_plot_of_the_history() -> None:
    def height(picture: np.ndarray, share: float) -> int:
        """The row of the highest point of the curve at a share of the way."""
        column = plot.MARGIN + int(share * (plot.SIZE - 2 * plot.MARGIN - 8)) + 4
        curve = (picture[:, column, 3] > 0.9) & (picture[:, column, 0] > 0.9)
        return int(np.flatnonzero(curve).max())

    falling = plot.picture([4.0, 3.0, 2.0])
    assert height(falling, 0.0) > height(falling, 0.5) > height(falling, 1.0)
    # in proportion, as the scale begins at zero
    low = plot.MARGIN
    assert (height(falling, 1.0) - low) / (height(falling, 0.0) - low) == pytest.approx(0.5, abs=0.06)
    assert height(plot.picture([1.0, 1e-3]), 1.0) < height(plot.picture([1.0, 1e-3]), 0.5)
    for odd in ([], [1.0], [0.0, 0.0], [1.0, np.nan, 0.5], [2.0] * 1000):
        picture = plot.picture(odd)
        assert picture.shape == (plot.SIZE, plot.SIZE, 4) and np.isfinite(picture).all()
        assert ((picture >= 0.0) & (picture <= 1.0)).all()
    assert plot.icon([3.0, 2.0]) == plot.icon([3.0, 2.0, 1.0])  # one icon, drawn anew


def test_limits_as_colours(piece: Any, attribute: Any) -> None:
    with pytest.raises(RuntimeError, match="press Simulate first"):
        bpy.ops.flexmaps.overlay(kind="REACH")
    for stage in ("simulate", "optimise"):
        press(stage)
        found = block(piece, "reach")
        assert sum(found["spirals"].values()) == QUADS and found["advice"].endswith(".")
        press("overlay", kind="REACH")
        legend = colouring.legend_of(piece, "REACH")
        shown = {name: n for name, n in found["spirals"].items() if n}
        assert sorted(int(text.rpartition(": ")[2]) for _, text in legend.entries) == sorted(shown.values())
        rgb = np.round(attribute(piece, "flexmaps_colour", "color", 4)[::4, :3], 5)
        assert len(np.unique(rgb, axis=0)) == len(shown)
    assert set(colouring.LIMITS) == set(NAMES)
    piece.flexmaps.material.material = "birch"
    with pytest.raises(RuntimeError, match="nothing to show"):
        bpy.ops.flexmaps.overlay(kind="REACH")


def test_many_panels_are_drawn_light() -> None:
    """The upper side of the panels covers what the design's own outline says."""
    quads = shapes.make("dome")
    surface = make_disks(mesh_layout(quads))
    made = uniform(flatten(surface, LayoutParams()), SpiralParams(), twist=2.0)
    centres = arrange.side_by_side(made.flat)
    assert not solids.light(made, centres, most=10**6).flat
    shape = solids.light(made, centres, most=20_000)
    assert shape.flat and len(shape.sizes) <= 20_000
    ends = np.cumsum(shape.sizes)
    area = 0.0
    for end, size in zip(ends, shape.sizes, strict=True):
        x, y = shape.vertices[shape.corners[end - size : end], :2].T
        area += 0.5 * float(x @ np.roll(y, -1) - y @ np.roll(x, -1))
    assert area == pytest.approx(made.area.sum(), rel=0.03)


def mesh_layout(quads: QuadMesh) -> Any:
    from flexmaps.engine.patches.layout import PatchLayout

    return PatchLayout(quads, np.zeros(len(quads.edges), bool))


# -- main job ------------------------------------------------------------------------------------------------------------


def test_main_job_with_and_without(tmp_path: Path) -> None:
    reports = {}
    for flag in ((), ("--optimise", "--optimise-iterations", "3")):
        out = tmp_path / str(len(flag))
        arguments = [
            "shape:saddle",
            "--edge",
            "20",
            "--out",
            str(out),
            "--no-pictures",
            "--stop-after",
            "simulate",
            *flag,
        ]
        assert command.main(["run", *arguments]) == 0
        reports[bool(flag)] = json.loads((out / "report.json").read_text())
    assert "optimise" not in reports[False] and "optimise" not in reports[False]["seconds"]
    found = reports[True]["optimise"]
    assert {"method", "iterations", "laplacian_rmse_mm_before", "laplacian_rmse_mm", "at_bound", "history"} <= set(
        found
    )
    assert found["laplacian_rmse_mm"] < found["laplacian_rmse_mm_before"]
    assert reports[True]["equilibrium"]["laplacian_rmse_mm"] == pytest.approx(found["laplacian_rmse_mm"], rel=1e-3)
    assert reports[True]["spirals"] != reports[False]["spirals"]
    assert {"spirals", "mismatch_share", "advice"} == set(reports[True]["reach"])
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "3" / "model.blend"))
    obj = bpy.data.objects["saddle"]
    assert not equilibrium.out_of_date(obj, bpy.context.scene, "optimise")
    assert block(obj)["history"] == found["history"]


def test_a_running_optimisation_touches_nothing(piece: Any, all_of: Any) -> None:
    before = all_of(piece)
    surface = mesh.read_surface(piece, bpy.context.scene)
    work = Button().prepare(surface, settings.read(piece.flexmaps, ObjectSettings))
    running = background.Job("Optimise", work)
    running.start()
    running.end()
    assert all_of(piece) == before
