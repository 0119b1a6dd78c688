"""What is stored in a .blend file is input: whatever stands there, it is taken or left out with a sentence, and made again."""

from __future__ import annotations

import json
from types import ModuleType
from typing import Any

import bpy
import numpy as np
import pytest
from flexmaps import api
from flexmaps.bridge.store import attributes, pose, states, stored_report
from flexmaps.bridge.view import collection
from flexmaps.engine.optimisation import match_limits

NOTES = {
    "broken": '{"layout": {"patches": ',
    "deeply nested": "[" * 100_000,
    "a number": 5,
    "a text": '"layout"',
    "a list": "[1, 2]",
    "bytes": b"\xff\xfe",
    "a dictionary of Blender's": {"layout": {"patches": 1}},
    "blocks of another kind": '{"layout": 5, "spirals": [], "equilibrium": {}, "optimise": null, "sheets": {"warnings": 3}}',
    "no number": '{"equilibrium": {"converged": true, "rms_mm": NaN, "status": 3}}',
    "an unknown stage": '{"painting": {}}',
    "half a character": '{"layout": "\ud7ff"}',
}


def _warnings(obj: Any) -> list[str]:
    return [f.message for f in api.check(api.load(obj)) if f.code == "left-out"]


@pytest.mark.parametrize("name", [stored_report.NAME, stored_report.INPUT_CHECKSUMS])
def test_damaged_notes_count_as_nothing(random_calls: ModuleType, spiralled: Any, name: str) -> None:
    assert not _warnings(spiralled)
    for damage in NOTES.values():
        spiralled.data[name] = damage
        assert stored_report.read(spiralled.data) == {}
        assert {state.kind for state in states.read_states(spiralled, bpy.context.scene).values()} == {states.TODO}
        assert _warnings(spiralled) == [
            "The notes of earlier stages are damaged and are left out: run the stages again"
        ]
        assert not random_calls.undrawn()
    assert api.report(spiralled)["layout"]["patches"] > 1  # the patches themselves are sound
    assert bpy.ops.flexmaps.flatten() == {"FINISHED"}
    assert not _warnings(spiralled)
    assert states.read_states(spiralled, bpy.context.scene)["layout"].kind == states.DONE
    assert json.loads(spiralled.data[stored_report.NAME])["layout"]


def test_notes_that_were_changed_by_hand_are_not_believed(spiralled: Any) -> None:
    found = json.loads(spiralled.data[stored_report.NAME])
    found["layout"]["patches"] = "many"
    spiralled.data[stored_report.NAME] = json.dumps(found)
    assert stored_report.read(spiralled.data) == {}
    del spiralled.data[stored_report.NAME + stored_report.CHECKSUM_SUFFIX]
    assert stored_report.read(spiralled.data) == {}


def _values(attribute: Any) -> tuple[str, np.ndarray]:
    prop, width, dtype, _ = attributes.KINDS[attribute.data_type]
    values = np.empty(len(attribute.data) * width, dtype)
    attribute.data.foreach_get(prop, values)
    return prop, values


