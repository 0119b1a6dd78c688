"""Flatten a layout, and judge it by the shape of its assembled panels after a short optimisation."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ...arrays import Bool, Float, Int
from ...errors import FlexMapsError
from ...mechanics.laplacian import laplacian_difference
from ...optimisation.optimise import optimise
from ...optimisation.reach import MatchLimits, find_limits
from ...params import Settings
from ...patches.flattening.flatten import FlatPatches, flatten, overlapping
from ...patches.layout import PatchLayout
from ...patches.merging.dissolve import without_crumbs
from ...patches.splitting.split import split
from ...patches.tracing.trace import make_disks
from ...progress import SILENT, Progress
from ...simulation.shortfall import angle_defects
from ...simulation.simulate import Simulation
from ...spirals.fabricable import curvature_adjusted, make_fabricable
from ...surface import curvature
from ...surface.mesh import QuadMesh
from ...surface.symmetry import Symmetry, keeping
from .drawn_cuts import open_symmetrically

# Shares of the optimiser's own patience. Four layouts of 986 quads end at 0.50, 0.41, 0.21 and 0.16 % of RMS distance after 5 s of
# a short search, and at 0.33, 0.22, 0.09 and 0.06 % after 12 s of a long one: the order is the same
SHORT, LONG = 0.15, 0.35
WHOLE = 1.0  # share of patience recorded for a piece that Optimise has optimised
# Exponent by which excess strain predicts how much farther a whole search ends than a long one. Two layouts of a cone ended at 0.60 and 0.90 % with 1.26 and
# 1.12 times the strain limit, and whole searches, which reduce the strain, at 0.86 and 1.15 %
EASED = 2
# Number of quads for which a short search has its full patience, and the smallest share of it for fewer quads, whose steps take less
# time. With the full patience a dome of 48 quads was searched to a millionth of its size
QUADS, LEAST = 1000, 0.25


@dataclass(frozen=True, eq=False)
class LayoutProblem:
    """Data common to all layouts of a surface.

    mesh : the target; supports : (k,) int or None; force : (F, 3) newtons or None
    symmetries : of the mesh; empty if layouts need not be symmetric
    spirals : widths (F, 4) metres and twists (F,) radians from which searches start, of a layout that was optimised; or None
    """

    mesh: QuadMesh
    settings: Settings
    supports: Int[np.ndarray, " held"] | None = None
    force: Float[np.ndarray, "quads 3"] | None = None
    symmetries: tuple[Symmetry, ...] = ()
    spirals: tuple[Float[np.ndarray, "quads 4"], Float[np.ndarray, " quads"]] | None = None

    @property
    def is_loaded(self) -> bool:
        """Whether supports or forces deform the piece, so that one panel without cuts need not stay flat."""
        return self.supports is not None and len(self.supports) > 0

    def restrict_to(self, mesh: QuadMesh, quads: Int[np.ndarray, " some"]) -> LayoutProblem:
        """Return the problem of some quads by themselves, without symmetries.

        Parameters
        ----------
        mesh : mesh of these quads
        quads : their indices, ascending
        """
        return replace(
            self,
            mesh=mesh,
            supports=None if self.supports is None else np.flatnonzero(np.isin(quads, self.supports)),
            force=None if self.force is None else self.force[quads],
            symmetries=(),
            spirals=self.spirals and (self.spirals[0][quads], self.spirals[1][quads]),
        )


@dataclass(frozen=True, eq=False)
class Idea:
    """A possible set of cuts, (E,) bool, and its origin in a few words.

    even : open patches that are not disks with the symmetries of the cuts
    """

    cut: Bool[np.ndarray, " edges"]
    origin: str
    even: bool = False


@dataclass(frozen=True, eq=False)
class FlatLayout:
    """A flattened idea; every panel fits its sheet."""

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
        """Number of joints to snap together: pairs of arms that meet across a cut."""
        return int(self.cut.sum())

    @property
    def seams(self) -> float:
        """Length of all seams on the surface, metres."""
        return float(self.flat.layout.mesh.edge_lengths[self.cut].sum())


@dataclass(frozen=True, eq=False)
class JudgedLayout:
    """Match, strains and making figures of a layout's assembled panels.

    rms, largest : distance from the target as a share of its size; strain : largest, as a share of the limit
    blame : (F,) squared difference between every quad's bending and the target's, square metres; kind : index into ``reach.REASON_NAMES``
    advice : what limits the match, in a sentence; closed : number of closed slots; None if not counted
    share : of the optimiser's patience that its search had; 0 if the match is predicted
    cut_length : of cuts without connectors, metres; contours : number of closed curves; None if the panels were not drawn
    spirals : widths and twists, as in ``LayoutProblem``; flat : the panels after the search, which may change their flat shapes
    """

    laid: FlatLayout
    rms: float
    largest: float
    strain: float
    closed: int | None
    blame: Float[np.ndarray, " quads"]
    kind: Int[np.ndarray, " quads"]
    advice: str
    share: float
    cut_length: float | None
    contours: int | None
    spirals: tuple[Float[np.ndarray, "quads 4"], Float[np.ndarray, " quads"]]
    flat: FlatPatches

    @property
    def proved(self) -> bool:
        """Whether ``rms`` is reliable: a long search reached it, with strains within the limit."""
        return self.share >= WHOLE or (self.share >= LONG and self.strain <= 1.0)

    @property
    def eased(self) -> float:
        """Expected RMS distance once a long search's strains are brought within the limit; for other searches, ``rms``."""
        return self.rms * max(1.0, self.strain) ** EASED if LONG <= self.share < WHOLE else self.rms


