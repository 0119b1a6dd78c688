"""Declaration of settings (default, bounds, unit, help text), and the checks that refuse wrong values.

The engine works in SI units; ``unit`` is the unit of a field's value ("m", "rad", "Pa", or "" for a dimensionless
number). User interfaces show millimetres, degrees and gigapascals; ``SHOWN`` holds the conversion factors and symbols.
"""

from __future__ import annotations

import math
from dataclasses import Field, field, fields
from numbers import Integral, Real
from typing import Any, ClassVar

from ..errors import FlexMapsError
from ..tolerances import SINGLE_TOL

# for each SI unit: factor from the SI value to the shown value, and symbol of the shown unit
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
    """Declare a dataclass field with the metadata that user interfaces need.

    Parameters
    ----------
    default : default value in SI units; its type is the type of the setting
    label, help : texts for users, which are translated
    low, high : bounds in SI units; None for no bound
    unit : key of ``SHOWN``
    choices : (identifier, label, help) of every value of a string setting
    folder : whether a string setting names a folder
    """
    meta = {"label": label, "help": help, "low": low, "high": high, "unit": unit, "choices": choices, "folder": folder}
    return field(default=default, metadata=meta)


MAX_VALUE = 1e300  # largest magnitude of any setting, which also refuses infinity and NaN


def describe_numbers(f: Field) -> str:
    """Describe the numbers that a field accepts, e.g. "a whole number from 0 to 50"."""
    whole = isinstance(f.default, int)
    kind, tell = ("a whole number", str) if whole else ("a number", lambda bound: format_value(f, bound))
    low, high = (None if f.metadata[k] is None else tell(f.metadata[k]) for k in ("low", "high"))
    if low is not None and high is not None:
        return f"{kind} from {low} to {high}"
    return kind if low is None else f"{kind} from {low} on"


def format_value(f: Field, value: float) -> str:
    """Return the text of a value of a setting in the unit shown to users, e.g. "2 mm".

    Parameters
    ----------
    f : field of the setting
    value : value in SI units
    """
    factor, symbol = SHOWN[f.metadata["unit"]]
    return f"{value * factor:g}{' ' if symbol.isalpha() else ''}{symbol}"


class Params:
    """Base class of sections of settings; raises FlexMapsError for wrong types, bounds exceeded, or a wrong order."""

    # pairs of settings of this section; the first must not be larger than the second
    ORDERED: ClassVar[tuple[tuple[str, str], ...]] = ()
    # on/off settings of earlier versions, on by default: by name, the values that the present settings get for "off"
    WERE: ClassVar[dict[str, dict[str, Any]]] = {}
    GONE: ClassVar[tuple[str, ...]] = ()  # settings of earlier versions, whose values are accepted and ignored

    def __post_init__(self) -> None:
        known = {f.name: f for f in fields(self)}  # type: ignore[arg-type]
        for f in known.values():
            _check_value(f, getattr(self, f.name))
        for name, other in self.ORDERED:
            refuse_if_above(self, name, self, other, "exchange them, or change one of them")


def refuse_if_above(block: Params, name: str, other: Params, limit: str, remedy: str) -> None:
    """Raise FlexMapsError if one setting is larger than another.

    Parameters
    ----------
    block, name : section and name of the setting that must not be larger
    other, limit : section and name of the other setting
    remedy : end of the message: what the user should do
    """
    value, most = getattr(block, name), getattr(other, limit)
    if value > most + SINGLE_TOL * abs(most):
        low, high = (next(f for f in fields(b) if f.name == n) for b, n in ((block, name), (other, limit)))  # type: ignore[arg-type]
        raise FlexMapsError(
            f"{low.metadata['label']} {format_value(low, value)} is above {high.metadata['label']} {format_value(high, most)}; {remedy}"
        )


def is_number(value: Any, *, whole: bool = False) -> bool:
    """Return whether a value is a finite number, and if ``whole``, a whole number; booleans are not numbers."""
    return isinstance(value, Integral if whole else Real) and not isinstance(value, bool) and abs(value) <= MAX_VALUE  # type: ignore[operator]


def quote(value: Any) -> str:
    """Quote a value for a message: in single quotes, on one line, shortened to 60 characters."""
    try:
        text = value if isinstance(value, str) else repr(value)
    except ValueError:  # Python refuses to print integers of thousands of digits
        text = "a very large number"
    text = " ".join(text.split())
    return f"'{text if len(text) <= 60 else text[:57] + '...'}'"


def _check_value(f: Field, value: Any) -> None:
    """Raise FlexMapsError if a field cannot have this value."""
    meta, default = f.metadata, f.default
    if meta["choices"]:
        names = [choice[0] for choice in meta["choices"]]
        if not isinstance(value, str) or value not in names:
            raise FlexMapsError(f"{meta['label']}: {quote(value)} is not one of {', '.join(names)}")
    elif isinstance(default, str):
        if not isinstance(value, str):
            raise FlexMapsError(f"{meta['label']} {quote(value)}: give a text")
    elif isinstance(default, bool):
        if not isinstance(value, bool):
            raise FlexMapsError(f"{meta['label']} {quote(value)}: give on or off")
    elif not is_number(value, whole=isinstance(default, int)):
        raise FlexMapsError(f"{meta['label']} {quote(value)}: give {describe_numbers(f)}")
    else:
        low, high = meta["low"], meta["high"]
        if low is not None and value < low - SINGLE_TOL * abs(low):
            raise FlexMapsError(
                f"{meta['label']} {format_value(f, value)} is below its smallest value {format_value(f, low)}"
            )
        if high is not None and value > high + SINGLE_TOL * abs(high):
            raise FlexMapsError(
                f"{meta['label']} {format_value(f, value)} is above its largest value {format_value(f, high)}"
            )
