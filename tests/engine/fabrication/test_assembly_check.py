"""The check of the assembly against lengths, forces and strains that are known."""

from types import SimpleNamespace

import numpy as np
import pytest
from flexmaps.engine.fabrication import assembly_check as assembly_check
from flexmaps.engine.fabrication import joints
from flexmaps.engine.fabrication.connectors import connect as connectors
from flexmaps.engine.materials import MATERIALS
from flexmaps.engine.mechanics.arms.model import ArmModel
from flexmaps.engine.params import ConnectorParams, LayoutParams, SimulateParams, SpiralParams
from flexmaps.engine.patches.flattening.flatten import FlatPatches
from flexmaps.engine.patches.merging import merge
from flexmaps.engine.patches.tracing import trace
from flexmaps.engine.simulation import simulate
from flexmaps.engine.spirals import fabricable
from flexmaps.engine.surface import shapes

POM = MATERIALS["pom"]


def stretched(flat, patch, factor):
    """The same patches, one of them longer along y."""
    points = flat.points.copy()
    points[np.unique(flat.layout.flat_corners[flat.layout.patches[patch]])] *= [1.0, factor]
    return FlatPatches(flat.layout, points, flat.energy, flat.irregularity)


def test_lengths_of_both_sides(flat_grid):
    flat = stretched(flat_grid(4, 3, cut=lambda x, y: x == 2), 1, 1.08)
    (seam,) = assembly_check.check_assembly(fabricable.uniform_design(flat, SpiralParams())).seams
    assert sorted(seam.lengths) == pytest.approx([0.06, 0.0648])
    assert seam.mismatch == pytest.approx(0.08 / 1.04)
    assert seam.stretch == pytest.approx(0.08 / 1.04)
    assert (seam.joints, seam.panels, seam.difficulties) == (3, (1, 2), ("stretch",))
    assert seam.force is seam.moment is seam.load is None


def test_differences_along_a_seam_do_not_cancel(flat_grid):
    flat = flat_grid(4, 2, cut=lambda x, y: x == 2)
    points, right = flat.points.copy(), np.unique(flat.layout.flat_corners[flat.layout.patches[1]])
    middle = right[np.isclose(flat.points[right, 1], 0.02)]
    points[middle, 1] += 0.001
    found = assembly_check.check_assembly(
        fabricable.uniform_design(FlatPatches(flat.layout, points, flat.energy, flat.irregularity), SpiralParams())
    )
    (seam,) = found.seams
    assert seam.mismatch == pytest.approx(0.0, abs=1e-9)
    assert seam.stretch == pytest.approx(2 * 0.001 / 0.039)
    assert "5 %" in found.warnings[0] and "(A)" in found.warnings[0]


def test_sides_keep_together_within_one_panel():
    """Along a cut inside a panel both sides have the same patch: the path tells which is which."""
    params = LayoutParams()
    flat = merge.merge(trace.trace_layout(shapes.make("cubesphere"), params), params)
    made = fabricable.uniform_design(flat, SpiralParams())
    layout, mesh = flat.layout, flat.layout.mesh
    for seam, edges in zip(assembly_check.check_assembly(made).seams, layout.seams, strict=True):
        if seam.panels[0] != seam.panels[1] or len(edges) < 2:
            continue
        # by hand: walk along the vertices of the seam, always with the quad to the left
        walk = [set(mesh.edges[e].tolist()) for e in edges]
        start = (walk[0] - walk[1]).pop()
        left = 0.0
        for e, ends in zip(edges.tolist(), walk, strict=True):
            for quad, side in zip(mesh.edge_quads[e].tolist(), mesh.edge_sides[e].tolist(), strict=True):
                if mesh.quads[quad, side] == start:
                    left += np.linalg.norm(flat.corners[quad, (side + 1) % 4] - flat.corners[quad, side])
            (start,) = ends - {start}
        assert min(abs(x - left) for x in seam.lengths) < 1e-12


