"""The design: width and twist of the spiral in every quad (FlexMaps sections 5 and 7)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from .errors import FlexMapsError
from .flatten import FlatPatches
from .params import SpiralParams
from .slots import gaps, gaps_across, room, slot_needed, twist_bound, twist_limit
from .spiral import Arms, arms

__all__ = ["SpiralDesign", "design_report", "from_curvature", "twist_bound", "twist_limit", "uniform"]


@dataclass(frozen=True, eq=False)
class SpiralDesign:
    """One spiral a quad.

    flat : the flat patches that the spirals lie in
    params : fabricable range, sheet thickness, chirality
    width : (F,) metres, width of the four arms
    twist : (F,) radians, winding angle from the tip to the centre
    """

    flat: FlatPatches
    params: SpiralParams
    width: np.ndarray
    twist: np.ndarray

    @cached_property
    def arms(self) -> Arms:
        """The true shape of every arm."""
        return arms(self.flat, self.params, self.width, self.twist)

    @cached_property
    def scale(self) -> np.ndarray:
        """(F,) metres: diameter of every spiral, twice the mean distance from the centre to the joints."""
        return 2.0 * self.arms.radius.mean(axis=1)

    @cached_property
    def gap(self) -> np.ndarray:
        """(F,) metres: narrowest gap beside the outer halves of every quad's arms, on the true shape."""
        across = gaps_across(self.arms, self.flat.layout.mesh, self.flat.corners)
        return np.minimum(gaps(self.arms), across).min(axis=1)

    @cached_property
    def coordinates(self) -> np.ndarray:
        """(F, 2): width and twist as shares of their coupled ranges, in which the fabricable designs are a box."""
        p = self.params
        bound = np.maximum(twist_bound(self.flat, p, self.width), 1e-9)
        return np.stack([(self.width - p.width_min) / max(p.width_max - p.width_min, 1e-12), self.twist / bound], axis=1)


def uniform(flat: FlatPatches, params: SpiralParams, *, width: float | None = None, twist: float | None = None) -> SpiralDesign:
    """The same spiral in every quad, as far as the quads allow: each is narrowed and unwound until it can be cut.

    width : metres, the mean of the allowed range if not given; twist : radians, half of the largest if not given.
    Raises ``FlexMapsError`` with the faces that are too small for the smallest width.
    """
    width = 0.5 * (params.width_min + params.width_max) if width is None else width
    twist = 0.5 * params.twist_max if twist is None else twist
    count = len(flat.corners)
    return _cuttable(flat, params, np.full(count, float(width)), np.full(count, float(twist)))


def from_curvature(flat: FlatPatches, params: SpiralParams, curvature: np.ndarray) -> SpiralDesign:
    """The curvature-adjusted start (FlexMaps section 7): the more a place is curved, the thinner and the more wound its spiral.

    curvature : (F,) RMS curvature, 1/m. Both descriptors are linear in c = C / C_max, where C_max is a high percentile of
    the curvature (``params.curvature_top``; 100 is the maximum of the publication): one sharp crease would else leave all
    the rest of the surface at c near 0. Raises ``FlexMapsError`` with the faces that are too small for the smallest width.
    """
    curvature = np.asarray(curvature, dtype=float)
    top = float(np.percentile(curvature, params.curvature_top))
    c = np.clip(curvature / top, 0.0, 1.0) if top > 0.0 else np.zeros_like(curvature)
    width = params.width_max - c * (params.width_max - params.width_min)
    twist = params.twist_min + c * (params.twist_max - params.twist_min)
    return _cuttable(flat, params, width, twist)


def _cuttable(flat: FlatPatches, params: SpiralParams, width: np.ndarray, twist: np.ndarray) -> SpiralDesign:
    """Bring widths and twists (F,) inside what can be cut in the real quads, joints and neighbours included."""
    if params.width_min > params.width_max:
        raise FlexMapsError("The smallest width is larger than the largest width; exchange them")
    widest = room(flat)
    small = np.flatnonzero(widest < params.width_min)
    if len(small):
        need = params.width_min / widest[small].min()
        raise FlexMapsError(
            f"{len(small)} quads are too small or too thin for arms {params.width_min * 1e3:g} mm wide; "
            f"make the object {need:.3g} times larger, or the smallest width {widest[small].min() * 1e3:.2g} mm",
            faces=small,
        )
    width = np.minimum(width, widest)
    design = SpiralDesign(flat, params, width, np.minimum(twist, twist_bound(flat, params, width)))
    slot, mesh = slot_needed(params), flat.layout.mesh
    for _ in range(30):
        tight = design.gap < slot * (1.0 - 1e-6)
        if not (tight & (design.twist > 0.0)).any():
            break
        # an arm also gives way where it is its neighbour's that has no room
        tight |= (tight[mesh.neighbours] & (mesh.neighbours >= 0)).any(axis=1) & (design.gap < 1.5 * slot)
        share = np.clip((design.gap + width) / (slot + width), 0.8, 0.99)
        loose = np.sqrt(np.maximum((design.twist**2 + 4.0) * share**2 - 4.0, 0.0))
        loose = np.where(design.twist < 0.1, 0.0, np.maximum(loose, 0.8 * design.twist))
        design = replace(design, twist=np.where(tight, loose, design.twist))
    return design


def design_report(design: SpiralDesign) -> dict[str, Any]:
    """The ``spirals`` block of report.json."""

    def spread(x: np.ndarray) -> list[float]:
        return [round(float(v), 4) for v in (x.min(), x.mean(), x.max())]

    return {
        "count": len(design.width),
        "width_mm": spread(design.width * 1e3),
        "twist_deg": spread(np.degrees(design.twist)),
        "scale_mm": spread(design.scale * 1e3),
        "slot_min_mm": round(float(design.gap.min()) * 1e3, 4),
    }
