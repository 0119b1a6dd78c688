"""Feet: at a supported spiral a straight strip runs from the hub down to the ground and ends in a tongue for a slot.

A foot replaces the arm at the open border. It runs down the direction of steepest descent in the plane of its hub, so
the direction across it is level: its shoulders rest on the ground with their whole edge, and the slot for its tongue is
a rectangle. Wound arms would cross the straight strip, so supported spirals have no twist.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ...arrays import Bool, Float, Int
from ...errors import FlexMapsError
from ...mechanics.assembly import Pose
from ...params import BaseParams
from ...spirals.caps import Cap, make_caps, stump_starts
from ...spirals.clearance.slots import min_slot_width
from ...spirals.curves.arcs import Curve, interpolate_biarcs
from ...spirals.curves.spiral import LEFT, RIGHT, edge_points
from ...spirals.design import SpiralDesign
from ...surface.checking.finding import with_count
from ...surface.mesh import QuadMesh
from .corners import CORNER_RADIUS, round_corners

# Minimum slope in radians of a hub at a foot; larger refuses more supports. Flatter feet would lie on the base rather
# than stand, and need slots wider than three thicknesses
MIN_SLOPE = np.radians(25.0)
# Maximum angle in radians between a foot and the direction from the hub to the middle of the side through which the
# foot leaves its quad. Larger accepts more supports. The limit must exceed 45 degrees, so that a quad at a corner of
# the border, two sides of which are open, can have a foot that points at the corner
MAX_SIDEWAYS_ANGLE = np.radians(60.0)
# maximum twist in radians of a spiral that counts as straight; larger permits arms that come nearer to feet
MAX_STRAIGHT_TWIST = 0.02
# width of the tongue as a share of the foot's width (two equal shoulders share the rest), by eye; larger needs longer
# slots
TONGUE_SHARE = 0.6
# length over which a foot widens beside its hub, as a share of the width that it gains on either side, by eye; larger
# is smoother
FLARE_RATIO = 0.8
TONGUE_OVERHANG = 1.0  # length by which the tongue extends below the base, in thicknesses of the sheet


@dataclass(frozen=True, eq=False)
class Foot:
    """A foot: the strip that replaces one arm at the border and stands in a slot of the base.

    number : engraved number, from 1
    quad, side : the arm that the foot replaces
    cap : outline of the foot in the patch's frame
    shoulder_distance : distance from the hub's centre to the shoulders along the foot, metres
    tongue_offset : distance of the tongue's middle from the hub's centre, to the left of the foot, metres
    width, tongue_width : widths of the foot and of its tongue, metres
    direction : unit vector along the foot in the patch's frame
    down, across : unit vectors in space along the foot and along its level shoulders
    place : intersection of the foot's centre line with the ground, metres
    lean : angle between the sheet and the ground, radians
    """

    number: int
    quad: int
    side: int
    cap: Cap
    shoulder_distance: float
    tongue_offset: float
    width: float
    tongue_width: float
    direction: Float[np.ndarray, " 2"]
    down: Float[np.ndarray, " 3"]
    across: Float[np.ndarray, " 3"]
    place: Float[np.ndarray, " 3"]
    lean: float

    def slot_corners(self, thickness: float, clearance: float) -> Float[np.ndarray, "4 2"]:
        """Return the corners of the foot's slot, counter-clockwise, metres.

        The slot has vertical walls and contains the leaning tongue over the whole thickness of the base, which equals
        the sheet's thickness.

        Parameters
        ----------
        thickness : thickness of the sheet and the base, metres
        clearance : gap around the tongue, metres
        """
        ahead = np.array([self.across[1], -self.across[0]])
        ahead *= np.sign(ahead @ self.down[:2]) or 1.0
        half = 0.5 * thickness / np.sin(self.lean)
        ends = np.array([-half - clearance, half + thickness / np.tan(self.lean) + clearance])
        side = (0.5 * self.tongue_width + clearance) * self.across[:2]
        a, b = self.place[:2] + ends[:, None] * ahead
        corners = np.array([a - side, b - side, b + side, a + side])
        turned = (b - a)[0] * side[1] - (b - a)[1] * side[0] > 0.0
        return corners if turned else corners[::-1]


def quads_for_feet(mesh: QuadMesh, supports: Int[np.ndarray, " held"]) -> Int[np.ndarray, " feet"]:
    """Return the supported quads that have a side on the open border, through which a foot can leave the piece.

    Parameters
    ----------
    mesh : target
    supports : supported quads
    """
    return supports[mesh.border[mesh.quad_edges[supports]].any(axis=1)]


def make_feet(
    design: SpiralDesign, pose: Pose, supports: Int[np.ndarray, " held"], lowest: float, params: BaseParams
) -> tuple[Foot, ...]:
    """Make a foot for every supported spiral of a design.

    Parameters
    ----------
    design : spirals of the piece
    pose : simulated positions and rotations of the hubs
    supports : supported quads
    lowest : height of the piece's lowest point, metres
    params : height of the base, and width of the feet

    Raises
    ------
    FlexMapsError : a foot is impossible; the error names the faces
    """
    side, way = _sides_and_directions(design, pose, supports)
    wound = supports[design.twist[supports] > MAX_STRAIGHT_TWIST]
    if len(wound):
        raise FlexMapsError(
            f"{with_count(len(wound), 'supported spiral is', 'supported spirals are')} wound, so that arms would cross feet; press Spirals again while a "
            "base is chosen, which leaves their arms straight",
            faces=wound,
        )
    rotations, height = pose.rotations[supports], pose.centres[supports, 2] - (lowest - params.base_height)
    level = np.abs(rotations[:, 2, 2])
    slope = np.sqrt(1.0 - level**2)
    shoulder = (height - 0.5 * design.params.thickness * level) / slope
    made = []
    for n, (f, k) in enumerate(zip(supports.tolist(), side.tolist(), strict=True)):
        cap, aside = _foot_cap(design, f, k, way[n], float(shoulder[n]), float(slope[n]), params.foot_width)
        flat = np.array([way[n], [-way[n, 1], way[n, 0]]])
        down, across = flat @ rotations[n, :, :2].T
        place = pose.centres[f] + height[n] / slope[n] * down + aside * across
        lean = float(np.arcsin(slope[n]))
        width = params.foot_width
        numbers = float(shoulder[n]), aside, width, TONGUE_SHARE * width
        made.append(Foot(n + 1, f, k, cap, *numbers, way[n], down, across, place, lean))
    _refuse_crowded(design, made)
    return tuple(made)


def _sides_and_directions(
    design: SpiralDesign, pose: Pose, supports: Int[np.ndarray, " held"]
) -> tuple[np.ndarray, np.ndarray]:
    """Return the side (n,) through which each foot leaves its quad, and its direction (n, 2) in the patch's frame."""
    mesh, rotations = design.flat.layout.mesh, pose.rotations[supports]
    refuse_inside(np.setdiff1d(supports, quads_for_feet(mesh, supports)))
    way = -rotations[:, 2, :2]  # project -z onto the plane of the hub
    slope = np.linalg.norm(way, axis=1)
    refuse_flat(supports[slope < np.sin(MIN_SLOPE)])
    way /= slope[:, None]
    aside = design.arms.angle[supports] - np.arctan2(way[:, 1], way[:, 0])[:, None]
    aside = np.abs((aside + np.pi) % (2.0 * np.pi) - np.pi)
    aside[~mesh.border[mesh.quad_edges[supports]]] = np.inf
    refuse_sideways(supports[aside.min(axis=1) > MAX_SIDEWAYS_ANGLE])
    return aside.argmin(axis=1), way


