"""Make the panels of several pieces, each with its own settings, and lay them on common sheets."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from ...errors import FlexMapsError
from ...params import ObjectSettings
from ...progress import SILENT, Progress
from ...runs import job
from ...runs.outputs import DesignVersion, MakingEstimate, SheetPlan
from ...runs.result import Result
from .batch import Batch, BatchPiece, nest_batch


def nest_together(
    names: Sequence[str], results: Sequence[Result], settings: Sequence[ObjectSettings], progress: Progress = SILENT
) -> Batch:
    """Lay the panels of several pieces on common sheets.

    Parameters
    ----------
    names : names of the pieces, for messages and labels
    results : results of each piece, at least up to the spirals
    settings : settings of each piece; those of the sheet are taken from the first piece
    progress : called with the fraction done; may cancel

    Raises
    ------
    FlexMapsError : there are no pieces, or a piece cannot be cut; the message begins with its name
    """
    parts = []
    for k, (name, result, own) in enumerate(zip(names, results, settings, strict=True)):
        part = progress.part(0.4 * k / len(names), 0.4 * (k + 1) / len(names))
        parts.append(_make_batch_piece(name, result, own, settings[0], part))
    if not parts:
        raise FlexMapsError("There is nothing to lay on sheets; name at least one piece")
    return nest_batch(parts, settings[0].sheet, progress.part(0.4, 1.0))


def _make_batch_piece(
    name: str, result: Result, own: ObjectSettings, first: ObjectSettings, progress: Progress
) -> BatchPiece:
    # the piece's own sheets are discarded, so nest them quickly and without remnants
    quick = replace(own, sheet=replace(first.sheet, nesting="FAST", remnants=""))
    try:
        made = job.run_stages(result, quick, ("sheets",), progress)
        estimate, design = made.need(MakingEstimate), made.need(DesignVersion).design
        sheets, material = made.need(SheetPlan).sheets, own.material.chosen
        return BatchPiece(name, design, sheets, material, estimate.estimates, estimate.assembly, own.export.copies)
    except FlexMapsError as error:
        raise FlexMapsError(f"{name}: {error}", faces=error.faces) from None
