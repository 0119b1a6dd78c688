"""Coordinates of the fabricable designs in which their coupled bounds are a box (FlexMaps section 7).

Per spiral, x0 in [0, 1] is the width between its smallest and its largest; x1 in [0, 1] runs from the smallest twist to the
largest one that still leaves a slot at that width in that quad, evenly in sqrt(1 + twist^2). That is about how long, and so
how compliant, an arm is; a straight arm would not feel a small twist, and a gradient by the twist itself would be blind there.
Any x in the box is a design whose spirals can be cut; what blended joints and neighbours ask for beyond that is settled by
``design.fitted`` and comes back as ``cap``.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..arrays import Float
from ..mechanics.arms.stiffness import SCALE_RANGE, twist_limit
from ..mechanics.assembly import Assembly
from ..progress import SILENT, Progress
from ..spirals.design import SpiralDesign, width_range
from ..spirals.slots import twist_bound

# widths at which the largest twist is computed; in between it is interpolated. Not measured: what is cut is checked
# again
KNOTS = 6
START = 1e-2  # a little twist even at the lower end of x1, where the slope would be infinite


def _share(x: np.ndarray) -> np.ndarray:
    return (x + START) / (1.0 + START)


@dataclass(frozen=True, eq=False)
class DesignSpace:
    """low, high : (F,) metres, range of the width; bound : (KNOTS, F) radians, largest twist at evenly spaced widths;
    cap : (F,) share of it that neighbours leave; twist_min : radians
    """

    low: Float[np.ndarray, " quads"]
    high: Float[np.ndarray, " quads"]
    bound: Float[np.ndarray, "knots quads"]
    cap: Float[np.ndarray, " quads"]
    twist_min: float

    @classmethod
    def of(cls, design: SpiralDesign, assembly: Assembly, progress: Progress = SILENT) -> DesignSpace:
        """The space of all designs in the same patches with the same settings."""
        low, high = width_range(design.flat, design.params)
        widths = low + np.linspace(0.0, 1.0, KNOTS)[:, None] * (high - low)
        bound = np.stack([twist_bound(design.flat, design.params, w, progress) for w in widths])
        # nor beyond the stiffness table, whose limit is that of the shortest arm
        shortest = np.full(len(low), np.inf)
        np.minimum.at(shortest, assembly.pairs, 2.0 * assembly.radius)
        ratio = np.maximum(np.where(np.isfinite(shortest), shortest, 1.0) / widths, SCALE_RANGE[0])
        return cls(low, high, np.minimum(bound, 0.999 * twist_limit(ratio)), np.ones(len(low)), design.params.twist_min)

    def limited(self, width: np.ndarray, twist: np.ndarray, where: np.ndarray) -> DesignSpace:
        """With twists (F,) radians as the largest, at widths (F,) metres, for some spirals (F,) bool."""
        x = np.clip((width - self.low) / np.maximum(self.high - self.low, 1e-12), 0.0, 1.0)
        share = self.cap * twist / np.maximum(self._largest(x)[0], 1e-12)
        return replace(self, cap=np.where(where, np.minimum(share, self.cap), self.cap))

    def design(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Widths (F,) metres and twists (F,) radians of coordinates (F, 2)."""
        least, span = self._lengths(x[:, 0])[:2]
        twist = np.sqrt((least + _share(x[:, 1]) * span) ** 2 - 1.0)
        return self.low + x[:, 0] * (self.high - self.low), twist

    def slopes(self, x: np.ndarray) -> Float[np.ndarray, "quads 2 2"]:
        """(F, 2, 2): derivative of width and twist (rows) by both coordinates (columns)."""
        least, span, least_change, change = self._lengths(x[:, 0])
        length = least + _share(x[:, 1]) * span
        by_length = length / np.sqrt(length**2 - 1.0)
        out = np.zeros((len(x), 2, 2))
        out[:, 0, 0] = self.high - self.low
        out[:, 1, 0] = by_length * (least_change + _share(x[:, 1]) * change)
        out[:, 1, 1] = by_length * span / (1.0 + START)
        return out

    def coordinates(self, width: np.ndarray, twist: np.ndarray) -> Float[np.ndarray, "quads 2"]:
        """(F, 2) of widths and twists, brought into the box."""
        x = np.zeros((len(width), 2))
        x[:, 0] = np.clip((width - self.low) / np.maximum(self.high - self.low, 1e-12), 0.0, 1.0)
        least, span = self._lengths(x[:, 0])[:2]
        share = (np.sqrt(1.0 + twist**2) - least) / np.maximum(span, 1e-12)
        x[:, 1] = np.clip(share * (1.0 + START) - START, 0.0, 1.0)
        return x

    def _lengths(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """sqrt(1 + twist^2) of the smallest twist, from there to that of the largest, and the derivatives of both."""
        largest, slope = self._largest(x)
        cut = self.twist_min > 0.9 * largest
        least = np.sqrt(1.0 + np.where(cut, 0.9 * largest, self.twist_min) ** 2)
        most = np.sqrt(1.0 + np.maximum(largest, 1e-3) ** 2)
        least_change = np.where(cut, 0.81 * largest * slope / least, 0.0)
        return least, most - least, least_change, largest * slope / most - least_change

    def _largest(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Largest twist at widths x in [0, 1], and its derivative: cubic Hermite pieces between the knots."""
        k = np.minimum((x * (KNOTS - 1)).astype(np.int64), KNOTS - 2)
        u, every = x * (KNOTS - 1) - k, np.arange(len(x))
        steps = np.diff(self.bound, axis=0)
        # harmonic means of the neighbouring steps: between two knots nothing rises above either of them
        inner = 2.0 * steps[1:] * steps[:-1] / np.minimum(steps[1:] + steps[:-1], -1e-300)
        inner = np.where(steps[1:] * steps[:-1] > 0.0, inner, 0.0)
        slope = np.concatenate([steps[:1], inner, steps[-1:]])
        a, b, da, db = self.bound[k, every], self.bound[k + 1, every], slope[k, every], slope[k + 1, every]
        value = a + u * (da + u * (3.0 * (b - a) - 2.0 * da - db + u * (da + db - 2.0 * (b - a))))
        change = da + u * (2.0 * (3.0 * (b - a) - 2.0 * da - db) + 3.0 * u * (da + db - 2.0 * (b - a)))
        return self.cap * value, self.cap * change * (KNOTS - 1)