def starting_spirals(piece: LayoutProblem) -> tuple[Float[np.ndarray, "quads 4"], Float[np.ndarray, " quads"]]:
    """Return the widths (metres) and twists (radians) from which searches start: those of the piece, or the curvature-adjusted ones.

    Parameters
    ----------
    piece : the surface and settings
    """
    return piece.spirals or curvature_adjusted(piece.settings.spiral, curvature.rms_curvature(piece.mesh))


def lay_flat(piece: LayoutProblem, idea: Idea, most: float = np.inf, progress: Progress = SILENT) -> FlatLayout | None:
    """Flatten an idea: open patches that are not disks, join tiny ones, cut those larger than a sheet. None if that fails, or if
    an ``even`` idea gives the same cuts as without ``even``.

    most : largest curvature within a panel, radians; ideas with more give None
    """
    layout, sheet = piece.settings.layout, piece.settings.sheet
    try:
        inner = idea.cut & ~piece.mesh.border
        cut = open_symmetrically(inner, piece.mesh, piece.symmetries) if idea.even else inner
        if cut is None:
            return None
        disks = make_disks(PatchLayout(piece.mesh, cut))
        if panel_curvature(disks) > most:
            return None
        disks = without_crumbs(disks, layout, piece.symmetries, progress)
        flat = split(flatten(disks, layout, progress), layout, sheet, progress)
    except FlexMapsError:
        return None
    if overlapping(flat):
        return None
    return FlatLayout(flat, idea.origin, 1 + len(keeping(piece.symmetries, flat.layout.cut)))


def panel_curvature(layout: PatchLayout) -> float:
    """Return the curvature within the most curved panel, radians."""
    return float(np.bincount(layout.patch_of, angle_defects(layout)).max())


def judge(
    piece: LayoutProblem,
    laid: FlatLayout,
    share: float = SHORT,
    progress: Progress = SILENT,
    thorough: bool | None = None,
) -> JudgedLayout | None:
    """Judge a layout by a search with a share of the optimiser's patience; return None if it has no equilibrium.

    The search starts from the piece's spirals, or from the curvature-adjusted ones.

    Parameters
    ----------
    piece : the surface, how it is held, and what it is made of
    laid : one of its layouts
    share : of the optimiser's patience
    progress : called with the fraction done; may cancel
    thorough : open and count closed slots, and try several starts if the piece has no spirals; default is only in searches with a
        share above ``SHORT``
    """
    settings, quick = piece.settings, share <= SHORT
    thorough = not quick if thorough is None else thorough
    params = settings.optimise
    patience = share * (params.patience or 1.0)
    if not thorough:
        patience *= float(np.clip(len(piece.mesh.quads) / QUADS, LEAST, 1.0))
        params = replace(params, open_slots=False)
    params = replace(params, patience=patience, restart=thorough and piece.spirals is None)
    try:
        design = make_fabricable(
            laid.flat, settings.spiral, *starting_spirals(piece), prove=not quick, progress=progress.quiet()
        )
        found = optimise(
            design,
            piece.mesh,
            settings.material.chosen,
            params,
            settings.simulate,
            supports=piece.supports,
            force=piece.force,
            prove=False,
            progress=progress.quiet(),
        )
        if not found.after.equilibrium.converged:
            return None
        return _drawn(
            judge_shape(laid, found.after, find_limits(found, remedies=False), share, thorough=thorough), found.after
        )
    except FlexMapsError:
        return None


def judge_optimised(laid: FlatLayout, found: Simulation) -> JudgedLayout:
    """Judge a layout whose spirals are already optimised.

    Parameters
    ----------
    laid : the layout
    found : its spirals at rest
    """
    return _drawn(judge_shape(laid, found, find_limits(found, remedies=False), WHOLE, thorough=True), found)


def _drawn(known: JudgedLayout, found: Simulation) -> JudgedLayout:
    """Return a judged layout with its length of cuts and number of contours."""
    curves = [curve for panel in found.design.outlines() for curve in (panel.outer, *panel.holes)]
    return replace(known, cut_length=sum(curve.length for curve in curves), contours=len(curves))


def judge_shape(
    laid: FlatLayout, found: Simulation, limits: MatchLimits, share: float, *, thorough: bool
) -> JudgedLayout:
    """Judge a layout by its shape at equilibrium, without figures of cutting.

    Parameters
    ----------
    laid : the layout
    found, limits : its equilibrium, and the reasons why it misses the target
    share : of the optimiser's patience that the search has had
    thorough : whether closed slots are counted
    """
    bends = laplacian_difference(found.assembly.pairs, found.equilibrium.pose.centres, found.target.centroids)
    match, measured = found.match, found.slots() if thorough else None
    return JudgedLayout(
        laid,
        match["rms_percent"] / 100.0,
        match["max_percent"] / 100.0,
        0.0 if found.strain is None else float(found.strain.max()),
        None if measured is None else len(measured.closed),
        (bends**2).sum(axis=1),
        limits.kind,
        limits.advice,
        share,
        None,
        None,
        (found.design.width, found.design.twist),
        found.design.flat,
    )
