"""The base: plates on the ground with a slot for the tongue of every foot."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ...arrays import Float, Int
from ...errors import FlexMapsError
from ...mechanics.assembly import Pose
from ...params import BaseParams, SheetParams, SpiralParams
from ...spirals.curves.arcs import Curve
from ...spirals.design import SpiralDesign
from ..nesting.packing import find_fitting_rotation
from ..panels.lettering import FILL_SHARE, straight_text, text_length
from .corners import hull_outline
from .eyelets import Eyelet, eyelets_report
from .feet import Foot, make_feet
from .frame import make_planks

NUMBER_GAP = 0.001  # metres between a slot and its foot's number; larger leaves numbers out more often


@dataclass(frozen=True, eq=False)
class Plate:
    """One plate in its place on the ground, seen from above, metres.

    feet : feet whose tongues enter its slots
    slots : four corners of every slot, counter-clockwise, in the order of ``feet``
    labels : strokes to engrave
    """

    outline: Curve
    feet: tuple[Foot, ...]
    slots: Float[np.ndarray, "slots 4 2"]
    labels: tuple[Curve, ...]

    @property
    def holes(self) -> tuple[Curve, ...]:
        """The slots as holes, clockwise."""
        return tuple(Curve(corners[::-1], np.zeros(4)) for corners in self.slots)


@dataclass(frozen=True, eq=False)
class Base:
    """Base that a piece stands on or hangs from.

    design : the design of the piece, in which feet replace arms
    ground_height : height of the upper side of the plates, metres
    thickness : thickness of the plates, as of all sheets, metres
    eyelets : holes to hang the piece by, instead of feet
    is_frame : whether the plates are the planks of a frame
    """

    design: SpiralDesign
    feet: tuple[Foot, ...]
    plates: tuple[Plate, ...]
    ground_height: float
    thickness: float
    eyelets: tuple[Eyelet, ...] = ()
    is_frame: bool = False

    def eyelet_holes(self, patch: int) -> tuple[Curve, ...]:
        """Return the eyelets of a patch as holes in its panel."""
        return tuple(one.hole for one in self.eyelets if one.patch == patch)

    @property
    def report(self) -> dict[str, Any]:
        """Figures of the base, or of the eyelets, for report.json."""
        if self.eyelets:
            return eyelets_report(self.eyelets)
        lean = np.degrees([foot.lean for foot in self.feet])
        reach = [1e3 * foot.shoulder_distance for foot in self.feet]
        return {
            ("planks" if self.is_frame else "plates"): len(self.plates),
            "feet": len(self.feet),
            "ground_mm": round(1e3 * self.ground_height, 3),
            "lean_deg": [round(float(x), 2) for x in (lean.min(), lean.max())],
            "foot_mm": [round(x, 2) for x in (min(reach), max(reach))],
        }

    def plate_labels(self, params: SheetParams, mark: str) -> list[tuple[Curve, ...]]:
        """Return the strokes engraved on every plate: the numbers of the feet beside their slots.

        Parameters
        ----------
        params : height of the letters, and whether there are labels
        mark : letter of the piece, if several pieces share sheets
        """
        return [_number_strokes(p.feet, p.slots, p.outline, params, mark) for p in self.plates]

    def foot_labels(self, params: SheetParams, mark: str = "") -> dict[int, list[Curve]]:
        """Return by patch the strokes of the numbers engraved along its feet.

        Parameters
        ----------
        params, mark : as for ``plate_labels``
        """
        found: dict[int, list[Curve]] = {}
        for foot in self.feet if params.labels else ():
            text, height = foot_name(foot, mark), _letter_height(foot, params, mark)
            left = foot.tongue_offset * np.array([-foot.direction[1], foot.direction[0]])
            tip = (
                self.design.arms.centre[foot.quad]
                + left
                + (foot.shoulder_distance - 0.6 * text_length(text) * height) * foot.direction
            )
            strokes = [
                Curve(s, np.zeros(len(s)), closed=False) for s in straight_text(text, height, tip, foot.direction)
            ]
            found.setdefault(foot.cap.patch, []).extend(strokes)
        return found


def foot_name(foot: Foot, mark: str = "") -> str:
    """Return the text on a foot and beside its slot; it differs from all names of panels and seams.

    Parameters
    ----------
    foot : the foot
    mark : letter of the piece, if several pieces share sheets
    """
    return f"-{mark}{foot.number}-"


def _letter_height(foot: Foot, params: SheetParams, mark: str = "") -> float:
    """Return the height in metres of the letters of a foot's number."""
    return min(
        params.label_height, FILL_SHARE * foot.width, 0.4 * foot.shoulder_distance / text_length(foot_name(foot, mark))
    )


