"""What is optimised: what bends and places count, strains that stay within their limit, and what is said of those that do not."""

import dataclasses
from functools import lru_cache

import numpy as np
import pytest
from flexmaps.engine.errors import FlexMapsError
from flexmaps.engine.materials import MATERIALS
from flexmaps.engine.mechanics.assembly import Pose
from flexmaps.engine.optimisation import optimise
from flexmaps.engine.optimisation.match_limits import find_limits
from flexmaps.engine.optimisation.objective import Target
from flexmaps.engine.optimisation.wishes import Wishes
from flexmaps.engine.params import OptimiseParams, Settings, SimulateParams
from flexmaps.engine.runs import job
from flexmaps.engine.simulation.simulate import simulate
from flexmaps.engine.spirals.design import SpiralDesign
from flexmaps.engine.surface import shapes
from flexmaps.engine.surface.mesh import PolygonMesh, QuadMesh
from scipy.spatial.transform import Rotation

VERO = MATERIALS["vero"]


@lru_cache(maxsize=2)
def made(name: str = "dome") -> tuple[SpiralDesign, QuadMesh]:
    found = job.run(PolygonMesh.from_quads(shapes.make(name, 0.03)), Settings(), edge=0.02, stop_after="spirals")
    assert found.design is not None
    return found.design, found.mesh


@pytest.mark.thorough
def test_strains_end_within_their_limit() -> None:
    """Where the best match is strained far more than it may be, and the limit is within reach."""
    design, mesh = made()

    def found(share: float) -> optimise.Optimisation:
        params = OptimiseParams(strain_share=share, codesign=False, iterations=20)
        return optimise.optimise(design, mesh, VERO, params, SimulateParams())

    loose = found(0.0)
    assert loose.after.strain is not None
    limit = 0.8 * float(loose.after.strain.max())
    held = found(limit)
    assert held.after.strain is not None
    assert held.after.strain.max() <= limit
    assert held.report()["strain_share_max"] == held.after.strain.max()
    assert held.report()["laplacian_rmse_mm"] < held.report()["laplacian_rmse_mm_before"]


def test_what_is_strained_too_much_is_named_with_advice() -> None:
    design, mesh = made()
    weak = dataclasses.replace(VERO, strain_limit=0.05 * VERO.strain_limit)
    found = simulate(design, mesh, weak, SimulateParams())
    assert found.strain is not None
    named = [one for one in found.findings if one.code == "strained"]
    assert len(named) == 1 and set(named[0].faces) == set(np.flatnonzero(found.strain > 1.001).tolist())
    assert "what the material bears" in find_limits(found).advice
    assert not [one for one in simulate(design, mesh, VERO, SimulateParams()).findings if one.code == "strained"]


def test_a_long_bend_counts_by_where_it_leads_though_neighbours_hardly_feel_it() -> None:
    """A row of spirals bent to a wide arc: its ends lie far away, and still no spiral lies far from its neighbours' mean."""
    x = 0.02 * np.arange(-20.0, 21.0)
    points, height = np.stack([x, 0 * x, 0 * x], axis=1), 0.25 * x**2  # a radius of 2 m
    pairs = np.stack([np.arange(40), np.arange(1, 41)], axis=1)
    bent = points + np.stack([0 * x, 0 * x, height], axis=1)
    target = Target(pairs, points, 0.2, supports=np.arange(1))
    found = target.compare(bent)
    around = np.pad(height, 1, mode="reflect")  # at the ends the one neighbour is the mean
    felt, distance = np.sqrt(((height - 0.5 * (around[:-2] + around[2:])) ** 2).mean()), np.sqrt((height**2).mean())
    assert found.rmse == pytest.approx(felt) and distance > 15.0 * felt
    # bends, slopes and places in the ratio of 16 to 4 to 1
    tilt = np.sqrt((np.diff(height) ** 2).mean())
    squares = (felt**2 * 256 + tilt**2 * 16 + distance**2) / (256 + 16 + 1)
    assert found.value == pytest.approx(0.5 * squares / 0.02**2)
    bends = Target(pairs, points, 0.0, supports=np.arange(1)).compare(bent)
    assert bends.value == pytest.approx(0.5 * (felt / 0.02) ** 2)
    assert bends.rmse == pytest.approx(found.rmse)
    # in places alone, no Laplacian coordinates are compared
    assert Target(pairs, points, position_share=1.0, supports=np.arange(1)).compare(bent).rmse == pytest.approx(
        distance
    )


