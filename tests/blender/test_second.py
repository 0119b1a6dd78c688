"""The second Blender: what it must leave alone, and what it must not keep waiting for."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from flexmaps.bridge.hosts import remesh, second_blender
from flexmaps.engine.errors import FlexMapsError
from flexmaps.engine.params import ObjectSettings, RemeshParams
from flexmaps.engine.surface import shapes
from flexmaps.engine.surface.checking import check
from flexmaps.engine.surface.mesh import PolygonMesh
from flexmaps.engine.surface.remeshing import requad


@pytest.fixture
def dome() -> PolygonMesh:
    return PolygonMesh.from_quads(shapes.make("dome"))


def test_it_has_user_files_of_its_own(dome: PolygonMesh, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """A Blender in which no extension is enabled clears away the packages of those that the user has."""
    monkeypatch.setenv("BLENDER_USER_RESOURCES", str(tmp_path))
    monkeypatch.setenv("BLENDER_USER_EXTENSIONS", str(tmp_path / "extensions"))
    given: list[dict[str, str]] = []
    popen = second_blender.subprocess.Popen

    def noting(*words: Any, env: dict[str, str], **options: Any) -> Any:
        given.append(env)
        return popen(*words, env=env, **options)

    monkeypatch.setattr(second_blender.subprocess, "Popen", noting)
    with second_blender.SecondBlender() as tool:
        assert tool.triangles(dome, 1e-9) is not None
        assert not any(str(tmp_path) in value for name, value in given[0].items() if name.startswith("BLENDER_USER"))
    assert not os.listdir(tmp_path)


def test_what_hangs_is_ended_and_the_next_one_starts_anew(dome: PolygonMesh, monkeypatch: pytest.MonkeyPatch) -> None:
    with second_blender.SecondBlender() as tool:
        triangles = tool.triangles(dome, 1e-9)
        assert triangles is not None and (triangles.sizes == 3).all() and len(triangles.sizes) == 2 * len(dome.sizes)
        first = tool._process
        monkeypatch.setattr(second_blender, "TIMEOUT", 0.0)
        assert tool.quads(triangles, 100, 0, False) is None and first.poll() is not None
        monkeypatch.setattr(second_blender, "TIMEOUT", 30.0)
        quads = tool.quads(triangles, 100, 0, False)
        assert quads is not None and (quads.sizes == 4).all() and tool._process is not first
        assert np.ptp(quads.vertices, axis=0) == pytest.approx(np.ptp(dome.vertices, axis=0), rel=0.15)
        last = tool._process
    assert last.poll() is not None


def test_a_letter_on_which_quadriflow_comes_apart_is_cut_into_quads() -> None:
    """The M of Blender's own font has slender triangles only."""
    curve = bpy.data.curves.new("M", "FONT")
    curve.body = "M"
    obj = bpy.data.objects.new("M", curve)
    bpy.context.scene.collection.objects.link(obj)
    letter = remesh.read_polygons(obj, bpy.context)
    made = remesh.make_quads(letter, 300, ObjectSettings(remesh=RemeshParams(smooth=True)))
    assert not [f for f in check.findings(made.polygons) if f.is_error]
    assert 150 < len(made.polygons.sizes) < 600
    expected, area = (requad.target_surface(mesh).area for mesh in (letter, made.polygons))
    assert area == pytest.approx(expected, rel=0.05)


def test_a_blender_that_does_not_start_is_named(dome: PolygonMesh, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(second_blender, "SCRIPT", Path(__file__).with_name("nothing.py"))
    with second_blender.SecondBlender() as tool, pytest.raises(FlexMapsError, match="second Blender"):
        tool.triangles(dome, 1e-9)
