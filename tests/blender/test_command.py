"""``blender --command flexmaps``: the registered handler, called as Blender calls it."""

from __future__ import annotations

import json
import signal
from dataclasses import fields
from pathlib import Path
from typing import Any

import bpy
import pytest
from flexmaps.command import arguments, sources
from flexmaps.command import main as command
from flexmaps.engine.extras.exploring import run_exploration as running
from flexmaps.engine.extras.exploring.candidate import Candidate
from flexmaps.engine.extras.exploring.folder import ExplorationFolder
from flexmaps.engine.params import ObjectSettings
from flexmaps.engine.surface import shapes

COMMANDS = ("run", "check", "layout", "simulate", "optimise", "export", "report", "share")
QUICK = ("--set", "optimise.iterations=2", "--set", "optimise.codesign=off", "--set", "sheet.nesting=FAST")


def run(*words: object) -> int:
    return command.main([str(word) for word in words])


def lines(text: str) -> list[str]:
    return [line for line in text.splitlines() if line.startswith("flexmaps:")]


def test_it_is_registered_with_blender(monkeypatch: pytest.MonkeyPatch) -> None:
    """And let go again: Blender refuses a handle that it does not know."""
    command.unregister()
    seen: list[Any] = []
    original = bpy.utils.register_cli_command
    monkeypatch.setattr(bpy.utils, "register_cli_command", lambda *given: seen.append(given) or original(*given))
    command.register()
    assert seen == [("flexmaps", command.main)]


@pytest.mark.parametrize("words", [(), *((name,) for name in COMMANDS)], ids=lambda w: " ".join(w) or "all")
def test_help(words: tuple[str, ...], capsys: pytest.CaptureFixture[str]) -> None:
    assert run(*words, "--help") == 0
    said = capsys.readouterr()
    assert said.err == ""
    assert all(name in said.out for name in (COMMANDS if not words else ("--supports", "--set", "--json", "--edge")))


