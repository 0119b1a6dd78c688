"""The parts of ``bench live`` that try foreign meshes and wishes: what is missing or wrong is named, and nothing ends them."""

from __future__ import annotations

import sys
from pathlib import Path
from types import ModuleType

import pytest
from flexmaps.engine.errors import FlexMapsError
from flexmaps.engine.surface import shapes
from flexmaps.engine.surface.mesh import QuadMesh


def tool(name: str) -> ModuleType:
    sys.path.append(str(Path(__file__).resolve().parents[2] / "tools"))
    return __import__(name)


def write(mesh: QuadMesh, path: Path) -> None:
    lines = [f"v {x} {y} {z}" for x, y, z in mesh.vertices.tolist()]
    path.write_text("\n".join(lines + ["f " + " ".join(str(1 + v) for v in quad) for quad in mesh.quads.tolist()]))


def test_foreign_meshes_that_are_missing_are_named_and_faults_counted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    live_foreign = tool("live_foreign")
    (tmp_path / "heart.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    write(shapes.quad(), tmp_path / "cmc1.obj")
    monkeypatch.setattr(live_foreign, "_live", lambda *_: 1 / 0)
    rows = list(live_foreign.measure_meshes(tmp_path, 0.03))
    assert {one["mesh"] for one in rows} == {Path(name).stem for name in live_foreign.NAMES}
    for one in rows:
        if one["mesh"] == "heart" and one["row"] != "errors":
            assert one["row"].startswith("refused") and "not a quad" in one["peer"]["because"]
        elif one["row"] == "errors":
            assert one["measured"] == (len(live_foreign.BORDERS) if one["mesh"] == "cmc1" else 0)
        else:
            assert one["ok"] is None and "missing" in one["row"]


@pytest.mark.thorough
def test_a_foreign_mesh_is_followed_and_painted_with_every_border(tmp_path: Path) -> None:
    live_foreign = tool("live_foreign")
    write(shapes.saddle(6), tmp_path / "heart.obj")
    rows = {one["row"]: one for one in live_foreign.measure_meshes(tmp_path, 0.03) if one["mesh"] == "heart"}
    assert rows["errors"]["measured"] == 0, rows["errors"]["peer"]
    for words in live_foreign.BORDERS.values():
        assert rows[f"live: strokes that came to rest{words}"]["measured"] == live_foreign.STROKES
        assert rows[f"brush: main thread, slowest, s{words}"]["measured"] > 0.0


def test_wishes_that_nothing_can_bring_nearer_are_named(monkeypatch: pytest.MonkeyPatch) -> None:
    live_wishes = tool("live_wishes")
    told = {
        "cone": {"wished_mm_before": 10.0, "wished_mm": 4.0},
        "star3": {"wished_mm_before": 10.0, "wished_mm": 10.0, "wish": "Nothing bends it."},
        "dome": {"wished_mm_before": 10.0, "wished_mm": 9.5},
    }

    def report(name: str) -> dict[str, float | str]:
        if name not in told:
            raise FlexMapsError("No equilibrium")
        return told[name]

    monkeypatch.setattr(live_wishes, "_report", report)
    rows = {one["mesh"]: one for one in live_wishes.measure_wishes()}
    assert (rows["cone"]["measured"], rows["cone"]["ok"], rows["dome"]["ok"]) == (0.4, True, False)
    assert "without strain" in rows["star3"]["row"] and rows["star3"]["ok"] is None
    assert rows["globe"]["measured"] == "No equilibrium" and rows["globe"]["ok"] is False
    assert rows["all"]["measured"] == pytest.approx(0.675)
