"""Tip compliances of lines on arms of isotropic sheets, with derivatives (sheets with a grain: see ``grain``)."""

from __future__ import annotations

import numpy as np

from ...arrays import Float
from ...materials import Material
from .beams import SHEAR_FACTOR, torsion_constant
from .stations import product, sum_products


def isotropic_line_compliance(
    place: np.ndarray, velocity: np.ndarray, width: np.ndarray, weight: np.ndarray, height: float, material: Material
) -> Float[np.ndarray, "12 numbers n"]:
    """Return the tip compliances (12, 1 + P, N) of lines on N arms, by the integrals of ``beams.path_integrals``.

    Axes: nonzero entries of the lower triangle (``cut._NONZERO``); value and derivatives by P parameters; arms.

    place, velocity, width, weight : S stations on every arm, as in ``cut._Line``
    height : thickness of the sheet, metres
    """
    x, y = -place.real, -place.imag
    speed = np.abs(velocity[0])
    # the velocity and its derivatives are rotated so that the velocity becomes real
    along = velocity * (np.conj(velocity[0]) / speed)
    unit = 1j * along.imag * (velocity[0] / speed**2)
    unit[0] = velocity[0] / speed
    tx, ty = unit.real, unit.imag
    length = product(weight, np.concatenate([speed[None], along.real[1:]]))
    lever, torque = product(x, tx) + product(y, ty), product(y, tx) - product(x, ty)

    stretch, bend, lift, twist = _flexibilities(width, length, height, material)
    shear = 2.0 * SHEAR_FACTOR * (1.0 + material.poisson)

    sx, sy = product(stretch, tx), product(stretch, ty)
    xx, xy, yy = sum_products(sx, tx), sum_products(sx, ty), sum_products(sy, ty)
    bx, by = product(bend, x), product(bend, y)
    inside = (
        sum_products(by, y) + xx + shear * yy,
        (1.0 - shear) * xy - sum_products(by, x),
        sum_products(bx, x) + yy + shear * xx,
        -by.sum(axis=1),
        bx.sum(axis=1),
        bend.sum(axis=1),
    )
    tt, tw_x, tw_y = product(twist, torque), product(twist, tx), product(twist, ty)
    rl, ra_x, ra_y = product(lift, lever), product(lift, tx), product(lift, ty)
    outside = (
        sum_products(tt, torque) + sum_products(rl, lever) + shear * stretch.sum(axis=1),
        sum_products(tt, tx) + sum_products(rl, ty),
        sum_products(tw_x, tx) + sum_products(ra_y, ty),
        sum_products(tt, ty) - sum_products(rl, tx),
        sum_products(tw_x, ty) - sum_products(ra_x, ty),
        sum_products(tw_y, ty) + sum_products(ra_x, tx),
    )
    return np.stack(inside + outside)


def _flexibilities(
    width: np.ndarray, length: np.ndarray, height: float, material: Material
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return four flexibilities (1 + P, S, N) of pieces of arms, with derivatives by P parameters.

    Stretch per force, bend in the sheet per moment, bend out of the sheet per moment, torsion per torque.
    """

    def flex(value: np.ndarray, by_width: np.ndarray) -> np.ndarray:
        out = by_width * width
        out[0] = value
        return product(length, out)

    w = width[0]
    soft = 1.0 / (material.youngs * height * w)
    inertia, slope = torsion_constant(height / w)
    twisting = 2.0 * (1.0 + material.poisson) / (material.youngs * w**4 * inertia)
    bend, lift = 12.0 * soft / w**2, 12.0 * soft / height**2
    by_width = twisting * (slope * height / (inertia * w) - 4.0) / w
    return flex(soft, -soft / w), flex(bend, -3.0 * bend / w), flex(lift, -lift / w), flex(twisting, by_width)
