"""Choose the sizes of the calibration pieces for a machine and a material."""

from __future__ import annotations

import math

from ...errors import FlexMapsError
from ...fabrication.connectors.shape import connector_size
from ...params import Settings
from .bending import spiral_load, strip_load
from .coupons import STRIP_LENGTH, STRIP_SAG, STRIP_WIDTH, Coupons, SpiralCoupon, fields_by_name

# number of squares of the kerf comb, and their side, metres; more squares: the kerf is resolved more finely
CELLS, CELL = 10, 0.01
# clearances of the ladders' rungs, mm, around the values usual for lasers and printers; more rungs: the clearance is
# found more finely, the sheet is larger
CLEARANCE_STEPS = (0.0, 0.025, 0.05, 0.075, 0.1, 0.15, 0.2)
# Spirals: diameter, and widths of the arms of A and B, in thicknesses; twist, radians; intended sag, in thicknesses.
# Chosen so that arms bend and twist as in real pieces and lie within the range of the stiffness table
SPIRAL_SCALE, SPIRAL_WIDTHS, SPIRAL_TWIST, SPIRAL_SAG = 25.0, (0.8, 1.2), math.pi, 0.5
MAX_MILL_RATIO = (
    1.5  # largest diameter of a mill, in thicknesses; wider mills do not fit around the ends of spiral B's arms
)
MIN_WIDTH_RATIO = (
    4.0  # smallest width of an arm, in kerfs; smaller: the variation of the kerf dominates the arm's stiffness
)


def choose_coupons(settings: Settings) -> Coupons:
    """Return the sizes of the calibration pieces for the thickness, material and cutter in the settings."""
    spiral, cut, material = settings.spiral, settings.cut, settings.material.sheet
    h, kerf = spiral.thickness, max(cut.kerf_outline, cut.kerf_holes)
    if cut.mill > MAX_MILL_RATIO * h:
        raise FlexMapsError(
            f"A mill of {cut.mill * 1e3:g} mm is too wide for the spirals of a sheet of {h * 1e3:g} mm; take a thinner mill, or "
            "calibrate a thicker sheet"
        )
    joint = spiral.width_max
    catch = connector_size(joint, settings.connect, mill=cut.mill)
    steps = tuple(c * 1e-3 for c in CLEARANCE_STEPS if c * 1e-3 <= 0.25 * (catch.head - catch.neck))
    # a mill's cut varies less in width than a beam's, so arms need not be wide compared with the cut
    thin = max(SPIRAL_WIDTHS[0] * h, 0.0 if cut.mill else MIN_WIDTH_RATIO * kerf)
    widths = tuple(thin * w / SPIRAL_WIDTHS[0] for w in SPIRAL_WIDTHS)
    scale = SPIRAL_SCALE / SPIRAL_WIDTHS[0] * thin
    length, width = STRIP_LENGTH * h, max(STRIP_WIDTH * h, 0.01)
    made = Coupons(
        material=settings.material.material, youngs=material.youngs, poisson=material.poisson, density=material.density,
        strain_limit=material.strain_limit, thickness=h, kerf=cut.kerf_outline, kerf_holes=cut.kerf_holes, mill=cut.mill,
        cells=CELLS, cell=max(CELL, 3.0 * max(kerf, cut.mill)), clearances=steps, joint=joint,
        strip_length=length, strip_width=width, strip_load=0.0, spirals=(),
    )  # fmt: skip
    spirals = tuple(
        SpiralCoupon(name, scale, w, SPIRAL_TWIST, spiral_load(made, scale, w, SPIRAL_TWIST, SPIRAL_SAG * h))
        for name, w in zip("AB", widths, strict=True)
    )
    return Coupons(**{**fields_by_name(made), "strip_load": strip_load(made, STRIP_SAG * length), "spirals": spirals})
