"""Connectors wherever two arms meet across a cut: dovetails, loose keys, or tabs for glue (FlexMaps section 8)."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from itertools import islice
from typing import Any

import numpy as np

from ...arrays import Float
from ...errors import FlexMapsError
from ...params import ConnectorParams
from ...progress import SILENT, Progress
from ...spirals.contours import Outline
from ...spirals.design import SpiralDesign
from ..panels.labels import seam_labels
from .free_space import SCALES, FreeSpace
from .shape import connector_size, key_outline, min_radius
from .tips import ConnectorCandidate, Tip

CANDIDATES_AT_ONCE = 180  # candidates evaluated together (0.1 s of work); more delay a cancel
_TIPS_AT_ONCE = 2000  # tips compared with all others at once; more take more memory
# The candidates of a joint are tested in rounds until one has room: a single one in the first round, SECOND_BATCH in
# the second, and at most MAX_BATCH in later rounds. Larger batches are faster per candidate, but waste the candidates
# after the first that has room
SECOND_BATCH, MAX_BATCH = 4, 16


@dataclass(frozen=True, eq=False)
class Connector:
    """One connector between two arms.

    name : label of the joint: letter of the seam and number of the joint along it
    seam : index of the seam
    candidate : kind and size, the arm with the head, and the position
    faces, sides : quads and sides of both arms; the arm of the patch with the lower index comes first
    is_shrunk : whether the connector is smaller than requested for lack of room
    is_swapped : whether the head is on the other arm than preferred for lack of room
    """

    name: str
    seam: int
    candidate: ConnectorCandidate
    faces: tuple[int, ...]
    sides: tuple[int, ...]
    is_shrunk: bool
    is_swapped: bool

    @property
    def kind(self) -> str:
        """Kind of the connector: "dovetail", "key" or "tab"."""
        return self.candidate.kind


@dataclass(frozen=True, eq=False)
class Connections:
    """The outlines of all panels with connectors, and the connectors.

    plain_joints : (name, quad, quad) of joints without room for any connector, whose arms keep plain ends
    clearance : gap between head and socket after cutting, metres
    occupied_lengths : length in metres of the part of every arm, from its joint, that a connector occupies; 0 without
    tips : ends of all arms that have a connector
    """

    outlines: tuple[Outline, ...]
    connectors: tuple[Connector, ...]
    plain_joints: tuple[tuple[str, int, int], ...]
    clearance: float
    occupied_lengths: Float[np.ndarray, "quads 4"]
    tips: tuple[Tip, ...] = ()

    @property
    def min_bridge(self) -> float:
        """Width in metres of the narrowest neck or wall of a connector; infinite without connectors."""
        return min(
            (
                min(c.candidate.size.neck - c.candidate.size.clearance, c.candidate.size.thinnest)
                for c in self.connectors
                if c.kind != "tab"
            ),
            default=np.inf,
        )

    @property
    def key_outlines(self) -> tuple[Outline, ...]:
        """The outlines of the loose keys, each around the origin."""
        return tuple(
            Outline(key_outline(c.candidate.size, c.candidate.setback), ()) for c in self.connectors if c.kind == "key"
        )

    @property
    def _min_radius(self) -> float:
        """Smallest corner radius in metres of all heads, sockets and shoulders."""
        sizes = {c.candidate.size for c in self.connectors if c.kind != "tab"}
        return min([*map(min_radius, sizes), *(radius for tip in self.tips for radius in tip.shoulder_radii)])

    @property
    def report(self) -> dict[str, Any]:
        """Figures of the connectors for report.json."""
        made = self.connectors
        count = {k: sum(c.kind == k for c in made) for k in ("dovetail", "key", "tab")}
        if not made and not self.plain_joints:
            return {"connectors": 0}
        shaped = [c.candidate.size for c in made if c.kind != "tab"]
        necks = {"connector_neck_min_mm": round(min(s.neck for s in shaped) * 1e3, 4)} if shaped else {}
        return {
            "connectors": len(made),
            "connector_kinds": {k: n for k, n in count.items() if n},
            "connector_clearance_mm": round(self.clearance * 1e3, 4),
            **necks,
            **({"connector_rounding_min_mm": round(self._min_radius * 1e3, 4)} if made else {}),
            "shrunk": sum(c.is_shrunk for c in made),
            "swapped": sum(c.is_swapped for c in made),
            "shifted": sum(c.candidate.shift != 0.0 for c in made),
            "glued": [{"joint": c.name, "faces": list(c.faces)} for c in made if c.kind == "tab"],
            "unsolved": [{"joint": name, "faces": list(faces)} for name, *faces in self.plain_joints],
        }


def connect(
    design: SpiralDesign,
    params: ConnectorParams,
    tolerance: float = 1e-5,
    progress: Progress = SILENT,
    mill: float = 0.0,
) -> Connections:
    """Draw the panels with the largest connector that has room at every joint.

    Joints without room for any connector keep plain ends and are listed in the result.

    Parameters
    ----------
    design : spirals on flat patches
    params : kind, dimensions and clearance of connectors
    tolerance : largest distance of the outlines' arcs from the exact edges, metres
    progress : called with the fraction done; may cancel
    mill : diameter of the mill, metres; 0 for a laser or another beam

    Raises
    ------
    FlexMapsError : the clearance is so large that connectors would slip out
    """
    taken = np.zeros((len(design.width), 4))
    if params.connector == "none" or not design.flat.layout.cut.any():
        drawn = design.outlines(tolerance, None, progress)
        return Connections(tuple(drawn), (), (), params.clearance, taken)
    least = connector_size(float(design.arms.joint_width.min()), params, min(SCALES), mill)
    catch = 0.5 * (least.head - least.neck)
    if params.clearance > 0.5 * catch:
        raise FlexMapsError(
            f"With a clearance of {params.clearance * 1e3:g} mm connectors would slip out, for the smallest ones catch by "
            f"{catch * 1e3:.2g} mm; make the clearance at most {500 * catch:.2g} mm"
        )
    space = FreeSpace(design, params, mill, progress.part(0.0, 0.1))
    chosen = _choose_connectors(space, progress.part(0.1, 0.8))
    labels = seam_labels(design.flat.layout)
    made, tips = list[Connector](), list[Tip]()
    unsolved: list[tuple[str, int, int]] = []
    for joint, choice in enumerate(chosen):
        quad, side = space.joints.quad[joint].tolist(), space.joints.side[joint].tolist()
        name = labels[quad[0], side[0]]
        if choice is None:
            unsolved.append((name, quad[0], quad[1]))
            continue
        candidate = choice.candidate
        seam, place = int(space.joints.seam[joint]), int(space.joints.place[joint])
        largest = space.connector_sizes(joint, candidate.kind)[0]
        swapped = candidate.kind == "dovetail" and candidate.head_arm != place % 2
        made.append(Connector(name, seam, candidate, tuple(quad), tuple(side), candidate.size != largest, swapped))
        tips.extend(choice.tips)
    for half in (space.joined_arms.own, space.joined_arms.other):
        full = np.zeros(len(half.arm))
        for tip in tips:
            if tip.joined_arms.own is half:
                full[tip.row] = tip.widening.taper_start[0]
        taken.ravel()[half.arm] = np.maximum(half.arc_lengths(full), 0.0)
    progress(0.8, "drawing outlines with connectors")
    drawn = design.outlines(tolerance, space.tips_as_arcs(tips, design.arm_starts, tolerance), progress.part(0.82, 1.0))
    return Connections(tuple(drawn), tuple(made), tuple(unsolved), params.clearance, taken, tuple(tips))


@dataclass(frozen=True, eq=False)
class _Choice:
    """A candidate connector that has room, with its two tips.

    polygons : (2, 2) shapely polygons, one column for each tip; row 0 in the tips' own panels, row 1 in those across
    """

    candidate: ConnectorCandidate
    tips: tuple[Tip, Tip]
    polygons: np.ndarray


class _CandidateQueues:
    """Candidate connectors of all joints, tried in order of preference, for many joints at once."""

    def __init__(self, space: FreeSpace):
        self.space = space
        self.untested = [space.candidates(joint) for joint in range(len(space.joints.edge))]
        self.fitting: list[deque[_Choice]] = [deque() for _ in self.untested]

    def next_fitting(self, joints: list[int], progress: Progress, first: bool = False) -> dict[int, _Choice | None]:
        """Return for each of these joints its next candidate that has room; None if there are no more.

        Parameters
        ----------
        joints : indices of the joints
        progress : called with the fraction done; may cancel
        first : whether to test only one candidate per joint in the first round, without measuring the free space
        """
        found: dict[int, _Choice | None] = {j: self.fitting[j].popleft() for j in joints if self.fitting[j]}
        waiting, few = [j for j in joints if j not in found], SECOND_BATCH
        while waiting:
            tries = []
            # test few candidates per joint at once, because those after the first that has room are wasted
            each = 1 if first else max(1, min(few, CANDIDATES_AT_ONCE // len(waiting)))
            for place, joint in enumerate(waiting):
                if not first and place % CANDIDATES_AT_ONCE == 0:
                    progress(len(found) / len(joints), "placing connectors")
                    self.space.measure_free_widths(waiting[place : place + CANDIDATES_AT_ONCE])
                more = list(islice(self.untested[joint], each))
                tries += [(joint, candidate) for candidate in more]
                if not more:
                    found[joint] = None
            for begin in range(0, len(tries), CANDIDATES_AT_ONCE):
                progress(len(found) / len(joints), "placing connectors")
                self._test_candidates(tries[begin : begin + CANDIDATES_AT_ONCE])
            for joint in waiting:
                if self.fitting[joint]:
                    found[joint] = self.fitting[joint].popleft()
            waiting = [j for j in waiting if j not in found]
            few, first = min(2 * each + 2, MAX_BATCH), False
        return found

    def _test_candidates(self, tries: list[tuple[int, ConnectorCandidate]]) -> None:
        """Evaluate pairs (joint, candidate), and store the candidates that have room in ``fitting``."""
        made = self.space.fit_tips([joint for joint, _ in tries], [candidate for _, candidate in tries])
        for (joint, candidate), tips in zip(tries, made, strict=True):
            if tips is not None:
                self.fitting[joint].append(_Choice(candidate, *tips))


def _choose_connectors(space: FreeSpace, progress: Progress) -> list[_Choice | None]:
    """Return for every joint its first candidate with room beside the connectors of other joints, or else None."""
    search = _CandidateQueues(space)
    every = list(range(len(space.joints.edge)))
    found = search.next_fitting(every, progress.part(0.0, 0.9), first=True)
    chosen = [found[joint] for joint in every]
    # while two tips are too close to each other, replace the connector of the larger tip by its next candidate
    changed = set(every)
    for turn in range(50):
        progress(0.9 + 0.002 * turn, "separating connectors")
        giving = _joints_too_close(space, chosen, changed, progress.part(0.9 + 0.002 * turn, 0.9 + 0.002 * turn))
        if not giving:
            break
        for joint, choice in search.next_fitting(
            giving, progress.part(0.9 + 0.002 * turn, 0.902 + 0.002 * turn)
        ).items():
            chosen[joint] = choice
        changed = set(giving)
    return chosen


def _joints_too_close(
    space: FreeSpace, chosen: list[_Choice | None], changed: set[int], progress: Progress
) -> list[int]:
    """Return the joints whose connector must be replaced because one of its tips comes too close to another tip.

    Two tips are too close if their distance is less than the smallest slot; the connector of the larger tip is then
    replaced. Only pairs with a tip of the ``changed`` joints are tested.
    """
    import shapely

    some = [(joint, c) for joint, c in enumerate(chosen) if c is not None]
    owner = np.repeat(np.array([joint for joint, _ in some], dtype=int), 2)
    fresh = np.flatnonzero(np.isin(owner, list(changed)))
    if not len(fresh):
        return []
    flat, mated = np.stack([c.polygons for _, c in some], axis=1).reshape(2, -1)
    tree, slot = shapely.STRtree(flat), 0.999 * space.slot
    area = shapely.area(flat)
    giving: set[int] = set()
    # test tips within each flat panel, and tips of two panels that are joined
    for shapes in (flat, mated):
        around = shapely.box(*(shapely.bounds(shapes[fresh]) + slot * np.array([-1.0, -1.0, 1.0, 1.0])).T)
        for part in progress.batches(len(fresh), _TIPS_AT_ONCE, "separating connectors"):
            one, two = tree.query(around[part])
            one = fresh[part][one]
            other = one != two if shapes is flat else owner[one] != owner[two]
            one, two = one[other], two[other]
            near = shapely.dwithin(shapes[one], flat[two], slot)
            one, two = one[near], two[near]
            giving |= set(np.where(area[one] > area[two], owner[one], owner[two]).tolist())
    return sorted(giving)
