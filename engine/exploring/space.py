"""What is varied, what is asked for, and what is to be small: the question that an exploration answers."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import Field, dataclass, fields
from itertools import product
from typing import Any

import numpy as np

from ..arrays import Float
from ..errors import FlexMapsError
from ..materials import STRAINED
from ..params import SHOWN, ExploreParams, Settings, changed, shown_values

Values = dict[str, Any]
SIZES = ("edge", "height", "quads")  # what is no setting of a stage: millimetres, millimetres, a number
SECTIONS = ("layout", "choose", "spiral", "sheet", "material", "simulate", "optimise")  # what a candidate depends on
DIGITS = 4  # of a number that is tried: nobody cuts finer, and it reads well; not measured
# what is known of a candidate, and its words and unit for a plot
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
MINIMISED = ("rms_percent", "strain_share")  # what is plotted against each other where nobody says
GOALS = ("rms_percent<=1", f"strain_share<={STRAINED:.2g}")


@dataclass(frozen=True)
class Variable:
    """Something that is varied, in the units that people are shown: between two numbers, or among ``choices``."""

    name: str
    low: float = 0.0
    high: float = 0.0
    choices: tuple[Any, ...] = ()

    def at(self, share: float) -> Any:
        """Its value at a place of [0, 1]."""
        if self.choices:
            return self.choices[min(int(share * len(self.choices)), len(self.choices) - 1)]
        return float(f"{self.low + share * (self.high - self.low):.{DIGITS}g}")

    def share(self, value: Any) -> float:
        """A place of [0, 1] that has this value."""
        if self.choices:
            return (self.choices.index(value) + 0.5) / len(self.choices)
        return min(max((value - self.low) / (self.high - self.low), 0.0), 1.0)


@dataclass(frozen=True)
class Goal:
    """What a measure of a candidate shall be, at most (``most``) or at least."""

    measure: str
    limit: float
    most: bool = True

    def missed(self, measures: Mapping[str, float]) -> float:
        """By how much it is missed, as a share of the limit; 0 where it is held."""
        value = measures.get(self.measure, math.inf)
        over = value - self.limit if self.most else self.limit - value
        return max(0.0, over / (abs(self.limit) or 1.0))

    def __str__(self) -> str:
        return f"{self.measure} {'<=' if self.most else '>='} {self.limit:g}"


@dataclass(frozen=True)
class Space:
    """The whole question. Raises ``FlexMapsError`` for what cannot be asked."""

    variables: tuple[Variable, ...]
    goals: tuple[Goal, ...]
    minimised: tuple[str, str] = MINIMISED

    def __post_init__(self) -> None:
        names = [variable.name for variable in self.variables]
        if not names:
            raise FlexMapsError("Nothing is varied; name at least one setting and its bounds, as spiral.thickness=1:3")
        if {"edge", "height"} <= set(names):
            raise FlexMapsError("edge and height both say how large the piece is; vary one of them")
        for name in names:
            if names.count(name) > 1:
                raise FlexMapsError(f"{name} is varied twice; name it once")
        for measure in self.minimised:
            _refuse_unknown(measure)
        if len(set(self.minimised)) != 2:
            raise FlexMapsError("Two different measures are needed that are to be small")

    @property
    def quads(self) -> tuple[int, ...]:
        """The numbers of quads that are tried; 0 alone where it has those that it has."""
        return next((v.choices for v in self.variables if v.name == "quads"), (0,))

    def values(self, place: Float[np.ndarray, " variables"]) -> Values:
        """What is tried at a place of the unit cube."""
        return {v.name: v.at(float(x)) for v, x in zip(self.variables, place, strict=True)}

    def place(self, values: Mapping[str, Any]) -> Float[np.ndarray, " variables"]:
        """A place of the unit cube that has these values."""
        return np.array([v.share(values[v.name]) for v in self.variables])

    def sweep(self, most: int) -> list[Values] | None:
        """Every combination, where there are no more than so many; None where there are."""
        if not all(v.choices for v in self.variables) or math.prod(len(v.choices) for v in self.variables) > most:
            return None
        names = [v.name for v in self.variables]
        return [dict(zip(names, one, strict=True)) for one in product(*(v.choices for v in self.variables))]

    def missed(self, measures: Mapping[str, float]) -> float:
        """By how much all goals together are missed."""
        return sum(goal.missed(measures) for goal in self.goals)


def variable(name: str, given: Any, settings: Settings) -> Variable:
    """A variable from a name and "LOW:HIGH", "A,B,C", a pair of numbers, or a list of choices, in shown units.

    Raises ``FlexMapsError`` where there is no such setting, or it takes no such value.
    """
    known = _fields(settings)
    if name not in known and name not in SIZES:
        raise FlexMapsError(
            f"'{name}' cannot be varied; that can be {', '.join(SIZES)} and the settings of {', '.join(SECTIONS)}"
        )
    f = known.get(name)
    whole = name == "quads" or (f is not None and isinstance(f.default, int))
    if isinstance(given, str):
        parts = given.split(":") if ":" in given else given.split(",")
        given = tuple(parts) if ":" in given else parts
    if isinstance(given, tuple) and len(given) == 2:
        low, high = (_number(name, value) for value in given)
        if not low < high:
            raise FlexMapsError(f"{name} from {low:g} to {high:g}: the first bound must be below the second")
        for value in (low, high):
            _refuse_wrong(name, f, value, settings)
        if name == "quads":
            raise FlexMapsError("Give quads as a list, such as 200,400,800: for each of them new quads are made")
        if whole:
            return Variable(name, choices=tuple(range(math.ceil(low), math.floor(high) + 1)))
        return Variable(name, low, high)
    if f is None or not isinstance(f.default, str | bool):
        given = [_number(name, value) for value in given]
        given = [int(value) if whole else value for value in given]
    choices = tuple(dict.fromkeys(given))
    for value in choices:
        _refuse_wrong(name, f, value, settings)
    return Variable(name, choices=choices)


def goal(text: str) -> Goal:
    """A goal from "measure<=number" or "measure>=number"."""
    for sign in ("<=", ">="):
        measure, found, limit = text.partition(sign)
        if found:
            _refuse_unknown(measure.strip())
            return Goal(measure.strip(), _number(text, limit), sign == "<=")
    raise FlexMapsError(f"'{text}' is no goal; give it as rms_percent<=1")


def space(
    vary: Mapping[str, Any], settings: Settings, goals: Sequence[str] = GOALS, minimised: Sequence[str] = MINIMISED
) -> Space:
    """The question that is asked with these words."""
    variables = tuple(variable(name, given, settings) for name, given in vary.items())
    if len(minimised) != 2:
        raise FlexMapsError("Two measures are needed that are to be small, as rms_percent and join_minutes")
    return Space(variables, tuple(goal(text) for text in goals), (minimised[0], minimised[1]))


# of ``ExploreParams``: what a switch varies
SWITCHES = {
    "vary_thickness": "spiral.thickness",
    "vary_widths": "spiral.width_max",
    "vary_twist": "spiral.twist_max",
    "vary_material": "material.material",
    "vary_arms": "optimise.arms",
    "vary_panels": "layout.distortion_limit",
}


def usual(params: ExploreParams, settings: Settings, edge: float) -> Space:
    """The question that the sidebar's switches ask; ``edge`` is the present one, millimetres."""
    vary: dict[str, Any] = {"edge": (edge / params.ratio, edge * params.ratio)} if params.vary_size else {}
    present, known = shown_values(settings), _fields(settings)
    for switch, name in SWITCHES.items():
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
    goals = [f"rms_percent<={params.largest:g}", GOALS[1]] + ([f"sheets<={params.sheets}"] if params.sheets else [])
    return space(vary, settings, goals, MINIMISED)


