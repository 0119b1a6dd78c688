"""Supports and loads: what they hold, what they leave free, and what is refused."""

from __future__ import annotations

import sys

import numpy as np
import pytest
from flexmaps.engine.errors import FlexMapsError
from flexmaps.engine.mechanics.arms.model import ArmModel
from flexmaps.engine.mechanics.equilibrium import other_minima, solve
from flexmaps.engine.mechanics.loads import Loads, parse_supports
from flexmaps.engine.mechanics.newton_system import NewtonSystem
from flexmaps.engine.mechanics.rigid import movable_pieces
from flexmaps.engine.params import SimulateParams
from flexmaps.engine.surface import shapes
from scipy.spatial.transform import Rotation

chains = sys.modules["flexmaps_chains"]
SPACING, VERO, row, straight, ring, shaken, free = (
    getattr(chains, name) for name in ("SPACING", "VERO", "row", "straight", "ring", "shaken", "free")
)


def test_pinned_supports_let_the_ends_turn() -> None:
    count = 9
    start = straight(count)
    force = np.zeros((count, 3))
    force[:, 2] = -0.01
    ends = np.array([0, count - 1])
    model = ArmModel.from_assembly(row(count), VERO)
    sag = [
        solve(model, start, Loads.for_spirals(count, supports=ends, clamped=c, force=force), SimulateParams()).pose
        for c in (True, False)
    ]
    assert sag[0].rotations[0] == pytest.approx(np.eye(3))
    assert abs(sag[1].rotations[0][0, 2]) > 1e-3
    assert sag[1].centres[4, 2] < sag[0].centres[4, 2] < 0.0


@pytest.mark.parametrize(
    "make, message",
    [
        (lambda: Loads.for_spirals(5, supports=np.array([], dtype=int)), "group of the supports"),
        (lambda: Loads.for_spirals(5, supports=np.array([7])), "there are only 5"),
        (lambda: Loads.for_spirals(5, force=np.full((5, 3), np.nan)), "finite"),
    ],
)
def test_bad_supports_are_refused(make: object, message: str) -> None:
    with pytest.raises(FlexMapsError, match=message):
        make()


@pytest.mark.parametrize(
    "which",
    ["99999999999999999999", "9" * 5000, [10**30], "-1", "150", "1.5", "1_0", "", " , ", [1, 2.5], ["3", "x"], [],
     "\N{FULLWIDTH DIGIT ONE},\N{FULLWIDTH DIGIT TWO}", "\N{ARABIC-INDIC DIGIT THREE}"],
)  # fmt: skip
def test_supports_that_name_no_quad_are_refused(which: object) -> None:
    """Digits of other scripts among them: what looks like a number here but not there is better typed again."""
    with pytest.raises(FlexMapsError, match=r"Supports '|cannot be a support|list of supports is empty") as caught:
        parse_supports(shapes.make("cubesphere"), which)  # type: ignore[arg-type]
    assert len(str(caught.value)) < 200


def test_supports_by_number() -> None:
    mesh = shapes.make("cubesphere")
    assert parse_supports(mesh, " 3, +4 ,3").tolist() == [3, 4]
    assert parse_supports(mesh, np.array([149, 0])).tolist() == [0, 149]


def test_weight_without_supports_names_the_piece() -> None:
    assembly = row(6)
    apart = assembly.part(np.arange(6), np.array([0, 1, 3, 4]))
    model = ArmModel.from_assembly(apart, VERO)
    loads = Loads.for_spirals(6, supports=np.array([0]), mass=np.full(6, 0.001))
    with pytest.raises(FlexMapsError, match="nothing holds") as caught:
        solve(model, straight(6), loads, SimulateParams())
    assert caught.value.faces == [3, 4, 5]


@pytest.mark.parametrize("hinges", [[], [3], [0, 5], [2, 3, 4], [0, 1, 6], [0, 1, 2, 3, 4, 5, 6, 7, 8]])
def test_hinges_hold_no_more_than_they_should(hinges: list[int]) -> None:
    """What they leave free to move as a whole changes nothing: energy and strain are those of the free piece, and the
    increments that are held in its place carry no force. Rows and single hinges leave turns; a bent row leaves none.
    """
    count = 9
    assembly = row(count, twist=0.6, closed=True)
    model, start = ArmModel.from_assembly(assembly, VERO), ring(count)
    loads = Loads.for_spirals(count, supports=np.array(hinges, dtype=int) if hinges else None, clamped=False)
    found = solve(model, start, loads, SimulateParams())
    assert found.converged
    forces = model.expand(model.start(found.pose)).gradient
    held = loads.held_increments(model.pairs, found.pose.centres)
    size = np.abs(forces[~loads.fixed]).max()
    assert size < 1e-7 * max(np.abs(model.expand(model.start(found.pose)).convex).max() * SPACING, 1e-12)
    extra = held & ~loads.fixed
    on_a_line = len(hinges) in (0, 1, 2)
    assert extra.sum() == {0: 6, 1: 3, 2: 1}.get(len(hinges), 0) and (on_a_line or not extra.any())
    if len(hinges) < 2:
        assert found.energy == pytest.approx(solve(model, start, free(count), SimulateParams()).energy, rel=1e-9)


