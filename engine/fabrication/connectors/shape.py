"""Shapes of connectors: heads, sockets, keys and plain faces as curves of arcs, in the frame of a joint.

In this frame x points out of the arm that has the curve, y to its left, and the cut is at x = 0. Head and socket are
offsets of the same curve by half of the clearance to either side, so the gap is equally wide everywhere.

The joint has to carry the load of the arms: tension, bending and torsion. A neck as wide as the arm is as strong as the
arm in tension. Two walls of 0.6 neck widths beside the socket are stronger than the head in tension, and have to be,
because they also bend. The flanks of a head make an angle of 25 degrees with the axis of the arm, which turns 0.05 mm
of clearance into 0.12 mm of play along the arm. At a smaller angle a pull would spread the socket; at a larger angle
the neck would be thin at its root. The shoulders beside the neck, as wide as the arm, rest against the lips of the
socket and carry bending instead of the neck.

A mill cannot cut an inside corner sharper than its own radius. The root of a head and the lips of the socket are
rounded accordingly; corners at the bottom of a socket are opened by dogbones, so that the head keeps sharp corners.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from ...params import ConnectorParams
from ...spirals.curves.arcs import Curve
from ..panels.kerf import cut_dogbones, offset_curve

# slope of the flanks of a head, width per length; the angle, explained at the top of this module, was chosen by eye
FLANK_SLOPE = math.tan(math.radians(25.0))
LENGTH_RATIO = 0.85  # length of a head in neck widths; longer heads are wider at their ends and need more room
WALL_RATIO = 0.6  # thickness of the walls beside a socket, in neck widths; thicker ones are stronger and need more room
# metres by which the radius of inside corners exceeds the mill's, so that the mill's path can turn there; larger makes
# corners rounder
_SLACK = 2e-5
_DOGBONE = 1.9  # length of a flank that a dogbone at its end takes up, in mill radii; larger lengthens flanks
_BITE = 0.5  # depth to which a dogbone cuts into a wall, in mill radii; walls are thickened by as much
# widths of tabs, in widths of their arms, to try besides the widths that dovetails and keys have; more take longer
_TAB_RATIOS = (2.0, 1.6, 1.3)
# length of a flank that a rounded corner at its end takes up, in corner radii; the outline turns there by 90 + 25
# degrees
_TANGENT = math.tan(math.radians(0.5 * 115.0))


@dataclass(frozen=True)
class ConnectorSize:
    """Dimensions of one connector in metres.

    neck, head : width of the head at its narrow and at its wide end
    length : length of the head, from neck to wide end
    wall : thickness of the walls on both sides of the socket in a straight arm
    thinnest : thickness that these walls must have at least in a curved arm
    pad_width : width of the arm's widened end
    clearance : gap between head and socket after cutting
    rounding : radius of all corners of head and socket that need no larger one for the mill
    inside_radius : minimum radius of inside corners that the mill can cut; 0 for a beam
    """

    neck: float
    head: float
    length: float
    wall: float
    thinnest: float
    pad_width: float
    clearance: float
    rounding: float
    inside_radius: float = 0.0


def connector_size(width: float, params: ConnectorParams, scale: float = 1.0, mill: float = 0.0) -> ConnectorSize:
    """Return the dimensions of a connector for arms of a given width.

    Parameters
    ----------
    width : width of the arms, metres
    params : relative dimensions, clearance, and the thinnest part permitted
    scale : factor on the width of the neck, which stays at least as wide as the thinnest part permitted
    mill : diameter of the mill, metres; 0 for a laser or another beam
    """
    c, inside = params.clearance, 0.51 * mill + _SLACK if mill else 0.0
    neck, flank = max(params.neck * width * scale, params.thinnest + c, 2.0 * inside), math.cos(math.atan(FLANK_SLOPE))
    least_rounding = max(params.rounding, 0.75 * c)
    # a flank has to be long enough for the rounded corners at both of its ends, or for one of them and a dogbone
    corners = max(2.1 * _TANGENT * least_rounding, (1.05 * _TANGENT + _DOGBONE) * inside)
    length = max(LENGTH_RATIO * neck, corners * flank)
    # offsetting reduces some corner radii by half of the clearance; compensate for it where the flank is long enough
    rounding = max(least_rounding, min(params.rounding + 0.5 * c, length / (2.1 * _TANGENT * flank)))
    head = neck + 2.0 * length * FLANK_SLOPE
    wall = max(WALL_RATIO * neck, params.thinnest)
    pad = max(head + c + 2.0 * (wall + _BITE * inside), width)
    return ConnectorSize(neck, head, length, wall, params.thinnest, pad, c, rounding, inside)


@lru_cache(maxsize=4096)
def connector_sizes(
    width: float, params: ConnectorParams, scales: tuple[float, ...], mill: float = 0.0
) -> tuple[ConnectorSize, ...]:
    """Return ``connector_size(width, params, scale, mill)`` for each of ``scales``, in their order, without repeats."""
    return tuple(dict.fromkeys(connector_size(width, params, scale, mill) for scale in scales))


@lru_cache(maxsize=4096)
def tab_sizes(
    width: float, params: ConnectorParams, scales: tuple[float, ...], mill: float = 0.0
) -> tuple[ConnectorSize, ...]:
    """Return the dimensions of tabs (flat ends for glue) to try on arms of width ``width``, the widest tab first.

    The tabs are as wide as the widened ends of connectors at ``scales``, or ``_TAB_RATIOS`` times as wide as the arm.
    """
    whole = connector_size(width, params)
    pads = [
        *(connector_size(width, params, scale, mill).pad_width for scale in scales),
        *(share * width for share in _TAB_RATIOS),
    ]
    short = 0.5 * width
    return tuple(
        ConnectorSize(
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


def round_polyline(points: list[tuple[float, float]], radius: float | list[float], closed: bool = False) -> Curve:
    """Return a polyline with its corners rounded by arcs.

    Parameters
    ----------
    points : corners (x, y), metres
    radius : radius in metres for all corners, or a list with one for each point; reduced where sides are short
    closed : whether the last point is joined to the first
    """
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


def _gap_middle(s: ConnectorSize) -> Curve:
    """Return the curve in the middle of the gap between head and socket, from right to left end of the shoulder."""
    n, h, p = 0.5 * s.neck, 0.5 * s.head, 0.5 * s.pad_width
    root = max(s.rounding, s.inside_radius)
    points = [(0.0, -p), (0.0, -n), (s.length, -h), (s.length, h), (0.0, n), (0.0, p)]
    return round_polyline(points, [0.0, root, s.rounding, s.rounding, root, 0.0])


def _in_mate_frame(curve: Curve, shift: float) -> Curve:
    """Transform a curve to the frame of the other arm, and move it along x there by ``shift`` metres."""
    return Curve(-curve.points + [shift, 0.0], curve.bulge, curve.closed).reversed()


@lru_cache(maxsize=512)
def head_curve(s: ConnectorSize) -> Curve:
    """Return the end curve of an arm with a head, from its right to its left edge."""
    return offset_curve(_gap_middle(s), -0.5 * s.clearance)


@lru_cache(maxsize=4096)
def min_radius(s: ConnectorSize) -> float:
    """Return the smallest radius in metres of the corners of a head and its socket, without dogbones."""
    curve = offset_curve(_gap_middle(s), -0.5 * s.clearance)
    other = offset_curve(_gap_middle(s), 0.5 * s.clearance)
    found = []
    for side in (curve, other):
        chord, bulge = np.linalg.norm(np.diff(side.points, axis=0), axis=1), np.abs(side.bulge[:-1])
        found.append((chord * (1.0 + bulge**2) / np.maximum(4.0 * bulge, 1e-300))[bulge > 0.0].min(initial=np.inf))
    return float(min(found))


@lru_cache(maxsize=512)
def socket_curve(s: ConnectorSize, setback: float = 0.0) -> Curve:
    """Return the end curve of an arm with a socket, from its right to its left edge.

    Parameters
    ----------
    s : size of the connector
    setback : distance from the cut to the socket's face, metres
    """
    return cut_dogbones(_in_mate_frame(offset_curve(_gap_middle(s), 0.5 * s.clearance), -setback), s.inside_radius)


def face_curve(s: ConnectorSize, setback: float = 0.0) -> Curve:
    """Return the flat end of an arm with a tab, from its right to its left edge.

    The end lies behind the cut by ``setback`` metres plus half of the clearance.
    """
    x, p = -0.5 * s.clearance - setback, 0.5 * s.pad_width
    return Curve(np.array([[x, -p], [x, p]]), np.zeros(2), closed=False)


def key_outline(s: ConnectorSize, setback: float = 0.0) -> Curve:
    """Return the outline of a loose key, counter-clockwise about 0: two heads for two sockets, joined at their necks.

    Parameters
    ----------
    s : size of the connector
    setback : distance from the cut to the face of each socket, metres
    """
    n, h, x = 0.5 * s.neck, 0.5 * s.head, setback + s.length
    root = max(s.rounding, s.inside_radius)
    right = [(setback, -n), (x, -h), (x, h), (setback, n)] if setback else [(x, -h), (x, h), (0.0, n)]
    radii = [root, s.rounding, s.rounding, root] if setback else [s.rounding, s.rounding, root]
    points = right + [(-a, -b) for a, b in right]
    return offset_curve(round_polyline(points, radii * 2, closed=True), -0.5 * s.clearance)
