"""Gain of Optimise for drag targets: distance of spirals from their targets before and after, on surfaces of all kinds."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from flexmaps.engine.errors import FlexMapsError
from flexmaps.engine.optimisation.optimise import optimise
from flexmaps.engine.optimisation.wishes import Wishes
from flexmaps.engine.params import MaterialParams, OptimiseParams, SimulateParams
from flexmaps.engine.surface.checking import check
from harness import Row, at_most, note, row
from live_cases import design_of_mesh
from zoo import SURFACES

# caps, stars, tubes, saddles and sheets, of few quads; some of them are a single panel that nothing bends
NAMES = (
    "cap-pole6", "cone", "star3", "cylinder", "elbow", "catenoid", "enneper", "hypar", "spindle", "globe", "dome", "helicoid",
)  # fmt: skip
BY = 0.5  # median edges along the normal, how far beside the target: 10 mm
LEFT = 0.9  # of the distance to the wishes at the most, as in the test of wishes that spirals can fulfil


def measure_wishes() -> Iterator[Row]:
    """Four wishes a surface, at the ends of its two longest axes: outwards along one, inwards along the other, which no turn can do."""
    left, flat = [], []
    for name in NAMES:
        try:
            found = _report(name)
        except FlexMapsError as error:
            yield row(name, "wishes: optimised", "", str(error)[:60], False)
            continue
        before, after = found["wished_mm_before"], found["wished_mm"]
        if found.get("wish"):
            flat.append(name)
            yield note(name, "wishes: without strain, nothing to be done", f"{before:.3g} mm")
            continue
        left.append(after / before)
        ways = {"mm": {"before": round(before, 2), "after": round(after, 2)}}
        yield at_most(name, "wishes: what is left of their distance", LEFT, left[-1], ways)
    yield note("all", "wishes: surfaces, those without strain", f"{len(NAMES)}, {len(flat)}")
    if left:
        yield at_most("all", "wishes: what is left of their distance, median", None, float(np.median(left)))


def _report(name: str) -> dict[str, Any]:
    """The ``optimise`` block for wishes on a surface of the zoo."""
    _, design = design_of_mesh(check.as_quad_mesh(SURFACES[name].polygons()))
    mesh = design.flat.layout.mesh
    apart = mesh.centroids - mesh.centroids.mean(axis=0)
    offsets = np.zeros((len(mesh.quads), 3))
    for axis, way in zip(np.linalg.svd(apart, full_matrices=False)[2][:2], (BY, -BY), strict=True):
        for quad in (int(np.argmin(apart @ axis)), int(np.argmax(apart @ axis))):
            offsets[quad] = way * mesh.median_edge * mesh.normals[quad]
    given = MaterialParams().chosen, OptimiseParams(codesign=False), SimulateParams()
    return optimise(design, mesh, *given, wishes=Wishes.from_offsets(mesh, offsets), prove=False).report()
