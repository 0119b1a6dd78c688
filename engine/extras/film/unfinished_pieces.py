"""Unfinished pieces: equilibrium shapes of the panels joined so far.

A stage is a static equilibrium of the whole piece's elastic model without the joints that are still open. The
unfinished piece floats freely, without weight, supports or forces, and is moved rigidly to fit its position in the
finished piece best. A loose panel is flat.

The stages are computed backwards. The finished piece is taken apart joint by joint in the reverse order of
``joining.assembly_steps``. After every few joints the remaining piece relaxes from its last shape, so nothing has to be
pulled together, and energy only decreases. If a part, such as a ring, springs open too far for the solver, the opened
joints are first weakened gradually. If an unfinished piece has several equilibria, this finds the one that leads to the
finished piece.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ...arrays import Bool, Int
from ...fabrication.panels.labels import panel_name, seam_name
from ...materials import Material
from ...mechanics.assembly import Pose, assembly_from_design
from ...mechanics.elastic import ElasticModel
from ...mechanics.equilibrium import solve
from ...mechanics.loads import Loads
from ...mechanics.vectors import nearest_rotation
from ...params import SimulateParams
from ...patches.joining import AssemblyStep, assembly_steps
from ...patches.layout import PatchLayout
from ...progress import SILENT, Progress
from ...simulation.simulate import build_model
from ...spirals.design import SpiralDesign
from ...surface.checking.finding import with_count

# approximate number of stages in which a panel is joined, at least one per seam; larger: smoother film, more time
BATCHES_PER_STEP = 3
# factors on the stiffness of joints that open gradually: many decades, because translation is far stiffer than rotation
STIFFNESS_SHARES = 10.0 ** -np.arange(1.0, 13.0)


@dataclass(frozen=True, eq=False)
class UnfinishedPiece:
    """Equilibrium of an unfinished piece.

    step : index of the step of ``joining.assembly_steps`` in which the last panel arrives
    seam : name of the seam closed last; "" if none is closed yet
    hubs : indices of the spirals of the panels joined so far
    closed : (m,) whether the joint at each inner edge is closed
    share : share of the step's joints that are closed
    pose : pose of the hubs, fitted to their positions in the finished piece
    energy : elastic energy, J
    whole : whether this is a finished body, in the final pose
    solved : whether the pose is an equilibrium; otherwise it is the pose of the following stage
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
class AssemblyStages:
    """All stages of a piece.

    all : the stages in the order of assembly
    skipped : names of panel and seam of the stages without an equilibrium
    """

    all: tuple[UnfinishedPiece, ...]
    skipped: tuple[tuple[str, str], ...]


def find_stages(
    design: SpiralDesign, pose: Pose, material: Material, params: SimulateParams, progress: Progress = SILENT
) -> AssemblyStages:
    """Compute all stages of a piece; the final pose of the hubs is the last stage of every body.

    Parameters
    ----------
    design, pose : spirals, and the final pose of their hubs
    material, params : material, elastic model and solver; weight and restarts are ignored
    progress : called with the fraction done; may cancel

    Raises
    ------
    FlexMapsError : a spiral is outside the elastic model's range
    """
    progress(0.0, "Taking the piece apart")
    model = build_model(assembly_from_design(design), material, params.model, slopes=False)
    search = _Disassembly(design, pose, model, replace(params, restarts=0))
    plan = [(number, k) for number, step in enumerate(search.order) for k in range(max(len(search.batches[number]), 1))]
    found: list[UnfinishedPiece] = []
    for done, (number, k) in enumerate(reversed(plan)):
        panel = panel_name(number + 1)
        # the first stages computed have most hubs and take longest
        share = 1.0 - (1.0 - done / len(plan)) ** 2
        progress(
            share,
            f"Taking the piece apart: panel {panel}, {with_count(len(plan) - done, 'half-finished piece', 'half-finished pieces')} to go",
        )
        made = search.stage(number, k, progress)
        if made is not None:
            found.append(made)
    return AssemblyStages(tuple(reversed(found)), tuple(reversed(search.skipped)))


