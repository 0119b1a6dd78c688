"""A piece that follows a hand, coloured by how far it is from its target."""

from __future__ import annotations

import numpy as np

from ...engine import colours
from ...engine.live.piece import Shape
from ..store.i18n import translate
from .legend import Legend
from .live_shape import LiveShape

PALE = 0.5 + 0.5 * colours.BAD  # the ink of the lines stands out from every colour of the scale
# millimetres at which the scale may end: it steps from one to the next, or colours would flicker while a piece moves
ENDS = np.array([1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0, 500.0])


class Followed(LiveShape):
    """What there is to see of a shape that there is something of."""

    def __init__(self, shape: Shape):
        assert shape.vertices is not None and shape.quads is not None and shape.distance is not None
        super().__init__(shape.vertices, shape.quads)
        far = 1e3 * shape.distance
        self._end = float(ENDS[min(int(np.searchsorted(ENDS, far.max(initial=0.0))), len(ENDS) - 1)])
        self._share = np.clip(far / self._end, 0.0, 1.0)
        title = translate("Live: distance to the target, RMS {:.2f} mm", 1e3 * shape.rms)
        self.legend = Legend(title, "0", f"{self._end:g} mm", PALE)

    @classmethod
    def of(cls, shape: Shape, unit: float) -> Followed | None:
        """Ready to be drawn, in a scene of this unit; None where there is nothing yet."""
        if shape.vertices is None:
            return None
        made = cls(shape)
        made.prepared(unit)
        return made

    @property
    def colours(self) -> np.ndarray:
        anchors = np.linspace(0.0, 1.0, len(PALE))
        return np.stack([np.interp(self._share, anchors, PALE[:, k]) for k in range(3)], axis=1)
