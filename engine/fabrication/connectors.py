"""Connectors wherever two arms meet across a cut: dovetails, loose keys or tabs for glue (FlexMaps section 8)."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import islice
from typing import Any

import numpy as np

from ..errors import FlexMapsError
from ..params import ConnectorParams
from ..progress import SILENT, Progress
from ..spirals.contours import Outline, ends
from ..spirals.design import SpiralDesign
from .connector_path import Attempt, Tip
from .connector_room import SCALES, Room
from .connector_shape import key, size
from .labels import seam_labels


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
    taken : (F, 4) metres of every arm, from its joint on, that a connector needs
    tips : the ends of all arms that have a connector
    """

    outlines: tuple[Outline, ...]
    connectors: tuple[Connector, ...]
    unsolved: tuple[tuple[str, int, int], ...]
    clearance: float
    taken: np.ndarray
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
    def report(self) -> dict[str, Any]:
        """The figures of report.json."""
        made = self.connectors
        count = {k: sum(c.kind == k for c in made) for k in ("dovetail", "key", "tab")}
        if not made and not self.unsolved:
            return {"connectors": 0}
        held = [c.made.size.neck for c in made if c.kind != "tab"]
        necks = {"connector_neck_min_mm": round(min(held) * 1e3, 4)} if held else {}
        return {
            "connectors": len(made),
            "connector_kinds": {k: n for k, n in count.items() if n},
            "connector_clearance_mm": round(self.clearance * 1e3, 4),
            **necks,
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

    ``tolerance`` in metres is that of the outlines; ``mill`` the diameter of the mill that cuts them, 0 for a beam. Joints without room keep their plain ends and are told. Raises
    ``FlexMapsError`` where the clearance is so large that nothing holds.
    """
    taken = np.zeros((len(design.width), 4))
    if params.connector == "none":
        return Connections(tuple(design.outlines(tolerance)), (), (), params.clearance, taken)
    least = size(float(design.arms.joint_width.min()), params, min(SCALES), mill)
    catch = 0.5 * (least.head - least.neck)
    if params.clearance > 0.5 * catch:
        raise FlexMapsError(
            f"With a clearance of {params.clearance * 1e3:g} mm connectors would slip out, for the smallest ones catch by "
            f"{catch * 1e3:.2g} mm; make the clearance at most {500 * catch:.2g} mm"
        )
    room = Room(design, params, mill)
    chosen = _chosen(room, progress.part(0.0, 0.8))
    labels = seam_labels(design.flat.layout)
    made: list[Connector] = []
    unsolved: list[tuple[str, int, int]] = []
    tips: list[Tip] = []
    for joint, choice in enumerate(chosen):
        quad, side = room.joints.quad[joint].tolist(), room.joints.side[joint].tolist()
        name = labels[quad[0], side[0]]
        if choice is None:
            unsolved.append((name, quad[0], quad[1]))
            continue
        attempt = choice.attempt
        seam, place = int(room.joints.seam[joint]), int(room.joints.place[joint])
        largest = room.sizes(choice.tips[0].through, attempt.kind)[0]
        swapped = attempt.kind == "dovetail" and attempt.male != place % 2
        made.append(Connector(name, seam, place, attempt, tuple(quad), tuple(side), attempt.size != largest, swapped))
        tips.extend(choice.tips)
        for tip in choice.tips:
            taken.ravel()[tip.arm] = max(
                float(np.interp(tip.wide.full, tip.through.own.t, tip.through.own.length)), 0.0
            )
    progress(0.8, "outlines with connectors")
    gathered = room.gathered(tips, ends(design.flat.layout, design.arms, room.slot), tolerance)
    drawn = design.outlines(tolerance, gathered)
    return Connections(tuple(drawn), tuple(made), tuple(unsolved), params.clearance, taken, tuple(tips))


@dataclass(frozen=True, eq=False)
class _Choice:
    """What is made of a joint: which of its attempts, and its tips."""

    number: int
    attempt: Attempt
    tips: tuple[Tip, Tip]


def _chosen(room: Room, progress: Progress) -> list[_Choice | None]:
    """For every joint the first attempt with room; ``None`` where none has."""
    count = len(room.joints.edge)
    chosen: list[_Choice | None] = []
    for joint in range(count):
        if joint % 8 == 0:
            progress(0.95 * joint / count, "connectors")
        chosen.append(_next(room, joint, 0))
    # tips that are too near to each other: the larger one of two gives way, as long as anything changes
    changed = set(range(count))
    for turn in range(50):
        progress(0.95 + 0.001 * turn, "connectors that are too near to each other")
        giving = _crowded(room, chosen, changed)
        if not giving:
            break
        for place, (joint, number) in enumerate(giving.items()):
            if place % 8 == 0:
                progress(0.95 + 0.001 * turn)
            chosen[joint] = _next(room, joint, number + 1)
        changed = set(giving)
    return chosen


def _next(room: Room, joint: int, start: int) -> _Choice | None:
    """The first attempt from ``start`` on that has room."""
    through = room.through(joint)
    near = room.near(through)
    for number, attempt in islice(enumerate(room.attempts(joint, through, near)), start, None):
        tips = room.tips(through, attempt)
        if tips is not None and room.free(joint, tips, near):
            return _Choice(number, attempt, tips)
    return None


def _crowded(room: Room, chosen: list[_Choice | None], changed: set[int]) -> dict[int, int]:
    """Joints that have to give way because two tips are nearer than the smallest slot; and what they tried last.

    Only tips near those of the ``changed`` joints are looked for.
    """
    import shapely

    owners = [(joint, c.number) for joint, c in enumerate(chosen) if c is not None for _ in c.tips]
    tips = [tip for c in chosen if c is not None for tip in c.tips]
    fresh = np.array([k for k, (joint, _) in enumerate(owners) if joint in changed], dtype=int)
    if not len(fresh):
        return {}
    polygons = np.array([t.polygon for t in tips])
    patch = np.array([t.patch for t in tips])
    tree, slot = shapely.STRtree(room.apart(polygons, patch)), 0.999 * room.slot
    one, two = tree.query(room.apart(polygons[fresh], patch[fresh]), predicate="dwithin", distance=slot)
    pairs = zip(fresh[one].tolist(), two.tolist(), strict=True)
    near = {(a, b) for a, b in pairs if a != b}
    # and of two panels that lie side by side along their joint
    beside = np.array([tips[a].beside for a in fresh.tolist()])
    others = np.array([tips[a].through.other.patch for a in fresh.tolist()])
    one, two = tree.query(room.apart(beside, others), predicate="dwithin", distance=slot)
    pairs = zip(fresh[one].tolist(), two.tolist(), strict=True)
    near |= {(a, b) for a, b in pairs if owners[a] != owners[b]}
    return dict(owners[a] if polygons[a].area > polygons[b].area else owners[b] for a, b in sorted(near))
