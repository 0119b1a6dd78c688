"""*Next* for a piece far from its target: other cuts, other layouts, and what only a person decides."""

from __future__ import annotations

from typing import Any

import pytest
from flexmaps.bridge.store import failures, next_button, notices, shape_notices
from flexmaps.bridge.store.finding_words import BREAKS, INFORMATION, WORSE
from flexmaps.engine.surface import shapes


@pytest.mark.parametrize(
    ("cut", "offered"),
    [(0.6, ["cut_there", "choose"]), (1.3, ["choose", "cut_there"]), (None, ["choose"])],
)
@pytest.mark.parametrize("code", [None, "far-from-target"])
def test_next_offers_other_cuts_where_an_optimised_piece_misses_its_match(
    add: Any, code: str | None, cut: float | None, offered: list[str]
) -> None:
    """The cut comes first where it is near enough; each is offered once, and layouts are proposed once."""
    piece = add(shapes.make("dome"))
    rows = [] if code is None else [{"code": code, "message": "", "faces": [], "edges": [], "severity": "warning"}]
    block = {"rms_percent": 2.0, "largest_percent": 3.0, "converged": True, "findings": rows}
    reach = {"advice": "", "remedies": {}, "prospects": {"lowest": 0.1} | ({} if cut is None else {"cut": cut})}
    blocks: dict[str, Any] = {"equilibrium": block, "reach": reach, "optimise": {}}

    def pressed(more: dict[str, Any]) -> list[str]:
        piece.data.pop("flexmaps_tried", None)
        names = []
        while (
            act := next_button._repair_action(piece.data, shape_notices.from_equilibrium(piece, blocks | more))
        ) is not None:
            assert act.cure is not None
            failures.count_press(piece.data, act.cure.call)
            names.append(act.idname.partition(".")[2])
        return names

    assert pressed({}) == offered
    assert pressed({"choose": {}}) == [name for name in offered if name != "choose"]
    assert pressed({"equilibrium": block | {"rms_percent": 0.9, "findings": []}}) == []
    (notice,) = (n for n in shape_notices.from_equilibrium(piece, blocks) if n.key in shape_notices.FAR_FROM_TARGET)
    failures.dismiss(piece.data, notice.key, notice.sentence)
    assert notices._downgrade_dismissed(piece.data, notice).severity == INFORMATION
    assert next_button._repair_action(piece.data, [notices._downgrade_dismissed(piece.data, notice)]) is None


@pytest.mark.parametrize("rounded, offered", [(0.9, []), (1.1, ["flexmaps.choose"])])
def test_next_leaves_layouts_out_where_rounded_folds_come_near_enough(
    add: Any, rounded: float, offered: list[str]
) -> None:
    piece = add(shapes.make("dome"))
    block = {"rms_percent": 2.0, "largest_percent": 3.0, "converged": True, "findings": []}
    reach = {"advice": "", "remedies": {}, "prospects": {"round": rounded, "lowest": 0.1}}
    seen_notices = shape_notices.from_equilibrium(piece, {"equilibrium": block, "reach": reach, "optimise": {}})
    (match,) = (notice for notice in seen_notices if notice.key in shape_notices.FAR_FROM_TARGET)
    assert {"flexmaps.choose", "flexmaps.mend"} <= {cure.idname for cure in match.cures}  # a person may press both
    act = next_button._repair_action(piece.data, seen_notices)
    assert ([] if act is None else [act.idname]) == offered


def test_another_size_is_tried_before_another_search(add: Any) -> None:
    """The piece is searched anew in its new size, and a search does not take back much strain."""
    piece = add(shapes.make("dome"))
    rows = [
        {"code": code, "severity": "warning", "message": code, "faces": [0], "edges": []}
        for code in ("knotted", "strained")
    ]
    block = {"rms_percent": 0.5, "strain_share_max": 4.0, "converged": True, "findings": rows}
    reach = {"advice": "", "remedies": {"larger": 2.0}}
    seen_notices = shape_notices.from_equilibrium(piece, {"equilibrium": block, "reach": reach, "optimise": {}})
    act = next_button._repair_action(piece.data, seen_notices)
    assert act is not None and act.idname == "flexmaps.make_larger"
    act = next_button._repair_action(piece.data, [n for n in seen_notices if n.key != "equilibrium/strained"])
    assert act is not None and act.idname == "flexmaps.optimise"


def test_a_cut_is_offered_only_where_short_searches_have_gained_by_it(add: Any) -> None:
    piece = add(shapes.make("dome"))
    reach = {"advice": "", "remedies": {"cut": None}}
    flat = {"code": "stays-flat", "severity": "warning", "message": "It stays flat", "faces": [0], "edges": []}
    block = {"rms_percent": 5.0, "converged": True, "findings": [flat]}

    def offered(**more: Any) -> set[str]:
        (notice,) = (
            n for n in shape_notices.from_equilibrium(piece, {"equilibrium": block, "reach": reach | more}) if n.cures
        )
        assert notice.severity == BREAKS
        return {cure.idname for cure in notice.cures}

    assert "flexmaps.cut_there" in offered()  # nobody has searched
    assert "flexmaps.cut_there" in offered(prospects={"cut": 1.0})
    assert "flexmaps.cut_there" not in offered(prospects={}) and "flexmaps.stand_on" in offered(prospects={})
    (notice,) = (
        n
        for n in shape_notices.from_equilibrium(piece, {"equilibrium": block | {"rms_percent": 1.5}})
        if n.key == "equilibrium/stays-flat"
    )
    assert notice.severity == WORSE  # a small body of a piece that is near as a whole


@pytest.mark.parametrize(
    ("percent", "bodies", "kind"), [(1.5, 1, BREAKS), (0.5, 1, WORSE), (1.5, 2, WORSE), (2.5, 2, BREAKS)]
)
def test_a_piece_of_one_body_that_stays_flat_is_held(add: Any, percent: float, bodies: int, kind: str) -> None:
    """Nothing but supports makes it rise; of several bodies a small one may be flat while the piece is near."""
    piece = add(shapes.make("dome"))
    flat = {"code": "stays-flat", "severity": "warning", "message": "It stays flat", "faces": [0], "edges": []}
    block = {"rms_percent": percent, "converged": True, "findings": [flat]}
    checks = [{"code": "several-bodies"}] if bodies > 1 else []
    found = {n.key: n for n in shape_notices.from_equilibrium(piece, {"equilibrium": block, "checks": checks})}
    assert found["equilibrium/stays-flat"].severity == kind
    assert ("equilibrium/match" in found) == (percent == 1.5 and bodies == 2)
    act = next_button._repair_action(piece.data, list(found.values()))
    assert (act is not None and act.idname == "flexmaps.stand_on") == (kind == BREAKS)


def test_a_small_body_that_stays_flat_does_not_hide_how_far_the_piece_is(add: Any) -> None:
    piece = add(shapes.make("dome"))
    flat = {"code": "stays-flat", "severity": "warning", "message": "It stays flat", "faces": [0], "edges": []}
    reach = {"advice": "", "remedies": {}, "prospects": {"lowest": 0.4}}
    for percent, told in ((1.5, True), (5.0, False), (0.5, False)):
        block = {"rms_percent": percent, "converged": True, "findings": [flat]}
        found = {n.key: n for n in shape_notices.from_equilibrium(piece, {"equilibrium": block, "reach": reach})}
        assert ("equilibrium/match" in found) == told
        if told:
            assert found["equilibrium/match"].cures[0].idname == "flexmaps.stand_on"
