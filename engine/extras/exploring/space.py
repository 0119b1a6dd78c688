"""Search space of an exploration: variables with their ranges, goals, and the two measures to minimise."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import Field, dataclass, fields
from itertools import product
from typing import Any

import numpy as np

from ...arrays import Float
from ...errors import FlexMapsError
from ...materials import OVERSTRAIN_SHARE
from ...params import SHOWN, Settings, values_in_shown_units, with_values
from .explore_params import ExploreParams

Values = dict[str, Any]
# variables that are not settings: median edge of the quads and height of the piece, mm, and number of quads
SIZES = ("edge", "height", "quads")
# sections of the settings that a candidate depends on
SECTIONS = ("layout", "choose", "spiral", "sheet", "material", "simulate", "optimise")
DIGITS = 4  # significant digits of varied values; more: longer to read. With 4, widths in mm are exact to 1 um
# names of a candidate's measures, and their labels with units
MEASURES = {
    "rms_percent": "RMS distance (%)",
    "max_percent": "Largest distance (%)",
    "strain_share": "Strain, share of the limit",
    "slots_closed": "Slots that close",
    "panels": "Panels",
    "joints": "Joints",
    "sheets": "Sheets",
    "quads": "Quads",
    "edge_mm": "Quad edge (mm)",
    "size_mm": "Largest extent (mm)",
    "cut_minutes": "Cutting (min)",
    "join_minutes": "Joining (min)",
}
DEFAULT_OBJECTIVES = ("rms_percent", "strain_share")  # default measures to minimise
DEFAULT_GOALS = ("rms_percent<=1", f"strain_share<={OVERSTRAIN_SHARE:.2g}")


@dataclass(frozen=True)
class Variable:
    """A setting or size that is varied, between ``low`` and ``high`` (in users' units) or among ``choices``."""

    name: str
    low: float = 0.0
    high: float = 0.0
    choices: tuple[Any, ...] = ()

    def at(self, share: float) -> Any:
        """Return the value at a position in [0, 1] of the range or of the choices."""
        if self.choices:
            return self.choices[min(int(share * len(self.choices)), len(self.choices) - 1)]
        return float(f"{self.low + share * (self.high - self.low):.{DIGITS}g}")

    def share(self, value: Any) -> float:
        """Return a position in [0, 1] at which the variable has this value; inverse of ``at``."""
        if self.choices:
            return (self.choices.index(value) + 0.5) / len(self.choices)
        return min(max((value - self.low) / (self.high - self.low), 0.0), 1.0)


@dataclass(frozen=True)
class Goal:
    """A limit of a measure: an upper limit if ``most``, else a lower limit."""

    measure: str
    limit: float
    most: bool = True

    def shortfall(self, measures: Mapping[str, float]) -> float:
        """Return how far the measure is beyond its limit, as a share of the limit; 0 if the goal is met.

        The shortfall is infinite if ``measures`` lacks the goal's measure.
        """
        value = measures.get(self.measure, math.inf if self.most else -math.inf)
        over = value - self.limit if self.most else self.limit - value
        return max(0.0, over / (abs(self.limit) or 1.0))

    def __str__(self) -> str:
        return f"{self.measure} {'<=' if self.most else '>='} {self.limit:g}"


@dataclass(frozen=True)
class SearchSpace:
    """Variables, goals and the two measures to minimise; raises FlexMapsError if they do not fit together."""

    variables: tuple[Variable, ...]
    goals: tuple[Goal, ...]
    minimised: tuple[str, str] = DEFAULT_OBJECTIVES

    def __post_init__(self) -> None:
        names = [variable.name for variable in self.variables]
        if not names:
            raise FlexMapsError(
                "Nothing is varied; name at least one setting and its bounds, such as spiral.thickness=1:3"
            )
        if {"edge", "height"} <= set(names):
            raise FlexMapsError("edge and height both say how large the piece is; vary one of them")
        for name in names:
            if names.count(name) > 1:
                raise FlexMapsError(f"{name} is varied twice; name it once")
        for measure in self.minimised:
            _refuse_unknown_measure(measure)
        if len(set(self.minimised)) != 2:
            raise FlexMapsError("Give two different measures to minimise")

    @property
    def quads(self) -> tuple[int, ...]:
        """Numbers of quads to try; (0,) if the number of quads is not varied."""
        return next((v.choices for v in self.variables if v.name == "quads"), (0,))

    def values(self, place: Float[np.ndarray, " variables"]) -> Values:
        """Return the values of all variables, by name, at a point of the unit cube."""
        return {v.name: v.at(float(x)) for v, x in zip(self.variables, place, strict=True)}

    def place(self, values: Mapping[str, Any]) -> Float[np.ndarray, " variables"]:
        """Return a point of the unit cube at which the variables have these values; inverse of ``values``."""
        return np.array([v.share(values[v.name]) for v in self.variables])

    def sweep(self, most: int) -> list[Values] | None:
        """Return all combinations of choices; None if there are more than ``most``, or if a variable is continuous."""
        if not all(v.choices for v in self.variables) or math.prod(len(v.choices) for v in self.variables) > most:
            return None
        names = [v.name for v in self.variables]
        return [dict(zip(names, one, strict=True)) for one in product(*(v.choices for v in self.variables))]

    def shortfall(self, measures: Mapping[str, float]) -> float:
        """Return the sum of the shortfalls from all goals, see ``Goal.shortfall``."""
        return sum(goal.shortfall(measures) for goal in self.goals)


def parse_variable(name: str, given: Any, settings: Settings) -> Variable:
    """Make a variable from its name and range.

    Parameters
    ----------
    name : one of ``SIZES``, or "section.setting"
    given : "LOW:HIGH", "A,B,C", a tuple of two numbers, or a list of choices, in the units shown to users
    settings : settings of the piece

    Raises
    ------
    FlexMapsError : there is no such setting, or it does not take such a value
    """
    known = _fields(settings)
    if name not in known and name not in SIZES:
        raise FlexMapsError(f"'{name}' cannot be varied; vary {', '.join(SIZES)} or a setting of {', '.join(SECTIONS)}")
    f = known.get(name)
    whole = name == "quads" or (f is not None and isinstance(f.default, int))
    if isinstance(given, str):
        parts = given.split(":") if ":" in given else given.split(",")
        given = tuple(parts) if ":" in given else parts
    if isinstance(given, tuple) and len(given) == 2:
        low, high = (_parse_finite(name, value) for value in given)
        if not low < high:
            raise FlexMapsError(f"{name} from {low:g} to {high:g}: the first bound must be below the second")
        for value in (low, high):
            _refuse_invalid_value(name, f, value, settings)
        if name == "quads":
            raise FlexMapsError("Give quads as a list, such as 200,400,800: for each of them new quads are made")
        if whole:
            return Variable(name, choices=tuple(range(math.ceil(low), math.floor(high) + 1)))
        return Variable(name, low, high)
    if f is None or not isinstance(f.default, str | bool):
        given = [_parse_finite(name, value) for value in given]
        given = [int(value) if whole else value for value in given]
    choices = tuple(dict.fromkeys(given))
    for value in choices:
        _refuse_invalid_value(name, f, value, settings)
    return Variable(name, choices=choices)


def parse_goal(text: str) -> Goal:
    """Parse a goal of the form "measure<=number" or "measure>=number"; raise FlexMapsError for any other text."""
    for sign in ("<=", ">="):
        measure, found, limit = text.partition(sign)
        if found:
            _refuse_unknown_measure(measure.strip())
            return Goal(measure.strip(), _parse_finite(text, limit), sign == "<=")
    raise FlexMapsError(f"'{text}' is not a goal; give it as rms_percent<=1")


def make_space(
    vary: Mapping[str, Any],
    settings: Settings,
    goals: Sequence[str] = DEFAULT_GOALS,
    minimised: Sequence[str] = DEFAULT_OBJECTIVES,
) -> SearchSpace:
    """Make the search space from variables, goals and measures.

    Parameters
    ----------
    vary : ranges by the names of variables, as in ``parse_variable``
    settings : settings of the piece
    goals : goals as in ``parse_goal``
    minimised : two names of ``MEASURES``

    Raises
    ------
    FlexMapsError : a variable, a goal or a measure cannot be understood, or they contradict each other
    """
    variables = tuple(parse_variable(name, given, settings) for name, given in vary.items())
    if len(minimised) != 2:
        raise FlexMapsError("Give two measures to minimise, such as rms_percent and join_minutes")
    return SearchSpace(variables, tuple(parse_goal(text) for text in goals), (minimised[0], minimised[1]))


# variable that each switch of ``ExploreParams`` turns on
SWITCH_VARIABLES = {
    "vary_thickness": "spiral.thickness",
    "vary_widths": "spiral.width_max",
    "vary_twist": "spiral.twist_max",
    "vary_material": "material.material",
    "vary_arms": "optimise.arms",
    "vary_panels": "layout.distortion_limit",
}


def space_from_switches(params: ExploreParams, settings: Settings, edge: float) -> SearchSpace:
    """Make the search space from the switches of the sidebar.

    Parameters
    ----------
    params : the switches, the factor between present and extreme values, and the goals
    settings : settings of the piece
    edge : present median edge of the quads, millimetres
    """
    vary: dict[str, Any] = {"edge": (edge / params.ratio, edge * params.ratio)} if params.vary_size else {}
    present, known = values_in_shown_units(settings), _fields(settings)
    for switch, name in SWITCH_VARIABLES.items():
        if not getattr(params, switch):
            continue
        section, _, short = name.partition(".")
        f, value = known[name], present[section][short]
        if f.metadata["choices"]:
            vary[name] = [choice[0] for choice in f.metadata["choices"] if choice[0] != "custom" or value == "custom"]
            continue
        factor = SHOWN[f.metadata["unit"]][0]
        vary[name] = (
            max(value / params.ratio, factor * f.metadata["low"]),
            min(value * params.ratio, factor * f.metadata["high"]),
        )
    goals = [f"rms_percent<={params.largest:g}", DEFAULT_GOALS[1]] + (
        [f"sheets<={params.sheets}"] if params.sheets else []
    )
    return make_space(vary, settings, goals, DEFAULT_OBJECTIVES)


def _fields(settings: Settings) -> dict[str, Field[Any]]:
    """Return the settings that can be varied, by "section.setting"."""
    return {f"{name}.{f.name}": f for name in SECTIONS for f in fields(getattr(settings, name))}


def _parse_finite(name: str, value: Any) -> float:
    """Return a finite number from a value that may be text; errors begin with ``name``."""
    try:
        found = float(value)
    except (TypeError, ValueError):
        found = math.nan
    if not math.isfinite(found):
        raise FlexMapsError(f"{name}: '{value}' is not a number")
    return found


def _refuse_invalid_value(name: str, f: Field[Any] | None, value: Any, settings: Settings) -> None:
    """Raise FlexMapsError if a variable cannot have a value.

    Conflicts with other settings are not found here; they become faults of candidates.

    f : field of the setting; None for sizes
    """
    if f is None:
        if not value > 0:
            raise FlexMapsError(f"{name}: {value:g} is not above 0")
    elif isinstance(f.default, str | bool):
        with_values(settings, {name: value})
    else:
        low, high = (f.metadata[key] for key in ("low", "high"))
        factor = SHOWN[f.metadata["unit"]][0]
        slack = 1e-6 * abs(value)  # bounds in shown units are rounded
        if (low is not None and value < low * factor - slack) or (high is not None and value > high * factor + slack):
            with_values(settings, {name: value})


def _refuse_unknown_measure(measure: str) -> None:
    if measure not in MEASURES:
        raise FlexMapsError(f"'{measure}' is not a measure; the measures are {', '.join(MEASURES)}")
