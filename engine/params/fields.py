"""How a setting is declared: default, bounds, unit and help text; and what refuses a wrong value.

The engine works in SI units; ``unit`` is the unit of the value in the dataclass ("m", "rad", "Pa", or "" for a pure number).
People are shown millimetres, degrees and gigapascals: ``SHOWN`` holds the factor and the symbol, used by the Blender settings and by
the command line.
"""

from __future__ import annotations

import math
from dataclasses import Field, field, fields
from numbers import Integral, Real
from typing import Any, ClassVar

from ..errors import FlexMapsError

# of each unit: the factor to what is shown, and its symbol
SHOWN: dict[str, tuple[float, str]] = {
    "m": (1e3, "mm"),
    "rad": (180.0 / math.pi, "\N{DEGREE SIGN}"),
    "Pa": (1e-9, "GPa"),
    "": (1.0, ""),
}


def setting(
    default: Any,
    label: str,
    help: str,
    *,
    low: float | None = None,
    high: float | None = None,
    unit: str = "",
    choices: tuple[tuple[str, str, str], ...] = (),
    folder: bool = False,
) -> Any:
    """Declare a dataclass field with what the user interfaces need to show it.

    ``choices`` are (identifier, label, help) triples for a string setting; ``folder`` marks a string that names one.
    """
    meta = {"label": label, "help": help, "low": low, "high": high, "unit": unit, "choices": choices, "folder": folder}
    return field(default=default, metadata=meta)


LARGEST = 1e300  # of any number; beyond it, and where it is no number at all, is what nobody means
SLACK = 1e-6  # relative: Blender's single precision lands a hair outside of bounds


def wanted(f: Field) -> str:
    """What number a field takes, e.g. "a whole number from 0 to 50"."""
    whole = isinstance(f.default, int)
    kind, tell = ("a whole number", str) if whole else ("a number", lambda bound: shown(f, bound))
    low, high = (None if f.metadata[k] is None else tell(f.metadata[k]) for k in ("low", "high"))
    if low is not None and high is not None:
        return f"{kind} from {low} to {high}"
    return kind if low is None else f"{kind} from {low} on"


def shown(f: Field, value: float) -> str:
    """``value`` of the field ``f`` as a person reads it, e.g. ``"2 mm"``."""
    factor, symbol = SHOWN[f.metadata["unit"]]
    return f"{value * factor:g}{' ' if symbol.isalpha() else ''}{symbol}"


class Params:
    """Base of all settings: refuses values of another kind, values outside their bounds, and bounds of each other that cross."""

    ORDERED: ClassVar[tuple[tuple[str, str], ...]] = ()  # of each pair the first may not be above the second
    # switches that earlier versions had, on by default, and the settings that stand for them where they are off
    WERE: ClassVar[dict[str, dict[str, Any]]] = {}

    def __post_init__(self) -> None:
        known = {f.name: f for f in fields(self)}  # type: ignore[arg-type]
        for f in known.values():
            _refuse_wrong(f, getattr(self, f.name))
        for name, other in self.ORDERED:
            refuse_above(self, name, self, other, "exchange them, or change one of them")


def refuse_above(block: Params, name: str, other: Params, limit: str, remedy: str) -> None:
    """Raise where a setting of a block is above one of the same or of another block."""
    value, most = getattr(block, name), getattr(other, limit)
    if value > most + SLACK * abs(most):
        low, high = (next(f for f in fields(b) if f.name == n) for b, n in ((block, name), (other, limit)))  # type: ignore[arg-type]
        raise FlexMapsError(
            f"{low.metadata['label']} {shown(low, value)} is above {high.metadata['label']} {shown(high, most)}; {remedy}"
        )


def is_number(value: Any, *, whole: bool = False) -> bool:
    """Whether it is a number that can be computed with."""
    return isinstance(value, Integral if whole else Real) and not isinstance(value, bool) and abs(value) <= LARGEST  # type: ignore[operator]


def quoted(value: Any) -> str:
    """A value for a message, in one line, however long it is."""
    try:
        text = value if isinstance(value, str) else repr(value)
    except ValueError:  # Python does not write out whole numbers of thousands of digits
        text = "a very large number"
    text = " ".join(text.split())
    return f"'{text if len(text) <= 60 else text[:57] + '...'}'"


def _refuse_wrong(f: Field, value: Any) -> None:
    """Raise unless ``value`` is one that the field may have."""
    meta, default = f.metadata, f.default
    if meta["choices"]:
        names = [choice[0] for choice in meta["choices"]]
        if not isinstance(value, str) or value not in names:
            raise FlexMapsError(f"{meta['label']}: {quoted(value)} is not one of {', '.join(names)}")
    elif isinstance(default, str):
        if not isinstance(value, str):
            raise FlexMapsError(f"{meta['label']} {quoted(value)}: give a text")
    elif isinstance(default, bool):
        if not isinstance(value, bool):
            raise FlexMapsError(f"{meta['label']} {quoted(value)}: give on or off")
    elif not is_number(value, whole=isinstance(default, int)):
        raise FlexMapsError(f"{meta['label']} {quoted(value)}: give {wanted(f)}")
    else:
        low, high = meta["low"], meta["high"]
        if low is not None and value < low - SLACK * abs(low):
            raise FlexMapsError(f"{meta['label']} {shown(f, value)} is below its smallest value {shown(f, low)}")
        if high is not None and value > high + SLACK * abs(high):
            raise FlexMapsError(f"{meta['label']} {shown(f, value)} is above its largest value {shown(f, high)}")
