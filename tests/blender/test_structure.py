"""Load cases of an object: groups of vertices, the button, its figures and colours, and the command line."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from flexmaps import api
from flexmaps.bridge.store import states, stored_report
from flexmaps.bridge.view import colouring
from flexmaps.command import main as command
from support.arch import EDGE, LENGTH, ends, group, spiralled
from support.buttons import press


@pytest.fixture
def piece(add: Any) -> Any:
    """An arch on its ends, simulated, with a group across its middle."""
    obj = spiralled(add)
    group(obj, "Feet", ends(obj))
    place = np.array([v.co[:] for v in obj.data.vertices])
    group(obj, "Top row", np.flatnonzero(place[:, 2] > place[:, 2].max() - 1e-3))
    obj.flexmaps.loads.supports = "Feet"
    press("simulate")
    return obj


def figures(obj: Any) -> dict[str, dict[str, Any]]:
    return {one["name"]: one for one in stored_report.read(obj.data)["structure"]["outcomes"]}


def test_cases_act_on_vertex_groups(piece: Any, attribute: Any) -> None:
    piece.flexmaps.structure.cases = "top: point 0.5 -z on Top row; w: weight"
    piece.flexmaps.structure.combinations = "both = 1.5 top + 1.35 w"
    shape = np.array([k.co[:] for k in piece.data.shape_keys.key_blocks[1].data])
    press("structure")
    found = figures(piece)
    assert set(found) == {"top", "w", "both"} and all(one["reached"] for one in found.values())
    assert (
        found["both"]["deflection_max_mm"] > found["top"]["deflection_max_mm"] > 10.0 * found["w"]["deflection_max_mm"]
    )
    # the quads beside the group are those that move most
    assert found["top"]["deflection_quad"] // 3 in (LENGTH // 2 - 1, LENGTH // 2)
    # the simulated shape stays
    assert np.array([k.co[:] for k in piece.data.shape_keys.key_blocks[1].data]) == pytest.approx(shape, abs=0)
    used = attribute(piece, "flexmaps_utilisation")
    assert used.max() == pytest.approx(max(one["arms"] for one in found.values()), rel=1e-4)
    assert bpy.ops.flexmaps.overlay(kind="UTILISATION") == {"FINISHED"}
    assert colouring.legend_of(piece, "UTILISATION").title.startswith("Under loads, largest")
    now = states.read_states(piece, bpy.context.scene)
    assert now["structure"].kind == states.DONE and now["equilibrium"].kind == states.DONE
    piece.flexmaps.structure.cases = "w: weight"
    now = states.read_states(piece, bpy.context.scene)
    assert now["structure"].kind == states.STALE and now["equilibrium"].kind == states.DONE
    assert not colouring.is_current(piece, "UTILISATION")


def test_loads_are_added_and_taken_out_by_buttons(piece: Any) -> None:
    wanted = piece.flexmaps.structure
    given = {"name": "lamp", "kind": "point", "value": 0.5, "axis": "-z", "group": "Top row", "factor": 1.2}
    assert bpy.ops.flexmaps.add_load(**given, lasting=True) == {"FINISHED"}
    assert bpy.ops.flexmaps.add_load(name="press", kind="pressure", value=20.0) == {"FINISHED"}
    assert wanted.cases == "weight: weight; lamp: point 0.5 -z on Top row times 1.2 lasting; press: pressure 20"
    assert bpy.ops.flexmaps.remove_load(number=0) == {"FINISHED"}
    press("structure")
    assert set(figures(piece)) == {"lamp", "press"}  # nobody knows what a year leaves of this material
    with pytest.raises(RuntimeError, match="give it as NAME: KIND"):
        bpy.ops.flexmaps.add_load(name="two words", kind="weight")
    with pytest.raises(RuntimeError, match="rename the group"):
        bpy.ops.flexmaps.add_load(name="a", kind="weight", group="it times 2")


def test_a_new_simulation_takes_what_was_said_of_loads(piece: Any) -> None:
    press("structure")
    assert "structure" in stored_report.read(piece.data)
    press("simulate")
    assert "structure" not in stored_report.read(piece.data) and "flexmaps_utilisation" not in piece.data.attributes


def test_a_load_that_snaps_it_is_a_warning(piece: Any, attribute: Any) -> None:
    piece.flexmaps.structure.cases = "top: point 100 -z on Top row"
    press("structure")
    block = stored_report.read(piece.data)["structure"]
    assert not block["outcomes"][0]["reached"]
    assert [one["code"] for one in block["findings"]] == ["snaps"]


@pytest.mark.parametrize(
    ("cases", "combinations", "says"),
    [
        ("top: point 1 -z on Nothing", "", "'Nothing' names no quad"),
        ("top: points", "", "'points' is not a kind of load"),
        ("w: weight", "a = 2 snow", "adds 'snow', which is not a load case"),
    ],
)
def test_loads_that_mean_nothing_are_refused(piece: Any, cases: str, combinations: str, says: str) -> None:
    piece.flexmaps.structure.cases, piece.flexmaps.structure.combinations = cases, combinations
    with pytest.raises(RuntimeError, match=says):
        bpy.ops.flexmaps.structure()
    assert "structure" not in stored_report.read(piece.data)


def test_an_old_shape_is_simulated_first(piece: Any) -> None:
    piece.flexmaps.spiral.thickness = 3.0
    with pytest.raises(RuntimeError, match="press Simulate first"):
        bpy.ops.flexmaps.structure()


def test_scripts_name_groups_too(piece: Any) -> None:
    made = api.structure(api.load(piece), "top: point 0.5 -z on Top row")
    assert made.result.structure is not None
    (one,) = api.report(made)["structure"]["outcomes"]
    piece.flexmaps.structure.cases = "top: point 0.5 -z on Top row"
    press("structure")
    assert figures(piece)["top"]["deflection_max_mm"] == pytest.approx(one["deflection_max_mm"], rel=1e-3)


def test_the_report_of_an_object_shows_what_it_bears(piece: Any, tmp_path: Path) -> None:
    press("structure")
    block = stored_report.read(piece.data)["structure"]
    assert api.report(piece, tmp_path)["structure"] == block
    assert (tmp_path / "plots/loads.svg").is_file() and (tmp_path / "plots/utilisation.svg").is_file()
    made = api.structure(api.load(piece))
    shown = api.show(api.load(made.mesh), None)
    assert "flexmaps_utilisation" not in shown.data.attributes
    shown = api.show(made, piece)
    assert "flexmaps_utilisation" in shown.data.attributes and "structure" in stored_report.read(shown.data)


def test_the_command_line_tells_and_writes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    given = ["structure", "shape:vault", "--edge", str(1e3 * EDGE), "--supports", "lowest"]
    loads = ["--case", "snow: snow 100", "--case", "w: weight", "--combine", "all = 1.5 snow + 1.35 w"]
    assert command.main([*given, *loads, "--out", str(tmp_path)]) == 0
    assert "load 'all':" in capsys.readouterr().out
    block = json.loads((tmp_path / "report.json").read_text())["structure"]
    assert [one["name"] for one in block["outcomes"]][:3] == ["snow", "w", "all"]
    assert "What it bears" in (tmp_path / "report.html").read_text() and (tmp_path / "plots/loads.svg").is_file()
    assert command.main([*given[:4], "--case", "w: weight"]) == 2
    assert "nothing holds" in capsys.readouterr().err
