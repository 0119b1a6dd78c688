"""Check whether sheets can be cut as requested: raise errors with faces and a remedy, or return warnings."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..errors import FlexMapsError
from ..materials import Material
from ..params import ConnectorParams, CutParams, SheetParams
from ..progress import SILENT, Progress
from ..spirals.contacts import find_contacts, nearest_quads
from ..spirals.contours import Outline
from ..spirals.design import SpiralDesign
from ..surface.checking.finding import with_count
from .connectors.connect import Connections
from .nesting.packing import find_fitting_rotation, preferred_box
from .panels.kerf import cut_paths
from .panels.panel import Panel


def check_mill(design: SpiralDesign, cut: CutParams) -> None:
    """Raise ``FlexMapsError`` if the mill is wider than the narrowest slot of a spiral."""
    if cut.mill == 0.0:
        return
    narrow = design.quads_with_narrow_slots(cut.mill)
    if len(narrow):
        raise FlexMapsError(
            f"A mill of {cut.mill * 1e3:g} mm does not fit into the slots of {with_count(len(narrow), 'spiral', 'spirals')}, down to "
            f"{design.min_slot_and_bridge[0] * 1e3:.2g} mm wide; make the smallest slot at least {cut.mill * 1e3:g} mm and the fillet "
            f"{cut.mill * 500:g} mm, the object larger, or take a thinner mill",
            faces=narrow,
        )


def check_nozzle(design: SpiralDesign, cut: CutParams) -> list[str]:
    """Return warnings about arms narrower than two printed lines; raise ``FlexMapsError`` if narrower than one line.

    A line is as wide as the printer's nozzle, ``cut.nozzle``.
    """
    narrowest = design.width.min(axis=1)
    lost, weak = (np.flatnonzero(narrowest < share * cut.nozzle * (1.0 - 1e-6)) for share in (1.0, 2.0))
    least = f"down to {narrowest.min() * 1e3:.2g} mm wide"
    if len(lost):
        raise FlexMapsError(
            f"The arms of {with_count(len(lost), 'spiral', 'spirals')} are {least}, narrower than the nozzle of {cut.nozzle * 1e3:g} mm, and would not be "
            "printed; make the smallest width or the object larger, or take a finer nozzle",
            faces=lost,
        )
    if not len(weak):
        return []
    return [
        f"The arms of {with_count(len(weak), 'spiral', 'spirals')} are {least}, less than two lines of the nozzle of {cut.nozzle * 1e3:g} mm, and will be weaker than "
        "computed: make the smallest width larger, or take a finer nozzle"
    ]


def check_kerf(design: SpiralDesign, panels: Sequence[Panel], cut: CutParams, progress: Progress = SILENT) -> None:
    """Raise ``FlexMapsError`` where the cutter is too wide for a slot or a corner.

    Parameters
    ----------
    design : spirals on flat patches
    panels : panels in their patches' frames, with the outlines that the finished parts should have
    cut : parameters of the cutter, with the widths of the kerf along outlines and along holes
    progress : called with the fraction done; may cancel
    """
    widest = max(cut.kerf_outline, cut.kerf_holes)
    if widest == 0.0:
        return
    remedy = f"the kerf of {widest * 1e3:g} mm is too wide for the slots or their ends; make the kerf smaller, or the smallest slot and the fillet larger"
    narrow = design.quads_with_narrow_slots(widest)
    # the test for contacts below misses these slots: the cutter's path would turn back before the narrow inner end of
    # the slot, without touching itself
    if len(narrow):
        raise FlexMapsError(f"{with_count(len(narrow), 'spiral', 'spirals')} cannot be cut: {remedy}", faces=narrow)
    paths: list[Outline] = []
    for panel in panels:
        progress(0.5 * len(paths) / len(panels), "checking the paths of the cutter")
        try:
            paths.append(cut_paths(Outline(panel.outline, panel.holes), cut.kerf_outline, cut.kerf_holes))
        except FlexMapsError as error:
            raise FlexMapsError(
                f"Panel {panel.number}: {remedy}", faces=design.flat.layout.patches[panel.patch]
            ) from error
    where = find_contacts(paths, progress.part(0.5, 1.0))
    if len(where):
        raise FlexMapsError(
            f"{with_count(len(where), 'place', 'places')} cannot be cut: {remedy}",
            faces=nearest_quads(design.flat, where),
        )


def warn_of_missing_connectors(connections: Connections, params: ConnectorParams) -> list[str]:
    """Return warnings about joints without a connector, and about joints that have only room for a glued tab.

    Parameters
    ----------
    connections : the connectors
    params : requested kind of connector; no warning about tabs if tabs are requested
    """
    found, whole = [], len(connections.plain_joints) + len(connections.connectors)
    remedy = "make the object larger, the slot at seams wider, or the thinnest part of the connectors smaller"
    glued = [(c.name, c.faces) for c in connections.connectors if c.kind == "tab" and params.connector != "tab"]
    if glued:
        found.append(
            f"{len(glued)} of {whole} joints have room for ends to be glued only ({_list_joints(glued)}): {remedy}"
        )
    if connections.plain_joints:
        plain = _list_joints([(name, faces) for name, *faces in connections.plain_joints])
        found.append(
            f"{len(connections.plain_joints)} of {whole} joints have no room for a connector and keep plain ends ({plain}): {remedy}"
        )
    return found


def _list_joints(joints: Sequence[tuple[str, Sequence[int]]], most: int = 5) -> str:
    """Return the names of the first ``most`` joints in words, with the two faces of each."""
    named = [f"{name} between faces {a} and {b}" for name, (a, b) in joints[:most]]
    return ", ".join(named) + (", ..." if len(joints) > most else "")


def check_panel_sizes(
    panels: Sequence[Panel],
    patches: tuple[np.ndarray, ...],
    params: SheetParams,
    progress: Progress = SILENT,
    turn: float = 0.0,
) -> list[str]:
    """Return a warning for every panel larger than the sheet, or raise ``FlexMapsError`` if such panels are forbidden.

    Parameters
    ----------
    panels : panels in their patches' frames
    patches : quads of every patch, for the error to point at
    params : size of the sheets, margin, allowed rotations; ``oversize`` "error" forbids larger panels
    progress : called with the fraction done; may cancel
    turn : rotation in radians of panels from their patches' frames, after which the grain lies along x
    """
    found = []
    for number, panel in enumerate(panels):
        progress(number / len(panels), "checking the size of the panels")
        shape = panel.outline.transform(turn, np.zeros(2)).sample(1e-4)
        if (
            find_fitting_rotation(shape, (params.sheet_width, params.sheet_height), params.margin, params.rotation)
            is not None
        ):
            continue
        size = preferred_box(shape, params.rotation)[1]
        text = (
            f"Panel {panel.number} is {size[0] * 1e3:.0f} x {size[1] * 1e3:.0f} mm and larger than the sheet of "
            f"{params.sheet_width * 1e3:g} x {params.sheet_height * 1e3:g} mm less its margins"
        )
        if params.oversize == "error":
            raise FlexMapsError(
                f"{text}; use a larger sheet, smaller quads, or cut the panel in two", faces=patches[panel.patch]
            )
        found.append(f"{text}; it gets a sheet of the size that it needs")
    return found


def warn_of_ignored_grain(material: Material, params: SheetParams) -> list[str]:
    """Return a warning if the material is stiffer along its grain and the panels are not laid along the grain.

    Parameters
    ----------
    material : material of the sheets
    params : allowed rotations of panels

    Returns
    -------
    list of at most one warning
    """
    if material.orthotropy is None or params.rotation == "GRAIN":
        return []
    return [
        f"{material.name} is stiffer along its grain, but the panels are not laid along it: set Rotation to Along the grain, or "
        "the piece takes another shape than the simulation's"
    ]


def warn_of_tight_quads(design: SpiralDesign) -> list[str]:
    """Return warnings about quads too small for the requested arms or slots."""
    found, params = [finding.message for finding in design.findings], design.params
    if len(design.thin_quads):
        found.append(
            f"{with_count(len(design.thin_quads), 'quad has', 'quads have')} no room for arms {params.width_min * 1e3:g} mm wide; "
            f"these are down to {design.width.min() * 1e3:.2g} mm: make the object larger or those quads more regular"
        )
    if design.min_slot_and_bridge[0] < min(params.slot_min, 2.0 * params.fillet or 1.0) * 0.999:
        found.append(
            f"The narrowest slot is {design.min_slot_and_bridge[0] * 1e3:.2g} mm wide and not {params.slot_min * 1e3:g} mm; "
            "make the object larger or its smallest quads more regular"
        )
    return found
