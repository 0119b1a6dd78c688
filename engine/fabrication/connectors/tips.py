"""Tips: the ends of arms at cuts, shaped for connectors where the arm has room.

Many joints are processed at once, one per row; frames and the parameter tau are those of module ``joined_arms``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np

from ...arrays import Complex, Float
from ...spirals.curves.arcs import Curve, sample_arcs
from ...spirals.curves.spiral import LEFT, RIGHT
from .joined_arms import ARM_SHARE, MIN_STEP_RATIO, SAMPLES, JoinedArms, Widening, to_complex, to_points
from .shape import ConnectorSize, face_curve, head_curve, socket_curve
from .tip_polygons import make_polygons, wall_thicknesses

# length over which a widened tip narrows to its arm, as a share of its added width: preferred and minimum; longer is
# smoother and needs more room
_FLARE = (1.3, 0.5)
# length behind the shoulder over which an arm with a head keeps its full width, in neck widths; longer needs more room
_BEHIND_HEAD = 0.3
# minimum length of full width between the rounded corner of a shoulder and the narrowing, in radii of that corner;
# hardly changes connectors
_MIN_FULL_WIDTH = 0.1
# iterations that shorten the edges of an arm until the rounded corners at its shoulders have the required radius; more
# are more exact and slower
_ROUNDING_STEPS = 3
# complex factors that turn an edge's outward direction by 90 degrees towards the other edge: left edge, right edge
_TURNS = np.array([[-1j], [1j]])
# maximum distance in metres between the arcs of a tip and its polygon; larger is faster and less exact
_TOLERANCE = 5e-6
_WIDENING = ("left", "right", "taper_start", "taper_end")


@dataclass(frozen=True)
class ConnectorCandidate:
    """A candidate connector at a joint.

    kind : "dovetail", "key" or "tab"
    size : dimensions of the connector
    head_arm : 0 or 1, the arm with the head
    shift : metres from the joint to the parting line, towards the second arm
    lateral_offset : metres from the arm's centre line to the connector's centre line, to the left of the first arm
    setback : metres from the parting line to the end of each arm with a socket for a key or with a tab
    """

    kind: str
    size: ConnectorSize
    head_arm: int
    shift: float = 0.0
    lateral_offset: float = 0.0
    setback: float = 0.0

    def roles(self) -> tuple[str, str]:
        """Return the role of each arm: "head", "socket" or "face" (flat end of a tab)."""
        if self.kind == "dovetail":
            return ("head", "socket") if self.head_arm == 0 else ("socket", "head")
        one = "socket" if self.kind == "key" else "face"
        return one, one


@dataclass(frozen=True, eq=False)
class Tip:
    """End of one arm with its half of a connector.

    joined_arms, row : the arm is row ``row`` of ``joined_arms.own``
    widening : widening of this arm, a single row
    begin : tau at which the arm's edges end and ``end_curve`` begins
    end_curve : nodes and bulges of the arcs from the right edge at ``begin`` to the left edge there, in the arm's frame
    polygon : shapely polygon of the tip from tau ``inner_end`` outwards, in the patch's frame
    """

    joined_arms: JoinedArms
    row: int
    widening: Widening
    begin: float
    end_curve: tuple[Complex[np.ndarray, " nodes"], Float[np.ndarray, " nodes"]]
    polygon: Any

    @property
    def shoulder_radii(self) -> tuple[float, ...]:
        """Radii in metres of the arcs between the arm's edges and the straight end of the tip."""
        nodes, bulge = self.end_curve
        chords = (abs(nodes[1] - nodes[0]), bulge[0]), (abs(nodes[-1] - nodes[-2]), bulge[-2])
        return tuple(float(chord * (1.0 + b**2) / (4.0 * abs(b))) for chord, b in chords if b)

    @property
    def arm(self) -> int:
        """Index of the arm, 4 quad + side."""
        return int(self.joined_arms.own.arm[self.row])

    @property
    def patch(self) -> int:
        """The patch of the arm."""
        return int(self.joined_arms.own.patch[self.row])

    @property
    def inner_end(self) -> float:
        """Parameter t from which on, towards the hub, the arm is not widened."""
        return float(self.widening.taper_end[0])

    @property
    def arm_without_tip(self) -> Any:
        """The arm without its tip, a shapely polygon in the patch's frame."""
        import shapely

        own = self.joined_arms.own.subset(np.array([self.row]))
        t = np.linspace(max(self.inner_end, 0.0), float(own.t_max[0]) / ARM_SHARE, SAMPLES)[None]
        ring = np.concatenate([own.edge_points(t, LEFT)[0], own.edge_points(t[:, ::-1], RIGHT)[0]], axis=1)
        return shapely.Polygon(to_points(own.in_patch_frames(ring)[0]))


