"""Draw the pieces of the calibration sheet as curves of arcs, in metres, with the origin at the lower left."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from ...arrays import Float
from ...errors import FlexMapsError
from ...fabrication.connectors.joined_arms import to_complex
from ...fabrication.connectors.shape import (
    ConnectorSize,
    connector_size,
    head_curve,
    key_outline,
    round_polyline,
    socket_curve,
)
from ...fabrication.panels.kerf import cut_dogbones, offset_curve
from ...fabrication.panels.lettering import text_length, text_strokes
from ...params import ConnectorParams
from ...spirals.curves.arcs import Curve, interpolate_biarcs
from ...spirals.curves.spiral import LEFT, RIGHT, Arms, centre_line, edge_points
from ...spirals.roots import find_roots
from .bending import fillet_radius
from .coupons import STRIP_CLAMP, STRIP_END, Coupons, SpiralCoupon

LETTER_HEIGHT = 0.0025  # height of engraved letters, metres
RIM_WIDTH = 0.008  # width of the material around holes, metres; larger: stiffer frames, larger sheet
ARC_PAIRS = 14  # pairs of arcs per edge of a spiral; more: closer to the spiral, but arcs shorter than a mill's radius
# ratio of base width to height of the tooth that joins an arm's end to the frame; larger: the arm's end yields less
TOOTH_RATIO = 3.0


@dataclass(frozen=True, eq=False)
class DrawnPiece:
    """Drawing of a piece, or of several that belong together, with finished sizes, metres.

    outlines, holes : outer and inner borders; the material lies on the left of these curves
    shared : lines that the cutter follows without an offset, such as those between the squares of the comb
    engraved : lines of the labels
    """

    outlines: tuple[Curve, ...] = ()
    holes: tuple[Curve, ...] = ()
    shared: tuple[Curve, ...] = ()
    engraved: tuple[Curve, ...] = ()

    def moved(self, shift: Float[np.ndarray, " 2"]) -> DrawnPiece:
        """Return the piece shifted by a vector, metres."""
        return DrawnPiece(*(tuple(c.transform(0.0, shift) for c in some) for some in self._all))

    def cut(self, kerf: float, kerf_holes: float) -> DrawnPiece:
        """Return the cutter's paths: outlines and holes offset by half of their kerf, metres."""
        return replace(
            self,
            outlines=tuple(offset_curve(c, 0.5 * kerf) for c in self.outlines),
            holes=tuple(offset_curve(c, 0.5 * kerf_holes) for c in self.holes),
        )

    @property
    def _all(self) -> tuple[tuple[Curve, ...], ...]:
        return self.outlines, self.holes, self.shared, self.engraved

    @property
    def box(self) -> tuple[Float[np.ndarray, " 2"], Float[np.ndarray, " 2"]]:
        """Bounding box: lower left and upper right corner, metres."""
        points = np.concatenate([c.sample(1e-5) for some in self._all for c in some])
        return points.min(axis=0), points.max(axis=0)


def combine_pieces(pieces: Iterable[DrawnPiece]) -> DrawnPiece:
    """Combine several pieces into one drawing."""
    some = list(pieces)
    return DrawnPiece(*(tuple(c for piece in some for c in piece._all[k]) for k in range(4)))


def engrave_text(text: str, x: float, y: float, middle: bool = False, room: float = math.inf) -> tuple[Curve, ...]:
    """Return engraved text.

    Parameters
    ----------
    text : letters
    x, y : begin of the base line, metres
    middle : whether the text is centred at x instead
    room : largest width, metres; letters become smaller if the text would be wider
    """
    high = min(LETTER_HEIGHT, room / max(text_length(text), 1.0))
    begin = np.array([x - (0.5 * high * text_length(text) if middle else 0.0), y])
    return tuple(Curve(high * s + begin, np.zeros(len(s)), closed=False) for s in text_strokes(text))


def rectangle(x0: float, y0: float, x1: float, y1: float) -> Curve:
    """Return a counter-clockwise rectangle from its lower left corner (x0, y0) to its upper right corner (x1, y1)."""
    return Curve(np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]]), np.zeros(4))


def polyline(*points: tuple[float, float]) -> Curve:
    """Return the open polyline through points."""
    return Curve(np.array(points), np.zeros(len(points)), closed=False)


