"""Compute kerf, clearance and stiffness, with standard errors, from measurements on a calibration sheet.

Kerf: the comb is a window with n squares, cut by n + 1 lines including its ends, and every line removes one kerf.
Pushed to one side, the squares leave a gap of n + 1 kerfs.

Clearance: the rung (joint of the ladder) that fits best was drawn with a clearance c for a kerf k0; with the true kerf
k its gap is c + k - k0. This gap is the clearance to use, once outlines are drawn for the kerf k.

Stiffness: see ``bending``. The true width of a piece, k0 - k more than drawn, is used. Strip and spirals are two
measurements of Young's modulus. If they agree within their errors, their mean is used, weighted by inverse variance.
Otherwise the spirals' value is used: they bend and twist in all directions of the sheet as the piece does, while the
strip bends in one direction only, and wood is stiffer along its grain.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from numbers import Real
from typing import Any

import numpy as np

from ...errors import FlexMapsError
from ...params import Settings, with_values
from .bending import spiral_youngs, strip_youngs
from .coupons import KINDS, STRIP_CLAMP, STRIP_END, Coupons

MIN_READING_ERROR = 0.02  # smallest standard error of a sag, share of its value; larger: fewer contradictions
CALIPER_ERROR = 2e-5  # standard error of a caliper reading, metres
# Relative error that the formulas in ``bending`` cause in a modulus; larger: fewer reports of contradictions
FORMULA_ERROR = 0.02
# Largest difference, in combined standard errors, of two moduli that agree; larger: fewer reports of contradictions
MAX_DEVIATION = 3.0
DIGITS = 3  # number of significant digits of results, minus one


@dataclass(frozen=True)
class Readings:
    """Measurements: lengths in metres, masses in kg; empty or None if not measured.

    kerf_gaps : gaps in the comb with the squares pushed to one side
    clearance, kind : value of the rung that fits best, and kind of its connector
    thickness : thickness of the sheet at several places
    strip_sags, strip_load, strip_mass : sags of the strip's end, the weight on it, and the mass of the strip itself
    spiral_sags, spiral_loads : sags of spirals A and B, a pair per measurement, and the weights on them
    """

    kerf_gaps: Sequence[float] = ()
    clearance: float | None = None
    kind: str = "dovetail"
    thickness: Sequence[float] = ()
    strip_sags: Sequence[float] = ()
    strip_load: float | None = None
    strip_mass: float | None = None
    spiral_sags: Sequence[tuple[float, float]] = ()
    spiral_loads: tuple[float, float] | None = None

    @classmethod
    def from_measurements(
        cls,
        *,
        kerf_comb: Sequence[float] | float = (),
        clearance: Sequence[float] | float | None = None,
        kind: str = "dovetail",
        thickness: Sequence[float] = (),
        strip_sag: Sequence[float] = (),
        strip_weight: Sequence[float] | float | None = None,
        strip_mass: Sequence[float] | float | None = None,
        spiral_sag: Sequence[Sequence[float]] = (),
        spiral_weight: Sequence[float] | None = None,
    ) -> Readings:
        """Make readings from measurements in mm and g; raises ``FlexMapsError``.

        Parameters
        ----------
        kerf_comb, clearance, kind, thickness, strip_sag, strip_weight, strip_mass : see ``Readings``
        spiral_sag, spiral_weight : one or several pairs of sags of spirals A and B, and the pair of weights
        """
        pairs = [spiral_sag] if spiral_sag and not isinstance(spiral_sag[0], Sequence) else spiral_sag
        weights = _to_si_numbers(spiral_weight, "spirals' weights")
        both = [_to_si_numbers(pair, "spirals' sags") for pair in pairs]
        if any(len(pair) != 2 for pair in both) or len(weights) not in (0, 2):
            raise FlexMapsError("Give two numbers for the spirals, one for A and one for B")
        one = {name: _to_si_numbers(value, name.replace("_", " ")) for name, value in
               (("clearance", clearance), ("strip_weight", strip_weight), ("strip_mass", strip_mass))}  # fmt: skip
        if any(len(value) > 1 for value in one.values()):
            raise FlexMapsError("Give one number each for the clearance, the strip's weight and its mass")
        first = {name: value[0] if value else None for name, value in one.items()}
        return cls(
            _to_si_numbers(kerf_comb, "kerf comb"), first["clearance"], kind, _to_si_numbers(thickness, "thickness"),
            _to_si_numbers(strip_sag, "strip's sag"), first["strip_weight"], first["strip_mass"],
            [(a, b) for a, b in both], (weights[0], weights[1]) if weights else None,
        )  # fmt: skip


def parse_numbers(text: str) -> list[float]:
    """Parse the numbers in a text such as "1.02, 1.04"; raises ``FlexMapsError``."""
    try:
        return [float(word) for word in text.replace(",", " ").replace(";", " ").split()]
    except ValueError:
        raise FlexMapsError(f"'{text[:40]}' is not a list of numbers; write them as 1.02, 1.04") from None


def _to_si_numbers(value: Any, what: str) -> list[float]:
    """Return one or several numbers times 1e-3: mm to metres, g to kg; ``what`` names them in errors."""
    some = (
        []
        if value is None
        else list(value)
        if isinstance(value, Sequence | np.ndarray) and not isinstance(value, str)
        else [value]
    )
    if any(isinstance(x, bool) or not isinstance(x, Real) for x in some):
        raise FlexMapsError(f"The {what} must be given as numbers, in millimetres or grams")
    return [1e-3 * float(x) for x in some]


@dataclass(frozen=True)
class MeasuredValue:
    """A measured value and its standard error, in SI units."""

    value: float
    error: float

    @property
    def share(self) -> float:
        """The error as a share of the value."""
        return self.error / self.value


@dataclass(frozen=True)
class Calibration:
    """Results in SI units; None if not measured.

    strip, spirals : Young's modulus measured with the strip and with the spirals, Pa
    youngs, believed : Young's modulus to use, and a text that says where it comes from
    warnings : sentences about contradictions
    settings : the measured settings, "section.name" -> value, for ``params.with_values``
    """

    kerf: MeasuredValue | None
    clearance: MeasuredValue | None
    thickness: MeasuredValue | None
    strip: MeasuredValue | None
    spirals: MeasuredValue | None
    youngs: MeasuredValue | None
    density: float | None
    believed: str
    warnings: tuple[str, ...]
    settings: dict[str, Any] = field(default_factory=dict)

    def report(self) -> dict[str, Any]:
        """Return the results in the units of their names (mm, GPa, kg/m3), for JSON."""

        def shown(one: MeasuredValue | None, factor: float) -> dict[str, float] | None:
            return (
                None if one is None else {"value": _rounded(one.value * factor), "error": _rounded(one.error * factor)}
            )

        return {
            "kerf_mm": shown(self.kerf, 1e3),
            "clearance_mm": shown(self.clearance, 1e3),
            "thickness_mm": shown(self.thickness, 1e3),
            "youngs_gpa": shown(self.youngs, 1e-9),
            "youngs_strip_gpa": shown(self.strip, 1e-9),
            "youngs_spirals_gpa": shown(self.spirals, 1e-9),
            "density": None if self.density is None else _rounded(self.density),
            "believed": self.believed,
            "warnings": list(self.warnings),
            "settings": self.settings,
        }


def calibrate(made: Coupons, readings: Readings) -> Calibration:
    """Evaluate the readings of a sheet; raises ``FlexMapsError`` if a reading is impossible, or if there are none.

    Parameters
    ----------
    made, readings : sizes of the calibration pieces, and measurements
    """
    _refuse_impossible_readings(made, readings)
    warnings: list[str] = []
    kerf, strays = _evaluate_kerf(made, readings)
    wider = made.kerf - kerf.value if kerf is not None else 0.0
    wider_arms = made.kerf_holes - kerf.value if kerf is not None else 0.0
    if kerf is not None and wider_arms <= -made.spirals[0].width:
        raise FlexMapsError(
            f"A kerf of {kerf.value * 1e3:.2f} mm would leave nothing of the spirals' arms; measure the gap again"
        )
    thickness = _mean_with_error(readings.thickness, CALIPER_ERROR) if readings.thickness else None
    as_cut = made if thickness is None else replace(made, thickness=thickness.value)
    clearance = _evaluate_clearance(readings, kerf, wider, strays, warnings)
    strip, density = _evaluate_strip(as_cut, readings, wider)
    spirals = _evaluate_spirals(as_cut, readings, wider_arms, warnings)
    youngs, believed = _choose_modulus(strip, spirals, warnings)
    found = Calibration(kerf, clearance, thickness, strip, spirals, youngs, density, believed, tuple(warnings))
    if all(one is None for one in (kerf, clearance, thickness, youngs, density)):
        raise FlexMapsError(
            "Nothing was measured; give the gap of the kerf comb, the rung that fits, or how far strip and spirals sag"
        )
    return replace(found, settings=_measured_settings(made, found, readings))


def _refuse_impossible_readings(made: Coupons, readings: Readings) -> None:
    """Raise ``FlexMapsError`` if a reading cannot come from pieces of these sizes."""
    values = {
        "kerf comb's gap": readings.kerf_gaps, "thickness": readings.thickness, "strip's sag": readings.strip_sags,
        "spirals' sag": [x for pair in readings.spiral_sags for x in pair], "weights": readings.spiral_loads or (),
        "strip's weight": () if readings.strip_load is None else (readings.strip_load,),
        "strip's mass": () if readings.strip_mass is None else (readings.strip_mass,),
    }  # fmt: skip
    for name, some in values.items():
        if any(not math.isfinite(x) or x <= 0.0 for x in some):
            raise FlexMapsError(f"The {name} must be a number above 0; measure it again, or leave it out")
    if readings.kind not in KINDS:
        raise FlexMapsError(f"There is no connector '{readings.kind}'; the ladders are of {', '.join(KINDS)}")
    if readings.clearance is not None and not any(abs(readings.clearance - c) < 1e-7 for c in made.clearances):
        rungs = ", ".join(f"{c * 1e3:g}" for c in made.clearances)
        raise FlexMapsError(
            f"No rung is engraved {readings.clearance * 1e3:g}; the clearances of this sheet are {rungs} mm"
        )
    for x in readings.thickness:
        if not 0.5 < x / made.thickness < 2.0:
            raise FlexMapsError(
                f"The pieces were drawn for a sheet of {made.thickness * 1e3:g} mm, but {x * 1e3:g} mm was measured; "
                "make a calibration sheet for this thickness"
            )


def _mean_with_error(values: Sequence[float], ruler: float = 0.0) -> MeasuredValue:
    """Return the mean and standard error of readings, from their scatter or the error of one reading if that is larger.

    ruler : standard error of one reading, in the unit of the readings; if 0, ``MIN_READING_ERROR`` times the mean
    """
    some = np.asarray(values, dtype=float)
    middle, count = float(some.mean()), len(some)
    known = ruler or MIN_READING_ERROR * middle
    scatter = float(some.std(ddof=1)) if count > 1 else 0.0
    return MeasuredValue(middle, max(scatter, known) / math.sqrt(count))


def _evaluate_kerf(made: Coupons, readings: Readings) -> tuple[MeasuredValue | None, float]:
    """Return the kerf with its standard error, and the resulting error of a joint's gap, metres."""
    if not readings.kerf_gaps:
        return None, 0.0
    lines = made.cells + 1
    gap = _mean_with_error(readings.kerf_gaps, CALIPER_ERROR)
    if gap.value >= made.cells * made.cell:
        raise FlexMapsError(
            f"A gap of {gap.value * 1e3:.1f} mm leaves nothing of {made.cells} squares of {made.cell * 1e3:g} mm; "
            "push them to one side and measure what is left between them and the window"
        )
    kerf = MeasuredValue(gap.value / lines, gap.error / lines)
    return kerf, kerf.error


