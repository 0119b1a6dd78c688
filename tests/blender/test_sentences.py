"""What to look at where a block of the results warns in plain sentences."""

from __future__ import annotations

from typing import Any

import bpy
import pytest
from flexmaps.bridge.store import cures, equilibrium, finding_words, guidance, notices, shape_notices, stored_report
from flexmaps.bridge.store.notice import Notice
from flexmaps.engine.patches.flattening import flattening_report
from flexmaps.engine.surface import shapes


def test_sentences_of_one_kind_are_one_row() -> None:
    (one,) = notices._from_warnings("layout", {"layout": {"remarks": ["Panel 1 keeps a neck"]}})
    (more,) = notices._from_warnings(
        "layout", {"layout": {"remarks": ["Panel 1 keeps a neck", "Panel 2 keeps a neck"]}}
    )
    assert one.label != more.label and "2" in more.label and more.sentence.splitlines()[1] == "Panel 2 keeps a neck"
    assert not notices._from_warnings("sheets", {"sheets": {"warnings": []}})
    (plain,) = notices._from_warnings(
        "layout", {"layout": {"halved": "Its seam drives it", "remarks": ["Its seam drives it"]}}
    )
    assert plain.severity == finding_words.INFORMATION and plain.sentence == "Its seam drives it"


def test_what_is_hard_to_join_or_at_a_limit_has_a_cure() -> None:
    """Beside going on: other layouts where none were compared, and what is advised where joints carry too much."""
    limits = {"layout": {"remarks": ["Panel 1 keeps a neck"]}}
    hard = {
        "assembly": {"warnings": ["Hard to assemble"]},
        "reach": {"advice": "", "remedies": {"larger": 1.25, "cut": None}},
    }
    names = [
        [cure.idname for cure in one.cures]
        for source, blocks in (("layout", limits), ("layout", limits | {"choose": {}}), ("assembly", hard))
        for one in notices._from_warnings(source, blocks)
    ]
    assert names == [
        ["flexmaps.choose", "flexmaps.let_go"],
        ["flexmaps.let_go"],
        ["flexmaps.make_larger", "flexmaps.let_go"],
    ]


def test_overloaded_connectors_are_counted_by_seams_and_hold_in_a_larger_piece() -> None:
    """Also where the arms bear and nothing is advised: a connector's neck is narrower than its arm."""
    block = {"hard": 4, "warnings": ["1 of 9 seams: its sides differ", "4 of 9 seams: a connector"], "load_max": 1.4}
    (found,) = notices._from_warnings("assembly", {"assembly": block, "reach": {"advice": "", "remedies": {}}})
    assert found.label.endswith(": 4")
    larger = found.cures[0]
    assert larger.idname == "flexmaps.set_size" and larger.properties == {"times": 1.4}
    (found,) = notices._from_warnings("assembly", {"assembly": block | {"load_max": 0.9, "hard": 1}})
    assert found.label == "Hard to assemble" and [cure.idname for cure in found.cures] == ["flexmaps.let_go"]


def test_closed_slots_have_no_cure_that_does_not_open_them(add: Any) -> None:
    """A larger piece bends alike: its slots close too. The sentence names the brush that opens them."""
    piece = add(shapes.make("dome"))
    row = {"code": "slots-close", "message": "2 slots close", "faces": [1, 2]}
    blocks = {
        "equilibrium": {"findings": [row], "rms_percent": 0.1, "converged": True},
        "reach": {"advice": "", "remedies": {"larger": 1.25}},
        "optimise": {},
    }
    (found,) = [one for one in shape_notices.from_equilibrium(piece, blocks) if one.key == "equilibrium/slots-close"]
    assert [cure.idname for cure in found.cures] == ["flexmaps.let_go"]


