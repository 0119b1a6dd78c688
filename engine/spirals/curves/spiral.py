"""The shape of the four-armed spirals in real quads: centre lines, widths and edges of every arm (FlexMaps section 5).

Arm k of a quad runs from the middle of its side k (t = 0) to the quad's centre (t = 1), the mean of its corners.
Outside the blend it is an Archimedean spiral, r = R_k (1 - t), angle = A_k + t twist, with its own radius R_k and start
angle A_k. Over the blend, both arms that meet at an edge turn to a common direction and width, so that their edges
continue smoothly from one quad into the next.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ...arrays import Columns, Float, Int
from ...params import SpiralParams
from ...patches.flattening.flatten import FlatPatches
from ...surface.mesh import QuadMesh
from . import arm_formulas
from .blends import blend_joints, lean_angles

LEFT, RIGHT = 1.0, -1.0  # sides of an arm, seen from the centre outwards

Floats = float | np.ndarray


@dataclass(frozen=True, eq=False)
class Arms(Columns):
    """Shape parameters of the four arms of every quad, or of single arms (see ``one_by_one``).

    Functions that evaluate arms take t of shape (F, 4, N) in [0, 1] and return (F, 4, N, ...).

    centre : centre of every quad, metres
    radius : distance from the centre to the middle of side k, metres
    angle : direction from the centre to the middle of side k, radians, ascending within a quad
    wind : twist with the sign of the sense of rotation, radians
    width : width of every arm away from its joint, metres
    joint_width : width at the joint, metres
    blend_slope : vector that the blend adds to the derivative of the centre line by t at the joint, metres
    share : length of the blend, in t
    """

    centre: Float[np.ndarray, "quads 2"]
    radius: Float[np.ndarray, "quads arms"]
    angle: Float[np.ndarray, "quads arms"]
    wind: Float[np.ndarray, " quads"]
    width: Float[np.ndarray, "quads arms"]
    joint_width: Float[np.ndarray, "quads arms"]
    blend_slope: Float[np.ndarray, "quads arms 2"]
    share: Float[np.ndarray, "quads arms"]

    def without_blends(self, wind: Float[np.ndarray, " quads"]) -> Arms:
        """Return the arms without blends and with another signed twist ``wind``, radians."""
        return replace(
            self,
            wind=wind,
            blend_slope=np.zeros_like(self.blend_slope),
            joint_width=self.width,
        )

    def one_by_one(self, quad: Int[np.ndarray, " n"], side: Int[np.ndarray, " n"]) -> Arms:
        """Return N single arms, stored as N quads of one arm each, so that any selection can be evaluated at once.

        Parameters
        ----------
        quad, side : (N,) quad and side of every arm
        """
        of_quad = {name: getattr(self, name)[quad] for name in ("centre", "wind")}
        names = ("radius", "angle", "width", "joint_width", "blend_slope", "share")
        of_arm = {name: getattr(self, name)[quad, side][:, None] for name in names}
        return Arms(**of_quad, **of_arm)


def opposite_sides(mesh: QuadMesh) -> tuple[Int[np.ndarray, "quads 4"], Int[np.ndarray, "quads 4"]]:
    """Return, for every side, the quad across it and the side's number in that quad; at the border, the side itself."""
    own = np.arange(len(mesh.quads))[:, None]
    quads, sides = mesh.edge_quads[mesh.quad_edges], mesh.edge_sides[mesh.quad_edges]
    across = np.where(quads[..., 0] == own, 1, 0)[..., None]
    quad = np.take_along_axis(quads, across, axis=2)[..., 0]
    side = np.take_along_axis(sides, across, axis=2)[..., 0]
    border = quad < 0
    return np.where(border, own, quad), np.where(border, np.arange(4), side)


def mate_signs(mesh: QuadMesh, params: SpiralParams) -> Float[np.ndarray, "quads 4"]:
    """Return the factor on the mate's wind (signed twist) and lean at every side: -1 at a rim, else 1.

    At a rim, the mate is the arm's own mirror image, so that the arm meets the rim at right angles.

    Parameters
    ----------
    mesh : quad mesh
    params : settings with the treatment of the border
    """
    return np.where(mesh.border[mesh.quad_edges] & (params.border == "rim"), -1.0, 1.0)


def same_width(width: Float[np.ndarray, " quads"]) -> Float[np.ndarray, "quads 4"]:
    """Return the widths of all arms, (F, 4), from one width per spiral."""
    return np.repeat(np.asarray(width, dtype=float)[:, None], 4, axis=1)


