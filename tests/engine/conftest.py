"""Flat patches made by hand from planar grids, where every length and angle is known."""

from __future__ import annotations

import sys
from collections.abc import Callable

import numpy as np
import pytest
from flexmaps.engine.patches.flattening.flatten import FlatPatches
from flexmaps.engine.patches.layout import PatchLayout
from flexmaps.engine.surface.mesh import QuadMesh

sys.modules["flexmaps_shapes"].watch("engine")


@pytest.fixture(scope="session", autouse=True)
def quick_merge_and_nesting(merge_without_prediction: None, quick_nesting: None) -> None:
    """Begin with the layout of Merge alone, and lay panels on sheets the quick way."""


def _flat_grid(
    columns: int = 3,
    rows: int = 3,
    size: float = 0.02,
    *,
    move: Callable[[np.ndarray], np.ndarray] | None = None,
    without: Callable[[int, int], bool] | None = None,
    cut: Callable[[float, float], bool] | None = None,
) -> FlatPatches:
    """Quads of ``size`` metres in the plane. All patches keep the grid's coordinates: they lie side by side along their cuts.

    ``move`` changes the points (N, 2); quads where ``without(column, row)`` are left out; edges whose middle, in units of
    quads, fulfils ``cut(x, y)`` are cut.
    """
    x, y = np.meshgrid(np.arange(columns + 1.0), np.arange(rows + 1.0), indexing="ij")
    whole = np.stack([x, y], axis=-1).reshape(-1, 2)
    corner = np.arange(len(whole)).reshape(columns + 1, rows + 1)
    quads = np.stack([corner[:-1, :-1], corner[1:, :-1], corner[1:, 1:], corner[:-1, 1:]], axis=-1)
    kept = [quads[i, j] for i in range(columns) for j in range(rows) if not (without and without(i, j))]
    used, compact = np.unique(np.array(kept), return_inverse=True)
    compact, whole = compact.reshape(-1, 4), whole[used]
    points = whole * size if move is None else move(whole * size)
    mesh = QuadMesh(np.column_stack([points, np.zeros(len(points))]), compact)
    middles = whole[mesh.edges].mean(axis=1)
    cuts = np.array([bool(cut and cut(*m)) for m in middles.tolist()]) & ~mesh.border
    layout = PatchLayout(mesh, cuts)
    flat = np.zeros((int(layout.flat_corners.max()) + 1, 2))
    flat[layout.flat_corners.ravel()] = points[compact.ravel()]
    return FlatPatches(layout, flat, np.zeros(len(compact)), np.zeros(len(compact)))


@pytest.fixture(scope="session")
def flat_grid() -> Callable[..., FlatPatches]:
    """A function that makes flat patches from a planar grid; see ``_flat_grid``."""
    return _flat_grid
