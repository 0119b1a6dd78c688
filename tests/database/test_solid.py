"""The solid mesh, its elements and its equilibria against closed forms, finite differences and scikit-fem."""

from __future__ import annotations

import math
import runpy
import sys

import numpy as np
import pytest
from flexmaps.database import linear
from flexmaps.database.elastic import Elements
from flexmaps.database.geometry import Spiral, edge, outline
from flexmaps.database.solid import Fineness, make_solid
from flexmaps.database.statics import Model
from flexmaps.database.table import FINENESS
from flexmaps.engine.errors import FlexMapsError
from flexmaps.engine.mechanics.arms import beams
from flexmaps.engine.mechanics.arms.stiffness import ENTRIES, IN_PLANE, OUT_OF_PLANE
from flexmaps.engine.spirals.clearance.table_range import table_twist_limit
from scipy.spatial.transform import Rotation

wrong_blocks = sys.modules["flexmaps_taylor"].wrong_blocks
SMALL = Spiral(6.0, 1.0, 1.5)


def test_straight_cross_has_the_volume_of_its_outline():
    solid = make_solid(Spiral(10.0, 1.5, 0.0, fillet=0.05))
    elements = Elements(solid.nodes, solid.elements, 0.3)
    corner = (1.0 - math.pi / 4.0) * 0.05**2
    assert elements.weight.sum() == pytest.approx(1.5 * (2 * 10.0 - 1.0 + 4 * corner), rel=5e-4)


@pytest.mark.parametrize(("scale", "share"), [(5.0, 1.0), (7.0, 0.95), (10.0, 1.0), (30.0, 0.6), (50.0, 0.0)])
def test_region_can_be_meshed(scale, share):
    spiral = Spiral(scale, 1.0, share * float(table_twist_limit(scale)))
    solid = make_solid(spiral)
    tips = np.array([solid.nodes[t].mean(0) for t in solid.tips])
    assert np.allclose(tips, solid.tip_centres, atol=1e-9)
    assert sum(len(t) for t in solid.tips) == 64


def test_fillet_touches_both_edges():
    shape = outline(Spiral(10.0, 1.0, 3.0, fillet=0.1))
    near = edge(shape.spiral, np.linspace(0.0, 1.0, 20001), 0.5)
    assert np.abs(near - shape.centre).min() == pytest.approx(0.1, abs=1e-6)
    near = 1j * edge(shape.spiral, np.linspace(0.0, 1.0, 20001), -0.5)
    assert np.abs(near - shape.centre).min() == pytest.approx(0.1, abs=1e-6)


@pytest.mark.parametrize(
    "bad", [(10.0, 1.0, 7.5), (4.0, 1.0, 3.0), (-1.0, 1.0, 0.0), (10.0, -1.0, 0.0), (10.0, 1.0, math.nan)]
)
def test_what_cannot_be_cut_is_refused(bad):
    with pytest.raises(FlexMapsError):
        make_solid(Spiral(*bad))


@pytest.mark.parametrize("poisson", [0.0, 0.45, -0.2, math.nan])
def test_poisson_outside_its_range_is_refused(poisson):
    with pytest.raises(FlexMapsError, match="Poisson"):
        Model(SMALL, poisson)


def test_rigid_motion_costs_nothing():
    model = Model(SMALL, 0.3)
    turn = Rotation.from_rotvec([0.4, 2.0, -1.0]).as_matrix()
    moved = model.solid.nodes @ turn.T + [1.0, -2.0, 3.0] - model.solid.nodes
    el = model.elements
    f = el.gradients(moved)
    assert el.energy(el.strain(f)) < 1e-24
    assert np.abs(el.forces(f, el.stress(el.strain(f)))).max() < 1e-12
    rotations = model.frames(moved)[1]
    assert np.allclose(rotations, turn, atol=1e-10)


def test_forces_and_tangent_are_those_of_the_energy():
    """Block by block: the free nodes along x, y and z, and the mean-free motions of the held face."""
    model = Model(SMALL, 0.3)
    rng = np.random.default_rng(2)
    free, count = len(model.numbering.free), model.size
    q = 0.02 * rng.normal(size=count)

    def energy(step):
        return model.elements.energy(model.elements.strain(model.elements.gradients(model.expand(q + step))))

    f = model.elements.gradients(model.expand(q))
    stress = model.elements.stress(model.elements.strain(f))
    tangent = model.pattern.matrix(model.stiffness(f, stress))
    index = np.arange(count)
    blocks = {f"nodes along {axis}": 0.02 * ((index < free) & (index % 3 == k)) for k, axis in enumerate("xyz")}
    blocks["the held face"] = 0.02 * (index >= free)
    assert wrong_blocks(energy, model.inner_forces(f, stress), lambda v: tangent @ v, blocks) == []


