"""Largest strains on the surface of the arms of a design's solid, with the fillets at their roots and without them."""

from __future__ import annotations

import numpy as np

from ..engine.arrays import Bool, Float
from ..engine.spirals.curves.spiral import centre_line
from ..engine.spirals.design import SpiralDesign
from .design_mesh import UNIT
from .design_solid import DesignSolid
from .elastic import largest_principal
from .solid import lagrange

# places across and through an element at which strains are taken; torsion has its largest half way through the sheet
_ACROSS = np.linspace(0.0, 1.0, 5)
# A place is free of a fillet that is farther than both: these many fillet radii, and this share of the arm's width
FREE_RADII, FREE_WIDTH = 2.0, 1.0 / 3.0
_PLACES = 513  # along a centre line, among which the nearest to a section is taken


def surface_strains(
    solid: DesignSolid, nodes: Float[np.ndarray, "spirals nodes 3"]
) -> tuple[Float[np.ndarray, "spirals 4"], Float[np.ndarray, "spirals 4"]]:
    """Largest principal Green strain in size of every arm of the spirals: farther than a fillet's reach from fillets, and all over.

    nodes : deformed. Strains are averaged over the elements that meet at a section.
    """
    design, count = solid.design, len(solid.design.width)
    free, every = np.zeros((count, 4)), np.zeros((count, 4))
    for batch in solid.batches:
        last = min(batch.spirals.stop, count)
        own = slice(batch.spirals.start, last)
        if own.start >= count:
            break
        strains, places = _of_batch(solid, batch, nodes)
        some = last - own.start
        away = free_places(design, np.arange(own.start, last), places[:some])
        size = strains[:some]
        every[own] = size.max(axis=(2, 3, 4))
        free[own] = np.where(away[..., None], size, 0.0).max(axis=(2, 3, 4))
    return free, every


def _of_batch(solid: DesignSolid, batch: object, nodes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Strains (spirals, 4, sections, across, through) and the places (spirals, 4, sections, across), in the plane, of a batch."""
    known = solid.mesh.numbering
    elements, spirals = batch.elements, batch.spirals  # type: ignore[attr-defined]
    value, slope = lagrange(_ACROSS)
    section = np.kron(value, value), np.kron(slope, value), np.kron(value, slope)
    of_arms = slice(batch.hubs, None)  # type: ignore[attr-defined]
    shift = solid.flat(batch, nodes - solid.mesh.nodes)[elements.index[of_arms]]  # type: ignore[arg-type]
    rest = elements.rest[of_arms]
    jacobian = elements._at(rest, *section)
    f = np.eye(3) + elements._at(shift, *section) @ np.linalg.inv(jacobian)
    strain = elements.strain(f)
    points = np.einsum("qs,epsi->epqi", section[0], rest)[..., :2]
    count, m = spirals.stop - spirals.start, len(_ACROSS)
    shape = (count, 4, known.pieces, known.across, 4, m, m)
    strain, points = strain.reshape(*shape, 3, 3), points.reshape(*shape, 2)
    out, at = [], []
    for piece in range(known.pieces):
        for station in range(4 if piece == known.pieces - 1 else 3):
            one = strain[:, :, piece, :, station]
            if station == 0 and piece > 0:
                one = 0.5 * (one + strain[:, :, piece - 1, :, 3])
            out.append(largest_principal(one).reshape(count, 4, -1, m))
            at.append(points[:, :, piece, :, station, :, 0].reshape(count, 4, -1, 2))
    return np.stack(out, axis=2), np.stack(at, axis=2)


def free_places(
    design: SpiralDesign, spirals: np.ndarray, places: Float[np.ndarray, "spirals 4 sections across 2"]
) -> Bool[np.ndarray, "spirals 4 sections across"]:
    """Which places (UNIT, seen from the quads' centres) lie on free arms: out of hubs, and away from fillets."""
    roots, arms = design.roots, design.arms.subset(spirals)
    apart = []
    for turn in (0, 1):
        middle, radius = (np.roll(v, turn, axis=1)[spirals] for v in (roots.centre, roots.fillet))
        centre = (middle - arms.centre[:, None]) / UNIT
        gap = np.linalg.norm(places - centre[:, :, None, None], axis=-1) - radius[..., None, None] / UNIT
        reach = np.maximum(FREE_RADII * radius, FREE_WIDTH * arms.width) / UNIT
        apart.append(gap > reach[..., None, None])
    t = np.broadcast_to(np.linspace(0.0, 1.0, _PLACES), (*arms.width.shape, _PLACES))
    line = (centre_line(arms, t)[0] - arms.centre[:, None, None]) / UNIT
    middle = places.mean(axis=3)
    nearest = np.linalg.norm(middle[:, :, :, None] - line[:, :, None], axis=-1).argmin(axis=3) / (_PLACES - 1)
    end = np.minimum(roots.left, np.roll(roots.right, 1, axis=1))[spirals]
    return apart[0] & apart[1] & (nearest < end[..., None])[..., None]
