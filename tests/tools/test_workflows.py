"""The workflow files for the forges: they can be read, and do nothing but call what runs here too.

Their keys are held by the forges' own schemas (``check-jsonschema --builtin-schema vendor.github-workflows`` and
``vendor.gitlab-ci``) and by ``actionlint`` where somebody changes them.
"""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import Any

import pytest

yaml = pytest.importorskip("yaml")

CALL = ".ci/run"


def read(path: Path) -> dict[Any, Any]:
    found = yaml.safe_load(path.read_text(encoding="utf-8"))
    assert isinstance(found, dict)
    return found


@pytest.mark.parametrize("folder", [".github", ".forgejo"])
def test_actions(root: Path, folder: str) -> None:
    made = read(root / folder / "workflows" / "check.yml")
    assert set(made[True]) == {"push", "pull_request"}, "'on' is YAML's word for true"
    ((_, job),) = made["jobs"].items()
    assert set(job) <= {"strategy", "runs-on", "container", "timeout-minutes", "steps"}
    pythons(job["strategy"]["matrix"]["python"])
    steps = job["steps"]
    assert all(set(step) <= {"name", "uses", "with", "if", "run", "shell"} for step in steps)
    assert [step["run"] for step in steps if step.get("shell")] == [CALL] and steps[-1]["shell"] == "bash"
    assert all(re.fullmatch(r"actions/[\w-]+@v\d+", step["uses"]) for step in steps if "uses" in step)
    assert "secrets" not in (root / folder / "workflows" / "check.yml").read_text()
    if folder == ".github":
        systems = {name.split("-")[0] for name in job["strategy"]["matrix"]["system"]}
        assert systems == {"ubuntu", "windows", "macos"} and made["permissions"] == {"contents": "read"}


def test_gitlab(root: Path) -> None:
    made = read(root / ".gitlab-ci.yml")
    jobs = {name: job for name, job in made.items() if name not in {"workflow", "default"}}
    assert jobs.keys() == {"linux", "windows", "macos"}
    for job in jobs.values():
        assert set(job) <= {"image", "tags", "parallel", "before_script", "script"}
        (line,) = job["script"]
        assert line.endswith(CALL)
        pythons(job["parallel"]["matrix"][0]["PYTHON"])


def test_what_they_call_can_be_run(root: Path) -> None:
    """On every system: the file may be executed, and its line ends stay as a Bash reads them."""
    script = root / CALL
    assert script.read_bytes().startswith(b"#!/usr/bin/env bash\n") and b"\r" not in script.read_bytes()
    assert os.name == "nt" or os.access(script, os.X_OK)
    assert "* -text" in (root / ".gitattributes").read_text().splitlines()


def pythons(given: list[Any]) -> None:
    from flexmaps_dev import SUPPORTED

    assert given == [f"{major}.{minor}" for major, minor in SUPPORTED], "text, for 3.10 would be the number 3.1"
