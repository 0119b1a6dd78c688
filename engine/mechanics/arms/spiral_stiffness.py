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

MM = 1e3  # factor from N m to N mm


def spiral_stiffness(design: SpiralDesign, material: Material) -> Float[np.ndarray, " quads"] | None:
    """Return the bending stiffness of every spiral: the mean over its arms that end in joints.

    The stiffness of an arm is the moment at its tip, about the side of its quad, per rotation of the tip about this
    side. A spiral without a joint gets the smallest value of all other spirals.

    Parameters
    ----------
    design, material : the spirals, and the material of their sheet

    Returns
    -------
    (F,) N mm per radian; None if the elastic model cannot be evaluated for this design
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
    """Return ``spiral_stiffness`` of a changed design, computed only where it differs from the known values.

    It is computed for the changed quads and their neighbours, because the arms of a joint are blended with each other.

    Parameters
    ----------
    known : (F,) the stiffness before the change; returned unchanged if the elastic model cannot be evaluated
    design, material : the design after the change, and the material of its sheet
    quads : (F,) mask of the quads whose spirals have changed
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
    """Return for every spiral the sum of the stiffnesses of its arms that end in joints, and the arms' number."""
    bend = arm_compliances(assembly, material, slopes=False).values
    # component 4 is about the axis across the arm's radius, which in square quads is parallel to the quad's side
    own = MM / bend[..., 4, 4]
    count = np.bincount(assembly.pairs.ravel(), minlength=assembly.size)
    return np.bincount(assembly.pairs.ravel(), weights=own.ravel(), minlength=assembly.size), count
