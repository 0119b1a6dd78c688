"""Format numbers in texts for users."""

from __future__ import annotations

from decimal import Decimal


def format_figure(number: float) -> str:
    """Format millimetres or percent with two digits; return "0" below 0.01, which no machine can cut."""
    if abs(number) < 0.01:
        return "0"
    return f"{number:.2g}" if abs(number) < 99.5 else f"{number:.0f}"


def format_length(metres: float) -> str:
    """Format a length with three digits and its unit, mm below 1 m: "21.8 mm", "303 m"; never as a power of ten."""
    number, unit = (1e3 * metres, "mm") if metres < 1.0 else (metres, "m")
    return f"{Decimal(f'{number:.3g}'):f} {unit}"
