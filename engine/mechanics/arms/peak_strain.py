"""The strain that a load at its tip costs an arm, from the stiffness table, with exact derivatives."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...arrays import Float
from .stiffness import SCALE_RANGE, Table, interpolate, lengths_and_twists, load_table, locate, refuse_material


@dataclass(frozen=True, eq=False)
class PeakStrain:
    """Peak strains of n arms, which the six components of a wrench add up to, and the derivatives of these shares.

    parts : (n, 6); by_wrench : (n, 6) each by its component, per N and N m; by_width : (n, 6) per metre, by_twist : (n, 6) per radian
    """

    parts: Float[np.ndarray, "arms 6"]
    by_wrench: Float[np.ndarray, "arms 6"]
    by_width: Float[np.ndarray, "arms 6"]
    by_twist: Float[np.ndarray, "arms 6"]

    @property
    def values(self) -> Float[np.ndarray, " arms"]:
        return self.parts.sum(axis=1)

    def times(self, share: Float[np.ndarray, " arms"], by_twist: Float[np.ndarray, " arms"]) -> PeakStrain:
        """These times a number of every arm that changes with its twist."""
        share, by_twist = share[:, None], by_twist[:, None]
        turned = self.by_twist * share + self.parts * by_twist
        return PeakStrain(self.parts * share, self.by_wrench * share, self.by_width * share, turned)


def peak_strain(
    wrench: np.ndarray,
    scale: np.ndarray,
    width: np.ndarray,
    twist: np.ndarray,
    *,
    thickness: float,
    youngs: float,
    poisson: float,
    signs: np.ndarray | None = None,
) -> PeakStrain:
    """A safe estimate of the strain that 99 % of the volume of an arm stays below under its tip load.

    wrench : (n, 6) N and N m at the tip of one arm, axes as in ``ArmCompliance``. The peak strains of the six components
    are added as if they met in one place: usually 1.2 to 2.5 times the true strain, more where components cancel. Small
    strains; at the fillets, in the hundredth of the volume that is left out, it is higher. Arms shorter than the table's
    shortest count as that long.
    """
    refuse_material(thickness, youngs)
    wrench = np.atleast_2d(np.asarray(wrench, dtype=float))
    scale, width, twist = lengths_and_twists(scale, width, twist)
    stub = scale < SCALE_RANGE[0] * width
    ratio = np.where(stub, SCALE_RANGE[0], scale / width)
    log, slopes = _log_strains(ratio, width / thickness, twist, load_table(float(poisson)))
    power = np.repeat([2.0, 3.0], 3)[:, None]
    unit = np.exp(log) / (youngs * width**power)
    signs = np.sign(wrench) if signs is None else signs
    size = (signs * wrench).T * unit
    by_width = slopes[1] - np.where(stub, 0.0, slopes[0]) - power
    return PeakStrain(size.T, signs * unit.T, (size * by_width / width).T, (size * slopes[2]).T)


def log_strains(
    ratio: np.ndarray, flatness: np.ndarray, twist: np.ndarray, table: Table
) -> Float[np.ndarray, "6 spirals"]:
    """(6, n) logarithms of the dimensionless peak strains per unit of the six components of a tip wrench."""
    return _log_strains(ratio, flatness, twist, table)[0]


# powers of s/w beyond its nodes: the moment of a force grows with the arm's length
_BY_LENGTH = np.repeat([1.0, 0.0], 3)[:, None]
# powers of w/h below and above its nodes, from section moduli: h w^2 in the plane; out of it, where torsion (h w^2 of a
# tall section) and bending (w h^2) mix, the one that strains more
_BY_HEIGHT = np.array([[1.0, 1.0, 1.0, 1.0, 1.0, 1.0], [1.0, 1.0, 2.0, 2.0, 2.0, 1.0]])[..., None]


def _log_strains(
    ratio: np.ndarray, flatness: np.ndarray, twist: np.ndarray, table: Table
) -> tuple[np.ndarray, np.ndarray]:
    """``log_strains``, and their derivatives (3, 6, n) by ln(s/w), ln(w/h) and twist."""
    at = locate(ratio, flatness, twist)
    log, slopes = interpolate(table, at, slice(12, 18))
    by_height = np.where(at.thinner < 0.0, *_BY_HEIGHT)
    log = log - _BY_LENGTH * np.log(at.share) + by_height * at.thinner
    slopes[0] += np.where(at.share < 1.0, _BY_LENGTH, 0.0)
    slopes[1] += np.where(at.thinner != 0.0, by_height, 0.0)
    return log, slopes
