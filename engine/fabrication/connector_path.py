"""The arm that runs through a joint, from one panel into the other, and the ends that it gets where it is parted.

Every arm has a frame of its own here, as complex numbers: the joint is 0, the arm runs out along the real axis. Seen from
the other arm everything is turned by half a turn. Places are given by the parameter tau: t of the arm itself, and below
0, beyond the joint, t of the other arm in the same measure of length.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ..spirals.arcs import Curve, fit
from ..spirals.design import SpiralDesign
from ..spirals.spiral import LEFT, RIGHT, Arms, centre_line, edge, widening, width_at
from .connector_shape import Size, face, head, socket

_FLARE = (
    1.3,
    0.5,
)  # length over which a tip narrows to its arm, as a share of what it is wider: as a rule, and at the least
_UNFOLDED = 0.15  # least speed along an edge of a tip, as a share of that along its other edge; at 0 the edge folds
_REACH = 0.85  # share of an arm, from its tip to its hub, that a connector may take
_BEHIND_HEAD = 0.3  # necks; how far an arm with a head keeps its full width behind the shoulder
_SAMPLES = 41
_TABLE = 41
_STEPS = 160


def complexes(points: np.ndarray) -> np.ndarray:
    """Points (..., 2) as complex numbers."""
    return points[..., 0] + 1j * points[..., 1]


def pairs(numbers: np.ndarray) -> np.ndarray:
    """Complex numbers as points (..., 2)."""
    return np.stack([numbers.real, numbers.imag], axis=-1)


@dataclass(frozen=True)
class Attempt:
    """One way to make a connector.

    kind : dovetail, key or tab; size : its measures; male : 0 or 1, the arm with the head
    shift : metres from the joint to the parting line, towards the second arm
    aside : metres from the arm's centre line to the connector's, to the left of the first arm
    back : metres that both faces stand back from the parting line
    """

    kind: str
    size: Size
    male: int
    shift: float = 0.0
    aside: float = 0.0
    back: float = 0.0

    def roles(self) -> tuple[str, str]:
        """What the two arms get: head, socket or face."""
        if self.kind == "dovetail":
            return ("head", "socket") if self.male == 0 else ("socket", "head")
        one = "socket" if self.kind == "key" else "face"
        return one, one


@dataclass(frozen=True, eq=False)
class Widening:
    """How much an arm is wider at its tip: ``left`` and ``right`` metres up to tau ``full``, nothing from tau ``over`` on."""

    left: float
    right: float
    full: float
    over: float

    def at(self, tau: np.ndarray, side: np.ndarray | float) -> tuple[np.ndarray, np.ndarray]:
        """What to add to the width for this edge, and its derivative; an edge moves by half of that."""
        return widening(2.0 * np.where(side == LEFT, self.left, self.right), self.full, self.over, tau)


@dataclass(frozen=True, eq=False)
class Half:
    """One arm of a joint by itself: ``arm`` is 4 quad + side; origin and direction of its frame in that of its patch."""

    arm: int
    patch: int
    arms: Arms
    origin: complex
    out: complex
    t: np.ndarray
    length: np.ndarray
    speed: float
    end: float

    @staticmethod
    def of(design: SpiralDesign, quad: int, side: int) -> Half:
        """The half of a joint that the arm ``side`` of ``quad`` is."""
        roots = design.roots
        single = design.arms.one_by_one(np.array([quad]), np.array([side]))
        end = float(min(roots.left[quad, side], roots.right[quad, side - 1]))
        t = np.linspace(0.0, end, _TABLE)
        p, d, _ = (complexes(x[0, 0]) for x in centre_line(single, t[None, None]))
        length = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(p)))])
        patch = int(design.flat.layout.patch_of[quad])
        return Half(4 * quad + side, patch, single, p[0], -d[0] / abs(d[0]), t, length, abs(d[0]), _REACH * end)

    def local(self, points: np.ndarray) -> np.ndarray:
        """From the patch's frame to the arm's."""
        return (points - self.origin) / self.out

    def placed(self, points: np.ndarray) -> np.ndarray:
        """From the arm's frame to the patch's."""
        return self.origin + self.out * points

    def edge(
        self, t: np.ndarray, side: np.ndarray | float, wider: tuple[np.ndarray, np.ndarray] | None = None
    ) -> np.ndarray:
        """(2, N) points of an edge and their derivative by t, in the arm's frame."""
        wide = None if wider is None else (wider[0][None, None], wider[1][None, None])
        p, d = edge(self.arms, t[None, None], side, wider=wide)
        return np.stack([self.local(complexes(p[0, 0])), complexes(d[0, 0]) / self.out])


