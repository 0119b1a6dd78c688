"""Families of smooth surfaces on regular grids: round a pole, tubes, tori, knots, minimal surfaces, saddles, strips."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from flexmaps.engine.surface import shapes
from flexmaps.engine.surface.mesh import QuadMesh

from . import pieces

PI = np.pi
Points = Sequence[np.ndarray]


def steps(low: float, high: float, count: int) -> np.ndarray:
    """The ends of ``count`` equal intervals."""
    return np.linspace(low, high, count + 1)


def rings(count: int, inner: float = 0.15) -> np.ndarray:
    """Radii from a pole to 1; the first ring is wider than the others, so that its quads are no slivers."""
    return np.append(0.0, np.linspace(inner, 1.0, count))


def turn(count: int) -> np.ndarray:
    """``count`` angles once round."""
    return np.arange(count) * 2 * PI / count


# -- round a pole ------------------------------------------------------------------------------------------------------


def cap(sectors: int, rings: int, opening: float, squeeze: float = 1.0) -> QuadMesh:
    """A ball's cap, ``opening`` degrees from the pole to the rim; ``squeeze`` is its height over the ball's."""
    end = np.radians(opening)
    return pieces.polar(
        lambda r, a: (np.sin(r) * np.cos(a), np.sin(r) * np.sin(a), squeeze * np.cos(r)), steps(0, end, rings), sectors
    )


def cone(sectors: int, rings: int, slope: float) -> QuadMesh:
    """A cone with its tip."""
    return pieces.polar(lambda r, a: (r * np.cos(a), r * np.sin(a), slope * (1 - r)), steps(0, 1, rings), sectors)


def spindle(sectors: int, rings: int, length: float, sharp: float = 1.0) -> QuadMesh:
    """A closed body of revolution with two poles; the greater ``sharp``, the more pointed."""
    return pieces.polar(
        lambda t, a: (np.sin(t) ** sharp * np.cos(a), np.sin(t) ** sharp * np.sin(a), length * np.cos(t)),
        steps(0, PI, rings),
        sectors,
        two_poles=True,
    )


def flower(petals: int, sectors: int, count: int, depth: float) -> QuadMesh:
    """A disk round a pole whose rim goes up and down ``petals`` times."""
    return pieces.polar(
        lambda r, a: (r * np.cos(a), r * np.sin(a), depth * r**2 * np.cos(petals * a)), rings(count, 0.25), sectors
    )


def star(sectors: int, size: int, bend: float, kind: str = "dome", power: float = 3.0) -> QuadMesh:
    """Squares round one vertex of that valence, as a dome or as a saddle of as many waves as half the sectors."""
    if kind == "dome":
        return pieces.star(sectors, size, lambda x, y: (x, y, bend * (1 - x**2 - y**2)), power)
    waves = max(sectors // 2, 2)
    return pieces.star(sectors, size, lambda x, y: (x, y, bend * ((x + 1j * y) ** waves).real), power)


# -- tubes, tori, knots ------------------------------------------------------------------------------------------------


def revolved(radius: np.ndarray, height: np.ndarray, sectors: int) -> QuadMesh:
    """Open tube of revolution through radii at heights, both (n,)."""
    return pieces.sheet(
        lambda k, a: (
            radius[k.astype(int)] * np.cos(a),
            radius[k.astype(int)] * np.sin(a),
            height[k.astype(int)],
        ),
        np.arange(len(radius)),
        turn(sectors),
        (False, True),
    )


def cylinder(sectors: int, rings: int, length: float, taper: float = 1.0) -> QuadMesh:
    """A tube; ``taper`` is the radius of its upper rim over the lower one's, 1."""
    return revolved(steps(1, taper, rings), steps(0, length, rings), sectors)


def bellows(sectors: int, rings: int, folds: int, depth: float) -> QuadMesh:
    """A tube whose radius goes up and down."""
    along = steps(0, 1, rings)
    return revolved(1 + depth * np.cos(2 * PI * folds * along), 3.2 * along, sectors)


def vase(sectors: int, rings: int) -> QuadMesh:
    """A vase without bottom: belly, neck, lip."""
    t = steps(0, 1, rings)
    return revolved(0.55 + 0.45 * np.sin(PI * (1.25 * t + 0.12)) + 0.35 * t**4, 2.4 * t, sectors)


