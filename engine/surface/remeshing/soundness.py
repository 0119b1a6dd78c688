"""Judge a remesher's quads: are they sound, and how good are they?"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree

from ...params import RegulariseParams
from ..checking.check import Finding, as_quad_mesh, findings
from ..checking.topology import sides_of
from ..mesh import PolygonMesh
from .bodies import is_clean, target_of
from .mend import FOLDED, POOR, USELESS, TargetSurface, mend_quads, of_rows
from .quality import quality
from .refine import refine_quads
from .regularise import flatter, regularise

WORTH = 10.0  # cost factor per share of poor quads: a tenth of them poor doubles the cost; not measured
# in quad edges: distance between quads and surface, at its 95th percentile, at which thin parts such as a rabbit's ears
# are lost
LOST = 3
# Largest area of the quads as a share of the surface's; more means a second skin. A voxel remesh gives an open surface
# two sides, and QuadriFlow with few quads closes it: an open half ball came back with 1.47 to 1.66, results that kept
# their border with 0.92 to 0.97.
DOUBLED = 1.2
# In quad edges: a quad fills a hole if all its corners are this near the border and, besides, its middle is off the
# surface or its back faces outwards.
AT_BORDER = 0.6
FILLING = 0.1  # in quad edges: distance between surface and middle of a quad above which the quad fills a hole


@dataclass(frozen=True, eq=False)
class SoundQuads:
    """Sound quads.

    faults : number without room for a spiral; whole quad edges by which parts of the surface are missed; number of poor
        quads
    cost : ``Quality.cost``, raised for poor quads and deviations from the wanted count
    """

    quads: PolygonMesh
    faults: tuple[int, int, int]
    cost: float


def judge_raw(
    raw: PolygonMesh, whole: TargetSurface, count: int, times: int = 0, sharp: bool = False
) -> SoundQuads | str:
    """Subdivide quads ``times`` times, repair and judge them; return the reason if they are useless."""
    if not (raw.sizes == 4).all():
        return "QuadriFlow left faces that are not quads"
    if not is_clean(raw):
        return "its quads are not a clean surface"
    unfilled = reopen_holes(raw, whole)
    made = mend_quads(refine_quads(unfilled, whole, times) if times or sharp else unfilled, whole)
    judged = judge(made, whole, count)
    moved = onto_corners(made, whole)
    again = judged if moved is made else judge(moved, whole, count)
    kept = isinstance(again, SoundQuads) and (isinstance(judged, str) or again.faults <= judged.faults)
    return again if kept else judged


def onto_corners(quads: PolygonMesh, whole: TargetSurface) -> PolygonMesh:
    """Move the nearest border vertex onto every corner of the surface's border; remeshers cut these corners off."""
    corners = whole.vertices[whole.border_corners]
    sides = sides_of(quads)
    border = np.unique(sides.edges[np.bincount(sides.edge) == 1])
    if not len(corners) or not len(border):
        return quads
    edge = (target_of(quads).area / len(quads.sizes)) ** 0.5
    away, nearest = cKDTree(quads.vertices[border]).query(corners, distance_upper_bound=edge)
    order = np.argsort(away)[: int(np.isfinite(away).sum())]
    vertex, first = np.unique(border[nearest[order]], return_index=True)  # the nearest corner for each vertex
    moved = quads.vertices.copy()
    moved[vertex] = corners[order[first]]
    return replace(quads, vertices=moved)


def judge(quads: PolygonMesh, whole: TargetSurface, count: int) -> SoundQuads | str:
    """Judge quads as they are; return the reason if they are useless."""
    found = findings(quads)
    errors = [f for f in found if f.is_error]
    if errors:
        folded = sum(len(f.faces) for f in errors if f.code in FOLDED)
        return f"{folded} of {len(quads.sizes)} quads are folded" if folded else "its quads differ too much in size"
    made = target_of(quads)
    edge = (whole.area / count) ** 0.5
    if made.area > DOUBLED * whole.area:
        return "its open side was closed, or both of its sides were covered"
    missed = int(
        max(np.percentile(made.distances(whole.samples), 95), np.percentile(whole.distances(made.samples), 95)) / edge
    )
    if missed >= LOST:
        return "parts of the surface are lost"
    useless, poor = _count_faces(found, USELESS), _count_faces(found, POOR)
    cost = (
        quality(quads, whole).cost
        * (1.0 + WORTH * poor / len(quads.sizes))
        * (1.0 + abs(len(quads.sizes) / count - 1.0))
    )
    return SoundQuads(quads, (useless, missed, poor), cost)


def reopen_holes(raw: PolygonMesh, whole: TargetSurface) -> PolygonMesh:
    """Remove quads that fill holes: QuadriFlow fills every hole with at most 25 of its edges round it."""
    rows = raw.corners.reshape(-1, 4)
    size = (target_of(raw).area / len(rows)) ** 0.5
    at_border = whole.to_border(raw.vertices) < AT_BORDER * size
    corners = raw.vertices[rows]
    middles = corners.mean(axis=1)
    there, normals = whole.nearest(middles)
    across = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
    back = np.einsum("fi,fi->f", across, normals) < 0  # over a flat part the filling faces the other way
    filling = at_border[rows].all(axis=1) & (back | (np.linalg.norm(there - middles, axis=1) > FILLING * size))
    if not filling.any() or filling.all():
        return raw
    unfilled = of_rows(raw.vertices, rows[~filling])
    return unfilled if is_clean(unfilled) else raw


def squarer(quads: PolygonMesh) -> PolygonMesh:
    """Regularise quads if that leaves fewer poor ones, then press bent ones flat if that makes no more of them poor.

    If neither helps, the quads are returned unchanged.
    """
    best, found = quads, findings(quads)
    if any(one.is_error for one in found):
        return quads
    poor = _count_faces(found, POOR)
    if poor:
        after = PolygonMesh.from_quads(regularise(as_quad_mesh(quads), RegulariseParams()))
        left = _count_faces(findings(after), POOR)
        best, poor = (after, left) if left < poor else (quads, poor)
    mesh = as_quad_mesh(best)
    pressed = flatter(mesh)
    if pressed is mesh:
        return best
    flat = PolygonMesh.from_quads(pressed)
    return flat if _count_faces(findings(flat), POOR) <= poor else best


def _count_faces(found: list[Finding], codes: set[str]) -> int:
    """Return the number of faces that findings with these codes name."""
    return sum(len(one.faces) for one in found if one.code in codes)