@pytest.mark.parametrize("words", [
    (), ("paint",), ("simulate",), ("simulate", "shape:strip", "--edge", "wide"), ("simulate", "shape:nothing"),
    ("simulate", "shape:strip", "--edge", "-3"), ("simulate", "missing.obj"), ("simulate", "missing.blend"),
    ("simulate", "shape:strip", "--set", "spiral.thickness"), ("simulate", "shape:strip", "--set", "spiral.thick=2"),
    ("simulate", "shape:strip", "--set", "spiral.thickness=thick"), ("simulate", "shape:strip", "--supports", "4,9999"),
    ("simulate", "shape:strip", "--supports", "feet"), ("layout", "shape:strip", "--keep-seams"),
    ("simulate", "shape:strip", "--set", "simulate.gravity=on"), ("run", "shape:strip"),
    ("export", "shape:strip", "--out", "x", "--formats", "png"),
    ("simulate", "shape:strip", "--edge", "nan"), ("simulate", "shape:strip", "--height", "1_0"),
    ("layout", "shape:strip", "--remesh", "0"), ("layout", "shape:strip", "--remesh", "1e99"),
    ("simulate", "shape:strip", "--set", "sheet.seed=inf"),
    ("run", "shape:strip", "--out", "x", "--twist-min", "300", "--twist-max", "60"),
    ("run", "shape:strip", "--out", "x", "--seed", "1.5"), ("run", "shape:strip", "--out", "x", "--iterations", "3"),
], ids=" ".join)  # fmt: skip
def test_a_mistake_is_told_in_one_line(
    words: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert run(*words) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert len(lines(said.err)) == 1
    assert "Traceback" not in said.err
    assert not list(tmp_path.iterdir())


def test_a_flag_of_a_name_that_several_sections_have_names_its_own() -> None:
    """``--iterations`` by itself would be taken for those of any of them."""
    words = ["--regularise-iterations", "3", "--simulate-iterations", "4", "--optimise-iterations", "5"]
    given = vars(arguments.make_parser().parse_args(["run", "shape:strip", "--out", "x", *words]))
    assert [given[f"{name}.iterations"] for name in ("regularise", "simulate", "optimise")] == ["3", "4", "5"]


def test_a_fault_of_the_program_is_no_mistake_of_the_users(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def broken(*_: object, **__: object) -> None:
        raise IndexError("sixth of five")

    monkeypatch.setattr("flexmaps.engine.patches.tracing.trace.trace_layout", broken)
    assert run("layout", "shape:strip") == 1
    said = capsys.readouterr()
    assert said.out == "" and "sixth of five" in said.err


def test_control_c_is_the_users_while_a_command_runs(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Whatever handler Blender has; and it has it back afterwards."""

    def pressed(*_: object, **__: object) -> None:
        signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr("flexmaps.engine.patches.tracing.trace.trace_layout", pressed)
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        assert run("run", "shape:strip", "--out", tmp_path / "out") == 130
        assert signal.getsignal(signal.SIGINT) == signal.SIG_IGN
    finally:
        signal.signal(signal.SIGINT, before)
    assert len(lines(capsys.readouterr().err)) == 1
    assert not (tmp_path / "out").exists()


def test_control_c_ends_an_exploration_with_what_it_found(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The first one; the second ends it at once, as of any program."""
    add = ExplorationFolder.add

    def pressed(folder: ExplorationFolder, one: Candidate) -> None:
        add(folder, one)
        signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr(ExplorationFolder, "add", pressed)
    monkeypatch.setitem(running.explore_piece.__kwdefaults__, "effort", 0.02)
    words = ("explore", "shape:strip", "--out", tmp_path, "--vary", "edge=10:30", "--cores", 1, *QUICK)
    assert run(*words) == 0
    said = capsys.readouterr()
    assert "1 candidate, then stopped" in said.out
    assert len((tmp_path / "candidates.csv").read_text().splitlines()) == 1 + 1


def test_results_to_standard_output_and_progress_to_standard_error(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """Of the process, not only of Python: Blender itself writes lines, too."""
    assert run("simulate", "shape:strip", "--supports", "lowest", "--json", "--out", tmp_path / "s.blend") == 0
    said = capfd.readouterr()
    report = json.loads(said.out)
    assert report["equilibrium"]["converged"] and report["input"]["supports"] > 0
    assert "100%" in said.err
    assert run("optimise", tmp_path / "s.blend", "--json", *QUICK, "--out", tmp_path / "o.blend") == 0
    better = json.loads(capfd.readouterr().out)
    assert better["input"]["supports"] == report["input"]["supports"], "kept in the file"
    assert better["equilibrium"]["rms_percent"] < report["equilibrium"]["rms_percent"]
    before = pytest.approx(report["equilibrium"]["laplacian_rmse_mm"], rel=1e-3)
    assert better["optimise"]["laplacian_rmse_mm_before"] == before, "went on from the spirals in the file"
    assert run("share", tmp_path / "o.blend", "--out", tmp_path / "one.html") == 0
    assert '"simulated":true' in (tmp_path / "one.html").read_text(encoding="utf-8")
    capfd.readouterr()
    assert run("report", tmp_path / "o.blend", "--json", "--out", tmp_path / "rep") == 0
    told = json.loads(capfd.readouterr().out)
    assert told["optimise"]["history"] == better["optimise"]["history"], "what the file holds, not a new one"
    assert (tmp_path / "rep" / "report.html").is_file()
    assert run("export", tmp_path / "o.blend", *QUICK, "--formats", "svg", "--out", tmp_path / "cut") == 0
    assert sorted(p.name for p in (tmp_path / "cut").glob("[!.]*")) == [
        "sheet-01.svg",
        "sheet-assembly.pdf",
        "sheet-parts.csv",
    ]
    assert "1 sheet," in capfd.readouterr().out


def test_the_settings_of_an_object_are_used(add: Any, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    obj = add(shapes.make("strip"))
    obj.flexmaps.spiral.thickness = 1.25
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "s.blend"))
    capfd.readouterr()
    for words, expected in (((), 1.25), (("--set", "spiral.thickness=3"), 3.0)):
        assert run("layout", tmp_path / "s.blend", "--json", *words) == 0
        assert json.loads(capfd.readouterr().out)["settings"]["spiral"]["thickness"] == expected


def test_check_tells_errors_by_its_status(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "t.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    assert run("check", tmp_path / "t.obj", "--json") == 2
    codes = {finding["code"] for finding in json.loads(capsys.readouterr().out)["checks"]}
    assert "non-quad" in codes
    assert run("check", "shape:strip") == 0


def test_every_setting_is_listed_and_can_be_set(capsys: pytest.CaptureFixture[str]) -> None:
    assert run("settings", "--json") == 0
    rows = json.loads(capsys.readouterr().out)["settings"]
    names = {f"{block.name}.{f.name}" for block in fields(ObjectSettings) for f in fields(block.default_factory)}  # type: ignore[arg-type, misc]
    assert set(rows) == names
    words = [f"--set={name}={row['default']}" for name, row in rows.items()]
    args = arguments.make_parser().parse_args(["check", "shape:strip", *words])
    from flexmaps import api

    assert api.load("shape:strip", settings=sources.parse_settings(args)).settings == ObjectSettings()
    assert run("settings") == 0
    assert "spiral.thickness" in capsys.readouterr().out
