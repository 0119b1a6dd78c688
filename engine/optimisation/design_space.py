"""Coordinates of fabricable designs in which the coupled bounds of width and twist become a box (FlexMaps section 7).

The coordinates x list one spiral after the other. A spiral has a width for each group of arms (1, 2 or 4 groups; arm k is in group
k modulo their number), in [0, 1] from the smallest to the largest width. Its last coordinate, in [0, 1], is the twist: from the
smallest one to the largest that still leaves a slot at the mean width in that quad, linear in sqrt(1 + twist^2). That is about the
length of an arm, which decides its compliance. The twist itself would have a gradient of 0 at straight arms.
Every x in the box gives spirals that can be cut on their own. ``fabricable.make_fabricable`` enforces the demands of blended joints and
neighbours; ``including`` then lowers the largest twists by ``cap``.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import csr_array

from ..arrays import Bool, Float, Int
from ..mechanics.assembly import Assembly
from ..progress import SILENT, Progress
from ..spirals.clearance.slots import twist_bound, width_range
from ..spirals.clearance.table_range import SCALE_RANGE, table_twist_limit
from ..spirals.constraints import NO_CONSTRAINTS, Constraints
from ..spirals.curves.spiral import same_width
from ..spirals.design import SpiralDesign

# Number of widths at which the largest twist is computed, and interpolated between; more take longer to prepare. Over five surfaces the
# interpolated twist is at most 1.3 degrees too large (11 widths: 0.4) and, at a hundredth of the spirals, 6 too small (11: 2.4)
KNOTS = 6
STRAIGHT_TWIST = 1e-3  # radians, largest twist of spirals that shall be straight; 0 would lead to a division by 0
# share of the range of lengths left out at its lower end, where the derivative of the twist may be infinite
LENGTH_OFFSET = 1e-2


def _length_share(x: np.ndarray) -> np.ndarray:
    """Return the share of the range of lengths at twist coordinates in [0, 1]: slightly more than 0 at the lower end."""
    return (x + LENGTH_OFFSET) / (1.0 + LENGTH_OFFSET)


@dataclass(frozen=True, eq=False)
class FixedSpirals:
    """Spirals that a search must not change; width : metres; twist : radians."""

    quads: Int[np.ndarray, " kept"]
    width: Float[np.ndarray, "kept 4"]
    twist: Float[np.ndarray, " kept"]

    @classmethod
    def from_design(cls, design: SpiralDesign, quads: Int[np.ndarray, " kept"]) -> FixedSpirals:
        """Return these spirals with their widths and twists in a design."""
        return cls(quads, design.width[quads], design.twist[quads])


@dataclass(frozen=True, eq=False)
class DesignSpace:
    """Map between coordinates in [0, 1] and designs in the same patches; F quads.

    low, high : (F,) metres, range of the width; bound : (KNOTS, F) radians, largest twist at evenly spaced widths
    cap : (F,) factor on ``bound``, below 1 where neighbours need the space; twist_min : radians, smallest twist
    groups : number of groups of arms with one width, 1, 2 or 4; kept : spirals that do not depend on their coordinates
    """

    low: Float[np.ndarray, " quads"]
    high: Float[np.ndarray, " quads"]
    bound: Float[np.ndarray, "knots quads"]
    cap: Float[np.ndarray, " quads"]
    twist_min: float
    groups: int
    kept: FixedSpirals | None = None

    @classmethod
    def from_design(
        cls,
        design: SpiralDesign,
        assembly: Assembly,
        groups: int = 1,
        progress: Progress = SILENT,
        constraints: Constraints = NO_CONSTRAINTS,
    ) -> DesignSpace:
        """Return the space of all designs that have the patches and settings of a design.

        Parameters
        ----------
        design, assembly : with the patches and settings; its widths and twists matter for kept spirals only
        groups : number of groups of arms with one width, 1, 2 or 4
        progress : reports progress and raises Cancelled
        constraints : spirals that must be kept, straight or as wide as possible
        """
        low, high = width_range(design.flat, design.params)
        low[constraints.wide] = high[constraints.wide]
        widths = low + np.linspace(0.0, 1.0, KNOTS)[:, None] * (high - low)
        bound = np.stack([twist_bound(design.flat, design.params, same_width(w), progress) for w in widths])
        # the stiffness table ends at a largest twist, which depends on the shortest arm
        shortest = np.full(len(low), np.inf)
        np.minimum.at(shortest, assembly.pairs, 2.0 * assembly.radius)
        ratio = np.maximum(np.where(np.isfinite(shortest), shortest, 1.0) / widths, SCALE_RANGE[0])
        bound = np.minimum(bound, 0.999 * table_twist_limit(ratio))
        bound[:, constraints.straight] = np.minimum(bound[:, constraints.straight], STRAIGHT_TWIST)
        kept = np.union1d(constraints.kept, np.flatnonzero(design.solid)).astype(np.int64)
        same = FixedSpirals.from_design(design, kept) if len(kept) else None
        return cls(low, high, bound, np.ones(len(low)), design.params.twist_min, groups, same)

    @property
    def each(self) -> int:
        """Number of coordinates of one spiral."""
        return self.groups + 1

    def by_spiral(self, x: np.ndarray) -> Float[np.ndarray, "quads _"]:
        """Return the spirals' coordinates as (F, groups + 1); entries of x after them (flat vertices) are left out."""
        return x[: len(self.low) * self.each].reshape(-1, self.each)

    def uniform(self, width: float, twist: float) -> Float[np.ndarray, " _"]:
        """Return x with these two coordinates, in [0, 1], for every spiral.

        Parameters
        ----------
        width, twist : in [0, 1]
        """
        return np.tile([width] * self.groups + [twist], len(self.low))

    def including(self, design: SpiralDesign) -> DesignSpace:
        """Return a space that contains this design: smaller widths are allowed, and twists limited to the design's, where needed.

        Twists are limited where even the smallest one in the space would exceed the design's.
        """
        space = replace(self, low=np.minimum(self.low, design.width.min(axis=1)))
        least = space.design(space.coordinates(design.width, design.twist))[1]
        return space._limit_twist(design.width, design.twist, least > design.twist + 1e-12)

    def winding_at_most(self, design: SpiralDesign, where: Bool[np.ndarray, " quads"]) -> DesignSpace:
        """Limit the twist of the spirals ``where`` to the twist in a design of the space.

        Parameters
        ----------
        design : a design of the space
        where : spirals to limit
        """
        return self._limit_twist(design.width, design.twist, where)

    def keeping(self, design: SpiralDesign, quads: Int[np.ndarray, " kept"]) -> DesignSpace:
        """Fix these spirals, beside those already fixed, at the values of a design.

        Parameters
        ----------
        design : a design of the space
        quads : spirals to fix
        """
        kept = quads if self.kept is None else np.union1d(self.kept.quads, quads)
        return replace(self, kept=FixedSpirals.from_design(design, kept.astype(np.int64)) if len(kept) else None)

    def _limit_twist(
        self, width: Float[np.ndarray, "quads 4"], twist: Float[np.ndarray, " quads"], where: np.ndarray
    ) -> DesignSpace:
        """Limit the twist of the spirals ``where`` (F,) bool to these twists, radians, at these widths, metres."""
        x = self._width_shares(width).mean(axis=1)
        share = self.cap * twist / np.maximum(self._max_twist(x)[0], 1e-12)
        return replace(self, cap=np.where(where, np.minimum(share, self.cap), self.cap))

    def design(self, x: np.ndarray) -> tuple[Float[np.ndarray, "quads 4"], Float[np.ndarray, " quads"]]:
        """Return the widths (F, 4), metres, and twists (F,), radians, at coordinates x."""
        x = self.by_spiral(x)
        shares = x[:, : self.groups]
        least, span = self._length_range(shares.mean(axis=1))[:2]
        twist = np.sqrt((least + _length_share(x[:, -1]) * span) ** 2 - 1.0)
        width = self.low[:, None] + shares[:, self._group_of_arm] * (self.high - self.low)[:, None]
        if self.kept is not None:
            width[self.kept.quads], twist[self.kept.quads] = self.kept.width, self.kept.twist
        return width, twist

    def slopes(self, x: np.ndarray) -> Float[np.ndarray, "quads 5 _"]:
        """Return the derivatives of the four widths and the twist (rows) by the coordinates of their spiral (columns)."""
        x = self.by_spiral(x)
        least, span, least_change, change = self._length_range(x[:, : self.groups].mean(axis=1))
        length = least + _length_share(x[:, -1]) * span
        by_length = length / np.sqrt(length**2 - 1.0)
        out = np.zeros((len(x), 5, self.each))
        out[:, np.arange(4), self._group_of_arm] = (self.high - self.low)[:, None]
        by_width = by_length * (least_change + _length_share(x[:, -1]) * change) / self.groups
        out[:, 4, : self.groups] = by_width[:, None]
        out[:, 4, -1] = by_length * span / (1.0 + LENGTH_OFFSET)
        if self.kept is not None:
            out[self.kept.quads] = 0.0
        return out

    def jacobian(self, x: np.ndarray) -> csr_array:
        """Return the derivatives (5 n, coordinates) of all widths (4 n), then of all twists (n), by the coordinates."""
        slopes = self.slopes(x)
        n, _, each = slopes.shape
        column = (each * np.arange(n)[:, None] + np.arange(each)).astype(np.int32)
        columns = np.concatenate([np.repeat(column, 4, axis=0).ravel(), column.ravel()])
        data = np.concatenate([slopes[:, :4].ravel(), slopes[:, 4].ravel()])
        return csr_array((data, columns, np.arange(0, data.size + 1, each, dtype=np.int32)), shape=(5 * n, len(x)))

    @property
    def free(self) -> Bool[np.ndarray, " quads"]:
        """Mask of the spirals that depend on their coordinates."""
        free = np.ones(len(self.low), dtype=bool)
        if self.kept is not None:
            free[self.kept.quads] = False
        return free

    def coordinates(
        self, width: Float[np.ndarray, "quads 4"], twist: Float[np.ndarray, " quads"]
    ) -> Float[np.ndarray, " _"]:
        """Return the coordinates of widths, metres, and twists, radians, clipped to the box; a group gets its mean width.

        Parameters
        ----------
        width : metres; a group gets its mean
        twist : radians
        """
        shares = self._width_shares(width)
        least, span = self._length_range(shares.mean(axis=1))[:2]
        wound = (np.sqrt(1.0 + twist**2) - least) / np.maximum(span, 1e-12)
        wound = np.clip(wound * (1.0 + LENGTH_OFFSET) - LENGTH_OFFSET, 0.0, 1.0)
        return np.concatenate([shares, wound[:, None]], axis=1).ravel()

    @property
    def _group_of_arm(self) -> Int[np.ndarray, " 4"]:
        """Index of the group of every arm."""
        return np.arange(4) % self.groups

    def _width_shares(self, width: np.ndarray) -> Float[np.ndarray, "quads _"]:
        """Return the mean widths (F, groups) as shares of their range, clipped to [0, 1]."""
        mean = width.reshape(len(width), -1, self.groups).mean(axis=1)
        span = np.maximum(self.high - self.low, 1e-12)
        return np.clip((mean - self.low[:, None]) / span[:, None], 0.0, 1.0)

    def _length_range(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Return the smallest sqrt(1 + twist^2) at mean widths x in [0, 1], its range from there, and the derivatives of both."""
        largest, slope = self._max_twist(x)
        cut = self.twist_min > 0.9 * largest
        least = np.sqrt(1.0 + np.where(cut, 0.9 * largest, self.twist_min) ** 2)
        most = np.sqrt(1.0 + np.maximum(largest, 1e-3) ** 2)
        least_change = np.where(cut, 0.81 * largest * slope / least, 0.0)
        return least, most - least, least_change, largest * slope / most - least_change

    def _max_twist(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the largest twist, radians, at mean widths x in [0, 1], and its derivative (cubic Hermite interpolation)."""
        k = np.minimum((x * (KNOTS - 1)).astype(np.int64), KNOTS - 2)
        u, every = x * (KNOTS - 1) - k, np.arange(len(x))
        steps = np.diff(self.bound, axis=0)
        # slopes as harmonic means of neighbouring differences keep the interpolation between the values of its two knots
        inner = 2.0 * steps[1:] * steps[:-1] / np.minimum(steps[1:] + steps[:-1], -1e-300)
        inner = np.where(steps[1:] * steps[:-1] > 0.0, inner, 0.0)
        slope = np.concatenate([steps[:1], inner, steps[-1:]])
        a, b, da, db = self.bound[k, every], self.bound[k + 1, every], slope[k, every], slope[k + 1, every]
        value = a + u * (da + u * (3.0 * (b - a) - 2.0 * da - db + u * (da + db - 2.0 * (b - a))))
        change = da + u * (2.0 * (3.0 * (b - a) - 2.0 * da - db) + 3.0 * u * (da + db - 2.0 * (b - a)))
        return self.cap * value, self.cap * change * (KNOTS - 1)
