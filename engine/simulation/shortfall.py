"""Whether a shape is no success: pieces that stay flat, or come to rest far from their target, and what would help them.

The relief of a surface is the root mean square distance of its middles from their best plane. Two kinds are far apart:
over 62 simulations of domes, saddles, hypars, barrels, tubes and waves of three heights, free or standing on their
lowest quads, and 100 surfaces of the zoo, a sheet that stays flat keeps at most 12 % of its target's relief, nearly
always none, and every other piece at least 45 %.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays import Bool, Float, Int
from ..patches.layout import PatchLayout
from ..patches.tracing.trace import middle_line
from ..surface.mesh import QuadMesh
from .visible import FAR

MISSED = 0.5  # RMS distance as a share of the target's relief: more than half of what should stand up does not
FLAT = 0.25  # share of the target's relief below which a piece has stayed flat
LOW = 0.005  # relief as a share of the diagonal below which the target itself is as good as flat
# radians of total Gaussian curvature within patches: domes and saddles of less stayed flat with seams, too
CURVED = 0.6


@dataclass(frozen=True, eq=False)
class Shortfall:
    """One piece that is far from its target.

    quads : (k,) int; rms : distance from the target as a share of the piece's diagonal; flat : whether it has stayed flat
    held : whether supports hold it; open : whether it has a border
    line : (c,) int, the edges of a cut that would let it curve, where one would
    """

    quads: Int[np.ndarray, " some"]
    rms: float
    flat: bool
    held: bool
    open: bool
    line: Int[np.ndarray, " c"]

    @property
    def wrong(self) -> str:
        """A sentence on what is wrong."""
        kind = "The piece stays flat" if self.flat else "The shape is far from its target"
        return f"{kind}: RMS distance {100.0 * self.rms:.1f} % of its size."

    @property
    def help(self) -> str:
        """A sentence on what helps, with a blank before it; nothing where neither supports nor a cut would."""
        ways = []
        if self.open:
            ways.append("hold it at more places" if self.held else "name supports, best at opposite borders")
        if len(self.line):
            ways.append(
                f"cut it along a line through its middle, {len(self.line)} edges long, so that it can curve both ways"
            )
        return f" To bring it nearer, {', or '.join(ways)}." if ways else ""


def shortfalls(
    layout: PatchLayout, target: QuadMesh, centres: Float[np.ndarray, "spirals 3"], held: Bool[np.ndarray, " spirals"]
) -> list[Shortfall]:
    """The pieces that are far from their target, the worst first.

    centres : (n, 3) metres of the hubs at rest; held : (n,) bool, the supports
    """
    mesh, found = target, []
    for k in range(int(mesh.body_of.max()) + 1):
        quads = np.flatnonzero(mesh.body_of == k)
        size = float(np.linalg.norm(np.ptp(mesh.vertices[mesh.quads[quads]].reshape(-1, 3), axis=0)))
        wanted, own = mesh.centroids[quads], centres[quads]
        rms, asked = float(np.sqrt(((own - wanted) ** 2).sum(axis=1).mean())), relief(wanted)
        flat = asked > LOW * size and relief(own) < FLAT * asked
        if flat or rms > FAR * size or (asked > LOW * size and rms > MISSED * asked):
            border = bool(mesh.border[mesh.quad_edges[quads]].any())
            found.append(Shortfall(quads, rms / size, flat, bool(held[quads].any()), border, _line(layout, quads)))
    return sorted(found, key=lambda s: -s.rms)


def relief(points: Float[np.ndarray, "spirals 3"]) -> float:
    """Root mean square distance of points (n, 3) from their best plane."""
    return float(np.linalg.svd(points - points.mean(axis=0), compute_uv=False)[-1] / np.sqrt(len(points)))


def _line(layout: PatchLayout, quads: np.ndarray) -> Int[np.ndarray, " c"]:
    """(c,) int: the edges of the line that halves the most curved patch among these quads; none where no patch is curved."""
    curved = curvature_within(layout)[quads]
    patch = layout.patch_of[quads]
    total = np.bincount(patch, weights=curved)
    worst = int(total.argmax())
    return middle_line(layout, worst) if total[worst] > CURVED else np.zeros(0, dtype=np.int64)


def curvature_within(layout: PatchLayout) -> Float[np.ndarray, " quads"]:
    """(F,) radians: the total of absolute Gaussian curvature that no seam of the layout lets out, shared among the quads.

    By the theorem of Gauss and Bonnet for corners: a vertex has what its angles lack of a full turn, a skew quad what its
    angles lack of one.
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