def draw_comb(made: Coupons, text: str) -> DrawnPiece:
    """Return the kerf comb: squares in a window, separated by lines that are cut without an offset.

    When n squares are pushed to one side, they leave a gap of n + 1 kerfs.

    Parameters
    ----------
    made : sizes of the calibration pieces
    text : text to engrave above the window
    """
    wide, high, a = made.cells * made.cell, made.cell, made.cell
    x, y = RIM_WIDTH, RIM_WIDTH + 2.0 * LETTER_HEIGHT
    window = rectangle(x, y, x + wide, y + high)
    between = [polyline((x + k * a, y), (x + k * a, y + high)) for k in range(1, made.cells)]
    says = engrave_text(
        f"{made.cells} SQUARES OF {a * 1e3:g} MM - GAP OVER {made.cells + 1} IS THE KERF", x, 0.5 * RIM_WIDTH, room=wide
    )
    outline = rectangle(0.0, 0.0, 2.0 * RIM_WIDTH + wide, y + high + RIM_WIDTH + LETTER_HEIGHT)
    return DrawnPiece(
        (outline,), (), (*between, window), says + engrave_text(text, x, y + high + 0.5 * RIM_WIDTH, room=wide)
    )


# -- the ladders of clearances -----------------------------------------------------------------------------------------


def draw_ladder(made: Coupons, params: ConnectorParams, kind: str) -> DrawnPiece:
    """Return a ladder: a rail with a socket for every clearance (rung), and the counterparts to insert.

    Each socket and each counterpart is labelled with its clearance, mm.

    Parameters
    ----------
    made : sizes of the calibration pieces
    params : settings of connectors
    kind : kind of connector, one of ``coupons.KINDS``
    """
    rungs = [connector_size(made.joint, replace(params, clearance=c), mill=made.mill) for c in made.clearances]
    values = [f"{c * 1e3:g}" for c in made.clearances]
    gap = made.joint + 2.0 * max(made.kerf, made.mill)
    pitch = max(
        max(r.pad_width for r in rungs) + gap, max(LETTER_HEIGHT * text_length(v) for v in values) + LETTER_HEIGHT + gap
    )
    deep = max(r.length for r in rungs) + 2.0 * LETTER_HEIGHT
    name, x0 = kind.upper(), 2.0 * LETTER_HEIGHT
    begin, top = x0 + LETTER_HEIGHT * text_length(name) + LETTER_HEIGHT, deep + LETTER_HEIGHT
    low = top - max(made.clearances)  # the rail is lower between sockets, so that only the sockets' faces touch
    end = begin + pitch * len(rungs) + x0
    places = [begin + pitch * (k + 0.5) for k in range(len(rungs))]
    rail = [(0.0, 0.0), (end, 0.0), (end, low)]
    bulges, says = [0.0, 0.0, 0.0], list(engrave_text(name, x0, LETTER_HEIGHT))
    for x, rung, value in reversed(list(zip(places, rungs, values, strict=True))):
        mouth = _point_up(_socket_outline(rung, kind), x, top)
        ends = [(float(mouth.points[k, 0]), low) for k in (0, -1)]
        rail += [ends[0], *map(tuple, mouth.points.tolist()), ends[1]]
        bulges += [0.0, *mouth.bulge[:-1].tolist(), 0.0, 0.0]
        says += engrave_text(value, x, LETTER_HEIGHT, middle=True)
    rail.append((0.0, low))
    bulges.append(0.0)
    parts = [DrawnPiece((Curve(np.array(rail), np.array(bulges)),), engraved=tuple(says))]
    high = top + 2.0 * max(r.length for r in rungs) + gap
    for x, rung, value in zip(places, rungs, values, strict=True):
        parts += _draw_counterpart(rung, kind, value, x, high, gap)
    return combine_pieces(parts)


def _socket_outline(rung: ConnectorSize, kind: str) -> Curve:
    """Return the outline of a socket in the rail, from right to left as seen from outside, as ``socket_curve`` does."""
    if kind != "tab":
        return socket_curve(rung)
    wide, deep = 0.5 * (rung.head + rung.clearance), rung.length + 0.5 * rung.clearance
    edge_of_pad = 0.5 * rung.pad_width
    points = [(0.0, -edge_of_pad), (0.0, -wide), (-deep, -wide), (-deep, wide), (0.0, wide), (0.0, edge_of_pad)]
    return cut_dogbones(round_polyline(points, [0.0, 0.0, rung.rounding, rung.rounding, 0.0, 0.0]), rung.inside_radius)


