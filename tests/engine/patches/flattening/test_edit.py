"""Hand edits: only what changed is flattened again, and what is no disk is refused."""

from __future__ import annotations

import numpy as np
import pytest
from flexmaps.engine.errors import FlexMapsError
from flexmaps.engine.params import LayoutParams
from flexmaps.engine.patches.flattening import edit, flatten
from flexmaps.engine.patches.flattening.flatten import FlatPatches
from flexmaps.engine.patches.layout import PatchLayout
from flexmaps.engine.patches.merging import merge
from flexmaps.engine.patches.tracing import trace
from flexmaps.engine.surface import shapes

PARAMS = LayoutParams()


@pytest.fixture(scope="module")
def flat() -> FlatPatches:
    mesh = shapes.make("three_holes")
    return flatten.flatten(trace.trace_layout(mesh, PARAMS), PARAMS)


def with_run(flat: FlatPatches, edges: np.ndarray, cut: bool) -> FlatPatches:
    """Cut along edges, or join the surface there."""
    cuts = flat.layout.cut.copy()
    cuts[edges] = cut
    return edit.with_cuts(flat, cuts, PARAMS)


def long_seam(flat: FlatPatches) -> np.ndarray:
    layout = flat.layout
    between = [s for s in layout.seams if len(np.unique(layout.patch_of[layout.mesh.edge_quads[s[0]]])) == 2]
    return max(between, key=len)


def test_opening_joins_two_patches_and_leaves_the_others_alone(flat: FlatPatches) -> None:
    seam = long_seam(flat)
    after = with_run(flat, seam, False)
    assert len(after.layout.patches) == len(flat.layout.patches) - 1
    touched = np.isin(flat.layout.patch_of, flat.layout.patch_of[flat.layout.mesh.edge_quads[seam]])
    assert touched.sum() < len(touched)
    assert np.abs(after.corners[~touched] - flat.corners[~touched]).max() == 0
    assert (after.energy[~touched] == flat.energy[~touched]).all()
    assert not flatten.overlapping_patches(after)


def test_closing_again_is_as_before(flat: FlatPatches) -> None:
    seam = long_seam(flat)
    back = with_run(with_run(flat, seam, False), seam, True)
    assert (back.layout.cut == flat.layout.cut).all()
    # flattened again, with less time for the seams: the same shape up to a little
    assert np.abs(np.sort(back.energy) - np.sort(flat.energy)).max() < 0.01


def test_the_border_is_never_cut() -> None:
    flat = merge.merge(trace.trace_layout(shapes.make("vault"), PARAMS), PARAMS, has_supports=True)
    after = with_run(flat, np.flatnonzero(flat.layout.mesh.border), True)
    assert not after.layout.cut.any()


def test_a_ring_is_refused_with_its_quads(flat: FlatPatches) -> None:
    mesh = shapes.make("vault")
    whole = flatten.flatten(trace.trace_layout(mesh, PARAMS), PARAMS)
    inside = np.flatnonzero(~mesh.on_border[mesh.edges].any(axis=1))[:1]
    with pytest.raises(FlexMapsError) as caught:
        with_run(whole, inside, True)
    assert len(caught.value.faces) == len(mesh.quads)
    assert int(inside[0]) in caught.value.edges


def test_a_run_from_the_border_stays_one_patch() -> None:
    mesh = shapes.make("vault")
    whole = flatten.flatten(trace.trace_layout(mesh, PARAMS), PARAMS)
    run = max(trace.parametric_lines(whole.layout, 0), key=len)
    slit = with_run(whole, run[: len(run) // 3], True) if len(run) > 3 else whole
    assert len(slit.layout.patches) <= 2


def test_a_panel_a_quad_lies_as_flat_as_its_quad_and_a_warped_one_spoils_no_other() -> None:
    mesh = shapes.make("saddle")
    warped = mesh.quads[20]
    spoilt = mesh.vertices.copy()
    spoilt[warped[2], 2] += 0.04
    mesh = mesh.with_vertices(spoilt)
    flat = flatten.flatten(PatchLayout(mesh, ~mesh.border), PARAMS)
    assert flat.energy[20] > PARAMS.distortion_limit
    beside = (mesh.quads == warped[2]).any(axis=1)
    assert flat.energy[~beside].max() < 0.01 * PARAMS.distortion_limit
    assert not flatten.overlapping_patches(flat)
    away = ~beside[mesh.edge_quads[flat.layout.cut]].any(axis=1)
    assert flatten.seam_mismatch(flat)[away].max() < 0.02