def stages_without_equilibria(design: SpiralDesign, pose: Pose) -> AssemblyStages:
    """Return stages without equilibria: every panel arrives in its final shape, and all its seams are closed at once.

    Parameters
    ----------
    design, pose : spirals, and the final pose of their hubs
    """
    layout, found = design.flat.layout, []
    order, bodies, sides = assembly_steps(layout), _body_of_patches(layout), layout.mesh.edge_quads[~layout.mesh.border]
    for number, step in enumerate(order):
        body = bodies[step.panel]
        patches = [p for p in step.joined_panels if bodies[p] == body]
        hubs = np.flatnonzero(np.isin(layout.patch_of, patches))
        closed = np.isin(layout.patch_of[sides], patches).all(axis=1)
        whole = all(bodies[later.panel] != body for later in order[number + 1 :])
        seam = seam_name(step.joins[-1].seam) if step.joins else ""
        found.append(UnfinishedPiece(number, seam, hubs, closed, 1.0, pose.part(hubs), np.nan, whole, whole))
    return AssemblyStages(tuple(found), ())


class _Disassembly:
    """State of the piece while it is taken apart, from the last stage to the first."""

    def __init__(self, design: SpiralDesign, pose: Pose, model: ElasticModel, params: SimulateParams):
        self.design, self.layout, self.end, self.model, self.params = design, design.flat.layout, pose, model, params
        self.pairs = assembly_from_design(design).pairs
        self.order = assembly_steps(self.layout)
        self.batches = [joint_batches(self.layout, step) for step in self.order]
        self.bodies = _body_of_patches(self.layout)
        self.closed = np.ones(len(self.pairs), dtype=bool)
        self.now = Pose(pose.centres.copy(), pose.rotations.copy())
        self.before = self.closed.copy()  # joints closed in the equilibrium ``now``
        self.skipped: list[tuple[str, str]] = []

    def stage(self, number: int, k: int, progress: Progress) -> UnfinishedPiece | None:
        """Return the stage after batches 0 to ``k`` of a step, or None if it has no equilibrium; then open batch ``k``.

        Parameters
        ----------
        number : index of the step
        k : index of the batch of joints within the step
        progress : called with the fraction done; may cancel
        """
        step, batches_ = self.order[number], self.batches[number]
        body, last = self.bodies[step.panel], k >= len(batches_) - 1
        patches = [p for p in step.joined_panels if self.bodies[p] == body]
        hubs = np.flatnonzero(np.isin(self.layout.patch_of, patches))
        closed = self.closed & np.isin(self.layout.patch_of[self.pairs], patches).all(axis=1)
        counts = [len(joints) for _, joints in batches_]
        share = sum(counts[: k + 1]) / sum(counts) if counts else 1.0
        seam = batches_[k][0] if batches_ else ""
        here = UnfinishedPiece(number, seam, hubs, closed, share, self.now.part(hubs), np.nan)
        made: UnfinishedPiece | None
        if last and all(self.bodies[later.panel] != body for later in self.order[number + 1 :]):
            made = self._with_energy(replace(here, pose=self.end.part(hubs), whole=True))
        elif not batches_:
            made = self._with_energy(replace(here, pose=flat_panel_pose(self.design, hubs, self.end)))
        else:
            made = self._relax(here, step.panel, progress)
            if made is None:
                self.skipped.append((panel_name(number + 1), seam))
                # the next panel needs a shape to be joined to, so the last stage of a step is never left out
                made = self._with_energy(replace(here, solved=False)) if last else None
        if made is not None:
            self.now.centres[hubs], self.now.rotations[hubs] = made.pose.centres, made.pose.rotations
            self.before = self.closed.copy()
        if batches_:
            self.closed[batches_[k][1]] = False
        return made

    def _with_energy(self, here: UnfinishedPiece) -> UnfinishedPiece:
        """Return the stage with the elastic energy of its pose filled in."""
        part = self._model(here)
        return replace(here, energy=part.energy(part.start(here.pose)))

    def _model(self, here: UnfinishedPiece) -> ElasticModel:
        """Return the elastic model of a stage: its hubs and closed joints."""
        return self.model.part(here.hubs, np.flatnonzero(here.closed))

    def _relax(self, here: UnfinishedPiece, panel: int, progress: Progress) -> UnfinishedPiece | None:
        """Return the stage at equilibrium; None if the solver does not converge.

        panel : the panel that is being joined
        """
        loads, quiet = Loads.for_spirals(len(here.hubs)), progress.quiet()
        found = solve(self._model(here), here.pose, loads, self.params, quiet)
        if not found.converged:
            opened = self.before & ~self.closed & np.isin(self.pairs, here.hubs).all(axis=1)
            joints, pose = np.flatnonzero(here.closed | opened), here.pose
            held = self.model.part(here.hubs, joints)
            for share in STIFFNESS_SHARES:
                weaker = held.scale_stiffness(np.where(opened[joints], share, 1.0))
                pose = solve(weaker, pose, loads, self.params, quiet).pose
            found = solve(self._model(here), pose, loads, self.params, quiet)
        if not found.converged:
            return None
        # a panel that only few joints hold yet gets little weight when the piece is fitted to its final position
        weight = np.where(self.layout.patch_of[here.hubs] == panel, here.share, 1.0)
        pose = _fit_rigidly(found.pose, self.end.part(here.hubs), weight, 0.5 * self.layout.mesh.median_edge)
        return replace(here, pose=pose, energy=found.energy)