def make_base(
    design: SpiralDesign,
    pose: Pose,
    supports: Int[np.ndarray, " held"] | None,
    params: BaseParams,
    sheet: SheetParams,
    *,
    lowest: float,
    clearance: float,
) -> Base:
    """Make feet for all supports of a design, and the plates under them.

    Parameters
    ----------
    design : spirals of the piece
    pose : simulated positions and rotations of the hubs
    supports : supported quads
    params : kind of base, its height, margins, and width of the feet
    sheet : size of the sheets, and settings of labels
    lowest : height of the piece's lowest point, metres
    clearance : gap around a tongue in its slot, metres

    Raises
    ------
    FlexMapsError : nothing is supported, a foot has no room, or slots would overlap
    """
    if supports is None or not len(supports):
        raise FlexMapsError(
            "The base has no supports to hold; choose supports, such as the lowest spirals, or choose no base"
        )
    refuse_rim(design.params)
    feet = make_feet(design, pose, supports, lowest, params)
    thickness, ground = design.params.thickness, lowest - params.base_height
    slots = np.array([foot.slot_corners(thickness, clearance) for foot in feet])
    _refuse_touching(feet, slots, thickness)
    footed = replace(design, feet=tuple(foot.cap for foot in feet))
    if params.base == "frame":
        cut = make_planks(slots, params.base_edge, clearance, thickness, sheet)
        made = tuple(_plate_with_slots(feet, slots, rows, outline, sheet) for outline, rows in cut)
        return Base(footed, feet, made, ground, thickness, is_frame=True)
    groups = (
        [np.arange(len(feet))] if params.base == "plate" else _feet_per_plate(design, feet, slots, params.base_edge)
    )
    plates = [_make_plates(feet, slots, rows, params.base_edge, sheet, thickness) for rows in groups]
    return Base(footed, feet, tuple(plate for some in plates for plate in some), ground, thickness)


def refuse_rim(params: SpiralParams) -> None:
    """Raise ``FlexMapsError`` if a rim joins the arms at the border, because feet must replace these arms."""
    if params.border == "rim":
        raise FlexMapsError(
            "Feet replace arms at the border, but a rim joins these arms; choose Stubs or Left out for the border, or no base: a rim can "
            "be screwed down through its holes"
        )


def _plate_with_slots(
    feet: Sequence[Foot], slots: np.ndarray, rows: np.ndarray, outline: Curve, sheet: SheetParams
) -> Plate:
    """Return a plate with this outline and the slots of the feet with indices ``rows``."""
    some = tuple(feet[k] for k in rows.tolist())
    return Plate(outline, some, slots[rows], _number_strokes(some, slots[rows], outline, sheet))


def _refuse_touching(feet: Sequence[Foot], slots: np.ndarray, wall: float) -> None:
    """Raise ``FlexMapsError`` if less than ``wall`` metres would be left between two slots."""
    import shapely

    shapes = shapely.polygons(slots)
    one, two = shapely.STRtree(shapes).query(shapes, predicate="dwithin", distance=wall)
    near = np.unique(one[one != two])
    if len(near):
        raise FlexMapsError(
            f"{len(near)} slots of the base are less than {1e3 * wall:g} mm apart; "
            "make the feet narrower, or support fewer spirals",
            faces=[feet[k].quad for k in near.tolist()],
        )


