"""Connectors wherever two arms meet across a cut: dovetails, loose keys or tabs for glue (FlexMaps section 8)."""

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
from .shape import key, least_radius, size
from .tips import Attempt, Tip

CHUNK = 180  # attempts that are judged together, a tenth of a second of work
_TIPS = 2000  # ends of arms that are compared with all others together
FEW, MANY = 4, 16  # attempts of one joint that are judged together, after the first and at the most


@dataclass(frozen=True, eq=False)
class Connector:
    """One connector that holds two arms together.

    name : the joint's label, seam letter and number; seam, place : index of the seam and of the joint along it
    made : its kind and size, which arm has the head, and where it sits
    faces, sides : the quads of both arms, the lower panel's first, and which of their sides
    shrunk, swapped : whether it is smaller, or has its head on the other arm, for want of room
    """

    name: str
    seam: int
    place: int
    made: Attempt
    faces: tuple[int, ...]
    sides: tuple[int, ...]
    shrunk: bool
    swapped: bool

    @property
    def kind(self) -> str:
        """dovetail, key or tab."""
        return self.made.kind

    @property
    def roles(self) -> tuple[str, str]:
        """What the two arms have: head, socket or face."""
        return self.made.roles()


@dataclass(frozen=True, eq=False)
class Connections:
    """The outlines of all panels with connectors, the connectors, and the loose keys that belong to them.

    unsolved : (name, quad, quad) of the joints that have no room for any connector: they keep their plain ends
    clearance : metres
    taken : metres of every arm, from its joint on, that a connector needs
    tips : the ends of all arms that have a connector
    """

    outlines: tuple[Outline, ...]
    connectors: tuple[Connector, ...]
    unsolved: tuple[tuple[str, int, int], ...]
    clearance: float
    taken: Float[np.ndarray, "quads 4"]
    tips: tuple[Tip, ...] = ()

    @property
    def bridge(self) -> float:
        """Metres: the narrowest neck or wall of a connector; infinite without any."""
        return min(
            (
                min(c.made.size.neck - c.made.size.clearance, c.made.size.thinnest)
                for c in self.connectors
                if c.kind != "tab"
            ),
            default=np.inf,
        )

    @property
    def keys(self) -> tuple[Outline, ...]:
        """The loose keys, one of every connector of that kind, each round the origin."""
        return tuple(Outline(key(c.made.size, c.made.back), ()) for c in self.connectors if c.kind == "key")

    @property
    def _least_radius(self) -> float:
        """Metres: the smallest radius of a corner of heads, sockets and shoulders."""
        sizes = {c.made.size for c in self.connectors if c.kind != "tab"}
        return min([*map(least_radius, sizes), *(radius for tip in self.tips for radius in tip.shoulder_radii)])

    @property
    def report(self) -> dict[str, Any]:
        """The figures of report.json."""
        made = self.connectors
        count = {k: sum(c.kind == k for c in made) for k in ("dovetail", "key", "tab")}
        if not made and not self.unsolved:
            return {"connectors": 0}
        shaped = [c.made.size for c in made if c.kind != "tab"]
        necks = {"connector_neck_min_mm": round(min(s.neck for s in shaped) * 1e3, 4)} if shaped else {}
        return {
            "connectors": len(made),
            "connector_kinds": {k: n for k, n in count.items() if n},
            "connector_clearance_mm": round(self.clearance * 1e3, 4),
            **necks,
            **({"connector_rounding_min_mm": round(self._least_radius * 1e3, 4)} if made else {}),
            "shrunk": sum(c.shrunk for c in made),
            "swapped": sum(c.swapped for c in made),
            "shifted": sum(c.made.shift != 0.0 for c in made),
            "glued": [{"joint": c.name, "faces": list(c.faces)} for c in made if c.kind == "tab"],
            "unsolved": [{"joint": name, "faces": list(faces)} for name, *faces in self.unsolved],
        }


def connect(
    design: SpiralDesign,
    params: ConnectorParams,
    tolerance: float = 1e-5,
    progress: Progress = SILENT,
    mill: float = 0.0,
) -> Connections:
    """Give every joint its connector, as large as there is room, and draw the panels with them.

    ``tolerance`` in metres is that of the outlines; ``mill`` the diameter of the mill that cuts them, 0 for a beam. Joints
    without room keep their plain ends, and the warnings name them. Raises ``FlexMapsError`` where the clearance is so large
    that nothing holds.
    """
    taken = np.zeros((len(design.width), 4))
    if params.connector == "none" or not design.flat.layout.cut.any():
        drawn = design.outlines(tolerance, None, progress)
        return Connections(tuple(drawn), (), (), params.clearance, taken)
    least = size(float(design.arms.joint_width.min()), params, min(SCALES), mill)
    catch = 0.5 * (least.head - least.neck)
    if params.clearance > 0.5 * catch:
        raise FlexMapsError(
            f"With a clearance of {params.clearance * 1e3:g} mm connectors would slip out, for the smallest ones catch by "
            f"{catch * 1e3:.2g} mm; make the clearance at most {500 * catch:.2g} mm"
        )
    space = FreeSpace(design, params, mill, progress.part(0.0, 0.1))
    chosen = _chosen(space, progress.part(0.1, 0.8))
    labels = seam_labels(design.flat.layout)
    made: list[Connector] = []
    unsolved: list[tuple[str, int, int]] = []
    tips: list[Tip] = []
    for joint, choice in enumerate(chosen):
        quad, side = space.joints.quad[joint].tolist(), space.joints.side[joint].tolist()
        name = labels[quad[0], side[0]]
        if choice is None:
            unsolved.append((name, quad[0], quad[1]))
            continue
        attempt = choice.attempt
        seam, place = int(space.joints.seam[joint]), int(space.joints.place[joint])
        largest = space.sizes(joint, attempt.kind)[0]
        swapped = attempt.kind == "dovetail" and attempt.male != place % 2
        made.append(Connector(name, seam, place, attempt, tuple(quad), tuple(side), attempt.size != largest, swapped))
        tips.extend(choice.tips)
    for half in (space.through.own, space.through.other):
        full = np.zeros(len(half.arm))
        for tip in tips:
            if tip.through.own is half:
                full[tip.row] = tip.wide.full[0]
        taken.ravel()[half.arm] = np.maximum(half.along(full), 0.0)
    progress(0.8, "outlines with connectors")
    gathered = space.gathered(tips, design.begin, tolerance)
    drawn = design.outlines(tolerance, gathered, progress.part(0.82, 1.0))
    return Connections(tuple(drawn), tuple(made), tuple(unsolved), params.clearance, taken, tuple(tips))


