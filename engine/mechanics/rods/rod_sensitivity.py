"""Derivatives of the rod model's forces by the widths and twists of the spirals, at a fixed pose.

The energy E is linear in the parameters k_s, k_b0, k_b1, k_t of every spiral. So its derivative by one of them, p, is
the energy with p = 1 and all other parameters 0. The rolls of the edges change with p too. As E is minimal over every
roll r, the gradient g of E by the pose q has the derivative

    dg/dp = E_qp - E_qr E_rp / E_rr    (subscripts denote derivatives).
"""

from __future__ import annotations

import numpy as np

from ...arrays import Float
from ..assembly import Assembly
from . import strains
from .motion import END_INCREMENTS, ROLL_SIGNS, RodState, first_order, roll_coupling


def gradient_by_design(
    assembly: Assembly, springs: np.ndarray, length: np.ndarray, by_design: np.ndarray, state: RodState
) -> Float[np.ndarray, "joints 12 2 5"]:
    """Differentiate every joint's contribution to the energy's gradient by widths and twists, at a fixed pose.

    Parameters
    ----------
    assembly, springs, length, by_design : as in ``RodModel``
    state : pose and state of the edges

    Returns
    -------
    (m, 12, 2, 5) : axis 1: increments of both hubs, as in ``Expansion.hessian``; axis 2: side of the joint; axis 3:
        four widths of the spiral on this side (per metre; equal, as only their mean matters), then its twist (per
        radian)
    """
    half = assembly.radius
    change = by_design[assembly.pairs]
    jacobian = first_order(state).jacobian
    ends = strains.expand(springs, state.bend, state.angles).hessian * np.outer(ROLL_SIGNS, ROLL_SIGNS)
    row, stiffness = roll_coupling(ends, jacobian), ends[..., 2, 2].sum(axis=1)
    out = np.empty((len(half), 12, 2, 5))
    tension = (state.length / length - 1.0) / length
    for side in (0, 1):
        for k in (0, 1):
            ks, bends = change[:, side, 0, k] * half[:, side], change[:, side, 1:, k] / half[:, side, None]
            slope = strains.slope(bends, state.bend[:, side], state.angles[:, side]) * ROLL_SIGNS
            gradient = np.einsum("mi,mij->mj", slope, jacobian[:, side])
            gradient[:, :3] += (ks * tension)[:, None] * state.tangent
            found = gradient @ END_INCREMENTS[side] - row * (slope[:, 2] / stiffness)[:, None]
            if k == 0:
                out[:, :, side, :4] = 0.25 * found[..., None]
            else:
                out[:, :, side, 4] = found
    return out