def test_information_hinders_nothing_that_could_be_dismissed(add: Any) -> None:
    rows = [
        {"code": code, "severity": "warning", "message": "", "faces": []}
        for code in ("several-bodies", "bodies-cross", "concave")
    ]
    found = notices._from_checks(add(shapes.make("dome")), bpy.context.scene, rows)
    dismissed = [one.key for one in found if "flexmaps.let_go" in {cure.idname for cure in one.cures}]
    assert dismissed == ["checks/concave"]


def test_several_bodies_that_are_far_are_one_row() -> None:
    rows = [
        {"code": "far-from-target", "message": "One is far.", "faces": [1, 2]},
        {"code": "slots-close", "message": "A slot.", "faces": [3]},
        {"code": "far-from-target", "message": "Another is far.", "faces": [2, 9]},
    ]
    far, closed = equilibrium.merge_by_code(rows)
    assert far["faces"] == [1, 2, 9] and far["message"].splitlines() == ["One is far.", "Another is far."]
    assert closed is rows[1]


def test_what_a_mesh_or_layout_foretells_is_answered_by_a_near_shape(add: Any) -> None:
    """A warning before anything is simulated, information once the shape is near and nothing breaks, a warning else."""
    piece = add(shapes.make("dome"))
    small = Notice(
        "checks/small-quads", "Small quads: 2", "2 are small", finding_words.WORSE, cures=(cures.enlarge(1.4),)
    )
    crossing = Notice("checks/cuts-itself", "Cuts itself", "It cuts itself", finding_words.WORSE)
    breaking = Notice("equilibrium/strained", "2 too strained", "Too strained", finding_words.BREAKS)

    def kinds(block: dict[str, Any], *more: Notice) -> list[str]:
        return [
            one.severity
            for one in notices._downgrade_predictions(piece, {"equilibrium": block}, [small, crossing, *more])
        ]

    before = [finding_words.WORSE, finding_words.WORSE]
    assert kinds({}) == before and kinds({"rms_percent": 1.2}) == before
    assert kinds({"rms_percent": 0.7}, breaking)[:2] == before
    assert kinds({"rms_percent": 0.7}) == [finding_words.INFORMATION, finding_words.WORSE]
    assert notices._downgrade_predictions(piece, {"equilibrium": {"rms_percent": 0.7}}, [small])[0].cures == small.cures


@pytest.mark.parametrize("share, said", [(0.914, "over 91 %"), (0.916, "92 %, 91 %"), (1.0513, "105 %, 91 %")])
def test_the_status_says_the_strain_that_the_row_says(add: Any, share: float, said: str) -> None:
    """And what is allowed, which is another figure."""
    piece = add(shapes.make("dome"))
    block = {"strain_share_max": share, "findings": []}
    stored_report.write(piece.data, "equilibrium", block)
    row = equilibrium.describe_finding({"code": "strained", "faces": [0, 1], "message": ""}, block)
    strained = Notice("equilibrium/strained", "2 too strained", row, finding_words.BREAKS)
    status = guidance._status_of_simulated(piece, [strained])
    assert said in status.text and f"{100 * share:.0f} %" in row


def test_one_face_and_one_spiral_stand_in_the_singular() -> None:
    for code in cures.REPAIRS:
        one, two = cures.repair(code, 1), cures.repair(code, 2)
        assert one is not None and two is not None and "1 faces" not in one.label and "2 face " not in f"{two.label} "
    for lasts in ("days", "years"):
        block = {"lasts": lasts, "strain_share_max": 1.2}
        first, second = (
            equilibrium.describe_finding({"code": "strained", "faces": [*range(n)]}, block) for n in (1, 2)
        )
        assert "1 spiral " in first and "2 spirals " in second


def test_panels_at_a_limit_are_counted_though_only_some_are_described() -> None:
    forced = [f"Panel {number} has only 1 quad" for number in range(1, 41)]
    block = {"forced": forced, **flattening_report.remarks({"forced": forced})}
    (one,) = notices._from_warnings("layout", {"layout": block})
    assert one.label == "Panels at a limit: 40" and "37 more panels" in one.sentence
