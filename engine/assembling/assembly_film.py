"""How the panels come together, as a film: from the table they fly to their places, bend, and close seam by seam.

The order is that of ``assembly_order``. A panel that bends goes through blends of its flat and its final pose, whose joints
stay closed; its arms are bent in every one of them as in ``bent_arms``. At its seams the arms take up the wrench that they
carry in the end, so that the tips of both sides meet as the panel arrives.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.sparse import csgraph
from scipy.sparse.linalg import splu

from ..fabrication.panel_mesh import Detail, PanelMesh, panel_mesh
from ..mechanics.assembly import Pose, nearest_rotation, rest_joints
from ..mechanics.bent_arms import BentArms, bent, exponential
from ..mechanics.joint_motion import rotation_vector, times
from ..progress import SILENT, Progress
from ..spirals.design import SpiralDesign
from .assembly_order import steps

BENDS = 6
"""Shapes between flat and bent."""
FLIGHT, CLOSING = 0.6, 0.5
"""How long a panel flies and closes, in steps; the next panel flies while it closes."""
WAYPOINTS = 9


@dataclass(frozen=True, eq=False)
class Track:
    """What becomes of one panel. Times are in steps.

    vertices : (n,) int, its vertices in the film's mesh
    shapes : (K, n, 3) metres, in the panel's own frame, one after the other; shape_times : (K,), when it has each
    times : (M,), turns : (M, 3, 3) and places : (M, 3) metres, of the panel's own frame
    """

    patch: int
    vertices: np.ndarray
    shapes: np.ndarray
    shape_times: np.ndarray
    times: np.ndarray
    turns: np.ndarray
    places: np.ndarray


@dataclass(frozen=True, eq=False)
class Film:
    """panels : the mesh of all panels; tracks : one a panel, in the order in which they are joined; length : in steps"""

    panels: PanelMesh
    tracks: tuple[Track, ...]
    length: float


def film(design: SpiralDesign, pose: Pose, table: np.ndarray, detail: Detail, progress: Progress = SILENT) -> Film:
    """The film of an assembly that ends in a pose; table (N, 3) metres: where the origin of every patch lies at first.

    The patches lie parallel to the xy plane.
    """
    layout = design.flat.layout
    order = steps(layout)
    when = np.zeros(len(order))
    when[[step.panel for step in order]] = np.arange(len(order))
    home = _frames(design, pose)
    blend = Blend.of(design, _local(pose, home, layout.patch_of))
    final = bent(design, pose).wrench
    events, sides = _events(design, when)
    panels = panel_mesh(design, detail)
    inside = ~layout.cut[~layout.mesh.border]
    shares = np.linspace(0.0, 1.0, BENDS + 1)
    rounds = len(shares) + max((len(e) for e in events), default=0)
    shapes: list[np.ndarray] = []
    for k in range(rounds):
        progress(k / rounds, "Bending the panels")
        stand = blend.at(shares[k]) if k < len(shares) else blend.at(1.0)
        # an arm at a seam takes its share as its own panel arrives, or later, when the other one does
        late = np.where(sides >= 0, sides + 1, 0)
        load = np.where(late == 0, shares[min(k, len(shares) - 1)], (k - len(shares) + 1 >= late) * 1.0)
        arms: BentArms = bent(design, stand, closed=inside, wrench=load[:, None] * final)
        shapes.append(panels.placed(arms, stand))
    patch = layout.patch_of[panels.vertex_quad]
    rest = _table_places(design, table)
    size = float(np.linalg.norm(np.ptp(pose.centres, axis=0)))
    tracks = []
    for number, step in enumerate(order):
        p = step.panel
        own = np.flatnonzero(patch == p)
        arrival = number + FLIGHT
        begins = [arrival + CLOSING * s for s in shares]
        marks, which = [*begins], list(range(len(shares)))
        for e, other in enumerate(events[p]):
            # it keeps its last shape until the other panel comes
            marks += [other + FLIGHT, other + FLIGHT + CLOSING]
            which += [which[-1], len(shares) + e]
        bending = [shape[own] for shape in shapes[: len(shares)]]
        moves = _flight(number, rest[p], home[1][p], home[0][p], size, bending)
        tracks.append(Track(p, own, np.stack([shapes[k][own] for k in which]), np.array(marks), *moves))
    return Film(panels, tuple(tracks), len(order) - 1 + FLIGHT + CLOSING)


# -- where the panels are -----------------------------------------------------------------------------------------------


def _frames(design: SpiralDesign, pose: Pose) -> tuple[np.ndarray, np.ndarray]:
    """Turns (N, 3, 3) and places (N, 3) of the patches as a whole: the mean of their hubs."""
    patch, count = design.flat.layout.patch_of, len(design.flat.layout.patches)
    turns = np.stack([np.bincount(patch, pose.rotations[:, i, j], count) for i in range(3) for j in range(3)], axis=1)
    return nearest_rotation(np.swapaxes(turns.reshape(-1, 3, 3), 1, 2)), _means(pose.centres, patch, count)


def _means(points: np.ndarray, patch: np.ndarray, count: int) -> np.ndarray:
    total = np.stack([np.bincount(patch, x, count) for x in points.T], axis=1)
    return total / np.bincount(patch, minlength=count)[:, None]


def _local(pose: Pose, home: tuple[np.ndarray, np.ndarray], patch: np.ndarray) -> Pose:
    """A pose as the patches see it."""
    back = np.swapaxes(home[0], 1, 2)[patch]
    return Pose(times(back, pose.centres - home[1][patch]), back @ pose.rotations)


def _table_places(design: SpiralDesign, table: np.ndarray) -> np.ndarray:
    """(N, 3) metres: where the middle of every patch lies on the table."""
    middles = _means(design.arms.centre, design.flat.layout.patch_of, len(table))
    return table + np.c_[middles, np.zeros(len(middles))]


def _flight(
    number: int, table: np.ndarray, place: np.ndarray, turn: np.ndarray, size: float, bending: list[np.ndarray]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times (M,), turns (M, 3, 3) and places (M, 3) of the panel that is joined in a step: up in an arc, then in from outside.

    bending : its shapes (n, 3) metres from flat to bent, evenly spaced in time; until it is there it stays above the table
    """
    share = np.linspace(0.0, 1.0, WAYPOINTS)
    ease = share * share * (3.0 - 2.0 * share)
    turns = exponential(ease[:, None] * rotation_vector(turn[None])[0])
    hover = place + 0.15 * size * turn[:, 2]
    arc = table + ease[:, None] * (hover - table)
    arc[:, 2] += 0.35 * size * np.sin(np.pi * ease)
    ground = table[2] + float(bending[0][:, 2].min())
    arc[:, 2] = np.maximum(arc[:, 2], ground - (turns[:, 2] @ bending[0].T).min(axis=1))
    closing = np.linspace(0.0, 1.0, len(bending))[1:]
    inwards = arc[-1] + (closing * (2.0 - closing))[:, None] * (place - arc[-1])
    lowest = np.array([(shape @ turn[2]).min() for shape in bending[1:]])
    inwards[:-1, 2] = np.maximum(inwards[:-1, 2], (ground - lowest)[:-1])
    when = number + np.concatenate([FLIGHT * share, FLIGHT + CLOSING * closing])
    held = np.broadcast_to(turn, (len(closing), 3, 3))
    return when, np.concatenate([turns, held]), np.concatenate([arc, inwards])


