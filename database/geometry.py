"""The outline of one spiral in the plane: centre lines, edges, crotches with their fillets (FlexMaps section 5).

Lengths are in arm widths. Points of the plane are complex numbers, arms are numbered counter-clockwise, arm k is arm 0
turned by k quarter turns. An arm is run through outwards by u in [0, 1], from the centre to the tip.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..engine.errors import FlexMapsError

QUARTER = 1j
HALF_WIDTH = 0.5  # of an arm, in arm widths


@dataclass(frozen=True)
class Spiral:
    """One spiral, dimensionless.

    scale : s / w, diameter of the circumscribed circle over the width of an arm
    height : h / w, thickness of the sheet over the width of an arm
    twist : radians, winding angle phi from the centre to the tip
    fillet : radius of the inside corners at the hub over the width of an arm
    """

    scale: float
    height: float
    twist: float
    fillet: float = 0.04

    def __post_init__(self) -> None:
        for name in ("scale", "height", "fillet"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0):
                raise FlexMapsError(f"A spiral's {name} (in arm widths) is {value}; it must be a positive number")
        if not (math.isfinite(self.twist) and self.twist >= 0):
            raise FlexMapsError(f"A spiral's twist is {self.twist}; it must be a number of radians from 0 on")

    @property
    def radius(self) -> float:
        return 0.5 * self.scale

    @property
    def tip_gap(self) -> float:
        """Width of the slot between two arms at their tips, in arm widths; below zero they overlap."""
        return 0.25 * math.pi * self.scale / math.hypot(1.0, self.twist) - 1.0


def centre_line(spiral: Spiral, u: np.ndarray | float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Point, unit tangent (outwards) and speed |dc/du| of arm 0 at u.

    c(u) = (s/2) u exp(i phi (1 - u)): the curve of FlexMaps section 5 with t = 1 - u.
    """
    u = np.asarray(u, dtype=float)
    turn = np.exp(1j * spiral.twist * (1.0 - u))
    velocity = spiral.radius * turn * (1.0 - 1j * spiral.twist * u)
    speed = np.abs(velocity)
    return spiral.radius * u * turn, velocity / speed, speed


def edge(spiral: Spiral, u: np.ndarray | float, offset: float) -> np.ndarray:
    """Points beside the centre line of arm 0, ``offset`` to the left of the outward direction."""
    point, tangent, _ = centre_line(spiral, u)
    return point + offset * 1j * tangent


def _edge_velocity(spiral: Spiral, u: float, offset: float) -> complex:
    """d/du of ``edge``: speed (1 - offset * curvature) along the tangent."""
    phi = spiral.twist
    _, tangent, speed = centre_line(spiral, u)
    curvature = -phi * (2.0 + (phi * u) ** 2) / (spiral.radius * (1.0 + (phi * u) ** 2) ** 1.5)
    return complex(tangent * speed * (1.0 - offset * curvature))


def meeting(spiral: Spiral, offset: float) -> tuple[float, float]:
    """u on arm 0 and on arm 1 where arm 0's left parallel and arm 1's right parallel, ``offset`` away, meet.

    Newton's method, continued in the twist from the straight cross where both are offset / radius. Raises
    FlexMapsError where the arms never part so far: such a spiral cannot be cut.
    """
    a = b = offset / spiral.radius
    steps = max(1, math.ceil(spiral.twist / 0.04))
    for k in range(1, steps + 1):
        now = Spiral(spiral.scale, spiral.height, spiral.twist * k / steps, spiral.fillet)
        for _ in range(30):
            gap = complex(edge(now, a, offset) - QUARTER * edge(now, b, -offset))
            va, vb = _edge_velocity(now, a, offset), -QUARTER * _edge_velocity(now, b, -offset)
            det = va.real * vb.imag - va.imag * vb.real
            if det == 0.0:
                break
            da = -(gap.real * vb.imag - gap.imag * vb.real) / det
            db = -(va.real * gap.imag - va.imag * gap.real) / det
            limit = min(1.0, 0.2 / max(abs(da), abs(db), 1e-300))
            a, b = a + limit * da, b + limit * db
            if abs(da) + abs(db) < 1e-14:
                break
        if abs(gap) > 1e-9 or not (0.0 < a < 1.0 and 0.0 < b < 1.0):
            raise FlexMapsError(
                f"A spiral with s/w = {spiral.scale:.3g} and twist {math.degrees(spiral.twist):.0f} degrees cannot be "
                "cut: its arms run into each other; use less twist or a smaller width"
            )
    return a, b


def check(spiral: Spiral) -> None:
    """Raise FlexMapsError unless the spiral can be cut: arms part, and the slot is wide enough for the fillet."""
    if spiral.tip_gap <= 2.0 * spiral.fillet:
        raise FlexMapsError(
            f"A spiral with s/w = {spiral.scale:.3g} and twist {math.degrees(spiral.twist):.0f} degrees leaves a slot of "
            f"{spiral.tip_gap:.3g} arm widths, but its fillets need {2 * spiral.fillet:.3g}; use less twist or a smaller width"
        )


@dataclass(frozen=True, eq=False)
class Outline:
    """The fillet between arm 0 and arm 1, and where both arms' edges leave it.

    left, right : u on arm 0's left edge and on arm 1's right edge where the fillet touches
    centre : centre of the fillet's arc
    corner : the middle of the arc, a corner of the hub
    """

    spiral: Spiral
    left: float
    right: float
    centre: complex
    corner: complex

    def left_arc(self, t: np.ndarray) -> np.ndarray:
        """Points of the half arc from the hub's corner (t = 0) to arm 0's left edge (t = 1)."""
        return self._arc(complex(edge(self.spiral, self.left, HALF_WIDTH)), t)

    def right_arc(self, t: np.ndarray) -> np.ndarray:
        """Points of the half arc from the hub's corner (t = 0) to arm 1's right edge (t = 1)."""
        return self._arc(complex(QUARTER * edge(self.spiral, self.right, -HALF_WIDTH)), t)

    def _arc(self, end: complex, t: np.ndarray) -> np.ndarray:
        start = self.corner - self.centre
        angle = np.angle((end - self.centre) / start)
        return self.centre + start * np.exp(1j * angle * np.asarray(t))


def outline(spiral: Spiral) -> Outline:
    """The outline of a spiral at its crotches; raises FlexMapsError where the spiral cannot be cut."""
    check(spiral)
    offset = HALF_WIDTH + spiral.fillet
    left, right = meeting(spiral, offset)
    centre = complex(edge(spiral, left, offset))
    a = complex(edge(spiral, left, HALF_WIDTH)) - centre
    b = complex(QUARTER * edge(spiral, right, -HALF_WIDTH)) - centre
    middle = a / abs(a) + b / abs(b)
    # the hub lies between the two contact points, away from the slot: towards the spiral's centre
    if abs(middle) < 1e-12:
        raise FlexMapsError("A spiral's fillet cannot be placed: its arms are parallel at the hub; use less twist")
    return Outline(spiral, left, right, centre, centre + spiral.fillet * middle / abs(middle))