def _draw_counterpart(rung: ConnectorSize, kind: str, value: str, x: float, y: float, gap: float) -> list[DrawnPiece]:
    """Return the pieces to insert into one socket, placed above it: a labelled stem, and the loose key if there is one.

    rung : size of the connector; value : label; x, y : position, metres; gap : distance between pieces, metres
    """
    wide = max(0.5 * rung.pad_width, 0.5 * LETTER_HEIGHT * text_length(value) + 0.4 * LETTER_HEIGHT)
    foot = rung.length + 2.0 * rung.inside_radius if kind == "key" else 0.0  # height of the socket, below the letters
    high = foot + 4.0 * LETTER_HEIGHT
    if kind == "dovetail":
        front = _point_down(head_curve(rung))
    elif kind == "key":
        front = _point_down(socket_curve(rung))
    else:
        half, deep, pad = 0.5 * (rung.head - rung.clearance), rung.length - 0.5 * rung.clearance, 0.5 * rung.pad_width
        corners = [(-pad, 0.0), (-half, 0.0), (-half, -deep), (half, -deep), (half, 0.0), (pad, 0.0)]
        front = round_polyline(
            corners, [0.0, rung.inside_radius, rung.rounding, rung.rounding, rung.inside_radius, 0.0]
        )
    points = [
        *front.points.tolist(),
        [wide, front.points[-1, 1]],
        [wide, high],
        [-wide, high],
        [-wide, front.points[0, 1]],
    ]
    bulge = [*front.bulge[:-1].tolist(), 0.0, 0.0, 0.0, 0.0, 0.0]
    stem = DrawnPiece(
        (Curve(np.array(points), np.array(bulge)),),
        engraved=engrave_text(value, 0.0, foot + 1.5 * LETTER_HEIGHT, middle=True),
    )
    if kind != "key":
        return [stem.moved(np.array([x, y]))]
    loose = key_outline(rung).transform(0.5 * math.pi, np.zeros(2))
    below = rung.length + gap
    return [DrawnPiece((loose,)).moved(np.array([x, y])), stem.moved(np.array([x, y + below]))]


def _point_up(curve: Curve, x: float, y: float) -> Curve:
    """Return the outline of an arm's end turned so that it points up, with the middle of its face at (x, y)."""
    return curve.transform(0.5 * math.pi, np.array([x, y]))


def _point_down(curve: Curve) -> Curve:
    """Return the outline of an arm's end turned so that it points down and runs from left to right."""
    return curve.transform(-0.5 * math.pi, np.zeros(2))


# -- the strip and the spirals -----------------------------------------------------------------------------------------


def draw_strip(made: Coupons) -> DrawnPiece:
    """Return the bending strip: a part to clamp, a line where the clamp ends, and a hole for the weight's thread."""
    clamp, end = STRIP_CLAMP * made.thickness, STRIP_END * made.thickness
    b, load = made.strip_width, clamp + made.strip_length
    hole = max(0.002, 1.5 * max(made.kerf, made.mill))
    says = (
        polyline((clamp, 0.0), (clamp, b)),
        *engrave_text("CLAMP", 0.5 * clamp, 0.5 * (b - LETTER_HEIGHT), middle=True, room=0.8 * clamp),
        *engrave_text(
            f"{made.strip_length * 1e3:g} TO THE HOLE - TRY {made.strip_load * 1e3:g} G",
            clamp + LETTER_HEIGHT, 0.5 * (b - LETTER_HEIGHT), room=made.strip_length - hole - 2.0 * LETTER_HEIGHT,
        ),
    )  # fmt: skip
    return DrawnPiece((rectangle(0.0, 0.0, load + end, b),), (_circle(load, 0.5 * b, 0.5 * hole),), engraved=says)


def _circle(x: float, y: float, radius: float) -> Curve:
    """Return a clockwise circle, as for a hole."""
    return Curve(np.array([[x + radius, y], [x - radius, y]]), np.array([-1.0, -1.0]))