def refuse_inside(faces: Int[np.ndarray, " some"]) -> None:
    """Raise ``FlexMapsError`` about ``faces``, supports away from the open border; do nothing if there are none."""
    if len(faces):
        raise FlexMapsError(
            f"{with_count(len(faces), 'support lies', 'supports lie')} away from the open border, where no foot can leave the piece; "
            "choose supports at the border, or no base",
            faces=faces,
        )


def refuse_flat(faces: Int[np.ndarray, " some"]) -> None:
    """Raise ``FlexMapsError`` about ``faces``, supports that lie too flat for a foot; do nothing if there are none."""
    if len(faces):
        raise FlexMapsError(
            f"{with_count(len(faces), 'supported spiral lies', 'supported spirals lie')} too flat for a foot to reach the ground: "
            f"{np.degrees(MIN_SLOPE):.0f} degrees at least are needed; support the piece elsewhere, turn it, or choose no base",
            faces=faces,
        )


def refuse_sideways(faces: Int[np.ndarray, " some"]) -> None:
    """Raise ``FlexMapsError`` about ``faces``, supports with no open border below; do nothing if there are none."""
    if len(faces):
        raise FlexMapsError(
            f"The open border of {len(faces)} supported spirals does not lie below them, so that their feet cannot reach the "
            "ground; support the piece where its border is lowest, or choose no base",
            faces=faces,
        )