def _evaluate_clearance(
    readings: Readings, kerf: MeasuredValue | None, wider: float, strays: float, warnings: list[str]
) -> MeasuredValue | None:
    """Return the clearance to use; append a warning if it is smaller than its error. ``wider``: true minus drawn width
    of a piece, metres; ``strays``: standard error of a joint's gap, metres."""
    if readings.clearance is None:
        return None
    # without a measured kerf ``wider`` is 0: the kerf for which the sheet was drawn counts as true
    gap = readings.clearance - wider
    error = math.hypot(strays, CALIPER_ERROR if kerf is None else 0.0)
    if kerf is not None and gap < -MAX_DEVIATION * error - 1e-6:
        raise FlexMapsError(
            f"The rung of {readings.clearance * 1e3:g} mm cannot fit: with the measured kerf of {kerf.value * 1e3:.3f} mm its parts "
            f"would overlap by {-gap * 1e3:.3f} mm; measure the kerf comb again, or look which rung it was"
        )
    if gap < error:
        warnings.append(
            f"The clearance of {max(gap, 0.0) * 1e3:.3f} mm is below the kerf's error of {error * 1e3:.3f} mm: joints may jam; "
            "measure the kerf comb several times, or take the next rung"
        )
    return MeasuredValue(max(gap, 0.0), max(error, 1e-9))


