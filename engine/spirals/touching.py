"""Whether outlines touch themselves or each other, judged by shapely."""

from __future__ import annotations

import numpy as np

from ..arrays import Float
from ..progress import SILENT, Progress
from .contours import Outline


def touching(drawn: list[Outline], progress: Progress = SILENT) -> Float[np.ndarray, "n 3"]:
    """Patch, x and y (metres) of the places where an outline crosses or touches itself or another of its panel."""
    import shapely

    found = []
    for patch, outline in enumerate(drawn):
        progress(patch / len(drawn), "checking the outlines")
        rings = [shapely.LinearRing(c.sampled(2e-5)) for c in (outline.outer, *outline.holes)]
        if shapely.is_valid(shapely.Polygon(rings[0], rings[1:])):
            continue
        places = [_crossing(ring) for ring in np.array(rings)[~shapely.is_simple(rings)]]
        one, two = shapely.STRtree(rings).query(rings, predicate="intersects")
        both = [rings[a].intersection(rings[b]) for a, b in zip(one[one < two], two[one < two], strict=True)]
        at = np.concatenate([shapely.get_coordinates(p) for p in [*places, *both]] or [np.empty((0, 2))])
        if not len(at):  # a hole outside the panel, say: no single place
            at = shapely.get_coordinates(rings[0])[:1]
        found.append(np.column_stack([np.full(len(at), patch), at]))
    return np.concatenate(found) if found else np.empty((0, 3))


def _crossing(ring):  # type: ignore[no-untyped-def]  # shapely's geometries
    """A place where a closed line crosses or touches itself."""
    import shapely

    return shapely.Point(
        *map(float, shapely.is_valid_reason(shapely.Polygon(ring)).partition("[")[2].rstrip("]").split())
    )