@pytest.mark.thorough
def test_a_spiral_comes_nearer_to_where_it_is_wished() -> None:
    """The distance that is told is that of points, and the search makes it small without giving the rest up."""
    design, mesh = made()
    rim = np.flatnonzero(mesh.border[mesh.quad_edges].any(axis=1))
    near = np.sort(rim[np.argsort(np.linalg.norm(mesh.centroids[rim] - mesh.centroids[rim[0]], axis=1))[:4]])
    away = mesh.centroids[near].mean(axis=0) * [1.0, 1.0, 0.0]
    offsets = np.zeros((len(mesh.quads), 3))
    offsets[near] = 0.01 * away / np.linalg.norm(away)
    wishes = Wishes.from_offsets(mesh, offsets)
    assert wishes is not None and wishes.offsets(mesh) == pytest.approx(offsets)
    params = OptimiseParams(codesign=False, iterations=8)
    held = np.setdiff1d(np.arange(len(mesh.quads)), rim)[:1]  # so that places are those of the world
    found = optimise.optimise(design, mesh, VERO, params, SimulateParams(), supports=held, wishes=wishes, prove=False)
    told = found.report()
    apart = found.after.equilibrium.pose.centres[near] - wishes.places
    assert told["wished_mm"] == pytest.approx(1e3 * np.sqrt((apart**2).sum(axis=1).mean()))
    assert told["wished_mm"] < 0.4 * told["wished_mm_before"]
    with pytest.raises(FlexMapsError, match="spiral 999"):
        optimise.optimise(
            design, mesh, VERO, params, SimulateParams(), wishes=Wishes(np.array([999]), np.zeros((1, 3)))
        )


def bodies() -> tuple[np.ndarray, np.ndarray]:
    """Joined pairs and places of a dome's spirals, of two joined spirals and of one alone."""
    _, mesh = made()
    n = len(mesh.quads)
    away = np.array([[0.5, 0.0, 0.0], [0.52, 0.0, 0.0], [0.0, 0.5, 0.0]])
    return np.concatenate([mesh.edge_quads[~mesh.border], [[n, n + 1]]]), np.concatenate([mesh.centroids, away])


@pytest.mark.parametrize("supports", [None, np.array([3]), np.array([-1])], ids=["free", "dome held", "one held"])
@pytest.mark.parametrize("lies", [0.0, 0.5, 1.0])
@pytest.mark.parametrize("wished", [False, True])
def test_derivatives_of_the_mismatch(supports: np.ndarray | None, lies: float, wished: bool) -> None:
    """The product is backward of forward, and the gradient that of finite differences."""
    pairs, points = bodies()
    rng = np.random.default_rng(1)
    quads = np.arange(0, len(points), 5)
    wishes = Wishes(quads, points[quads] + rng.normal(0.0, 0.01, (len(quads), 3))) if wished else None
    target = Target(pairs, points, lies, supports, wishes)
    away, shift = rng.normal(0.0, 0.005, (2, *points.shape))
    found = target.compare(points + away)
    wanted = found.vjp(found.jvp(shift))
    assert found.gauss_newton_product(shift) == pytest.approx(wanted, abs=1e-12 * np.abs(wanted).max())
    ahead, behind = (target.compare(points + away + sign * 1e-4 * shift) for sign in (1.0, -1.0))
    rate = (ahead.value - behind.value) / 2e-4
    assert float((found.gradient * shift).sum()) == pytest.approx(rate, rel=1e-6)
    residual = (ahead.residual - behind.residual) / 2e-4
    assert found.vjp(residual) == pytest.approx(wanted, abs=1e-5 * np.abs(wanted).max())


@pytest.mark.parametrize("lies", [0.0, 0.5, 1.0])
def test_bodies_may_lie_anywhere_unless_they_are_held(lies: float) -> None:
    """Bodies that are moved rigidly, each in its own way, match their target exactly, but a body with a support does not."""
    pairs, points = bodies()
    moved, n = points.copy(), len(points) - 3
    turns = Rotation.from_rotvec([[0.1, 0.4, -0.2], [1.0, 0.5, 0.0]]).as_matrix()
    moved[:n], moved[n:] = points[:n] @ turns[0].T + 0.1, points[n:] @ turns[1].T - 0.3
    free, held = (Target(pairs, points, lies, supports) for supports in (None, np.array([0])))
    pose = Pose(moved, np.tile(np.eye(3), (len(moved), 1, 1)))
    assert free.compare(moved).value < 1e-20 and free.relative_distance(pose) < 1e-10
    assert held.compare(moved).value > 1e-4 and held.relative_distance(pose) > 1.0