def test_hinges_in_a_row_leave_the_turn_about_it() -> None:
    """All spirals of a flat strip on one line: the roll about it costs nothing, and weight beside the line turns it."""
    count = 6
    model = ArmModel.from_assembly(row(count), VERO)
    loads = Loads.for_spirals(count, supports=np.arange(count), clamped=False)
    found = solve(model, straight(count), loads, SimulateParams())
    assert found.converged and found.pose.centres == pytest.approx(straight(count).centres)
    (left,) = movable_pieces(loads.fixed, model.pairs, straight(count).centres)
    assert left.entries.tolist() == [3]
    assert np.abs(left.motions[0, 3:] / np.linalg.norm(left.motions[0, 3:])) == pytest.approx([1, 0, 0], abs=1e-9)


def test_what_swings_about_its_hinges_is_refused() -> None:
    model, force = ArmModel.from_assembly(row(6), VERO), np.zeros((6, 3))
    force[5, 2] = -0.01
    with pytest.raises(FlexMapsError, match="one hinge") as caught:
        solve(
            model,
            straight(6),
            Loads.for_spirals(6, supports=np.array([1]), clamped=False, force=force),
            SimulateParams(),
        )
    assert caught.value.faces == list(range(6))
    bent = ring(6)
    force[5] = [0.0, 0.01, 0.0]
    with pytest.raises(FlexMapsError, match="hinges in a line"):
        solve(
            model, bent, Loads.for_spirals(6, supports=np.array([1, 2]), clamped=False, force=force), SimulateParams()
        )
    # pulled away from its hinge in a straight line it only grows longer
    force[5] = [0.01, 0.0, 0.0]
    found = solve(
        model, straight(6), Loads.for_spirals(6, supports=np.array([0]), clamped=False, force=force), SimulateParams()
    )
    assert found.converged and found.pose.centres[5, 0] > 5.0 * SPACING


@pytest.mark.parametrize("hinges", [[], [2], [0, 4]])
def test_pieces_are_laid_as_near_as_their_supports_allow(hinges: list[int]) -> None:
    """A piece that has only been moved by what is left free comes back to its target exactly."""
    target = ring(7)
    fixed = np.zeros((7, 6), dtype=bool)
    fixed[hinges, :3] = True
    loads = Loads(fixed, np.zeros((7, 3)))
    pairs = row(7, closed=True).pairs
    axis = target.centres[4] - target.centres[0]
    turn = {0: [0.3, -0.7, 0.2], 1: [0.3, -0.7, 0.2], 2: 0.8 * axis / np.linalg.norm(axis)}[len(hinges)]
    rotation = Rotation.from_rotvec(turn).as_matrix()
    pivot = target.centres[hinges[0]] if hinges else np.array([0.1, 0.2, 0.3])
    moved = target.transform(rotation, pivot - rotation @ pivot)
    back = loads.align(moved, pairs, target)
    assert back.centres == pytest.approx(target.centres, abs=1e-12)
    assert back.rotations == pytest.approx(target.rotations, abs=1e-12)


@pytest.mark.parametrize("backend", ["cvxopt", "superlu"])
@pytest.mark.parametrize("free_hubs", [0, 1, 2])
def test_all_or_nearly_all_held(backend: str, free_hubs: int) -> None:
    """Nothing, or hardly anything, is left to seek: still an equilibrium, with its softest motions and other shapes."""
    count = 8
    model, start = ArmModel.from_assembly(row(count, closed=True), VERO), shaken(ring(count), 0.001, 0.1)
    loads = Loads.for_spirals(count, supports=np.arange(count - free_hubs))
    system = NewtonSystem(model.pairs, loads.held_increments(model.pairs, start.centres), backend)
    found = solve(model, start, loads, SimulateParams(), system=system)
    assert found.converged
    here = model.expand(model.start(found.pose))
    modes, rise = system.softest_modes(system.values(here.hessian), system.values(here.convex), 3)
    assert modes.shape[1:] == (count, 6) and (rise > 0).all() and not modes[:, loads.fixed].any()
    assert other_minima(model, found, loads, SimulateParams(restarts=2)) == []
    assert system.solve(np.ones((count, 6)))[loads.fixed] == pytest.approx(0)


def test_forces_that_turn_an_unsupported_piece_are_refused() -> None:
    model, force = ArmModel.from_assembly(row(4), VERO), np.zeros((4, 3))
    force[0, 2], force[3, 2] = 0.01, -0.01
    with pytest.raises(FlexMapsError, match="turn a piece"):
        solve(model, straight(4), Loads.for_spirals(4, force=force), SimulateParams())
    # pulled apart along its length it only grows longer
    force[:] = 0.0
    force[0, 0], force[3, 0] = -0.01, 0.01
    found = solve(model, straight(4), Loads.for_spirals(4, force=force), SimulateParams())
    assert found.converged and np.ptp(found.pose.centres[:, 0]) > 3 * SPACING
