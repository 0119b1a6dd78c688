"""*Next* on an object that shares its mesh with another one, or that was scaled after its layout."""

from __future__ import annotations

from typing import Any

import bpy
import pytest
from flexmaps.bridge.store import guidance, notices, states
from flexmaps.bridge.store.finding_words import INFORMATION, WORSE
from support.buttons import press, report


def seen(obj: Any) -> guidance.Guidance:
    bpy.context.view_layer.objects.active = obj
    bpy.context.view_layer.update()
    return guidance.read_guidance(obj, bpy.context.scene)


def offered(obj: Any) -> str:
    action = seen(obj).action
    return "" if action is None else action.idname


def twin_of(obj: Any) -> Any:
    twin = obj.copy()  # a linked duplicate, as with Alt D
    bpy.context.scene.collection.objects.link(twin)
    return twin


@pytest.fixture
def finished(dome: Any) -> Any:
    for name in ("flatten", "spirals"):
        press(name)
    return dome


def is_finished(obj: Any) -> bool:
    return states.read_states(obj, bpy.context.scene)["spirals"].kind == states.DONE


def test_the_results_of_a_linked_duplicate_are_kept(finished: Any) -> None:
    twin = twin_of(finished)
    twin.scale = (3.0, 3.0, 3.0)
    (notice,) = [one for one in seen(twin).notices if one.key == notices.SHARED]
    assert notice.severity == WORSE and f"'{finished.name}'" in notice.sentence
    assert offered(twin) == "flexmaps.own_mesh"
    before = report(finished)
    press("next")
    assert twin.data != finished.data and report(finished) == before and is_finished(finished)
    assert offered(twin) == "flexmaps.set_size"
    press("next")
    assert offered(twin) == "flexmaps.merge" and is_finished(finished)
    assert not [one for one in seen(finished).notices if one.key == notices.SHARED]


def test_settings_of_its_own_lose_no_results_of_another(finished: Any) -> None:
    twin = twin_of(finished)
    assert offered(twin) == offered(finished), "results are common to all as long as they hold for all"
    (notice,) = [one for one in seen(twin).notices if one.key == notices.SHARED]
    assert notice.severity == INFORMATION and [cure.name for cure in notice.cures] == ["own_mesh"]
    twin.flexmaps.spiral.slot_min += 0.1
    assert offered(twin) == "flexmaps.own_mesh" and is_finished(finished)
    press("let_go", key=notices.SHARED)
    assert offered(twin) == "flexmaps.fit"


def test_a_mesh_edited_for_all_is_laid_out_for_all(finished: Any) -> None:
    twin = twin_of(finished)
    finished.data.vertices[0].co.z += 1e-3
    assert offered(twin) == offered(finished) == "flexmaps.merge"


def test_an_object_scaled_after_its_layout_is_offered_its_scale(finished: Any) -> None:
    finished.scale = [10.0 * one for one in finished.scale]
    assert offered(finished) == "flexmaps.set_size"
    finished.lock_scale[0] = True
    assert offered(finished) == "flexmaps.merge"
    finished.lock_scale[0] = False
    finished.scale = [0.12 * one for one in finished.scale]
    assert offered(finished) == "flexmaps.merge", "its quads can be cut as they are"
