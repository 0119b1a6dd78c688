"""Format numbers in texts for users."""

from __future__ import annotations


def format_figure(number: float) -> str:
    """Format millimetres or percent with two digits; return "0" below 0.01, which no machine can cut."""
    if abs(number) < 0.01:
        return "0"
    return f"{number:.2g}" if abs(number) < 99.5 else f"{number:.0f}"
