"""What some spirals must be, whatever would suit the shape best: those under feet, under eyelets, and those that are protected."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ..arrays import Int


def _none() -> Int[np.ndarray, " 0"]:
    return np.empty(0, dtype=np.int64)


@dataclass(frozen=True, eq=False)
class Constraints:
    """Quads whose spirals are not free; by default all are.

    straight : these are not wound, and their arms at the border are as wide as may be to begin with, for feet begin there
    wide : all arms of these are as wide as may be, for an eyelet is cut into their hub
    kept : these stay exactly as they are, the flat shapes of their quads too; only a search that changes a design asks for them
    """

    straight: Int[np.ndarray, " straight"] = field(default_factory=_none)
    wide: Int[np.ndarray, " wide"] = field(default_factory=_none)
    kept: Int[np.ndarray, " kept"] = field(default_factory=_none)


FREE = Constraints()
