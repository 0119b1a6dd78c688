"""Sizes of the calibration pieces (coupons), stored in a file beside the sheet.

The sizes are proportional to the sheet's thickness, so that sags and weights stay practical: the stiffness of the
pieces is then proportional to Young's modulus times thickness.
"""

from __future__ import annotations

import json
import math
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

from ... import MARK
from ...errors import FlexMapsError

CALIBRATION_FILE = "calibration.json"
GRAVITY = 9.80665  # m/s^2, standard
KINDS = ("dovetail", "key", "tab")
# Length, width, clamped part and part beyond the weight of the strip, in thicknesses; intended sag as a share of the
# length. Longer: less shear, larger sheet; wider: the strip bends like a plate, not like a beam
STRIP_LENGTH, STRIP_WIDTH, STRIP_CLAMP, STRIP_END, STRIP_SAG = 50.0, 7.0, 15.0, 3.0, 0.1


@dataclass(frozen=True)
class SpiralCoupon:
    """A spiral in a frame that holds the tips of its arms.

    name : engraved letter
    scale, width : diameter of the spiral, and width of its arms, metres
    twist : winding angle of the arms, radians
    load : suggested weight, kg
    """

    name: str
    scale: float
    width: float
    twist: float
    load: float


@dataclass(frozen=True)
class Coupons:
    """Sizes of all calibration pieces: lengths in metres, weights in kg.

    material : key of the assumed material
    youngs, poisson, density, strain_limit : properties of the assumed material, in SI units
    thickness : thickness of the sheet
    kerf, kerf_holes : assumed kerfs at outlines and at holes, by which the drawn lines are offset
    mill : diameter of the mill; 0 for a laser or another beam
    cells, cell : number of squares in the kerf comb, and side length of a square
    clearances : clearance of the connector at every rung of a ladder (a rail with sockets, the rungs, and counterparts
        to insert into them)
    joint : width of the two arms that each of these connectors joins
    strip_length, strip_width : length of the bending strip from its clamp to its weight, and its width
    strip_load : suggested weight on the bending strip
    spirals : spirals A and B, the softer first
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

    def text(self) -> str:
        """Return the JSON document that is stored beside the sheet, in SI units."""
        return json.dumps({"flexmaps": "calibration", "program": MARK, **asdict(self)}, indent=1) + "\n"


def fields_by_name(made: Coupons) -> dict[str, Any]:
    """Return the fields of ``Coupons`` by name."""
    return {f.name: getattr(made, f.name) for f in fields(Coupons)}


def read_coupons(path: str | Path) -> Coupons:
    """Read the sizes of a sheet from its ``calibration.json`` or the folder with it; raises ``FlexMapsError``."""
    path = Path(path)
    path = path / CALIBRATION_FILE if path.is_dir() else path
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
        assert found.pop("flexmaps") == "calibration"
        found.pop("program", None)  # missing in files of earlier versions
        found["spirals"] = tuple(SpiralCoupon(**one) for one in found["spirals"])
        found["clearances"] = tuple(map(float, found["clearances"]))
        made = Coupons(**found)
        numbers = [v for v in [*fields_by_name(made).values(), *made.clearances] if isinstance(v, float)]
        numbers += [v for s in made.spirals for v in (s.scale, s.width, s.twist, s.load)]
        assert all(math.isfinite(v) and v >= 0.0 for v in numbers)
        assert len(made.spirals) == 2 and made.cells > 0
        assert min(made.thickness, made.strip_length, made.strip_width, made.youngs, made.density) > 0.0
    except OSError:
        raise FlexMapsError(f"There is no {path}; make a calibration sheet first, it lies beside its files") from None
    except (ValueError, TypeError, KeyError, AttributeError, AssertionError):
        raise FlexMapsError(f"{path} is not a FlexMaps calibration file, or is damaged; make the sheet again") from None
    return made
