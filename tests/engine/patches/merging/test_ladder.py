"""Merging in one run under limits that rise."""

from __future__ import annotations

import pytest
from flexmaps.engine.params import Settings
from flexmaps.engine.patches.flattening.flatten import flatten
from flexmaps.engine.patches.merging.ladder import merge_in_steps
from flexmaps.engine.patches.tracing.trace import trace_layout
from flexmaps.engine.surface import shapes
from flexmaps.engine.surface.symmetry import preserved_by, symmetries


@pytest.mark.parametrize(("name", "symmetric"), [("cubesphere", False), ("dome", True)])
def test_merging_in_steps_gives_fewer_panels_as_the_limit_rises_and_keeps_each_limit(
    name: str, symmetric: bool
) -> None:
    """One run, a layout for every share of the limit, symmetric as the traced one."""
    mesh, params = shapes.make(name), Settings().layout
    found, traced = symmetries(mesh) if symmetric else [], trace_layout(mesh, params)
    shares = (1.0, 0.1, 0.3)
    made = merge_in_steps(traced, params, shares, found, has_supports=True)
    assert len(made) == 3
    counts = [len(layout.patches) for layout in made]
    assert counts == sorted(counts, reverse=True) and counts[0] > counts[-1]
    for share, layout in zip(sorted(shares), made, strict=True):
        assert layout.is_flattenable.all() and len(preserved_by(found, layout.cut)) >= len(
            preserved_by(found, traced.cut)
        )
        before = float(flatten(traced, params).energy.max())
        assert float(flatten(layout, params).energy.max()) <= max(share * params.distortion_limit, before) * 1.05
