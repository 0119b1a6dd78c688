"""The design: width and twist of the spiral in every quad (FlexMaps sections 5 and 7)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .flatten import FlatPatches
from .params import SpiralParams


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
