"""*Next* where the files cannot be written: it asks for another folder."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import bpy
import pytest
from flexmaps import api
from flexmaps.bridge.store import failures, guidance
from flexmaps.bridge.view import head_text
from flexmaps.engine.errors import FlexMapsError
from flexmaps.operators.next import Next
from support.buttons import press


def seen(obj: Any) -> guidance.Guidance:
    bpy.context.view_layer.update()
    return guidance.read_guidance(obj, bpy.context.scene)


@pytest.fixture
def unwritable(dome: Any, tmp_path: Path) -> Any:
    """A piece whose files go below a path that is a file."""
    place = tmp_path / "file"
    place.touch()
    dome.flexmaps.export.folder = str(place / "below")
    for name in ("flatten", "spirals"):
        press(name)
    with pytest.raises(RuntimeError, match="Cannot write"):
        bpy.ops.flexmaps.export()
    return dome


def test_a_folder_that_cannot_be_written_is_chosen_anew(unwritable: Any, tmp_path: Path) -> None:
    (notice,) = [one for one in seen(unwritable).notices if one.key == "failed/flexmaps.export"]
    (cure,) = notice.cures
    assert (
        cure.call == "bpy.ops.flexmaps.choose_folder(stage='flexmaps.export')" and "choose another" in notice.sentence
    )
    press("choose_folder", directory=str(tmp_path / "other"), **cure.properties)
    assert list((tmp_path / "other").glob("*.pdf"))
    assert not [one for one in seen(unwritable).notices if one.key.startswith("failed/")]


def test_the_folder_is_tried_before_the_work(unwritable: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    from flexmaps.engine.runs import job

    monkeypatch.setattr(job, "run_stages", lambda *_: pytest.fail("the panels were placed on sheets"))
    with pytest.raises(RuntimeError, match="Cannot write"):
        bpy.ops.flexmaps.export()


def test_a_cancelled_question_is_asked_again(unwritable: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """In a window; without one, *Next* cannot ask and ends."""
    wanted = guidance.NextAction("flexmaps.choose_folder", "", "", "make", {}, seen(unwritable).notices[0].cures[0])
    monkeypatch.setattr(guidance, "read_guidance", lambda *_: SimpleNamespace(action=wanted))
    asked = SimpleNamespace(_check_before_cut=lambda _, guide: guide, report=lambda *_: None)
    for how, count in (("INVOKE_DEFAULT", 0), ("EXEC_DEFAULT", 1)):
        Next._run_action(asked, bpy.context, how)
        assert len(failures.read_press_counts(unwritable.data)) == count


def test_where_next_ends_the_head_says_why(unwritable: Any) -> None:
    failures.write(unwritable, bpy.context.scene, "flexmaps.export", FlexMapsError("No sheet is large enough"))
    guide = guidance.Guidance(None, seen(unwritable).status, seen(unwritable).notices)
    content = head_text.head_content(bpy.context, "", guide, None, None)
    assert content.hint == "No sheet is large enough" and not content.operator
    assert not [cure for one in guide.notices if one.key == "failed/flexmaps.export" for cure in one.cures]


def test_a_script_is_told_that_a_folder_has_to_be_given(unwritable: Any) -> None:
    told = api.press(unwritable, cure="choose_folder")
    assert told is not None and told["error"] == "Choose a folder for the files"