def end_curves(tips: Sequence[Tip], tolerance: float) -> list[Curve]:
    """Return for every tip the curve from its arm's right edge to its left edge, in the patch's frame.

    If a tip extends beyond the joint, the curve includes the parts of its edges there, as arcs within ``tolerance``
    metres of the exact edges.
    """
    made = [tip.end_curve for tip in tips]
    long = [k for k, tip in enumerate(tips) if tip.begin < 0.0]
    for through in dict.fromkeys(tips[k].joined_arms for k in long):
        these = [k for k in long if tips[k].joined_arms is through]
        rows = np.array([tips[k].row for k in these] * 2)
        wide = Widening(*(np.concatenate([getattr(tips[k].widening, n) for k in these] * 2) for n in _WIDENING))
        begin, side = np.array([tips[k].begin for k in these] * 2), np.repeat([RIGHT, LEFT], len(these))
        drawn = through.subset(rows).edges_beyond_joint(begin, side, wide, tolerance)
        for k, right, left in zip(these, drawn, drawn[len(these) :], strict=False):
            back, (nodes, bulge) = left.reversed(), made[k]
            nodes = np.concatenate([to_complex(right.points[:-1]), nodes[:-1], to_complex(back.points)])
            made[k] = nodes, np.concatenate([right.bulge[:-1], bulge[:-1], back.bulge])
    placed = []
    for tip, (nodes, bulge) in zip(tips, made, strict=True):
        own = tip.joined_arms.own
        placed.append(Curve(to_points(own.origin[tip.row] + own.outwards[tip.row] * nodes), bulge, closed=False))
    return placed


@dataclass(frozen=True, eq=False)
class _EndShape:
    """The end curve of a tip between its two shoulders, where it does not depend on the arm's edges.

    The origin is where the centre line of the connector meets the parting line; the real axis points outwards.

    x : position of the straight shoulders, metres
    nodes, bulge : complex nodes of the curve without the outer ends of the shoulders, and bulges of its segments
    low, high : smallest and largest y of the nodes
    samples : (M,) complex points on the curve
    """

    x: float
    nodes: np.ndarray
    bulge: np.ndarray
    low: float
    high: float
    samples: np.ndarray


@lru_cache(maxsize=4096)
def _end_shape(role: str, s: ConnectorSize, setback: float) -> _EndShape:
    """Return the end curve of an arm with the role "head", "socket" or "face" in a connector of size ``s``.

    setback : metres from the parting line to the end of the arm; has no effect on heads
    """
    curve = (
        head_curve(s) if role == "head" else socket_curve(s, setback) if role == "socket" else face_curve(s, setback)
    )
    nodes = to_complex(curve.points[1:-1])
    inner = Curve(curve.points[1:-1], curve.bulge[1:-1], closed=False)
    sampled = to_complex(inner.sample(_TOLERANCE)) if len(nodes) else nodes
    y = nodes.imag if len(nodes) else np.zeros(1)
    return _EndShape(float(curve.points[0, 0]), nodes, curve.bulge[1:-1], float(y.min()), float(y.max()), sampled)


