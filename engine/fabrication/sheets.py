"""Sheets ready for cutting: panels with outlines, holes and labels, and their places on the sheets of material."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ..errors import FlexMapsError
from ..params import ConnectorParams, CutParams, SheetParams, refuse_crossed
from ..patches.joining import panel_numbers
from ..progress import SILENT, Progress
from ..spirals.contacts import find_contacts, nearest_quads
from ..spirals.contours import Outline
from ..spirals.curves.spiral import centre_line
from ..spirals.design import SpiralDesign
from ..surface.checking.finding import with_count
from .checks import (
    check_kerf,
    check_mill,
    check_nozzle,
    check_panel_sizes,
    warn_of_missing_connectors,
    warn_of_tight_quads,
)
from .connectors.connect import Connections, connect
from .nesting.nest import nest
from .nesting.packing import Packing
from .nesting.sheet_count import refuse_many_sheets
from .panels.kerf import cut_paths
from .panels.labels import Labels, SmallLabel, key_label, make_labels, with_mark
from .panels.panel import Panel
from .panels.toolpath import CUTTER_PATH, SheetCuts, plan_cuts
from .standing.base import Base
from .waste_labels import labels_beside

# Penalty factor of a place for a holding tab at a hub: it is preferred to a plain arm end only if it is this many times
# as far from the other tabs; larger values put fewer tabs at hubs
_HUB_PENALTY = 3.0
CONNECTORS, CUT = ConnectorParams(), CutParams()


@dataclass(frozen=True, eq=False)
class CutSheets:
    """All panels and the sheets that they are cut from.

    Lengths are in metres; the origin of a sheet is its lower left corner.

    panels : one for every patch, followed by the plates of the base and the loose keys
    packing : sheet, rotation and shift of every panel, and the sizes of the sheets
    params : settings that the sheets were made with
    warnings : sentences for the user
    labels_placed, labels_left_out : number of labels that are engraved, and of labels without room
    slot_min, bridge_min : narrowest slot and narrowest piece of material on the true outlines
    thickness : thickness of the material
    cut : settings of the cutter
    connections : connectors of all joints
    base : base that the piece stands on or hangs from, or None
    """

    panels: tuple[Panel, ...]
    packing: Packing
    params: SheetParams
    warnings: tuple[str, ...]
    labels_placed: int
    labels_left_out: int
    slot_min: float
    bridge_min: float
    thickness: float
    cut: CutParams
    connections: Connections
    base: Base | None = None
    _cuts_by_sheet: dict[int, SheetCuts] = field(default_factory=dict, init=False, repr=False)

    @property
    def count(self) -> int:
        """Number of sheets."""
        return len(self.packing.sizes)

    def panels_on_sheet(self, index: int) -> list[Panel]:
        """Return the panels of one sheet, in the sheet's frame."""
        where = self.packing
        return [
            self.panels[i].transform(float(where.rotation[i]), where.shift[i])
            for i in np.flatnonzero(where.sheet == index)
        ]

    def paths_on_sheet(self, index: int, progress: Progress = SILENT) -> list[Panel]:
        """Return the panels of one sheet with their outlines and holes offset by half of the kerf.

        Parameters
        ----------
        index : number of the sheet, from 0
        progress : called with the fraction done; may cancel
        """
        return [_with_cutter_path(p, self.cut) for p in progress.each(self.panels_on_sheet(index), CUTTER_PATH)]

    def cuts_on_sheet(self, index: int, progress: Progress = SILENT) -> SheetCuts:
        """Return the cuts of one sheet in cutting order, with lead-ins and holding tabs.

        Parameters
        ----------
        index : number of the sheet, from 0
        progress : called with the fraction done; may cancel
        """
        if index not in self._cuts_by_sheet:
            panels = self.paths_on_sheet(index, progress.part(0.0, 0.5))
            labels, holes = [c for p in panels for c in (*p.labels, *p.waste_labels)], [p.holes for p in panels]
            size = tuple(self.packing.sizes[index].tolist())
            outlines, holds = [p.outline for p in panels], [p.tab_places for p in panels]
            self._cuts_by_sheet[index] = plan_cuts(
                labels, holes, outlines, holds, size, self.cut, progress.part(0.5, 1.0)
            )
        return self._cuts_by_sheet[index]

    @property
    def cut_length(self) -> float:
        """Length of all cuts in metres, without engraving."""
        return sum(c.length for p in self.panels for c in (p.outline, *p.holes))

    @property
    def node_count(self) -> int:
        """Number of nodes of all cuts."""
        return sum(len(c.points) for p in self.panels for c in (p.outline, *p.holes))


