"""What making the object takes: time on the machine, mass, joints, time to put it together. Rough, and said so."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from ..materials import MATERIALS, Material
from ..params import CostParams
from ..spirals.design import SpiralDesign
from .sheets import CutSheets


@dataclass(frozen=True)
class CutSpeed:
    """How fast a laser of 60 W cuts a sheet of 3 mm, in m/s, and where that is published.

    The speed goes with one over the thickness: the same tables give half of it at 6 mm.
    """

    at_3mm: float
    source: str

    def at(self, thickness: float) -> float:
        """Metres a second in a sheet of this thickness, metres; no faster than a machine follows small curves."""
        return min(self.at_3mm * 0.003 / thickness, FASTEST)


FASTEST = 0.06  # m/s
CONTOUR = 0.4  # seconds for every contour: moving there and piercing
ENGRAVING = 0.1  # m/s along the strokes of a label
_TABLE = "teaching material of a certified laser course, 60 W CO2: cast acrylic 3 mm 10-15 mm/s, 6 mm 5-8; birch plywood 3 mm 12-18, 6 mm 5-8; MDF 3 mm 15-20"
# by material, each with where its speed is published
SPEEDS: dict[str, CutSpeed] = {
    "acrylic": CutSpeed(0.0125, _TABLE),
    "birch": CutSpeed(0.015, _TABLE),
    "mdf": CutSpeed(0.0175, _TABLE),
    "pom": CutSpeed(0.0125, "taken as acrylic, which it cuts like; no table at hand names it"),
}
# FlexMaps table 1 gives 0.25 h (Shell) to 7.5 h (Bunny) for objects with about 70 to 700 joints: 12 to 80 s each
JOINT = 45.0  # seconds


def duration(minutes: float) -> str:
    """A rough time in words."""
    whole = max(round(minutes), 1)
    return f"{whole} min" if whole < 90 else f"{minutes / 60.0:.1f} h"


@dataclass(frozen=True)
class Estimates:
    """Rough figures of the making, SI.

    material : of the sheet; mass : kg of the finished panels; sheet_area : square metres of sheets that are needed
    cut_seconds : on a laser of 60 W; ``None`` for materials that are not cut by laser
    cut_speed : m/s, or ``None``; joints : arms that meet across a cut; assembly_seconds : of one person
    waste : share of the sheets that becomes no part
    cut_length : metres of all cuts; costs : of "sheets", "machine" and "assembly", in whatever money the prices are; only what has a price
    """

    material: Material
    mass: float
    sheet_area: float
    cut_seconds: float | None
    cut_speed: float | None
    joints: int
    assembly_seconds: float
    waste: float
    cut_length: float
    costs: dict[str, float]


def estimate(
    sheets: CutSheets, design: SpiralDesign, material: Material, prices: CostParams | None = None
) -> Estimates:
    """Estimate what the sheets of a design take in this material, and what they cost at these prices."""
    contours = sum(1 + len(p.holes) for p in sheets.panels)
    strokes = sum(c.length for p in sheets.panels for c in p.labels)
    seconds = cut_seconds(material, sheets.thickness, sheets.cut_length, contours, strokes)
    joints = int(design.flat.layout.cut.sum())
    area, used = float(sheets.packing.areas.sum()), sum(p.area for p in sheets.panels)
    prices, hour = prices or CostParams(), 3600.0
    costs = {
        "sheets": prices.sheet_price * (sheets.count - len(sheets.packing.remnants)),  # remnants are paid for
        "machine": prices.machine_rate * (seconds or 0.0) / hour,
        "assembly": prices.labour_rate * assembly_seconds(joints) / hour,
    }
    return Estimates(
        material=material,
        mass=material.density * sheets.thickness * used,
        sheet_area=area,
        cut_seconds=seconds,
        cut_speed=cut_speed(material, sheets.thickness),
        joints=joints,
        assembly_seconds=assembly_seconds(joints),
        waste=1.0 - used / area,
        cut_length=sheets.cut_length,
        costs={name: cost for name, cost in costs.items() if cost},
    )


def cut_speed(material: Material, thickness: float) -> float | None:
    """Metres a second at which a laser cuts a sheet of this thickness, metres; ``None`` for what no laser cuts."""
    known = next((key for key, one in MATERIALS.items() if one.name == material.name), "")
    return SPEEDS[known].at(thickness) if known in SPEEDS else None


def cut_seconds(
    material: Material, thickness: float, length: float, contours: int, strokes: float = 0.0
) -> float | None:
    """Seconds on a laser for so many metres of cuts in so many contours, and of strokes that are engraved, metres."""
    speed = cut_speed(material, thickness)
    return None if speed is None else length / speed + CONTOUR * contours + strokes / ENGRAVING


def assembly_seconds(joints: int) -> float:
    """Seconds that one person takes to put so many joints together."""
    return JOINT * joints


def estimates_report(made: Estimates) -> dict[str, Any]:
    """The part of report.json's ``sheets`` block that these figures are; absent where nothing can be said."""
    block: dict[str, Any] = {
        "mass_g": round(made.mass * 1e3, 2),
        "sheet_area_m2": round(made.sheet_area, 4),
        "joints": made.joints,
        "assembly_minutes": round(made.assembly_seconds / 60.0),
        "waste": round(made.waste, 4),
    }
    if made.costs:
        block["cost"] = {
            name: round(cost, 2) for name, cost in (*made.costs.items(), ("total", sum(made.costs.values())))
        }
    if made.cut_seconds is not None and made.cut_speed is not None:
        block |= {"cut_minutes": round(made.cut_seconds / 60.0, 1), "cut_speed_mm_s": round(made.cut_speed * 1e3, 2)}
    return block
