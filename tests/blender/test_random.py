"""Whatever is pressed in whatever order with whatever settings: no traceback, and the mesh stays valid.

A few calls here; ``python3 tools/dev.py bench blender`` makes a thousand.
"""

from __future__ import annotations

import random
from pathlib import Path
from types import ModuleType

import bpy
import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

CALLS, SESSIONS = 8, 5


@settings(
    max_examples=SESSIONS,
    deadline=None,
    derandomize=True,
    phases=[Phase.explicit, Phase.generate],  # a session that fails is printed whole; making it smaller takes too long
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow, HealthCheck.data_too_large],
)
@given(rng=st.randoms(use_true_random=True))
@pytest.mark.thorough
def test_random_calls(random_calls: ModuleType, tmp_path: Path, rng: random.Random) -> None:
    log = random_calls.Log()
    random_calls.session(rng, CALLS, tmp_path, log)
    assert log.calls == CALLS
    assert not log.faults, "\n".join(log.faults)


def test_the_search_for_faults_can_find_them(
    random_calls: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A bug in a stage, a mesh that is not valid and a panel that cannot be drawn are seen."""
    from flexmaps.operators import check
    from flexmaps.panels import sidebar

    def bug(self: object, *_: object) -> None:
        raise ZeroDivisionError("a bug")

    def bad(self: object, *_: object) -> None:
        raise KeyError("missing")

    monkeypatch.setattr(check.Check, "prepare", bug)
    monkeypatch.setattr(sidebar.MainPanel, "draw", bad)
    log = random_calls.Log()
    rng = random.Random(3)
    bpy.ops.mesh.primitive_grid_add()
    assert random_calls._call(rng, "check", log) == "fault" and "ZeroDivisionError" in log.faults[0]
    assert any("FLEXMAPS_PT_main cannot be drawn: KeyError" in fault for fault in random_calls._faults())
    bpy.context.object.data.loops[0].vertex_index = bpy.context.object.data.loops[1].vertex_index
    assert any("was not valid" in fault for fault in random_calls._faults())


def test_every_operator_has_a_chance(random_calls: ModuleType) -> None:
    names = set(random_calls.operators())
    assert {"check", "quad_remesh", "merge", "spirals", "simulate", "optimise", "export", "overlay"} <= names
    assert set(random_calls.STEPS) <= names