def hyperboloid(sectors: int, rings: int, waist: float, lean: float = 0.0) -> QuadMesh:
    """A cooling tower; its grid leans by ``lean`` radians from rim to rim."""
    return pieces.sheet(
        lambda z, a: (
            np.hypot(waist, z) * np.cos(a + lean * z),
            np.hypot(waist, z) * np.sin(a + lean * z),
            z,
        ),
        steps(-1, 1, rings),
        turn(sectors),
        (False, True),
    )


def elbow(sectors: int, rings: int) -> QuadMesh:
    """A pipe bend of a right angle."""
    t = steps(0, PI / 2, rings)
    curve = np.stack([2.2 * np.cos(t), 2.2 * np.sin(t), 0 * t], axis=1)
    return pieces.tube(curve, 1.0, sectors, closed=False)


def coil(sectors: int, rings: int, windings: float) -> QuadMesh:
    """An open pipe along a helix."""
    t = steps(0, 2 * PI * windings, rings)
    return pieces.tube(np.stack([np.cos(t), np.sin(t), 0.22 * t], axis=1), 0.4, sectors, closed=False)


def torus(around: int, across: int, ratio: float, slip: int = 0, egg: float = 1.0) -> QuadMesh:
    """A ring of tube radius ``ratio``; after once round, the grid joins itself ``slip`` rows further on.

    ``egg`` is the tube's height over its breadth.
    """

    def place(u: np.ndarray, v: np.ndarray) -> Points:
        v = v + slip * u / across
        radius = 1 + ratio * np.cos(v)
        return radius * np.cos(u), radius * np.sin(u), egg * ratio * np.sin(v)

    ends = pieces.sheet(place, steps(0, 2 * PI, around), turn(across), (False, True))
    return shapes.weld_quads(ends.vertices, ends.quads)


def knot(windings: int, wraps: int, along: int, sectors: int, radius: float) -> QuadMesh:
    """A torus knot as a tube: 2, 3 is the trefoil."""
    return pieces.tube(knot_curve(windings, wraps, along), radius, sectors, closed=True)


def knot_curve(windings: int, wraps: int, along: int) -> np.ndarray:
    """(along, 3) points of a torus knot."""
    t = turn(along)
    reach = 2 + np.cos(wraps * t)
    return np.stack([reach * np.cos(windings * t), reach * np.sin(windings * t), -np.sin(wraps * t)], axis=1)


def figure_eight_knot(along: int, sectors: int, radius: float) -> QuadMesh:
    """The knot of four crossings as a tube."""
    t = turn(along)
    curve = np.stack([(2 + np.cos(2 * t)) * np.cos(3 * t), (2 + np.cos(2 * t)) * np.sin(3 * t), np.sin(4 * t)], axis=1)
    return pieces.tube(curve, radius, sectors, closed=True)


# -- minimal surfaces --------------------------------------------------------------------------------------------------


def catenoid(sectors: int, rings: int, reach: float) -> QuadMesh:
    """A soap film between two rings."""
    z = steps(-reach, reach, rings)
    return revolved(np.cosh(z), z, sectors)


def helicoid(along: int, across: int, windings: float) -> QuadMesh:
    """A spiral ramp without a pillar."""
    return pieces.sheet(
        lambda u, v: (v * np.cos(u), v * np.sin(u), 0.5 * u),
        steps(0, 2 * PI * windings, along),
        steps(-1, 1, across),
    )


def enneper(side: int, reach: float) -> QuadMesh:
    """Enneper's surface on a square."""
    u = steps(-reach, reach, side)
    return pieces.sheet(lambda u, v: (u - u**3 / 3 + u * v**2, v - v**3 / 3 + v * u**2, u**2 - v**2), u, u)


def enneper_polar(folds: int, sectors: int, count: int, reach: float) -> QuadMesh:
    """Enneper's surface with more waves, round a pole."""

    def place(r: np.ndarray, a: np.ndarray) -> Points:
        z = r * np.exp(1j * a)
        n = folds - 1
        w = z - z.conj() ** (2 * n + 1) / (2 * n + 1)
        return w.real, w.imag, 2 * (z ** (n + 1)).real / (n + 1)

    return pieces.polar(place, reach * rings(count, 0.3), sectors)


def scherk(side: int) -> QuadMesh:
    """A piece of Scherk's surface: log (cos x / cos y)."""
    u = steps(-1.25, 1.25, side)
    return pieces.sheet(lambda x, y: (x, y, np.log(np.cos(x) / np.cos(y))), u, u)