# -- how they bend --------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Blend:
    """Poses between flat patches, 0, and a pose, 1, in which the joints within every patch are as closed as they are there.

    turns : (F, 3) rotation vectors of the hubs from flat to there, in the frames of their patches
    gaps : (m, 3) metres, what the way between both hubs misses the joint by, as seen half way, at inner joints ``pairs``
    """

    patch: np.ndarray
    flat: np.ndarray
    pairs: np.ndarray
    lever: np.ndarray
    turns: np.ndarray
    gaps: np.ndarray
    solve: object

    @classmethod
    def of(cls, design: SpiralDesign, pose: Pose) -> Blend:
        """``pose`` is seen from the frames of the patches."""
        layout = design.flat.layout
        mesh, patch = layout.mesh, layout.patch_of
        joined = ~layout.cut[~mesh.border]
        pairs, lever = mesh.edge_quads[~mesh.border][joined], rest_joints(mesh, design.flat.corners)[0][joined]
        turns = _unwound(rotation_vector(pose.rotations), pairs, len(patch))
        count, middles = len(layout.patches), design.arms.centre
        flat = np.c_[middles - _means(middles, patch, count)[patch], np.zeros(len(patch))]
        gaps = _gap(pose.centres, exponential(turns), pairs, lever)
        gaps = times(np.swapaxes(_half(turns, pairs), 1, 2), gaps)
        # hubs are held together by their joints, and every patch by a weak spring at its middle
        ones, rows = np.ones(len(pairs)), np.arange(len(pairs))
        ends = sparse.coo_matrix(
            (np.concatenate([ones, -ones]), (np.tile(rows, 2), np.concatenate([pairs[:, 1], pairs[:, 0]]))),
            (len(pairs), len(patch)),
        ).tocsr()
        solver = splu((ends.T @ ends + 1e-9 * sparse.identity(len(patch))).tocsc())
        return cls(patch, flat, pairs, lever, turns, gaps, lambda right: solver.solve(ends.T @ right))

    def at(self, share: float) -> Pose:
        """The pose in between, in the frames of the patches."""
        turns = share * self.turns
        rotations = exponential(turns)
        wanted = times(_half(turns, self.pairs), share * self.gaps) - _gap(self.flat, rotations, self.pairs, self.lever)
        moved = self.flat + self.solve(wanted)  # type: ignore[operator]
        return Pose(moved - _means(moved, self.patch, int(self.patch.max()) + 1)[self.patch], rotations)


