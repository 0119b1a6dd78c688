"""Design variables in which the coupled bounds of width and twist become a box (FlexMaps section 7).

The design variables x, all in [0, 1], list the spirals one after the other. A spiral has one variable for the width of
each of its 1, 2 or 4 groups of arms (arm k is in group k modulo their number), from the smallest to the largest width.
Its last variable gives the twist, from the smallest twist to the largest that still leaves a slot at the spiral's mean
width. This variable is linear in sqrt(1 + twist^2), which is about the length of an arm and determines its compliance;
the gradient with respect to the twist itself would be 0 at straight arms.

Every x in the box gives spirals that can be cut if they are alone. ``fabricable.make_fabricable`` ensures that they can
be cut beside their neighbours; ``extended_to`` then lowers the largest twists by ``twist_factor``.
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

# Number of widths at which the largest twist is computed; it is interpolated in between. Larger: more accurate (with 6
# it is at most 1.3 degrees too large), slower to prepare (docs/tuning.md)
KNOTS = 6
STRAIGHT_TWIST = 1e-3  # radians, largest twist of spirals that must be straight; 0 would lead to a division by 0
# Share left out at the lower end of the range of arm lengths, where the derivative of the twist may be infinite
LENGTH_OFFSET = 1e-2


def _length_share(x: np.ndarray) -> np.ndarray:
    """Convert design variables of twists to shares of the range of arm lengths; 0 becomes slightly more than 0."""
    return (x + LENGTH_OFFSET) / (1.0 + LENGTH_OFFSET)


@dataclass(frozen=True, eq=False)
class FixedSpirals:
    """Spirals that a search must not change; quads : their numbers; width : metres; twist : radians."""

    quads: Int[np.ndarray, " kept"]
    width: Float[np.ndarray, "kept 4"]
    twist: Float[np.ndarray, " kept"]

    @classmethod
    def from_design(cls, design: SpiralDesign, quads: Int[np.ndarray, " kept"]) -> FixedSpirals:
        """Fix the spirals in ``quads`` at their widths and twists in a design."""
        return cls(quads, design.width[quads], design.twist[quads])


@dataclass(frozen=True, eq=False)
class DesignSpace:
    """Map between design variables in [0, 1] and designs in the same patches; F quads.

    min_width, max_width : (F,) metres, range of the width; max_twists : (KNOTS, F) radians, largest twist at evenly
        spaced widths
    twist_factor : (F,) factor on ``max_twists``, below 1 where neighbours need the space; twist_min : radians, smallest
        twist
    n_groups : number of groups of arms, 1, 2 or 4; the arms of a group have the same width
    fixed_spirals : fixed spirals, which do not depend on their design variables
    """

    min_width: Float[np.ndarray, " quads"]
    max_width: Float[np.ndarray, " quads"]
    max_twists: Float[np.ndarray, "knots quads"]
    twist_factor: Float[np.ndarray, " quads"]
    twist_min: float
    n_groups: int
    fixed_spirals: FixedSpirals | None = None

    @classmethod
    def from_design(
        cls,
        design: SpiralDesign,
        assembly: Assembly,
        groups: int = 1,
        progress: Progress = SILENT,
        constraints: Constraints = NO_CONSTRAINTS,
    ) -> DesignSpace:
        """Return the space of all designs with the patches and settings of a design.

        Parameters
        ----------
        design, assembly : give patches and settings; widths and twists matter only for spirals that stay unchanged
        groups : number of groups of arms, 1, 2 or 4
        progress : reports progress and raises Cancelled
        constraints : spirals that must stay unchanged, be straight or be as wide as possible
        """
        low, high = width_range(design.flat, design.params)
        low[constraints.wide] = high[constraints.wide]
        widths = low + np.linspace(0.0, 1.0, KNOTS)[:, None] * (high - low)
        bound = np.stack([twist_bound(design.flat, design.params, same_width(w), progress) for w in widths])
        # the stiffness table covers twists up to a limit, which depends on the shortest arm
        shortest = np.full(len(low), np.inf)
        np.minimum.at(shortest, assembly.pairs, 2.0 * assembly.radius)
        ratio = np.maximum(np.where(np.isfinite(shortest), shortest, 1.0) / widths, SCALE_RANGE[0])
        bound = np.minimum(bound, 0.999 * table_twist_limit(ratio))
        bound[:, constraints.straight] = np.minimum(bound[:, constraints.straight], STRAIGHT_TWIST)
        kept = np.union1d(constraints.fixed, np.flatnonzero(design.has_solid_hub)).astype(np.int64)
        same = FixedSpirals.from_design(design, kept) if len(kept) else None
        return cls(low, high, bound, np.ones(len(low)), design.params.twist_min, groups, same)

    @property
    def coordinates_per_spiral(self) -> int:
        """Number of design variables of one spiral."""
        return self.n_groups + 1

    def by_spiral(self, x: np.ndarray) -> Float[np.ndarray, "quads _"]:
        """Return the spirals' design variables as (F, groups + 1), without the flat vertices at the end of x."""
        return x[: len(self.min_width) * self.coordinates_per_spiral].reshape(-1, self.coordinates_per_spiral)

    def uniform(self, width: float, twist: float) -> Float[np.ndarray, " _"]:
        """Return design variables x that are equal for all spirals.

        Parameters
        ----------
        width, twist : design variables of widths and of twists, in [0, 1]
        """
        return np.tile([width] * self.n_groups + [twist], len(self.min_width))

    def extended_to(self, design: SpiralDesign) -> DesignSpace:
        """Return this space extended so that it contains a design.

        Smaller widths are allowed where needed. Where even the smallest twist of the space exceeds the design's, the
        largest twist is lowered.
        """
        space = replace(self, min_width=np.minimum(self.min_width, design.width.min(axis=1)))
        least = space.width_and_twist(space.coordinates(design.width, design.twist))[1]
        return space._limit_twist(design.width, design.twist, least > design.twist + 1e-12)

    def with_twist_limits(self, design: SpiralDesign, where: Bool[np.ndarray, " quads"]) -> DesignSpace:
        """Return a space in which some spirals cannot have more twist than in a design.

        Parameters
        ----------
        design : a design of the space
        where : mask of the spirals to limit
        """
        return self._limit_twist(design.width, design.twist, where)

    def with_fixed_spirals(self, design: SpiralDesign, quads: Int[np.ndarray, " kept"]) -> DesignSpace:
        """Return a space in which more spirals are fixed; all fixed spirals get their widths and twists in a design.

        Parameters
        ----------
        design : a design of the space
        quads : spirals to fix
        """
        kept = quads if self.fixed_spirals is None else np.union1d(self.fixed_spirals.quads, quads)
        return replace(
            self, fixed_spirals=FixedSpirals.from_design(design, kept.astype(np.int64)) if len(kept) else None
        )

    def _limit_twist(
        self, width: Float[np.ndarray, "quads 4"], twist: Float[np.ndarray, " quads"], where: np.ndarray
    ) -> DesignSpace:
        """Return a space where the twist of the spirals ``where`` (F,) is at most ``twist`` at these widths."""
        x = self._width_shares(width).mean(axis=1)
        share = self.twist_factor * twist / np.maximum(self._max_twist(x)[0], 1e-12)
        return replace(self, twist_factor=np.where(where, np.minimum(share, self.twist_factor), self.twist_factor))

    def width_and_twist(self, x: np.ndarray) -> tuple[Float[np.ndarray, "quads 4"], Float[np.ndarray, " quads"]]:
        """Return the widths (F, 4), metres, and twists (F,), radians, at design variables x."""
        x = self.by_spiral(x)
        shares = x[:, : self.n_groups]
        least, span = self._length_range(shares.mean(axis=1))[:2]
        twist = np.sqrt((least + _length_share(x[:, -1]) * span) ** 2 - 1.0)
        width = self.min_width[:, None] + shares[:, self._group_of_arm] * (self.max_width - self.min_width)[:, None]
        if self.fixed_spirals is not None:
            width[self.fixed_spirals.quads], twist[self.fixed_spirals.quads] = (
                self.fixed_spirals.width,
                self.fixed_spirals.twist,
            )
        return width, twist

    def spiral_jacobians(self, x: np.ndarray) -> Float[np.ndarray, "quads 5 _"]:
        """Return the derivatives of every spiral's four widths and twist (rows) by its design variables (columns)."""
        x = self.by_spiral(x)
        least, span, least_change, change = self._length_range(x[:, : self.n_groups].mean(axis=1))
        length = least + _length_share(x[:, -1]) * span
        by_length = length / np.sqrt(length**2 - 1.0)
        out = np.zeros((len(x), 5, self.coordinates_per_spiral))
        out[:, np.arange(4), self._group_of_arm] = (self.max_width - self.min_width)[:, None]
        by_width = by_length * (least_change + _length_share(x[:, -1]) * change) / self.n_groups
        out[:, 4, : self.n_groups] = by_width[:, None]
        out[:, 4, -1] = by_length * span / (1.0 + LENGTH_OFFSET)
        if self.fixed_spirals is not None:
            out[self.fixed_spirals.quads] = 0.0
        return out

    def jacobian(self, x: np.ndarray) -> csr_array:
        """Return the Jacobian (5 n, coordinates) of all widths (4 n rows), then of all twists (n rows), at x."""
        slopes = self.spiral_jacobians(x)
        n, _, each = slopes.shape
        column = (each * np.arange(n)[:, None] + np.arange(each)).astype(np.int32)
        columns = np.concatenate([np.repeat(column, 4, axis=0).ravel(), column.ravel()])
        data = np.concatenate([slopes[:, :4].ravel(), slopes[:, 4].ravel()])
        return csr_array((data, columns, np.arange(0, data.size + 1, each, dtype=np.int32)), shape=(5 * n, len(x)))

    @property
    def free_spirals(self) -> Bool[np.ndarray, " quads"]:
        """Mask of the spirals that are not fixed."""
        free = np.ones(len(self.min_width), dtype=bool)
        if self.fixed_spirals is not None:
            free[self.fixed_spirals.quads] = False
        return free

    def coordinates(
        self, width: Float[np.ndarray, "quads 4"], twist: Float[np.ndarray, " quads"]
    ) -> Float[np.ndarray, " _"]:
        """Return the design variables of widths and twists, clipped to [0, 1].

        Parameters
        ----------
        width : (F, 4) metres; all arms of a group get their mean width
        twist : (F,) radians
        """
        shares = self._width_shares(width)
        least, span = self._length_range(shares.mean(axis=1))[:2]
        wound = (np.sqrt(1.0 + twist**2) - least) / np.maximum(span, 1e-12)
        wound = np.clip(wound * (1.0 + LENGTH_OFFSET) - LENGTH_OFFSET, 0.0, 1.0)
        return np.concatenate([shares, wound[:, None]], axis=1).ravel()

    @property
    def _group_of_arm(self) -> Int[np.ndarray, " 4"]:
        """Index of the group of every arm."""
        return np.arange(4) % self.n_groups

    def _width_shares(self, width: np.ndarray) -> Float[np.ndarray, "quads _"]:
        """Return the mean width of every group (F, groups) as a share of the spiral's range, clipped to [0, 1]."""
        mean = width.reshape(len(width), -1, self.n_groups).mean(axis=1)
        span = np.maximum(self.max_width - self.min_width, 1e-12)
        return np.clip((mean - self.min_width[:, None]) / span[:, None], 0.0, 1.0)

    def _length_range(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Return the allowed range of sqrt(1 + twist^2), about an arm's length over that of a straight arm.

        x : (F,) mean widths as shares of the allowed range, 0 to 1

        Returns
        -------
        four arrays (F,): lower end of the range, its extent (upper minus lower end), and the derivatives of both by x
        """
        largest, slope = self._max_twist(x)
        cut = self.twist_min > 0.9 * largest
        least = np.sqrt(1.0 + np.where(cut, 0.9 * largest, self.twist_min) ** 2)
        most = np.sqrt(1.0 + np.maximum(largest, 1e-3) ** 2)
        least_change = np.where(cut, 0.81 * largest * slope / least, 0.0)
        return least, most - least, least_change, largest * slope / most - least_change

    def _max_twist(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the largest twists (F,), radians, and their derivatives by x, interpolated by Hermite splines.

        x : (F,) mean widths as shares of the allowed range, 0 to 1
        """
        k = np.minimum((x * (KNOTS - 1)).astype(np.int64), KNOTS - 2)
        u, every = x * (KNOTS - 1) - k, np.arange(len(x))
        steps = np.diff(self.max_twists, axis=0)
        # with harmonic means of neighbouring differences as slopes, the interpolation does not overshoot its knots
        inner = 2.0 * steps[1:] * steps[:-1] / np.minimum(steps[1:] + steps[:-1], -1e-300)
        inner = np.where(steps[1:] * steps[:-1] > 0.0, inner, 0.0)
        slope = np.concatenate([steps[:1], inner, steps[-1:]])
        a, b, da, db = self.max_twists[k, every], self.max_twists[k + 1, every], slope[k, every], slope[k + 1, every]
        value = a + u * (da + u * (3.0 * (b - a) - 2.0 * da - db + u * (da + db - 2.0 * (b - a))))
        change = da + u * (2.0 * (3.0 * (b - a) - 2.0 * da - db) + 3.0 * u * (da + db - 2.0 * (b - a)))
        return self.twist_factor * value, self.twist_factor * change * (KNOTS - 1)
