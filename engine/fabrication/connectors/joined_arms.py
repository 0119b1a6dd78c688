"""Pairs of arms that meet at joints, as one continuous strip; many joints at once, one per row.

Every arm has its own frame of complex numbers: the joint is 0, and the positive real axis points outwards, from the arm
across the joint. The frames of both arms of a joint differ by half a turn. Both are described from one of them, called
``own`` or "this arm"; ``other`` is the arm across the joint. Places along the strip have the parameter tau: on this arm
(tau >= 0) it is the arm's t; on the other arm (tau < 0) it is minus that arm's t, scaled such that at the joint equal
steps of tau are equally long on both arms.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ...arrays import Bool, Columns, Complex, Float, Int
from ...spirals.curves.arcs import Curve, fit_biarcs
from ...spirals.curves.spiral import LEFT, RIGHT, Arms, centre_line, edge_points, taper_width, width_at
from ...spirals.design import SpiralDesign

# Where an arm curves, the same step of tau is shorter on its inner edge than on its outer edge. Minimum ratio of these
# lengths in a tip: at 0 the inner edge folds, and larger values refuse more connectors
MIN_STEP_RATIO = 0.15
# share of an arm's range of t, from its joint, that a connector may occupy; larger lets connectors reach nearer to hubs
ARM_SHARE = 0.85
SAMPLES = 41  # samples along an arm or the edge of a tip; more are slower and hardly more exact


def to_complex(points: Float[np.ndarray, "... 2"]) -> np.ndarray:
    """Convert points to complex numbers."""
    return points[..., 0] + 1j * points[..., 1]


def to_points(numbers: np.ndarray) -> Float[np.ndarray, "... 2"]:
    """Convert complex numbers to points."""
    return np.stack([numbers.real, numbers.imag], axis=-1)


def _interpolate_rows(x: np.ndarray, known: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Interpolate linearly in each of n rows, like ``np.interp(x[i], known[i], values[i])``.

    x : (n, M) positions at which to interpolate
    known, values : (n, K) ascending positions, and the values there
    """
    rows = np.arange(len(known))[:, None]
    x = np.clip(x, known[:, :1], known[:, -1:])
    step = 1.01 * float(known.max(initial=0.0)) + 1e-12
    cell = np.searchsorted((known + step * rows).ravel(), x + step * rows, side="right") - 1 - rows * known.shape[1]
    cell = np.clip(cell, 0, known.shape[1] - 2)
    low, high = known[rows, cell], known[rows, cell + 1]
    share = (x - low) / np.maximum(high - low, 1e-300)
    return values[rows, cell] * (1.0 - share) + values[rows, cell + 1] * share