def test_values_that_are_never_written_are_left_out(simulated: Any) -> None:
    for name, value in [
        ("flat", np.nan), ("flat", np.inf), ("patch", -1), ("patch", 2**31 - 1), ("energy", np.nan), ("energy", -1.0),
        ("square", np.inf), ("width", np.nan), ("width", -2.0), ("width", 0.0), ("twist", np.inf), ("twist", 1e30), ("twist", -300.0),
        ("distance", np.nan), ("strain", -np.inf), ("reach", -1), ("reach", 99), ("hub", np.nan),
    ]:  # fmt: skip
        key = attributes.PREFIX + name
        attribute = simulated.data.attributes[key]
        prop, values = _values(attribute)
        damaged = values.copy()
        damaged[len(values) // 2] = value
        attribute.data.foreach_set(prop, damaged)
        assert attributes.read(simulated.data, key) is None
        (told,) = _warnings(simulated)
        assert (
            told
            == f"The attribute '{key}' holds other values than FlexMaps writes and is left out: run its stage again"
        )
        piece = api.load(simulated)
        assert set(piece.result.lost) == ({"design"} if name in {"width", "twist"} else set())
        assert (piece.result.flat is None) == (name in {"flat", "patch", "energy", "square"})
        assert (piece.result.design is None) == (name in {"flat", "patch", "energy", "square", "width", "twist"})
        if piece.result.flat is not None:
            api.report(simulated)
        attribute.data.foreach_set(prop, values)
    assert not _warnings(simulated)


def test_attributes_of_another_kind_or_place(simulated: Any) -> None:
    for name in ("cut", "patch", "width", "reach", "colour"):
        key = attributes.PREFIX + name
        for kind, domain in (("FLOAT", "POINT"), ("INT", "EDGE"), ("STRING", "FACE"), ("FLOAT_COLOR", "CORNER")):
            if name == "colour" and kind == "FLOAT_COLOR":
                continue
            if key in simulated.data.attributes:
                simulated.data.attributes.remove(simulated.data.attributes[key])
            simulated.data.attributes.new(key, kind, domain)
            assert attributes.read(simulated.data, key) is None
            assert api.load(simulated).result.lost == {}
    assert api.spirals(api.load(simulated)).result.design is not None


def test_a_flat_map_without_size(simulated: Any) -> None:
    """Nothing can be measured on it."""
    attribute = simulated.data.attributes["flexmaps_flat"]
    prop, values = _values(attribute)
    attribute.data.foreach_set(prop, np.zeros_like(values))
    assert "press Flatten" in str(api.load(simulated).result.lost["flat"])
    attribute.data.foreach_set(prop, np.full_like(values, 1e30))
    assert "press Flatten" in str(api.load(simulated).result.lost["flat"])


def test_every_attribute_of_ours_is_known(simulated: Any) -> None:
    """What the stages write is what the door lets through."""
    ours = {a.name for a in simulated.data.attributes if a.name.startswith(attributes.PREFIX)}
    assert ours <= {attributes.PREFIX + name for name in attributes.SPECS}
    assert not attributes.read_all(simulated.data)[1]
    assert attributes.SPECS["reach"][3] == len(match_limits.REASON_NAMES) - 1


def test_properties_of_another_kind(spiralled: Any) -> None:
    """By these the pieces beside the model are found; without them new ones are made."""
    found = collection.find(spiralled)
    assert found is not None
    for value in (5, "x", [1, 2], {"a": 1}):
        for owner, name in ((found, "flexmaps_owner"), *((o, "flexmaps_kind") for o in found.objects)):
            owner[name] = value
        collection.find(spiralled)
        collection.clear(spiralled)
    for value in (5, "x", [1, 2], {"a": 1}):
        spiralled["flexmaps_collection"] = value
        assert collection.find(spiralled) is None
    assert bpy.ops.flexmaps.spirals() == {"FINISHED"}


def test_hubs_that_make_no_pose(simulated: Any) -> None:
    """A simulation would begin there."""
    to_metres = np.array(simulated.matrix_world)
    assert pose.read(simulated, to_metres) is not None
    for name, value in (("hub", 2147483647.0), ("hub", 0.0), ("hub_x", 0.0), ("hub_y", 1.0)):
        attribute = simulated.data.attributes[attributes.PREFIX + name]
        prop, values = _values(attribute)
        attribute.data.foreach_set(prop, np.full_like(values, value))
        if name == "hub_y":
            other = simulated.data.attributes["flexmaps_hub_x"]
            other.data.foreach_set("vector", np.full_like(values, value))
        assert pose.read(simulated, to_metres) is None
        attribute.data.foreach_set(prop, values)
    assert bpy.ops.flexmaps.simulate() == {"FINISHED"}


def test_an_equilibrium_that_is_nowhere(simulated: Any) -> None:
    simulated.data.shape_keys.key_blocks["FlexMaps equilibrium"].data[3].co.z = np.nan
    assert not {"equilibrium", "reach"} & set(api.report(simulated))


def test_the_report_leaves_out_what_is_out_of_date(spiralled: Any) -> None:
    described = api.report(spiralled)
    assert "spirals" in described
    api.show(api.sheets(api.load(spiralled)), spiralled)
    assert "sheets" in api.report(spiralled)
    spiralled.flexmaps.sheet.sheet_width = 432.0
    assert "sheets" not in api.report(spiralled)


def test_damage_by_chance(fuzz_stored: ModuleType) -> None:
    """A few of those that ``bench fuzz stored`` plays."""
    for number in range(1):
        fuzz_stored.play(number, False)
