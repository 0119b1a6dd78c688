"""Decide whether a remesher's quads are sound, repair them, and rate them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree

from ...params import RegulariseParams
from ..checking.check import Finding, as_quad_mesh, findings
from ..checking.topology import sides_of
from ..mesh import PolygonMesh
from .bodies import is_clean, target_surface
from .mend import FOLDED, POOR, USELESS, TargetSurface, mend_quads, mesh_from_rows
from .quality import quality
from .refine import refine_quads
from .regularise import flatten_bent_quads, regularise

# Weight of the share of poor quads in the cost: a tenth of poor quads doubles the cost. Larger: fewer poor quads, but
# less regular meshes.
POOR_WEIGHT = 10.0
# Distance between quads and surface (95th percentile), in whole quad edges, from which quads are rejected: thin parts,
# such as a rabbit's ears, are lost. Larger: worse results are accepted.
MAX_MISSED = 3
# Largest area of the quads, as a share of the surface's area. More means a second skin, as when the remesher closes an
# open surface; sound results of open surfaces have 0.92 to 0.97. Larger: closed surfaces may pass.
MAX_AREA_RATIO = 1.2
# A quad fills a hole if all its corners are within this distance of the surface's border, in quad edges, and its middle
# is off the surface or the quad faces the other way. Larger: quads at narrow parts are removed too.
BORDER_DISTANCE = 0.6
# Distance of a quad's middle from the surface, in quad edges, above which the middle is off the surface. Larger: more
# holes stay filled.
FILL_DISTANCE = 0.1


@dataclass(frozen=True, eq=False)
class SoundQuads:
    """Sound quads with their rating.

    faults : number of quads without room for a spiral; distance by which parts of the surface are missed, in whole quad
        edges; number of poor quads
    cost : ``Quality.cost``, raised for poor quads and for deviations from the wanted number of quads
    """

    quads: PolygonMesh
    faults: tuple[int, int, int]
    cost: float


def repair_and_rate(
    raw: PolygonMesh, target: TargetSurface, count: int, times: int = 0, sharp: bool = False
) -> SoundQuads | str:
    """Subdivide, repair and rate a remesher's quads; return the reason if they are unusable.

    Parameters
    ----------
    raw : result of the remesher
    target : surface that the quads should cover
    count : wanted number of quads
    times : number of subdivisions
    sharp : whether corners are moved onto sharp edges even without a subdivision
    """
    if not (raw.sizes == 4).all():
        return "QuadriFlow left faces that are not quads"
    if not is_clean(raw):
        return "its quads are not a clean surface"
    unfilled = reopen_holes(raw, target)
    made = mend_quads(refine_quads(unfilled, target, times) if times or sharp else unfilled, target)
    judged = rate_quads(made, target, count)
    moved = snap_to_border_corners(made, target)
    again = judged if moved is made else rate_quads(moved, target, count)
    kept = isinstance(again, SoundQuads) and (isinstance(judged, str) or again.faults <= judged.faults)
    return again if kept else judged


def snap_to_border_corners(quads: PolygonMesh, target: TargetSurface) -> PolygonMesh:
    """Return quads whose nearest border vertex is moved onto each corner of the surface's border.

    Remeshers cut these corners off.

    Parameters
    ----------
    quads : quad mesh
    target : the surface that the quads cover
    """
    corners = target.vertices[target.border_corners]
    sides = sides_of(quads)
    border = np.unique(sides.edges[np.bincount(sides.edge) == 1])
    if not len(corners) or not len(border):
        return quads
    edge = (target_surface(quads).area / len(quads.sizes)) ** 0.5
    away, nearest = cKDTree(quads.vertices[border]).query(corners, distance_upper_bound=edge)
    order = np.argsort(away)[: int(np.isfinite(away).sum())]
    vertex, first = np.unique(border[nearest[order]], return_index=True)  # the nearest corner for each vertex
    moved = quads.vertices.copy()
    moved[vertex] = corners[order[first]]
    return replace(quads, vertices=moved)


def rate_quads(quads: PolygonMesh, target: TargetSurface, count: int) -> SoundQuads | str:
    """Rate quads that should cover a surface, without repairing them; return the reason if they are unusable.

    Parameters
    ----------
    quads : quad mesh
    target : surface that the quads should cover
    count : wanted number of quads
    """
    found = findings(quads)
    errors = [f for f in found if f.is_error]
    if errors:
        folded = sum(len(f.faces) for f in errors if f.code in FOLDED)
        return f"{folded} of {len(quads.sizes)} quads are folded" if folded else "its quads differ too much in size"
    made = target_surface(quads)
    edge = (target.area / count) ** 0.5
    if made.area > MAX_AREA_RATIO * target.area:
        return "its open side was closed, or both of its sides were covered"
    missed = int(
        max(
            np.percentile(made.distances(target.sample_points), 95),
            np.percentile(target.distances(made.sample_points), 95),
        )
        / edge
    )
    if missed >= MAX_MISSED:
        return "parts of the surface are lost"
    useless, poor = _count_faces(found, USELESS), _count_faces(found, POOR)
    cost = (
        quality(quads, target).cost
        * (1.0 + POOR_WEIGHT * poor / len(quads.sizes))
        * (1.0 + abs(len(quads.sizes) / count - 1.0))
    )
    return SoundQuads(quads, (useless, missed, poor), cost)


def reopen_holes(raw: PolygonMesh, target: TargetSurface) -> PolygonMesh:
    """Return quads without those that fill holes of the surface; QuadriFlow fills holes surrounded by up to 25 edges.

    Parameters
    ----------
    raw : quads of the remesher
    target : surface that the quads should cover
    """
    rows = raw.corners.reshape(-1, 4)
    size = (target_surface(raw).area / len(rows)) ** 0.5
    at_border = target.distances_to_border(raw.vertices) < BORDER_DISTANCE * size
    corners = raw.vertices[rows]
    middles = corners.mean(axis=1)
    there, normals = target.nearest(middles)
    across = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
    back = np.einsum("fi,fi->f", across, normals) < 0  # quads that fill a hole over a flat part face the other way
    filling = at_border[rows].all(axis=1) & (back | (np.linalg.norm(there - middles, axis=1) > FILL_DISTANCE * size))
    if not filling.any() or filling.all():
        return raw
    unfilled = mesh_from_rows(raw.vertices, rows[~filling])
    return unfilled if is_clean(unfilled) else raw


def regularise_if_better(quads: PolygonMesh) -> PolygonMesh:
    """Regularise quads if that reduces the poor quads, then flatten bent quads if that makes no more quads poor.

    If neither helps, return the quads unchanged.
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
    pressed = flatten_bent_quads(mesh)
    if pressed is mesh:
        return best
    flat = PolygonMesh.from_quads(pressed)
    return flat if _count_faces(findings(flat), POOR) <= poor else best


def _count_faces(found: list[Finding], codes: set[str]) -> int:
    """Return the number of faces named by findings with these codes."""
    return sum(len(one.faces) for one in found if one.code in codes)
