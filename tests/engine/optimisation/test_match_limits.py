"""Why spirals miss the target, and how much of the mismatch each reason has."""

from __future__ import annotations

import numpy as np
import pytest
from flexmaps.engine.optimisation.match_limits import MATCHED_BELOW, REASON_NAMES, find_limits
from flexmaps.engine.params import Settings, SimulateParams
from flexmaps.engine.runs import job
from flexmaps.engine.simulation.simulate import simulate
from flexmaps.engine.surface import shapes
from flexmaps.engine.surface.mesh import PolygonMesh
from scipy.spatial.transform import Rotation


@pytest.mark.usefixtures("predicted_match")  # with more panels, some spirals match
def test_shares_are_those_of_the_squared_mismatch_and_what_matches_is_said_to_match() -> None:
    """The mismatch of a spiral: its place among its neighbours, minus that in the target turned over it (Kabsch by scipy)."""
    made = job.run(PolygonMesh.from_quads(shapes.make("dome", 0.03)), Settings(), edge=0.02, stop_after="spirals")
    assert made.design is not None
    found = simulate(made.design, made.mesh, Settings().material.chosen, SimulateParams())
    limits = find_limits(found, remedies=False)
    beside: list[list[int]] = [[] for _ in made.mesh.quads]
    for a, b in found.assembly.pairs.tolist():
        beside[a].append(b)
        beside[b].append(a)
    own, wanted = (
        np.array([points[k] - points[near].mean(axis=0) for k, near in enumerate(beside)])
        for points in (found.equilibrium.pose.centres, found.target.centroids)
    )
    turn, _ = Rotation.align_vectors(wanted, own)
    mismatch = np.linalg.norm(turn.apply(own) - wanted, axis=1)
    for number, share in enumerate(limits.share):
        part = (mismatch[limits.kind == number] ** 2).sum()
        assert share == pytest.approx(part / (mismatch**2).sum(), abs=1e-9)
    apart = [np.linalg.norm(np.subtract(*found.target.centroids[pair])) for pair in found.assembly.pairs]
    matched = mismatch <= MATCHED_BELOW * np.mean(apart)
    assert ((limits.kind == REASON_NAMES.index("matched")) == matched).all() and 0 < matched.sum() < len(matched)
