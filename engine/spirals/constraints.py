"""Constraints on single spirals: spirals with feet, spirals with eyelets, and spirals protected by the user."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ..arrays import Int


def _no_quads() -> Int[np.ndarray, " 0"]:
    return np.empty(0, dtype=np.int64)


@dataclass(frozen=True, eq=False)
class Constraints:
    """Indices of quads whose spirals are not free; empty by default.

    straight : quads with twist 0; in a first design, their arms at the border have the largest width, to carry feet
    wide : quads whose arms all have the largest width, because an eyelet is cut into their hub
    fixed : quads whose spirals and flat shapes a search must not change; ignored when a first design is made
    """

    straight: Int[np.ndarray, " straight"] = field(default_factory=_no_quads)
    wide: Int[np.ndarray, " wide"] = field(default_factory=_no_quads)
    fixed: Int[np.ndarray, " kept"] = field(default_factory=_no_quads)


NO_CONSTRAINTS = Constraints()