def hung(flat_grid, newtons, factor=1.0):
    """A strip that is held at one end and pulled in line at the other, its joints crossed by the force.

    factor : how many times its second panel is drawn too large
    """
    flat = stretched(flat_grid(4, 1, cut=lambda x, y: x == 2), 1, factor)
    made = fabricable.uniform_design(flat, SpiralParams(), width=0.002, twist=0.5)
    mesh = made.flat.layout.mesh
    force = np.zeros((4, 3))
    force[np.argmax(mesh.centroids[:, 0])] = [newtons, 0.0, 0.0]
    held = np.array([np.argmin(mesh.centroids[:, 0])])
    return made, simulate.simulate(made, mesh, POM, SimulateParams(), supports=held, force=force)


def test_the_force_of_a_pulled_strip(flat_grid):
    made, found = hung(flat_grid, 0.8)
    assert found.equilibrium.converged
    joined = connectors.connect(made, ConnectorParams())
    (seam,) = assembly_check.check_assembly(made, joined, found).seams
    assert seam.force == pytest.approx(0.8, rel=1e-5)  # statics
    assert seam.difficulties == ()
    size = joined.connectors[0].candidate.size
    tension = 0.8 / ((size.neck - size.clearance) * made.params.thickness) / (POM.youngs * POM.strain_limit)
    assert seam.load >= tension
    # a strip keeps its plane, so that what is beyond tension is bending in it
    bending = 6.0 * seam.moment / made.params.thickness / (size.neck - size.clearance) ** 2
    assert seam.load - tension == pytest.approx(bending / (POM.youngs * POM.strain_limit), rel=1e-4)


def test_unequal_sides_are_judged_by_the_force_where_it_is_known(flat_grid):
    made, found = hung(flat_grid, 0.8, factor=1.08)
    (unknown,) = assembly_check.check_assembly(made).seams
    (known,) = assembly_check.check_assembly(made, None, found).seams
    assert unknown.stretch == known.stretch > assembly_check.MAX_STRETCH
    assert unknown.difficulties == ("stretch",)
    assert known.force == pytest.approx(0.8, rel=1e-5) and known.difficulties == ()


@pytest.mark.parametrize("kind", ["none", "dovetail", "key", "tab"])
def test_necks_are_those_of_the_connectors(flat_grid, kind):
    made = fabricable.uniform_design(flat_grid(4, 2, cut=lambda x, y: x == 2), SpiralParams())
    joined = connectors.connect(made, ConnectorParams(connector=kind))
    neck = joints.list_necks(made, joined).width
    cut = made.flat.layout.cut
    arm = made.arms.joint_width[made.flat.layout.mesh.edge_quads[:, 0], made.flat.layout.mesh.edge_sides[:, 0]]
    np.testing.assert_array_equal(neck[~cut], arm[~cut])
    if kind in ("dovetail", "key"):
        assert len(joined.connectors) == 2
        assert (neck[cut] == [c.candidate.size.neck - c.candidate.size.clearance for c in joined.connectors]).all()
    else:
        np.testing.assert_array_equal(neck[cut], arm[cut])


def test_what_cannot_be_believed_is_not_told(flat_grid):
    made, found = hung(flat_grid, 0.8)
    for converged, locked in ((False, False), (True, True)):
        equilibrium = SimpleNamespace(pose=found.equilibrium.pose, converged=converged)
        doubtful = SimpleNamespace(model=found.model, material=POM, equilibrium=equilibrium, is_locked=locked)
        assert assembly_check.check_assembly(made, None, doubtful).seams[0].force is None


