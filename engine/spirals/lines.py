"""Single arms as complex numbers, for any points on any of them at once, with derivatives by everything that shapes them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays import Complex, Float, Int
from .blends import ANGLE, NUMBERS, OWN_WIDTH, OWN_WIND, RADIUS, Blends, blends
from .spiral import curve, widths

# The numbers of an arm by which there are derivatives: those of its blended end, and the centre of its quad.
CENTRE_X, CENTRE_Y = NUMBERS, NUMBERS + 1
COUNT = NUMBERS + 2  # how many these are


@dataclass(frozen=True, eq=False)
class Lines:
    """N arms one by one.

    centre : metres; radius : metres; angle, wind : radians; width : metres; end : their blended ends
    """

    centre: Complex[np.ndarray, " n"]
    radius: Float[np.ndarray, " n"]
    angle: Float[np.ndarray, " n"]
    wind: Float[np.ndarray, " n"]
    width: Float[np.ndarray, " n"]
    end: Blends

    @classmethod
    def of(
        cls,
        centre: Complex[np.ndarray, " n"],
        radius: Float[np.ndarray, " n"],
        angle: Float[np.ndarray, " n"],
        both: tuple[Float[np.ndarray, "n 2"], Float[np.ndarray, "n 2"], Float[np.ndarray, "n 2"]],
        shortest: float,
    ) -> Lines:
        """From their own and their mates' widths, winds and leans, see ``blends.blends``."""
        width, wind, lean = both
        return cls(centre, radius, angle, wind[:, 0], width[:, 0], blends(width, wind, lean, radius, angle, shortest))

    def at(
        self, i: Int[np.ndarray, "*arms"], t: Float[np.ndarray, "*m"]
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Points of the arms i at t and their first and second derivatives by t; half of the width there and its own."""
        end = self.end
        p, d1, d2 = curve(self.radius[i], self.angle[i], self.wind[i], end.slope[i], end.share[i], t)
        w, w1, w2 = widths(self.width[i], end.width[i], end.share[i], t)
        return self.centre[i] + p, d1, d2, 0.5 * w, 0.5 * w1, 0.5 * w2

    def points(self, i: Int[np.ndarray, "*m"], t: Float[np.ndarray, "*m"]) -> Complex[np.ndarray, "*m"]:
        """Points of the arms i at t."""
        end = self.end
        turn = np.exp(1j * (self.angle[i] + self.wind[i] * t))
        return self.centre[i] + self.radius[i] * (1.0 - t) * turn + end.slope[i] * bent(end.share[i], t)

    def pull(
        self, i: Int[np.ndarray, " m"], t: Float[np.ndarray, " m"], along: Complex[np.ndarray, " m"]
    ) -> tuple[Float[np.ndarray, "m numbers"], Float[np.ndarray, "m numbers"]]:
        """Derivatives of the points at t, each along a direction, and of half of the width there, by the arms' numbers."""
        end, share, slope = self.end, self.end.share[i], self.end.slope[i]
        u = np.minimum(t / share, 1.0)
        uu = u * u
        value = u * (1.0 + uu * (-6.0 + u * (8.0 - 3.0 * u)))
        change = 1.0 + uu * (-18.0 + u * (32.0 - 15.0 * u))
        turn = np.exp(1j * (self.angle[i] + self.wind[i] * t))
        point = np.zeros((len(i), COUNT))

        def seen(move: np.ndarray) -> np.ndarray:
            return move.real * along.real + move.imag * along.imag

        by_slope, by_share = (share * value), seen(slope) * (value - u * change)
        point[:, :NUMBERS] = by_slope[:, None] * (
            end.slope_by[i].real * along.real[:, None] + end.slope_by[i].imag * along.imag[:, None]
        )
        point[:, :NUMBERS] += by_share[:, None] * end.share_by[i]
        radial = seen(turn) * (1.0 - t)
        across = seen(1j * turn) * (1.0 - t) * self.radius[i]
        point[:, OWN_WIND] += t * across
        point[:, RADIUS] += radial
        point[:, ANGLE] += across
        point[:, CENTRE_X], point[:, CENTRE_Y] = along.real, along.imag
        joint = 1.0 + uu * u * (-10.0 + u * (15.0 - 6.0 * u))
        narrows = -30.0 * (u * (1.0 - u)) ** 2 * -u / share
        half = np.zeros((len(i), COUNT))
        half[:, :NUMBERS] = 0.5 * joint[:, None] * end.width_by[i]
        half[:, :NUMBERS] += (0.5 * (end.width[i] - self.width[i]) * narrows)[:, None] * end.share_by[i]
        half[:, OWN_WIDTH] += 0.5 * (1.0 - joint)
        return point, half

    def pulled(
        self,
        t: Float[np.ndarray, "n m"],
        point: Complex[np.ndarray, "n m"],
        velocity: Complex[np.ndarray, "n m"],
        half: Float[np.ndarray, "n m"],
    ) -> tuple[Float[np.ndarray, "n numbers"], Float[np.ndarray, "n m"]]:
        """Derivatives by the arms' numbers, without their centres, and by t, of what changes with all arms' points at t, seen
        from their centres, with the derivatives of these by t and with half of the width there (``at``) as told."""
        end, rest, i = self.end, 1.0 - t, np.arange(len(t))[:, None]
        share, slope = end.share[:, None], end.slope[:, None]
        _, d1, d2, _, half1, _ = self.at(i, t)
        u = np.minimum(t / share, 1.0)
        uu = u * u
        value, change = u * (1.0 + uu * (-6.0 + u * (8.0 - 3.0 * u))), 1.0 + uu * (-18.0 + u * (32.0 - 15.0 * u))
        again, joint = u * (-36.0 + u * (96.0 - 60.0 * u)) * u, 1.0 + uu * u * (-10.0 + u * (15.0 - 6.0 * u))
        # turned back by the spiral's own turn: of the points and their derivatives along its spokes
        back = np.exp(-1j * (self.angle[:, None] + self.wind[:, None] * t))
        own, pace = back * point, back * velocity
        wound = 1j * self.wind[:, None] * rest - 1.0
        radial = _seen(own, rest) + _seen(pace, wound)
        turned = self.radius[:, None] * (_seen(own, 1j * rest) + _seen(pace, 1j * wound))
        by_slope = (point * (share * value) + velocity * change).sum(1)
        by_share = (
            _seen(point, slope) * (value - u * change) - _seen(velocity, slope) * (again / share) - half * half1 * u
        )
        out = by_slope.real[:, None] * end.slope_by.real + by_slope.imag[:, None] * end.slope_by.imag
        out += by_share.sum(1)[:, None] * end.share_by + 0.5 * (half * joint).sum(1)[:, None] * end.width_by
        out[:, OWN_WIDTH] += 0.5 * (half * (1.0 - joint)).sum(1)
        out[:, RADIUS] += radial.sum(1)
        out[:, ANGLE] += turned.sum(1)
        out[:, OWN_WIND] += (t * turned + self.radius[:, None] * _seen(pace, 1j * rest)).sum(1)
        return out, _seen(point, d1) + _seen(velocity, d2) + half * half1


def _seen(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Products of vectors in the plane."""
    return (np.conj(a) * b).real


def bent(share: np.ndarray, t: np.ndarray) -> np.ndarray:
    """What a blended end of this share of an arm adds to its points at t, per slope at the joint; both broadcast (see ``spiral.curve``)."""
    u = np.minimum(t / share, 1.0)
    uu = u * u
    return share * u * (1.0 + uu * (-6.0 + u * (8.0 - 3.0 * u)))