def _fields(settings: Settings) -> dict[str, Field[Any]]:
    return {f"{name}.{f.name}": f for name in SECTIONS for f in fields(getattr(settings, name))}


def _number(name: str, value: Any) -> float:
    try:
        found = float(value)
    except (TypeError, ValueError):
        found = math.nan
    if not math.isfinite(found):
        raise FlexMapsError(f"{name}: '{value}' is no number")
    return found


def _refuse_wrong(name: str, f: Field[Any] | None, value: Any, settings: Settings) -> None:
    """Raise where a variable cannot have a value; what crosses another setting is told of the candidate."""
    if f is None:
        if not value > 0:
            raise FlexMapsError(f"{name}: {value:g} is not above 0")
    elif isinstance(f.default, str | bool):
        changed(settings, {name: value})
    else:
        low, high = (f.metadata[key] for key in ("low", "high"))
        factor = SHOWN[f.metadata["unit"]][0]
        slack = 1e-6 * abs(value)  # bounds in shown units are rounded
        if (low is not None and value < low * factor - slack) or (high is not None and value > high * factor + slack):
            changed(settings, {name: value})


def _refuse_unknown(measure: str) -> None:
    if measure not in MEASURES:
        raise FlexMapsError(f"'{measure}' is nothing that is measured; that is {', '.join(MEASURES)}")
