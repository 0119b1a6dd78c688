"""The main job without Blender: what could not be done, what it says of its result, and odd sheets, sizes and loads."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from flexmaps.engine.errors import FlexMapsError
from flexmaps.engine.params import Settings
from flexmaps.engine.patches.flattening import flatten
from flexmaps.engine.patches.layout import PatchLayout
from flexmaps.engine.progress import Progress
from flexmaps.engine.runs import job, manual_changes, report
from flexmaps.engine.simulation.shortfall import quad_curvatures
from flexmaps.engine.surface import shapes
from flexmaps.engine.surface.mesh import PolygonMesh, QuadMesh

UP_TO_SHEETS = ("trace", "merge", "split", "spirals", "optimise", "simulate", "sheets")


def hill(count: int = 4, edge: float = 0.02, height: float = 0.15) -> PolygonMesh:
    """A square of ``count`` x ``count`` quads that rises to ``height`` of its width in the middle."""
    x, y = np.meshgrid(np.linspace(-0.5, 0.5, count + 1), np.linspace(-0.5, 0.5, count + 1), indexing="ij")
    z = height * np.cos(np.pi * x) * np.cos(np.pi * y)
    corner = np.arange((count + 1) ** 2).reshape(count + 1, count + 1)
    quads = np.stack([corner[:-1, :-1], corner[1:, :-1], corner[1:, 1:], corner[:-1, 1:]], axis=-1).reshape(-1, 4)
    points = count * edge * np.stack([x, y, z], axis=-1).reshape(-1, 3)
    return PolygonMesh(points, quads.ravel(), np.full(len(quads), 4))


def quick(**simulate: object) -> Settings:
    """No search for the best nesting and a short one for spirals."""
    base = Settings()
    return replace(
        base,
        sheet=replace(base.sheet, nesting="FAST"),
        optimise=replace(base.optimise, iterations=1, codesign=False, restart=False),
        simulate=replace(base.simulate, **simulate),  # type: ignore[arg-type]
    )


def test_what_could_not_be_done_is_told_and_forgotten_when_it_can() -> None:
    hanging = quick(gravity=True)  # and no supports
    made = job.run_stages(job.check_input(hill()), hanging, UP_TO_SHEETS, lenient=True)
    assert made.sheets is not None and made.simulation is None and made.optimisation is None
    described = report.build_report(made, source="hill", settings=hanging)
    assert described["undone"] == ["optimise", "simulate"]
    assert [c["code"] for c in described["checks"]] == ["not-optimised", "not-simulated"]
    assert all("supports" in c["message"] and len(c["faces"]) == 16 for c in described["checks"])
    # simulated without its weight: only that it was not optimised is left to tell
    again = job.run_stages(made, quick(), ("simulate",))
    assert again.simulation is not None and list(again.undone) == ["optimise"]
    better = job.run_stages(again, quick(), ("optimise", "simulate"))
    described = report.build_report(better, source="hill", settings=quick())
    assert "undone" not in described and described["checks"] == []
    # other spirals: what was told of the old ones is out of date
    assert job.run_stages(made, quick(), ("spirals",)).undone == {}


def test_a_later_failure_drops_what_the_stage_had_made() -> None:
    made = job.run_stages(job.check_input(hill()), quick(), (*UP_TO_SHEETS[:4], "simulate"))
    assert made.simulation is not None
    failed = job.run_stages(made, quick(gravity=True), ("simulate", "sheets"), lenient=True)
    assert failed.simulation is None and list(failed.undone) == ["simulate"] and failed.sheets is not None
    with pytest.raises(FlexMapsError, match="nothing holds"):
        job.run_stages(made, quick(gravity=True), ("simulate",), lenient=True)


@pytest.mark.parametrize("edge", [0.1, 0.003])
def test_slender_and_stout_spirals_are_simulated(edge: float) -> None:
    """Cut-outs of 60 s/w, and quads so small that their arms are thinner than asked for."""
    base = quick()
    settings = replace(base, spiral=replace(base.spiral, width_max=0.0017))
    made = job.run(hill(edge=edge), settings, stop_after="simulate")
    assert made.simulation is not None and made.simulation.equilibrium.converged
    codes = {f.code for f in made.simulation.findings}
    assert "beyond-model" not in codes
    if edge > 0.05:
        assert made.design is not None and (made.design.scale[:, None] / made.design.width).max() > 55.0


@pytest.mark.parametrize("model", ["arm", "rod"])
def test_spirals_outside_the_model_are_named_and_simulated(model: str) -> None:
    base = quick(model=model)
    settings = replace(base, spiral=replace(base.spiral, thickness=0.0002))
    made = job.run(hill(), settings, stop_after="simulate")
    assert made.simulation is not None and made.simulation.equilibrium.converged
    (found,) = [f for f in made.simulation.findings if f.code == "beyond-model" and "width / thickness" in f.message]
    assert len(found.faces) == 16 and found.severity == "warning"
    assert report.build_report(made, source="hill")["equilibrium"]["findings"]


def test_one_quad_by_itself_takes_nothing_from_the_others() -> None:
    """It is named, and the other body comes to rest as if it were not there; supports of one body are none of the other."""
    dome = hill(5, height=0.3)
    beside = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]) * 0.02 + 0.2
    points, corners = (
        np.concatenate([dome.vertices, beside]),
        np.append(dome.corners, len(dome.vertices) + np.arange(4)),
    )
    both = PolygonMesh(points, corners, np.append(dome.sizes, 4))
    shapes_found = []
    for polygons in (dome, both):
        made = job.run(polygons, quick(), stop_after="optimise", supports=[0, 4])
        assert made.optimisation is not None
        shapes_found.append(made.optimisation.before)
    alone, together = shapes_found
    assert together.equilibrium.pose.centres[:25] == pytest.approx(alone.equilibrium.pose.centres, abs=1e-5)
    assert [f.faces for f in together.findings if f.code == "joined-to-nothing"] == [(25,)]
    with pytest.raises(FlexMapsError, match="nothing can bend"):
        job.run(PolygonMesh(beside, np.arange(4), np.array([4])), quick(), stop_after="simulate")


def laid_out(polygons: PolygonMesh, cut_at: float | None = None, supports: str | None = None) -> job.Result:
    """One panel, or two with a seam along x = ``cut_at`` metres, simulated as it comes."""
    settings = quick()
    begun = job.check_input(polygons, supports=supports)
    mesh = begun.mesh
    x = mesh.vertices[mesh.edges, 0]
    cuts = np.zeros(len(mesh.edges), dtype=bool) if cut_at is None else (np.abs(x - cut_at) < 1e-9).all(axis=1)
    flat = flatten.flatten(PatchLayout(mesh, cuts & ~mesh.border), settings.layout)
    return job.run_stages(manual_changes.with_manual_layout(begun, flat, settings), settings, ("spirals", "simulate"))


def test_a_seamless_dome_that_nothing_holds_is_said_to_stay_flat() -> None:
    """No strain, every joint closed, and no success: the sentence offers supports and a cut, and both do help."""
    dome = hill(10, height=0.4)
    made = laid_out(dome)
    assert made.simulation is not None and made.limits is not None
    assert made.simulation.strain is not None and made.simulation.strain.max() < 1e-3
    (found,) = made.simulation.findings
    assert found.code == "stays-flat" and "supports" in found.message and "cut it" in found.message
    assert (
        len(found.edges) == 10
        and np.ptp(made.mesh.vertices[made.mesh.edges[list(found.edges)]].reshape(-1, 3)[:, :2], axis=0).min() < 1e-9
    )
    assert "stays flat" in made.limits.advice and "narrower" not in made.limits.advice
    rms = made.simulation.report()["rms_percent"]
    for other in (laid_out(dome, supports="lowest"), laid_out(dome, cut_at=0.0)):
        assert other.simulation is not None and other.limits is not None
        assert other.simulation.report()["rms_percent"] < 0.5 * rms
        assert "stays flat" not in other.limits.advice


def test_bodies_that_stay_flat_alike_are_told_of_once() -> None:
    """Two domes beside each other: one finding that names places of both."""
    one = hill(8, height=0.4)
    count = len(one.vertices)
    points = np.concatenate([one.vertices, one.vertices + np.array([1.0, 0.0, 0.0])])
    corners = np.concatenate([one.corners, one.corners + count])
    made = laid_out(PolygonMesh(points, corners, np.concatenate([one.sizes, one.sizes])))
    assert made.simulation is not None
    (found,) = made.simulation.findings
    assert found.code == "stays-flat" and {made.mesh.body_of[face] for face in found.faces} == {0, 1}
    assert set(made.mesh.body_of[made.mesh.edge_quads[list(found.edges)]].ravel()) == {0, 1}


def test_a_further_cut_is_not_offered_where_it_would_not_help() -> None:
    """A vault that is curved one way only stays flat before it is optimised; without a seam it always does, held it does not."""
    vault = hill(10)
    points = vault.vertices.copy()
    points[:, 2] = 0.06 * np.cos(np.pi * points[:, 0] / 0.2)
    bent = PolygonMesh(points, vault.corners, vault.sizes)
    for cut_at in (None, 0.0):
        made = laid_out(bent, cut_at)
        assert made.simulation is not None
        (found,) = made.simulation.findings
        assert found.code == "stays-flat" and "supports" in found.message
        assert ("cut it" in found.message) is (cut_at is None)
    held = laid_out(bent, supports="lowest")
    assert held.simulation is not None and held.simulation.findings == []


def test_total_curvature_is_that_of_gauss_and_bonnet() -> None:
    """A cube has 4 pi, in its corners, and none of it within its faces; the ball's skew quads add a little to it."""
    points = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=float)
    cube = QuadMesh(
        points, np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])
    )
    for mesh, slack in ((cube, 1e-12), (shapes.make("cubesphere"), 1.0)):
        uncut, cut = (PatchLayout(mesh, np.full(len(mesh.edges), c)) for c in (False, True))
        assert quad_curvatures(uncut).sum() == pytest.approx(4.0 * np.pi, abs=slack)
        assert quad_curvatures(cut).sum() == pytest.approx(0.0, abs=slack)


def test_a_job_may_end_with_the_check() -> None:
    made = job.run(PolygonMesh.from_quads(shapes.make("strip")), Settings(), stop_after="check")
    assert made.mesh is not None and made.layout is None
    assert job.run_stages(made, Settings(), ()).layout is None


def test_many_nearly_empty_sheets_are_refused_before_a_search() -> None:
    usual = quick()
    settings = replace(usual, sheet=replace(usual.sheet, sheet_width=0.08, sheet_height=0.08, margin=0.0))
    seen: list[str] = []
    with pytest.raises(FlexMapsError, match="sheets of 80 x 80 mm would be cut"):
        job.run(hill(5, 0.05), settings, optimised=True, progress=Progress(lambda _, text: seen.append(text)))
    assert "Spirals" in seen and "Optimise" not in seen
