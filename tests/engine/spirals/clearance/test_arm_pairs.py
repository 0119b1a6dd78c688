"""Broad phase of clearances: pairs of arms across seams against all points of their centre lines."""

from __future__ import annotations

import numpy as np
import pytest
from flexmaps.engine.params import LayoutParams, SpiralParams
from flexmaps.engine.patches.flattening import flatten
from flexmaps.engine.patches.tracing import trace
from flexmaps.engine.spirals.clearance.arm_pairs import ACROSS, DEPTHS, find_arm_pairs
from flexmaps.engine.spirals.curves.spiral import centre_line, opposite_sides, width_at
from flexmaps.engine.spirals.design import SpiralDesign
from flexmaps.engine.surface import shapes
from flexmaps.engine.surface.mesh import QuadMesh

NEAR = 1e-3  # metres between edges
POINTS = 40  # of a centre line


@pytest.mark.parametrize("name", ["dome", "cubesphere", "three_holes"])
def test_arms_that_come_near_across_a_seam_are_pairs(name: str) -> None:
    mesh, params, rng = shapes.make(name), SpiralParams(), np.random.default_rng(3)
    flat = flatten.flatten(trace.trace_layout(mesh, LayoutParams()), LayoutParams())
    found = find_arm_pairs(flat, params, NEAR)
    laid = found.subset((found.kind == ACROSS) & found.is_across_cut)
    known = set(zip(laid.one.tolist(), laid.two.tolist(), strict=True))
    mate, side = opposite_sides(mesh)
    corners = flat.corners @ np.array([1.0, 1j])
    quads, sides = np.nonzero(flat.layout.outline_sides & ~mesh.border[mesh.quad_edges])
    near, possible = set[tuple[int, int]](), 0
    for _ in range(3):
        count = len(mesh.quads)
        width = rng.uniform(params.width_min, params.width_max, (count, 1)).repeat(4, axis=1)
        arms = SpiralDesign(flat, params, width, rng.uniform(params.twist_min, params.twist_max, count)).arms
        lines = [
            centre_line(arms, np.broadcast_to(np.linspace(0.0, depth, POINTS), (count, 4, POINTS)))[0]
            @ np.array([1, 1j])
            for depth in DEPTHS[ACROSS]
        ]
        for f, k in zip(quads.tolist(), sides.tolist(), strict=True):
            g, m = int(mate[f, k]), int(side[f, k])
            here = corners[f, k], corners[f, (k + 1) % 4]
            there = corners[g, (m + 1) % 4], corners[g, m]
            turn = (here[1] - here[0]) / (there[1] - there[0])
            turn /= abs(turn)
            for arm in ((m + 1) % 4, (m + 3) % 4):
                placed = turn * (lines[1][g, arm] - np.mean(there)) + np.mean(here)
                apart = np.abs(lines[0][f, k][:, None] - placed).min() - 0.5 * (width[f, k] + width[g, arm])
                possible += 1
                if apart < NEAR:
                    near.add((4 * f + k, 4 * g + arm))
    assert 0.01 * possible < len(near) < possible and near <= known


def test_the_narrowest_slot_may_lie_deep_inside_an_uneven_quad() -> None:
    """Half way to the centre an arm that is hardly wound passes the arms beside its mate."""
    points = np.array([[129, 40, 0], [137, 48, 0], [113, 49, 0], [108, 37, 0], [112, 27, 0], [140, 35, 0]]) * 1e-3
    mesh = QuadMesh(points, np.array([[0, 1, 2, 3], [0, 3, 4, 5]]))
    flat = flatten.flatten(trace.trace_layout(mesh, LayoutParams()), LayoutParams())
    width = np.array([[1.0, 1.08, 1.19, 1.15], [1.1, 1.0, 1.0, 1.0]]) * 1e-3
    design = SpiralDesign(flat, SpiralParams(), width, np.radians([54.0, 130.0]))
    t = np.broadcast_to(np.linspace(0.0, 1.0, 1001), (2, 4, 1001))
    (one, other), (half, beside) = centre_line(design.arms, t)[0], 0.5 * width_at(design.arms, t)[0]
    edges = np.linalg.norm(one[3][:, None] - other[3], axis=2) - half[3][:, None] - beside[3]
    assert edges.min() < 0.9 * SpiralParams().slot_min
    assert design.measure_slot_and_bridge()[0] == pytest.approx(edges.min(), rel=1e-3)
