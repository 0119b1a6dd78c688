"""Widths of the slots between the bent arms in the assembled piece; slots may close when the arms bend.

Every arm is a bent strip of rectangular sections at right angles to it, as wide as the flat arm and as thick as the
sheet: a point P of the section at the point c(t) of the flat centre line moves to x(t) + D(t) (P - c(t)), where x and D
are the position and rotation of the section (``BentArms``). The width of a slot is the smallest distance between
sections of its two arms. Each section of the first arm is compared with the facing section of the second arm: the one
whose plane contains the middle of the first arm's section. Arms that pass above each other, at heights that differ by
more than the sheet's thickness, do not touch. A negative width is an overlap. Real arms cannot overlap, but the elastic
models ignore contact.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial import cKDTree

from ...arrays import Float, Int
from ...progress import SILENT, Progress
from ...spirals.clearance.slots import is_beside_absent, is_clockwise, slot_widths
from ...spirals.curves.spiral import Arms, centre_line, width_at
from ...spirals.design import SpiralDesign
from ..arms.bent import BentArms
from ..vectors import dot

# A slot within a spiral is first measured at STATIONS points from its mouth inwards, then at CLOSER_STATIONS points
# around the narrowest of these. More are slower and find narrower places, by up to 0.08 mm
STATIONS, CLOSER_STATIONS = 14, 7
# Share of a slot's length, from its mouth inwards, that is measured. Near its inner end the slot is as wide as its
# fillet. There the model would close slots that stay open, because its arms bend immediately outside the hub
DEEPEST = 0.9
# number of Newton iterations for the facing section of the second arm; more are slower and more exact (error 2e-4 mm)
ROUNDS = 2
# slots between arms of different spirals that are wider than this, in arm widths, are not measured; larger is slower
REACH = 0.5
# Number of sections of an arm that are measured around its point nearest to an arm of another spiral; more are slower
# and more exact (error 0.02 mm)
PAIR_STATIONS = 9
BATCH = 4000  # number of slots between two updates of the progress bar
MEASURING = "Measuring the slots in space"  # message that the progress bar shows


@dataclass(frozen=True, eq=False)
class SpaceSlots:
    """The slots between n pairs of bent arms in space.

    The first 4 F slots lie within spirals: slot 4 f + k between the arms k and k + 1 of quad f. The others lie between
    arms of different spirals that come close to each other.

    arms : (n, 2) indices of the two arms; 4 f + k is arm k of quad f
    width : (n,) metres at the narrowest point; negative where arms overlap, infinite beside arms that are not cut
    """

    arms: Int[np.ndarray, "slots 2"]
    width: Float[np.ndarray, " slots"]

    @cached_property
    def closed(self) -> Int[np.ndarray, " closed"]:
        """Indices of the slots whose arms overlap."""
        return np.flatnonzero(self.width < 0.0)

    @cached_property
    def narrowest_per_quad(self) -> Float[np.ndarray, " quads"]:
        """Width (F,) of the narrowest slot beside the arms of every spiral, metres."""
        least = np.full(int(self.arms.max()) // 4 + 1, np.inf)
        for which in (0, 1):
            np.minimum.at(least, self.arms[:, which] // 4, self.width)
        return least

    def with_quads_of(self, part: SpaceSlots, quads: Int[np.ndarray, " some"]) -> SpaceSlots:
        """Return a copy in which the slots within and between some quads are replaced by newly measured slots.

        Parameters
        ----------
        part : the new slots, as ``slots_in_space`` measures them with ``quads``
        quads : indices of the quads, in ascending order
        """
        inside = np.zeros(len(self.narrowest_per_quad), dtype=bool)
        inside[quads] = True
        own, count = 4 * len(inside), 4 * len(quads)
        width, kept = self.width[:own].copy(), ~inside[self.arms[own:] // 4].all(axis=1)
        width.reshape(-1, 4)[quads] = part.width[:count].reshape(-1, 4)
        arms = np.concatenate([self.arms[:own], self.arms[own:][kept], part.arms[count:]])
        return SpaceSlots(arms, np.concatenate([width, self.width[own:][kept], part.width[count:]]))


@dataclass(frozen=True, eq=False)
class _Sections:
    """M cross-sections of each of n bent arms.

    middle : middle of the section in space, metres
    along, across, off : unit vectors along the arm (inwards), across it, and along its normal
    half : half of the arm's width, metres
    curvature : of the flat arm's centre line, 1 / metres
    pace : derivative of the length along the flat centre line by t, metres
    """

    middle: Float[np.ndarray, "arms places 3"]
    along: Float[np.ndarray, "arms places 3"]
    across: Float[np.ndarray, "arms places 3"]
    off: Float[np.ndarray, "arms places 3"]
    half: Float[np.ndarray, "arms places"]
    curvature: Float[np.ndarray, "arms places"]
    pace: Float[np.ndarray, "arms places"]


def slots_in_space(
    design: SpiralDesign, bent: BentArms, progress: Progress = SILENT, quads: Int[np.ndarray, " some"] | None = None
) -> SpaceSlots:
    """Measure the slots of a design whose arms are bent.

    Parameters
    ----------
    design, bent : the spirals, and the deformation of their arms
    progress : is updated and can cancel
    quads : indices, ascending; only slots within and between these quads are measured; default all
    """
    progress(0.0, MEASURING)
    some = np.arange(len(design.width)) if quads is None else quads
    first, second, t, s = _slots_within(design, some)
    width = _narrowest_widths(design, bent, first, second, t, s, progress.part(0.1, 0.6))
    width[is_beside_absent(design.is_absent[some]).ravel()] = np.inf
    progress(0.6, MEASURING)
    near, far, u, v = _slots_between(design, bent, some)
    others = _narrowest_widths(design, bent, near, far, u, v, progress.part(0.7, 1.0))
    arms = np.concatenate([np.stack([first, second], axis=1), np.stack([near, far], axis=1)])
    return SpaceSlots(arms, np.concatenate([width, others]))


def _slots_within(
    design: SpiralDesign, quads: Int[np.ndarray, " n"]
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return the slots within the spirals of n quads, and M pairs of facing points beside every slot.

    Four arrays: the outer and the inner arms (4 n,), and positions t (4 n, M) on the outer and s on the inner arms.
    """
    share, arms = np.linspace(0.0, DEEPEST, STATIONS), design.arms.subset(quads)
    t, s = slot_widths(arms, design.roots.left[quads], design.roots.right[quads], share)[2:]
    first = 4 * quads[:, None] + np.arange(4)
    second = np.roll(first, -1, axis=1)
    outer, inner = (first, second) if is_clockwise(arms) else (second, first)
    return outer.ravel(), inner.ravel(), t.reshape(first.size, -1), s.reshape(first.size, -1)


