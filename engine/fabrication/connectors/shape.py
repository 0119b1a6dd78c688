"""What a connector looks like: heads, sockets, keys and plain faces as curves of arcs, in the frame of a joint.

Both arms of a joint run in one line there: x points out of the arm that the curve belongs to, y to the left, and the
cut is at x = 0. Head and socket are the two sides of one curve, half of the clearance to the left and to the right of it,
so the gap between them is the same everywhere.

The joint has to carry what the arms carry: tension, bending and torsion. A neck as wide as the arm is as strong as the
arm in tension; two walls of 0.6 necks hold the head more than evenly, for they are bent too. Flanks at 25 degrees turn
0.05 mm of clearance into 0.12 mm of play along the arm; steeper ones would open the socket, flatter ones thin the neck's
root. Shoulders of full width lie against the socket's lips, so that bending goes through faces and not through the neck.

A mill cuts no inside corner rounder than itself. The root of a head is rounded so that it fits, and the lips of the socket
with it; the corners at the bottom of a socket are opened by dogbones, so that the head keeps corners that hold.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from ...params import ConnectorParams
from ...spirals.arcs import Curve
from ..panels.kerf import offset, relieved

FLANK = math.tan(math.radians(25.0))  # how far the flanks of a dovetail lean out, per length; chosen by eye
LENGTH = 0.85  # of a head, in necks
WALL = 0.6  # of a socket, in necks
_SLACK = 2e-5  # metres that inside corners are wider than a mill, so that its path turns in them
_DOGBONE = 1.9  # of that radius that a dogbone takes of either side of its corner
_BITE = 0.5  # of that radius by which it goes into the sides
_TABS = (2.0, 1.6, 1.3)  # widths of tabs, in widths of their arms, where nothing else has room
_TURN = math.tan(math.radians(0.5 * 115.0))  # length of the tangents at the flank's corners, in radii


@dataclass(frozen=True)
class Size:
    """Measures of one connector in metres.

    neck, head : width of the narrow and of the wide end; length : from the one to the other
    wall : material beside the socket of a straight arm; thinnest : and of any other at the least; pad : width of the arm's widened end
    clearance : gap between the finished parts; rounding : radius of the corners
    inside : least radius of inside corners, 0 where any can be cut
    """

    neck: float
    head: float
    length: float
    wall: float
    thinnest: float
    pad: float
    clearance: float
    rounding: float
    inside: float = 0.0


def size(width: float, params: ConnectorParams, scale: float = 1.0, mill: float = 0.0) -> Size:
    """The connector for arms ``width`` metres wide, shrunk by ``scale`` but never below the thinnest part.

    ``mill`` is the diameter in metres of the mill that cuts it, 0 for a beam.
    """
    c, inside = params.clearance, 0.51 * mill + _SLACK if mill else 0.0
    neck, flank = max(params.neck * width * scale, params.thinnest + c, 2.0 * inside), math.cos(math.atan(FLANK))
    # room on a flank for both of its corners
    asked = max(params.rounding, 0.75 * c)
    corners = max(2.1 * _TURN * asked, (1.05 * _TURN + _DOGBONE) * inside)
    length = max(LENGTH * neck, corners * flank)
    # of the finished corners some are sharper by half of the clearance, which is made up for where the flank is long enough
    rounding = max(asked, min(params.rounding + 0.5 * c, length / (2.1 * _TURN * flank)))
    head = neck + 2.0 * length * FLANK
    wall = max(WALL * neck, params.thinnest)
    pad = max(head + c + 2.0 * (wall + _BITE * inside), width)
    return Size(neck, head, length, wall, params.thinnest, pad, c, rounding, inside)


@lru_cache(maxsize=4096)
def sizes(width: float, params: ConnectorParams, scales: tuple[float, ...], mill: float = 0.0) -> tuple[Size, ...]:
    """The connectors of these scales that differ, in their order."""
    return tuple(dict.fromkeys(size(width, params, scale, mill) for scale in scales))


@lru_cache(maxsize=4096)
def tabs(width: float, params: ConnectorParams, scales: tuple[float, ...], mill: float = 0.0) -> tuple[Size, ...]:
    """Plain ends for glue, the widest first: as wide as connectors of these scales would be, then hardly wider than the arm."""
    whole = size(width, params)
    pads = [*(size(width, params, scale, mill).pad for scale in scales), *(share * width for share in _TABS)]
    short = 0.5 * width
    return tuple(
        Size(
            short,
            short,
            short,
            0.0,
            min(width, params.thinnest),
            pad,
            whole.clearance,
            min(whole.rounding, 0.2 * width),
        )
        for pad in sorted(set(pads), reverse=True)
    )


def rounded(points: list[tuple[float, float]], radius: float | list[float], closed: bool = False) -> Curve:
    """A polyline (metres) with its corners rounded by arcs of one radius, or of one each, as far as there is room."""
    p = np.array(points) @ np.array([1.0, 1.0j])
    count = len(p)
    radii = radius if isinstance(radius, list) else [radius] * count
    corners = range(count) if closed else range(1, count - 1)
    nodes, bulges = ([] if closed else [p[0]]), ([] if closed else [0.0])
    for i in corners:
        back, ahead = p[i] - p[i - 1], p[(i + 1) % count] - p[i]
        turn = float(np.angle(ahead / back))
        if abs(turn) < 1e-9:
            continue
        tangent = min(radii[i] * math.tan(0.5 * abs(turn)), 0.49 * abs(back), 0.49 * abs(ahead))
        nodes += [p[i] - tangent * back / abs(back), p[i] + tangent * ahead / abs(ahead)]
        bulges += [math.tan(0.25 * turn), 0.0]
    if not closed:
        nodes.append(p[-1])
        bulges.append(0.0)
    made = np.array(nodes)
    return Curve(np.column_stack([made.real, made.imag]), np.array(bulges), closed)


def _middle(s: Size) -> Curve:
    """The curve between head and socket, from the right end of the shoulder to its left end."""
    n, h, p = 0.5 * s.neck, 0.5 * s.head, 0.5 * s.pad
    root = max(s.rounding, s.inside)
    points = [(0.0, -p), (0.0, -n), (s.length, -h), (s.length, h), (0.0, n), (0.0, p)]
    return rounded(points, [0.0, root, s.rounding, s.rounding, root, 0.0])


def _turned(curve: Curve, shift: float) -> Curve:
    """Seen from the other arm of the joint, then moved along x by ``shift`` metres."""
    return Curve(-curve.points + [shift, 0.0], curve.bulge, curve.closed).reversed()


@lru_cache(maxsize=512)
def head(s: Size) -> Curve:
    """The end of an arm with a head, from right to left."""
    return offset(_middle(s), -0.5 * s.clearance)


@lru_cache(maxsize=4096)
def least_radius(s: Size) -> float:
    """Metres: the smallest radius of the corners of a head and its socket; a mill's dogbones are none."""
    curve = offset(_middle(s), -0.5 * s.clearance)
    other = offset(_middle(s), 0.5 * s.clearance)
    found = []
    for one in (curve, other):
        chord, bulge = np.linalg.norm(np.diff(one.points, axis=0), axis=1), np.abs(one.bulge[:-1])
        found.append((chord * (1.0 + bulge**2) / np.maximum(4.0 * bulge, 1e-300))[bulge > 0.0].min(initial=np.inf))
    return float(min(found))


@lru_cache(maxsize=512)
def socket(s: Size, back: float = 0.0) -> Curve:
    """The end of an arm with a socket, from right to left; its face lies ``back`` metres behind the cut."""
    return relieved(_turned(offset(_middle(s), 0.5 * s.clearance), -back), s.inside)


def face(s: Size, back: float = 0.0) -> Curve:
    """A plain widened end, from right to left."""
    x, p = -0.5 * s.clearance - back, 0.5 * s.pad
    return Curve(np.array([[x, -p], [x, p]]), np.zeros(2), closed=False)


def key(s: Size, back: float = 0.0) -> Curve:
    """The loose key for two sockets ``back`` metres behind the cut: two heads, neck to neck; counter-clockwise, round 0."""
    n, h, x = 0.5 * s.neck, 0.5 * s.head, back + s.length
    root = max(s.rounding, s.inside)
    right = [(back, -n), (x, -h), (x, h), (back, n)] if back else [(x, -h), (x, h), (0.0, n)]
    radii = [root, s.rounding, s.rounding, root] if back else [s.rounding, s.rounding, root]
    points = right + [(-a, -b) for a, b in right]
    return offset(rounded(points, radii * 2, closed=True), -0.5 * s.clearance)
