"""The blended ends of the arms: how both arms of a joint turn to one direction and one width, in closed form.

In the complex plane an arm's centre line leaves its joint with the slope -R e^(iA) (1 - i phi), where R is its radius, A
the angle of its middle spoke and phi its signed winding. Seen from the shared edge, with the outward normal as the real
axis, its outward tangent per unit of radius is z = (1 - i phi) e^(i beta), where beta is the angle from the outward
normal to the spoke. The common direction c of both arms is that of z + z of the mate, each in the frame of its own side:
so the mean of the twists counts, and the strongly wound arm is hardly bent. What turns the arm to it is

    slope = R e^(iA) ((1 - i phi) - |1 - i phi| e^(-i beta) c).

Everything is twice continuously differentiable by every number of both arms.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays import Complex, Float

# The numbers of a joint by which there are derivatives, in this order. A mate's radius has no part in an arm's end.
OWN_WIDTH, MATE_WIDTH, OWN_WIND, MATE_WIND, RADIUS, ANGLE, OWN_LEAN, MATE_LEAN = range(8)
NUMBERS = 8  # how many these are

# the steepest that an arm may lean along the edge that it crosses: sine of the smallest angle between the two
_CROSSING_MIN = 0.1
# over which the crossing passes from free to steepest: 0.1 + this, 0.15, is a twist of 6.6 between alike squares
_CROSSING_SOFT = 0.05
# What the blend alone leaves of the radius of curvature of an arm's inner edge, as a share of that of its centre line. With
# the arm's own curvature, 0.6 is left in 9 of 10 random arms of 19 surfaces, and 0.43 in 99 of 100, as with blends that
# were lengthened step by step.
_INNER_RADIUS = 0.7
_BLEND_MAX = 0.7  # largest share of an arm over which it is blended: the rest stays a spiral
_BLEND_SOFT = 0.3  # share of the shortest blend round which it becomes longer
_TOP_SOFT = 0.1  # below and above the largest share over which a longer blend comes to its end
# Largest curvature of the blending quintic, times 1 - h, per square root of h, the squared sine of half of the angle that
# it turns by. 7.88 for small angles, 7.6 for a right one.
_BEND = 7.88


@dataclass(frozen=True, eq=False)
class Blends:
    """The blended ends of N arms.

    slope : metres, what the blend adds to the derivative of the centre line by t at the joint, as complex numbers
    width : metres, of the joint
    share : of t, over which arm and joint are blended
    slope_by, width_by, share_by : their derivatives by the numbers above
    """

    slope: Complex[np.ndarray, "*n"]
    width: Float[np.ndarray, "*n"]
    share: Float[np.ndarray, "*n"]
    slope_by: Complex[np.ndarray, "*n numbers"]
    width_by: Float[np.ndarray, "*n numbers"]
    share_by: Float[np.ndarray, "*n numbers"]


def leans(corners: Float[np.ndarray, "quads 4 2"], angle: Float[np.ndarray, "quads 4"]) -> Float[np.ndarray, "quads 4"]:
    """Radians from the outward normals of the sides to the spokes, whose directions are ``angle``."""
    along = np.roll(corners, -1, axis=1) - corners
    return np.angle(np.exp(1j * angle) / (along[..., 1] - 1j * along[..., 0]))


def blends(
    width: Float[np.ndarray, "*n 2"],
    wind: Float[np.ndarray, "*n 2"],
    lean: Float[np.ndarray, "*n 2"],
    radius: Float[np.ndarray, "*n"],
    angle: Float[np.ndarray, "*n"],
    shortest: float,
) -> Blends:
    """The blended ends of arms, from numbers of their own and of their mates (last axis), with derivatives.

    width : metres; wind : radians, twist with the sign of the sense of rotation; lean : radians, see ``leans``;
    radius : metres; angle : radians; shortest : share of t over which an arm is blended that hardly turns.
    An arm at the border is its own mate.
    """
    pure = 1.0 - 1j * wind
    length = np.abs(pure)
    turned = np.exp(1j * lean)
    both = pure * turned
    total, scale = both.sum(-1), length.sum(-1)
    # derivatives by both winds and both leans, (..., 4)
    total_by = np.concatenate([-1j * turned, 1j * both], axis=-1)
    length_by = wind / length
    scale_by = np.concatenate([length_by, np.zeros_like(length_by)], axis=-1)
    # the common direction crosses the edge
    seen = total / scale
    seen_by = (total_by - seen[..., None] * scale_by) / scale[..., None]
    over, slope = ramp(seen.real - _CROSSING_MIN, _CROSSING_SOFT)
    steep = _CROSSING_MIN + over + 1j * seen.imag
    steep_by = slope[..., None] * seen_by.real + 1j * seen_by.imag
    size = np.abs(steep)
    common = steep / size
    common_by = 1j * common[..., None] * ((steep_by * np.conj(common)[..., None]).imag / size[..., None])
    # what turns the own arm to it, per unit of radius
    back = length[..., 0] / turned[..., 0]
    turn = pure[..., 0] - back * common
    turn_by = -back[..., None] * common_by
    turn_by[..., 0] -= 1j + length_by[..., 0] / turned[..., 0] * common
    turn_by[..., 2] += 1j * back * common
    spoke = radius * np.exp(1j * angle)
    by = np.zeros((*radius.shape, NUMBERS), dtype=complex)
    by[..., [OWN_WIND, MATE_WIND, OWN_LEAN, MATE_LEAN]] = spoke[..., None] * turn_by
    by[..., RADIUS], by[..., ANGLE] = spoke * turn / radius, 1j * spoke * turn
    joint = 0.5 * width.sum(-1)
    joint_by = np.zeros((*radius.shape, NUMBERS))
    joint_by[..., [OWN_WIDTH, MATE_WIDTH]] = 0.5
    share, share_by = _shares(turn, turn_by, length[..., 0], length_by[..., 0], joint, radius, shortest)
    return Blends(spoke * turn, joint, share, by, joint_by, share_by)


def _shares(
    turn: np.ndarray, turn_by: np.ndarray, length: np.ndarray, length_by: np.ndarray, joint: np.ndarray,
    radius: np.ndarray, shortest: float,
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Over which share of t the inner edge keeps its radius while the arm turns, and its derivatives."""
    h = 0.25 * np.abs(turn) ** 2 / length**2
    h_by = 0.5 * (turn_by * np.conj(turn)[..., None]).real / (length**2)[..., None]
    h_by[..., 0] -= 2.0 * h * length_by / length
    rest = np.maximum(1.0 - h, 1e-6)
    root = np.sqrt(np.maximum(h, 1e-12))
    scale = _BEND * 0.5 / (1.0 - _INNER_RADIUS) * joint / (radius * length)
    need = scale * root / rest
    over, slope = ramp(need - shortest, _BLEND_SOFT * shortest)
    below, cut = ramp(_BLEND_MAX - shortest - over, _TOP_SOFT)
    change = slope * cut
    by = np.zeros((*radius.shape, NUMBERS))
    by_h = change * need * (0.5 / np.maximum(h, 1e-12) + 1.0 / rest)
    by[..., [OWN_WIND, MATE_WIND, OWN_LEAN, MATE_LEAN]] = by_h[..., None] * h_by
    by[..., OWN_WIND] -= change * need * length_by / length
    by[..., [OWN_WIDTH, MATE_WIDTH]] = (0.5 * change * need / joint)[..., None]
    by[..., RADIUS] = -change * need / radius
    return _BLEND_MAX - below, by


def ramp(x: np.ndarray, half: float) -> tuple[np.ndarray, np.ndarray]:
    """The larger of x and 0, smooth to the second derivative within ``half`` of 0; and its derivative."""
    s = np.clip(0.5 * (x / half + 1.0), 0.0, 1.0)
    return 2.0 * half * s**3 * (1.0 - 0.5 * s) + np.maximum(x - half, 0.0), s * s * (3.0 - 2.0 * s)
