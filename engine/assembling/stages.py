"""Half-finished pieces: the shapes in which the panels that are joined so far come to rest.

A stage is a static equilibrium of the elastic model of the whole piece without the joints that are still open; every other
joint is as it will be in the end, and nothing forces those that are open. Pieces float freely: neither weight nor supports
nor forces act on them, and each lies where it fits its place in the finished piece best. A loose panel lies flat.

The stages are sought backwards. The finished piece is taken apart joint by joint, seam by seam, in the opposite order of
``joining.steps``, and after some joints what is left relaxes from where it was: nothing has to be pulled together over a
gap, and energy is only given away. What springs open too far to be followed at once, such as a ring, is let go slowly: the
joints that are opened become weaker and weaker first. Where a half-finished piece could rest in several shapes, this is the
one from which the finished one is reached.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..arrays import Bool, Int
from ..fabrication.panels.labels import panel_name, seam_name
from ..materials import Material
from ..mechanics.assembly import Pose, nearest_rotation, of_design
from ..mechanics.elastic import ElasticModel
from ..mechanics.equilibrium import solve
from ..mechanics.loads import Loads
from ..params import SimulateParams
from ..patches.joining import Step, steps
from ..patches.layout import PatchLayout
from ..progress import SILENT, Progress
from ..simulation.simulate import build_model
from ..spirals.design import SpiralDesign
from ..surface.checking.finding import counted

# about so many stages, one after the other, in which an arriving panel is joined; every seam has one at least; by eye
PARTS = 3
# Newton steps that a piece may take to its rest after joints were opened, and after they were made weaker; not measured
AT_ONCE, SLOWLY = 150, 40
# shares of their stiffness of joints that are let go slowly; shifts at a joint are far stiffer than turns: many decades
WEAKER = 10.0 ** -np.arange(1.0, 13.0)


@dataclass(frozen=True, eq=False)
class Stage:
    """What is joined after some joints, and where it rests.

    step : number of the step of ``joining.steps`` in which its last panel comes; seam : name of its last seam, empty
        before the first
    hubs : the spirals of its panels; closed : of all inner edges, those whose joints are closed
    share : of the joints of the step that are closed
    pose : of the hubs, laid over their places in the finished piece
    energy : joules, of the elastic model
    whole : whether it is the finished body, which is in the pose that it was given
    solved : whether it is an equilibrium; if not, it has the shape of the next one that is
    """

    step: int
    seam: str
    hubs: Int[np.ndarray, " hubs"]
    closed: Bool[np.ndarray, " joints"]
    share: float
    pose: Pose
    energy: float
    whole: bool = False
    solved: bool = True


@dataclass(frozen=True, eq=False)
class Stages:
    """All stages of a piece.

    all : in the order in which it is put together; skipped : panels and seams, by their names, of those that found no
        equilibrium
    """

    all: tuple[Stage, ...]
    skipped: tuple[tuple[str, str], ...]


def find_stages(
    design: SpiralDesign, pose: Pose, material: Material, params: SimulateParams, progress: Progress = SILENT
) -> Stages:
    """All stages of a piece whose hubs rest in a pose, which is the last stage of every body.

    params : the elastic model and its solver; weight and other shapes are left out. Raises FlexMapsError where a spiral is
    outside the elastic model's range.
    """
    model = build_model(of_design(design), material, params.model, slopes=False)
    search = _Search(design, pose, model, replace(params, restarts=0))
    plan = [(number, k) for number, step in enumerate(search.order) for k in range(max(len(search.batches[number]), 1))]
    found: list[Stage] = []
    for done, (number, k) in enumerate(reversed(plan)):
        panel = panel_name(number + 1)
        # many joints are many hubs: the first stages that are sought are the longest
        share = 1.0 - (1.0 - done / len(plan)) ** 2
        progress(
            share,
            f"Taking the piece apart: panel {panel}, {counted(len(plan) - done, 'half-finished piece', 'half-finished pieces')} to go",
        )
        made = search.stage(number, k, progress)
        if made is not None:
            found.append(made)
    return Stages(tuple(reversed(found)), tuple(reversed(search.skipped)))


def at_once(design: SpiralDesign, pose: Pose) -> Stages:
    """Stages that nothing was sought for: every panel takes its final shape as it comes, and all its seams are closed with it."""
    layout, found = design.flat.layout, []
    order, bodies, sides = steps(layout), _bodies(layout), layout.mesh.edge_quads[~layout.mesh.border]
    for number, step in enumerate(order):
        body = bodies[step.panel]
        patches = [p for p in step.there if bodies[p] == body]
        hubs = np.flatnonzero(np.isin(layout.patch_of, patches))
        closed = np.isin(layout.patch_of[sides], patches).all(axis=1)
        whole = all(bodies[later.panel] != body for later in order[number + 1 :])
        seam = seam_name(step.joins[-1].seam) if step.joins else ""
        found.append(Stage(number, seam, hubs, closed, 1.0, pose.part(hubs), np.nan, whole, whole))
    return Stages(tuple(found), ())


class _Search:
    """The piece as it is taken apart."""

    def __init__(self, design: SpiralDesign, pose: Pose, model: ElasticModel, params: SimulateParams):
        self.design, self.layout, self.end, self.model, self.params = design, design.flat.layout, pose, model, params
        self.pairs = of_design(design).pairs
        self.order = steps(self.layout)
        self.batches = [batches(self.layout, step) for step in self.order]
        self.bodies = _bodies(self.layout)
        self.closed = np.ones(len(self.pairs), dtype=bool)
        self.now = Pose(pose.centres.copy(), pose.rotations.copy())
        self.before = self.closed.copy()  # where ``now`` rests
        self.skipped: list[tuple[str, str]] = []

    def stage(self, number: int, k: int, progress: Progress) -> Stage | None:
        """The stage after the batches up to ``k`` of a step; then those of ``k`` are opened. None where it is left out."""
        step, batches_ = self.order[number], self.batches[number]
        body, last = self.bodies[step.panel], k >= len(batches_) - 1
        patches = [p for p in step.there if self.bodies[p] == body]
        hubs = np.flatnonzero(np.isin(self.layout.patch_of, patches))
        closed = self.closed & np.isin(self.layout.patch_of[self.pairs], patches).all(axis=1)
        counts = [len(joints) for _, joints in batches_]
        share = sum(counts[: k + 1]) / sum(counts) if counts else 1.0
        seam = batches_[k][0] if batches_ else ""
        here = Stage(number, seam, hubs, closed, share, self.now.part(hubs), np.nan)
        made: Stage | None
        if last and all(self.bodies[later.panel] != body for later in self.order[number + 1 :]):
            made = self._standing(replace(here, pose=self.end.part(hubs), whole=True))
        elif not batches_:
            made = self._standing(replace(here, pose=lying(self.design, hubs, self.end)))
        else:
            made = self._solved(here, step.panel, progress)
            if made is None:
                self.skipped.append((panel_name(number + 1), seam))
                # something has to be there before the panel comes
                made = self._standing(replace(here, solved=False)) if last else None
        if made is not None:
            self.now.centres[hubs], self.now.rotations[hubs] = made.pose.centres, made.pose.rotations
            self.before = self.closed.copy()
        if batches_:
            self.closed[batches_[k][1]] = False
        return made

    def _standing(self, here: Stage) -> Stage:
        """With the energy of where it is."""
        part = self._model(here)
        return replace(here, energy=part.energy(part.start(here.pose)))

    def _model(self, here: Stage) -> ElasticModel:
        return self.model.part(here.hubs, np.flatnonzero(here.closed))

    def _solved(self, here: Stage, panel: int, progress: Progress) -> Stage | None:
        loads, quiet = Loads.of(len(here.hubs)), progress.quiet()
        found = solve(self._model(here), here.pose, loads, self.params, quiet, iterations=AT_ONCE)
        if not found.converged:
            opened = self.before & ~self.closed & np.isin(self.pairs, here.hubs).all(axis=1)
            joints, pose = np.flatnonzero(here.closed | opened), here.pose
            held = self.model.part(here.hubs, joints)
            for share in WEAKER:
                weaker = held.weakened(np.where(opened[joints], share, 1.0))
                pose = solve(weaker, pose, loads, self.params, quiet, iterations=SLOWLY).pose
            found = solve(self._model(here), pose, loads, self.params, quiet, iterations=AT_ONCE)
        if not found.converged:
            return None
        # a panel that hangs on by a few joints has little to say about where the piece lies
        weight = np.where(self.layout.patch_of[here.hubs] == panel, here.share, 1.0)
        pose = _laid(found.pose, self.end.part(here.hubs), weight, 0.5 * self.layout.mesh.median_edge)
        return replace(here, pose=pose, energy=found.energy)


def lying(design: SpiralDesign, hubs: Int[np.ndarray, " hubs"], there: Pose) -> Pose:
    """Hubs of one panel, flat, laid over their places in a pose of all hubs."""
    centres = np.c_[design.arms.centre[hubs], np.zeros(len(hubs))]
    flat = Pose(centres, np.broadcast_to(np.eye(3), (len(hubs), 3, 3)))
    return _laid(flat, there.part(hubs), np.ones(len(hubs)), 0.5 * design.flat.layout.mesh.median_edge)


def _laid(pose: Pose, there: Pose, weight: np.ndarray, reach: float) -> Pose:
    """A pose moved rigidly so that hubs with these weights (n,) lie as near as possible to those of another one.

    What is compared are the ends of the hubs' axes, of length ``reach`` in metres: a row of hubs has a direction, too.
    """
    share = weight / weight.sum()
    own, aim = share @ pose.centres, share @ there.centres
    spread = (share[:, None] * (pose.centres - own)).T @ (there.centres - aim)
    turned = np.einsum("n,nik,njk->ij", share, pose.rotations, there.rotations)
    rotation = nearest_rotation(spread + reach**2 * turned)
    return pose.placed(rotation, aim - rotation @ own)


def _bodies(layout: PatchLayout) -> np.ndarray:
    """(N,) int: which body every patch belongs to."""
    body = np.arange(len(layout.patches))
    for edges in layout.seams:
        one, two = body[layout.patch_of[layout.mesh.edge_quads[edges[0]]]]
        body[body == two] = one
    return body


# -- joints in the order in which they are closed --------------------------------------------------------------------------


def batches(layout: PatchLayout, step: Step) -> list[tuple[str, Int[np.ndarray, " _"]]]:
    """The joints, of all inner edges, that a step closes one after the other, with the names of their seams.

    Seam by seam as the step says, those within the panel last, for it hangs on nothing before the others; along a seam from
    the end at which the panel is already joined.
    """
    mesh = layout.mesh
    joint = np.cumsum(~mesh.border) - 1
    joins = sorted(step.joins, key=lambda join: join.other == join.panel)
    total, found = sum(join.joints for join in joins), []
    held: set[int] = set()  # vertices where the panel is joined
    for join in joins:
        edges = layout.seams[join.seam]
        if len(edges) > 1 and held:
            first, last = (set(mesh.edges[e].tolist()) for e in (edges[0], edges[-1]))
            if last & held and not first & held:
                edges = edges[::-1]
        held.update(mesh.edges[edges].ravel().tolist())
        count = min(max(round(PARTS * len(edges) / total), 1), len(edges))
        found += [(seam_name(join.seam), joint[part]) for part in np.array_split(edges, count)]
    return found