@dataclass(frozen=True, eq=False)
class Through:
    """The whole arm through a joint, seen from one of its two halves."""

    own: Half
    other: Half

    @cached_property
    def turned(self) -> Through:
        """The same, seen from the other half."""
        return Through(self.other, self.own)

    @cached_property
    def steps(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Steps along the arm as it is: tau (N,) in their middles, lengths (2, N) of the left and the right edge, widths (N,)."""
        tau = np.linspace(-self.other.end / self.scale, self.own.end, _STEPS + 1)
        edges = self.edges(tau, Widening(0.0, 0.0, 0.0, 0.0))[0]
        wide = np.abs(edges[0] - edges[1])
        return 0.5 * (tau[1:] + tau[:-1]), np.abs(np.diff(edges, axis=1)), 0.5 * (wide[1:] + wide[:-1])

    def folds(self, begin: float, full: float, wide: Widening) -> bool:
        """Whether an edge would fold between two tau if the arm were as much wider there; for parallel curves, quickly."""
        tau, (left, right), width = self.steps
        here = (tau > begin) & (tau < full)
        turn = (left - right)[here] / width[here]
        one, two = left[here] + turn * wide.left, right[here] - turn * wide.right
        return bool((np.minimum(one, two) < _UNFOLDED * np.maximum(one, two)).any())

    @property
    def scale(self) -> float:
        """How much t of the other arm is worth one of this."""
        return self.own.speed / self.other.speed

    def tau(self, distance: float) -> float:
        """The parameter at a distance in metres along the arm from the joint; beyond the joint if negative."""
        if distance >= 0.0:
            return float(np.interp(distance, self.own.length, self.own.t))
        return -float(np.interp(-distance, self.other.length, self.other.t)) / self.scale

    def centre(self, tau: float) -> tuple[complex, complex, float]:
        """Point and outward unit direction of the centre line, and the width of the arm."""
        known = self.__dict__.setdefault("_centres", {})
        if tau not in known:
            known[tau] = self._centre(tau)
        return known[tau]

    def _centre(self, tau: float) -> tuple[complex, complex, float]:
        half, t, sign = (self.own, tau, 1.0) if tau >= 0.0 else (self.other, -tau * self.scale, -1.0)
        p, d, _ = (complexes(x[0, 0]) for x in centre_line(half.arms, np.array([[[t]]])))
        direction = -d[0] / half.out  # outwards, from the one half into the other
        width = float(width_at(half.arms, np.array([[[t]]]))[0][0, 0, 0])
        return complex(sign * half.local(p)[0]), complex(direction / abs(direction)), width

    def edges(self, tau: np.ndarray, wide: Widening) -> tuple[np.ndarray, np.ndarray]:
        """Points (2, N) of the widened arm's left and right edge and the outward directions there, in the arm's frame."""
        side, both = np.repeat([LEFT, RIGHT], len(tau)), np.tile(tau, 2)
        extra, slope = wide.at(both, side)
        inside = both >= 0.0
        made = np.empty((2, len(both)), dtype=complex)
        if inside.any():
            made[:, inside] = self.own.edge(both[inside], side[inside], (extra[inside], slope[inside]))
        if not inside.all():
            beyond = ~inside
            t = -both[beyond] * self.scale
            far = self.other.edge(t, -side[beyond], (extra[beyond], -slope[beyond] / self.scale))
            made[0, beyond], made[1, beyond] = -far[0], far[1]
        points, ways = made[0], -made[1] / np.abs(made[1])
        return points.reshape(2, -1), ways.reshape(2, -1)

    def beyond(self, tau: float, side: float, wide: Widening, tolerance: float) -> Curve:
        """The edge from the joint to tau < 0 as arcs, walking outwards."""
        other = self.other

        def evaluate(which: np.ndarray, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            extra, slope = wide.at(-t[0] / self.scale, side)
            p, d = other.edge(t[0], -side, (extra, -slope / self.scale))
            return pairs(-p)[None], pairs(-d)[None]

        ends = np.array([[0.0, -tau * self.scale]])
        fitted = fit(evaluate, ends, tolerance)
        last = evaluate(np.zeros(1, dtype=int), ends[:, 1:])[0][0]
        return Curve(np.concatenate([fitted.points, last]), np.append(fitted.bulge, 0.0), closed=False)


@dataclass(frozen=True, eq=False)
class Tip:
    """One arm's end with its part of a connector.

    through : the arm; wide : how it is widened; begin : tau where the edges end
    across : from the right edge at ``begin`` to the left one, in the arm's frame
    polygon : shapely's, from ``over`` outwards, in the patch's frame
    """

    through: Through
    wide: Widening
    begin: float
    across: Curve
    polygon: Any

    @property
    def arm(self) -> int:
        """4 quad + side."""
        return self.through.own.arm

    @property
    def patch(self) -> int:
        """The patch of the arm."""
        return self.through.own.patch

    @property
    def beside(self) -> Any:
        """Its polygon in the frame of the other half's patch, both panels lying side by side."""
        import shapely

        own, other = self.through.own, self.through.other
        return shapely.transform(self.polygon, lambda p: pairs(other.placed(-own.local(complexes(p)))))

    @property
    def rest(self) -> Any:
        """The remaining arm, shapely's polygon in the patch's frame."""
        import shapely

        own = self.through.own
        t = np.linspace(max(self.wide.over, 0.0), own.end / _REACH, _SAMPLES)
        ring = np.concatenate([own.edge(t, LEFT)[0], own.edge(t[::-1], RIGHT)[0]])
        return shapely.Polygon(pairs(own.placed(ring)))

    def end(self, tolerance: float) -> Curve:
        """From the arm's right to its left edge, beginning with the parts beyond the joint, in the patch's frame."""
        made = self.across
        if self.begin < 0.0:
            right, left = (self.through.beyond(self.begin, s, self.wide, tolerance) for s in (RIGHT, LEFT))
            left = left.reversed()
            made = Curve(
                np.concatenate([right.points[:-1], made.points[:-1], left.points]),
                np.concatenate([right.bulge[:-1], made.bulge[:-1], left.bulge]),
                closed=False,
            )
        return Curve(pairs(self.through.own.placed(complexes(made.points))), made.bulge, closed=False)


def make_tip(through: Through, role: str, a: Attempt, shift: float, aside: float) -> Tip | None:
    """The end of one arm; ``None`` where the arm is too short for it. ``shift`` and ``aside`` as this arm sees them."""
    import shapely

    s, back = a.size, a.back
    point, way, width = through.centre(through.tau(-shift))
    extra = max(s.pad - width, 0.0)
    aside = float(np.clip(aside, -0.5 * extra, 0.5 * extra))
    deep = back + (
        _BEHIND_HEAD * s.neck
        if role == "head"
        else s.length + s.clearance + 0.5 * s.inside
        if role == "socket"
        else s.neck
    )
    full, least, over = (through.tau(deep + share * extra - shift) for share in (0.0, *_FLARE[::-1]))
    over = min(over, through.own.end)
    begin = through.tau(back + 0.5 * s.clearance + s.rounding - shift)
    if over < least or begin >= full or -begin * through.scale > through.other.end:
        return None
    wide = Widening(0.5 * extra + aside, 0.5 * extra - aside, full, over)
    if through.folds(begin, full, wide):
        return None
    tau = np.linspace(begin, over, _SAMPLES)
    (left, right), (left_way, right_way) = through.edges(tau, wide)
    steps = np.abs(np.diff(left)), np.abs(np.diff(right))
    if (left_way * right_way.conj()).real.min() <= 0.0 or (
        np.min(steps, axis=0) < _UNFOLDED * np.max(steps, axis=0)
    ).any():
        return None
    curve = head(s) if role == "head" else socket(s, back) if role == "socket" else face(s, back)

    def seen(p: np.ndarray) -> complex:
        return complex((p - point) / way)

    across = _across(
        Curve(curve.points + np.array([0.0, aside]), curve.bulge, closed=False),
        (seen(right[0]), complex(right_way[0] / way)),
        (seen(left[0]), complex(left_way[0] / way)),
    )
    if across is None:
        return None
    across = Curve(pairs(point + way * complexes(across.points)), across.bulge, closed=False)
    if role == "socket" and _wall(across, left, right) < 0.999 * s.thinnest:
        return None
    ring = np.concatenate([right[:0:-1], complexes(across.sampled(5e-6)), left[1:]])
    polygon = shapely.Polygon(pairs(through.own.placed(ring)))
    return Tip(through, wide, begin, across, polygon) if polygon.is_valid else None


def _wall(across: Curve, left: np.ndarray, right: np.ndarray) -> float:
    """Metres: the thinnest place between a socket and the edges of its arm, which are bent where the arm is."""
    import shapely

    inner = Curve(across.points[2:-2], across.bulge[2:-2], closed=False).sampled(5e-6)
    return min(float(shapely.LineString(inner).distance(shapely.LineString(pairs(e)))) for e in (left, right))


def _across(curve: Curve, right: tuple[complex, complex], left: tuple[complex, complex]) -> Curve | None:
    """The end of an arm from its right to its left edge, given as end point and outward direction of either edge.

    The corners between the edges and the curve's straight ends are rounded by arcs that touch both.
    """
    x = float(curve.points[0, 0])
    ends = []
    for (point, way), turn in ((right, 1j), (left, -1j)):
        radius = (x - point.real) / (1.0 + (turn * way).real)
        y = (point + radius * turn * way).imag
        ends.append((radius, y, float(np.angle(1j / way if turn == 1j else -way / 1j))))
    inner = curve.points[1:-1]
    low, high = (inner[:, 1].min(), inner[:, 1].max()) if len(inner) else (0.0, 0.0)
    if min(ends[0][0], ends[1][0]) <= 0.0 or ends[0][1] > low or ends[1][1] < high:
        return None
    points = [[right[0].real, right[0].imag], [x, ends[0][1]], *inner.tolist(), [x, ends[1][1]]]
    bulge = [np.tan(0.25 * ends[0][2]), 0.0, *curve.bulge[1:-1].tolist(), np.tan(0.25 * ends[1][2]), 0.0]
    return Curve(np.array([*points, [left[0].real, left[0].imag]]), np.array(bulge), closed=False)