def anisotropy(width: Float[np.ndarray, "quads 4"]) -> Float[np.ndarray, " quads"]:
    """Return the difference in width between both pairs of opposite arms, |w0 + w2 - w1 - w3| / (w0 + w1 + w2 + w3)."""
    return np.abs(width @ np.array([1.0, -1.0, 1.0, -1.0])) / width.sum(axis=1)


def make_arms(
    flat: FlatPatches, params: SpiralParams, width: Float[np.ndarray, "quads 4"], twist: Float[np.ndarray, " quads"]
) -> Arms:
    """Compute the arms of spirals, including blends.

    Parameters
    ----------
    flat, params : flat patches, and the sense, border and blends of the spirals
    width, twist : (F, 4) metres, (F,) radians
    """
    centre, radius, angle = spokes(flat.corners)
    wind = np.asarray(twist, dtype=float) * (-1.0 if params.clockwise else 1.0)
    width, lean = np.asarray(width, dtype=float), lean_angles(flat.corners, angle)
    quad, side = opposite_sides(flat.layout.mesh)
    every = np.broadcast_to(wind[:, None], width.shape)
    sign = mate_signs(flat.layout.mesh, params)
    widths = np.stack([width, width[quad, side]], axis=-1)
    winds, both = (np.stack([own, sign * own[quad, side]], axis=-1) for own in (every, lean))
    end = blend_joints(widths, winds, both, radius, angle, params.blend)
    return Arms(centre, radius, angle, wind, width, end.width, _to_points(end.slope), end.share)


def widest_arms(flat: FlatPatches, params: SpiralParams) -> Float[np.ndarray, " quads"]:
    """Return the largest width in metres at which straight arms leave slots with fillets in every corner of a quad.

    Parameters
    ----------
    flat, params : flat quads, and the fillet
    """
    _, radius, angle = spokes(flat.corners)
    opening = np.diff(angle, axis=1)
    # edges at distance a from straight centre lines meet at the distance a (1 + cos) / sin from the quad's centre; cos
    # and sin belong to the angle between the two lines
    reach = ((1.0 + np.abs(np.cos(opening))) / np.maximum(np.sin(opening), 1e-9)).max(axis=1)
    return 2.0 * (0.9 * radius.min(axis=1) / reach - params.fillet)


def widest_beside_slots(flat: FlatPatches, slot: float, depth: float) -> Float[np.ndarray, " quads"]:
    """Return the largest width in metres at which straight arms leave slots beside their outer part.

    Parameters
    ----------
    flat : flat patches
    slot : least width of the slots, metres
    depth : length of the slots from the tip, as a share of the arms
    """
    _, radius, angle = spokes(flat.corners)
    least = np.minimum(np.sin(np.diff(angle, axis=1)).min(axis=1), 1.0)
    return (1.0 - depth) * radius.min(axis=1) * least - slot


def spokes(
    corners: Float[np.ndarray, "quads 4 2"],
) -> tuple[Float[np.ndarray, "quads 2"], Float[np.ndarray, "quads 4"], Float[np.ndarray, "quads 4"]]:
    """Return every quad's centre, and from there the distance (metres) and direction (radians) of its sides' middles.

    The directions of a quad ascend.
    """
    centre = corners.mean(axis=1)
    spokes = 0.5 * (corners + np.roll(corners, -1, axis=1)) - centre[:, None]
    angle = np.arctan2(spokes[..., 1], spokes[..., 0])
    # the middles of the sides go round the centre once, counter-clockwise
    angle[:, 1:] = angle[:, :1] + np.cumsum(np.diff(angle, axis=1) % (2.0 * np.pi), axis=1)
    return centre, np.linalg.norm(spokes, axis=2), angle


