"""How stiff every spiral is, as one number to be looked at."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...arrays import Bool, Float
from ...errors import FlexMapsError
from ...materials import Material
from ...spirals.design import SpiralDesign
from ..assembly import Assembly, of_design
from .compliances import arm_compliances

MM = 1e3  # newton metres to newton millimetres


def stiffness(design: SpiralDesign, material: Material) -> Float[np.ndarray, " quads"] | None:
    """N mm for every radian by which an arm bends over its side, the mean of the joined arms of every spiral.

    Of the elastic model's tip compliances; None where it knows no such spirals. Spirals without a joint have the least of the others.
    """
    try:
        assembly = of_design(design)
        total, count = _summed(assembly, material)
    except FlexMapsError:
        return None
    mean = total / np.maximum(count, 1)
    return np.where(count > 0, mean, mean[count > 0].min())


def renewed(
    known: Float[np.ndarray, " quads"], design: SpiralDesign, material: Material, quads: Bool[np.ndarray, " quads"]
) -> Float[np.ndarray, " quads"]:
    """The ``stiffness`` of a design of which only some quads differ from that whose stiffness is known.

    Neighbours change too, by the joints' blends. The known where the model knows no such spirals.
    """
    try:
        whole = of_design(design)
        beside = np.zeros_like(quads)
        beside[whole.pairs[quads[whole.pairs].any(axis=1)]] = True
        some = beside[whole.pairs].any(axis=1)
        if not some.any():
            return known
        parts = {name: getattr(whole, name)[some] for name in ("pairs", "sides", "lever", "axes")}
        total, count = _summed(replace(whole, **parts), material)
    except FlexMapsError:
        return known
    return np.where(beside & (count > 0), total / np.maximum(count, 1), known)


def _summed(assembly: Assembly, material: Material) -> tuple[np.ndarray, np.ndarray]:
    """(n,) sums over the joints of every spiral, and how many these are."""
    bend = arm_compliances(assembly, material, slopes=False).values
    # a moment about the side: across the arm's own radius as nearly as quads are squares
    own = MM / bend[..., 4, 4]
    count = np.bincount(assembly.pairs.ravel(), minlength=assembly.size)
    return np.bincount(assembly.pairs.ravel(), weights=own.ravel(), minlength=assembly.size), count