@pytest.mark.parametrize(
    ("height", "twist"), [(1.0, 0.0), (0.5, 3.0), pytest.param(2.0, 6.0, marks=pytest.mark.thorough)]
)
def test_slender_arms_agree_with_castigliano(height, twist):
    model = Model(Spiral(80.0, height, twist), 0.3)
    compliance = linear.tip_compliance(model, linear.unit_motions(model))
    assert np.abs(compliance[np.ix_(IN_PLANE, OUT_OF_PLANE)]).max() < 1e-6 * np.abs(compliance).max()
    base = beams.beam_tip_compliance(np.array([80.0]), np.array([height]), np.array([twist]), 0.3).values[..., 0]
    for block, rows in zip(base, (IN_PLANE, OUT_OF_PLANE)):
        beam = np.zeros((3, 3))
        for value, (i, j) in zip(block, ENTRIES):
            beam[i, j] = beam[j, i] = value
        scale = np.diag([0.04, 0.04, 1.0] if rows == IN_PLANE else [0.04, 1.0, 1.0])
        true = np.linalg.eigvalsh(scale @ compliance[np.ix_(rows, rows)] @ scale)[-1]
        assert np.linalg.eigvalsh(scale @ beam @ scale)[-1] == pytest.approx(true, rel=0.03)


@pytest.mark.parametrize(
    ("scale", "height", "twist"),
    [(9.0, 1.0, 2.0), *(pytest.param(*one, marks=pytest.mark.thorough) for one in ((9.0, 3.0, 2.0), (20.0, 0.5, 3.0)))],
)
def test_stubs_of_arms_without_load_stand_for_whole_arms(scale, height, twist):
    spiral = Spiral(scale, height, twist)
    whole, cut = (Model(spiral, 0.3, FINENESS, whole=one) for one in (None, linear.TIP))
    assert len(cut.solid.elements) < len(whole.solid.elements)
    one, other = (linear.tip_compliance(m, linear.unit_motions(m)) for m in (whole, cut))
    assert np.abs(np.linalg.eigvals(np.linalg.solve(one, other)).real - 1.0).max() < 1e-5


@pytest.mark.thorough
def test_equilibrium_matches_scikit_fem(root):
    """An independent St. Venant-Kirchhoff solver: quadratic hexahedra of scikit-fem on a finer mesh, same loads."""
    pytest.importorskip("skfem")
    peer = runpy.run_path(str(root / "tools" / "peer_scikit.py"))
    model = Model(Spiral(6.0, 1.0, 0.0, fillet=0.04), 0.3)
    force = 1.5e-3
    wrenches = np.zeros((4, 6))
    wrenches[2, 2] = force
    ours = model.solve(model.loads(wrenches))
    assert ours.energy == pytest.approx(peer["cross_energy"](force, model.solid.nodes, ours.displacement), rel=0.005)


def test_full_load_in_one_step_and_energy_balance():
    model = Model(Spiral(20.0, 1.4, 3.0), 0.3)
    wrenches = np.zeros((4, 6))
    wrenches[1:, 2] = [8e-5, -4e-5, 6e-5]
    wrenches[2, :2] = [4e-5, -8e-5]
    found = model.solve(model.loads(wrenches))
    assert found.converged and found.steps == 1 and found.iterations <= 8
    assert np.linalg.norm(found.displacement, axis=1).max() > 2.0
    # the work of the growing load, by Gauss quadrature over its share, is the stored energy
    x, w = np.polynomial.legendre.leggauss(4)
    nodal = model.loads(wrenches)
    shares = 0.5 * (x + 1.0)
    reached = [float((nodal * model.solve(share * nodal).displacement).sum()) for share in shares]
    complementary = float(np.dot(0.5 * w, reached))
    total = float((nodal * found.displacement).sum())
    assert found.energy == pytest.approx(total - complementary, rel=2e-3)


def test_finer_mesh_changes_little():
    wrenches = np.zeros((4, 6))
    wrenches[1:, :3] = np.random.default_rng(2).normal(size=(3, 3)) * 2e-4
    coarse, fine = (
        Model(Spiral(10.0, 1.0, 3.5), 0.3, fineness)
        for fineness in (Fineness(), Fineness(length=1.25, turn=0.4, across=2))
    )
    energies = [m.solve(m.loads(wrenches)).energy for m in (coarse, fine)]
    assert energies[0] == pytest.approx(energies[1], rel=0.02)