def _feet_per_plate(design: SpiralDesign, feet: Sequence[Foot], slots: np.ndarray, margin: float) -> list[np.ndarray]:
    """Return for every plate the indices of its feet.

    Feet share a plate if their quads are neighbours in the mesh, or if their plates would overlap.

    margin : width of the plate around the slots, metres
    """
    import shapely

    corners = [set(design.flat.layout.mesh.quads[foot.quad].tolist()) for foot in feet]
    groups = [({k}, own) for k, own in enumerate(corners)]
    changed = True
    while changed:
        changed = False
        for i in range(len(groups)):
            for j in range(len(groups) - 1, i, -1):
                shapes = [
                    shapely.convex_hull(shapely.multipoints(slots[sorted(groups[g][0])].reshape(-1, 2))) for g in (i, j)
                ]
                if groups[i][1] & groups[j][1] or shapely.dwithin(*shapes, 2.0 * margin):
                    groups[i] = groups[i][0] | groups[j][0], groups[i][1] | groups[j][1]
                    del groups[j]
                    changed = True
    return [np.array(sorted(rows)) for rows, _ in groups]


def _make_plates(
    feet: Sequence[Foot], slots: np.ndarray, rows: np.ndarray, margin: float, sheet: SheetParams, thickness: float
) -> list[Plate]:
    """Return a plate around the slots with indices ``rows``, or several if it would be larger than the sheet.

    margin : width of the plates around the slots, metres; reduced to at least ``thickness`` where plates are divided
    """
    import shapely

    outline = hull_outline(slots[rows].reshape(-1, 2), margin)
    size = sheet.sheet_width, sheet.sheet_height
    if find_fitting_rotation(outline.sample(1e-4), size, sheet.margin, sheet.rotation) is not None:
        return [_plate_with_slots(feet, slots, rows, outline, sheet)]
    middles = slots[rows].mean(axis=1)
    along = np.linalg.svd(middles - middles.mean(axis=0))[2][0]
    order = np.argsort(middles @ along)
    halves = [rows[part] for part in np.array_split(order, 2)]
    if len(rows) < 2:
        raise FlexMapsError(
            "The sheet is too small for a foot's plate; take a larger sheet", faces=[feet[rows[0]].quad]
        )
    apart = shapely.distance(*(shapely.convex_hull(shapely.multipoints(slots[h].reshape(-1, 2))) for h in halves))
    margin = min(margin, 0.48 * float(apart))
    if margin < thickness:
        raise FlexMapsError(
            "The base is larger than the sheet and cannot be divided between its slots; take a larger sheet, or choose feet",
            faces=[feet[k].quad for k in rows.tolist()],
        )
    return [plate for half in halves for plate in _make_plates(feet, slots, half, margin, sheet, thickness)]


def _number_strokes(
    feet: Sequence[Foot], slots: np.ndarray, outline: Curve, sheet: SheetParams, mark: str = ""
) -> tuple[Curve, ...]:
    """Return the strokes of the feet's numbers, each at an end of its slot; left out where neither end has room."""
    import shapely

    if not sheet.labels:
        return ()
    holes = shapely.polygons(slots)
    plate = shapely.Polygon(outline.sample(1e-4)).buffer(-NUMBER_GAP)
    shapely.prepare(plate)
    found: list[Curve] = []
    for foot, corners in zip(feet, slots, strict=True):
        text = foot_name(foot, mark)
        height, middle, along = _letter_height(foot, sheet, mark), corners.mean(axis=0), foot.across[:2]
        for side in (1.0, -1.0):
            beside = np.abs((corners - middle) @ along).max() + NUMBER_GAP + 0.5 * height * text_length(text)
            strokes = straight_text(text, height, middle + side * beside * along, along)
            lines = shapely.multilinestrings([[shapely.linestrings(s) for s in strokes]])[0]
            if plate.contains(lines) and shapely.distance(lines, holes).min() > 0.5 * NUMBER_GAP:
                found += [Curve(s, np.zeros(len(s)), closed=False) for s in strokes]
                break
    return tuple(found)