def centre_line(arms: Arms, t: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the points of the centre lines at t and their first and second derivatives, each (F, 4, N, 2), metres.

    Parameters
    ----------
    arms : arms of F quads
    t : (F, 4, N) 0 at the joint, 1 at the centre
    """
    slope = _to_complex(arms.blend_slope)[..., None]
    numbers = arms.radius[..., None], arms.angle[..., None], arms.wind[:, None, None], slope, arms.share[..., None]
    p, d1, d2 = curve_points(*numbers, t)
    p += _to_complex(arms.centre)[:, None, None]
    return _to_points(p), _to_points(d1), _to_points(d2)


def curve_points(
    radius: np.ndarray, angle: np.ndarray, wind: np.ndarray, slope: np.ndarray, share: np.ndarray, t: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the vectors from quads' centres to centre lines at t, and their first and second derivatives, complex.

    Parameters
    ----------
    radius, angle, wind, share : as in ``Arms``
    slope : ``Arms.blend_slope`` as complex numbers
    t : 0 at the joint, 1 at the centre; all arguments broadcast
    """
    # continue arms straight beyond the centre
    if (t > 1.0).any():
        angle, wind = np.where(t > 1.0, angle + wind, angle), np.where(t > 1.0, 0.0, wind)
    p, d1, d2 = arm_formulas.spiral_points(radius, angle, wind, t)
    if slope.any():
        u = np.minimum(t / share, 1.0)
        p += slope * arm_formulas.blend_quintic(u, share)
        d1 += slope * arm_formulas.blend_quintic_slope(u)
        d2 += slope * (arm_formulas.blend_quintic_curvature(u) / share)
    return p, d1, d2


def _to_complex(pairs: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(pairs).view(np.complex128)[..., 0]


def _to_points(numbers: np.ndarray) -> np.ndarray:
    return numbers.view(np.float64).reshape(*numbers.shape, 2)


def width_at(arms: Arms, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the width of the arms at t and its derivative by t, each (F, 4, N), metres.

    Parameters
    ----------
    arms : arms of all quads
    t : (F, 4, N) places along the arms, 0 at the tip, 1 at the centre
    """
    return arm_widths(arms.width[..., None], arms.joint_width[..., None], arms.share[..., None], t)[:2]


def arm_widths(
    width: np.ndarray, joint: np.ndarray, share: np.ndarray, t: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the widths of arms at t and their first and second derivatives by t, metres.

    Parameters
    ----------
    width, joint : widths away from the joint and at the joint, metres
    share : length of the blend, in t
    t : 0 at the joint, 1 at the centre; all arguments broadcast
    """
    u = np.minimum(t / share, 1.0)
    change, bend = joint - width, -60.0 * (u * (1.0 - u)) * (1.0 - 2.0 * u)
    return (
        width + change * arm_formulas.fade_out(u),
        change * (arm_formulas.fade_out_slope(u) / share),
        change * (bend / share**2),
    )


def taper_width(extra: Floats, taper_start: Floats, taper_end: Floats, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the additional width of a tip at t and its derivative by t, smooth to the second derivative.

    Parameters
    ----------
    extra : additional width at the tip, metres
    taper_start, taper_end : t up to which the additional width has its full value, and t from which it is 0
    t : 0 at the joint, 1 at the centre; all arguments broadcast
    """
    span = np.maximum(np.asarray(taper_end) - taper_start, 1e-9)
    u = np.clip((t - taper_start) / span, 0.0, 1.0)
    rest = u * (1.0 - u)
    return extra * arm_formulas.fade_out(u), -30.0 * extra * rest * rest / span


def edge_points(
    arms: Arms,
    t: np.ndarray,
    side: float | np.ndarray,
    offset: Floats = 0.0,
    added_width: tuple[np.ndarray, np.ndarray] | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Return points on an edge of the arms at t and their derivatives by t (inwards), each (F, 4, N, 2), metres.

    Parameters
    ----------
    arms : arms of F quads
    t : (F, 4, N) 0 at the joint, 1 at the centre
    side : LEFT, RIGHT, or an array of these that broadcasts with t; additional leading axes remain in the result
    offset : distance of the points outwards from the edge, metres, such as the radius of a cutter or fillet
    added_width : additional width of the arms (metres), and its derivative by t
    """
    p, d1, d2 = centre_line(arms, t)
    width, slope = width_at(arms, t)
    if added_width is not None:
        width, slope = width + added_width[0], slope + added_width[1]
    side = np.asarray(side, dtype=float)
    speed = np.hypot(d1[..., 0], d1[..., 1])
    normal: np.ndarray = np.empty((*np.broadcast_shapes(side.shape, speed.shape), 2))
    normal[..., 0], normal[..., 1] = side * d1[..., 1] / speed, -side * d1[..., 0] / speed
    curvature = side * _cross(d1, d2) / speed**3
    point = p + normal * (0.5 * width)[..., None]
    tangent = d1 * (1.0 + 0.5 * width * curvature)[..., None] + normal * (0.5 * slope)[..., None]
    if np.any(offset):
        length = np.hypot(tangent[..., 0], tangent[..., 1])
        point[..., 0] += offset * side * tangent[..., 1] / length
        point[..., 1] -= offset * side * tangent[..., 0] / length
        tangent = tangent + d1 * (offset * curvature)[..., None]
    return point, tangent


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
