"""One layout laid flat, and judged by the shape that its assembled panels take after a short optimisation."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..arrays import Bool, Float, Int
from ..errors import FlexMapsError
from ..mechanics.laplacian import laplacian_difference
from ..optimisation.optimise import Optimisation, optimise
from ..optimisation.reach import reach
from ..params import Settings
from ..patches.flattening.flatten import FlatPatches, flatten, overlapping
from ..patches.layout import PatchLayout
from ..patches.splitting.split import split
from ..patches.tracing.trace import make_disks
from ..progress import SILENT, Progress
from ..spirals.design import from_curvature
from ..surface import curvature
from ..surface.mesh import QuadMesh
from ..surface.symmetry import Symmetry, keeping

# Shares of the optimiser's own patience. On 986 quads a short search takes 4 s of a core and ends at 0.78 % where the whole one
# ends at 0.15 %; what matters is the order, and that hardly changes: see ``Choice``
SHORT, LONG = 0.15, 0.5


@dataclass(frozen=True, eq=False)
class Piece:
    """What all layouts of a surface have in common.

    mesh : the target; supports : (k,) int or None; force : (F, 3) newtons or None
    symmetries : of the mesh, none where layouts need not be symmetric
    """

    mesh: QuadMesh
    settings: Settings
    supports: Int[np.ndarray, " held"] | None = None
    force: Float[np.ndarray, "quads 3"] | None = None
    symmetries: tuple[Symmetry, ...] = ()


@dataclass(frozen=True, eq=False)
class Idea:
    """Where a surface could be cut, (E,) bool, and how somebody came upon that, in a few words."""

    cut: Bool[np.ndarray, " edges"]
    origin: str


@dataclass(frozen=True, eq=False)
class Laid:
    """An idea laid flat, every panel within its sheet."""

    flat: FlatPatches
    origin: str
    symmetric: int

    @property
    def cut(self) -> Bool[np.ndarray, " edges"]:
        return self.flat.layout.cut

    @property
    def panels(self) -> int:
        return len(self.flat.layout.patches)

    @property
    def joints(self) -> int:
        """Arms that meet across a cut: what somebody has to snap together."""
        return int(self.cut.sum())

    @property
    def seams(self) -> float:
        """Metres of seams on the surface."""
        return float(self.flat.layout.mesh.edge_lengths[self.cut].sum())


@dataclass(frozen=True, eq=False)
class Judged:
    """What the assembled panels of a layout do.

    rms, largest : distance from the target as a share of its size; strain : share of what the material bears
    blame : (F,) how much every quad's bending differs from the target's, squared metres; kind : index into ``reach.NAMES``
    advice : what limits the match, in a sentence; closed : slots that close; share : of the patience that it was given
    cut_length : metres of cuts, without connectors; contours : how many closed curves they are
    """

    laid: Laid
    rms: float
    largest: float
    strain: float
    closed: int
    blame: Float[np.ndarray, " quads"]
    kind: Int[np.ndarray, " quads"]
    advice: str
    share: float
    cut_length: float
    contours: int


def lay(piece: Piece, idea: Idea, progress: Progress = SILENT) -> Laid | None:
    """An idea laid flat: what is no disk is opened, what is larger than a sheet is cut. None where that cannot be."""
    layout, sheet = piece.settings.layout, piece.settings.sheet
    try:
        disks = make_disks(PatchLayout(piece.mesh, idea.cut & ~piece.mesh.border))
        flat = split(flatten(disks, layout, progress), layout, sheet, progress)
    except FlexMapsError:
        return None
    if overlapping(flat):
        return None
    return Laid(flat, idea.origin, 1 + len(keeping(list(piece.symmetries), flat.layout.cut)))


def judge(piece: Piece, laid: Laid, share: float = SHORT, progress: Progress = SILENT) -> Judged | None:
    """A layout judged with this share of the optimiser's patience; None where it takes no shape at all.

    A short search moves the spirals alone, a longer one what the settings say.
    """
    settings = piece.settings
    params = replace(settings.optimise, patience=share * (settings.optimise.patience or 1.0))
    if share <= SHORT:
        params = replace(params, codesign=False)
    try:
        design = from_curvature(laid.flat, settings.spiral, curvature.rms_curvature(piece.mesh), progress.quiet())
        found = optimise(
            design,
            piece.mesh,
            settings.material.chosen,
            params,
            settings.simulate,
            supports=piece.supports,
            force=piece.force,
            progress=progress.quiet(),
        )
    except FlexMapsError:
        return None
    return _judged(laid, found, share) if found.after.equilibrium.converged else None


def _judged(laid: Laid, found: Optimisation, share: float) -> Judged:
    after, limits = found.after, reach(found)
    bends = laplacian_difference(after.assembly.pairs, after.equilibrium.pose.centres, after.target.centroids)
    match, slots = after.match, after.slots()
    curves = [curve for panel in after.design.outlines() for curve in (panel.outer, *panel.holes)]
    return Judged(
        laid,
        match["rms_percent"] / 100.0,
        match["max_percent"] / 100.0,
        0.0 if after.strain is None else float(after.strain.max()),
        0 if slots is None else len(slots.closed),
        (bends**2).sum(axis=1),
        limits.kind,
        limits.advice,
        share,
        sum(curve.length for curve in curves),
        len(curves),
    )
