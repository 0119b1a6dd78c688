"""Flatten a layout, and judge it by the shape that its assembled panels take after a short optimisation."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ...arrays import Bool, Float, Int
from ...errors import FlexMapsError
from ...mechanics.laplacian import laplacian_difference
from ...optimisation.match_limits import MatchLimits, find_limits
from ...optimisation.optimise import optimise
from ...params import Settings
from ...patches.flattening.flatten import FlatPatches, flatten, overlapping_patches
from ...patches.layout import PatchLayout
from ...patches.merging.dissolve import join_small_panels
from ...patches.splitting.split import split_to_sheet
from ...patches.tracing.trace import make_disks
from ...progress import SILENT, Progress
from ...simulation.shortfall import quad_curvatures
from ...simulation.simulate import Simulation
from ...spirals.fabricable import curvature_adjusted, make_fabricable
from ...surface import curvature
from ...surface.mesh import QuadMesh
from ...surface.symmetry import Symmetry, preserved_by
from .drawn_cuts import open_symmetrically

# Durations of a short and a long search, as shares of the optimiser's patience (its time budget). Larger: more reliable
# comparison, more time. Short and long searches mostly rank layouts in the same order
SHORT_SHARE, LONG_SHARE = 0.15, 0.35
FULL_SHARE = 1.0  # share recorded for a layout that the user had optimised with the full patience
# A layout whose strain is s > 1 times the limit after a long search is expected to be s^STRAIN_EXPONENT times as far
# from the target once its strain is reduced to the limit; larger: overstrained layouts rank lower
STRAIN_EXPONENT = 2
# A short search has its full duration from FULL_SEARCH_QUADS quads on. With fewer quads its duration is proportional to
# their number, but at least the share MIN_SHARE. Larger FULL_SEARCH_QUADS or smaller MIN_SHARE: faster on small pieces,
# less reliable
FULL_SEARCH_QUADS, MIN_SHARE = 1000, 0.25


@dataclass(frozen=True, eq=False)
class LayoutProblem:
    """Data common to all layouts of a surface.

    mesh : the target; settings : settings of all stages
    supports : (k,) indices of supported quads, or None
    force : (F, 3) force on every quad, newtons, or None
    symmetries : symmetries of the mesh; empty if layouts need not be symmetric
    spirals : widths (F, 4) metres and twists (F,) radians of an optimised layout, from which searches start; or None
    """

    mesh: QuadMesh
    settings: Settings
    supports: Int[np.ndarray, " held"] | None = None
    force: Float[np.ndarray, "quads 3"] | None = None
    symmetries: tuple[Symmetry, ...] = ()
    spirals: tuple[Float[np.ndarray, "quads 4"], Float[np.ndarray, " quads"]] | None = None

    @property
    def is_loaded(self) -> bool:
        """Whether the piece is supported. Supports and forces can bend even a single panel without cuts."""
        return self.supports is not None and len(self.supports) > 0

    def restrict_to(self, mesh: QuadMesh, quads: Int[np.ndarray, " some"]) -> LayoutProblem:
        """Return the problem for a subset of the quads alone, without symmetries.

        Parameters
        ----------
        mesh : mesh of these quads
        quads : their indices in the whole mesh, ascending
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
class CutPlan:
    """A set of cuts that is not flattened yet.

    cut : (E,) whether an edge is cut; origin : how the cuts were made, in a few words
    even : whether patches that are not disks (tubes, rings) are opened by symmetric cuts
    """

    cut: Bool[np.ndarray, " edges"]
    origin: str
    even: bool = False


