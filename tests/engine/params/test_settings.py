"""Settings: whatever is no value of theirs is refused by name, with what they take."""

from __future__ import annotations

import math
from dataclasses import fields
from functools import partial

import pytest
from flexmaps.engine.errors import FlexMapsError
from flexmaps.engine.params import (
    ORDERED_ACROSS_SECTIONS,
    ObjectSettings,
    OptimiseParams,
    RegulariseParams,
    Settings,
    SheetParams,
    SpiralParams,
    refuse_crossed,
    values_in_shown_units,
    with_values,
)
from flexmaps.engine.runs import job
from flexmaps.engine.surface import shapes
from flexmaps.engine.surface.mesh import PolygonMesh

FIELDS = [(block, f) for block in fields(ObjectSettings) for f in fields(block.default_factory)]
NAMES = [f"{block.name}.{f.name}" for block, f in FIELDS]
NO_NUMBERS = [math.nan, math.inf, -math.inf, 10**400, 10**5000, "2", None, [], True, 1j, object()]
NO_TEXT_OF_A_NUMBER = [
    "nan",
    "inf",
    "-1e999",
    "",
    " ",
    "two",
    "1_0",
    "\uff11\uff10",
    "\u0661",
    "1,5",
    "0x10",
    "1" * 5000,
    b"2",
]


def _refused(make, label):
    with pytest.raises(FlexMapsError) as caught:
        make()
    assert label in str(caught.value)
    assert "\n" not in str(caught.value)
    return str(caught.value)


@pytest.mark.parametrize(("block", "f"), FIELDS, ids=NAMES)
def test_values_of_another_kind(block, f):
    kind, default, label = block.default_factory, f.default, f.metadata["label"]
    if isinstance(default, bool):
        wrong, wrong_text = ["on", 1, 0.0, None, [], math.nan], ["", "maybe", None, 0.5, [], 7]
    elif isinstance(default, str):
        wrong, wrong_text = [1, None, [], True, b"a"], [1, None, [], True, b"a"]
        if f.metadata["choices"]:
            wrong, wrong_text = [*wrong, "", "no such choice"], [*wrong_text, "", "no such choice"]
    else:
        wrong, wrong_text = NO_NUMBERS, [*(v for v in NO_NUMBERS if v != "2"), *NO_TEXT_OF_A_NUMBER]
        if isinstance(default, int):
            wrong, wrong_text = [*wrong, 1.5, 2.0], [*wrong_text, "1.5", 1.5]
    for value in wrong:
        _refused(partial(kind, **{f.name: value}), label)
    for value in wrong_text:
        _refused(partial(with_values, ObjectSettings(), {f"{block.name}.{f.name}": value}), label)


@pytest.mark.parametrize(("block", "f"), FIELDS, ids=NAMES)
def test_values_out_of_bounds(block, f):
    for bound, factor in ((f.metadata["low"], -1), (f.metadata["high"], 1)):
        if bound is not None:
            beyond = bound + factor * max(abs(bound), 1)
            text = _refused(partial(block.default_factory, **{f.name: type(f.default)(beyond)}), f.metadata["label"])
            assert "smallest value" in text or "largest value" in text


def test_what_is_shown_can_be_given_back():
    shown = values_in_shown_units(ObjectSettings())
    flat = {f"{section}.{name}": value for section, block in shown.items() for name, value in block.items()}
    assert values_in_shown_units(with_values(ObjectSettings(), flat)) == shown
    assert (
        values_in_shown_units(with_values(ObjectSettings(), {name: str(value) for name, value in flat.items()}))
        == shown
    )


def test_settings_that_bound_each_other():
    text = _refused(
        lambda: with_values(ObjectSettings(), {"spiral.twist_min": 300, "spiral.twist_max": 60}), "Smallest twist"
    )
    assert "Largest twist 60" in text
    assert "settings of spiral" in text
    _refused(lambda: SpiralParams(width_min=0.003, width_max=0.002), "Largest width 2 mm")
    assert SpiralParams(width_min=0.002, width_max=0.002 * (1 - 1e-8)).width_min == 0.002  # single precision
    _refused(lambda: SheetParams(sheet_width=0.01), "nothing but margin")
    # both change at once: the order does not matter
    assert with_values(ObjectSettings(), {"spiral.width_min": 5, "spiral.width_max": 6}).spiral.width_max == 0.006


@pytest.mark.parametrize(
    ("low", "high", "remedy"),
    ORDERED_ACROSS_SECTIONS,
    ids=[f"{low} {high}" for low, high, _ in ORDERED_ACROSS_SECTIONS],
)
def test_settings_of_two_sections_that_bound_each_other(low, high, remedy):
    least = values_in_shown_units(ObjectSettings())[high.split(".")[0]][high.split(".")[1]]
    wide = {"spiral.slot_min": 10} if high != "spiral.slot_min" else {}  # or that bound would be met first
    there = {
        name: with_values(ObjectSettings(), wide | {low: least * factor})
        for name, factor in (("same", 1), ("above", 1.5))
    }
    blocks = {name: {f.name: getattr(s, f.name) for f in fields(s)} for name, s in there.items()}
    sections = {low.split(".")[0], high.split(".")[0]}
    refuse_crossed(blocks["same"], sections)
    refuse_crossed(blocks["above"], {"layout"})  # what has nothing to do with either goes on
    for section in sections:
        text = _refused(partial(refuse_crossed, blocks["above"], {section}), remedy)
        label = {name: f.metadata["label"] for name, (_, f) in zip(NAMES, FIELDS)}
        assert text.startswith(label[low])
        assert label[high] in text


def test_a_stage_that_makes_something_refuses_settings_that_cross_before_it_begins():
    crossed = with_values(ObjectSettings(), {"cut.kerf_holes": 0.5})
    flat = job.run(
        PolygonMesh.from_quads(shapes.make("strip")), crossed, stop_after="split"
    )  # has nothing to do with the cutter
    with pytest.raises(FlexMapsError, match=r"Kerf, holes 0\.5 mm is above Smallest slot 0\.3 mm"):
        job.run_stages(flat, crossed, ["spirals"])


def test_what_the_message_says_of_bounds():
    text = _refused(lambda: with_values(ObjectSettings(), {"sheet.seed": math.inf}), "Seed")
    assert "a whole number from 0 to 2147483647" in text
    assert "from 0.1 mm to 50 mm" in _refused(lambda: SpiralParams(thickness="2"), "Thickness")  # type: ignore[arg-type]
    assert "a whole number" in _refused(lambda: RegulariseParams(iterations=2.5), "Iterations")  # type: ignore[arg-type]


def test_a_setting_of_an_earlier_version_that_chose_the_optimiser_is_ignored() -> None:
    assert with_values(Settings(), {"optimise.method": "lbfgs", "optimise.iterations": 7}) == Settings(
        optimise=OptimiseParams(iterations=7)
    )


@pytest.mark.parametrize(("setting", "message"), [("rim_width", "too narrow"), ("rim_spacing", "cannot be")])
@pytest.mark.parametrize("hole", [0.002, 0.003])
def test_a_rim_holds_holes_of_at_most_half_its_width_and_spacing(setting: str, message: str, hole: float) -> None:
    wide = {"border": "rim", "rim_hole": hole, "rim_width": 0.02, "rim_spacing": 0.02}
    assert SpiralParams(**{**wide, setting: 2.0 * hole}).rim_hole == hole
    with pytest.raises(FlexMapsError, match=message):
        SpiralParams(**{**wide, setting: 1.9 * hole})
    assert SpiralParams(**{**wide, setting: 1.9 * hole, "border": "stubs"}).border == "stubs"
