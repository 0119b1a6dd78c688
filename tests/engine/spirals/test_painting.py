"""Painted spirals: bounds, symmetry, smoothing, protection, and that a search starts from them."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from flexmaps.engine.errors import FlexMapsError
from flexmaps.engine.materials import MATERIALS
from flexmaps.engine.mechanics.arms.spiral_stiffness import spiral_stiffness, update_stiffness
from flexmaps.engine.optimisation.optimise import optimise
from flexmaps.engine.params import ChooseParams, OptimiseParams, Settings, SimulateParams
from flexmaps.engine.runs import job
from flexmaps.engine.spirals.clearance.clearance_model import ClearanceModel
from flexmaps.engine.spirals.constraints import Constraints
from flexmaps.engine.spirals.contacts import find_contacts
from flexmaps.engine.spirals.design import SpiralDesign
from flexmaps.engine.spirals.fabricable import unfabricable_quads, uniform_design
from flexmaps.engine.spirals.painting import BRUSHES, Canvas, Stroke, paint_spirals
from flexmaps.engine.surface import shapes
from flexmaps.engine.surface.mesh import PolygonMesh, QuadMesh
from flexmaps.engine.surface.symmetry import symmetries

POM = MATERIALS["pom"]


@lru_cache(maxsize=2)
def made(name: str = "dome", edge: float = 0.03) -> tuple[SpiralDesign, QuadMesh]:
    found = job.run(
        PolygonMesh.from_quads(shapes.make(name, edge)),
        Settings(choose=ChooseParams(goal="panels")),
        edge=0.02,
        stop_after="spirals",
    )
    assert found.design is not None
    return found.design, found.mesh


def spot(mesh: QuadMesh, quad: int, radius: float) -> np.ndarray:
    return np.clip(1.0 - np.linalg.norm(mesh.centroids - mesh.centroids[quad], axis=1) / radius, 0.0, 1.0)


def test_whatever_is_painted_can_be_cut() -> None:
    """Room between all arms, widths and twists within the settings, and finished outlines that nowhere touch."""
    design, mesh = made("saddle", 0.02)
    rng = np.random.default_rng(1)
    for _ in range(40):
        brush = rng.choice([name for name in BRUSHES if name != "stiffness"])
        stroke = Stroke(bool(rng.integers(2)), rng.normal(size=3))
        weight = spot(mesh, int(rng.integers(len(mesh.quads))), rng.uniform(0.03, 0.15))
        after = paint_spirals(design, str(brush), weight, stroke)
        still = weight == 0.0
        assert (after.width[still] == design.width[still]).all() and (after.twist[still] == design.twist[still]).all()
        design = after
    assert (
        not ClearanceModel.from_flat(design.flat, design.params)
        .quads_with_closed_gaps(design.width, design.twist)
        .any()
    )
    assert not len(unfabricable_quads(design)) and not len(find_contacts(design.outlines()))
    assert np.ptp(design.width) > 0.5e-3  # something was painted at all


def test_brushes_do_what_their_names_say() -> None:
    design, mesh = made()
    weight = spot(mesh, 12, 0.07)
    inside = weight > 0.3
    before = spiral_stiffness(design, POM)
    assert before is not None
    for brush, more in (("stiffer", True), ("softer", False)):
        for inverted in (False, True):
            after = spiral_stiffness(paint_spirals(design, brush, weight, Stroke(inverted)), POM)
            assert after is not None
            assert ((after > before)[inside] == (more is not inverted)).all()
    even = uniform_design(design.flat, design.params, width=1.4e-3, twist=1.0)
    wider = paint_spirals(even, "width", weight)
    assert (wider.width[inside] > even.width[inside]).all() and (wider.twist == even.twist).all()
    wound = paint_spirals(design, "twist", weight, Stroke(is_inverted=True))
    assert (wound.twist[inside] < design.twist[inside]).all() and (wound.width == design.width).all()


def test_along_widens_the_arms_that_lie_along_and_thins_those_across() -> None:
    design, _ = made()
    narrow = replace(design, width=np.full_like(design.width, 1.5e-3), twist=np.zeros_like(design.twist))
    spokes = Canvas.from_design(narrow).spokes
    level = np.abs(spokes[..., 2]).max(axis=1, keepdims=True) < 0.2 * np.abs(spokes).max(axis=(1, 2))[:, None]
    along = level & (np.abs(spokes[..., 0]) > 2.0 * np.abs(spokes[..., 1]))
    across = level & (np.abs(spokes[..., 1]) > 2.0 * np.abs(spokes[..., 0]))
    ahead = paint_spirals(narrow, "along", np.ones(len(along)), Stroke(direction=np.array([1.0, 0.0, 0.0])))
    aside = paint_spirals(narrow, "along", np.ones(len(along)), Stroke(True, np.array([1.0, 0.0, 0.0])))
    assert along.any() and across.any()
    assert (ahead.width[along] > 1.6e-3).all() and (ahead.width[across] < 1.4e-3).all()
    assert (aside.width[along] < 1.4e-3).all() and (aside.width[across] > 1.6e-3).all()


def test_a_symmetric_stroke_gives_a_symmetric_design() -> None:
    design, mesh = made()
    mirror = next(one for one in symmetries(mesh) if one.is_mirror)
    even = uniform_design(design.flat, design.params, width=1.4e-3, twist=1.0)
    assert np.ptp(even.width) < 1e-9 and np.ptp(even.twist) < 1e-9
    one = spot(mesh, 5, 0.08)
    weight = np.maximum(one, one[mirror.quads])
    for brush in ("stiffer", "width", "twist"):
        after = paint_spirals(even, brush, 0.3 * weight)
        np.testing.assert_allclose(after.width.mean(axis=1)[mirror.quads], after.width.mean(axis=1), rtol=1e-9)
        np.testing.assert_allclose(after.twist[mirror.quads], after.twist, rtol=1e-9)
        assert np.ptp(after.width) + np.ptp(after.twist) > 1e-4


def test_smoothing_lowers_the_variation_and_leaves_even_spirals_as_they_are() -> None:
    design, mesh = made()
    rng = np.random.default_rng(2)
    even = uniform_design(design.flat, design.params, width=1.4e-3, twist=1.0)
    same = paint_spirals(even, "smooth", np.ones(len(even.twist)))
    np.testing.assert_allclose(same.width, even.width, rtol=1e-12)
    pairs = mesh.edge_quads[~mesh.border]
    rough = replace(
        even, width=rng.uniform(1.1e-3, 1.7e-3, even.width.shape), twist=rng.uniform(0.5, 1.5, even.twist.shape)
    )
    variation = []
    for _ in range(6):
        width = rough.width.mean(axis=1)
        variation.append(
            [float(((v[pairs[:, 0]] - v[pairs[:, 1]]) ** 2).sum()) for v in (width, rough.twist)]
            + [float(np.ptp(rough.width, axis=1).mean())]
        )
        rough = paint_spirals(rough, "smooth", np.ones(len(rough.twist)))
    assert (np.diff(np.array(variation), axis=0) < 0.0).all()


def test_a_level_of_stiffness_orders_the_spirals() -> None:
    design, mesh = made()
    level = np.clip(mesh.centroids[:, 0] / np.ptp(mesh.centroids[:, 0]) + 0.5, 0.0, 1.0)
    after = paint_spirals(design, "stiffness", np.ones(len(level)), Stroke(level=level))
    found = spiral_stiffness(after, POM)
    assert found is not None
    assert np.corrcoef(np.argsort(np.argsort(level)), np.argsort(np.argsort(found)))[0, 1] > 0.95
    with pytest.raises(FlexMapsError, match="needs a stiffness"):
        paint_spirals(design, "stiffness", np.ones(len(level)))
    with pytest.raises(FlexMapsError, match="no brush 'stif'"):
        paint_spirals(design, "stif", np.ones(len(level)))
    with pytest.raises(FlexMapsError, match="a weight"):
        paint_spirals(design, "softer", np.full(len(level), np.nan))


def test_stiffness_of_a_part_is_that_of_the_whole() -> None:
    design, mesh = made()
    before = spiral_stiffness(design, POM)
    after = paint_spirals(design, "stiffer", spot(mesh, 7, 0.05))
    changed = (after.width != design.width).any(axis=1) | (after.twist != design.twist)
    assert before is not None and 0 < changed.sum() < len(changed)
    np.testing.assert_allclose(update_stiffness(before, after, POM, changed), spiral_stiffness(after, POM), rtol=1e-12)


@pytest.mark.parametrize("codesign", [False, pytest.param(True, marks=pytest.mark.thorough)])
def test_the_optimiser_leaves_protected_spirals_exactly_as_they_are(codesign: bool) -> None:
    design, mesh = made()
    kept = np.flatnonzero(spot(mesh, 12, 0.06) > 0.0)
    mine = paint_spirals(design, "stiffer", np.where(np.isin(np.arange(len(design.twist)), kept), 0.7, 0.0))
    params = OptimiseParams(iterations=3, codesign=codesign, smoothness=0.01, strain_share=0.0, open_slots=False)
    found = optimise(mine, mesh, POM, params, SimulateParams(), constraints=Constraints(fixed=kept), prove=False)
    assert found.start == "given"  # painted spirals are where it starts, though others may lie nearer
    assert (found.design.width[kept] == mine.width[kept]).all() and (found.design.twist[kept] == mine.twist[kept]).all()
    free = np.setdiff1d(np.arange(len(design.twist)), kept)
    assert np.abs(found.design.width[free] - mine.width[free]).max() > 1e-5
    assert found.after.target_distances["laplacian_rmse_mm"] < 0.95 * found.before.target_distances["laplacian_rmse_mm"]
    shape, was = (d.flat.corners[kept] - d.flat.corners[kept].mean(axis=1, keepdims=True) for d in (found.design, mine))
    np.testing.assert_allclose(shape, was, atol=1e-12)
    if codesign:
        moved = found.design.flat.corners[free] - found.design.flat.corners[free].mean(axis=1, keepdims=True)
        still = mine.flat.corners[free] - mine.flat.corners[free].mean(axis=1, keepdims=True)
        assert np.abs(moved - still).max() > 1e-5
    with pytest.raises(FlexMapsError, match="All spirals are protected"):
        optimise(mine, mesh, POM, params, SimulateParams(), constraints=Constraints(fixed=np.arange(len(design.twist))))