@dataclass(frozen=True, eq=False)
class FlatLayout:
    """A flattened layout whose panels fit the sheet.

    flat : its flat panels
    origin : how the cuts were made, in a few words
    symmetric : 1 + number of the surface's symmetries that the layout keeps
    """

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
    """A layout with the match, strain and cutting figures of its assembled panels.

    laid : the layout
    rms, largest : RMS and largest distance from the target, shares of the target's size
    strain : largest strain, as a share of the limit
    closed : number of closed slots; None if not counted
    blame : (F,) mismatch of every quad: squared difference of its bending from the target's, square metres
    kind : (F,) reason for the mismatch, index into ``match_limits.REASON_NAMES``
    advice : sentence on what limits the match
    share : duration of the search, as a share of the optimiser's patience; 0 if the match is predicted
    cut_length : length of all outlines without connectors, metres; None if the outlines were not computed
    contours : number of closed curves to cut; None if the outlines were not computed
    spirals : widths (F, 4) metres and twists (F,) radians after the search
    flat : the panels after the search, which may have changed their flat shapes
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
        """Whether ``rms`` is reliable: reached by the full search, or by a long one with strains within the limit."""
        return self.share >= FULL_SHARE or (self.share >= LONG_SHARE and self.strain <= 1.0)

    @property
    def eased(self) -> float:
        """RMS distance from the target, a share of its size, that is expected once strains are within the limit.

        It equals ``rms`` unless a long search ended with strains beyond the limit.
        """
        return (
            self.rms * max(1.0, self.strain) ** STRAIN_EXPONENT if LONG_SHARE <= self.share < FULL_SHARE else self.rms
        )


def starting_spirals(piece: LayoutProblem) -> tuple[Float[np.ndarray, "quads 4"], Float[np.ndarray, " quads"]]:
    """Return the widths (F, 4), metres, and twists (F,), radians, from which searches start.

    These are ``piece.spirals`` if present, else spirals adjusted to the curvature of the surface.
    """
    return piece.spirals or curvature_adjusted(piece.settings.spiral, curvature.rms_curvature(piece.mesh))


def flatten_cuts(
    piece: LayoutProblem, idea: CutPlan, most: float = np.inf, progress: Progress = SILENT
) -> FlatLayout | None:
    """Flatten a plan of cuts, after opening patches that are not disks and joining patches that are too small.

    Panels larger than a sheet are cut again.

    Parameters
    ----------
    piece : the surface, its symmetries and settings
    idea : the plan
    most : largest absolute Gaussian curvature within a panel, radians
    progress : called with the fraction done; may cancel

    Returns
    -------
    the layout; None if flattening fails, if panels overlap themselves, if a panel has more curvature than ``most``, or
    if the plan is ``even`` and ``open_symmetrically`` finds no cuts
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
        disks = join_small_panels(disks, layout, piece.symmetries, progress)
        flat = split_to_sheet(flatten(disks, layout, progress), layout, sheet, progress)
    except FlexMapsError:
        return None
    if overlapping_patches(flat):
        return None
    return FlatLayout(flat, idea.origin, 1 + len(preserved_by(piece.symmetries, flat.layout.cut)))


def panel_curvature(layout: PatchLayout) -> float:
    """Return the integral of the absolute Gaussian curvature over the most curved panel, radians."""
    return float(np.bincount(layout.patch_of, quad_curvatures(layout)).max())


def judge(
    piece: LayoutProblem,
    laid: FlatLayout,
    share: float = SHORT_SHARE,
    progress: Progress = SILENT,
    thorough: bool | None = None,
) -> JudgedLayout | None:
    """Judge a layout by a search of limited duration from ``starting_spirals``.

    Parameters
    ----------
    piece : the surface, its supports and forces, and the settings
    laid : one of its layouts
    share : duration, as a share of the optimiser's patience
    progress : called with the fraction done; may cancel
    thorough : whether to open and count closed slots, and to try several starts if ``piece.spirals`` is None; default
        is True only if ``share`` is above ``SHORT_SHARE``

    Returns
    -------
    None if the layout has no equilibrium, or its spirals cannot be cut
    """
    settings, quick = piece.settings, share <= SHORT_SHARE
    thorough = not quick if thorough is None else thorough
    params = settings.optimise
    patience = share * (params.patience or 1.0)
    if not thorough:
        patience *= float(np.clip(len(piece.mesh.quads) / FULL_SEARCH_QUADS, MIN_SHARE, 1.0))
        params = replace(params, open_slots=False)
    params = replace(params, patience=patience, restart=thorough and piece.spirals is None)
    try:
        design = make_fabricable(
            laid.flat, settings.spiral, *starting_spirals(piece), check_outlines=not quick, progress=progress.quiet()
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
        return _with_cut_lengths(
            judge_shape(laid, found.after, find_limits(found, remedies=False), share, thorough=thorough), found.after
        )
    except FlexMapsError:
        return None


def judge_optimised(laid: FlatLayout, found: Simulation) -> JudgedLayout:
    """Judge a layout whose spirals are already optimised.

    Parameters
    ----------
    laid : the layout
    found : simulation of its optimised spirals
    """
    return _with_cut_lengths(
        judge_shape(laid, found, find_limits(found, remedies=False), FULL_SHARE, thorough=True), found
    )


def _with_cut_lengths(known: JudgedLayout, simulation: Simulation) -> JudgedLayout:
    """Return a copy with the length of cuts and the number of contours, taken from the outlines."""
    curves = [curve for panel in simulation.design.outlines() for curve in (panel.outer, *panel.holes)]
    return replace(known, cut_length=sum(curve.length for curve in curves), contours=len(curves))


def judge_shape(
    laid: FlatLayout, found: Simulation, limits: MatchLimits, share: float, *, thorough: bool
) -> JudgedLayout:
    """Judge a layout by its simulated shape; the length of cuts and the number of contours stay None.

    Parameters
    ----------
    laid : the layout
    found : simulation of the layout
    limits : reasons why the simulated shape misses the target
    share : duration of the search that led to this shape, as a share of the optimiser's patience
    thorough : whether to count closed slots
    """
    bends = laplacian_difference(found.assembly.pairs, found.equilibrium.pose.centres, found.target.centroids)
    match, measured = found.target_distances, found.slots() if thorough else None
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