def _gap(centres: np.ndarray, rotations: np.ndarray, pairs: np.ndarray, lever: np.ndarray) -> np.ndarray:
    """(m, 3) metres from the joint as the first hub carries it to that of the second."""
    ends = centres[pairs] + (rotations[pairs] @ lever[..., None])[..., 0]
    return ends[:, 1] - ends[:, 0]


def _half(turns: np.ndarray, pairs: np.ndarray) -> np.ndarray:
    """(m, 3, 3): about half way between two hubs."""
    return exponential(0.5 * (turns[pairs[:, 0]] + turns[pairs[:, 1]]))


def _unwound(turns: np.ndarray, pairs: np.ndarray, count: int) -> np.ndarray:
    """Rotation vectors (F, 3) that change little from a hub to the next, so that rolled panels unroll the way they came."""
    graph = sparse.coo_matrix((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), (count, count)).tocsr()
    parts, label = csgraph.connected_components(graph, directed=False)
    out = turns.copy()
    size = np.linalg.norm(turns, axis=1)
    for part in range(parts):
        members = np.flatnonzero(label == part)
        start = members[np.argmin(size[members])]
        order, before = csgraph.breadth_first_order(graph, start, directed=False)
        for hub in order[1:].tolist():
            near = out[before[hub]]
            # about the same axis, as many whole turns more as bring it nearest to the hub before
            axis = turns[hub] / size[hub] if size[hub] > 1e-9 else near / max(float(np.linalg.norm(near)), 1e-9)
            out[hub] += 2.0 * np.pi * np.round((near @ axis - size[hub]) / (2.0 * np.pi)) * axis
    return out


# -- which seams close when ---------------------------------------------------------------------------------------------


def _events(design: SpiralDesign, when: np.ndarray) -> tuple[list[list[int]], np.ndarray]:
    """Of every patch the later steps that close a seam of it; and of every arm (A,) which of these is its own, else -1."""
    layout = design.flat.layout
    mesh = layout.mesh
    seam = layout.cut & ~mesh.border
    arms = 4 * mesh.edge_quads[seam] + mesh.edge_sides[seam]
    patch = layout.patch_of[mesh.edge_quads[seam]]
    events: list[list[int]] = [[] for _ in when]
    for a, b in np.unique(np.sort(patch, axis=1), axis=0).tolist():
        if a != b:
            first, last = (a, b) if when[a] < when[b] else (b, a)
            events[first].append(int(when[last]))
    for found in events:
        found.sort()
    which = np.full(4 * len(mesh.quads), -1)
    for own, other in ((0, 1), (1, 0)):
        for arm, a, b in zip(arms[:, own].tolist(), patch[:, own].tolist(), patch[:, other].tolist(), strict=True):
            if when[b] > when[a]:
                which[arm] = events[a].index(int(when[b]))
    return events, which
