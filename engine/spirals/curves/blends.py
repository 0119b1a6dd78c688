"""Blends: near a joint, both of its arms turn to a common direction and width, in closed form.

In the complex plane an arm's centre line leaves its joint with the slope -R e^(iA) (1 - i phi), where R is its radius,
A the angle of its spoke (the line from the quad's centre to the joint) and phi its signed twist (wind). In the frame of
the shared edge, with the outward normal as the real axis, its outward tangent per unit of radius is
z = (1 - i phi) e^(i beta), where beta, the lean, is the angle from the outward normal to the spoke. Both arms turn to
the direction c of the sum of their two z, each in the frame of its own side. So the direction of a joint depends on the
mean of both twists, and a strongly wound arm hardly bends. To turn an arm to c, the blend adds to the slope of its
centre line

    slope = R e^(iA) ((1 - i phi) - |1 - i phi| e^(-i beta) c).

All results are twice continuously differentiable with respect to all parameters of both arms. The mate of an arm is the
arm across its joint.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...arrays import Complex, Float

# Columns of the derivatives with respect to a joint's parameters. The mate's radius does not affect an arm's blend.
OWN_WIDTH, MATE_WIDTH, OWN_WIND, MATE_WIND, RADIUS, ANGLE, OWN_LEAN, MATE_LEAN = range(8)
N_BLEND_PARAMETERS = 8  # number of columns above

# sine of the smallest angle between an arm and the edge that it crosses; larger values bend strongly wound arms more
_CROSSING_MIN = 0.1
# half width, as a sine, of the smooth transition to ``_CROSSING_MIN``; larger is smoother and bends more arms
_CROSSING_SOFT = 0.05
# Least radius of curvature of a blend's inner edge, as a share of the centre line's radius of curvature, from the turn
# of the blend alone; larger values lengthen blends. With the arm's own curvature, 99 of 100 random arms stay above
# 0.43.
_INNER_RADIUS = 0.7
_BLEND_MAX = 0.7  # longest blend, as a share of the arm; larger values leave less of the arm a pure spiral
# half width of the smooth transition from the shortest blend to longer blends, as a share of the shortest length;
# larger is smoother and lengthens more blends
_BLEND_SOFT = 0.3
# half width of the smooth transition to the longest blend, as a share of the arm; larger is smoother and shortens more
# blends
_TOP_SOFT = 0.1
# largest curvature of the blending quintic, times 1 - h, per square root of h, where h is the squared sine of half the
# turning angle: 7.88 for small angles, 7.6 for a right angle
_BEND = 7.88


@dataclass(frozen=True, eq=False)
class Blends:
    """Blends of N arms, with derivatives.

    slope : vector added to the derivative of the centre line with respect to t at the joint, metres, complex
    width : width at the joint, metres
    share : length of the blend, in t (0 at the joint, 1 at the quad's centre)
    slope_by, width_by, share_by : derivatives with respect to the joint's parameters (columns ``OWN_WIDTH`` and on)
    """

    slope: Complex[np.ndarray, "*n"]
    width: Float[np.ndarray, "*n"]
    share: Float[np.ndarray, "*n"]
    slope_by: Complex[np.ndarray, "*n numbers"]
    width_by: Float[np.ndarray, "*n numbers"]
    share_by: Float[np.ndarray, "*n numbers"]


def lean_angles(
    corners: Float[np.ndarray, "quads 4 2"], angle: Float[np.ndarray, "quads 4"]
) -> Float[np.ndarray, "quads 4"]:
    """Return the angles from the outward normals of the sides to the spokes.

    Parameters
    ----------
    corners : flat quads, metres
    angle : directions of the spokes, radians

    Returns
    -------
    (F, 4) radians
    """
    along = np.roll(corners, -1, axis=1) - corners
    return np.angle(np.exp(1j * angle) / (along[..., 1] - 1j * along[..., 0]))


def blend_joints(
    width: Float[np.ndarray, "*n 2"],
    wind: Float[np.ndarray, "*n 2"],
    lean: Float[np.ndarray, "*n 2"],
    radius: Float[np.ndarray, "*n"],
    angle: Float[np.ndarray, "*n"],
    shortest: float,
) -> Blends:
    """Compute the blends of arms from the parameters of the arms and of their mates.

    Parameters
    ----------
    width : metres, of the arm and of its mate (last axis); an arm at the border is its own mate
    wind : radians, twist with the sign of the sense of rotation, of the arm and of its mate
    lean : radians, see ``lean_angles``, of the arm and of its mate
    radius : metres, from the quad's centre to the joint
    angle : radians, direction of the spoke
    shortest : length of the shortest blend, in t, for an arm that hardly turns in it
    """
    pure = 1.0 - 1j * wind
    length = np.abs(pure)
    turned = np.exp(1j * lean)
    both = pure * turned
    total, scale = both.sum(-1), length.sum(-1)
    # total_by, scale_by, mean_by, ...: derivatives by both winds and both leans, (..., 4)
    total_by = np.concatenate([-1j * turned, 1j * both], axis=-1)
    length_by = wind / length
    scale_by = np.concatenate([length_by, np.zeros_like(length_by)], axis=-1)
    # keep the common direction away from the direction of the shared edge
    mean = total / scale
    mean_by = (total_by - mean[..., None] * scale_by) / scale[..., None]
    over, slope = smooth_positive(mean.real - _CROSSING_MIN, _CROSSING_SOFT)
    steep = _CROSSING_MIN + over + 1j * mean.imag
    steep_by = slope[..., None] * mean_by.real + 1j * mean_by.imag
    size = np.abs(steep)
    common = steep / size
    common_by = 1j * common[..., None] * ((steep_by * np.conj(common)[..., None]).imag / size[..., None])
    # slope that turns the arm to the common direction, per unit of radius
    back = length[..., 0] / turned[..., 0]
    turn = pure[..., 0] - back * common
    turn_by = -back[..., None] * common_by
    turn_by[..., 0] -= 1j + length_by[..., 0] / turned[..., 0] * common
    turn_by[..., 2] += 1j * back * common
    spoke = radius * np.exp(1j * angle)
    by = np.zeros((*radius.shape, N_BLEND_PARAMETERS), dtype=complex)
    by[..., [OWN_WIND, MATE_WIND, OWN_LEAN, MATE_LEAN]] = spoke[..., None] * turn_by
    by[..., RADIUS], by[..., ANGLE] = spoke * turn / radius, 1j * spoke * turn
    joint = 0.5 * width.sum(-1)
    joint_by = np.zeros((*radius.shape, N_BLEND_PARAMETERS))
    joint_by[..., [OWN_WIDTH, MATE_WIDTH]] = 0.5
    share, share_by = _blend_shares(turn, turn_by, length[..., 0], length_by[..., 0], joint, radius, shortest)
    return Blends(spoke * turn, joint, share, by, joint_by, share_by)


def _blend_shares(
    turn: np.ndarray, turn_by: np.ndarray, length: np.ndarray, length_by: np.ndarray, joint: np.ndarray,
    radius: np.ndarray, shortest: float,
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Return the lengths of the blends, in t, that keep their inner edges round, and the lengths' derivatives."""
    # h: squared sine of half the angle by which the blend turns the arm
    h = 0.25 * np.abs(turn) ** 2 / length**2
    h_by = 0.5 * (turn_by * np.conj(turn)[..., None]).real / (length**2)[..., None]
    h_by[..., 0] -= 2.0 * h * length_by / length
    rest = np.maximum(1.0 - h, 1e-6)
    root = np.sqrt(np.maximum(h, 1e-12))
    scale = _BEND * 0.5 / (1.0 - _INNER_RADIUS) * joint / (radius * length)
    need = scale * root / rest
    over, slope = smooth_positive(need - shortest, _BLEND_SOFT * shortest)
    below, cut = smooth_positive(_BLEND_MAX - shortest - over, _TOP_SOFT)
    change = slope * cut
    by = np.zeros((*radius.shape, N_BLEND_PARAMETERS))
    by_h = change * need * (0.5 / np.maximum(h, 1e-12) + 1.0 / rest)
    by[..., [OWN_WIND, MATE_WIND, OWN_LEAN, MATE_LEAN]] = by_h[..., None] * h_by
    by[..., OWN_WIND] -= change * need * length_by / length
    by[..., [OWN_WIDTH, MATE_WIDTH]] = (0.5 * change * need / joint)[..., None]
    by[..., RADIUS] = -change * need / radius
    return _BLEND_MAX - below, by


def smooth_positive(x: np.ndarray, half: float) -> tuple[np.ndarray, np.ndarray]:
    """Return max(x, 0), smoothed to the second derivative, and its derivative.

    Parameters
    ----------
    x : any shape
    half : half width of the smooth transition around 0
    """
    s = np.clip(0.5 * (x / half + 1.0), 0.0, 1.0)
    return 2.0 * half * s**3 * (1.0 - 0.5 * s) + np.maximum(x - half, 0.0), s * s * (3.0 - 2.0 * s)
