"""Centre lines of single arms as complex numbers, with derivatives with respect to all parameters of the arms."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...arrays import Complex, Float, Int
from . import arm_formulas
from .blends import ANGLE, N_BLEND_PARAMETERS, OWN_WIDTH, OWN_WIND, RADIUS, Blends, blend_joints
from .spiral import arm_widths, curve_points

# Columns of the derivatives with respect to an arm's parameters: the columns of ``blends``, then the quad's centre.
CENTRE_X, CENTRE_Y = N_BLEND_PARAMETERS, N_BLEND_PARAMETERS + 1
N_ARM_PARAMETERS = N_BLEND_PARAMETERS + 2  # number of all columns


@dataclass(frozen=True, eq=False)
class ArmCurves:
    """Shape parameters of N single arms.

    centre : centre of the quad, metres, complex
    radius, angle : length (metres) and direction (radians) from the centre to the joint
    wind : twist with the sign of the sense of rotation, radians
    width : width away from the joint, metres
    blends : blends at the joints
    """

    centre: Complex[np.ndarray, " n"]
    radius: Float[np.ndarray, " n"]
    angle: Float[np.ndarray, " n"]
    wind: Float[np.ndarray, " n"]
    width: Float[np.ndarray, " n"]
    blends: Blends

    @classmethod
    def from_arms(
        cls,
        centre: Complex[np.ndarray, " n"],
        radius: Float[np.ndarray, " n"],
        angle: Float[np.ndarray, " n"],
        both: tuple[Float[np.ndarray, "n 2"], Float[np.ndarray, "n 2"], Float[np.ndarray, "n 2"]],
        shortest: float,
    ) -> ArmCurves:
        """Make arms and their blends.

        Parameters
        ----------
        centre, radius, angle : as in the attributes of the class
        both : widths, winds and leans of the arms and of their mates, as in ``blends.blend_joints``
        shortest : length of the shortest blend, in t, for an arm that hardly turns in it
        """
        width, wind, lean = both
        return cls(
            centre, radius, angle, wind[:, 0], width[:, 0], blend_joints(width, wind, lean, radius, angle, shortest)
        )

    def evaluate(
        self, i: Int[np.ndarray, "*arms"], t: Float[np.ndarray, "*m"]
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Evaluate centre lines and half widths at t.

        Parameters
        ----------
        i : indices of arms; broadcasts with ``t``
        t : places along these arms, 0 at the tip, 1 at the quad's centre

        Returns
        -------
        points (complex, metres) with their first and second derivatives by t, then half widths (metres) with theirs
        """
        end = self.blends
        p, d1, d2 = curve_points(self.radius[i], self.angle[i], self.wind[i], end.slope[i], end.share[i], t)
        w, w1, w2 = arm_widths(self.width[i], end.width[i], end.share[i], t)
        return self.centre[i] + p, d1, d2, 0.5 * w, 0.5 * w1, 0.5 * w2

    def points(self, i: Int[np.ndarray, "*m"], t: Float[np.ndarray, "*m"]) -> Complex[np.ndarray, "*m"]:
        """Return points of the centre lines.

        Parameters
        ----------
        i : indices of arms
        t : places along these arms, 0 at the tip, 1 at the quad's centre

        Returns
        -------
        complex points, metres
        """
        end = self.blends
        pure = self.radius[i] * (1.0 - t) * arm_formulas.spiral_directions(self.angle[i], self.wind[i], t)
        return self.centre[i] + pure + end.slope[i] * blend_offset(end.share[i], t)

    def point_and_width_vjp(
        self, i: Int[np.ndarray, " m"], t: Float[np.ndarray, " m"], cotangent: Complex[np.ndarray, " m"]
    ) -> tuple[Float[np.ndarray, "m numbers"], Float[np.ndarray, "m numbers"]]:
        """Return the derivatives of points and half widths at t by the arms' parameters (vector-Jacobian products).

        Parameters
        ----------
        i : indices of M arms
        t : a place along each of these arms, 0 at the tip
        cotangent : vector with which the derivative of each point is multiplied (scalar product)

        Returns
        -------
        two arrays (M, N_ARM_PARAMETERS), for the points and for the half widths
        """
        end, share, slope = self.blends, self.blends.share[i], self.blends.slope[i]
        u = np.minimum(t / share, 1.0)
        value, change = arm_formulas.blend_quintic(u), arm_formulas.blend_quintic_slope(u)
        turn = arm_formulas.spiral_directions(self.angle[i], self.wind[i], t)
        point = np.zeros((len(i), N_ARM_PARAMETERS))

        def project(move: np.ndarray) -> np.ndarray:
            return move.real * cotangent.real + move.imag * cotangent.imag

        by_slope, by_share = (share * value), project(slope) * (value - u * change)
        point[:, :N_BLEND_PARAMETERS] = by_slope[:, None] * (
            end.slope_by[i].real * cotangent.real[:, None] + end.slope_by[i].imag * cotangent.imag[:, None]
        )
        point[:, :N_BLEND_PARAMETERS] += by_share[:, None] * end.share_by[i]
        radial = project(turn) * (1.0 - t)
        across = project(1j * turn) * (1.0 - t) * self.radius[i]
        point[:, OWN_WIND] += t * across
        point[:, RADIUS] += radial
        point[:, ANGLE] += across
        point[:, CENTRE_X], point[:, CENTRE_Y] = cotangent.real, cotangent.imag
        joint, narrows = arm_formulas.fade_out(u), -30.0 * (u * (1.0 - u)) ** 2 * -u / share
        half = np.zeros((len(i), N_ARM_PARAMETERS))
        half[:, :N_BLEND_PARAMETERS] = 0.5 * joint[:, None] * end.width_by[i]
        half[:, :N_BLEND_PARAMETERS] += (0.5 * (end.width[i] - self.width[i]) * narrows)[:, None] * end.share_by[i]
        half[:, OWN_WIDTH] += 0.5 * (1.0 - joint)
        return point, half

    def vjp(
        self,
        t: Float[np.ndarray, "n m"],
        point: Complex[np.ndarray, "n m"],
        velocity: Complex[np.ndarray, "n m"],
        half: Float[np.ndarray, "n m"],
    ) -> tuple[Float[np.ndarray, "n numbers"], Float[np.ndarray, "n m"]]:
        """Apply the chain rule (vector-Jacobian product) to a function of points, velocities and half widths at t.

        Velocities are the derivatives of the points by t.

        Parameters
        ----------
        t : (N, M) places on the N arms
        point, velocity, half : derivatives of the function by the points, by the velocities and by the half widths

        Returns
        -------
        (N, N_BLEND_PARAMETERS) derivatives by the arms' parameters without their centres, and (N, M) derivatives by t
        """
        end, rest, radius, wind = self.blends, 1.0 - t, self.radius[:, None], self.wind[:, None]
        # in a frame that turns with the spiral, derivatives along the spoke (real part) and across it (imaginary part)
        back = np.conj(arm_formulas.spiral_directions(self.angle[:, None], wind, t))
        own, pace = back * point, back * velocity
        (along, aside), (along1, aside1) = ((np.ascontiguousarray(x) for x in (y.real, y.imag)) for y in (own, pace))
        level = wind * rest
        radial = along * rest + aside1 * level - along1
        across = radius * (aside * rest - along1 * level - aside1)
        by_t = radius * (level * (aside - wind * along1) - along - 2.0 * wind * aside1)
        out = np.zeros((len(t), N_BLEND_PARAMETERS))
        out[:, RADIUS], out[:, ANGLE] = radial.sum(1), across.sum(1)
        out[:, OWN_WIND] = (t * across + radius * aside1 * rest).sum(1)
        out[:, OWN_WIDTH] = 0.5 * half.sum(1)
        # blends affect only the places within them: use only these from here on
        some = np.flatnonzero((t < end.share[:, None]).any(axis=0))
        share, slope = end.share[:, None], end.slope[:, None]
        point, velocity, half = point[:, some], velocity[:, some], half[:, some]
        u = np.minimum(t[:, some] / share, 1.0)
        value, change, again, joint = (
            arm_formulas.blend_quintic(u),
            arm_formulas.blend_quintic_slope(u),
            arm_formulas.blend_quintic_curvature(u),
            arm_formulas.fade_out(u),
        )
        by_point, by_velocity = _dot(point, slope), _dot(velocity, slope)
        narrowing = half * (-15.0 * (end.width - self.width)[:, None] / share) * (u * (1.0 - u)) ** 2
        further = by_velocity * (again / share) + narrowing
        by_t[:, some] += by_point * change + further
        by_slope = (point * (share * value) + velocity * change).sum(1)
        by_share = (by_point * (value - u * change) - further * u).sum(1)
        widened = 0.5 * (half * joint).sum(1)
        out += by_slope.real[:, None] * end.slope_by.real + by_slope.imag[:, None] * end.slope_by.imag
        out += by_share[:, None] * end.share_by + widened[:, None] * end.width_by
        out[:, OWN_WIDTH] -= widened
        return out, by_t


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the scalar products of plane vectors that are given as complex numbers."""
    return (np.conj(a) * b).real


def blend_offset(share: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Return the factor on ``Blends.slope`` that gives the offset of an arm's points due to its blend.

    Parameters
    ----------
    share : length of the blend, in t
    t : places on the arm; broadcasts with ``share``
    """
    return arm_formulas.blend_quintic(np.minimum(t / share, 1.0), share)