@dataclass(frozen=True, eq=False)
class _Choice:
    """What is made of a joint: one of its attempts, its tips, and ``placed`` (2, 2) their polygons from ``Room.judged``."""

    attempt: Attempt
    tips: tuple[Tip, Tip]
    placed: np.ndarray


class _Search:
    """Goes through the attempts of all joints, one joint's after the other but those of many joints at once."""

    def __init__(self, space: FreeSpace):
        self.space = space
        self.attempts = [space.attempts(joint) for joint in range(len(space.joints.edge))]
        self.ready: list[deque[_Choice]] = [deque() for _ in self.attempts]

    def next(self, joints: list[int], progress: Progress, first: bool = False) -> dict[int, _Choice | None]:
        """For each of these joints the next attempt that has room; ``None`` where there is no other one.

        first : whether these are the joints' first attempts, which are made without looking round
        """
        found: dict[int, _Choice | None] = {j: self.ready[j].popleft() for j in joints if self.ready[j]}
        waiting, few = [j for j in joints if j not in found], FEW
        while waiting:
            tries = []
            # only as many of one joint as make a chunk: those after the first with room are judged in vain
            each = 1 if first else max(1, min(few, CHUNK // len(waiting)))
            for place, joint in enumerate(waiting):
                if not first and place % CHUNK == 0:
                    progress(len(found) / len(joints), "connectors")
                    self.space.look(waiting[place : place + CHUNK])
                more = list(islice(self.attempts[joint], each))
                tries += [(joint, attempt) for attempt in more]
                if not more:
                    found[joint] = None
            for begin in range(0, len(tries), CHUNK):
                progress(len(found) / len(joints), "connectors")
                self._judge(tries[begin : begin + CHUNK])
            for joint in waiting:
                if self.ready[joint]:
                    found[joint] = self.ready[joint].popleft()
            waiting = [j for j in waiting if j not in found]
            few, first = min(2 * each + 2, MANY), False
        return found

    def _judge(self, tries: list[tuple[int, Attempt]]) -> None:
        """Keep the attempts that have room."""
        made = self.space.judged([joint for joint, _ in tries], [attempt for _, attempt in tries])
        for (joint, attempt), tips in zip(tries, made, strict=True):
            if tips is not None:
                self.ready[joint].append(_Choice(attempt, *tips))


def _chosen(space: FreeSpace, progress: Progress) -> list[_Choice | None]:
    """For every joint the first attempt with room; ``None`` where none has."""
    search = _Search(space)
    every = list(range(len(space.joints.edge)))
    found = search.next(every, progress.part(0.0, 0.9), first=True)
    chosen = [found[joint] for joint in every]
    # tips that are too near to each other: the larger one of two gives way, as long as anything changes
    changed = set(every)
    for turn in range(50):
        progress(0.9 + 0.002 * turn, "connectors that are too near to each other")
        giving = _crowded(space, chosen, changed, progress.part(0.9 + 0.002 * turn, 0.9 + 0.002 * turn))
        if not giving:
            break
        for joint, choice in search.next(giving, progress.part(0.9 + 0.002 * turn, 0.902 + 0.002 * turn)).items():
            chosen[joint] = choice
        changed = set(giving)
    return chosen


def _crowded(space: FreeSpace, chosen: list[_Choice | None], changed: set[int], progress: Progress) -> list[int]:
    """Joints that have to give way because two tips are nearer than the smallest slot.

    Only tips near those of the ``changed`` joints are looked for.
    """
    import shapely

    some = [(joint, c) for joint, c in enumerate(chosen) if c is not None]
    owner = np.repeat(np.array([joint for joint, _ in some], dtype=int), 2)
    fresh = np.flatnonzero(np.isin(owner, list(changed)))
    if not len(fresh):
        return []
    flat, mated = np.stack([c.placed for _, c in some], axis=1).reshape(2, -1)
    tree, slot = shapely.STRtree(flat), 0.999 * space.slot
    area = shapely.area(flat)
    giving: set[int] = set()
    # in one panel, and in two panels that lie side by side along their joint
    for shapes in (flat, mated):
        around = shapely.box(*(shapely.bounds(shapes[fresh]) + slot * np.array([-1.0, -1.0, 1.0, 1.0])).T)
        for part in progress.batches(len(fresh), _TIPS, "connectors that are too near to each other"):
            one, two = tree.query(around[part])
            one = fresh[part][one]
            other = one != two if shapes is flat else owner[one] != owner[two]
            one, two = one[other], two[other]
            near = shapely.dwithin(shapes[one], flat[two], slot)
            one, two = one[near], two[near]
            giving |= set(np.where(area[one] > area[two], owner[one], owner[two]).tolist())
    return sorted(giving)
