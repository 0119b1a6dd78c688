"""Two tolerances for all rooms: differences that rounding explains are none."""

from __future__ import annotations

# share of the size: numbers stored in single precision, as by Blender; shorter edges have no length, smaller turns (radians) are straight
SINGLE_TOL = 1e-6
DOUBLE_TOL = 1e-9  # share of the size, or metres: numbers computed in double precision in several steps
