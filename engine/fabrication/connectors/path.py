"""The arms that run through joints, from one panel into the other.

Every arm has a frame of its own here, as complex numbers: the joint is 0, the arm runs out along the real axis. Seen from
the other arm everything is turned by half a turn. Places are given by the parameter tau: t of the arm itself, and below
0, beyond the joint, t of the other arm in the same measure of length. There are thousands of joints: all functions work
on many of them at once, one a row.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ...arrays import Bool, Complex, Float, Int
from ...spirals.arcs import Curve, fit
from ...spirals.design import SpiralDesign
from ...spirals.spiral import LEFT, RIGHT, Arms, centre_line, edge, widening, width_at

UNFOLDED = 0.15  # least speed along an edge of a tip, as a share of that along its other edge; at 0 the edge folds
ARM_SHARE = 0.85  # share of an arm, from its tip to its hub, that a connector may take
_TABLE = 41  # places along an arm of the table from length to parameter; not measured
_FOLDS = 41  # places along a tip where its edges are looked at for folds; not measured


def complexes(points: Float[np.ndarray, "... 2"]) -> np.ndarray:
    """Points as complex numbers."""
    return points[..., 0] + 1j * points[..., 1]


def pairs(numbers: np.ndarray) -> Float[np.ndarray, "... 2"]:
    """Complex numbers as points."""
    return np.stack([numbers.real, numbers.imag], axis=-1)


def _interpolated(x: np.ndarray, known: np.ndarray, values: np.ndarray) -> np.ndarray:
    """(n, M): ``values`` (n, K) at x (n, M), between ascending ``known`` (n, K), the ends beyond; row by row as np.interp."""
    rows = np.arange(len(known))[:, None]
    x = np.clip(x, known[:, :1], known[:, -1:])
    step = 1.01 * float(known.max(initial=0.0)) + 1e-12
    cell = np.searchsorted((known + step * rows).ravel(), x + step * rows, side="right") - 1 - rows * known.shape[1]
    cell = np.clip(cell, 0, known.shape[1] - 2)
    low, high = known[rows, cell], known[rows, cell + 1]
    share = (x - low) / np.maximum(high - low, 1e-300)
    return values[rows, cell] * (1.0 - share) + values[rows, cell + 1] * share


@dataclass(frozen=True, eq=False)
class Widening:
    """How much arms are wider at their tips: ``left`` and ``right`` metres up to tau ``full``, nothing from ``over`` on."""

    left: Float[np.ndarray, " arms"]
    right: Float[np.ndarray, " arms"]
    full: Float[np.ndarray, " arms"]
    over: Float[np.ndarray, " arms"]

    def at(self, tau: np.ndarray, side: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """What to add to the widths at tau (n, M) for edges that broadcast with it, and the derivative; an edge moves by half."""
        extra = 2.0 * np.where(side == LEFT, self.left[:, None], self.right[:, None])
        return widening(extra, self.full[:, None], self.over[:, None], tau)

    def rows(self, which: np.ndarray) -> Widening:
        """Some of the rows."""
        return Widening(self.left[which], self.right[which], self.full[which], self.over[which])


@dataclass(frozen=True, eq=False)
class Halves:
    """One arm each of n joints by itself.

    arm : 4 quad + side; patch : its patch; origin, out : origin and direction of its frame in that of its patch, complex
    t, length : table of metres along the centre line from the joint; speed : metres per t at the joint
    end : t up to which a connector may take it
    """

    arm: Int[np.ndarray, " arms"]
    patch: Int[np.ndarray, " arms"]
    arms: Arms
    origin: Complex[np.ndarray, " arms"]
    out: Complex[np.ndarray, " arms"]
    t: Float[np.ndarray, "arms table"]
    length: Float[np.ndarray, "arms table"]
    speed: Float[np.ndarray, " arms"]
    end: Float[np.ndarray, " arms"]

    @staticmethod
    def of(design: SpiralDesign, quad: Int[np.ndarray, " arms"], side: Int[np.ndarray, " arms"]) -> Halves:
        """The halves of joints that the arms ``side`` of ``quad`` are."""
        roots = design.roots
        single = design.arms.one_by_one(quad, side)
        end = np.minimum(roots.left[quad, side], roots.right[quad, side - 1])
        t = end[:, None] * np.linspace(0.0, 1.0, _TABLE)
        p, d, _ = (complexes(x[:, 0]) for x in centre_line(single, t[:, None]))
        length = np.concatenate([np.zeros((len(t), 1)), np.cumsum(np.abs(np.diff(p, axis=1)), axis=1)], axis=1)
        speed = np.abs(d[:, 0])
        patch = design.flat.layout.patch_of[quad]
        return Halves(4 * quad + side, patch, single, p[:, 0], -d[:, 0] / speed, t, length, speed, ARM_SHARE * end)

    def rows(self, which: np.ndarray) -> Halves:
        """Some of the arms."""
        rest = {n: getattr(self, n)[which] for n in self.__dataclass_fields__ if n != "arms"}
        return Halves(arms=self.arms.of(which), **rest)

    def local(self, points: Complex[np.ndarray, "arms ..."]) -> Complex[np.ndarray, "arms ..."]:
        """From the patches' frames to the arms'."""
        shape = (-1, *(1,) * (points.ndim - 1))
        return (points - self.origin.reshape(shape)) / self.out.reshape(shape)

    def placed(self, points: Complex[np.ndarray, "arms ..."]) -> Complex[np.ndarray, "arms ..."]:
        """From the arms' frames to the patches'."""
        shape = (-1, *(1,) * (points.ndim - 1))
        return self.origin.reshape(shape) + self.out.reshape(shape) * points

    def along(self, t: Float[np.ndarray, " arms"]) -> Float[np.ndarray, " arms"]:
        """Metres along the centre lines up to t."""
        return _interpolated(t[:, None], self.t, self.length)[:, 0]

    def edge(
        self, t: np.ndarray, side: np.ndarray | float, wider: tuple[np.ndarray, np.ndarray] | None = None
    ) -> np.ndarray:
        """(2, ..., n, M) points of edges at t (n, M) and their derivative by t, in the arms' frames; ``side`` a number or (..., n, 1)."""
        added = None if wider is None else (wider[0][..., None, :], wider[1][..., None, :])
        p, d = edge(self.arms, t[:, None], np.asarray(side, dtype=float)[..., None], wider=added)
        points, ways = complexes(p[..., 0, :, :]), complexes(d[..., 0, :, :])
        return np.stack([(points - self.origin[:, None]) / self.out[:, None], ways / self.out[:, None]])