def make_tips(
    joined_arms: JoinedArms,
    rows: np.ndarray,
    roles: Sequence[str],
    candidates: Sequence[ConnectorCandidate],
    shift: Float[np.ndarray, " arms"],
    lateral_offset: Float[np.ndarray, " arms"],
) -> list[Tip | None]:
    """Return the tips of the arms in rows ``rows`` of ``joined_arms.own``; None where an arm has no room for its tip.

    joined_arms : both arms of all joints
    rows : (n,) index of the joint of every tip
    roles : (n,) "head", "socket" or "face" of every tip
    candidates : (n,) candidate connector of every tip
    shift : (n,) metres from the joint outwards to the parting line
    lateral_offset : (n,) metres from the arm's centre line to that of the connector, to the left looking outwards
    """
    found: list[Tip | None] = [None] * len(rows)
    through = joined_arms.subset(rows)
    size = {n: np.array([getattr(a.size, n) for a in candidates]) for n in ConnectorSize.__dataclass_fields__}
    back, role = np.array([a.setback for a in candidates]), np.array(roles)
    point, way, width = through.centre_lines(through.tau_at(-shift[:, None])[:, 0])
    extra = np.maximum(size["pad_width"] - width, 0.0)
    lateral_offset = np.clip(lateral_offset, -0.5 * extra, 0.5 * extra)
    edge_ends = back + 0.5 * size["clearance"] + size["rounding"]
    taper_start, taper_end, begin, good = _tapers(through, role, size, back, extra, shift, edge_ends)
    wide = Widening(0.5 * extra + lateral_offset, 0.5 * extra - lateral_offset, taper_start, taper_end)
    good[good] = ~through.subset(good).have_folded_edge(begin[good], taper_start[good], wide.subset(good))
    k = np.flatnonzero(good)
    if not len(k):
        return found
    shapes = [_end_shape(str(role[i]), candidates[i].size, candidates[i].setback) for i in k.tolist()]
    through, wide, point, way, lateral_offset = through.subset(k), wide.subset(k), point[k], way[k], lateral_offset[k]
    begin, wide = _round_shoulders(shapes, through, wide, (edge_ends - shift)[k], size["rounding"][k], point, way)
    tau = begin[:, None] + (wide.taper_end - begin)[:, None] * np.linspace(0.0, 1.0, SAMPLES)
    (left, right), (left_way, right_way) = through.edge_points(tau, wide)
    straight = _runs_straight(left, right, left_way, right_way)
    shoulders, fits = _shoulder_arcs(shapes, lateral_offset, (right[:, 0] - point) / way, right_way[:, 0] / way,
                                 (left[:, 0] - point) / way, left_way[:, 0] / way)  # fmt: skip
    keep = np.flatnonzero(straight & fits)
    # refuse sockets beside which the walls are too thin: where an arm is curved, they are thinner than ``size.wall``
    with_socket = keep[role[k[keep]] == "socket"]
    inner = [point[i] + way[i] * (shapes[i].samples + 1j * lateral_offset[i]) for i in with_socket.tolist()]
    thin = wall_thicknesses(inner, left[with_socket], right[with_socket]) < 0.999 * size["thinnest"][k[with_socket]]
    keep = np.setdiff1d(keep, with_socket[thin])
    if not len(keep):
        return found
    across = _end_nodes(shapes, keep, shoulders, lateral_offset, left[:, 0], right[:, 0], point, way)
    rings = []
    for i, (nodes, _), turned, returning in zip(keep.tolist(), *across, strict=True):
        end = point[i] + way[i] * (shapes[i].samples + 1j * lateral_offset[i])
        ring = np.concatenate([right[i, :0:-1], turned, nodes[1:2], end, returning, left[i]])
        rings.append(through.own.origin[i] + through.own.outwards[i] * ring)
    polygons = make_polygons(rings)
    for i, curve, polygon in zip(keep.tolist(), across[0], polygons, strict=True):
        if polygon is not None:
            found[k[i]] = Tip(joined_arms, int(rows[k[i]]), wide.subset(np.array([i])), float(begin[i]), curve, polygon)
    return found


