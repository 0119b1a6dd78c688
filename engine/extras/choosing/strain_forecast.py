"""Forecast, from a layout alone, whether arms will be strained beyond the limit of the material."""

from __future__ import annotations

from dataclasses import replace

from ...errors import FlexMapsError
from ...patches.flattening.flatten import FlatPatches
from ...progress import SILENT, Progress
from ...simulation.simulate import simulate
from ...spirals.fabricable import make_fabricable
from .judge import LayoutProblem
from .predict import PredictionStart


def strain_of_softest(piece: LayoutProblem, flat: FlatPatches, progress: Progress = SILENT) -> float | None:
    """Return the largest strain at equilibrium with the softest spirals that can be cut.

    This is nearly a lower bound for all designs: stiffer spirals have larger strains, but a search can reduce the
    strain of single arms by changing their neighbours.

    Parameters
    ----------
    piece : the surface, its supports and forces, and the settings
    flat : one of its layouts
    progress : called with the fraction done; may cancel

    Returns
    -------
    strain as a share of the material's limit; None if there is no equilibrium, no room for spirals, or no strain in the
    chosen model
    """
    settings = piece.settings
    try:
        softest = PredictionStart.from_layout(piece, flat, progress.part(0.0, 0.4)).with_uniform_spirals(0.0, 1.0)
        design = make_fabricable(
            flat, settings.spiral, *softest.spirals, check_outlines=False, progress=progress.part(0.4, 0.5)
        )
        rest = simulate(
            design,
            piece.mesh,
            settings.material.chosen,
            replace(settings.simulate, restarts=0),
            supports=piece.supports,
            force=piece.force,
            progress=progress.part(0.5, 1.0),
        )
    except FlexMapsError:
        return None
    if rest.strain is None or not rest.equilibrium.converged:
        return None
    return float(rest.strain.max())