def draw_spiral(made: Coupons, one: SpiralCoupon) -> DrawnPiece:
    """Return a spiral in its frame: a rectangle with four holes, each between two consecutive arms.

    Parameters
    ----------
    made : sizes of the calibration pieces
    one : sizes of the spiral
    """
    arms = _make_arms(one)
    rim = (
        0.5 * one.scale
        + 1.5 * max(one.width, 2.0 * max(made.kerf_holes, made.mill))
        + max(RIM_WIDTH, 5.0 * made.thickness)
    )
    foot = 2.0 * LETTER_HEIGHT
    centre = np.array([rim, rim + foot])
    holes = tuple(hole.transform(0.0, centre) for hole in _slot_outlines(made, one, arms))
    says = engrave_text(f"{one.name} - TRY {one.load * 1e3:g} G", rim, 0.8 * LETTER_HEIGHT, middle=True, room=1.8 * rim)
    return DrawnPiece((rectangle(0.0, 0.0, 2.0 * rim, 2.0 * rim + foot),), holes, engraved=says)


def _make_arms(one: SpiralCoupon) -> Arms:
    """Return four equal arms around the origin, unblended as in the stiffness table."""
    four = np.full((1, 4), 1.0)
    angle = 0.5 * np.pi * np.arange(4.0)[None]
    return Arms(
        np.zeros((1, 2)), 0.5 * one.scale * four, angle, np.array([one.twist]), one.width * four, one.width * four,
        np.zeros((1, 4, 2)), 0.15 * four,
    )  # fmt: skip


def _slot_outlines(sizes: Coupons, one: SpiralCoupon, arms: Arms) -> list[Curve]:
    """Return the four holes between consecutive arms, clockwise.

    The outline of a hole runs along arm k to the hub, along arm k + 1 to its end, and back along the frame. Teeth of
    the frame, perpendicular to the arms, hold the arms' ends.
    """
    roots = find_roots(arms, fillet_radius(sizes, one.width))
    if roots.is_missing.any():
        raise FlexMapsError(
            "The spirals of the calibration sheet have no room; use a thicker sheet or a narrower cutter"
        )
    share = np.linspace(0.0, 1.0, ARC_PAIRS + 1)
    inwards = edge_points(arms, roots.left[..., None] * share, LEFT)
    right = np.roll(roots.right, 1, axis=1)[..., None]
    outwards = edge_points(arms, right * share[::-1], RIGHT)
    to_hub, hub_bulge = interpolate_biarcs(inwards[0][0], inwards[1][0])
    from_hub, tip_bulge = interpolate_biarcs(outwards[0][0], -outwards[1][0])
    ends = to_complex(np.stack([edge_points(arms, np.zeros((1, 4, 1)), side)[0][0, :, 0] for side in (LEFT, RIGHT)]))
    middle = to_complex(centre_line(arms, np.zeros((1, 4, 1)))[0][0, :, 0])
    reach = max(one.width, 2.0 * max(sizes.kerf_holes, sizes.mill))  # the cutter must pass around the arms' ends
    made = []
    for k in range(4):
        after = (k + 1) % 4
        first = to_complex(inwards[0][0, k, -1])
        into, out = to_complex(inwards[1][0, k, -1]), -to_complex(outwards[1][0, after, 0])
        corner_bulge = math.tan(0.25 * _right_turn(complex(into), complex(out)))
        # arms wind clockwise outwards, so the left corner of an arm's end lies farther out than the right corner. The
        # outline follows the ends of both arms outwards; between them it follows the frame's circle, on which the tooth
        # of arm k + 1 stands
        outer, inner = (
            corner + reach * (corner - tip) / abs(corner - tip)
            for corner, tip in ((ends[0, k], middle[k]), (ends[1, after], middle[after]))
        )
        radius = abs(outer)
        foot = radius * inner / abs(inner) * np.exp(-1j * TOOTH_RATIO * reach / radius)
        back = math.tan(0.25 * float(np.angle(outer / foot)))
        nodes = [
            *to_complex(to_hub[k]).tolist(),
            first,
            *to_complex(from_hub[after]).tolist(),
            ends[1, after],
            inner,
            foot,
            outer,
        ]
        bulges = [*hub_bulge[k].tolist(), corner_bulge, *tip_bulge[after].tolist(), 0.0, 0.0, back, 0.0]
        made.append(Curve(np.column_stack([np.real(nodes), np.imag(nodes)]), np.array(bulges)))
    return made


def _right_turn(before: complex, after: complex) -> float:
    """Return the angle from one direction to another as a right turn: radians, 0 or negative."""
    turn = float(np.angle(after / before))
    return turn - 2.0 * math.pi if turn > 0.5 * math.pi else min(turn, 0.0)