def soap_frame(side: int, height: float, waves: int) -> QuadMesh:
    """A soap film in a square frame whose sides are waves."""
    u = steps(-1, 1, side)

    def place(x: np.ndarray, y: np.ndarray) -> Points:
        return x, y, height * np.sin(waves * np.arctan2(y, x))

    return pieces.soap_film(pieces.sheet(place, u, u))


# -- graphs over a square ----------------------------------------------------------------------------------------------


def saddle(columns: int, rows: int, bend: float, shear: float = 0.0, aspect: float = 1.0) -> QuadMesh:
    """x^2 - y^2 on a grid sheared by ``shear`` degrees, of quads ``aspect`` times as long as wide."""
    return _graph(columns, rows, lambda x, y: bend * (x**2 - y**2), shear, aspect)


def hypar(side: int, bend: float) -> QuadMesh:
    """x y: a square with straight sides and rulings, twisted."""
    return _graph(side, side, lambda x, y: bend * x * y)


def monkey(side: int, bend: float) -> QuadMesh:
    """x^3 - 3 x y^2."""
    return _graph(side, side, lambda x, y: bend * (x**3 - 3 * x * y**2))


def cushion(columns: int, rows: int, bend: float, shear: float = 0.0, aspect: float = 1.0) -> QuadMesh:
    """A hill of a cosine over a square, with level sides; arguments as in ``saddle``."""
    return _graph(
        columns, rows, lambda x, y: bend * (1 + np.cos(PI * x / 1.2)) * (1 + np.cos(PI * y / 1.2)) / 4, shear, aspect
    )


def barrel(columns: int, rows: int, arc: float, belly: float) -> QuadMesh:
    """A vault over ``arc`` degrees that bulges along its axis too, or, with a negative ``belly``, narrows."""
    end = np.radians(arc) / 2

    def place(a: np.ndarray, y: np.ndarray) -> Points:
        radius = 1 - belly * y**2
        return radius * np.sin(a), y, radius * np.cos(a)

    return pieces.sheet(place, steps(-end, end, columns), steps(-1, 1, rows))


def terrain(side: int, seed: int, length: float, height: float, octaves: int = 2) -> QuadMesh:
    """Random hills."""
    return _graph(
        side,
        side,
        lambda x, y: height * pieces.noise(np.stack([x, y], axis=1), seed, length, octaves),
    )


def graded(side: int, ratio: float, bend: float) -> QuadMesh:
    """A hill on a grid whose steps grow by the factor ``ratio`` from one corner to the opposite one."""
    lengths = ratio ** steps(0, 1, side - 1)
    u = np.append(0, np.cumsum(lengths)) / lengths.sum() * 2 - 1
    return pieces.sheet(lambda x, y: (x, y, bend * (2 - x**2 - y**2)), u, u)


def _graph(columns: int, rows: int, height: object, shear: float = 0.0, aspect: float = 1.0) -> QuadMesh:
    lean = np.tan(np.radians(shear))
    long, wide = columns * aspect / max(columns * aspect, rows), rows / max(columns * aspect, rows)

    def place(u: np.ndarray, v: np.ndarray) -> Points:
        x, y = u * long + lean * v * wide, v * wide
        return x, y, height(x / (1 + lean), y)  # type: ignore[operator]

    return pieces.sheet(place, steps(-1, 1, columns), steps(-1, 1, rows))


# -- strips ------------------------------------------------------------------------------------------------------------


def ramp(along: int, rows: int, windings: float) -> QuadMesh:
    """A strip along a helix."""
    t = steps(0, 2 * PI * windings, along)
    return pieces.ribbon(np.stack([np.cos(t), np.sin(t), 0.3 * t], axis=1), rows * 0.1, rows, closed=False)


def twisted_ring(along: int, rows: int, turns: float) -> QuadMesh:
    """A ring of a strip that turns about its middle line; half a turn gives the strip of Moebius."""
    t = turn(along)
    wide = rows * 2 * PI / along
    return pieces.ribbon(np.stack([np.cos(t), np.sin(t), 0 * t], axis=1), wide, rows, closed=True, turns=turns)


def knotted_strip(along: int, rows: int) -> QuadMesh:
    """A strip along a trefoil, with two sides."""
    curve = knot_curve(2, 3, along)
    return pieces.ribbon(curve, 0.16 * rows, rows, closed=True)


def wave_strip(along: int, rows: int, waves: int, height: float) -> QuadMesh:
    """A strip that goes up and down."""
    return pieces.sheet(
        lambda x, y: (x, y, height * np.sin(2 * PI * waves * x)),
        steps(0, 1, along),
        steps(0, rows / along, rows),
    )
