"""Notices about the simulated shape, and the status that goes with them: buttons that helped nobody are gone."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
import pytest
from flexmaps.bridge.store import derived_properties, guidance, notices, shape_notices, stored_report
from flexmaps.bridge.store.finding_words import BREAKS, INFORMATION, WORSE
from flexmaps.bridge.store.notice import Notice
from flexmaps.engine.simulation.shortfall import FarBody
from flexmaps.engine.surface import shapes


@pytest.fixture
def piece(add: Any) -> Any:
    return add(shapes.make("dome"))


def finding(code: str, message: str = "It is so.") -> dict[str, Any]:
    return {"code": code, "severity": "warning", "message": message, "faces": [0], "edges": []}


def one_notice(piece: Any, code: str, block: dict[str, Any], **more: Any) -> Notice:
    blocks = {"equilibrium": {"rms_percent": 0.5, "converged": True} | block, **more}
    (found,) = (one for one in shape_notices.from_equilibrium(piece, blocks) if one.key == f"equilibrium/{code}")
    return found


@pytest.mark.parametrize(
    ("other", "within", "kind"),
    [
        ({"rms_percent": 0.8, "strain_share_max": 0.7}, 1.0, INFORMATION),
        ({"rms_percent": 0.8}, 1.0, INFORMATION),  # of the rod model, which knows no strains
        ({"rms_percent": 0.8, "strain_share_max": 1.1}, 1.0, WORSE),
        ({"rms_percent": 0.8, "strain_share_max": 0.7}, 0.5, WORSE),
        ({"rms_percent": 1.3, "strain_share_max": 0.7}, 1.0, WORSE),
        (None, 1.0, WORSE),  # of an earlier version
    ],
)
def test_another_rest_that_is_as_wanted_is_information(piece: Any, other: Any, within: float, kind: str) -> None:
    piece.flexmaps.choose.match = within
    block = {"findings": [finding("other-rest")]} | ({} if other is None else {"other_rest": other})
    found = one_notice(piece, "other-rest", block)
    assert found.severity == kind and bool(found.cures) == (kind == WORSE)
    assert ("0.8 %" in found.sentence) == (kind == INFORMATION)


@pytest.mark.parametrize("code", sorted(shape_notices.FIXED_BY_OPTIMISE))
@pytest.mark.parametrize(
    ("run", "offered"),
    [
        ({"iterations": 0, "rms_percent_before": 0.45, "rms_percent": 0.45, "finished": True}, False),
        ({"iterations": 4, "rms_percent_before": 0.45, "rms_percent": 0.45, "finished": True}, False),
        ({"iterations": 4, "rms_percent_before": 0.9, "rms_percent": 0.45, "finished": True}, True),
        ({"iterations": 0, "rms_percent_before": 0.45, "rms_percent": 0.45, "finished": False}, True),
        (None, True),
    ],
    ids=["no step", "no nearer", "nearer", "stopped", "never"],
)
def test_optimise_is_not_offered_again_where_it_just_gained_nothing(
    piece: Any, code: str, run: Any, offered: bool
) -> None:
    more = {} if run is None else {"optimise": run}
    found = one_notice(piece, code, {"findings": [finding(code)]}, **more)
    assert ("flexmaps.optimise" in {cure.idname for cure in found.cures}) == offered
    assert ("found nothing better" in found.sentence) != offered


def test_a_remedy_that_did_not_help_is_not_offered_again(piece: Any) -> None:
    reach: dict[str, Any] = {"advice": "", "remedies": {"larger": 1.25, "thinner": 1.0}}
    effect = {"remedy": "larger", "was": 0.2, "now": 0.25, "rms_percent": [0.5, 0.5], "strain_share_max": [1.2, 1.2]}

    def offered(**more: Any) -> set[str]:
        found = one_notice(piece, "strained", {"findings": [finding("strained")]}, reach=reach | more)
        return {cure.idname for cure in found.cures}

    assert offered() == {"flexmaps.make_larger", "flexmaps.make_thinner", "flexmaps.let_go"}
    assert offered(brought=effect) == {"flexmaps.make_thinner", "flexmaps.let_go"}
    assert offered(brought=effect | {"strain_share_max": [1.2, 1.0]}) == offered()


@pytest.mark.parametrize("supported", [False, True])
def test_text_of_a_flat_piece_names_only_buttons_that_are_there(piece: Any, supported: bool) -> None:
    quads = np.arange(len(piece.data.polygons))
    body = FarBody(quads, 0.03, True, False, supported, True, True, np.arange(8))
    row = finding("stays-flat", body.fault_text + body.remedy_text)
    if supported:
        derived_properties.set_supports(piece, [0])
    for prospects, cut in (({}, False), ({"cut": 1.0}, True)):
        reach = {"advice": "", "remedies": {"cut": None}, "prospects": prospects}
        found = one_notice(piece, "stays-flat", {"rms_percent": 3.0, "findings": [row]}, reach=reach)
        names = {cure.idname for cure in found.cures}
        assert found.severity == BREAKS and ("flexmaps.cut_there" in names) == ("(Cut there)" in found.sentence) == cut
        assert ("flexmaps.stand_on" in names) == ("with the button" in found.sentence) == (not cut and not supported)


def test_a_piece_that_has_to_be_held_says_so(piece: Any) -> None:
    def told() -> list[Notice]:
        blocks = {"equilibrium": {"rms_percent": 0.2, "converged": True}}
        return [one for one in shape_notices.from_equilibrium(piece, blocks) if one.key == "equilibrium/held"]

    assert not told()
    bpy.ops.flexmaps.stand_on(where="border")
    (found,) = told()
    assert found.severity == INFORMATION and piece.flexmaps.loads.supports in found.sentence
    piece.flexmaps.base.base = "frame"
    assert not told()


def test_the_status_promises_no_more_than_is_known(piece: Any) -> None:
    stored_report.write(piece.data, "equilibrium", {"rms_percent": 0.2, "converged": True, "strain_share_max": 0.8})
    held = Notice("equilibrium/held", "Needs to be held", "It is held", INFORMATION)
    seen = [guidance._status_of_simulated(piece, some) for some in ([], [held])]
    assert [one.icon for one in seen] == [guidance.TICK, guidance.TICK]
    assert "held" not in seen[0].text and "held" in seen[1].text
    assert not any("Ready to cut" in one.text for one in seen)


def test_a_further_cut_that_did_not_help_does_not_claim_that_it_did() -> None:
    layout = {"layout": {"halved": "The seam makes it rise"}}
    flat = {"equilibrium": {"findings": [finding("stays-flat")]}}
    texts = [
        notices._from_warnings("layout", layout | more, is_held=held)[0].sentence
        for more, held in (({}, False), (flat, False), ({}, True))
    ]
    assert texts[0] == "The seam makes it rise" and "stays flat" in texts[1] and "supports hold it" in texts[2]
