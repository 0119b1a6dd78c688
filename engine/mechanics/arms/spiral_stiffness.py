"""Bending stiffness of every spiral as one number, for display."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...arrays import Bool, Float
from ...errors import FlexMapsError
from ...materials import Material
from ...spirals.design import SpiralDesign
from ..assembly import Assembly, assembly_from_design
from .compliances import arm_compliances

MM = 1e3  # newton millimetres per newton metre


def spiral_stiffness(design: SpiralDesign, material: Material) -> Float[np.ndarray, " quads"] | None:
    """Return the mean bending stiffness of the joined arms of every spiral, from the elastic model's tip compliances.

    A spiral without a joint gets the smallest value of all other spirals.

    Parameters
    ----------
    design, material : the spirals, and the sheet

    Returns
    -------
    (F,) moment about the quad's side per turn of the arm's tip about it, N mm per radian; None where the elastic model
    cannot be evaluated
    """
    try:
        assembly = assembly_from_design(design)
        total, count = _sum_by_spiral(assembly, material)
    except FlexMapsError:
        return None
    mean = total / np.maximum(count, 1)
    return np.where(count > 0, mean, mean[count > 0].min())


def update_stiffness(
    known: Float[np.ndarray, " quads"], design: SpiralDesign, material: Material, quads: Bool[np.ndarray, " quads"]
) -> Float[np.ndarray, " quads"]:
    """Return ``spiral_stiffness``, updated after a change of some quads.

    Their neighbours are updated too, because the arms of a joint are blended with each other.

    Parameters
    ----------
    known : (F,) the stiffness before; returned unchanged where the elastic model cannot be evaluated
    design, material : the changed spirals, and the sheet
    quads : (F,) mask of the changed quads
    """
    try:
        whole = assembly_from_design(design)
        beside = np.zeros_like(quads)
        beside[whole.pairs[quads[whole.pairs].any(axis=1)]] = True
        some = beside[whole.pairs].any(axis=1)
        if not some.any():
            return known
        parts = {name: getattr(whole, name)[some] for name in ("pairs", "sides", "lever", "axes")}
        total, count = _sum_by_spiral(replace(whole, **parts), material)
    except FlexMapsError:
        return known
    return np.where(beside & (count > 0), total / np.maximum(count, 1), known)


def _sum_by_spiral(assembly: Assembly, material: Material) -> tuple[np.ndarray, np.ndarray]:
    """Return the sums (n,) of the stiffnesses at the joints of every spiral, and the numbers of its joints."""
    bend = arm_compliances(assembly, material, slopes=False).values
    # moment about the axis across the arm's radius, which is parallel to the quad's side in square quads
    own = MM / bend[..., 4, 4]
    count = np.bincount(assembly.pairs.ravel(), minlength=assembly.size)
    return np.bincount(assembly.pairs.ravel(), weights=own.ravel(), minlength=assembly.size), count