def test_hard_seams_are_named(flat_grid):
    made, found = hung(flat_grid, 0.8)
    weak = SimpleNamespace(
        model=found.model,
        equilibrium=found.equilibrium,
        material=SimpleNamespace(strength=1e-6 * POM.youngs),
        is_locked=False,
    )
    checked = assembly_check.check_assembly(made, None, weak)
    assert checked.seams[0].difficulties == ("load",)
    block = checked.report()
    assert block["hard"] == 1 and "beyond what the material bears" in block["warnings"][0]
    assert block["force_n_max"] == block["seams"][0]["force_n"] == pytest.approx(0.8, abs=1e-3)
    assert isinstance(found.model, ArmModel)


def _seam(name, *difficulties, force=None, moment=None, load=None, lengths=(0.1, 0.1), stretch=0.0):
    return assembly_check.SeamCheck(name, (1, 6), 3, lengths, stretch, force, moment, load, difficulties)


def test_the_report_is_in_millimetres_newtons_and_newton_millimetres():
    """The largest of every figure, whichever seam it is at, and of loads where they are known."""
    seams = (
        _seam("A", "load", force=1.5, moment=0.012, load=1.25, lengths=(0.1, 0.102), stretch=0.03),
        _seam("B", force=2.5, moment=0.004, load=0.5, lengths=(0.0512352, 0.05), stretch=0.01),
        _seam("C", "stretch", stretch=0.06),
    )
    report = assembly_check.AssemblyCheck(seams).report()
    assert (report["force_n_max"], report["moment_n_mm_max"], report["load_max"]) == (2.5, 12.0, 1.25)
    assert report["mismatch_max"] == pytest.approx(0.0012352 / 0.0506176, abs=1e-5)
    assert report["stretch_max"] == 0.06 and report["hard"] == 2
    first, second, third = report["seams"]
    assert first["lengths_mm"] == [100.0, 102.0] and second["lengths_mm"] == [51.235, 50.0]
    assert first["mismatch"] == pytest.approx(0.002 / 0.101, abs=1e-5)
    assert (first["force_n"], first["moment_n_mm"], first["load"]) == (1.5, 12.0, 1.25)
    assert first["panels"] == ["1", "6."] and first["hard"] == ["load"]
    assert not {"force_n", "moment_n_mm", "load"} & set(third)
    unknown = assembly_check.AssemblyCheck(seams[2:]).report()
    assert not {"force_n_max", "moment_n_mm_max", "load_max"} & set(unknown)
    assert assembly_check.AssemblyCheck(()).report()["stretch_max"] == 0.0


@pytest.mark.parametrize(("count", "end"), [(8, "A, B, C, D, E, F, G, H)"), (9, "A, B, C, D, E, F, G, H, ...)")])
def test_every_reason_names_its_first_seams(count, end):
    seams = (*(_seam("ABCDEFGHJ"[k], "force") for k in range(count)), _seam("K", "stretch", "load"), _seam("L"))
    stretch, force, load = assembly_check.AssemblyCheck(seams).warnings
    assert force.startswith(f"Hard to assemble, {count} of {count + 2} seams (") and end in force
    assert force.endswith("a joint pulls with more than 20 N; a thinner sheet or thinner arms help")
    assert stretch.startswith(f"Hard to assemble, 1 of {count + 2} seams (K): the two sides of an edge differ")
    assert load.startswith(f"Hard to assemble, 1 of {count + 2} seams (K): a connector would be strained")


def test_a_joint_is_hard_beyond_its_limits_and_not_at_them(flat_grid, monkeypatch):
    made, found = hung(flat_grid, 0.8)
    monkeypatch.setattr(assembly_check, "MAX_HAND_FORCE", 0.8 * (1.0 + 1e-4))
    (seam,) = assembly_check.check_assembly(made, None, found).seams
    assert seam.difficulties == ()
    monkeypatch.setattr(assembly_check, "MAX_HAND_FORCE", 0.8 * (1.0 - 1e-4))
    monkeypatch.setattr(assembly_check, "MAX_LOAD", 0.999 * seam.load)
    (seam,) = assembly_check.check_assembly(made, None, found).seams
    assert seam.difficulties == ("force", "load")
