"""The main job from the command line: what it leaves behind, and what it refuses."""

from __future__ import annotations

import errno
import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from flexmaps.bridge.view import picture
from flexmaps.command import main as command
from flexmaps.engine import files
from flexmaps.engine.surface import shapes


def obj_file(path: Path, vertices: np.ndarray, faces: np.ndarray) -> Path:
    lines = [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in vertices]
    lines += ["f " + " ".join(str(i + 1) for i in face) for face in faces]
    path.write_text("\n".join(lines) + "\n")
    return path


@pytest.fixture
def dome(tmp_path: Path) -> Path:
    mesh = shapes.make("dome")
    return obj_file(tmp_path / "dome.obj", mesh.vertices, mesh.quads)


def run(*arguments: object) -> int:
    return command.main(["run", *(str(a) for a in arguments)])


def contents(folder: Path) -> dict[str, bytes]:
    return {p.name: p.read_bytes() for p in folder.rglob("*") if p.is_file()} if folder.is_dir() else {}


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Everything that the job writes of the dome, with small pictures."""
    folder, mesh = tmp_path_factory.mktemp("whole"), shapes.make("dome")
    dome = obj_file(folder / "dome.obj", mesh.vertices, mesh.quads)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(picture, "SIZE", (160, 90))
        patch.setattr(picture, "SAMPLES", 1)
        assert run(dome, "--edge", 20, "--nesting", "FAST", "--out", folder / "out") == 0
    return folder / "out"


def test_everything_is_written(whole: Path) -> None:
    out = whole
    report = json.loads((out / "report.json").read_text())
    assert report["schema"] == 1
    assert report["input"]["quads"] == len(shapes.make("dome").quads)
    assert report["input"]["edge_mm"] == pytest.approx(20, abs=0.01)
    assert report["input"]["open"] and report["input"]["genus"] == 0
    assert report["layout"]["energy_max"] <= 0.035
    assert report["layout"]["flips"] == 0 and report["layout"]["overlaps"] == 0
    assert report["spirals"]["count"] == report["input"]["quads"]
    named = set(report["sheets"]["files"]) | {"report.json", "model.blend", "share.html"}
    named |= {"layout.png", "panels.png", "shape.png", "together.png"}
    assert named | {"report.html", "plots"} == {p.name for p in out.glob("[!.]*")}
    assert {Path(name).suffix for name in report["sheets"]["files"]} == {".svg", ".dxf", ".pdf", ".csv"}
    assert (out / "layout.png").read_bytes().startswith(b"\x89PNG")


def test_a_stage_that_has_not_run_is_absent(dome: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    assert run(dome, "--edge", 20, "--out", out, "--stop-after", "regularise", "--no-pictures") == 0
    report = json.loads((out / "report.json").read_text())
    assert not {"layout", "spirals", "sheets"} & set(report)
    assert set(report["seconds"]) == {"check", "regularise"}


def test_files_of_an_earlier_run_that_are_no_longer_true_go(whole: Path, dome: Path, tmp_path: Path) -> None:
    """Its sheets and its pictures, but no picture that somebody else put there under such a name."""
    out = tmp_path / "out"
    shutil.copytree(whole, out)
    (out / "notes.txt").write_text("mine")
    (out / "panels.png").write_bytes(b"\x89PNG mine")
    assert run(dome, "--edge", 20, "--out", out, "--no-pictures", "--stop-after", "merge") == 0
    kept = {"notes.txt", "panels.png"}
    assert {p.name for p in out.glob("[!.]*")} == {"report.json", "report.html", "plots", "model.blend"} | kept
    assert {p.name for p in (out / "plots").glob("[!.]*")} == {"surface.svg", "patches.svg", "distortion.svg"}


def broken_inputs(folder: Path) -> dict[str, Path]:
    mesh = shapes.make("dome")
    triangles = np.concatenate([mesh.quads[:, [0, 1, 2]], mesh.quads[:, [0, 2, 3]]])
    uneven = mesh.vertices * [1, 30, 1]
    lost = mesh.vertices.copy()
    lost[3] = np.nan
    flipped = mesh.quads.copy()
    flipped[5] = flipped[5, ::-1]
    whole = obj_file(folder / "whole.obj", mesh.vertices, mesh.quads).read_text()
    (folder / "truncated.obj").write_text(whole[: len(whole) * 2 // 3])
    (folder / "empty.obj").write_text("")
    return {
        "triangles": obj_file(folder / "triangles.obj", mesh.vertices, triangles),
        "size": obj_file(folder / "uneven.obj", uneven, mesh.quads),
        "nan": obj_file(folder / "nan.obj", lost, mesh.quads),
        "flipped": obj_file(folder / "flipped.obj", mesh.vertices, flipped),
        "truncated": folder / "truncated.obj",
        "empty": folder / "empty.obj",
        "missing": folder / "missing.obj",
        "folder": folder,
    }


@pytest.mark.parametrize(
    "case",
    [
        "triangles",
        pytest.param("size", marks=pytest.mark.thorough),
        "nan",
        "flipped",
        "truncated",
        "empty",
        "missing",
        "folder",
    ],
)
def test_a_bad_mesh_is_refused_in_one_line(case: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out"
    out.mkdir()
    (out / "report.json").write_text("earlier")
    path = broken_inputs(tmp_path)[case]
    assert run(path, "--edge", 20, "--no-remesh", "--out", out) == 2
    assert contents(out) == {"report.json": b"earlier"}
    complaint = [line for line in capsys.readouterr().err.splitlines() if line.startswith("flexmaps:")]
    assert len(complaint) == 1


@pytest.mark.parametrize("name, says", [("suzanne.obj", "quad"), ("moebius_desk.obj", "size")])
def test_known_bad_meshes(
    name: str, says: str, shared_meshes: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    assert run(shared_meshes / name, "--edge", 20, "--no-remesh", "--out", out) == 2
    assert not out.exists()
    assert says in capsys.readouterr().err


def test_a_folder_that_is_a_file(dome: Path, tmp_path: Path) -> None:
    (tmp_path / "out").write_text("in the way")
    assert run(dome, "--edge", 20, "--out", tmp_path / "out") == 2
    assert (tmp_path / "out").read_text() == "in the way"


def test_full_disk_leaves_the_earlier_run(dome: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    out = tmp_path / "out"
    assert run(dome, "--edge", 20, "--out", out, "--no-pictures", "--stop-after", "spirals") == 0
    before = contents(out)

    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(files, "_swap", full)
    assert run(dome, "--edge", 15, "--out", out, "--no-pictures", "--stop-after", "merge") == 2
    assert contents(out) == before


def test_a_setting_out_of_bounds(dome: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(dome, "--edge", 20, "--thickness", -1, "--out", tmp_path / "out") == 2
    assert "Thickness -1 mm" in capsys.readouterr().err


def test_stopping_leaves_nothing(dome: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def stop(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("flexmaps.engine.patches.merging.merge.merge", stop)
    assert run(dome, "--edge", 20, "--out", tmp_path / "out") == 130
    assert not (tmp_path / "out").exists()
