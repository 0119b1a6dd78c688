"""Panels turned each for itself: what one Newton step foretells, against equilibria, and that nothing gets worse."""

from dataclasses import replace

import numpy as np
import pytest
from flexmaps.engine.optimisation import panel_grain
from flexmaps.engine.params import Settings, with_values
from flexmaps.engine.runs import job
from flexmaps.engine.simulation.simulate import simulate
from flexmaps.engine.surface.mesh import PolygonMesh, QuadMesh

BIRCH = {"material.material": "birch", "sheet.rotation": "GRAIN", "optimise.iterations": 1}


# both short borders: a free bowl lies flat, and nothing in it depends on its arms
ENDS = np.flatnonzero(np.isin(np.arange(24) % 6, (0, 5)))


@pytest.fixture(scope="module")
def settings():

    return with_values(Settings(), BIRCH | {"optimise.codesign": False, "simulate.tolerance": 1e-9})


@pytest.fixture(scope="module")
def piece(settings):
    """A bowl of 4 x 6 quads in two panels."""
    x, y = np.meshgrid(np.arange(-2.0, 3.0), np.arange(-3.0, 4.0), indexing="ij")
    points = 0.02 * np.stack([x, y, 0.08 * (x * x + 0.5 * y * y)], axis=-1).reshape(-1, 3)
    corner = np.arange(35).reshape(5, 7)
    quads = np.stack([corner[:-1, :-1], corner[1:, :-1], corner[1:, 1:], corner[:-1, 1:]], axis=-1).reshape(-1, 4)
    mesh = QuadMesh(points, quads)
    made = job.run(PolygonMesh.from_quads(mesh), settings, stop_after="check")
    cut = np.abs(mesh.vertices[mesh.edges][..., 1]).max(axis=1) < 1e-9
    made = job.go_on(job.flattened(made, cut, settings.layout), settings, ("spirals",))
    assert len(made.flat.layout.patches) == 2
    return made


def _rested(piece, settings, design, start=None):
    return simulate(
        design, piece.mesh, settings.material.chosen, settings.simulate, supports=ENDS, start=start, quick=True
    )


def test_turned_panels_keep_their_shape_and_half_a_turn_is_none(piece, settings):
    flat = panel_grain.rotate_panels(piece.flat, np.array([0.3, np.pi]))
    for side in range(4):
        before, after = (np.roll(f.corners, -side, axis=1)[:, 1] - f.corners[:, 0] for f in (piece.flat, flat))
        assert np.linalg.norm(after, axis=1) == pytest.approx(np.linalg.norm(before, axis=1))
    cross = [np.cross(f.corners[:, 1] - f.corners[:, 0], f.corners[:, 2] - f.corners[:, 0]) for f in (piece.flat, flat)]
    assert cross[1] == pytest.approx(cross[0])
    half = replace(piece.design, flat=panel_grain.rotate_panels(piece.flat, np.array([np.pi, 0.0])))
    one, two = (_rested(piece, settings, design).match["rms_mm"] for design in (piece.design, half))
    assert two == pytest.approx(one, rel=1e-6)
    quarter = replace(piece.design, flat=panel_grain.rotate_panels(piece.flat, np.array([0.5 * np.pi, 0.0])))
    assert abs(_rested(piece, settings, quarter).match["rms_mm"] / one - 1.0) > 1e-3


def test_one_newton_step_foretells_where_hubs_go_when_a_panel_is_turned_a_little(piece, settings):
    found = _rested(piece, settings, piece.design)
    angle = np.radians(0.5)
    moved = panel_grain.predict_shifts(found, np.array([0.0, angle]))
    assert not moved[0].any()
    for patch in (0, 1):
        turns = np.where(np.arange(2) == patch, angle, 0.0)
        again = replace(piece.design, flat=panel_grain.rotate_panels(piece.flat, turns))
        start = panel_grain._with_rotated_frames(found.equilibrium.pose, piece.design, turns)
        there = _rested(piece, settings, again, start)
        true = there.equilibrium.pose.centres - found.equilibrium.pose.centres
        assert np.abs(moved[1, patch] - true).max() < 0.02 * np.abs(true).max()


def test_chosen_turns_are_never_farther_and_stay_on_the_sheet(piece, settings):
    how = settings.material.chosen, "free", settings.simulate
    found = panel_grain.choose_grain(piece.design, piece.mesh, *how, settings.sheet, supports=ENDS)
    assert found.after < found.before
    assert found.turns.any()
    again = _rested(piece, settings, found.design)
    assert 1e-3 * again.match["rms_mm"] == pytest.approx(found.after, rel=1e-3)
    # a sheet on which panels have room only as they lie
    sizes = np.array([np.ptp(piece.flat.corners[quads].reshape(-1, 2), axis=0) for quads in piece.flat.layout.patches])
    width, height = (sizes.max(axis=0) + 2.0 * settings.sheet.margin + 1e-4).tolist()
    narrow = replace(settings.sheet, sheet_width=width, sheet_height=height)
    kept = panel_grain.choose_grain(piece.design, piece.mesh, *how, narrow, supports=ENDS)
    assert not panel_grain.fits_sheet(piece.flat, 0.5 * np.pi, 0.0, narrow).any()
    turned = panel_grain.rotate_panels(piece.flat, kept.turns)
    assert panel_grain.fits_sheet(turned, 0.0, 0.0, narrow).all()


def test_optimising_turns_panels_only_where_it_is_asked_to_and_there_is_a_grain(piece, settings):
    piece = replace(piece, supports=ENDS)
    made = job.go_on(piece, with_values(settings, {"optimise.grain": "free"}), ("optimise",))
    assert np.abs(made.flat.points - piece.flat.points).max() > 1e-3
    assert np.array_equal(made.design.flat.points, made.flat.points)
    for more in ({"optimise.grain": "common"}, {"optimise.grain": "free", "material.material": "pom"}):
        plain = job.go_on(piece, with_values(settings, more), ("optimise",))
        assert np.array_equal(plain.flat.points, piece.flat.points)
