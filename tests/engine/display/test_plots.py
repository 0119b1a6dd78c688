"""Plots: what can be said of them without looking."""

from __future__ import annotations

import numpy as np
from flexmaps.engine.display.drawing import FilledShapes
from flexmaps.engine.display.plots import Colouring, shape_map
from flexmaps.engine.surface import shapes


def test_both_sides_of_a_surface_are_lit_alike() -> None:
    mesh = shapes.make("saddle")
    grey = Colouring("", np.full((len(mesh.quads), 3), 0.5))
    plain = np.zeros((len(mesh.quads), 4), dtype=bool)
    front, back = (
        [item.fills for item in shape_map(mesh.vertices, quads, plain, grey).items if isinstance(item, FilledShapes)]
        for quads in (mesh.quads, mesh.quads[:, ::-1])
    )
    np.testing.assert_allclose(np.concatenate(front), np.concatenate(back), atol=1e-12)
    assert np.ptp(np.concatenate(front)) > 0.01  # slopes differ
