"""*Next* for a piece whose arms are likely to break: a larger size before any search."""

from __future__ import annotations

from typing import Any

import bpy
import pytest
from flexmaps import api
from flexmaps.bridge.store import failures, guidance, next_button, notices, states, stored_report
from flexmaps.bridge.store.finding_words import BREAKS
from flexmaps.engine.surface import shapes


def seen(obj: Any) -> guidance.Guidance:
    bpy.context.view_layer.update()
    return guidance.read_guidance(obj, bpy.context.scene)


def _small(add: Any) -> Any:
    """Return a dome of quads of 6 mm."""
    dome = shapes.dome(4)
    return add(dome.with_vertices(dome.vertices * (0.006 / dome.median_edge)))


def test_a_piece_whose_arms_would_break_is_made_larger_before_any_search(add: Any, predicted_match: None) -> None:
    """Then it is laid out again; where the scale is locked, *Next* goes on."""
    piece = _small(add)
    assert bpy.ops.flexmaps.merge() == {"FINISHED"}
    found = seen(piece)
    (notice,) = [one for one in found.notices if one.key == notices.TOO_SMALL]
    assert notice.severity == BREAKS and found.action is not None and found.action.idname == "flexmaps.set_size"
    piece.lock_scale[0] = True
    assert _next(piece) == "flexmaps.fit"
    piece.lock_scale[0] = False
    before = tuple(piece.scale)
    assert bpy.ops.flexmaps.next() == {"FINISHED"}
    assert tuple(piece.scale) == pytest.approx([one * found.action.properties["times"] for one in before])
    assert _next(piece) == "flexmaps.merge"


def test_a_script_keeps_the_size_by_name(add: Any) -> None:
    piece = _small(add)
    assert bpy.ops.flexmaps.flatten() == {"FINISHED"}
    stored_report.write(piece.data, "layout", stored_report.read(piece.data)["layout"] | {"strain_softest": 3.0})
    assert _next(piece) == "flexmaps.set_size"
    (told,) = api.presses(piece, named=("let_go",), most=1)
    assert "let_go" in told["call"] and not told["error"]
    assert _next(piece) == "flexmaps.fit"


def _next(piece: Any) -> str:
    act = seen(piece).action
    return "" if act is None else act.idname


def test_who_wants_a_small_piece_goes_on(add: Any) -> None:
    piece = add(shapes.make("dome"))
    scene, blocks = bpy.context.scene, {"layout": {"strain_softest": 1e3}}
    assert not notices._too_small(piece, scene, blocks)  # of unknown settings
    states.stamp_side_result(piece, scene, "forecast")
    (notice,) = notices._too_small(piece, scene, blocks)
    assert notice.severity == BREAKS
    for _ in range(next_button.MAX_ENLARGEMENTS):  # each factor is limited, so one may not be enough
        act = next_button._enlarge_action(piece.data, [notice])
        assert act is not None and act.cure is not None
        failures.count_press(piece.data, act.cure.call)
    assert next_button._enlarge_action(piece.data, [notice]) is None
    piece.data.pop("flexmaps_tried")
    failures.dismiss(piece.data, notice.key, notice.sentence)
    assert next_button._enlarge_action(piece.data, [notices._downgrade_dismissed(piece.data, notice)]) is None


@pytest.mark.parametrize(
    "setting, value", [("spiral.thickness", 1.0), ("material.material", "birch"), ("simulate.model", "rod")]
)
def test_a_forecast_of_strains_is_forgotten_once_its_input_has_changed(add: Any, setting: str, value: Any) -> None:
    piece = add(shapes.make("dome"))
    scene, blocks = bpy.context.scene, {"layout": {"strain_softest": 3.0}}
    states.stamp_side_result(piece, scene, "forecast")
    assert notices._too_small(piece, scene, blocks)
    section, name = setting.split(".")
    setattr(getattr(piece.flexmaps, section), name, value)
    assert not notices._too_small(piece, scene, blocks)


def test_a_shape_answers_the_forecast_of_its_strains_even_if_it_is_out_of_date(add: Any) -> None:
    piece = add(shapes.make("dome"))
    scene, blocks = bpy.context.scene, {"layout": {"strain_softest": 3.0}}
    states.stamp_side_result(piece, scene, "forecast")
    stored_report.write(piece.data, "equilibrium", {"strain_share_max": 0.9})
    assert not notices._too_small(piece, scene, blocks)
