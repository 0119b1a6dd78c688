"""Report on a design: the block about spirals in report.json and in .blend files."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..progress import SILENT, Progress
from .curves.spiral import anisotropy
from .design import SpiralDesign


def design_report(design: SpiralDesign, progress: Progress = SILENT, *, with_slot: bool = True) -> dict[str, Any]:
    """Return the ``spirals`` block of report.json.

    Parameters
    ----------
    design : the design
    progress : called with the fraction done; may cancel
    with_slot : include the width of the narrowest slot, which takes a while to measure
    """

    def spread(x: np.ndarray) -> list[float]:
        return [round(float(v), 4) for v in (x.min(), x.mean(), x.max())]

    slot = {"slot_min_mm": round(design.measure_slot_and_bridge(progress)[0] * 1e3, 4)} if with_slot else {}
    return {
        "count": len(design.width),
        **({"painted": True} if design.is_painted else {}),
        "width_mm": spread(design.width * 1e3),
        "unlike_percent": spread(100 * np.ptp(design.width, axis=1) / design.width.mean(axis=1)),
        "anisotropy_percent": spread(100 * anisotropy(design.width)),
        "twist_deg": spread(np.degrees(design.twist)),
        "scale_mm": spread(design.scale * 1e3),
        **slot,
        "too_thin": len(design.thin_quads),
        **({"no_spiral": np.flatnonzero(design.has_solid_hub).tolist()} if design.has_solid_hub.any() else {}),
    }
