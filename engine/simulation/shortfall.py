"""Find bodies that stay flat or come to rest far from their target, and what a user can do about it.

A body is a connected part of the piece. The relief of a surface is the root mean square distance of its quads' centres
from the plane that fits them best.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays import Bool, Float, Int
from ..figures import format_figure
from ..patches.layout import PatchLayout
from ..patches.tracing.trace import middle_line
from ..surface.checking.finding import with_count
from ..surface.curvature import LOW_RELIEF, relief
from ..surface.mesh import QuadMesh
from .visible import REMEDY_WORDS, VISIBLE_RMS_SHARE

# A body is far from its target if the RMS distance is above this share of the target's relief; larger warns less
FAR_BY_RELIEF = 0.5
# A body has stayed flat if its relief is below this share of the target's relief. Bodies that stayed flat had at most
# 0.12, all others at least 0.45
FLAT_RELIEF_SHARE = 0.25
# A cut through a patch is proposed if the integral of its absolute Gaussian curvature is above this, radians; larger:
# fewer cuts. For a flat body without seams a cut is always proposed
MIN_PATCH_CURVATURE = 0.6


@dataclass(frozen=True, eq=False)
class FarBody:
    """One body that is far from its target.

    quads : (k,) indices of its quads
    rms : RMS distance from the target, as a share of the diagonal of the body's bounding box
    is_flat : the body has stayed flat
    has_seam : a seam runs through the body
    is_supported : supports hold the body
    has_border : the body has a border
    is_whole_piece : the body is the whole piece
    cut_edges : (c,) indices of the edges of a cut that would let the body curve; empty if no cut is proposed
    """

    quads: Int[np.ndarray, " some"]
    rms: float
    is_flat: bool
    has_seam: bool
    is_supported: bool
    has_border: bool
    is_whole_piece: bool
    cut_edges: Int[np.ndarray, " c"]

    @property
    def fault_text(self) -> str:
        """Message to users: how far the body is from its target, and whether it is flat."""
        which = (
            "The piece"
            if self.is_whole_piece
            else f"One body of the piece, of {with_count(len(self.quads), 'quad', 'quads')},"
        )
        kind = "stays flat" if self.is_flat else "comes to rest far from its target"
        return f"{which} {kind}: the RMS distance is {format_figure(100.0 * self.rms)} % of {'its' if self.is_whole_piece else 'its own'} size."

    @property
    def remedy_text(self) -> str:
        """Message to users: what to do about it. It begins with a space; it is empty if nothing would help."""
        ways = []
        if self.has_border:
            ways.append(
                "hold it at more places"
                if self.is_supported
                else "hold it with supports, best at opposite borders (Rests, in Piece)"
            )
        if len(self.cut_edges):
            ways.append(
                f"cut it along a line through its middle, {with_count(len(self.cut_edges), 'edge', 'edges')} long (Cut there), so that it can curve both ways"
            )
        return f" {REMEDY_WORDS}{', or '.join(ways)}." if ways else ""


def find_far_bodies(
    layout: PatchLayout,
    target: QuadMesh,
    centres: Float[np.ndarray, "spirals 3"],
    is_supported: Bool[np.ndarray, " spirals"],
) -> list[FarBody]:
    """Return the bodies that are far from their target, the worst first.

    Parameters
    ----------
    layout : mesh and cuts
    target : mesh that the piece should match
    centres : (n, 3) centres of the hubs in the simulated shape, metres
    is_supported : (n,) mask of the hubs whose position a support holds
    """
    mesh, far = target, []
    for k in range(mesh.body_count):
        quads = np.flatnonzero(mesh.body_of == k)
        size = float(np.linalg.norm(np.ptp(mesh.vertices[mesh.quads[quads]].reshape(-1, 3), axis=0)))
        wanted, own = mesh.centroids[quads], centres[quads]
        rms, height = float(np.sqrt(((own - wanted) ** 2).sum(axis=1).mean())), relief(wanted)
        flat = height > LOW_RELIEF * size and relief(own) < FLAT_RELIEF_SHARE * height
        if flat or rms > VISIBLE_RMS_SHARE * size or (height > LOW_RELIEF * size and rms > FAR_BY_RELIEF * height):
            edges = mesh.quad_edges[quads]
            seamed = bool(layout.cut[edges].any())
            far.append(
                FarBody(
                    quads,
                    rms / size,
                    flat,
                    seamed,
                    bool(is_supported[quads].any()),
                    bool(mesh.border[edges].any()),
                    len(quads) == len(mesh.quads),
                    _middle_cut(layout, quads, any_curvature=flat and not seamed),
                )
            )
    return sorted(far, key=lambda s: -s.rms)


def _middle_cut(layout: PatchLayout, quads: np.ndarray, *, any_curvature: bool) -> Int[np.ndarray, " c"]:
    """Return the edges (c,) along which the most curved patch of a body would be cut into halves.

    Empty if this patch has less curvature than ``MIN_PATCH_CURVATURE``, unless ``any_curvature``.

    quads : indices of the body's quads
    """
    curved = quad_curvatures(layout)[quads]
    patch = layout.patch_of[quads]
    total = np.bincount(patch, weights=curved)
    worst = int(total.argmax())
    return (
        middle_line(layout, worst)
        if any_curvature or total[worst] > MIN_PATCH_CURVATURE
        else np.zeros(0, dtype=np.int64)
    )


def quad_curvatures(layout: PatchLayout) -> Float[np.ndarray, " quads"]:
    """Return the integral (F,) of the absolute Gaussian curvature over every quad, radians.

    It is computed from angle defects (discrete Gauss-Bonnet), as a sum of two parts. The defect at a vertex is 2 pi
    minus the sum of the angles around it, or 0 on seams and borders; its absolute value is divided equally among the
    quads at the vertex. The defect in a quad is 2 pi minus the sum of its own angles, which is 0 if the quad is planar.
    """
    mesh = layout.mesh
    points = mesh.vertices[mesh.quads]
    ahead, back = np.roll(points, -1, axis=1) - points, np.roll(points, 1, axis=1) - points
    lengths = np.linalg.norm(ahead, axis=2) * np.linalg.norm(back, axis=2)
    angle = np.arccos(np.clip((ahead * back).sum(axis=2) / np.maximum(lengths, 1e-300), -1.0, 1.0))
    lack = 2.0 * np.pi - np.bincount(mesh.quads.ravel(), angle.ravel(), len(mesh.vertices))
    lack[mesh.edges[mesh.border | layout.cut].ravel()] = 0.0
    share = np.abs(lack) / np.maximum(mesh.valence, 1)
    return share[mesh.quads].sum(axis=1) + np.abs(2.0 * np.pi - angle.sum(axis=1))