@dataclass(frozen=True, eq=False)
class Throughs:
    """The whole arms through n joints, seen from one of their two halves."""

    own: Halves
    other: Halves

    @cached_property
    def turned(self) -> Throughs:
        """The same, seen from the other halves."""
        return Throughs(self.other, self.own)

    def rows(self, which: np.ndarray) -> Throughs:
        """Some of them."""
        return Throughs(self.own.rows(which), self.other.rows(which))

    @property
    def scale(self) -> Float[np.ndarray, " arms"]:
        """How much t of the other arm is worth one of this."""
        return self.own.speed / self.other.speed

    def folds(self, begin: np.ndarray, full: np.ndarray, wide: Widening) -> Bool[np.ndarray, " arms"]:
        """Whether an edge would fold between two tau (n,) if the arm were as much wider there; for parallel curves."""
        low = np.maximum(begin, -self.other.end / self.scale)
        tau = low[:, None] + (np.minimum(full, self.own.end) - low)[:, None] * np.linspace(0.0, 1.0, _FOLDS)
        edges = self.edges(tau)[0]
        width = np.abs(edges[0] - edges[1])
        left, right = np.abs(np.diff(edges, axis=2))
        turn = 2.0 * (left - right) / (width[:, 1:] + width[:, :-1])
        one, two = left + turn * wide.left[:, None], right - turn * wide.right[:, None]
        return (np.minimum(one, two) < UNFOLDED * np.maximum(one, two)).any(axis=1)

    def tau(self, distance: Float[np.ndarray, "arms m"]) -> Float[np.ndarray, "arms m"]:
        """The parameters at distances in metres along the arms from the joints; beyond the joint if negative."""
        ahead = _interpolated(distance, self.own.length, self.own.t)
        beyond = _interpolated(-distance, self.other.length, self.other.t)
        return np.where(distance >= 0.0, ahead, -beyond / self.scale[:, None])

    def centre(self, tau: Float[np.ndarray, " arms"]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Points and outward unit directions (n,) of the centre lines at tau, complex, and the widths of the arms."""
        found = []
        for half, t in ((self.own, tau), (self.other, -tau * self.scale)):
            at = np.maximum(t, 0.0)[:, None, None]
            p, d, _ = (complexes(x[:, 0]) for x in centre_line(half.arms, at))
            found.append((half.local(p)[:, 0], -d[:, 0] / half.out, width_at(half.arms, at)[0][:, 0, 0]))
        (point, way, width), (far, away, beyond) = found
        inside = tau >= 0.0
        # the other half looks back at this one: its outward direction is this one's inward one, turned by half a turn
        way = np.where(inside, way, away)
        return np.where(inside, point, -far), way / np.abs(way), np.where(inside, width, beyond)

    def edges(self, tau: Float[np.ndarray, "arms m"], wide: Widening | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Points (2, n, M) of the widened arms' left and right edges at tau, and the outward directions there."""
        side = np.array([LEFT, RIGHT])[:, None, None]
        wider = None if wide is None else wide.at(tau, side)
        made = self.own.edge(np.maximum(tau, 0.0), side, wider)
        rows = np.flatnonzero((tau < 0.0).any(axis=1))
        if len(rows):
            scale = self.scale[rows, None]
            beyond = None if wider is None else (wider[0][:, rows], -wider[1][:, rows] / scale)
            far = self.other.rows(rows).edge(np.maximum(-tau[rows] * scale, 0.0), -side, beyond)
            inside = tau[rows] >= 0.0
            made[0][:, rows] = np.where(inside, made[0][:, rows], -far[0])
            made[1][:, rows] = np.where(inside, made[1][:, rows], far[1])
        return made[0], -made[1] / np.abs(made[1])

    def beyond(self, tau: np.ndarray, side: np.ndarray, wide: Widening, tolerance: float) -> list[Curve]:
        """The edges ``side`` (n,) from the joints to tau (n,) < 0 as arcs, walking outwards."""
        scale = self.scale

        def evaluate(which: np.ndarray, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            extra, slope = wide.rows(which).at(-t / scale[which, None], side[which, None])
            p, d = self.other.rows(which).edge(t, -side[which, None], (extra, -slope / scale[which, None]))
            return pairs(-p), pairs(-d)

        ends = np.stack([np.zeros(len(tau)), -tau * scale], axis=1)
        fitted = fit(evaluate, ends, tolerance)
        last = evaluate(np.arange(len(tau)), ends[:, 1:])[0]
        found = []
        for k, (a, b) in enumerate(zip(fitted.start[:-1].tolist(), fitted.start[1:].tolist(), strict=True)):
            points = np.concatenate([fitted.points[a:b], last[k]])
            found.append(Curve(points, np.append(fitted.bulge[a:b], 0.0), closed=False))
        return found
