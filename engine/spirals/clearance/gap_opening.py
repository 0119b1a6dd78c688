"""Repair designs with closed gaps: unwind spirals and thin their arms until every clearance is met."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array

from ...arrays import Bool
from ...progress import SILENT, Progress
from .clearance_model import ClearanceModel

# Largest number of rounds that change spirals according to the derivatives of clearances (mostly under 10 suffice), and
# largest number of all rounds. The later rounds change all spirals at closed gaps by a fixed share. More rounds open
# more gaps and take longer.
SLOPE_ROUNDS, ROUNDS = 25, 90
TARGET_CLEARANCE = 0.02  # target clearance, as in ``Clearances.value``; larger values need fewer rounds but unwind more
# least derivative of a clearance (``Clearances.value``) by the twists, 1/radian, for which spirals are unwound; for
# smaller derivatives arms become thinner instead
MIN_TWIST_SLOPE = 0.02
# largest decrease in one round: of a twist in radians, and of a width as a share of the width; larger values need fewer
# rounds but overshoot
MAX_UNWIND, MAX_THIN = 0.4, 0.1


def open_gaps(
    model: ClearanceModel,
    low: np.ndarray,
    width: np.ndarray,
    twist: np.ndarray,
    free: Bool[np.ndarray, " quads"],
    progress: Progress = SILENT,
) -> tuple[np.ndarray, np.ndarray]:
    """Return widths and twists near the input for which all gaps are open; the input if they are open already.

    Every closed gap requests the smallest unwinding that opens it, or thinner arms if unwinding does not help. Every
    spiral follows its largest request; its four arms become thinner by equal shares. Gaps that remain closed after
    ``SLOPE_ROUNDS`` rounds are opened by unwinding and thinning all their spirals.

    Parameters
    ----------
    model : clearance model of the flat patches
    low : (F,) smallest widths, metres; thinner arms in the input keep their width
    width, twist : (F, 4) metres and (F,) radians, the design to start from
    free : mask of the spirals that may change
    progress : called with the fraction done; may cancel
    """
    least, quads = np.minimum(low[:, None], width), np.ones(len(twist), dtype=bool)
    for turn in range(SLOPE_ROUNDS):
        progress(turn / ROUNDS, "making room between the arms")
        terms = model.clearances(width, twist, below=0.0, quads=quads)
        if not len(terms.value):
            return width, twist
        short = TARGET_CLEARANCE - terms.value
        by_twist = _opening_slopes(terms.by_design[:, width.size :], free & (twist > 0.0))
        idle = by_twist.power(2).sum(axis=1) < MIN_TWIST_SLOPE**2
        unwind = _largest_request(by_twist, np.where(idle, 0.0, short))
        thin = _largest_request(
            _opening_slopes(terms.by_design[:, : width.size], (free[:, None] & (width > least)).ravel()),
            np.where(idle, short, 0.0),
        )
        share = (thin.reshape(-1, 4) / width).min(axis=1, keepdims=True)
        width = np.maximum((1.0 + np.maximum(share, -MAX_THIN)) * width, least)
        twist = np.maximum(twist + np.maximum(unwind, -MAX_UNWIND), 0.0)
        quads = np.zeros(len(twist), dtype=bool)
        quads[terms.arms // 4] = True
    for turn in range(SLOPE_ROUNDS, ROUNDS):
        progress(turn / ROUNDS, "making room between the arms")
        quads = model.quads_with_closed_gaps(width, twist, quads) & free
        straight = quads & (twist == 0.0)
        width = np.where(straight[:, None], np.maximum((1.0 - MAX_THIN) * width, least), width)
        twist = np.where(quads, np.where(twist < 0.1, 0.0, 0.9 * twist), twist)
        if not quads.any():
            break
    return width, twist


def _opening_slopes(slopes: csr_array, free: np.ndarray) -> csr_array:
    """Return the derivatives (gaps, parameters) by which a reduced free parameter widens the gap; all others are 0."""
    return csr_array(slopes.minimum(0.0).multiply(free))


def _largest_request(slopes: csr_array, short: np.ndarray) -> np.ndarray:
    """Return, for every parameter, the largest reduction that any gap requests, as a negative number.

    A gap requests the least-norm change that increases its clearance by ``short``, to first order; ``slopes`` are the
    derivatives of the clearances (gaps, parameters).
    """
    size = slopes.power(2).sum(axis=1)
    return csr_array(slopes.multiply((short / np.maximum(size, 1e-12))[:, None])).min(axis=0).toarray().ravel()