def _foot_cap(
    design: SpiralDesign, quad: int, side: int, way: np.ndarray, shoulder: float, slope: float, width: float
) -> tuple[Cap, float]:
    """Return the outline of a foot in place of the arm at side ``side`` of quad ``quad``, and the offset of its tongue.

    The outline leads from the right to the left edge of the arm. A foot leaves its quad through the middle of the side
    and bends there into the direction of steepest descent, so its tongue is not below the hub's centre. The offset is
    the distance in metres of the tongue from the hub's centre, to the left of this direction.

    way : unit direction of steepest descent in the patch's frame
    shoulder : distance from the hub's centre to the shoulders along ``way``, metres
    slope : sine of the angle between the sheet and the ground
    width : width of the foot, metres
    """
    begin = stump_starts(design.roots)[quad, side]
    arm = design.arms.one_by_one(np.array([quad]), np.array([side]))
    (right, right_way), (left, left_way) = (
        [x[0, 0, 0] for x in edge_points(arm, np.full((1, 1, 1), begin), s)] for s in (RIGHT, LEFT)
    )
    frame, half, narrow = np.array([way, [-way[1], way[0]]]), 0.5 * width, 0.5 * TONGUE_SHARE * width
    out = frame @ [np.cos(arm.angle[0, 0]), np.sin(arm.angle[0, 0])]
    normal, knee = np.array([-out[1], out[0]]), out * arm.radius[0, 0]
    starts = [frame @ (p - arm.centre[0]) for p in (right, left)]
    wide = max(float(p @ out) for p in starts) + FLARE_RATIO * (half - min(abs(float(p @ normal)) for p in starts))
    # length by which the bend shortens the foot's inner edge before it, and once more after it
    turn = half * abs(out[1]) / (1.0 + out[0])
    short = max(knee[0] + turn + 2.0 * CORNER_RADIUS - shoulder, wide + turn - arm.radius[0, 0])
    if short > 0.0:
        raise FlexMapsError(
            f"There is no room for a foot of {1e3 * width:g} mm at a supported spiral: {1e3 * short:.2g} mm are lacking; make the "
            "feet narrower, or the height of the base's feet larger",
            faces=[quad],
        )
    # the tongue passes through the base; as it leans, one of its faces reaches the lower side later than the other
    thickness, level = design.params.thickness, np.sqrt(max(1.0 - slope**2, 0.0))
    end, bend = (
        shoulder + thickness * (1.0 + level + TONGUE_OVERHANG) / slope,
        (normal + np.array([0.0, 1.0])) / (1.0 + out[0]),
    )
    aside = knee[1]
    lines = []
    for sign in (-1.0, 1.0):
        corners = [wide * out + sign * half * normal, knee + sign * half * bend]
        corners += [(shoulder, aside + sign * half), (shoulder, aside + sign * narrow), (end, aside + sign * narrow)]
        lines.append(np.array(corners))
    radii = np.array([0.0, half, CORNER_RADIUS, 0.0, CORNER_RADIUS])
    line = np.concatenate([lines[0], lines[1][::-1]])
    post = round_corners(line @ frame + arm.centre[0], np.concatenate([radii, radii[::-1]]), closed=False)
    away = out @ frame
    parts = [
        _flare_biarc(right, -right_way, post.points[0], away),
        (post.points[:-1], post.bulge[:-1]),
        _flare_biarc(post.points[-1], -away, left, left_way),
        (left[None], np.zeros(1)),
    ]
    nodes, bulge = (np.concatenate([part[i] for part in parts]) for i in (0, 1))
    patch = int(design.flat.layout.patch_of[quad])
    return Cap(4 * quad + side, patch, float(begin), Curve(nodes, bulge, closed=False)), float(aside)


def _flare_biarc(
    start: np.ndarray, first: np.ndarray, end: np.ndarray, last: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return nodes and bulges of the biarc between two points with given directions, without the last point.

    start, end : (2,) points where it begins and ends, metres
    first, last : (2,) unit directions at ``start`` and at ``end``
    """
    nodes, bulge = interpolate_biarcs(np.stack([start, end])[None], np.stack([first, last])[None])
    return nodes[0], bulge[0]


def _refuse_crowded(design: SpiralDesign, feet: list[Foot]) -> None:
    """Raise ``FlexMapsError`` if a foot is closer than the smallest slot's width to other feet or arms of its panel."""
    import shapely

    slot, layout = 0.999 * min_slot_width(design.params), design.flat.layout
    mask: Bool[np.ndarray, "quads 4"] = np.zeros(design.width.shape, dtype=bool)
    mask.ravel()[[foot.cap.arm for foot in feet]] = True
    bare = replace(design, feet=make_caps(design.arms, stump_starts(design.roots), mask, layout.patch_of))
    drawn = bare.outlines()
    bodies = np.array([shapely.Polygon(o.outer.sample(1e-5), [h.sample(1e-5) for h in o.holes]) for o in drawn])
    patch = np.array([foot.cap.patch for foot in feet])
    shapes = np.array([foot.cap.polygon for foot in feet])
    # ignore a disc around the foot's own hub, where the foot and the other arms begin
    quads = np.array([foot.quad for foot in feet])
    root = np.linalg.norm(design.roots.centre[quads] - design.arms.centre[quads][:, None], axis=2).max(axis=1)
    discs = shapely.buffer(shapely.points(design.arms.centre[quads]), root + 2.0 * design.width[quads].max(axis=1))
    near = shapely.dwithin(shapely.difference(shapes, discs), shapely.difference(bodies[patch], discs), slot)
    tree = shapely.STRtree(shapes)
    one, two = tree.query(shapes, predicate="dwithin", distance=slot)
    both = (one != two) & (patch[one] == patch[two])
    near[one[both]] = True
    if near.any():
        raise FlexMapsError(
            f"{with_count(int(near.sum()), 'foot comes', 'feet come')} too near to another foot, or to an arm of its panel; make the feet "
            "narrower, or support fewer spirals",
            faces=quads[near],
        )
