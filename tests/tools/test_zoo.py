"""The zoo's surfaces are what they are said to be, and the summary of a bench over them finds what is amiss."""

from __future__ import annotations

from types import ModuleType

import numpy as np
import pytest
from flexmaps.engine.errors import FlexMapsError
from flexmaps.engine.surface.checking import check
from flexmaps.engine.surface.mesh import PolygonMesh, QuadMesh


def test_every_surface_of_the_zoo_passes_the_checks_or_is_refused_for_its_reason(zoo: ModuleType):
    assert len(zoo.SURFACES) >= 80
    for name, surface in zoo.SURFACES.items():
        if surface.remesh is not None:
            continue
        polygons = check.scale_to_metres(surface.polygons(), edge=0.02)
        errors = [finding.code for finding in check.findings(polygons) if finding.is_error]
        assert errors == ([surface.refused] if surface.refused else []), name


def test_the_families_are_what_their_names_say(zoo: ModuleType):
    def euler(mesh: QuadMesh) -> int:
        return len(mesh.vertices) - len(mesh.edges) + len(mesh.quads)

    surfaces = {name: zoo.SURFACES[name].make() for name in ("genus0", "genus2", "genus4", "genus5-frame", "trefoil")}
    assert [euler(mesh) for mesh in surfaces.values()] == [2, -2, -6, -8, 0]  # 2 - 2 genus
    assert [int(zoo.smooth.star(n, 3, 0.4).valence.max()) for n in (3, 5, 7, 12)] == [4, 5, 7, 12]
    ball = zoo.irregular.catmull_clark(zoo.irregular.random_cells(24, 8), 1)
    assert euler(ball) == 2
    catenoid = zoo.smooth.catenoid(60, 60, 1.0)
    inner = ~catenoid.on_border
    # Weierstrass: a minimal surface has no mean curvature, so a vertex lies in the middle of its neighbours up to O(h^2)
    middle = np.zeros_like(catenoid.vertices)
    for a, b in (catenoid.edges.T, catenoid.edges.T[::-1]):
        np.add.at(middle, a, catenoid.vertices[b])
    away = np.linalg.norm(middle / catenoid.valence[:, None] - catenoid.vertices, axis=1)[inner]
    assert away.max() < 0.05 * catenoid.median_edge
    assert np.isfinite(away).all()
    with pytest.raises(FlexMapsError, match="one side"):
        check.as_quad_mesh(PolygonMesh.from_quads(zoo.smooth.twisted_ring(24, 2, 0.5)))


def record(quads: int, **more: object) -> dict:
    """A record without faults."""
    busy = {"optimise": 1.0, "merge": 1e-4 * quads**1.5, "sheets": 1e-3 * quads}
    usual = {
        "quads": quads,
        "sizes": [quads],
        "median": quads,
        "sheets": 1,
        "busy": busy,
        "ended_in": "sheets",
        "findings": [],
    }
    return {**usual, "rmse_mm": 0.1, "rmse_mm_before": 0.2, **more}


def test_the_summary_finds_what_is_amiss_and_how_the_cost_grows(zoo: ModuleType):
    records = {f"sound{n}": record(n) for n in (200, 300, 500, 800, 1200, 2000, 3000, 5000)}
    found = {row["row"]: row for row in zoo.summary.rows(records)}
    assert all(row["ok"] is not False for name, row in found.items() if "cost of merge" not in name)
    assert found["cost of merge by quads, exponent"]["measured"] == pytest.approx(1.5, abs=1e-3)
    assert found["cost of sheets by quads, exponent"]["measured"] == pytest.approx(1.0, abs=1e-3)
    records |= {
        "one-sided": {"quads": 9, "refused": "one side", "ended_in": "check", "to_be_refused": "non-orientable"},
        "late": {"quads": 400, "crashed": "given up", "ended_in": "merge"},
        "shattered": record(100, sizes=[1] * 100, median=1.0, alone=100, alone_own_e=1),
        "unknown": record(90, left_out=["Not simulated"]),
        "plain": record(90, busy={"simulate": 1.0}),
        "worse": record(90, worse=True),
        "broken": record(90, uncuttable=2),
        "flat": record(90, rms_percent=4.0, strain=0.0),
        "told": record(90, rms_percent=4.0, strain=0.0, findings=["stays-flat"]),
        "foreign/cmc1": record(240, patches=12.0),
    }
    del records["unknown"]["rmse_mm"]
    del records["plain"]["rmse_mm_before"]
    found = {row["row"]: row for row in zoo.summary.rows(records)}
    assert found["surfaces"]["measured"] == "18, 1 refused"
    assert found["wrongly refused or wrongly taken"]["ok"]
    assert found["without sheets"]["measured"] == "1: late"
    assert found["not optimised or not simulated"]["measured"] == "1: unknown"
    assert found["with sheets, %"]["measured"] == pytest.approx(100 * 16 / 17, abs=0.01)
    assert found["stay flat without a word"]["measured"] == "1: flat"
    assert found["worse than they began"]["measured"] == "1: worse"
    assert found["panels that cannot be cut"]["measured"] == "1: broken"
    assert found["patches of one quad for no reason of its own"]["measured"] == "1: shattered"
    assert found["median quads a patch"]["ok"] is False
    assert found["patches"]["ok"]