def make_sheets(
    design: SpiralDesign,
    params: SheetParams,
    progress: Progress = SILENT,
    connectors: ConnectorParams = CONNECTORS,
    cut: CutParams = CUT,
    base: Base | None = None,
) -> CutSheets:
    """Draw every panel with its connectors, and lay the panels and the plates of the base on sheets.

    Parameters
    ----------
    design : spirals and flat patches
    params : size of the sheets, labels, nesting
    progress : called with the fraction done; may cancel
    connectors, cut : settings of the connectors and of the cutter
    base : plates and feet of a standing piece; panels are then drawn from ``base.design``, in which feet replace arms

    Raises
    ------
    FlexMapsError : no room for a spiral, a panel that touches itself or exceeds the sheet, or too wide a cutter
    """
    design = design if base is None else base.design
    layout = design.flat.layout
    progress(0.0, "drawing outlines")
    refuse_crossed({"sheet": params, "cut": cut}, ("cut",))
    check_mill(design, cut)
    made = connect(design, connectors, params.tolerance, progress.part(0.0, 0.3), cut.mill)
    drawn = list(made.outlines)
    progress(0.3, "checking outlines")
    _refuse_contacts(design, drawn, progress.part(0.3, 0.5))
    progress(0.5, "placing labels")
    labels = make_engraving(design, made, params, base, progress=progress.part(0.5, 0.6))
    panels = _make_panels(design, drawn, labels, base, progress.part(0.6, 0.6))
    check_kerf(design, panels, cut, progress.part(0.6, 0.65))
    if made.connectors:
        _refuse_wide_cutter(connectors, cut)
    slot, bridge = design.measure_slot_and_bridge(progress.part(0.65, 0.7))
    bridge = min([bridge, made.min_bridge, *(one.edge_width for one in (() if base is None else base.eyelets))])
    turn = grain_rotation(design, params)
    warnings = [
        *check_panel_sizes(panels, layout.patches, params, progress.part(0.7, 0.72), turn),
        *warn_of_tight_quads(design),
        *check_nozzle(design, cut),
        *warn_of_missing_connectors(made, connectors),
    ]
    panels += _base_panels(base)
    packing = _nest_panels(panels, made, turn, params, progress.part(0.72, 0.97))
    warnings += dict.fromkeys(remark for one in packing.remnants for remark in one.remarks)
    every, beside = panels + key_panels(made, params), progress.part(0.97, 1.0)
    panels, more = with_labels_beside(every, packing, labels.small, params, progress=beside)
    placed, left_out = labels.engraved_count + more, labels.left_out_count - more
    if left_out:
        warnings.append(
            f"{left_out} of {placed + left_out} labels have no room on or beside their panels and are left out"
        )
    return CutSheets(
        panels, packing, params, tuple(warnings), placed, left_out,
        slot, bridge, design.params.thickness, cut, made, base,
    )  # fmt: skip


def _refuse_contacts(design: SpiralDesign, outlines: list[Outline], progress: Progress) -> None:
    """Raise ``FlexMapsError`` where outlines touch themselves or each other."""
    where = find_contacts(outlines, progress)
    if len(where):
        raise FlexMapsError(
            f"The spirals of {with_count(len(np.unique(where[:, 0])), 'panel', 'panels')} touch each other; make the twist or the width smaller there",
            faces=nearest_quads(design.flat, where),
        )


def _refuse_wide_cutter(connectors: ConnectorParams, cut: CutParams) -> None:
    """Raise ``FlexMapsError`` if the cutter does not fit into the inner corners of the connectors."""
    if max(2.0 * connectors.rounding, cut.mill) < max(cut.kerf_outline, cut.kerf_holes):
        raise FlexMapsError(
            f"The cutter is too wide for corners of {connectors.rounding * 1e3:g} mm in the connectors; "
            f"make their rounding at least {max(cut.kerf_outline, cut.kerf_holes) * 500:g} mm, or set the mill's diameter"
        )


