"""Clearances of a design as smooth functions of widths and twists, with exact derivatives.

A design has gaps between neighbouring arms of a quad over their outer part, between an arm and the arms beside its mate
(the arm across the joint), and between arms of quads that share an edge or a vertex. The inner edge of every blend must
not fold, and the twist of every arm must stay within the range of the stiffness table. Each condition has a clearance
(also called room): 0 at the limit, negative beyond it (closed). A gap has clearance 1 at about twice its required
width; the clearance of a twist is its distance from the limit in radians.

    model = ClearanceModel.from_flat(flat, params)                # once; ``with_flat`` when the flat points move
    terms = model.clearances(width, twist)                        # clearances below SUPPORT with their Jacobian
    model.quads_with_closed_gaps(trial_width, trial_twist, quads) # quads whose steps must be shorter
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from scipy.sparse import csr_array

from ...arrays import Bool, Float, Int
from ...params import SpiralParams
from ...patches.flattening.flatten import FlatPatches
from ..curves.arm_curves import N_ARM_PARAMETERS, ArmCurves
from ..curves.arm_geometry import ArmGeometry
from ..curves.blends import MATE_WIDTH, MATE_WIND, OWN_WIDTH, OWN_WIND, RADIUS
from ..curves.spiral import same_width
from .arm_pairs import ROUND, SAME_QUAD, ArmPairs, find_arm_pairs
from .gaps import find_narrow_gaps, find_sharp_edges, gap_slopes, sharp_edge_slopes
from .slots import min_slot_width, width_range
from .table_range import twist_margin

# clearance below which clearances are computed by default; larger values let steps foresee limits earlier and take
# longer
SUPPORT = 0.5
# safety factor on the smallest slot, because gaps are measured at some points of the arms only; larger is safer and
# leaves less room for twist
_SAFETY = 1.015
# Required gap where even the thinnest straight arms are too close, as a share of the gap between these arms; larger is
# stricter and leaves less room for twist
_RELAXED_SHARE = 0.95
# Largest radius (from the quad's centre to the joint) of a short arm, as a multiple of the slot at seams. That wider
# slot is required only beside short arms at seams. Larger values leave more room for connectors and less for twist.
_SHORT_ARM_RATIO = 6.0
# largest slot at seams, as a share of the gap between the thinnest straight arms; smaller values leave small quads more
# twist and less room for connectors
_SEAM_SLOT_SHARE = 0.5
# least radius of curvature of a blend's inner edge, as a share of the centre line's radius of curvature; larger values
# keep edges rounder and leave less room for twist
_MIN_RADIUS_RATIO = 0.25


@dataclass(frozen=True, eq=False)
class Clearances:
    """All clearances of a design that lie below a threshold, with derivatives.

    value : (K,) clearances
    by_design : (K, 5 F) derivatives by the widths (metres, four per quad) and then by the twists (radians)
    by_flat : (K, 2 V) derivatives by the flat points (metres, x and y in turn); None if not requested
    arms : (K, 4) arms on whose widths and twists the clearance depends: first arm, its mate, second arm, its mate
    """

    value: Float[np.ndarray, " k"]
    by_design: csr_array
    by_flat: csr_array | None
    arms: Int[np.ndarray, "k 4"]


@dataclass(frozen=True, eq=False)
class ClearanceModel:
    """Clearance model: the required gaps, common to all designs on given flat patches with given settings.

    params : settings of the spirals
    pairs : pairs of arms that come near each other in some design
    geometry : geometry of the flat quads
    required_gaps : required gap of each pair, metres
    min_radius_ratio : required radius of curvature of each blend's inner edge, as a share of the centre line's radius
    has_joint : mask of the arms whose twist must stay within the range of the stiffness table
    """

    params: SpiralParams
    pairs: ArmPairs
    geometry: ArmGeometry
    required_gaps: Float[np.ndarray, " pairs"]
    min_radius_ratio: Float[np.ndarray, " arms"]
    has_joint: Bool[np.ndarray, " arms"]

    @classmethod
    @lru_cache(maxsize=2)  # a search asks for the model at every start and stage, with the same patches
    def from_flat(cls, flat: FlatPatches, params: SpiralParams) -> ClearanceModel:
        """Make the model: pairs of arms that come near each other in some design, and the required gap of each pair.

        Where even the thinnest straight arms have smaller gaps than required, because quads are small or thin, 95 % of
        their gaps are required; where these arms touch, nothing is required. Beside short arms that meet across a cut,
        the slot at seams is required, but at most half of the gap between the thinnest straight arms.

        Parameters
        ----------
        flat : flat patches
        params : settings of the spirals: width range, smallest slots

        Raises
        ------
        FlexMapsError : with the faces that are far too small for the smallest width
        """
        slot, shapes = _SAFETY * min_slot_width(params), ArmGeometry.from_flat(flat, params)
        wide = max(slot, _SAFETY * params.slot_seam)
        pairs = find_arm_pairs(flat, params, wide + SUPPORT * slot)
        arms = len(shapes.mate)
        short = np.minimum(shapes.radius, shapes.radius[shapes.mate]) < _SHORT_ARM_RATIO * params.slot_seam
        seam = (pairs.kind != ROUND) & (short & flat.layout.cut[flat.layout.mesh.quad_edges].ravel())[pairs.one]
        mesh = flat.layout.mesh
        joined = ~mesh.border[mesh.quad_edges].ravel()
        room = cls(params, pairs, shapes, np.where(seam, wide, slot), np.full(arms, _MIN_RADIUS_RATIO), joined)
        lines, need = (
            room._arm_curves(same_width(width_range(flat, params)[0]), np.zeros(arms // 4)),
            room.required_gaps.copy(),
        )
        thin = find_narrow_gaps(lines, pairs, np.where(seam, need / _SEAM_SLOT_SHARE, need), params.clockwise)
        least = _RELAXED_SHARE * thin.gap
        least = np.where(seam[thin.pair], np.maximum(_SEAM_SLOT_SHARE * thin.gap, np.minimum(least, slot)), least)
        np.minimum.at(need, thin.pair, least)
        arm, _, left = find_sharp_edges(lines, np.arange(arms), room.min_radius_ratio)
        np.minimum.at(room.min_radius_ratio, arm, left - (1.0 - _RELAXED_SHARE) * np.abs(left))
        some = need > 0.0
        return replace(room, pairs=pairs.subset(some), required_gaps=need[some])

    def with_flat(self, flat: FlatPatches) -> ClearanceModel:
        """Return the model for slightly moved flat points; pairs and requirements stay."""
        return replace(self, pairs=self.pairs.with_flat(flat), geometry=ArmGeometry.from_flat(flat, self.params))

    @property
    def without_twist_limits(self) -> ClearanceModel:
        """The clearance model without the limit on twists from the stiffness table."""
        return replace(self, has_joint=np.zeros_like(self.has_joint))

    @property
    def gap_unit(self) -> float:
        """Unit of clearances of gaps, metres: the smallest slot, but at least a tenth of the smallest arm width."""
        return max(min_slot_width(self.params), 0.1 * self.params.width_min)

    def clearances(
        self,
        width: Float[np.ndarray, "quads 4"],
        twist: Float[np.ndarray, " quads"],
        *,
        below: float = SUPPORT,
        with_flat: bool = False,
        quads: Bool[np.ndarray, " quads"] | None = None,
        narrowest_only: bool = False,
    ) -> Clearances:
        """Compute all clearances below a threshold, with derivatives.

        Parameters
        ----------
        width, twist : (F, 4) metres, (F,) radians
        below : threshold on the clearance, as in ``Clearances.value``
        with_flat : whether to compute derivatives by the flat points too
        quads : mask of quads; compute only clearances that depend on their spirals; default is all
        narrowest_only : compute only the narrowest place between every two arms, as in ``gaps.find_narrow_gaps``
        """
        lines = self._arm_curves(width, twist)
        pairs, need, arms = self._restricted_to(quads)
        gaps = find_narrow_gaps(
            lines, pairs, need + below * self.gap_unit, self.params.clockwise, narrowest_only=narrowest_only
        )
        i, u, left = find_sharp_edges(lines, arms, self.min_radius_ratio[arms] + below * _MIN_RADIUS_RATIO)
        first, second, way, place = gap_slopes(lines, pairs, gaps)
        ends = np.zeros((len(i), first.shape[1]))
        slopes = sharp_edge_slopes(lines, i, u)
        ends[:, : slopes.shape[1]] = slopes / _MIN_RADIUS_RATIO
        twisted, spare, by_spare = self._twist_clearances(width, twist, arms, below)
        value = np.concatenate(
            [(gaps.gap - need[gaps.pair]) / self.gap_unit, (left - self.min_radius_ratio[i]) / _MIN_RADIUS_RATIO, spare]
        )
        one, two = (np.concatenate([a, i, twisted]) for a in (pairs.one[gaps.pair], pairs.two[gaps.pair]))
        by_one = np.concatenate([first / self.gap_unit, ends, by_spare])
        by_two = np.concatenate([second / self.gap_unit, np.zeros_like(ends), np.zeros_like(by_spare)])
        by_flat = None
        if with_flat:
            by_flat = self.geometry.by_points(one, by_one) + self.geometry.by_points(two, by_two)
            laid = np.flatnonzero(pairs.is_across_cut[gaps.pair])
            own = one[laid]
            rows = self.geometry.by_sides(laid, len(value), own, self.geometry.mate[own], way[laid], place[laid])
            by_flat = by_flat + rows / self.gap_unit
        mate = self.geometry.mate
        four = np.stack([one, mate[one], two, mate[two]], axis=1)
        four[len(four) - len(twisted) :] = twisted[:, None]
        return Clearances(value, self._by_design(four, by_one, by_two), by_flat, four)

    def quads_with_closed_gaps(
        self,
        width: Float[np.ndarray, "quads 4"],
        twist: Float[np.ndarray, " quads"],
        quads: Bool[np.ndarray, " quads"] | None = None,
    ) -> Bool[np.ndarray, " quads"]:
        """Return a mask of the quads on whose spirals any closed (negative) clearance depends.

        Parameters
        ----------
        width, twist : (F, 4) metres, (F,) radians
        quads : mask of quads; check only clearances that depend on their spirals; default is all
        """
        lines, mate = self._arm_curves(width, twist), self.geometry.mate
        pairs, need, arms = self._restricted_to(quads)
        which = find_narrow_gaps(lines, pairs, need, self.params.clockwise, narrowest_only=True).pair
        i = find_sharp_edges(lines, arms, self.min_radius_ratio[arms])[0]
        out = np.zeros(len(twist), dtype=bool)
        for a in (pairs.one[which], pairs.two[which], i):
            out[a // 4] = out[mate[a] // 4] = True
        out[self._twist_clearances(width, twist, arms, 0.0)[0] // 4] = True
        return out

    @classmethod
    def measure_gaps(
        cls,
        flat: FlatPatches,
        params: SpiralParams,
        width: Float[np.ndarray, "quads 4"],
        twist: Float[np.ndarray, " quads"],
        below: float,
    ) -> tuple[Int[np.ndarray, "k 2"], Float[np.ndarray, " k"]]:
        """Measure the narrow gaps between arms of different quads of the same panel.

        Parameters
        ----------
        flat : flat patches
        params : slots and sense of the spirals
        width, twist : (F, 4) metres, (F,) radians
        below : largest gap that is returned, metres

        Returns
        -------
        arms : (k, 2) both arms of every gap, 4 quad + side
        width : (k,) width of every gap, metres; negative where arms overlap
        """
        pairs, shapes = find_arm_pairs(flat, params, below), ArmGeometry.from_flat(flat, params)
        pairs = pairs.subset((pairs.kind != SAME_QUAD) & ~pairs.is_across_cut)
        every = np.zeros(len(shapes.mate))
        room = cls(params, pairs, shapes, np.full(len(pairs.one), below), every, every > 0.0)
        gaps = find_narrow_gaps(room._arm_curves(width, twist), pairs, room.required_gaps, params.clockwise)
        return np.stack([pairs.one[gaps.pair], pairs.two[gaps.pair]], axis=1), gaps.gap

    def _twist_clearances(
        self, width: np.ndarray, twist: np.ndarray, arms: Int[np.ndarray, " n"], below: float
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the arms whose twist is within ``below`` radians of its limit, with their margins and derivatives.

        Margins are radians; their derivatives by the arms' parameters have the columns of ``arm_curves``.
        """
        arms = arms[self.has_joint[arms]]
        spare, by_radius, by_width = twist_margin(self.geometry.radius[arms], width.ravel()[arms], twist[arms // 4])
        some = spare < below
        by = np.zeros((int(some.sum()), N_ARM_PARAMETERS))
        by[:, RADIUS], by[:, OWN_WIDTH] = by_radius[some], by_width[some]
        by[:, OWN_WIND] = 1.0 if self.params.clockwise else -1.0
        return arms[some], spare[some], by

    def _restricted_to(self, quads: np.ndarray | None) -> tuple[ArmPairs, np.ndarray, np.ndarray]:
        """Return the pairs, their required gaps and the arms that depend on spirals in the mask; None means all."""
        arms = np.arange(len(self.geometry.mate))
        if quads is None:
            return self.pairs, self.required_gaps, arms
        some = quads[arms // 4] | quads[self.geometry.mate // 4]
        near = some[self.pairs.one] | some[self.pairs.two]
        return self.pairs.subset(near), self.required_gaps[near], arms[some]

    def _arm_curves(self, width: np.ndarray, twist: np.ndarray) -> ArmCurves:
        """Return the centre lines of all arms of a design, with blends."""
        wind, s = np.repeat((-1.0 if self.params.clockwise else 1.0) * twist, 4), self.geometry
        widths = np.stack([width.ravel(), width.ravel()[s.mate]], axis=1)
        winds, leans = (np.stack([x, s.sign * x[s.mate]], axis=1) for x in (wind, s.lean))
        return ArmCurves.from_arms(s.centre, s.radius, s.angle, (widths, winds, leans), self.params.blend)

    def _by_design(self, four: np.ndarray, one: np.ndarray, two: np.ndarray) -> csr_array:
        """Turn derivatives by the parameters of both arms into derivatives by all widths and twists of the design.

        one, two : derivatives by the parameters of the first and of the second arm
        four : as ``Clearances.arms``
        """
        sign, arms = -1.0 if self.params.clockwise else 1.0, len(self.geometry.mate)
        columns = np.concatenate([four, arms + four // 4], axis=1)
        widths = [by[:, k] for by in (one, two) for k in (OWN_WIDTH, MATE_WIDTH)]
        mates = self.geometry.sign[four[:, [0, 2]].T]
        twists = [
            sign * by[:, k] * s
            for by, m in ((one, mates[0]), (two, mates[1]))
            for k, s in ((OWN_WIND, 1.0), (MATE_WIND, m))
        ]
        data = np.stack(widths + twists, axis=1)
        start = np.arange(0, data.size + 1, data.shape[1])
        out = csr_array((data.ravel(), columns.ravel(), start), shape=(len(data), arms + arms // 4))
        out.sum_duplicates()
        return out
