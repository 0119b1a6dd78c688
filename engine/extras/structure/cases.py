"""Named load cases, each a sum of loads, and combinations of cases with factors; read from lines of text.

    weight: weight
    snow: snow 500 on 12,13,14
    lamp: point 5 -z on lamp lasting
    storm: wind 300 x times 1.2

    all = 1.35 weight + 1.5 snow

A line is NAME: KIND VALUE AXIS on WHERE times FACTOR lasting; lines with the same name form one case. Values are in N,
N/m or N/m2, and in mm for movements.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from ...errors import FlexMapsError

# every kind of load: name of its value, unit and default axis, "" if it has none
KINDS: dict[str, tuple[str, str, str]] = {
    "weight": ("", "", "-z"),
    "point": ("force", "N", ""),
    "line": ("force per metre", "N/m", ""),
    "pressure": ("pressure", "N/m2", ""),
    "wind": ("pressure", "N/m2", ""),
    "snow": ("pressure", "N/m2", "-z"),
    "move": ("movement", "mm", ""),
}
AXES = {sign + axis: k for k, axis in enumerate("xyz") for sign in ("", "+", "-")}
LASTING = "lasting"  # word in a line for a load that acts for years
NAME = r"[^\W\d][\w-]*"  # name of a case: a letter, then letters, digits, _ and -
LINE = re.compile(
    rf"(?P<name>{NAME})\s*:\s*(?P<kind>\w+)(?P<given>(?:\s+\S+?)*?)(?:\s+on\s+(?P<where>.+?))?"
    rf"(?:\s+times\s+(?P<factor>\S+))?(?P<lasting>\s+{LASTING})?\s*"
)
SUM = re.compile(
    rf"\s*(?P<sign>[+-]?)\s*(?P<factor>[0-9.]+(?:e[+-]?[0-9]+)?)?\s*\*?\s*(?P<name>{NAME})\s*", re.IGNORECASE
)
MAX_QUOTE = 60  # largest number of characters of a line that an error quotes


@dataclass(frozen=True)
class Load:
    """One load of a load case.

    kind : key of ``KINDS``
    value : vector (3,) in N, N/m, N/m2 or m; one number for a pressure along the normals; empty for weight
    where : vertex group, numbers of quads, or "lowest"; "" for all quads, or for all supports in case of a movement
    factor : number by which the value is multiplied
    lasting : whether the load acts for years
    """

    kind: str
    value: tuple[float, ...] = ()
    where: str = ""
    factor: float = 1.0
    lasting: bool = False


@dataclass(frozen=True)
class LoadCase:
    """Loads that act together under one name."""

    name: str
    loads: tuple[Load, ...]


@dataclass(frozen=True)
class LoadCombination:
    """A weighted sum of load cases; ``parts`` has the factor and the name of each case."""

    name: str
    parts: tuple[tuple[float, str], ...]


@dataclass(frozen=True)
class LoadPlan:
    """All load cases and combinations of a piece; all names differ."""

    cases: tuple[LoadCase, ...]
    combinations: tuple[LoadCombination, ...] = ()

    def __post_init__(self) -> None:
        if not self.cases:
            raise FlexMapsError("There is no load case; give one, such as 'weight: weight'")
        names = [case.name for case in self.cases] + [one.name for one in self.combinations]
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise FlexMapsError(f"Two cases or combinations are called '{twice[0]}'; give each its own name")
        known = {case.name for case in self.cases}
        for one in self.combinations:
            unknown = [name for _, name in one.parts if name not in known]
            if unknown:
                raise FlexMapsError(
                    f"Combination '{one.name}' adds '{unknown[0]}', which is not a load case; the load cases are {', '.join(known)}"
                )

    @property
    def groups(self) -> tuple[str, ...]:
        """The distinct texts that say where loads act, see ``Load.where``."""
        return tuple(dict.fromkeys(load.where for case in self.cases for load in case.loads if load.where))


def format_line(
    name: str, kind: str, value: float, axis: str, where: str = "", factor: float = 1.0, lasting: bool = False
) -> str:
    """Return the line of text that describes a load; values that its kind does not use are left out.

    Parameters
    ----------
    name, kind : name of the case, and key of ``KINDS``
    value : amount, in the unit of ``KINDS``
    axis : key of ``AXES``
    where, factor, lasting : see ``Load``

    Raises
    ------
    FlexMapsError : ``where`` would not be read back from the line unchanged
    """
    called = KINDS[kind][0]
    words = [f"{name.strip()}: {kind}"]
    words += [f"{value:.6g}"] if called else []
    words += [axis] if called and kind != "pressure" else []
    words += [f"on {where}"] if where else []
    words += [f"times {factor:.6g}"] if factor != 1.0 else []
    words += [LASTING] if lasting and kind != "weight" else []
    line = " ".join(words)
    if ";" in where or "\n" in where:
        raise FlexMapsError(
            f"The group '{where:.{MAX_QUOTE}}' has a semicolon in its name, which separates load cases; rename the group"
        )
    read = _parse_line(line)[1]
    if read.where != where.strip():
        raise FlexMapsError(
            f"The group '{where:.{MAX_QUOTE}}' has a name that reads like words of a load case; rename the group"
        )
    return line


def split_lines(text: str) -> list[str]:
    """Split a text into its non-empty lines; semicolons separate lines too."""
    return [line.strip() for line in re.split(r"[;\n]", text) if line.strip()]


def parse_plan(cases: str | Iterable[str], combinations: str | Iterable[str] = "") -> LoadPlan:
    """Read cases and combinations from lines of text.

    Parameters
    ----------
    cases, combinations : text, or its lines

    Raises
    ------
    FlexMapsError : a line cannot be read, or the names do not fit; the message quotes it
    """
    found: dict[str, list[Load]] = {}
    for line in split_lines(cases) if isinstance(cases, str) else cases:
        name, load = _parse_line(line)
        found.setdefault(name, []).append(load)
    sums = split_lines(combinations) if isinstance(combinations, str) else combinations
    return LoadPlan(
        tuple(LoadCase(n, tuple(loads)) for n, loads in found.items()), tuple(_parse_combination(s) for s in sums)
    )


def _line_error(line: str, why: str) -> FlexMapsError:
    """Return an error that quotes a line of a load case and says what is wrong."""
    return FlexMapsError(f"Load case '{line.strip():.{MAX_QUOTE}}': {why}")


def _parse_line(line: str) -> tuple[str, Load]:
    """Parse a line of text: return the name of its load case, and the load."""
    found = LINE.fullmatch(line.strip())
    if found is None:
        raise _line_error(
            line, "give it as NAME: KIND VALUE AXIS, such as 'snow: snow 500' or 'lamp: point 5 -z on 12,13'"
        )
    kind = found["kind"]
    if kind not in KINDS:
        raise _line_error(line, f"'{kind}' is not a kind of load; choose one of {', '.join(KINDS)}")
    words = found["given"].split()
    factor = 1.0 if found["factor"] is None else _parse_number(line, found["factor"])
    # a piece's own weight acts for years
    lasting = found["lasting"] is not None or kind == "weight"
    return found["name"], Load(kind, _parse_value(line, kind, words), (found["where"] or "").strip(), factor, lasting)


def _parse_value(line: str, kind: str, words: list[str]) -> tuple[float, ...]:
    """Return the value of a load from its words, in SI units: a vector, one number or nothing, see ``Load.value``."""
    called, unit, usual = KINDS[kind]
    if not called:
        if words:
            raise _line_error(line, f"{kind} takes no value; 'times 1.35' gives it a factor")
        return ()
    if not words:
        raise _line_error(line, f"give its {called} in {unit}")
    scale = 1e-3 if unit == "mm" else 1.0
    numbers = [scale * _parse_number(line, word) for word in words[0].split(",")]
    if len(numbers) == 3 and len(words) == 1 and kind not in ("pressure", "wind", "snow"):
        return tuple(numbers)
    if len(numbers) != 1 or len(words) > 2:
        raise _line_error(
            line, f"give its {called} in {unit} as one number and an axis, or of a force or movement as x,y,z"
        )
    if kind == "pressure":
        if len(words) > 1:
            raise _line_error(line, "a pressure acts along the normals and has no axis; wind and snow have one")
        return (numbers[0],)
    axis = words[1] if len(words) > 1 else usual
    if axis not in AXES:
        raise _line_error(line, f"give the axis along which it acts: {', '.join(a for a in AXES if '+' not in a)}")
    along = np.zeros(3)
    along[AXES[axis]] = -numbers[0] if axis.startswith("-") else numbers[0]
    return tuple(along.tolist())


def _parse_number(line: str, word: str) -> float:
    """Parse a finite decimal number in ASCII; raise an error that quotes the line if the word is not a number."""
    try:
        value = float(word) if word.isascii() and "_" not in word else np.nan
    except ValueError:
        value = np.nan
    if not np.isfinite(value):
        raise _line_error(line, f"'{word:.{MAX_QUOTE}}' is not a number")
    return value


def _parse_combination(text: str) -> LoadCombination:
    """Parse a combination from a line such as "all = 1.35 weight + 1.5 snow"."""
    name, equals, right = text.partition("=")
    name = name.strip()
    parts = [SUM.fullmatch(one) for one in re.split(r"(?<![eE])(?=[+-])", right) if one.strip()]
    if not equals or not re.fullmatch(NAME, name) or not parts or not all(parts):
        raise FlexMapsError(f"Combination '{text.strip():.{MAX_QUOTE}}': give it as NAME = 1.35 weight + 1.5 snow")
    found = []
    for part in parts:
        assert part is not None
        found.append((_parse_number(text, part["sign"] + (part["factor"] or "1")), part["name"]))
    return LoadCombination(name, tuple(found))