def _evaluate_strip(made: Coupons, readings: Readings, wider: float) -> tuple[MeasuredValue | None, float | None]:
    """Return Young's modulus, Pa, and density, kg/m3, from the strip; ``wider``: true minus drawn width, metres."""
    width = made.strip_width + wider
    long = made.strip_length + (STRIP_CLAMP + STRIP_END) * made.thickness + wider
    density = None
    if readings.strip_mass is not None:
        density = readings.strip_mass / (width * long * made.thickness)
        if not 10.0 < density < 3e4:
            raise FlexMapsError(
                f"A strip of {readings.strip_mass * 1e3:g} g would weigh {density:.0f} kg per cubic metre; weigh it again, in grams"
            )
    if not readings.strip_sags:
        return None, density
    load = readings.strip_load or made.strip_load
    known = made if density is None else replace(made, density=density)
    youngs = [strip_youngs(known, sag, load, width=width) for sag in readings.strip_sags]
    return _mean_with_error(youngs), density


def _evaluate_spirals(made: Coupons, readings: Readings, wider: float, warnings: list[str]) -> MeasuredValue | None:
    """Return Young's modulus, Pa, from the readings of both spirals; append a warning if A and B contradict."""
    if not readings.spiral_sags:
        return None
    loads = readings.spiral_loads or tuple(one.load for one in made.spirals)
    found = [
        _mean_with_error([spiral_youngs(made, one, pair[k], loads[k], wider) for pair in readings.spiral_sags])
        for k, one in enumerate(made.spirals)
    ]
    first, second = found
    if _contradict(first, second):
        warnings.append(
            f"Spirals A and B contradict each other: {first.value * 1e-9:.2f} and {second.value * 1e-9:.2f} GPa; check their weights, "
            "that their frames are held all round, and the kerf, which their arms' width depends on"
        )
    return _weighted_mean(found)


