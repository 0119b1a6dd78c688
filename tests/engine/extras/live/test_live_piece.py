"""A live piece: where it rests, that the newest change wins, that nothing is lost by what goes wrong."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from flexmaps.engine.extras.live import live_state as rigs
from flexmaps.engine.extras.live import session
from flexmaps.engine.extras.live.live_input import LiveInput
from flexmaps.engine.extras.live.live_piece import LiveEquilibrium, LivePiece
from flexmaps.engine.materials import find_material
from flexmaps.engine.mechanics.arms.model import ArmModel
from flexmaps.engine.mechanics.loads import parse_supports
from flexmaps.engine.params import LayoutParams, MaterialParams, SimulateParams, SpiralParams
from flexmaps.engine.patches.flattening.flatten import FlatPatches, flatten
from flexmaps.engine.patches.layout import PatchLayout
from flexmaps.engine.patches.tracing.trace import trace_layout
from flexmaps.engine.simulation.simulate import simulate
from flexmaps.engine.spirals.design import SpiralDesign
from flexmaps.engine.spirals.fabricable import uniform_design
from flexmaps.engine.surface import shapes
from flexmaps.engine.surface.mesh import QuadMesh
from flexmaps.engine.workers import Workers

SAME = 1e-5  # metres: the live tolerance, with room


@pytest.fixture(scope="module")
def dome() -> FlatPatches:
    return flatten(trace_layout(shapes.make("dome"), LayoutParams()), LayoutParams())


def given_of(flat: FlatPatches, twist: float = 1.5) -> LiveInput:
    made, mesh = uniform_design(flat, SpiralParams(), twist=twist), flat.layout.mesh
    cut, sizes = flat.layout.cut, np.full(len(mesh.quads), 4)
    rest = (made.params, LayoutParams(), MaterialParams().chosen, SimulateParams())
    return LiveInput(
        mesh.vertices, mesh.quads.ravel(), sizes, cut, cut, flat.corners, flat.energy, made.width, made.twist, *rest
    )


def followed(piece: LivePiece, wanted: LiveInput, since: LiveInput | None) -> LiveEquilibrium:
    piece.change(wanted.changes(since))
    return rested(piece)


def rested(piece: LivePiece) -> LiveEquilibrium:
    for _ in range(1000):
        shape = piece.advance()
        if shape.resting:
            return shape
    raise AssertionError("it never rests")


def simulated(given: LiveInput, flat: FlatPatches) -> np.ndarray:
    """The same by the stage that takes no short cut, begun from the target."""
    design = SpiralDesign(flat, given.spiral, given.width, given.twist)
    known = {"supports": given.supports, "force": given.force}
    return simulate(design, flat.layout.mesh, given.material, given.simulate, **known).vertices


def softer(given: LiveInput, where: slice) -> LiveInput:
    width, twist = given.width.copy(), given.twist.copy()
    width[where] *= 0.8
    twist[where] *= 1.3
    return replace(given, width=width, twist=twist)


CHANGES = {
    "stroke": lambda g, flat: softer(g, slice(40, 50)),
    "thickness": lambda g, flat: replace(g, spiral=replace(g.spiral, thickness=0.0025)),
    "material": lambda g, flat: replace(g, material=find_material("birch")),
    "weight": lambda g, flat: replace(
        g, simulate=replace(g.simulate, gravity=True), supports=parse_supports(flat.layout.mesh, "lowest")
    ),
}


@pytest.mark.parametrize("name", CHANGES)
def test_it_rests_where_a_simulation_does(dome: FlatPatches, name: str) -> None:
    """What is taken over from before a change must not be seen any more at rest."""
    piece, first = LivePiece(), given_of(dome)
    followed(piece, first, None)
    wanted = CHANGES[name](first, dome)
    shape = followed(piece, wanted, first)
    assert shape.converged and not shape.problem
    assert shape.vertices == pytest.approx(simulated(wanted, dome), abs=SAME)
    assert np.abs(shape.vertices - simulated(first, dome)).max() > 5 * SAME  # it has moved


def test_what_is_refined_in_parts_is_what_is_made_at_once(dome: FlatPatches, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where many joints change: first with the second order of another thickness, in the end with their own."""
    monkeypatch.setattr(rigs, "BATCH", 100)
    first = given_of(dome)
    thick = replace(first, spiral=replace(first.spiral, thickness=1.2 * first.spiral.thickness))
    old, pose = rigs.LiveState.from_input(first)
    rig, _ = rigs.LiveState.from_input(thick, old, pose)
    assert rig.strains_outdated.sum() == len(rig.model.pairs) > 300
    whole = ArmModel.from_assembly(rig.assembly, thick.material)
    assert not np.allclose(rig.model.curving, whole.curving)
    steps = rig.refine()
    with pytest.raises(StopIteration) as ended:
        while True:
            next(steps)
    refined = ended.value.value
    assert not refined.refinable
    for name in ("at_joint", "lever", "rest", "stiffness", "offset", "curving"):
        np.testing.assert_allclose(getattr(refined.model, name), getattr(whole, name), rtol=1e-12, atol=0.0)
    piece = LivePiece()
    followed(piece, first, None)
    assert followed(piece, thick, first).vertices == pytest.approx(simulated(thick, dome), abs=SAME)


def test_a_rim_comes_and_goes_and_follows_too(dome: FlatPatches) -> None:
    """A rim has bodies and joints of its own, which no piece without one knows."""
    piece, plain = LivePiece(), given_of(dome)
    rimmed = replace(plain, spiral=replace(plain.spiral, border="rim"))
    made = uniform_design(dome, rimmed.spiral, twist=1.5)
    rimmed = replace(rimmed, width=made.width, twist=made.twist)
    last = None
    for wanted in (plain, rimmed, softer(rimmed, slice(40, 50)), plain):
        shape = followed(piece, wanted, last)
        assert shape.converged and shape.vertices == pytest.approx(simulated(wanted, dome), abs=SAME)
        last = wanted