@dataclass(frozen=True, eq=False)
class Widening(Columns):
    """Widening of arms at their tips, so that they are wide enough for connectors.

    left, right : metres by which the left and the right edge are moved outwards, from the tip up to tau ``taper_start``
    taper_start, taper_end : values of tau between which the widening falls from its full amount to 0
    """

    left: Float[np.ndarray, " arms"]
    right: Float[np.ndarray, " arms"]
    taper_start: Float[np.ndarray, " arms"]
    taper_end: Float[np.ndarray, " arms"]

    def added_width(self, tau: np.ndarray, side: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return twice the distance by which edges move outwards at tau (n, M), in metres, and its derivative by tau.

        Twice, because an arm to whose width it is added moves each of its edges by half of it. ``side`` is LEFT or
        RIGHT for each edge, and broadcasts with tau.
        """
        extra = 2.0 * np.where(side == LEFT, self.left[:, None], self.right[:, None])
        return taper_width(extra, self.taper_start[:, None], self.taper_end[:, None], tau)


@dataclass(frozen=True, eq=False)
class JointArms(Columns):
    """One arm at each of n joints.

    arm : number of the arm, 4 quad + side
    patch : patch of the arm
    arms : shape parameters of the arms
    origin, outwards : complex origin and outward unit direction of the arm's frame in the patch's frame
    t, length : samples of t, and the length in metres of the centre line from the joint to each of them
    speed : length of the centre line per unit of t at the joint, metres
    t_max : largest t that a connector may occupy
    """

    arm: Int[np.ndarray, " arms"]
    patch: Int[np.ndarray, " arms"]
    arms: Arms
    origin: Complex[np.ndarray, " arms"]
    outwards: Complex[np.ndarray, " arms"]
    t: Float[np.ndarray, "arms table"]
    length: Float[np.ndarray, "arms table"]
    speed: Float[np.ndarray, " arms"]
    t_max: Float[np.ndarray, " arms"]

    @staticmethod
    def from_arms(design: SpiralDesign, quad: Int[np.ndarray, " arms"], side: Int[np.ndarray, " arms"]) -> JointArms:
        """Return the arms at sides ``side`` of quads ``quad``, one for each joint."""
        roots = design.roots
        single = design.arms.one_by_one(quad, side)
        end = np.minimum(roots.left[quad, side], roots.right[quad, side - 1])
        t = end[:, None] * np.linspace(0.0, 1.0, SAMPLES)
        p, d, _ = (to_complex(x[:, 0]) for x in centre_line(single, t[:, None]))
        length = np.concatenate([np.zeros((len(t), 1)), np.cumsum(np.abs(np.diff(p, axis=1)), axis=1)], axis=1)
        speed = np.abs(d[:, 0])
        patch = design.flat.layout.patch_of[quad]
        return JointArms(4 * quad + side, patch, single, p[:, 0], -d[:, 0] / speed, t, length, speed, ARM_SHARE * end)

    def in_arm_frames(self, points: Complex[np.ndarray, "arms ..."]) -> Complex[np.ndarray, "arms ..."]:
        """Transform points from the patches' frames to the arms' frames."""
        shape = (-1, *(1,) * (points.ndim - 1))
        return (points - self.origin.reshape(shape)) / self.outwards.reshape(shape)

    def in_patch_frames(self, points: Complex[np.ndarray, "arms ..."]) -> Complex[np.ndarray, "arms ..."]:
        """Transform points from the arms' frames to the patches' frames."""
        shape = (-1, *(1,) * (points.ndim - 1))
        return self.origin.reshape(shape) + self.outwards.reshape(shape) * points

    def arc_lengths(self, t: Float[np.ndarray, " arms"]) -> Float[np.ndarray, " arms"]:
        """Return the length in metres of the centre lines from the joints to t."""
        return _interpolate_rows(t[:, None], self.t, self.length)[:, 0]

    def edge_points(
        self, t: np.ndarray, side: np.ndarray | float, added_width: tuple[np.ndarray, np.ndarray] | None = None
    ) -> np.ndarray:
        """Return complex points of edges at t (n, M), stacked with their derivatives by t: (2, ..., n, M).

        Both are in the arms' frames.

        side : LEFT or RIGHT, as a number or (..., n, 1)
        added_width : metres added to the widths of the arms, and the derivative by t of this addition
        """
        added = None if added_width is None else (added_width[0][..., None, :], added_width[1][..., None, :])
        p, d = edge_points(self.arms, t[:, None], np.asarray(side, dtype=float)[..., None], added_width=added)
        points, ways = to_complex(p[..., 0, :, :]), to_complex(d[..., 0, :, :])
        return np.stack([(points - self.origin[:, None]) / self.outwards[:, None], ways / self.outwards[:, None]])


@dataclass(frozen=True, eq=False)
class JoinedArms(Columns):
    """Both arms at each of n joints; tau and frames are those of the arm ``own``, and ``other`` lies across the cut."""

    own: JointArms
    other: JointArms

    @cached_property
    def from_other_side(self) -> JoinedArms:
        """These joints with ``own`` and ``other`` exchanged."""
        return JoinedArms(self.other, self.own)

    @property
    def parameter_scale(self) -> Float[np.ndarray, " arms"]:
        """Ratio of t on the other arm to t on this arm for steps that are equally long in metres at the joint."""
        return self.own.speed / self.other.speed

    def have_folded_edge(self, begin: np.ndarray, full: np.ndarray, wide: Widening) -> Bool[np.ndarray, " arms"]:
        """Return a mask of the joints where an edge of this arm's tip folds when it is moved outwards by ``wide``.

        begin : (n,) tau at which the edges of the tip end
        full : (n,) tau up to which the tip has its full width
        """
        low = np.maximum(begin, -self.other.t_max / self.parameter_scale)
        tau = low[:, None] + (np.minimum(full, self.own.t_max) - low)[:, None] * np.linspace(0.0, 1.0, SAMPLES)
        edges = self.edge_points(tau)[0]
        width = np.abs(edges[0] - edges[1])
        left, right = np.abs(np.diff(edges, axis=2))
        turn = 2.0 * (left - right) / (width[:, 1:] + width[:, :-1])
        one, two = left + turn * wide.left[:, None], right - turn * wide.right[:, None]
        return (np.minimum(one, two) < MIN_STEP_RATIO * np.maximum(one, two)).any(axis=1)

    def tau_at(self, distance: Float[np.ndarray, "arms m"]) -> Float[np.ndarray, "arms m"]:
        """Return tau at distances in metres along the centre lines from the joints, negative on the other arm."""
        ahead = _interpolate_rows(distance, self.own.length, self.own.t)
        beyond = _interpolate_rows(-distance, self.other.length, self.other.t)
        return np.where(distance >= 0.0, ahead, -beyond / self.parameter_scale[:, None])

    def centre_lines(self, tau: Float[np.ndarray, " arms"]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the centre lines at tau: complex points, their outward unit directions, and the arms' widths (n,)."""
        found = []
        for half, t in ((self.own, tau), (self.other, -tau * self.parameter_scale)):
            at = np.maximum(t, 0.0)[:, None, None]
            p, d, _ = (to_complex(x[:, 0]) for x in centre_line(half.arms, at))
            found.append((half.in_arm_frames(p)[:, 0], -d[:, 0] / half.outwards, width_at(half.arms, at)[0][:, 0, 0]))
        (point, way, width), (far, away, beyond) = found
        inside = tau >= 0.0
        # points of the other arm change sign, because its frame is turned by half a turn; directions change it once
        # more, because what points outwards from the other arm points towards this arm
        way = np.where(inside, way, away)
        return np.where(inside, point, -far), way / np.abs(way), np.where(inside, width, beyond)

    def edge_points(
        self, tau: Float[np.ndarray, "arms m"], wide: Widening | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return complex points (2, n, M) of the left and right edges, widened by ``wide``, at tau (n, M).

        Also return the unit tangents (2, n, M) of the edges, which point outwards from this arm.
        """
        side = np.array([LEFT, RIGHT])[:, None, None]
        wider = None if wide is None else wide.added_width(tau, side)
        made = self.own.edge_points(np.maximum(tau, 0.0), side, wider)
        rows = np.flatnonzero((tau < 0.0).any(axis=1))
        if len(rows):
            scale = self.parameter_scale[rows, None]
            beyond = None if wider is None else (wider[0][:, rows], -wider[1][:, rows] / scale)
            far = self.other.subset(rows).edge_points(np.maximum(-tau[rows] * scale, 0.0), -side, beyond)
            inside = tau[rows] >= 0.0
            made[0][:, rows] = np.where(inside, made[0][:, rows], -far[0])
            made[1][:, rows] = np.where(inside, made[1][:, rows], far[1])
        return made[0], -made[1] / np.abs(made[1])

    def edges_beyond_joint(self, tau: np.ndarray, side: np.ndarray, wide: Widening, tolerance: float) -> list[Curve]:
        """Return the parts of widened edges that lie on the other arm, from the joint to ``tau``, as arcs.

        Parameters
        ----------
        tau : (n,) negative values at which the parts end
        side : (n,) LEFT or RIGHT, as seen from this arm
        wide : widening of the tips
        tolerance : largest distance of the arcs from the exact edges, metres
        """
        scale = self.parameter_scale

        def evaluate(which: np.ndarray, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            extra, slope = wide.subset(which).added_width(-t / scale[which, None], side[which, None])
            p, d = self.other.subset(which).edge_points(t, -side[which, None], (extra, -slope / scale[which, None]))
            return to_points(-p), to_points(-d)

        ends = np.stack([np.zeros(len(tau)), -tau * scale], axis=1)
        fitted = fit_biarcs(evaluate, ends, tolerance)
        last = evaluate(np.arange(len(tau)), ends[:, 1:])[0]
        found = []
        for k, (a, b) in enumerate(zip(fitted.start[:-1].tolist(), fitted.start[1:].tolist(), strict=True)):
            points = np.concatenate([fitted.points[a:b], last[k]])
            found.append(Curve(points, np.append(fitted.bulge[a:b], 0.0), closed=False))
        return found
