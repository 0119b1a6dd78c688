"""Broad phase for gaps: pairs of arms that come near each other in some design. Arm 4 f + k is arm k of quad f."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from ...arrays import Bool, Columns, Complex, Float, Int
from ...params import SpiralParams
from ...patches.flattening.flatten import FlatPatches
from ..curves.arm_curves import ArmCurves
from ..curves.blends import lean_angles
from ..curves.spiral import mate_signs, opposite_sides, spokes

# Kinds of pairs: two consecutive arms of a quad; an arm and the two arms beside its mate (the arm across the joint);
# all other pairs of arms from two quads that share an edge or a vertex
SAME_QUAD, ACROSS, ROUND = range(3)
# Largest arm parameter t (0 at the joint, 1 at the centre) of the first and of the second arm at which gaps are
# measured; one row per kind of pair. In SAME_QUAD, 1/3 is the part that must be open (``slots.OPEN_SHARE``). Larger
# values miss fewer narrow gaps and take longer; with 0.4 across joints, slots of 0.17 mm were measured as 0.3 mm.
DEPTHS = np.array([[1.0 / 3.0, 1.0], [0.7, 0.9], [0.8, 0.8]])
# Twists of an arm and of its mate, as shares of the largest twist, at which the reach of arms (how far they extend in
# every direction) is sampled. Apart from blends, arms with less twist lie within the region that arms with the largest
# twist surround.
_OWN_TWISTS, _MATE_TWISTS = (0.0, 0.5, 1.0), (0.0, 1.0)
_REACH_T = np.linspace(0.0, 0.9, 25)  # arm parameters t at which the reach is sampled; more are safer and slower
_DIRECTIONS = 32  # number of directions in which the reach is sampled; more exclude more pairs and take longer
# angles between the normals of the separating lines that are tried and the line between the centres of two quads,
# radians
_NORMAL_ANGLES = np.array([-0.7, -0.35, 0.0, 0.35, 0.7])
# Safety margin added to how far an arm reaches, as a share of its distance from quad centre to joint: the arm may reach
# farther at twists between those sampled, and flat patches may change later. Larger: safer, more pairs
_MARGIN = 0.1


@dataclass(frozen=True, eq=False)
class ArmPairs(Columns):
    """Pairs of arms that can come near each other.

    one, two : numbers of the first and of the second arm
    kind : SAME_QUAD, ACROSS or ROUND
    turn, shift : map from the second arm's frame to the first arm's frame: point q (complex, metres) to turn q + shift
    is_across_cut : True if the second quad is moved to the first quad at a cut; if False, turn is 1 and shift is 0
    """

    one: Int[np.ndarray, " n"]
    two: Int[np.ndarray, " n"]
    kind: Int[np.ndarray, " n"]
    turn: Complex[np.ndarray, " n"]
    shift: Complex[np.ndarray, " n"]
    is_across_cut: Bool[np.ndarray, " n"]

    def with_flat(self, flat: FlatPatches) -> ArmPairs:
        """Return the pairs with turn and shift recomputed for flat patches whose vertices have moved."""
        mate, side = opposite_sides(flat.layout.mesh)
        turn, shift = _align_sides(flat, self.one, (4 * mate + side).ravel()[self.one])
        return replace(
            self, turn=np.where(self.is_across_cut, turn, 1.0), shift=np.where(self.is_across_cut, shift, 0.0)
        )


def find_arm_pairs(flat: FlatPatches, params: SpiralParams, near: float) -> ArmPairs:
    """Return all pairs of arms that may come nearer than ``near`` metres to each other in some design.

    Parameters
    ----------
    flat : flat patches
    params : settings of the spirals: largest width and twist, sense of rotation, blends
    near : largest gap, metres; a larger value keeps more pairs
    """
    layout = flat.layout
    mate, side = opposite_sides(layout.mesh)
    count = len(mate)
    arm = np.arange(4 * count).reshape(count, 4)
    beyond = 4 * mate + side
    facing = arm[:, (np.arange(4) + (1 if params.clockwise else -1)) % 4]
    # pairs across joints, and across cuts as if both quads were placed side by side
    inner = beyond != arm
    own = np.repeat(arm[inner], 2)
    there = np.repeat(beyond[inner], 2)
    other = 4 * (there // 4) + (there + np.tile([1, 3], len(own) // 2)) % 4
    cut = np.repeat(layout.outline_sides[inner], 2)
    turn, shift = _align_sides(flat, own, there)
    turn, shift = np.where(cut, turn, 1.0), np.where(cut, shift, 0.0)
    # across cuts inside a patch, measure gaps also with both quads at their own places
    inside = cut & (layout.patch_of[own // 4] == layout.patch_of[other // 4])
    first, second = _arms_around(flat)
    identity = np.ones(4 * count, dtype=complex), np.zeros(4 * count, dtype=complex), np.zeros(4 * count, dtype=bool)
    groups = [
        (arm.ravel(), facing.ravel(), SAME_QUAD, *identity),
        (own, other, ACROSS, turn, shift, cut),
        (own[inside], other[inside], ACROSS, 1.0, 0.0, False),
        (first, second, ROUND, 1.0, 0.0, False),
    ]
    types = np.int64, np.int64, np.int64, complex, complex, bool
    columns = [
        np.concatenate([np.broadcast_to(np.asarray(row[c], dtype=types[c]), len(row[0])) for row in groups])
        for c in range(6)
    ]
    pairs = ArmPairs(*columns)
    return pairs.subset((pairs.kind == SAME_QUAD) | _can_meet(flat, params, pairs, near))


def _align_sides(flat: FlatPatches, own: np.ndarray, there: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return turn and shift (see ``ArmPairs``) that move each side ``there`` onto the side ``own``, end to start.

    Sides are numbered 4 quad + side.
    """
    z = flat.corners @ [1.0, 1j]
    ends = [(z[a // 4, a % 4], z[a // 4, (a + 1) % 4]) for a in (own, there)]
    (a, b), (c, d) = ends
    turn = -(b - a) / (d - c)
    turn /= np.abs(turn)
    return turn, 0.5 * (a + b) - turn * 0.5 * (c + d)


def _arms_around(flat: FlatPatches) -> tuple[Int[np.ndarray, " n"], Int[np.ndarray, " n"]]:
    """Return the pairs of kind ROUND, each once: arms of two quads at an edge or a vertex, with no cut between them."""
    layout = flat.layout
    mate, side = opposite_sides(layout.mesh)
    joined, count = ~layout.outline_sides, len(mate)
    quad, corner = np.repeat(np.arange(count), 4), np.tile(np.arange(4), count)
    whole, at, to = np.ones(len(quad), dtype=bool), quad, corner
    neighbours: list[np.ndarray] = []
    for _ in range(3):  # steps from quad to quad around each corner's vertex
        whole = whole & joined[at, to]
        at, to = np.where(whole, mate[at, to], at), np.where(whole, (side[at, to] + 1) % 4, to)
        far = whole & (at != quad)
        neighbours.append(np.stack([np.minimum(quad[far], at[far]), np.maximum(quad[far], at[far])], axis=1))
    quads = np.unique(np.concatenate(neighbours), axis=0)
    k = np.stack(np.divmod(np.arange(16), 4), axis=1)
    both = (4 * quads[:, None] + k).reshape(-1, 2)
    # leave out the two arms of a joint, which have no gap, and pairs of kind ACROSS
    excluded = np.zeros(len(both), dtype=bool)
    for one, two in (both.T, both[:, ::-1].T):
        there = 4 * mate[one // 4, one % 4] + side[one // 4, one % 4]
        excluded |= (there // 4 == two // 4) & ((two - there) % 4 != 2)
    return both[~excluded, 0], both[~excluded, 1]


def _can_meet(flat: FlatPatches, params: SpiralParams, pairs: ArmPairs, near: float) -> Bool[np.ndarray, " n"]:
    """Return a mask of the pairs whose arms can come within ``near`` metres in some design.

    These are the pairs whose regions, as far as the arms reach, are separated by none of the tried lines.
    """
    centre, radius, _ = spokes(flat.corners)
    extents, c = _extents(flat, params), np.repeat(centre @ np.array([1.0, 1j]), 4)
    between = pairs.turn * c[pairs.two] + pairs.shift - c[pairs.one]
    margin = _MARGIN * (radius.ravel()[pairs.one] + radius.ravel()[pairs.two]) + near + params.width_max
    out = np.ones(len(between), dtype=bool)
    for rotation in np.exp(1j * _NORMAL_ANGLES):
        normal = rotation * between / np.maximum(np.abs(between), 1e-12)
        far = (between * np.conj(normal)).real
        for arm, there in ((pairs.one, normal), (pairs.two, -normal * np.conj(pairs.turn))):
            place = np.angle(there) / (2.0 * np.pi / _DIRECTIONS)
            before, after = (np.asarray(np.floor(place) + k, dtype=np.int64) % _DIRECTIONS for k in (0, 1))
            far -= np.maximum(extents[arm, before], extents[arm, after]) / np.cos(np.pi / _DIRECTIONS)
        out &= far < margin
    return out


def _extents(flat: FlatPatches, params: SpiralParams) -> Float[np.ndarray, "arms ways"]:
    """Return how far arms can reach from their quad's centre in any design, in evenly spaced directions, metres."""
    _, radius, angle = spokes(flat.corners)
    mate, side = opposite_sides(flat.layout.mesh)
    lean, sign = lean_angles(flat.corners, angle), mate_signs(flat.layout.mesh, params)
    width = np.full((radius.size, 2), params.width_max)
    both = np.stack([lean, sign * lean[mate, side]], axis=-1).reshape(-1, 2)
    t = np.broadcast_to(_REACH_T[:, None], (len(_REACH_T), radius.size))
    i = np.broadcast_to(np.arange(radius.size), t.shape)
    directions = np.exp(2j * np.pi / _DIRECTIONS * np.arange(_DIRECTIONS))
    out = np.full((_DIRECTIONS, radius.size), -np.inf)
    zero, sense = np.zeros(radius.size, dtype=complex), -1.0 if params.clockwise else 1.0
    for own, other in product(_OWN_TWISTS, _MATE_TWISTS):
        twist = sense * params.twist_max * np.stack([np.full(radius.size, own), other * sign.ravel()], axis=1)
        lines = ArmCurves.from_arms(zero, radius.ravel(), angle.ravel(), (width, twist, both), params.blend)
        # arms along the last axis, so that numpy compares long contiguous runs
        points = lines.points(i, t)
        along, aside = points.real.copy(), points.imag.copy()
        for reach, n in zip(out, directions, strict=True):
            np.maximum(reach, (along * n.real + aside * n.imag).max(axis=0), out=reach)
    return np.ascontiguousarray(out.T)
