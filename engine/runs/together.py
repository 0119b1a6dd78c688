"""Several pieces that are cut together: each one's panels as its own settings have them, on common sheets."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from ..errors import FlexMapsError
from ..fabrication.batch import Batch, Part, batch
from ..params import ObjectSettings
from ..progress import SILENT, Progress
from . import job, stages
from .result import Result


def together(
    names: Sequence[str], results: Sequence[Result], settings: Sequence[ObjectSettings], progress: Progress = SILENT
) -> Batch:
    """Pieces with spirals on common sheets, as the first one's settings of the sheet say, each as often as its copies.

    Raises ``FlexMapsError``, of one piece with its name.
    """
    parts = []
    for k, (name, result, own) in enumerate(zip(names, results, settings, strict=True)):
        part = progress.part(0.4 * k / len(names), 0.4 * (k + 1) / len(names))
        parts.append(_part(name, result, own, settings[0], part))
    if not parts:
        raise FlexMapsError("There is nothing to lay on sheets; name at least one piece")
    return batch(parts, settings[0].sheet, progress.part(0.4, 1.0))


def _part(name: str, result: Result, own: ObjectSettings, first: ObjectSettings, progress: Progress) -> Part:
    # where its panels would lie alone is of no interest, so that is found quickly, and without remnants
    quick = replace(own, sheet=replace(first.sheet, nesting="FAST", remnants=""))
    try:
        made = job.go_on(result, quick, ("sheets",), progress)
        sheets, figures = stages.needed(made, "sheets"), stages.needed(made, "estimates")
        return Part(
            name, stages.needed(made, "design"), sheets, own.material.chosen, figures, made.assembly, own.export.copies
        )
    except FlexMapsError as error:
        raise FlexMapsError(f"{name}: {error}", faces=error.faces) from None
