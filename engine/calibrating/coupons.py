"""What is cut to calibrate a machine and a material: the sizes of all pieces, as numbers that are kept beside the sheet.

The pieces grow with the sheet's thickness, so that sags and weights stay handy: the stiffness of all of them goes with Young's
modulus times the thickness.
"""

from __future__ import annotations

import json
import math
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

from ..errors import FlexMapsError
from ..fabrication.connectors.shape import size
from ..materials import Material
from ..params import Settings

FILE = "calibration.json"
GRAVITY = 9.80665  # m/s^2, standard
CELLS, CELL = (
    10,
    0.01,
)  # squares of the kerf comb, and metres of their sides: calipers of 0.02 mm then tell 0.002 mm of kerf
STEPS = (
    0.0,
    0.025,
    0.05,
    0.075,
    0.1,
    0.15,
    0.2,
)  # mm, clearances of the ladder: round the usual ones of lasers and printers
KINDS = ("dovetail", "key", "tab")
# The strip in thicknesses: so slender that shear makes less than 0.1 % of its sag, and so narrow that it bends as a beam and not
# as a plate (within 1 % of finite elements, see ``bench make``). Its sag is to be a tenth of its length.
STRIP_LENGTH, STRIP_WIDTH, STRIP_CLAMP, STRIP_END, STRIP_SAG = 50.0, 7.0, 15.0, 3.0, 0.1
# The spirals in thicknesses: diameter, and widths of the arms of A and B. Half a turn: the arms bend and twist as those of pieces
# do. All within the range of the stiffness table. Their sag is to be half a thickness.
SPIRAL_SCALE, SPIRAL_WIDTHS, SPIRAL_TWIST, SPIRAL_SAG = 25.0, (0.8, 1.2), math.pi, 0.5
MILLS = 1.5  # thicknesses that a mill may be wide: wider ones do not get round the ends of spiral B's arms
KERFS = 4.0  # an arm is at least so many kerfs wide, or what the kerf strays would decide its stiffness


@dataclass(frozen=True)
class SpiralCoupon:
    """A spiral in a frame that holds the tips of its arms: diameter and width in metres, twist in radians, and a weight in kg."""

    name: str
    scale: float
    width: float
    twist: float
    load: float


@dataclass(frozen=True)
class Coupons:
    """All sizes in metres, weights in kg.

    material : key of the material that is taken for known; poisson, density, strain_limit : its; thickness : of the sheet
    kerf, kerf_holes : what the drawn outlines and holes allow for; mill : its diameter, 0 for a beam
    cells, cell : squares of the kerf comb and their sides; clearances : of the ladder; joint : width of its arms
    strip_length : from the clamp to the load; strip_width; strip_load : a weight to try
    spirals : two, the softer one first
    """

    material: str
    youngs: float
    poisson: float
    density: float
    strain_limit: float
    thickness: float
    kerf: float
    kerf_holes: float
    mill: float
    cells: int
    cell: float
    clearances: tuple[float, ...]
    joint: float
    strip_length: float
    strip_width: float
    strip_load: float
    spirals: tuple[SpiralCoupon, ...]

    @property
    def assumed(self) -> Material:
        """The material as it was taken to be when the sheet was made."""
        values = (self.youngs, self.poisson, self.density, self.strain_limit)
        return Material(self.material, *values, breaks=True, source="assumed for the calibration sheet")

    def text(self) -> str:
        """The JSON document that is kept beside the sheet, SI."""
        return json.dumps({"flexmaps": "calibration", **asdict(self)}, indent=1) + "\n"


def coupons(settings: Settings) -> Coupons:
    """The pieces for a sheet of these settings: thickness, material, kerf, mill and widths are theirs."""
    from .bending import spiral_load, strip_load

    spiral, cut, material = settings.spiral, settings.cut, settings.material.chosen
    h, kerf = spiral.thickness, max(cut.kerf_outline, cut.kerf_holes)
    if cut.mill > MILLS * h:
        raise FlexMapsError(
            f"A mill of {cut.mill * 1e3:g} mm is too wide for the spirals of a sheet of {h * 1e3:g} mm; take a thinner mill, or "
            "calibrate a thicker sheet"
        )
    joint = spiral.width_max
    catch = size(joint, settings.connect, mill=cut.mill)
    steps = tuple(c * 1e-3 for c in STEPS if c * 1e-3 <= 0.25 * (catch.head - catch.neck))
    thin = max(SPIRAL_WIDTHS[0] * h, 0.0 if cut.mill else KERFS * kerf)  # a mill strays less than a beam
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
    return Coupons(**{**_members(made), "strip_load": strip_load(made, STRIP_SAG * length), "spirals": spirals})


def _members(made: Coupons) -> dict[str, Any]:
    return {f.name: getattr(made, f.name) for f in fields(Coupons)}


def read(path: str | Path) -> Coupons:
    """The pieces of a sheet that was made, from its ``calibration.json`` or the folder with it; raises ``FlexMapsError``."""
    path = Path(path)
    path = path / FILE if path.is_dir() else path
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
        assert found.pop("flexmaps") == "calibration"
        found["spirals"] = tuple(SpiralCoupon(**one) for one in found["spirals"])
        found["clearances"] = tuple(map(float, found["clearances"]))
        made = Coupons(**found)
        numbers = [v for v in [*_members(made).values(), *made.clearances] if isinstance(v, float)]
        numbers += [v for s in made.spirals for v in (s.scale, s.width, s.twist, s.load)]
        assert all(math.isfinite(v) and v >= 0.0 for v in numbers)
        assert len(made.spirals) == len(SPIRAL_WIDTHS) and made.cells > 0
        assert min(made.thickness, made.strip_length, made.strip_width, made.youngs, made.density) > 0.0
    except OSError:
        raise FlexMapsError(f"There is no {path}; make a calibration sheet first, it lies beside its files") from None
    except (ValueError, TypeError, KeyError, AttributeError, AssertionError):
        raise FlexMapsError(f"{path} is no calibration of this program, or is damaged; make the sheet again") from None
    return made
