"""Coordinates of the fabricable designs in which their coupled bounds are a box (FlexMaps section 7).

Per spiral, first the widths of its groups of arms (all alike, in pairs or each its own; arm k is in group k modulo their
number), each in [0, 1] between the smallest and the largest. The last number in [0, 1] runs from the smallest twist to the
largest one that still leaves a slot at the mean width in that quad, evenly in sqrt(1 + twist^2). That is about how long, and so
how compliant, an arm is; a straight arm would not feel a small twist, and a gradient by the twist itself would be blind there.
The numbers of all spirals, one spiral after the other, are one vector x.
Any x in the box is a design whose spirals can be cut; what blended joints and neighbours ask for beyond that is settled by
``design.fitted`` and comes back as ``cap``.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..arrays import Bool, Float, Int
from ..mechanics.assembly import Assembly
from ..progress import SILENT, Progress
from ..spirals.constraints import FREE, Constraints
from ..spirals.design import SpiralDesign, width_range
from ..spirals.known import SCALE_RANGE, twist_limit
from ..spirals.slots import twist_bound
from ..spirals.spiral import alike

# widths at which the largest twist is computed; in between it is interpolated. Not measured: what is cut is checked
# again
KNOTS = 6
STRAIGHT = 1e-3  # radians that spirals may be wound which are to be straight: 0 would leave nothing to divide by
START = 1e-2  # a little twist even at the lower end of x1, where the slope would be infinite


def _share(x: np.ndarray) -> np.ndarray:
    return (x + START) / (1.0 + START)


@dataclass(frozen=True, eq=False)
class Kept:
    """Spirals that a search must leave as they are: which, their widths in metres and their twists in radians."""

    quads: Int[np.ndarray, " kept"]
    width: Float[np.ndarray, "kept 4"]
    twist: Float[np.ndarray, " kept"]

    @classmethod
    def of(cls, design: SpiralDesign, quads: Int[np.ndarray, " kept"]) -> Kept:
        return cls(quads, design.width[quads], design.twist[quads])


@dataclass(frozen=True, eq=False)
class DesignSpace:
    """low, high : (F,) metres, range of the width; bound : (KNOTS, F) radians, largest twist at evenly spaced widths;
    cap : (F,) share of it that neighbours leave; twist_min : radians; groups : of arms with one width, 1, 2 or 4
    kept : the spirals that stay as they are whatever their coordinates say, if there are any
    """

    low: Float[np.ndarray, " quads"]
    high: Float[np.ndarray, " quads"]
    bound: Float[np.ndarray, "knots quads"]
    cap: Float[np.ndarray, " quads"]
    twist_min: float
    groups: int
    kept: Kept | None = None

    @classmethod
    def of(
        cls,
        design: SpiralDesign,
        assembly: Assembly,
        groups: int = 1,
        progress: Progress = SILENT,
        constraints: Constraints = FREE,
    ) -> DesignSpace:
        """The space of all designs in the same patches with the same settings, as far as the constraints allow."""
        low, high = width_range(design.flat, design.params)
        low[constraints.wide] = high[constraints.wide]
        widths = low + np.linspace(0.0, 1.0, KNOTS)[:, None] * (high - low)
        bound = np.stack([twist_bound(design.flat, design.params, alike(w), progress) for w in widths])
        # nor beyond the stiffness table, whose limit is that of the shortest arm
        shortest = np.full(len(low), np.inf)
        np.minimum.at(shortest, assembly.pairs, 2.0 * assembly.radius)
        ratio = np.maximum(np.where(np.isfinite(shortest), shortest, 1.0) / widths, SCALE_RANGE[0])
        bound = np.minimum(bound, 0.999 * twist_limit(ratio))
        bound[:, constraints.straight] = np.minimum(bound[:, constraints.straight], STRAIGHT)
        kept = np.union1d(constraints.kept, np.flatnonzero(design.solid)).astype(np.int64)
        same = Kept.of(design, kept) if len(kept) else None
        return cls(low, high, bound, np.ones(len(low)), design.params.twist_min, groups, same)

    @property
    def each(self) -> int:
        """Coordinates of one spiral."""
        return self.groups + 1

    def by_spiral(self, x: np.ndarray) -> Float[np.ndarray, "quads _"]:
        """(F, groups + 1) of the coordinates (F (groups + 1),) of all spirals; what follows them is left out."""
        return x[: len(self.low) * self.each].reshape(-1, self.each)

    def filled(self, width: float, twist: float) -> Float[np.ndarray, " _"]:
        """The same coordinates of width and twist for every spiral."""
        return np.tile([width] * self.groups + [twist], len(self.low))

    def including(self, design: SpiralDesign) -> DesignSpace:
        """The space in which this design is too: with thinner arms, and less wound ones, where there is no more room."""
        space = replace(self, low=np.minimum(self.low, design.width.min(axis=1)))
        least = space.design(space.coordinates(design.width, design.twist))[1]
        return space._limited(design.width, design.twist, least > design.twist + 1e-12)

    def winding_at_most(self, design: SpiralDesign, where: Bool[np.ndarray, " quads"]) -> DesignSpace:
        """Limit the twist of some spirals to that of a design in the space."""
        return self._limited(design.width, design.twist, where)

    def keeping(self, design: SpiralDesign, quads: Int[np.ndarray, " kept"]) -> DesignSpace:
        """Also keep these spirals fixed at the values of a design."""
        kept = quads if self.kept is None else np.union1d(self.kept.quads, quads)
        return replace(self, kept=Kept.of(design, kept.astype(np.int64)) if len(kept) else None)

    def _limited(
        self, width: Float[np.ndarray, "quads 4"], twist: Float[np.ndarray, " quads"], where: np.ndarray
    ) -> DesignSpace:
        """With these twists, radians, as the largest, at these widths, metres, for some spirals (F,) bool."""
        x = self._shares(width).mean(axis=1)
        share = self.cap * twist / np.maximum(self._largest(x)[0], 1e-12)
        return replace(self, cap=np.where(where, np.minimum(share, self.cap), self.cap))

    def design(self, x: np.ndarray) -> tuple[Float[np.ndarray, "quads 4"], Float[np.ndarray, " quads"]]:
        """Widths (F, 4) metres and twists (F,) radians of coordinates."""
        x = self.by_spiral(x)
        shares = x[:, : self.groups]
        least, span = self._lengths(shares.mean(axis=1))[:2]
        twist = np.sqrt((least + _share(x[:, -1]) * span) ** 2 - 1.0)
        width = self.low[:, None] + shares[:, self._group] * (self.high - self.low)[:, None]
        if self.kept is not None:
            width[self.kept.quads], twist[self.kept.quads] = self.kept.width, self.kept.twist
        return width, twist

    def slopes(self, x: np.ndarray) -> Float[np.ndarray, "quads 5 _"]:
        """(F, 5, groups + 1): derivative of the widths and the twist (rows) by the coordinates of their spiral (columns)."""
        x = self.by_spiral(x)
        least, span, least_change, change = self._lengths(x[:, : self.groups].mean(axis=1))
        length = least + _share(x[:, -1]) * span
        by_length = length / np.sqrt(length**2 - 1.0)
        out = np.zeros((len(x), 5, self.each))
        out[:, np.arange(4), self._group] = (self.high - self.low)[:, None]
        by_width = by_length * (least_change + _share(x[:, -1]) * change) / self.groups
        out[:, 4, : self.groups] = by_width[:, None]
        out[:, 4, -1] = by_length * span / (1.0 + START)
        if self.kept is not None:
            out[self.kept.quads] = 0.0
        return out

    @property
    def free(self) -> Bool[np.ndarray, " quads"]:
        """The spirals that their coordinates change."""
        free = np.ones(len(self.low), dtype=bool)
        if self.kept is not None:
            free[self.kept.quads] = False
        return free

    def coordinates(
        self, width: Float[np.ndarray, "quads 4"], twist: Float[np.ndarray, " quads"]
    ) -> Float[np.ndarray, " _"]:
        """Of widths and twists, brought into the box; arms of one group get their mean width."""
        shares = self._shares(width)
        least, span = self._lengths(shares.mean(axis=1))[:2]
        wound = (np.sqrt(1.0 + twist**2) - least) / np.maximum(span, 1e-12)
        wound = np.clip(wound * (1.0 + START) - START, 0.0, 1.0)
        return np.concatenate([shares, wound[:, None]], axis=1).ravel()

    @property
    def _group(self) -> Int[np.ndarray, " 4"]:
        """The group of every arm."""
        return np.arange(4) % self.groups

    def _shares(self, width: np.ndarray) -> Float[np.ndarray, "quads _"]:
        """(F, groups) mean widths as shares of their range."""
        mean = width.reshape(len(width), -1, self.groups).mean(axis=1)
        span = np.maximum(self.high - self.low, 1e-12)
        return np.clip((mean - self.low[:, None]) / span[:, None], 0.0, 1.0)

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