def test_seams_and_vertices_are_flattened_anew(dome: FlatPatches) -> None:
    piece, first = LivePiece(), given_of(dome)
    followed(piece, first, None)
    mesh, seams = dome.layout.mesh, dome.layout.cut.copy()
    sides = np.sort(dome.layout.patch_of[mesh.edge_quads], axis=1)
    between = seams & (sides[:, 0] != sides[:, 1])
    seams[between & (sides == sides[between][0]).all(axis=1)] = False
    opened = replace(first, seams=seams)
    shape = followed(piece, opened, first)
    # nothing else is known of the flat patches here than in Update from seams
    flat = flatten(PatchLayout(mesh, seams), LayoutParams(), previous=dome)
    assert shape.vertices == pytest.approx(simulated(opened, flat), abs=SAME)
    raised = (
        mesh.vertices
        + 0.004 * np.exp(-((np.linalg.norm(mesh.vertices - mesh.vertices[100], axis=1) / 0.03) ** 2))[:, None]
    )
    shape = followed(piece, replace(first, vertices=raised), opened)
    assert shape.converged
    assert np.abs(shape.vertices - simulated(first, dome)).max() > 1e-3


def test_the_newest_change_wins_and_undo_finds_its_shape_again(dome: FlatPatches) -> None:
    piece, first = LivePiece(), given_of(dome)
    before, known = followed(piece, first, None), first
    for k in range(4):  # a drag: nobody waits for rest
        wanted = replace(first, spiral=replace(first.spiral, thickness=0.002 + 0.0002 * k))
        piece.change(wanted.changes(known))
        piece.advance()
        known = wanted
    assert rested(piece).vertices == pytest.approx(simulated(known, dome), abs=SAME)
    after = followed(piece, first, known)
    assert np.abs(after.vertices - before.vertices).max() < 1e-9


def test_what_makes_no_piece_is_said_and_the_last_shape_stays(dome: FlatPatches) -> None:
    piece, first = LivePiece(), given_of(dome)
    before = followed(piece, first, None)
    heavy = replace(first, simulate=replace(first.simulate, gravity=True))
    shape = followed(piece, heavy, first)
    assert "supports" in shape.problem and not shape.converged
    assert np.array_equal(shape.vertices, before.vertices)
    hasty = replace(first, simulate=replace(first.simulate, iterations=1))
    far = replace(
        softer(hasty, slice(0, 120)), supports=np.array([0]), force=np.eye(3)[np.zeros(len(first.sizes), int)] * 3.0
    )
    shape = followed(piece, far, heavy)
    assert "No equilibrium" in shape.problem and not shape.converged
    assert np.array_equal(shape.vertices, before.vertices)
    assert followed(piece, first, far).problem == ""


def bump(n: int, height: float) -> QuadMesh:
    x, y = np.meshgrid(*2 * [np.linspace(-1.0, 1.0, n + 1)])
    z = height * np.cos(0.5 * np.pi * x) * np.cos(0.5 * np.pi * y)
    i = np.arange(n * n) // n * (n + 1) + np.arange(n * n) % n
    mesh = QuadMesh(np.stack([x, y, z], axis=2).reshape(-1, 3), np.stack([i, i + 1, i + n + 2, i + n + 1], axis=1))
    return mesh.with_vertices(mesh.vertices * (0.02 / mesh.median_edge))


def test_a_piece_that_snaps_is_told_and_comes_back() -> None:
    """A shell that is held round about and pushed down in its middle, until it does not come back by itself."""
    flat = flatten(trace_layout(bump(10, 0.8), LayoutParams()), LayoutParams())
    mesh = flat.layout.mesh
    rim = np.flatnonzero(mesh.border[mesh.quad_edges].any(axis=1))
    first = replace(given_of(flat, twist=0.3), supports=rim)
    piece = LivePiece()
    before, known = followed(piece, first, None), first
    top = np.linalg.norm(mesh.centroids - mesh.centroids[np.argmax(mesh.centroids[:, 2])], axis=1) < 0.045
    told = {}
    for newtons in (3.0, 60.0):
        force = np.zeros((len(mesh.quads), 3))
        force[top, 2] = -newtons / top.sum()
        wanted = replace(first, force=force)
        told[newtons] = followed(piece, wanted, known)
        known = wanted
    assert told[3.0].snapped == 0.0
    assert told[60.0].snapped > 20.0 and told[60.0].converged
    after = followed(piece, first, known)
    assert after.snapped == 0.0 and np.abs(after.vertices - before.vertices).max() < 1e-9


def test_in_a_process_of_its_own(dome: FlatPatches) -> None:
    first = given_of(dome)
    with Workers(1) as workers:
        assert (
            workers.submit(session.step_piece, session.LiveRequest("piece")).result() is None
        )  # nobody has sent it yet
        call = session.LiveRequest("piece", first.changes(None), whole=True)
        while not (shape := workers.submit(session.step_piece, call).result()).resting:
            call = session.LiveRequest("piece")
    assert shape.vertices == pytest.approx(simulated(first, dome), abs=SAME)


def test_only_what_differs_is_sent(dome: FlatPatches) -> None:
    first = given_of(dome)
    assert set(softer(first, slice(3)).changes(first)) == {"width", "twist"}
    assert first.mark == given_of(dome).mark != softer(first, slice(3)).mark
