"""Every stage reads the settings that its row of the table lists, and no others."""

from __future__ import annotations

import sys
from dataclasses import fields, is_dataclass, replace
from typing import Any

import pytest
from flexmaps.engine.params import ObjectSettings, Settings, with_values
from flexmaps.engine.runs import job
from flexmaps.engine.runs.stage import section_of
from flexmaps.engine.runs.stages import STAGES, TABLE
from flexmaps.engine.runs.steps import function_of
from flexmaps.engine.surface import shapes
from flexmaps.engine.surface.mesh import PolygonMesh

# functions that take a section as a whole, to copy, compare or check it
WHOLE = {"replace", "__post_init__", "__eq__", "__hash__", "__repr__", "__reduce__"}
# pieces on which stages read what they read only sometimes
PIECES = {
    "free": (
        shapes.saddle(4),
        None,
        {
            "sheet.sheet_width": 60.0,
            "sheet.sheet_height": 60.0,
        },
    ),
    "standing": (
        shapes.dome(4),
        "lowest",
        {"base.base": "feet", "simulate.gravity": True, "spiral.border": "left_out", "structure.cases": "own: weight"},
    ),
}
COMMON = {"sheet.nesting": "FAST", "optimise.iterations": 1, "choose.match": 0.5}


class Recorder:
    """Records what the running stage reads of the settings, as "section.name", also where an input holds a section."""

    def __init__(self) -> None:
        self.read: dict[str, set[str]] = {name: set() for name in STAGES}
        self.running = ""

    def step(self, name: str, step: Any) -> Any:
        def recorded(result: Any, *rest: Any) -> Any:
            *inputs, settings, progress = rest
            self.running = name
            try:
                return step(result, *inputs, self._watched_settings(settings), progress)
            finally:
                self.running = ""

        return recorded

    def _watched_settings(self, settings: Settings) -> Settings:
        sections = {f.name: getattr(settings, f.name) for f in fields(settings)}
        watched = {name: self._watched(name, block) for name, block in sections.items() if is_dataclass(type(block))}
        return replace(settings, **watched)  # type: ignore[arg-type]

    def _watched(self, section: str, block: Any) -> Any:
        plain = next(kind for kind in type(block).__mro__ if kind.__module__.startswith("flexmaps"))
        names = {f.name for f in fields(plain)}

        def look(value: Any, name: str) -> Any:
            if self.running and name in names and not {sys._getframe(k).f_code.co_name for k in (1, 2)} & WHOLE:
                self.read[self.running].add(f"{section}.{name}")
            return object.__getattribute__(value, name)

        def reduced(value: Any) -> Any:  # another process reads unseen
            return plain, tuple(getattr(value, f.name) for f in fields(plain))

        kind = type(plain.__name__, (plain,), {"__getattribute__": look, "__reduce__": reduced})
        return kind(**{name: getattr(block, name) for name in names})


@pytest.fixture(scope="module")
def read() -> dict[str, set[str]]:
    """What every stage has read on the pieces."""
    recorder = Recorder()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(job, "function_of", lambda stage: recorder.step(stage.name, function_of(stage)))
        for mesh, supports, values in PIECES.values():
            settings, held = with_values(ObjectSettings(), COMMON | values), supports is not None
            polygons = PolygonMesh.from_quads(mesh)
            made = job.run(polygons, settings, edge=0.02, optimised=not held, structured=held, supports=supports)
            assert made.undone == {}
    return recorder.read


def _covers(entry: str, setting: str) -> bool:
    section, but = section_of(entry)
    name, _, one = setting.partition(".")
    return section == name and one not in but


# Choose takes minutes, and a scan is compared without settings
@pytest.mark.parametrize("name", [stage.name for stage in TABLE if stage.name not in ("choose", "compare")])
def test_what_a_stage_reads_is_what_its_row_lists(read: dict[str, set[str]], name: str) -> None:
    stage = STAGES[name]
    # an entry may also act through an input; the forces and supports of "loads" reach the stages as arrays
    makers = [maker for need in stage.needs for maker in TABLE if need in maker.makes]
    inherited = {"loads", *(entry for maker in makers for entry in maker.settings)}
    listed = {*stage.settings, *stage.reads} | inherited
    assert [one for one in sorted(read[name]) if not any(_covers(entry, one) for entry in listed)] == []
    own = {*stage.settings} - inherited
    unread = [entry for entry in own if not any(_covers(entry, one) for one in read[name])]
    assert unread == []


def test_a_section_that_a_row_does_not_list_cannot_be_read() -> None:
    settings = STAGES["split"].readable(ObjectSettings())
    assert settings.sheet == ObjectSettings().sheet
    with pytest.raises(AttributeError, match="'split' reads material"):
        assert settings.material.material