def _nest_panels(
    panels: Sequence[Panel], connections: Connections, turn: float, params: SheetParams, progress: Progress
) -> Packing:
    """Lay panels on sheets, and the loose keys of ``connections`` on further sheets.

    turn : rotation in radians by which all panels are turned before they are laid, see ``grain_rotation``
    """
    outlines = [p.outline for p in progress.part(0.0, 0.0).each(panels, "drawing the outlines of the panels")]
    shapes = [o.transform(turn, np.zeros(2)).sample(2e-5) if turn else o.sample(2e-5) for o in outlines]
    refuse_many_sheets(shapes, params)
    laid = nest(shapes, params, progress)
    return with_key_sheets(replace(laid, rotation=laid.rotation + turn), connections.key_outlines, params)


def with_labels_beside(
    panels: Sequence[Panel],
    packing: Packing,
    small: Sequence[SmallLabel],
    params: SheetParams,
    piece: int = 0,
    progress: Progress = SILENT,
) -> tuple[tuple[Panel, ...], int]:
    """Return the panels with small labels written beside them, and the number of labels that appear only there.

    Parameters
    ----------
    panels : panels of all pieces
    packing : places of these panels on the sheets
    small : labels of one piece that are too small on its panels
    params : height of letters, and spacing
    piece : index of this piece
    progress : called with the fraction done; may cancel
    """
    place = {p.patch: k for k, p in enumerate(panels) if p.patch >= 0 and p.piece == piece}
    of_panel = [place[one.patch] for one in small]
    found, more = list(panels), 0
    for one, k, strokes in zip(
        small, of_panel, labels_beside(panels, packing, small, of_panel, params, progress), strict=True
    ):
        found[k] = replace(found[k], waste_labels=(*found[k].waste_labels, *strokes))
        more += bool(strokes) and not one.is_engraved
    return tuple(found), more


def make_engraving(
    design: SpiralDesign,
    connections: Connections,
    params: SheetParams,
    base: Base | None,
    mark: str = "",
    progress: Progress = SILENT,
) -> Labels:
    """Return the labels to engrave on the panels and on their feet.

    Parameters
    ----------
    design : spirals and panels
    connections : connectors, whose places the labels avoid
    params : heights of labels, and whether there are any
    base : base whose feet are labelled too, and whose eyelets the labels avoid; None without a base
    mark : letter of the piece, if several share sheets
    progress : called with the fraction done; may cancel
    """
    if not params.labels:
        return Labels(((),) * len(connections.outlines), 0, 0, ((),) * len(connections.outlines))
    taken = np.where(design.is_absent, np.inf, connections.occupied_lengths)
    pierced = [] if base is None else [one.quad for one in base.eyelets]
    labels = make_labels(
        design.flat.layout, design.arms, design.roots, params, taken, progress, mark=mark, quads_with_holes=pierced
    )
    more = {} if base is None else base.foot_labels(params, mark)
    return replace(labels, strokes=tuple((*s, *more.get(i, ())) for i, s in enumerate(labels.strokes)))


def grain_rotation(design: SpiralDesign, params: SheetParams) -> float:
    """Return the angle in radians by which panels are turned so that their grain runs along the sheet's width.

    Parameters
    ----------
    design : ``design.params.grain`` is the direction of the grain in the panels' plane, radians
    params : allowed rotations; unless they are "GRAIN", the angle is 0
    """
    return -design.params.grain if params.rotation == "GRAIN" else 0.0


def _make_panels(
    design: SpiralDesign, outlines: Sequence[Outline], labels: Labels, base: Base | None, progress: Progress
) -> tuple[Panel, ...]:
    """Return one panel per patch, including the holes for eyelets."""
    holds, numbers = _tab_places(design, progress), panel_numbers(design.flat.layout)
    panels = []
    for i, o in enumerate(progress.each(outlines, "measuring the areas of the panels")):
        pierced = (*o.holes, *(() if base is None else base.eyelet_holes(i)))
        area = o.outer.area + sum(h.area for h in pierced)
        panels.append(
            Panel(numbers[i], i, o.outer, pierced, labels.strokes[i], area, holds[i], hub_labels=labels.hub_strokes[i])
        )
    return tuple(panels)