def _tapers(
    through: JoinedArms,
    role: np.ndarray,
    size: dict[str, np.ndarray],
    back: np.ndarray,
    extra: np.ndarray,
    shift: np.ndarray,
    edge_ends: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return where widened tips begin and end along their arms, as parameters tau, and which arms have that room.

    through, role, size : (n,) arms seen from their tips, roles of the tips, and fields of their connectors' sizes
    back, extra : (n,) setback of each tip, and width added to its arm, metres
    shift, edge_ends : (n,) metres from the joint outwards to the parting line, and from there inwards to the shoulder

    Returns
    -------
    start and end of the taper, end of the edges at the shoulder, and mask of the arms with room
    """
    deep = back + _full_width_length(role, size, edge_ends - back)
    flared = [deep + share * extra for share in (0.0, *_FLARE[::-1])]
    taper_start, min_taper_end, taper_end, begin = through.tau_at(
        np.stack([*flared, edge_ends], axis=1) - shift[:, None]
    ).T
    # the widening must not end beyond the joint, where tau < 0: there it ends at the joint
    taper_end = np.maximum(np.minimum(taper_end, through.own.t_max), 0.0)
    too_short = (taper_end < min_taper_end) | (begin >= taper_start)
    return taper_start, taper_end, begin, ~(too_short | (-begin * through.parameter_scale > through.other.t_max))


def _full_width_length(
    role: np.ndarray, size: dict[str, np.ndarray], shoulder: np.ndarray
) -> Float[np.ndarray, " arms"]:
    """Return the length (n,) in metres, from the ends of arms inwards, over which they keep their full width.

    role : (n,) "head", "socket" or "face"
    size : fields of ``ConnectorSize`` by name, each (n,)
    shoulder : (n,) distance in metres from the ends of the arms to the inner ends of their rounded shoulders
    """
    head = np.maximum(_BEHIND_HEAD * size["neck"], shoulder + _MIN_FULL_WIDTH * size["rounding"])
    socket = size["length"] + size["clearance"] + 0.5 * size["inside_radius"]
    return np.select([role == "head", role == "socket"], [head, socket], size["neck"])


def _runs_straight(left: np.ndarray, right: np.ndarray, left_way: np.ndarray, right_way: np.ndarray) -> np.ndarray:
    """Return a mask (n,) of the tips whose two edges run in the same direction and do not fold.

    left, right : (n, samples) complex points of the edges
    left_way, right_way : (n, samples) complex unit tangents there
    """
    steps = np.abs(np.diff(left, axis=1)), np.abs(np.diff(right, axis=1))
    same = ((left_way * right_way.conj()).real > 0.0).all(axis=1)
    return same & (np.minimum(*steps) >= MIN_STEP_RATIO * np.maximum(*steps)).all(axis=1)


def _round_shoulders(
    shapes: Sequence[_EndShape], through: JoinedArms, wide: Widening, distance: np.ndarray, rounding: np.ndarray,
    point: np.ndarray, way: np.ndarray,
) -> tuple[np.ndarray, Widening]:  # fmt: skip
    """Return the tau (n,) at which the edges of tips end, and the widening for these ends.

    An arc joins the end of each edge to the straight shoulder. The edges of a curved arm are shortened until both arcs
    have the required radius; where the arm has too little room for this, they end at the initial distance. The widening
    returned keeps its full amount up to the ends of the edges.

    distance : (n,) metres along the centre lines from the joints to the ends of the edges if the arms were straight
    rounding : (n,) required radius of the arcs, metres
    point, way : (n,) end of the centre line at the parting line and its outward unit direction, complex
    """
    x, first = np.array([s.x for s in shapes]), through.tau_at(distance[:, None])[:, 0]
    begin = first
    for _ in range(_ROUNDING_STEPS):
        edges, ways = (e[..., 0] for e in through.edge_points(begin[:, None], wide))
        radius = _shoulder_radii(x, (edges - point) / way, ways / way)
        lean = 1.0 + (_TURNS * ways / way).real
        distance = distance + np.clip(((rounding - radius) * lean).max(axis=0), 0.0, rounding)
        begin = through.tau_at(distance[:, None])[:, 0]
    full = np.maximum(wide.taper_start, through.tau_at(distance[:, None] + _MIN_FULL_WIDTH * rounding[:, None])[:, 0])
    room = (full < wide.taper_end) | (full == wide.taper_start)
    return np.where(room, begin, first), replace(wide, taper_start=np.where(room, full, wide.taper_start))


def _shoulder_radii(x: np.ndarray, points: np.ndarray, ways: np.ndarray) -> np.ndarray:
    """Return the radii (2, n) in metres of the arcs that join left and right edges to the straight shoulders.

    x : (n,) position of the shoulders
    points, ways : (2, n) complex ends of the edges and outward unit tangents there, with the real axis along x
    """
    return np.asarray((x - points.real) / (1.0 + (_TURNS * ways).real))


_Shoulders = tuple[tuple[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]


def _shoulder_arcs(
    shapes: Sequence[_EndShape], lateral_offset: np.ndarray, right: np.ndarray, right_way: np.ndarray, left: np.ndarray,
    left_way: np.ndarray,
) -> tuple[_Shoulders, np.ndarray]:  # fmt: skip
    """Return the arcs between the edges and the straight shoulders of tips, and a mask (n,) of tips with room for them.

    Each arc is tangent to an edge and to the shoulder. It is returned as the y (n,) where it meets the shoulder, and
    its bulge (n,); the pair for the right shoulder comes first.

    lateral_offset : (n,) metres from the arm's centre line to that of the connector, to the left
    right, left : (n,) complex ends of the edges, relative to the end of the centre line and its outward direction
    right_way, left_way : (n,) outward unit tangents of the edges there
    """
    x = np.array([s.x for s in shapes])
    made, fits = [], np.ones(len(x), dtype=bool)
    left_radius, right_radius = _shoulder_radii(x, np.stack([left, right]), np.stack([left_way, right_way]))
    for point, way, turn, radius in ((right, right_way, 1j, right_radius), (left, left_way, -1j, left_radius)):
        angle = np.angle(1j / way if turn == 1j else -way / 1j)
        made.append(((point + radius * turn * way).imag, np.tan(0.25 * angle)))
        fits &= radius > 0.0
    low, high = (np.array([getattr(s, n) for s in shapes]) for n in ("low", "high"))
    moved = np.where([len(s.nodes) > 0 for s in shapes], lateral_offset, 0.0)
    fits &= (made[0][0] <= low + moved) & (made[1][0] >= high + moved)
    return (made[0], made[1]), fits


_Nodes = tuple[np.ndarray, np.ndarray]


def _end_nodes(
    shapes: Sequence[_EndShape], rows: np.ndarray, shoulders: _Shoulders, lateral_offset: np.ndarray, left: np.ndarray,
    right: np.ndarray, point: np.ndarray, way: np.ndarray,
) -> tuple[list[_Nodes], list[np.ndarray], list[np.ndarray]]:  # fmt: skip
    """Return nodes and bulges of the end curves of the tips ``rows``, from right to left edge, in the arms' frames.

    Also return complex points on the arcs at the right and at the left shoulder, without the last point of each.

    shapes : end curves between the shoulders
    shoulders : arcs returned by ``_shoulder_arcs``
    lateral_offset : (n,) metres from the arm's centre line to that of the connector, to the left
    left, right : (n,) complex ends of the edges
    point, way : (n,) complex end of the centre line and its outward unit direction
    """
    x = np.array([shapes[i].x for i in rows.tolist()])
    (right_y, right_bulge), (left_y, left_bulge) = ((y[rows], bulge[rows]) for y, bulge in shoulders)
    one, two = (point[rows] + way[rows] * (x + 1j * y) for y in (right_y, left_y))
    found = []
    for k, i in enumerate(rows.tolist()):
        inner = point[i] + way[i] * (shapes[i].nodes + 1j * lateral_offset[i])
        nodes = np.concatenate([[right[i], one[k]], inner, [two[k], left[i]]])
        found.append((nodes, np.concatenate([[right_bulge[k], 0.0], shapes[i].bulge, [left_bulge[k], 0.0]])))
    turned = _sample_arcs(to_points(right[rows]), to_points(one), right_bulge)
    back = _sample_arcs(to_points(two), to_points(left[rows]), left_bulge)
    return found, turned, back


def _sample_arcs(a: np.ndarray, b: np.ndarray, bulge: np.ndarray) -> list[np.ndarray]:
    """Return complex points on every arc from point ``a`` to point ``b`` (n, 2) with ``bulge`` (n,), without ``b``."""
    points, count = sample_arcs(a, b, bulge, _TOLERANCE)
    return np.split(to_complex(points), np.cumsum(count)[:-1])
