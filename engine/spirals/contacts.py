"""Find places where outlines touch themselves or each other, with shapely."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from ..arrays import Float, Int
from ..patches.flattening.flatten import FlatPatches
from ..progress import SILENT, Progress
from .contours import Outline


def find_contacts(
    outlines: list[Outline], progress: Progress = SILENT, contact_free: Collection[int] = ()
) -> Float[np.ndarray, "n 3"]:
    """Find the places where the curves of a panel's outline cross or touch themselves or each other.

    Parameters
    ----------
    outlines : outlines, one per patch
    progress : called with the fraction done; may cancel
    contact_free : patches that are known to have no contacts and are not checked

    Returns
    -------
    (N, 3) patch, x and y of every place; metres in the patch's frame
    """
    import shapely

    contacts = []
    for patch, outline in enumerate(outlines):
        if patch in contact_free:
            continue
        progress(patch / len(outlines), "checking the outlines")
        rings = [shapely.LinearRing(c.sample(2e-5)) for c in (outline.outer, *outline.holes)]
        if shapely.is_valid(shapely.Polygon(rings[0], rings[1:])):
            continue
        places = [_self_contact(ring) for ring in np.array(rings)[~shapely.is_simple(rings)]]
        one, two = shapely.STRtree(rings).query(rings, predicate="intersects")
        both = [rings[a].intersection(rings[b]) for a, b in zip(one[one < two], two[one < two], strict=True)]
        at = np.concatenate([shapely.get_coordinates(p) for p in [*places, *both]] or [np.empty((0, 2))])
        if not len(at):  # for example a hole outside the panel: report any point of the outer curve
            at = shapely.get_coordinates(rings[0])[:1]
        contacts.append(np.column_stack([np.full(len(at), patch), at]))
    return np.concatenate(contacts) if contacts else np.empty((0, 3))


def _self_contact(ring):  # type: ignore[no-untyped-def]  # shapely's geometries
    """Return a place where a closed line crosses or touches itself."""
    import shapely

    return shapely.Point(
        *map(float, shapely.is_valid_reason(shapely.Polygon(ring)).partition("[")[2].rstrip("]").split())
    )


def nearest_quads(flat: FlatPatches, where: Float[np.ndarray, "n 3"], count: int = 4) -> Int[np.ndarray, " found"]:
    """Return the quads that are among the ``count`` nearest quads of any place, ascending.

    Parameters
    ----------
    flat : flat patches
    where : (n, 3) patch, and x and y in its frame in metres, of every place
    count : number of quads for each place
    """
    nearest = []
    for patch, x, y in where:
        quads = flat.layout.patches[int(patch)]
        apart = np.linalg.norm(flat.corners[quads].mean(axis=1) - [x, y], axis=1)
        nearest.append(quads[np.argsort(apart)[:count]])
    return np.unique(np.concatenate(nearest))