def _slots_between(
    design: SpiralDesign, bent: BentArms, quads: Int[np.ndarray, " some"]
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return n pairs of arms of different spirals that come close to each other, and M positions on every arm.

    Pairs of arms that meet at a joint, and of arms in different bodies (unconnected parts of the piece), are left out.

    Returns
    -------
    (n,) and (n,) : the first and the second arms
    (n, M) : positions t on the first arms, around the point that is nearest to the second arm
    (n, M) : positions s on the second arms where the search for the facing sections starts; the M are equal
    """
    count, some = design.arms.width.size, (4 * quads[:, None] + np.arange(4)).ravel()
    place = bent.place[some]
    stations = place.shape[1]
    widest = np.maximum(design.arms.width, design.arms.joint_width).ravel()[some]
    piece = np.linalg.norm(np.diff(place, axis=1), axis=2).max(axis=1)
    pair = _near_stations(place, (1.0 + REACH) * widest + 0.5 * piece)
    pair = stations * some[pair // stations] + pair % stations
    arm = pair // stations
    mate = np.arange(count)
    mesh = design.flat.layout.mesh
    joint = (4 * mesh.edge_quads + mesh.edge_sides)[~mesh.border]
    mate[joint] = joint[:, ::-1]
    body = mesh.body_of[arm // 4]
    keep = (arm[:, 0] // 4 != arm[:, 1] // 4) & (mate[arm[:, 0]] != arm[:, 1]) & (body[:, 0] == body[:, 1])
    keep &= ~design.is_absent.ravel()[arm].any(axis=1)
    pair, arm = pair[keep], arm[keep]
    apart = np.linalg.norm(np.diff(bent.place.reshape(-1, 3)[pair], axis=1)[:, 0], axis=1)
    order = np.lexsort((apart, arm[:, 1], arm[:, 0]))
    pair, arm = pair[order], arm[order]
    first = np.ones(len(arm), dtype=bool)
    first[1:] = (arm[1:] != arm[:-1]).any(axis=1)
    pair, arm = pair[first], arm[first]
    # stations run from the hub to the tip in equal steps of t
    t = bent.hub[arm] * (1.0 - (pair % stations) / (stations - 1))
    step = 1.5 * bent.hub[arm[:, 0]] / (stations - 1)
    about = t[:, :1] + step[:, None] * np.linspace(-1.0, 1.0, PAIR_STATIONS)
    within = np.clip(about, 0.0, bent.hub[arm[:, :1]])
    return arm[:, 0], arm[:, 1], within, np.broadcast_to(t[:, 1:], within.shape)


def _near_stations(
    place: Float[np.ndarray, "arms stations 3"], reach: Float[np.ndarray, " arms"]
) -> Int[np.ndarray, "pairs 2"]:
    """Return the pairs of stations that are closer than the reach of at least one of their arms, and a few other pairs.

    Arms are searched in groups whose reach differs by less than a factor of two. With the largest reach for all arms,
    nearly all arms of small quads, as at the tip of a cone, would form pairs.

    Parameters
    ----------
    place : positions of the stations, metres
    reach : distance below which a station of an arm forms pairs, metres

    Returns
    -------
    (pairs, 2) : indices of the stations in the flattened ``place``
    """
    point, size = place.reshape(-1, 3), np.repeat(reach, place.shape[1])
    level = np.floor(np.log2(size / size.min()))
    pairs = []
    for k in np.unique(level):
        alike, smaller = np.flatnonzero(level == k), np.flatnonzero(level < k)
        tree, radius = cKDTree(point[alike]), float(size[alike].max())
        pairs.append(alike[tree.query_pairs(radius, output_type="ndarray")])
        near = tree.sparse_distance_matrix(cKDTree(point[smaller]), radius, output_type="ndarray")
        pairs.append(np.stack([alike[near["i"]], smaller[near["j"]]], axis=1))
    return np.sort(np.concatenate(pairs), axis=1)


def _narrowest_widths(
    design: SpiralDesign,
    bent: BentArms,
    first: Int[np.ndarray, " slots"],
    second: Int[np.ndarray, " slots"],
    t: Float[np.ndarray, "slots places"],
    s: Float[np.ndarray, "slots places"],
    progress: Progress,
) -> Float[np.ndarray, " slots"]:
    """Return the smallest distance between the two arms of every pair, metres.

    Parameters
    ----------
    design, bent : the spirals, and the deformation of their arms
    first, second : indices of the two arms of every pair
    t : positions on the first arms where distances are measured
    s : positions on the second arms where the searches for the facing sections start
    progress : is updated and can cancel
    """
    width = np.empty(len(first))
    for some in progress.batches(len(first), BATCH, MEASURING):
        pair, rows = (first[some], second[some]), np.arange(len(first[some]))
        apart, facing = _facing_distances(design, bent, pair, t[some], s[some])
        least = apart.argmin(axis=1)
        # measure again at CLOSER_STATIONS positions between the two neighbours of the narrowest position
        step = np.diff(t[some], axis=1).max(axis=1)[:, None]
        closer = t[some][rows, least, None] + step * np.linspace(-1.0, 1.0, CLOSER_STATIONS)
        closer = np.clip(closer, t[some].min(axis=1)[:, None], t[some].max(axis=1)[:, None])
        again = _facing_distances(design, bent, pair, closer, np.broadcast_to(facing[rows, least, None], closer.shape))[
            0
        ]
        width[some] = np.minimum(apart.min(axis=1), again.min(axis=1))
    return width


def _facing_distances(
    design: SpiralDesign,
    bent: BentArms,
    pair: tuple[Int[np.ndarray, " slots"], Int[np.ndarray, " slots"]],
    t: Float[np.ndarray, "slots places"],
    s: Float[np.ndarray, "slots places"],
) -> tuple[Float[np.ndarray, "slots places"], Float[np.ndarray, "slots places"]]:
    """Return the distances between sections of the first arms and the facing sections of the second arms.

    Parameters
    ----------
    design, bent : the spirals, and the deformation of their arms
    pair : indices of the first arms, and of the second arms
    t : positions of the sections on the first arms
    s : positions on the second arms where the search for the facing sections starts

    Returns
    -------
    (slots, places) : distances, metres
    (slots, places) : positions of the facing sections on the second arms
    """
    mine, other = (design.arms.one_by_one(*np.divmod(arm, 4)) for arm in pair)
    here, end = _sections(bent, mine, pair[0], t), bent.hub[pair[1], None]
    for _ in range(ROUNDS):
        there = _sections(bent, other, pair[1], s)
        way = here.middle - there.middle
        bend = np.maximum(1.0 + there.curvature * dot(way, there.across), 0.25)
        move = dot(way, there.along) / (bend * there.pace)
        s = np.clip(s + np.clip(move, -0.1, 0.1), 0.0, end)
    return _section_distance(here, _sections(bent, other, pair[1], s), 0.5 * design.params.thickness), s


def _sections(bent: BentArms, shape: Arms, arm: np.ndarray, t: Float[np.ndarray, "arms places"]) -> _Sections:
    """Return the cross-sections at the positions t of bent arms.

    arm : (n,) indices of the arms in ``bent``; shape : their flat shapes
    """
    point, speed, change = (x[:, 0] for x in centre_line(shape, t[:, None]))
    flat = np.zeros((*t.shape, 3))
    flat[..., :2] = point - shape.centre[:, None]
    pace = np.hypot(speed[..., 0], speed[..., 1])
    curvature = (speed[..., 0] * change[..., 1] - speed[..., 1] * change[..., 0]) / pace**3
    place, turn = bent.at(np.repeat(arm, t.shape[1]), t.ravel(), flat.reshape(-1, 3))
    turn, (x, y) = turn.reshape(*t.shape, 3, 3), np.moveaxis(speed / pace[..., None], -1, 0)[..., None]
    along, across = x * turn[..., 0] + y * turn[..., 1], y * turn[..., 0] - x * turn[..., 1]
    half = 0.5 * width_at(shape, t[:, None])[0][:, 0]
    return _Sections(place.reshape(*t.shape, 3), along, across, turn[..., 2], half, curvature, pace)


def _section_distance(a: _Sections, b: _Sections, height: float) -> Float[np.ndarray, "arms places"]:
    """Return the distances between rectangular sections a and the facing sections b, metres; negative for an overlap.

    The distance is measured along the axis that separates two sections best (separating axis theorem), or between
    corners where two axes separate them. Where arm b ends before it faces the section a, the distance along b from its
    end to the section is added at a right angle.

    height : half of the sheet's thickness, metres
    """
    way = a.middle - b.middle
    level, tilt, tilted, upright = (np.abs(dot(x, y)) for x in (a.across, a.off) for y in (b.across, b.off))
    side = np.maximum(
        np.abs(dot(way, a.across)) - a.half - b.half * level - height * tilt,
        np.abs(dot(way, b.across)) - b.half - a.half * level - height * tilted,
    )
    above = np.maximum(
        np.abs(dot(way, a.off)) - height - b.half * tilted - height * upright,
        np.abs(dot(way, b.off)) - height - a.half * tilt - height * upright,
    )
    apart = np.where((side > 0.0) & (above > 0.0), np.hypot(side, above), np.maximum(side, above))
    lean, rise = (np.abs(dot(x, b.along)) for x in (a.across, a.off))
    beyond = np.abs(dot(way, b.along)) - a.half * lean - height * rise - 1e-3 * b.half
    return np.where(beyond > 0.0, np.hypot(np.maximum(apart, 0.0), beyond), apart)
