"""The settings of the engine as properties of an object, there and back."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any

import bpy
import pytest
from flexmaps.bridge.store import settings
from flexmaps.engine.params import SHOWN, ObjectSettings, Params, Settings, SheetParams, SpiralParams


def test_defaults_are_those_of_the_engine(dome: Any) -> None:
    assert settings.read(dome.flexmaps, ObjectSettings) == ObjectSettings()
    assert settings.read(dome.flexmaps, Settings) == Settings()


def test_switches_of_earlier_versions_are_read(dome: Any) -> None:
    """A file or a preset that matched places alone still does, until somebody moves what stands for it."""
    block = dome.flexmaps.optimise
    block.laplacian = False
    assert settings.read(dome.flexmaps, Settings).optimise.lies == 1.0
    block.lies = 0.5
    assert settings.read(dome.flexmaps, Settings).optimise.lies == 0.5
    block.laplacian = False
    settings.write(dome.flexmaps, ObjectSettings())
    assert settings.read(dome.flexmaps, ObjectSettings) == ObjectSettings()


def test_there_and_back(dome: Any) -> None:
    wanted = ObjectSettings(
        spiral=SpiralParams(thickness=0.003, width_min=0.00123, slot_min=0.00045, twist_max=4.2, clockwise=True),
        sheet=SheetParams(sheet_width=1.234, labels=False),
    )
    settings.write(dome.flexmaps, wanted)
    got = settings.read(dome.flexmaps, ObjectSettings)
    for block in fields(ObjectSettings):
        for f in fields(getattr(wanted, block.name)):
            a, b = (getattr(getattr(x, block.name), f.name) for x in (wanted, got))
            assert a == (pytest.approx(b, rel=1e-6) if isinstance(a, float) else b), f.name
    assert got.spiral.thickness == 0.003  # what a person types comes back as typed


# settings that bound each other
TOGETHER = {
    "width_min": ["width_max"],
    "width_max": ["width_min"],
    "twist_min": ["twist_max"],
    "twist_max": ["twist_min"],
    "sheet_width": ["margin"],
    "sheet_height": ["margin"],
}


def test_every_bound_can_be_used(dome: Any) -> None:
    """The largest and smallest value of every setting survive Blender's single precision."""
    for block in fields(ObjectSettings):
        kind = block.default_factory
        for f in fields(kind):  # type: ignore[arg-type]
            for bound in (f.metadata["low"], f.metadata["high"]):
                if bound is None:
                    continue
                if f.name == "margin" and bound:  # as much as the largest sheet has
                    beside = {"sheet_width": 10.0, "sheet_height": 10.0}
                else:
                    beside = {other: 0.0 if other == "margin" else bound for other in TOGETHER.get(f.name, ())}
                changed: Params = replace(kind(), **{f.name: bound}, **beside)  # type: ignore[operator]
                settings.write(getattr(dome.flexmaps, block.name), changed)
                assert getattr(settings.read(getattr(dome.flexmaps, block.name), kind), f.name) == pytest.approx(bound)


def test_shown_in_millimetres_and_degrees_whatever_the_scene(dome: Any) -> None:
    bpy.context.scene.unit_settings.scale_length = 0.001
    assert dome.flexmaps.spiral.thickness == pytest.approx(2.0)
    assert dome.flexmaps.spiral.twist_max == pytest.approx(360.0)
    assert settings.read(dome.flexmaps, ObjectSettings) == ObjectSettings()


def test_every_property_says_what_it_is() -> None:
    for block in fields(ObjectSettings):
        properties = settings.property_group(block.default_factory).bl_rna.properties  # type: ignore[arg-type]
        for f in fields(block.default_factory):  # type: ignore[arg-type]
            assert properties[f.name].description
            unit = SHOWN[f.metadata["unit"]][1]
            assert unit in properties[f.name].name


def test_a_copy_takes_its_settings_along(dome: Any) -> None:
    dome.flexmaps.spiral.thickness = 4.0
    assert dome.copy().flexmaps.spiral.thickness == pytest.approx(4.0)
