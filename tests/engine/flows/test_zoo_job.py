"""A share of the zoo: the whole job on small surfaces, one of each class that is hard in its own way."""

from __future__ import annotations

from dataclasses import replace
from types import ModuleType

import pytest
from flexmaps.engine.surface.mesh import PolygonMesh

SMALL = {
    "a pole, and slender arms": lambda z: z.smooth.cap(8, 5, 60),
    "a pole of valence 10, closed": lambda z: z.smooth.spindle(20, 6, 1.0),
    "a vertex of valence 12": lambda z: z.smooth.star(12, 2, 0.3),
    "one row of quads": lambda z: z.smooth.wave_strip(24, 1, 1, 0.12),
    "a ring that turns once": lambda z: z.smooth.twisted_ring(30, 2, 1.0),
    "a slender tube": lambda z: z.smooth.cylinder(6, 14, 14.0),
    "a thin ring": lambda z: z.smooth.torus(24, 6, 0.25),
    "quads 4 times as long as wide": lambda z: z.smooth.saddle(4, 14, 0.45, 0.0, 4.0),
    "sheared by 50 degrees": lambda z: z.smooth.saddle(9, 9, 0.5, 50.0),
    "a grid that grows 8 times": lambda z: z.smooth.graded(11, 8.0, 0.3),
    "several boundary loops": lambda z: z.irregular.perforated(11, 5, 0.3),
    "a hole for every fourth quad": lambda z: z.irregular.perforated(11, 2, 0.2),
    "folds": lambda z: z.irregular.folded(12, 6, 4, 0.25),
    "right angles": lambda z: z.irregular.block("l", 2),
    "a handle": lambda z: z.irregular.handles(1, 1),
    "tubes that meet": lambda z: z.irregular.branches("xXZ", 1, 1),
    "every triangle in three quads": lambda z: z.irregular.thirds(z.irregular.octa_triangles(1), z.irregular.on_ball),
    "random polygons": lambda z: z.irregular.catmull_clark(z.irregular.random_cells(16, 8), 1),
}


# the one that must be opened and whose ends must meet; the others run in a survey
QUICK = {"a ring that turns once"}


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[] if name in QUICK else [pytest.mark.thorough]) for name in SMALL]
)
def test_the_whole_job_comes_to_a_sound_end(zoo: ModuleType, name: str):
    mesh = SMALL[name](zoo)
    # few steps and a quick nesting: a sound end is asked for, not the best one
    settings = zoo.trial.settings_used(iterations=3, codesign=False)
    settings = replace(settings, sheet=replace(settings.sheet, nesting="FAST"))
    record, result = zoo.trial.run(lambda: PolygonMesh.from_quads(mesh), settings=settings)
    assert "traceback" not in record, record["traceback"]
    assert "refused" not in record, record["refused"]
    assert record["sheets"] >= 1
    assert sum(record["sizes"]) == len(mesh.quads) == len(result.design.width)
    assert record["alone"] <= record["alone_own_e"]
    assert record["not_finite"] == []
    assert not record.get("worse")
    assert record["left_out"] == []
