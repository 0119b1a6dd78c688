"""Find bodies that stay flat or come to rest far from their target, and remedies for them.

A body is a connected part of the piece. The relief of a surface is the root mean square distance of its quad centres
from their best-fit plane.
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

# RMS distance from the target, as a share of the target's relief, above which a body is far from it; larger warns less
FAR_BY_RELIEF = 0.5
# relief, as a share of the target's relief, below which a body counts as having stayed flat: flat bodies have at most
# 0.12, all others at least 0.45
FLAT_RELIEF_SHARE = 0.25
# absolute Gaussian curvature of a patch, radians, above which a cut through it is proposed; larger: fewer cuts. For a
# flat body without seams a cut is always proposed
MIN_PATCH_CURVATURE = 0.6


@dataclass(frozen=True, eq=False)
class FarBody:
    """One body that is far from its target.

    quads : (k,) indices of its quads
    rms : RMS distance from the target, as a share of the body's diagonal
    is_flat : whether the body has stayed flat; has_seam : whether a seam runs through it
    is_supported : whether supports hold the body
    has_border : whether the body has a border
    is_whole_piece : whether the body is the whole piece
    cut_edges : (c,) indices of the edges of a cut that would let the body curve; empty if no cut would help
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
        """Sentence to users about the fault."""
        which = (
            "The piece"
            if self.is_whole_piece
            else f"One body of the piece, of {with_count(len(self.quads), 'quad', 'quads')},"
        )
        kind = "stays flat" if self.is_flat else "comes to rest far from its target"
        return f"{which} {kind}: the RMS distance is {format_figure(100.0 * self.rms)} % of {'its' if self.is_whole_piece else 'its own'} size."

    @property
    def remedy_text(self) -> str:
        """Sentence to users with the remedies, after a space; empty if neither supports nor a cut would help."""
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
    centres : (n, 3) hub centres at rest, metres
    is_supported : (n,) whether a support holds the hub's position
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
    """Return the edges (c,) that halve the most curved patch of a body; empty if no patch is curved enough.

    quads : quads of the body; any_curvature : whether to halve the patch no matter how little it is curved
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
    """Return the absolute Gaussian curvature (F,) of every quad, radians; vertices on seams and borders count as 0.

    The curvature is the angle defect (discrete Gauss-Bonnet). At a vertex this is 2 pi minus the sum of the angles
    around it, divided equally among its quads; in a quad 2 pi minus the sum of its own angles, which is 0 in a planar
    quad.
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
