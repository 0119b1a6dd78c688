"""The buttons that do what is advised: what they change and bring, what they leave as it was, and when they are grey."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import SimpleNamespace
from typing import Any

import bpy
import numpy as np
import pytest
from flexmaps.bridge.hosts import background
from flexmaps.bridge.store import advice, mesh, states, stored_report
from flexmaps.bridge.view import flat_panels
from flexmaps.engine.errors import FlexMapsError
from flexmaps.engine.progress import Progress
from flexmaps.operators import advice as operators
from flexmaps.operators import stage
from flexmaps.operators.continued_stage import ContinuedStage
from support.arch import group
from support.bowl import QUADS, bowl
from support.buttons import press, report
from support.drawing import everything as drawn
from support.window import ESCAPE, MOUSE, Window, clean, drive

BUTTONS = {
    "larger": ("make_larger", operators.MakeLarger),
    "thinner": ("make_thinner", operators.MakeThinner),
    "finer": ("make_finer", operators.MakeFiner),
}


def simulated(add: Any, material: str, *, mirrored: bool = False, limit: float = 0.02) -> Any:
    obj = add(bowl())
    obj.scale.x = -1.0 if mirrored else 1.0
    obj.flexmaps.material.material, obj.flexmaps.material.strain_limit = material, limit
    obj.flexmaps.connect.connector = "none"
    obj.location = 0.1, 0.2, 0.3
    bpy.context.view_layer.update()
    for name in ("check", "merge", "spirals", "simulate"):
        press(name)
    return obj


@pytest.fixture
def strained(add: Any, once: Any) -> Any:
    """A bowl whose arms are strained a little more than they bear."""
    return once("strained", lambda: simulated(add, "custom", limit=0.0122))


@pytest.fixture
def distorted(add: Any, once: Any) -> Any:
    """A bowl of a softer material, whose match is held back by quads that flattening distorts."""
    return once("distorted", lambda: simulated(add, "pom"))


def everything(obj: Any, all_of: Callable[[Any], dict[str, bytes]]) -> dict[str, Any]:
    """What the mesh holds, the settings, the size and what there is in the file."""
    settings = {name: str(obj.flexmaps[name].to_dict()) for name in obj.flexmaps.keys()}  # noqa: SIM118
    there = sorted(o.name for o in bpy.data.objects), sorted(m.name for m in bpy.data.meshes)
    return {**all_of(obj), "settings": settings, "scale": tuple(obj.scale), "there": there, "hidden": obj.hide_get()}


def done(obj: Any, *, optimised: bool = False) -> None:
    """Everything up to the simulation is up to date, and stands there whole."""
    now = states.read_states(obj, bpy.context.scene)
    wanted = {"checks", "layout", "spirals", "equilibrium", "reach", *(("optimise",) if optimised else ())}
    assert {name for name in wanted if now[name].kind == states.DONE} == wanted
    surface = mesh.read_surface(obj, bpy.context.scene)
    assert len(surface.polygons.sizes) == len(obj.data.polygons) and not len(surface.invalid_faces)
    assert len(flat_panels.panels_of(obj)) == 1
    assert obj.data.shape_keys is not None and not obj.data.validate(verbose=False)


@contextmanager
def one_step(obj: Any, all_of: Callable[[Any], dict[str, bytes]]) -> Iterator[None]:
    """What is done within can be undone in one step, in the end."""
    name = obj.name
    bpy.ops.ed.undo_push(message="before")
    before = everything(bpy.data.objects[name], all_of)
    yield
    bpy.ops.ed.undo_push(message="after")
    bpy.ops.ed.undo()
    assert everything(bpy.data.objects[name], all_of) == before


def figures(obj: Any) -> tuple[float, float]:
    block = report(obj)["equilibrium"]
    return block["rms_percent"], block["strain_share_max"]


# -- what they bring ---------------------------------------------------------------------------------------------------


def test_larger(strained: Any, attribute: Any, all_of: Any) -> None:
    obj = strained
    factor = advice.read_advice(strained.data)["larger"]
    assert 1.0 < factor < 1.5
    distance, strain = figures(strained)
    size, place = np.array(strained.dimensions), tuple(strained.location)
    with one_step(obj, all_of):
        press("make_larger")
        assert tuple(strained.scale) == pytest.approx((factor,) * 3) and tuple(strained.location) == place
        assert np.array(strained.dimensions) == pytest.approx(
            factor * size, rel=0.2
        )  # of the shape at rest, with its key
        assert figures(strained)[1] < min(1.0, strain)
        brought = report(strained)["reach"]["brought"]
        assert brought["rms_percent"] == [distance, figures(strained)[0]]
        assert brought["strain_share_max"] == [strain, figures(strained)[1]]
        assert f"strain {100 * strain:.0f} % to {100 * figures(strained)[1]:.0f} %" in advice.describe_effect(brought)
        done(strained)
        # the flat patches are as much larger as the surface is
        uv = attribute(strained, "flexmaps_flat", "vector", 2)
        flat = {f.index: uv[list(f.loop_indices)] for f in strained.data.polygons}
        edges = np.array(
            [np.linalg.norm(corners - np.roll(corners, 1, axis=0), axis=1).mean() for corners in flat.values()]
        )
        assert np.median(edges) == pytest.approx(20.0 * factor, rel=0.1)


def test_thinner(strained: Any, all_of: Any) -> None:
    obj = strained
    assert advice.read_advice(strained.data)["thinner"] == pytest.approx(1.5)
    before, edges = figures(strained), [edge.use_seam for edge in strained.data.edges]
    with one_step(obj, all_of):
        press("make_thinner")
        assert strained.flexmaps.spiral.thickness == pytest.approx(1.5)
        assert figures(strained)[1] < before[1] and tuple(strained.scale) == (1, 1, 1)
        assert [edge.use_seam for edge in strained.data.edges] == edges
        brought = report(strained)["reach"]["brought"]
        assert advice.describe_effect(brought).startswith("Sheet of 1.5 mm instead of 2 mm: RMS distance ")
        done(strained)


def test_finer(add: Any, all_of: Any) -> None:
    obj = distorted = simulated(add, "pom", mirrored=True)
    wanted, before = advice.read_advice(distorted.data)["finer"], figures(distorted)
    assert wanted == 2 * QUADS
    distorted.flexmaps.sheet.margin = 7.0  # a setting that the new object takes along
    with one_step(obj, all_of):
        press("make_finer")
        made = bpy.context.object
        assert (
            made != distorted and distorted.hide_get() and not made.hide_get() and len(distorted.data.polygons) == QUADS
        )
        assert 1.5 * QUADS < len(made.data.polygons) < 2.5 * QUADS
        assert made.flexmaps.sheet.margin == pytest.approx(7.0)
        assert tuple(made.location) == pytest.approx((0.1, 0.2, 0.3))
        assert figures(made)[0] < before[0]
        brought = report(made)["reach"]["brought"]
        assert advice.describe_effect(brought).startswith(
            f"{len(made.data.polygons)} quads instead of {QUADS}: RMS distance "
        )
        done(made)


@pytest.mark.thorough
def test_what_was_optimised_is_optimised_again(add: Any) -> None:
    obj = simulated(add, "birch")
    obj.flexmaps.optimise.iterations = 1
    obj.flexmaps.optimise.codesign = obj.flexmaps.optimise.restart = False
    press("optimise")
    before = figures(obj)
    assert before[1] > 1.2
    press("make_larger")
    # as many times as the strain is beyond its limit, in steps of a twentieth, no more than twice
    assert (
        obj.scale[0] == pytest.approx(min(2.0, np.ceil(20.0 * before[1]) / 20.0)) and report(obj)["optimise"]["history"]
    )
    assert figures(obj)[1] < before[1]
    done(obj, optimised=True)


def test_spirals_that_were_set_by_hand_stay(strained: Any, attribute: Any) -> None:
    strained.data.attributes["flexmaps_twist"].data.foreach_set("value", np.full(QUADS, 30.0, np.float32))
    press("simulate")
    press("make_larger")
    assert attribute(strained, "flexmaps_twist") == pytest.approx(np.full(QUADS, 30.0), abs=0.1)


@pytest.mark.parametrize(
    ("distance", "strain", "helped"),
    [
        ([2.0, 1.0], [0.5, 0.9], True),
        ([2.0, 1.99], [0.5, 0.4], False),  # nobody needs less strain than is borne
        ([2.0, 2.1], [1.4, 0.9], True),
        ([2.0, 2.1], [1.4, 1.5], False),
        ([2.0, 2.1], [0.97, 0.8], True),  # a tenth is kept as a margin
        ([2.0, 1.0], [None, None], True),  # rods tell no strain
        ([2.0, 2.0], [None, None], False),
    ],
)
def test_what_brought_nothing_is_said(distance: list[float], strain: list[Any], helped: bool) -> None:
    brought = {"remedy": "larger", "was": 1.0, "now": 1.25, "rms_percent": distance, "strain_share_max": strain}
    assert advice.has_helped(brought) == helped and ("did not help" in advice.describe_effect(brought)) != helped
    assert advice.describe_effect(brought).startswith(f"1.25 times as large: RMS distance 2 % to {distance[1]:.2g} %")


@pytest.mark.parametrize(
    ("closed", "helped"), [([1, 0], True), ([1, 1], False), ([0, 2], False), ([None, None], False)]
)
def test_slots_that_opened_count_as_help(closed: list[Any], helped: bool) -> None:
    brought = {"remedy": "larger", "was": 1.0, "now": 1.25, "rms_percent": [1.2, 1.2], "strain_share_max": [0.9, 0.89]}
    brought["slots_closed"] = closed
    assert advice.has_helped(brought) == helped and ("did not help" in advice.describe_effect(brought)) != helped
    assert (f"closed slots {closed[0]} to {closed[1]}" in advice.describe_effect(brought)) == (closed[0] != closed[1])


# -- what they leave as it was -----------------------------------------------------------------------------------------


def stopping(after: int) -> Callable[[str, Any], Any]:
    """In place of ``background.run_blocking``: work that is stopped when it has told so often how far it is."""
    told: list[float] = []

    def run(title: str, work: Any) -> Any:
        return work(Progress(lambda fraction, text: told.append(fraction), lambda: len(told) > after))

    return run


@pytest.mark.parametrize("remedy", ["larger", "thinner", pytest.param("finer", marks=pytest.mark.thorough)])
def test_stopped_or_failed_everything_is_as_it_was(
    add: Any, remedy: str, all_of: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    obj = simulated(add, "pom" if remedy == "finer" else "custom", limit=0.0122)
    before = everything(obj, all_of)
    for after in (1, 25):
        with monkeypatch.context() as patch:
            patch.setattr(background, "run_blocking", stopping(after))
            assert getattr(bpy.ops.flexmaps, BUTTONS[remedy][0])() == {"CANCELLED"}
        assert everything(obj, all_of) == before and bpy.context.object == obj

    def refused(*_: Any, **__: Any) -> None:
        raise FlexMapsError("no shape")

    monkeypatch.setattr("flexmaps.bridge.view.live_shape.simulate_and_show", refused)
    with pytest.raises(RuntimeError, match="no shape"):
        press(BUTTONS[remedy][0])
    assert everything(obj, all_of) == before


@pytest.mark.thorough
def test_a_search_that_is_stopped_is_not_kept(add: Any, all_of: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """Optimise alone keeps its best so far; here that would be a piece that nobody asked for."""
    obj = simulated(add, "birch")
    obj.flexmaps.optimise.iterations = 1
    obj.flexmaps.optimise.codesign = obj.flexmaps.optimise.restart = False
    press("optimise")
    before = everything(obj, all_of)

    def run(title: str, work: Any) -> Any:
        seen: list[Any] = []
        return work(Progress(stopped=lambda: len(seen) > 0, shown=seen.append))

    monkeypatch.setattr(background, "run_blocking", run)
    assert bpy.ops.flexmaps.make_larger() == {"CANCELLED"}
    assert everything(obj, all_of) == before


def test_they_run_beside_the_window(strained: Any, all_of: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    played = SimpleNamespace(app=SimpleNamespace(background=False), ops=bpy.ops, types=bpy.types)
    monkeypatch.setattr(stage, "bpy", played)
    parts = (stage.StageOperator, ContinuedStage, operators.RemedyStage, operators.MakeThinner)
    hidden = {"__dict__", "__weakref__", "bl_rna", "__annotations__"}
    body = {key: value for part in parts for key, value in vars(part).items() if key not in hidden}
    kind, said = type("MakeThinner", (), body), list[tuple[str, str]]()
    before = everything(strained, all_of)
    for event, wanted in ((ESCAPE, "CANCELLED"), (MOUSE, "FINISHED")):
        operator, window = kind(), Window()
        operator.report = lambda level, text: said.append((*level, text))
        assert operator.invoke(window, None) == {"RUNNING_MODAL"}
        operator.modal(window, event)
        assert drive(operator, window) == {wanted} and clean(window) and background.current_job() is None
        assert (everything(strained, all_of) == before) == (wanted == "CANCELLED")
    assert said[0] == ("WARNING", "Thinner sheet was stopped; nothing was changed")
    assert "Sheet of 1.5 mm instead of 2 mm" in said[1][1]
    done(strained)


def test_a_size_that_something_else_sets_is_refused(strained: Any, all_of: Any) -> None:
    limit = strained.constraints.new("LIMIT_SCALE")
    limit.use_max_x = limit.use_max_y = limit.use_max_z = True
    limit.max_x = limit.max_y = limit.max_z = 1.0
    bpy.context.view_layer.update()
    before = everything(strained, all_of)
    with pytest.raises(RuntimeError, match="a constraint or a driver"):
        press("make_larger")
    assert everything(strained, all_of) == before


# -- when they are grey ------------------------------------------------------------------------------------------------


def test_a_grey_button_says_why(strained: Any, add: Any) -> None:
    distorted = simulated(add, "pom")
    larger, thinner, finer = (operators.MakeLarger, operators.MakeThinner, operators.MakeFiner)
    assert larger.obstacle(strained) is None and thinner.obstacle(strained) is None
    assert finer.obstacle(strained) == "This advice is out of date; see the present advice under Optimise"
    strained.lock_scale[1] = True
    assert "locked" in (larger.obstacle(strained) or "")
    assert finer.obstacle(distorted) is None and "out of date" in (larger.obstacle(distorted) or "")
    group(distorted, "feet", [0, 1])
    for name in ("supports", "pulled"):
        setattr(distorted.flexmaps.loads, name, "feet")
        assert "belong to the old quads" in (finer.obstacle(distorted) or "")
        setattr(distorted.flexmaps.loads, name, "")
    bpy.ops.object.mode_set(mode="EDIT")
    assert "Object Mode" in (finer.obstacle(distorted) or "")
    bpy.ops.object.mode_set(mode="OBJECT")
    press("spirals")
    assert "press Simulate first" in (finer.obstacle(distorted) or "")
    assert not bpy.ops.flexmaps.make_finer.poll()


def test_advice_that_is_out_of_date_is_not_followed(strained: Any, all_of: Any) -> None:
    strained.flexmaps.spiral.thickness = 1.9
    before = everything(strained, all_of)
    with pytest.raises(RuntimeError, match="out of date"):
        press("make_thinner")
    assert everything(strained, all_of) == before


def test_settings_that_change_meanwhile_make_it_out_of_date(strained: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    run = background.run_blocking

    def busy(title: str, work: Any) -> Any:
        strained.flexmaps.spiral.slot_min = 0.35  # by hand, while the work goes on
        return run(title, work)

    monkeypatch.setattr(background, "run_blocking", busy)
    press("make_thinner")
    assert states.read_states(strained, bpy.context.scene)["reach"].kind == states.STALE


def test_the_sidebar_offers_what_is_advised(strained: Any, add: Any) -> None:
    distorted = simulated(add, "pom")
    bpy.context.view_layer.objects.active = strained
    assert {"Cut there", "Larger: 1.1 x", "Sheet of 1.5 mm"} <= set(drawn().lines)
    assert "flexmaps.make_finer" not in drawn().operators
    bpy.context.view_layer.objects.active = distorted
    found = drawn()
    assert {"Cut there", f"Finer: {2 * QUADS} quads"} <= set(found.lines)
    assert "flexmaps.make_larger" not in found.operators


def test_notes_of_earlier_versions_offer_a_cut_alone(distorted: Any) -> None:
    block = {key: value for key, value in report(distorted)["reach"].items() if key != "remedies"}
    stored_report.write(distorted.data, "reach", block)
    assert advice.read_advice(distorted.data) == {"cut": None}
    stored_report.write(distorted.data, "reach", block | {"advice": "finer quads would help"})
    assert advice.read_advice(distorted.data) == {}
    assert "flexmaps.cut_there" not in drawn().operators
