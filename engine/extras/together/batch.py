"""Lay several pieces, or several copies of a piece, on common sheets.

Each copy has a letter, which precedes every label engraved on that copy. Pieces share sheets only if their material,
thickness and cutter are equal.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ...arrays import Float
from ...errors import FlexMapsError
from ...fabrication.connectors.connect import Connections
from ...fabrication.estimates import Estimates
from ...fabrication.nesting.nest import nest
from ...fabrication.panels.labels import Labels, seam_name
from ...fabrication.panels.panel import Panel
from ...fabrication.sheets import (
    CutSheets,
    grain_rotation,
    key_panels,
    make_engraving,
    with_key_sheets,
    with_labels_beside,
)
from ...materials import Material
from ...params import SheetParams
from ...progress import SILENT, Progress
from ...spirals.contours import Outline
from ...spirals.design import SpiralDesign

MAX_PANELS = (
    2000  # largest number of panels on common sheets; larger: more time (the quick packing of 2,000 takes a minute)
)


@dataclass(frozen=True, eq=False)
class BatchPiece:
    """A piece to cut ``copies`` times.

    name : name for the user
    design : its spirals
    sheets : sheets with the panels of a single copy
    figures : mass, time and cost of a single copy
    assembly : ``AssemblyCheck`` of its seams, or None
    """

    name: str
    design: SpiralDesign
    sheets: CutSheets
    material: Material
    figures: Estimates
    assembly: Any = None  # ``fabrication.assembly_check.AssemblyCheck``
    copies: int = 1


@dataclass(frozen=True, eq=False)
class Batch:
    """Pieces on common sheets.

    parts : the pieces
    sheets : the sheets with the panels of all copies; ``Panel.piece`` is the index of the copy
    of : for each copy the index of its piece in ``parts``
    """

    parts: tuple[BatchPiece, ...]
    sheets: CutSheets
    of: tuple[int, ...]

    @property
    def designs(self) -> list[SpiralDesign]:
        """Designs of all copies, in order."""
        return [self.parts[k].design for k in self.of]

    def letters_of(self, part: int) -> list[str]:
        """Return the letters of the copies of the piece with this index."""
        return [seam_name(copy) for copy, k in enumerate(self.of) if k == part]

    def seen_by(self, part: int) -> CutSheets:
        """Return the common sheets from the viewpoint of one piece, for its assembly sheet.

        Panels of other pieces get the patch number -1; connectors and narrowest widths are those of this piece.

        part : index of the piece
        """
        panels = tuple(p if self.of[p.piece] == part else replace(p, patch=-1) for p in self.sheets.panels)
        own = self.parts[part].sheets
        return replace(
            self.sheets, panels=panels, connections=own.connections, slot_min=own.slot_min, bridge_min=own.bridge_min
        )


def nest_batch(parts: Sequence[BatchPiece], params: SheetParams, progress: Progress = SILENT) -> Batch:
    """Lay all copies of several pieces on common sheets.

    Parameters
    ----------
    parts : pieces with their numbers of copies
    params : size of the sheets, margin, spacing and labels
    progress : called with the fraction done; may cancel

    Raises
    ------
    FlexMapsError : no pieces, too many panels, or pieces of different material, thickness or cutter
    """
    _refuse_unlike(parts)
    of = tuple(k for k, part in enumerate(parts) for _ in range(part.copies))
    panels: list[Panel] = []
    keys: list[Panel] = []
    labels, small = np.zeros(2, dtype=int), []
    for copy, k in enumerate(progress.part(0.0, 0.2).each(of, "placing labels")):
        mark = seam_name(copy) if len(of) > 1 else ""
        made, of_copy = _engraved_copy(parts[k], copy, mark, params)
        labels += [of_copy.engraved_count, of_copy.left_out_count]
        small.append(of_copy.small)
        panels += [p for p in made if p.kind != "key"]
        keys += [p for p in made if p.kind == "key"]
    turns = np.array([grain_rotation(parts[of[p.piece]].design, params) for p in panels])
    shapes: list[Float[np.ndarray, "_ 2"]] = [
        p.outline.transform(turn, np.zeros(2)).sample(2e-5) for p, turn in zip(panels, turns.tolist(), strict=True)
    ]
    laid = nest(shapes, params, progress.part(0.2, 1.0))
    packing = replace(laid, rotation=laid.rotation + turns)
    packing = with_key_sheets(packing, tuple(Outline(key.outline, ()) for key in keys), params)
    all_panels: tuple[Panel, ...] = (*panels, *keys)
    for copy, of_copy_small in enumerate(small):
        all_panels, more = with_labels_beside(all_panels, packing, of_copy_small, params, copy)
        labels += [more, -more]
    first = parts[0].sheets
    several = [one.sheets for k in of for one in (parts[k],)]
    warnings = [f"{part.name}: {said}" for part in parts for said in part.sheets.warnings]
    sheets = CutSheets(
        all_panels, packing, params, tuple(warnings), int(labels[0]), int(labels[1]),
        min(s.slot_min for s in several), min(s.bridge_min for s in several),
        first.thickness, first.cut, _all_connections([s.connections for s in several]),
    )  # fmt: skip
    return Batch(tuple(parts), sheets, of)


def _refuse_unlike(parts: Sequence[BatchPiece]) -> None:
    """Raise ``FlexMapsError`` if there are no pieces or too many panels, or if the pieces cannot share sheets."""
    if not parts:
        raise FlexMapsError("There is nothing to lay on sheets; name at least one piece")
    count = sum(part.copies * len(part.design.flat.layout.patches) for part in parts)
    if count > MAX_PANELS:
        raise FlexMapsError(
            f"{count} panels are too many for common sheets, which take up to {MAX_PANELS}; export them in several batches"
        )
    first = parts[0]
    for part in parts[1:]:
        for what, own, others in (
            ("sheet's thickness", part.sheets.thickness, first.sheets.thickness),
            ("material", part.material, first.material),
            ("cutter", part.sheets.cut, first.sheets.cut),
        ):
            if own != others:
                raise FlexMapsError(
                    f"{part.name} and {first.name} cannot share sheets, for their {what} differs; export them apart, or give them the same"
                )


def _engraved_copy(part: BatchPiece, copy: int, mark: str, params: SheetParams) -> tuple[list[Panel], Labels]:
    """Engrave one copy's labels with its letter.

    Parameters
    ----------
    part : the piece
    copy : index of the copy
    mark : letter of the copy; "" if there is only one copy
    params : settings of the labels

    Returns
    -------
    panels, plates and loose keys of the copy; its labels
    """
    made = part.sheets
    design = part.design if made.base is None else made.base.design
    known = [p for p in made.panels if p.kind != "key"]
    labels = make_engraving(design, made.connections, params, made.base, mark)
    plates = iter(() if made.base is None else made.base.plate_labels(params, mark))
    known = [
        replace(p, labels=labels.strokes[p.patch], hub_labels=labels.hub_strokes[p.patch], waste_labels=())
        if p.patch >= 0
        else replace(p, labels=next(plates))
        for p in known
    ]
    keys = key_panels(made.connections, params, mark)
    return [replace(p, piece=copy, mark=mark) for p in (*known, *keys)], labels


def _all_connections(some: Sequence[Connections]) -> Connections:
    """Concatenate the connectors of all copies for the figures in the report."""
    return Connections(
        tuple(o for c in some for o in c.outlines),
        tuple(one for c in some for one in c.connectors),
        tuple(one for c in some for one in c.plain_joints),
        some[0].clearance,
        np.concatenate([c.occupied_lengths for c in some]),
        tuple(tip for c in some for tip in c.tips),
    )
