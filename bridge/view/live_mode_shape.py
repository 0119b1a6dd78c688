"""Picture of live mode: the live piece's shape, coloured by the distance from its target."""

from __future__ import annotations

import numpy as np

from ...engine import colours
from ...engine.extras.live.live_piece import LiveEquilibrium
from ..store.i18n import translate
from .legend import Legend
from .live_shape import LiveShape

# possible upper ends of the colour scale, millimetres; with a continuous end, colours would flicker while a piece moves
SCALE_ENDS = np.array([1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0, 500.0])


class LiveModeShape(LiveShape):
    """Picture of a live shape; the shape must have vertices."""

    def __init__(self, shape: LiveEquilibrium):
        assert shape.vertices is not None and shape.quads is not None and shape.distance is not None
        super().__init__(shape.vertices, shape.quads)
        far = 1e3 * shape.distance
        self._end = float(SCALE_ENDS[min(int(np.searchsorted(SCALE_ENDS, far.max(initial=0.0))), len(SCALE_ENDS) - 1)])
        self._share = np.clip(far / self._end, 0.0, 1.0)
        title = translate("Live: distance to the target, RMS {:.2f} mm", 1e3 * shape.rms)
        self.legend = Legend(title, "0", f"{self._end:g} mm", colours.mix_with_white(colours.ERROR_SCALE))

    @classmethod
    def from_shape(cls, shape: LiveEquilibrium, unit: float) -> LiveModeShape | None:
        """Make the picture of a shape, ready to be drawn; return None if the shape has no vertices yet.

        Parameters
        ----------
        shape : live shape to draw
        unit : metres in one unit of the scene
        """
        if shape.vertices is None:
            return None
        made = cls(shape)
        made.prepare(unit)
        return made

    @property
    def colours(self) -> np.ndarray:
        return colours.interpolate_scale(self._share, colours.mix_with_white(colours.ERROR_SCALE))