def _weighted_mean(some: Sequence[MeasuredValue]) -> MeasuredValue:
    """Return the mean of values weighted by inverse variance, and its standard error."""
    weights = np.array([1.0 / one.error**2 for one in some])
    value = float(weights @ np.array([one.value for one in some]) / weights.sum())
    return MeasuredValue(value, float(weights.sum() ** -0.5))


def _contradict(one: MeasuredValue, other: MeasuredValue) -> bool:
    """Return whether two moduli differ by more than ``MAX_DEVIATION`` standard errors and the error of the formulas."""
    middle = 0.5 * (one.value + other.value)
    return abs(one.value - other.value) > MAX_DEVIATION * math.hypot(one.error, other.error) + FORMULA_ERROR * middle


def _choose_modulus(
    strip: MeasuredValue | None, spirals: MeasuredValue | None, warnings: list[str]
) -> tuple[MeasuredValue | None, str]:
    """Return the modulus to use, from the strip, the spirals or both, and a text with the reason."""
    if strip is None or spirals is None:
        one = strip or spirals
        if one is None:
            return None, ""
        return (
            one,
            "the strip, for the spirals were not measured" if strip else "the spirals, for the strip was not measured",
        )
    if not _contradict(strip, spirals):
        return _weighted_mean(
            [strip, spirals]
        ), "both, for they agree within their spread; each counts by how little it scatters"
    warnings.append(
        f"Strip and spirals contradict each other: {strip.value * 1e-9:.2f} GPa +- {strip.share:.0%} and "
        f"{spirals.value * 1e-9:.2f} GPa +- {spirals.share:.0%}; measure again, unless the sheet is stiffer in one direction, as wood is"
    )
    return spirals, (
        "the spirals, for the strip disagrees: spirals bend and twist in all directions of the sheet, as the piece does, the strip in "
        "one only"
    )


def _measured_settings(made: Coupons, found: Calibration, readings: Readings) -> dict[str, Any]:
    """Return the measured settings by "section.name"; all values of a custom material if one of them was measured."""
    values: dict[str, Any] = {}
    if found.thickness is not None or found.youngs is not None:
        values["spiral.thickness"] = _rounded(1e3 * (found.thickness.value if found.thickness else made.thickness))
    if found.youngs is not None or found.density is not None:
        youngs = found.youngs.value if found.youngs is not None else made.youngs
        values |= {
            "material.material": "custom",
            "material.youngs": _rounded(youngs * 1e-9),
            "material.poisson": made.poisson,
            "material.density": _rounded(made.density if found.density is None else found.density),
            "material.strain_limit": made.strain_limit,
        }
    if found.kerf is not None:
        kerf = _rounded(1e3 * found.kerf.value)
        values |= {"cut.kerf_outline": kerf, "cut.kerf_holes": kerf}
    if found.clearance is not None:
        values |= {"connect.connector": readings.kind, "connect.clearance": _rounded(1e3 * found.clearance.value)}
    try:
        with_values(Settings(), {k: v for k, v in values.items() if not k.startswith("cut.")})
    except FlexMapsError as error:
        raise FlexMapsError(
            f"The measured values are outside the range of the settings: {error}; check the units"
        ) from None
    return values


def _rounded(value: float) -> float:
    """Return a number rounded to ``DIGITS`` + 1 significant digits."""
    return float(f"{value:.{DIGITS + 1}g}")


def preset_script(values: Mapping[str, Any], note: str) -> str:
    """Return the Python script of a Blender preset with these settings.

    Parameters
    ----------
    values, note : values by "section.name", and a comment for the first line
    """
    lines = [f"# {' '.join(note.split())}", "import bpy", "", "settings = bpy.context.object.flexmaps", ""]
    return "\n".join([*lines, *(f"settings.{name} = {value!r}" for name, value in values.items())]) + "\n"