def _base_panels(base: Base | None) -> tuple[Panel, ...]:
    """Return the plates of the base as panels."""
    found = []
    for plate in () if base is None else base.plates:
        area = plate.outline.area + sum(h.area for h in plate.holes)
        # places for holding tabs: the nodes of the outline, at the ends of its straight sides
        holds = np.column_stack([plate.outline.points, np.ones(len(plate.outline.points))])
        found.append(Panel(0, -1, plate.outline, plate.holes, plate.labels, area, holds, "base"))
    return tuple(found)


def key_panels(connections: Connections, params: SheetParams, mark: str = "") -> tuple[Panel, ...]:
    """Return the loose keys as panels.

    Parameters
    ----------
    connections : connectors of the piece
    params : heights of labels, and whether there are any
    mark : letter of the piece
    """
    keyed = [(with_mark(c.name, mark), c.candidate) for c in connections.connectors if c.kind == "key"]
    return tuple(
        Panel(
            0,
            -1,
            k.outer,
            (),
            key_label(name, a.size.neck, 2.0 * (a.size.length + a.setback), params),
            k.outer.area,
            kind="key",
        )
        for k, (name, a) in zip(connections.key_outlines, keyed, strict=True)
    )


def _tab_places(design: SpiralDesign, progress: Progress) -> list[np.ndarray]:
    """Return for every panel the places (K, 3) for holding tabs: plain arm ends, and roots of slots at the outline.

    Columns are x, y in metres and a penalty factor of at least 1, see ``plan_cuts``. Other places are not suitable: a
    tab beside an arm would bend the arm when broken off, and a tab on a connector would spoil the connector's fit.
    """
    layout, arms = design.flat.layout, design.arms
    border = layout.mesh.border[layout.mesh.quad_edges]
    tips = centre_line(arms, np.where(design.is_absent, design.arm_starts, 0.0)[..., None])[0][:, :, 0]
    # a slot opens to the outline if the mesh vertex between the sides of its two arms lies on the outline
    outer = layout.on_outline[np.roll(layout.flat_corners, -1, axis=1)]
    found = []
    for quads in progress.each(layout.patches, "placing holding tabs"):
        ends, roots = tips[quads][border[quads]], design.roots.centre[quads][outer[quads]]
        liked = np.repeat([1.0, _HUB_PENALTY], [len(ends), len(roots)])
        found.append(np.column_stack([np.concatenate([ends, roots]), liked]))
    return found


def _with_cutter_path(panel: Panel, cut: CutParams) -> Panel:
    """Return the panel with its outline and holes replaced by the paths of the cutter."""
    path = cut_paths(Outline(panel.outline, panel.holes), cut.kerf_outline, cut.kerf_holes)
    return replace(panel, outline=path.outer, holes=path.holes)


def with_key_sheets(packing: Packing, keys: tuple[Outline, ...], params: SheetParams) -> Packing:
    """Add sheets for the loose keys, in rows; these sheets are only as large as needed, to be cut from leftovers.

    Parameters
    ----------
    packing : places of all other panels
    keys : outlines of the keys, each around the origin
    params : size of the sheets, margin and spacing, metres
    """
    if not keys:
        return packing
    size = max(np.ptp(k.outer.sample(1e-5), axis=0).max() for k in keys)
    pitch = size + params.spacing
    free = np.array([params.sheet_width, params.sheet_height]) - 2.0 * params.margin + params.spacing
    columns, rows = np.maximum((free // pitch).astype(int), 1).tolist()
    sheet, place = np.divmod(np.arange(len(keys)), columns * rows)
    row, column = np.divmod(place, columns)
    shift = params.margin + 0.5 * size + pitch * np.column_stack([column, row])
    on = np.bincount(sheet)
    taken = np.column_stack([np.minimum(on, columns), -(-on // columns)])
    return replace(
        packing,
        sheet=np.append(packing.sheet, len(packing.sizes) + sheet),
        rotation=np.append(packing.rotation, np.zeros(len(keys))),
        shift=np.concatenate([packing.shift, shift]),
        sizes=np.concatenate([packing.sizes, 2.0 * params.margin + pitch * taken - params.spacing]),
    )
