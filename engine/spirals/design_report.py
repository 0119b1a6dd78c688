"""What is told of a design in report.json and in a .blend file."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..progress import SILENT, Progress
from .design import SpiralDesign
from .spiral import anisotropy


def design_report(design: SpiralDesign, progress: Progress = SILENT, *, measured: bool = True) -> dict[str, Any]:
    """The ``spirals`` block of report.json; without its narrowest slot, which takes a while, if it is not to be ``measured``."""

    def spread(x: np.ndarray) -> list[float]:
        return [round(float(v), 4) for v in (x.min(), x.mean(), x.max())]

    slot = {"slot_min_mm": round(design.measured(progress)[0] * 1e3, 4)} if measured else {}
    return {
        "count": len(design.width),
        **({"painted": True} if design.painted else {}),
        "width_mm": spread(design.width * 1e3),
        "unlike_percent": spread(100 * np.ptp(design.width, axis=1) / design.width.mean(axis=1)),
        "anisotropy_percent": spread(100 * anisotropy(design.width)),
        "twist_deg": spread(np.degrees(design.twist)),
        "scale_mm": spread(design.scale * 1e3),
        **slot,
        "too_thin": len(design.thin),
        **({"no_spiral": np.flatnonzero(design.solid).tolist()} if design.solid.any() else {}),
    }
