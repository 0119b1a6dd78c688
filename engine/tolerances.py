"""Tolerances for the whole program: smaller differences are rounding errors and count as equal."""

from __future__ import annotations

# Relative to the size, for numbers in single precision, as Blender stores them; shorter edges count as degenerate, and
# smaller turns (radians) as straight
SINGLE_TOL = 1e-6
# Relative to the size, or metres, for numbers computed in double precision
DOUBLE_TOL = 1e-9
