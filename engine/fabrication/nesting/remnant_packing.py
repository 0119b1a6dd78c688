"""Lay panels on irregular remnants with a raster: large panels first, each on the smallest remnant with room."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...arrays import Float
from ...errors import FlexMapsError
from ...params import SheetParams
from ...progress import SILENT, Progress
from .packing import CELLS, Packing, preferred_box
from .remnants import Remnant
from .sheet_raster import ShapeMask, SheetRaster

# number of rotations within a quarter turn; each is tried with 0 to 3 quarter turns more; more rotations only take
# longer
SLANTS = 3


class _RemnantInUse:
    """A remnant that is being filled, with rotation (radians) and shift of each panel on it."""

    def __init__(self, remnant: Remnant, params: SheetParams):
        self.remnant, self.params = remnant, params
        width, height = remnant.size.tolist()
        self.cell_size = max(width, height) / CELLS
        self.half_spacing = 0.5 * params.spacing
        self.area = float(remnant.polygon.area)
        self.places: dict[int, tuple[float, np.ndarray]] = {}
        roomy = min(width, height) > 2.0 * (params.margin - self.half_spacing) + self.cell_size
        self.raster = (
            SheetRaster((width, height), params.margin, self.half_spacing, self.cell_size, remnant) if roomy else None
        )

    def place(self, number: int, shape: np.ndarray, area: float) -> bool:
        """Place panel ``number`` with this outline and area (m2) if there is room; return whether it was placed."""
        if self.raster is None or area > self.area:
            return False
        grain = self.params.rotation == "GRAIN"
        slants = np.radians(90.0 / SLANTS * np.arange(SLANTS)) if self.params.rotation == "FREE" else np.zeros(1)
        for slant in slants.tolist():
            turn = preferred_box(shape, self.params.rotation)[0] + slant
            stamp = ShapeMask(shape, turn, self.cell_size, self.half_spacing, (0, 2) if grain else (0, 1, 2, 3))
            found = self.raster.place(stamp, try_half_turns=True)
            if found is not None:
                self.places[number] = found
                return True
        return False


def pack_on_remnants(
    shapes: Sequence[Float[np.ndarray, "_ 2"]],
    remnants: Sequence[Remnant],
    params: SheetParams,
    progress: Progress = SILENT,
) -> tuple[Packing, list[int]]:
    """Lay panels on remnants, each of which exists once; return the packing and the indices of the panels left over.

    Panels left over have sheet -1 in the packing.

    Parameters
    ----------
    shapes : closed outlines (M, 2), metres
    remnants : pieces of sheet to fill
    params : margin, spacing and allowed rotations
    progress : called with the fraction done; may cancel

    Raises
    ------
    FlexMapsError : a remnant is smaller than every panel
    """
    from shapely import Polygon

    area = [float(Polygon(shape).area) for shape in shapes]
    order = sorted(range(len(shapes)), key=lambda i: -area[i])
    odd = sorted((_RemnantInUse(remnant, params) for remnant in remnants), key=lambda one: one.area)
    rest = []
    for i in progress.each(order, "laying panels on remnants"):
        if not any(one.place(i, shapes[i], area[i]) for one in odd):
            rest.append(i)
    for one in odd:
        if not one.places:
            fresh = _RemnantInUse(one.remnant, params)
            if not any(fresh.place(i, shapes[i], area[i]) for i in reversed(order)):
                width, height = one.remnant.size * 1e3
                raise FlexMapsError(
                    f"The remnant '{one.remnant.name}' of {width:.0f} x {height:.0f} mm is smaller than every panel; leave it out, "
                    "or make the panels smaller"
                )
    used = [one for one in odd if one.places]
    sheet, rotation, shift = np.full(len(shapes), -1), np.zeros(len(shapes)), np.zeros((len(shapes), 2))
    for k, one in enumerate(used):
        for i, (turn, move) in one.places.items():
            sheet[i], rotation[i], shift[i] = k, turn, move
    sizes = np.array([one.remnant.size for one in used]).reshape(-1, 2)
    return Packing(sheet, rotation, shift, sizes, tuple(one.remnant for one in used)), sorted(rest)
