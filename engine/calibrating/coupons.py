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

from .. import MARK
from ..errors import FlexMapsError
from ..materials import Material

FILE = "calibration.json"
GRAVITY = 9.80665  # m/s^2, standard
KINDS = ("dovetail", "key", "tab")
# The strip in thicknesses: so slender that shear makes less than 0.1 % of its sag, and so narrow that it bends as a beam and not
# as a plate (within 1 % of finite elements, see ``bench workshop``). Its sag is to be a tenth of its length.
STRIP_LENGTH, STRIP_WIDTH, STRIP_CLAMP, STRIP_END, STRIP_SAG = 50.0, 7.0, 15.0, 3.0, 0.1


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
        return json.dumps({"flexmaps": "calibration", "program": MARK, **asdict(self)}, indent=1) + "\n"


def members(made: Coupons) -> dict[str, Any]:
    """Its values by their names."""
    return {f.name: getattr(made, f.name) for f in fields(Coupons)}


def read(path: str | Path) -> Coupons:
    """The pieces of a sheet that was made, from its ``calibration.json`` or the folder with it; raises ``FlexMapsError``."""
    path = Path(path)
    path = path / FILE if path.is_dir() else path
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
        assert found.pop("flexmaps") == "calibration"
        found.pop("program", None)  # files of earlier versions do not say it
        found["spirals"] = tuple(SpiralCoupon(**one) for one in found["spirals"])
        found["clearances"] = tuple(map(float, found["clearances"]))
        made = Coupons(**found)
        numbers = [v for v in [*members(made).values(), *made.clearances] if isinstance(v, float)]
        numbers += [v for s in made.spirals for v in (s.scale, s.width, s.twist, s.load)]
        assert all(math.isfinite(v) and v >= 0.0 for v in numbers)
        assert len(made.spirals) == 2 and made.cells > 0
        assert min(made.thickness, made.strip_length, made.strip_width, made.youngs, made.density) > 0.0
    except OSError:
        raise FlexMapsError(f"There is no {path}; make a calibration sheet first, it lies beside its files") from None
    except (ValueError, TypeError, KeyError, AttributeError, AssertionError):
        raise FlexMapsError(f"{path} is no calibration of this program, or is damaged; make the sheet again") from None
    return made