def flat_panel_pose(design: SpiralDesign, hubs: Int[np.ndarray, " hubs"], there: Pose) -> Pose:
    """Return the pose of one panel's hubs if the panel is flat, fitted rigidly to a pose of all hubs.

    Parameters
    ----------
    design : the spirals
    hubs : hubs of the panel
    there : pose of all hubs
    """
    centres = np.c_[design.arms.centre[hubs], np.zeros(len(hubs))]
    flat = Pose(centres, np.broadcast_to(np.eye(3), (len(hubs), 3, 3)))
    return _fit_rigidly(flat, there.part(hubs), np.ones(len(hubs)), 0.5 * design.flat.layout.mesh.median_edge)


def _fit_rigidly(pose: Pose, there: Pose, weight: np.ndarray, reach: float) -> Pose:
    """Return ``pose`` moved rigidly to fit the pose ``there`` best, with weights (n,) of the hubs.

    Axes of the hubs, ``reach`` metres long, are fitted too, so that also hubs in a straight row define an orientation.
    """
    share = weight / weight.sum()
    own, aim = share @ pose.centres, share @ there.centres
    spread = (share[:, None] * (pose.centres - own)).T @ (there.centres - aim)
    turned = np.einsum("n,nik,njk->ij", share, pose.rotations, there.rotations)
    rotation = nearest_rotation(spread + reach**2 * turned)
    return pose.transform(rotation, aim - rotation @ own)


def _body_of_patches(layout: PatchLayout) -> np.ndarray:
    """Return (N,) an index of the body to which every patch belongs; a body is a set of patches connected by seams."""
    body = np.arange(len(layout.patches))
    for edges in layout.seams:
        one, two = body[layout.patch_of[layout.mesh.edge_quads[edges[0]]]]
        body[body == two] = one
    return body


# -- joints in the order in which they are closed
# --------------------------------------------------------------------------


def joint_batches(layout: PatchLayout, step: AssemblyStep) -> list[tuple[str, Int[np.ndarray, " _"]]]:
    """Return the batches of joints that a step closes one after another: name of the seam, and indices of inner edges.

    Seams within the panel come last, because nothing holds the panel before its other seams are joined. Along a seam,
    joints are closed from the end where the panel is already joined.

    Parameters
    ----------
    layout : mesh and cuts
    step : the step
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
        count = min(max(round(BATCHES_PER_STEP * len(edges) / total), 1), len(edges))
        found += [(seam_name(join.seam), joint[part]) for part in np.array_split(edges, count)]
    return found
