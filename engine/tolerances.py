"""Tolerances for the whole program: smaller differences are rounding errors and count as equal."""

from __future__ import annotations

# Tolerance of lengths in single precision, as Blender stores them, as a share of the size of the object: shorter edges
# count as degenerate. Also of angles in radians: a smaller turn counts as straight
SINGLE_TOL = 1e-6
# Tolerance of lengths computed in double precision, as a share of the size of the object, or in metres
DOUBLE_TOL = 1e-9
