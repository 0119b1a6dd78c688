"""Rough estimates of making the piece: time on the machine, mass, joints, and time for assembly."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from ..materials import MATERIALS, Material
from ..params import CostParams
from ..spirals.design import SpiralDesign
from .sheets import CutSheets


@dataclass(frozen=True)
class CutSpeed:
    """Cutting speed of a 60 W laser in a sheet 3 mm thick, m/s, and the source of this figure.

    The speed is assumed to be inversely proportional to the thickness: tables give half of it at 6 mm.
    """

    at_3mm: float
    source: str

    def at_thickness(self, thickness: float) -> float:
        """Return the speed in m/s for a thickness in metres; at most ``MAX_CUT_SPEED``, as machines slow in curves."""
        return min(self.at_3mm * 0.003 / thickness, MAX_CUT_SPEED)


MAX_CUT_SPEED = 0.06  # maximum cutting speed, m/s; larger estimates shorter times for thin sheets
SECONDS_PER_CONTOUR = 0.4  # seconds per contour for travel and piercing; larger estimates longer times
ENGRAVING_SPEED = 0.1  # speed of engraving the strokes of labels, m/s; larger estimates shorter times
_TABLE = "teaching material of a certified laser course, 60 W CO2: cast acrylic 3 mm 10-15 mm/s, 6 mm 5-8; birch plywood 3 mm 12-18, 6 mm 5-8; MDF 3 mm 15-20"
# cutting speeds by key of the material in ``MATERIALS``
CUT_SPEEDS: dict[str, CutSpeed] = {
    "acrylic": CutSpeed(0.0125, _TABLE),
    "birch": CutSpeed(0.015, _TABLE),
    "mdf": CutSpeed(0.0175, _TABLE),
    "pom": CutSpeed(0.0125, "taken as acrylic, which it cuts like; no table at hand names it"),
}
SECONDS_PER_JOINT = 45.0  # seconds to assemble a joint by hand; table 1 of FlexMaps implies 12 to 80 s


def format_duration(minutes: float) -> str:
    """Format a duration given in minutes as "25 min" or "1.8 h"."""
    whole = max(round(minutes), 1)
    return f"{whole} min" if whole < 90 else f"{minutes / 60.0:.1f} h"


@dataclass(frozen=True)
class Estimates:
    """Rough figures of making the piece, in SI units.

    material : material of the sheets
    mass : mass of the finished panels, kg
    sheet_area : area of all sheets needed, m2
    cut_seconds : time on a 60 W laser; None for materials that a laser does not cut
    cut_speed : cutting speed of this laser, m/s, or None
    joints : number of pairs of arms that meet across a cut
    assembly_seconds : time of assembly by a single person
    waste : share of the sheets' area that is not used by parts
    cut_length : total length of the cuts, metres
    costs : costs of "sheets", "machine" and "assembly", in the currency of the prices; only items that have a price
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
    """Estimate mass, time and cost of cutting and assembling a design.

    Parameters
    ----------
    sheets : sheets of the design
    design : spirals
    material : material of the sheets
    prices : price per sheet and rates per hour; if None, no costs are estimated
    """
    contours = sum(1 + len(p.holes) for p in sheets.panels)
    strokes = sum(c.length for p in sheets.panels for c in p.labels)
    seconds = cut_seconds(material, sheets.thickness, sheets.cut_length, contours, strokes)
    joints = int(design.flat.layout.cut.sum())
    area, used = float(sheets.packing.sheet_areas.sum()), sum(p.area for p in sheets.panels)
    prices, hour = prices or CostParams(), 3600.0
    costs = {
        "sheets": prices.sheet_price * (sheets.count - len(sheets.packing.remnants)),  # remnants cost nothing
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
    """Return the speed in m/s of a laser in a thickness in metres; None for materials that a laser does not cut."""
    known = next((key for key, one in MATERIALS.items() if one.name == material.name), "")
    return CUT_SPEEDS[known].at_thickness(thickness) if known in CUT_SPEEDS else None


def cut_seconds(
    material: Material, thickness: float, length: float, contours: int, strokes: float = 0.0
) -> float | None:
    """Return the seconds that a 60 W laser needs to cut and engrave; None for materials that it does not cut.

    Parameters
    ----------
    material : material of the sheets
    thickness : thickness of the sheets, metres
    length : length of all cuts, metres
    contours : number of separate contours
    strokes : length of all engraved strokes, metres
    """
    speed = cut_speed(material, thickness)
    return None if speed is None else length / speed + SECONDS_PER_CONTOUR * contours + strokes / ENGRAVING_SPEED


def assembly_seconds(joints: int) -> float:
    """Return the seconds that a single person needs to assemble this number of joints."""
    return SECONDS_PER_JOINT * joints


def estimates_report(estimates: Estimates) -> dict[str, Any]:
    """Return the estimates for the ``sheets`` block of report.json; unknown figures are left out."""
    block: dict[str, Any] = {
        "mass_g": round(estimates.mass * 1e3, 2),
        "sheet_area_m2": round(estimates.sheet_area, 4),
        "joints": estimates.joints,
        "assembly_minutes": round(estimates.assembly_seconds / 60.0),
        "waste": round(estimates.waste, 4),
    }
    if estimates.costs:
        block["cost"] = {
            name: round(cost, 2) for name, cost in (*estimates.costs.items(), ("total", sum(estimates.costs.values())))
        }
    if estimates.cut_seconds is not None and estimates.cut_speed is not None:
        block |= {
            "cut_minutes": round(estimates.cut_seconds / 60.0, 1),
            "cut_speed_mm_s": round(estimates.cut_speed * 1e3, 2),
        }
    return block
