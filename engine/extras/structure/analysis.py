"""Response of a piece to its load cases: deflection, utilisation of arms and joints, and snapping.

Utilisation is strain or stress as a share of its limit. All figures of a case come from its load path (``load_path``),
which begins at the equilibrium without loads. The state after a year is computed under the lasting loads with the share
of Young's modulus that is left by then (effective modulus, EN 1995-1-1, 2.3.2.2). All stiffnesses are proportional to
the modulus, so this state equals the equilibrium with the full modulus under these loads divided by that share.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ...arrays import Bool, Float, Int
from ...errors import FlexMapsError
from ...fabrication import joints
from ...fabrication.connectors.connect import Connections
from ...materials import OVERLOADED, OVERSTRAIN_SHARE, Material
from ...mechanics.arms.strain_changes import max_strain_per_spiral
from ...mechanics.assembly import Pose
from ...mechanics.equilibrium import Equilibrium, solve
from ...mechanics.loads import Loads, parse_supports
from ...mechanics.newton_system import NewtonSystem
from ...params import SimulateParams
from ...progress import SILENT, Progress
from ...simulation.simulate import Simulation, move_vertices
from ...surface.checking.check import Finding
from ...surface.checking.finding import with_count
from ...threads import one_thread
from .actions import Action, UnloadedState, actions_by_name, lasting_action
from .buckling import linear_buckling
from .cases import LoadPlan
from .load_path import LoadPath, PathFollower, follow_path
from .structure_params import StructureParams

YEAR = "after a year"  # name and kind of the outcome under lasting loads
MAX_CURVE_POINTS = 60  # largest number of points of a load-deflection curve in the report; later points are left out


@dataclass(frozen=True, eq=False)
class Utilisation:
    """Utilisation of arms and joints in one pose; all None for the rod model.

    arms : largest strain in the arms of every spiral, as a share of the limit
    joints : stress at the narrowest place of every joint, as a share of the limit
    forces, moments : force and moment in every joint, N and N m
    """

    arms: Float[np.ndarray, " spirals"] | None = None
    joints: Float[np.ndarray, " joints"] | None = None
    forces: Float[np.ndarray, " joints"] | None = None
    moments: Float[np.ndarray, " joints"] | None = None


@dataclass(frozen=True, eq=False)
class LoadOutcome:
    """Response to a load case, to a combination, or to the lasting loads after a year.

    name, kind : name, and "case", "combination" or ``YEAR``
    action : loads at the factor 1
    rest, pose : poses of the hubs without and under these loads; ``pose`` is None if the load path does not reach them
    borne : utilisation of arms and joints under these loads
    path : the load path with the full Young's modulus; its factors times ``share`` are the load factors
    linear : critical factor of ``path`` by linear buckling; None if there is none
    share : share of Young's modulus that is left; 1 except after a year
    """

    name: str
    kind: str
    action: Action
    rest: Pose
    pose: Pose | None
    borne: Utilisation
    path: LoadPath
    linear: float | None
    share: float = 1.0

    @property
    def critical(self) -> float | None:
        """Load factor at which the piece snaps, or None if the path did not reach such a point."""
        return None if self.path.critical is None else self.share * self.path.critical

    @property
    def shift(self) -> Float[np.ndarray, "spirals 3"]:
        """Displacement of the hubs from ``rest``, metres, at the factor 1; if that was not reached, just before the
        piece snaps."""
        return (self.path.last.pose if self.pose is None else self.pose).centres - self.rest.centres

    @property
    def deflection(self) -> Float[np.ndarray, " spirals"]:
        """Length of every hub's displacement, metres."""
        return np.linalg.norm(self.shift, axis=1)

    @property
    def curve(self) -> Float[np.ndarray, "points 2"]:
        """Load factor and deflection (metres) at each point of the path, for the hub that moves most.

        The deflection is measured in the direction of the final displacement of this hub.
        """
        most = int(self.deflection.argmax())
        way = self.shift[most] / max(float(self.deflection[most]), 1e-300)
        return np.array([
            [self.share * one.factor, float((one.pose.centres[most] - self.rest.centres[most]) @ way)]
            for one in self.path.points
        ])  # fmt: skip

    def report(self, seams: Bool[np.ndarray, " joints"]) -> dict[str, Any]:
        """Return this outcome's row in the ``structure`` block of report.json.

        seams : whether a joint lies on a seam; only these joints are reported
        """
        row: dict[str, Any] = {
            "name": self.name,
            "kind": self.kind,
            "reached": self.pose is not None,
            "critical": _round_figure(self.critical),
            "critical_kind": self.path.kind,
            "linear": _round_figure(None if self.linear is None else self.share * self.linear),
            "followed_to": _round_figure(self.share * max(one.factor for one in self.path.points)),
            "curve": [[float(f"{x:.6g}"), float(f"{1e3 * y:.6g}")] for x, y in self.curve[:MAX_CURVE_POINTS]],
        }
        if self.path.ended:
            row["ended"] = self.path.ended
        if self.pose is not None:
            row |= {
                "deflection_max_mm": float(f"{1e3 * self.deflection.max():.6g}"),
                "deflection_rms_mm": float(f"{1e3 * np.sqrt((self.deflection**2).mean()):.6g}"),
                "deflection_quad": int(self.deflection.argmax()),
                **_utilisation_figures(self.borne, seams),
            }
        return row


@dataclass(frozen=True, eq=False)
class StructuralAnalysis:
    """Result of the load analysis of a piece.

    at_rest : utilisation of arms and joints without loads
    outcomes : outcomes of the cases, the combinations and the state after a year, in this order
    seams : whether a joint lies on a seam, and so is assembled by hand
    """

    simulation: Simulation
    at_rest: Utilisation
    outcomes: tuple[LoadOutcome, ...]
    seams: Bool[np.ndarray, " joints"]

    @property
    def utilisation(self) -> Float[np.ndarray, " quads"] | None:
        """Largest utilisation of every spiral's arms over all outcomes; None for the rod model."""
        found = [one.borne.arms for one in self.outcomes if one.borne.arms is not None]
        return np.max(found, axis=0) if found else self.at_rest.arms

    @property
    def findings(self) -> list[Finding]:
        """Findings about snapping, breaking, and overloaded connectors."""
        return [finding for one in self.outcomes for finding in _outcome_findings(one, self)]

    def report(self) -> dict[str, Any]:
        """Return the ``structure`` block of report.json."""
        block: dict[str, Any] = {
            "material": self.simulation.material.name,
            "rest": _utilisation_figures(self.at_rest, self.seams),
            "outcomes": [one.report(self.seams) for one in self.outcomes],
        }
        known = self.simulation.material.lasting
        if known is not None:
            block["lasting"] = {
                "share": known.share, "strain": known.strain, "source": known.source, "estimated": list(known.estimated)
            }  # fmt: skip
        if self.findings:
            block["findings"] = [finding.as_dict() for finding in self.findings]
        return block


def _round_figure(value: float | None) -> float | None:
    """Return a number with six significant digits, or None."""
    return None if value is None else float(f"{value:.6g}")


def _utilisation_figures(found: Utilisation, seams: Bool[np.ndarray, " joints"]) -> dict[str, Any]:
    """Return the largest utilisation of arms and of joints on seams for report.json; empty for the rod model."""
    if found.arms is None or found.joints is None or found.forces is None or found.moments is None:
        return {}
    told: dict[str, Any] = {"arms": _round_figure(float(found.arms.max())), "arms_quad": int(found.arms.argmax())}
    if seams.any():
        told |= {
            "joints": _round_figure(float(found.joints[seams].max())),
            "joint_force_n": _round_figure(float(found.forces[seams].max())),
            "joint_moment_n_mm": _round_figure(1e3 * float(found.moments[seams].max())),
        }
    return told


def _outcome_findings(one: LoadOutcome, structure: StructuralAnalysis) -> list[Finding]:
    """Return the findings about one outcome: snapping, overstrained arms and overloaded connectors."""
    found, what = [], f"Under '{one.name}'" if one.kind != YEAR else "After a year under the loads that stay"
    if one.pose is None:
        reached = one.critical or one.share * one.path.last.factor
        far = tuple(np.flatnonzero(one.deflection >= 0.5 * one.deflection.max()).tolist())
        how = "snaps" if one.critical is not None else f"cannot be followed ({one.path.ended}) beyond where it stands"
        text = f"{what} the piece {how} at {reached:.2f} of the load: hold it at more places, or take a thicker sheet"
        found.append(Finding("snaps", "warning", text, far))
    if one.borne.arms is not None and one.borne.arms.max() > OVERSTRAIN_SHARE:
        worst = tuple(np.flatnonzero(one.borne.arms > OVERSTRAIN_SHARE).tolist())
        text = (
            f"{what} the arms of {with_count(len(worst), 'spiral', 'spirals')} are strained to {100.0 * one.borne.arms.max():.0f} % of "
            f"{structure.simulation.material.bears}, give or take 15 %: they may break or stay bent. Hold the piece at more places, or lessen the load"
        )
        found.append(Finding("overstrained", "warning", text, worst))
    if one.borne.joints is not None and structure.seams.any():
        share = np.where(structure.seams, one.borne.joints, 0.0)
        weak = np.flatnonzero(share > OVERLOADED)
        if len(weak):
            quads = np.unique(structure.simulation.assembly.pairs[weak])
            text = f"{what} {with_count(len(weak), 'connector is', 'connectors are')} loaded to {100.0 * share.max():.0f} % of what a neck bears and may open: use glue, hold the piece at more places, or lessen the load"
            found.append(Finding("joints-overloaded", "warning", text, tuple(quads.tolist())))
    return found


# -- analysis
# ------------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class _Strength:
    """Data by which the strength of a piece is checked: its simulation, and the narrowest places of its joints."""

    simulation: Simulation
    necks: joints.Necks

    def borne(self, pose: Pose, strain: float) -> Utilisation:
        """Return the utilisation of arms and joints in a pose; ``strain``: strain limit of the material."""
        model, material = self.simulation.model, self.simulation.material
        state = model.start(pose)
        strains, wrenches = model.strains(state, material), model.wrenches(state)
        if strains is None or wrenches is None:
            return Utilisation()
        worst, wrench = (
            max_strain_per_spiral(model.assembly, strains) / strain,
            wrenches[: model.assembly.n_inner_joints],
        )
        stress = self.necks.stresses(wrench, model.assembly.thickness)
        force, moment = np.linalg.norm(wrench[:, :3], axis=1), np.linalg.norm(wrench[:, 3:], axis=1)
        return Utilisation(worst, stress / (material.youngs * strain), force, moment)


def solve_without_loads(simulation: Simulation, params: SimulateParams, progress: Progress = SILENT) -> Equilibrium:
    """Return the equilibrium of a piece without loads.

    Parameters
    ----------
    simulation : the simulated piece, with model and supports
    params : settings of the solver
    progress : called with the fraction done; may cancel

    Raises
    ------
    FlexMapsError : the solver does not converge
    """
    loads = Loads(simulation.loads.fixed, np.zeros_like(simulation.loads.force))
    found = solve(simulation.model, simulation.equilibrium.pose, loads, params, progress)
    if not found.converged:
        raise FlexMapsError(f"The piece has no equilibrium without loads: {found.status}")
    return found


def unloaded_state(simulation: Simulation, rest: Pose, groups: dict[str, Int[np.ndarray, " some"]]) -> UnloadedState:
    """Return the shape to which loads are applied.

    Parameters
    ----------
    simulation : the simulated piece
    rest : pose of the hubs at the equilibrium without loads
    groups : quads by name, for loads that name their place instead of giving numbers
    """
    design, mesh = simulation.design, simulation.target

    def where(text: str) -> np.ndarray:
        if text in groups:
            return groups[text]
        try:
            return parse_supports(mesh, text)
        except FlexMapsError:
            last = len(mesh.quads) - 1
            raise FlexMapsError(
                f"'{text:.60}' names no quad; give numbers from 0 to {last} with commas between them, 'lowest', or a vertex group"
            ) from None

    return UnloadedState(
        rest,
        move_vertices(design, rest, mesh)[mesh.quads],
        design.flat.corners,
        simulation.assembly.pairs,
        simulation.assembly.sides,
        design.area * simulation.assembly.thickness * simulation.material.density,
        simulation.loads.fixed[:, :3].all(axis=1),
        where,
    )


@one_thread
def analyse(
    simulation: Simulation,
    plan: LoadPlan,
    params: StructureParams,
    how: SimulateParams,
    *,
    connections: Connections | None = None,
    groups: dict[str, Int[np.ndarray, " some"]] | None = None,
    progress: Progress = SILENT,
) -> StructuralAnalysis:
    """Analyse a simulated piece under cases and combinations of loads, and after a year.

    Parameters
    ----------
    simulation : the simulated piece
    plan : load cases and combinations
    params : settings of the analysis
    how : settings of the solver
    connections : connectors, whose necks limit the joints; if None, joints are as wide as the arms
    groups : quads by name, see ``unloaded_state``
    progress : called with the fraction done; may cancel

    Raises
    ------
    FlexMapsError : a load names no quad, or acts on a piece without supports
    """
    base = solve_without_loads(simulation, how, progress.part(0.0, 0.05))
    ground = unloaded_state(simulation, base.pose, groups or {})
    found, stays = actions_by_name(plan, ground), lasting_action(plan, ground)
    mesh = simulation.design.flat.layout.mesh
    strength = _Strength(simulation, joints.list_necks(simulation.design, connections).subset(~mesh.border))
    material, out = simulation.material, []
    if material.lasting is not None:
        # the path is followed to the load factor 1 / share instead of reducing the stiffness; the movements of
        # supports, which this factor multiplies too, must keep their amount
        stays = replace(stays, shift=material.lasting.share * stays.shift)
    names = [*found, *([YEAR] if material.lasting is not None and stays.acts else [])]
    combined = {one.name for one in plan.combinations}
    for number, name in enumerate(names):
        part = progress.part(0.05 + 0.95 * number / len(names), 0.05 + 0.95 * (number + 1) / len(names))
        kind = YEAR if name not in found else "combination" if name in combined else "case"
        action = found.get(name, stays)
        try:
            held = Loads(simulation.loads.fixed, action.at(base.pose)).held_increments(
                simulation.model.pairs, base.pose.centres
            )
        except FlexMapsError as error:
            raise FlexMapsError(f"Load case '{name}': {error}", faces=error.faces) from None
        out.append(_compute_outcome(name, kind, action, strength, base, held, params, how, part.at(0.0, name)))
    seams = simulation.design.flat.layout.cut[~mesh.border]
    return StructuralAnalysis(simulation, strength.borne(base.pose, material.strain_limit), tuple(out), seams)


def _compute_outcome(
    name: str,
    kind: str,
    action: Action,
    strength: _Strength,
    base: Equilibrium,
    held: np.ndarray,
    params: StructureParams,
    how: SimulateParams,
    progress: Progress,
) -> LoadOutcome:
    """Follow the load path of one case, combination or state after a year, and return its outcome.

    base : equilibrium without loads
    held : which unknowns of the hubs are fixed by supports
    how : settings of the solver
    """
    model, material = strength.simulation.model, strength.simulation.material
    share, strain = _modulus_share_and_strain_limit(material, kind)
    follower = PathFollower(model, NewtonSystem(model.pairs, held), action, how.tolerance)
    path = follow_path(follower, base.pose, marks=(1.0 / share,), most=params.factor_max / share, progress=progress)
    there = path.marks.get(1.0 / share)
    pose = None if there is None else there.pose
    borne = Utilisation() if pose is None else strength.borne(pose, strain)
    if share != 1.0 and borne.forces is not None and borne.moments is not None:
        # the model has its full stiffness and scaled-up loads, so its forces are scaled back
        borne = Utilisation(borne.arms, borne.joints, share * borne.forces, share * borne.moments)
    linear = linear_buckling(follower, path.points[0])
    return LoadOutcome(name, kind, action, base.pose, pose, borne, path, linear, share)


def _modulus_share_and_strain_limit(material: Material, kind: str) -> tuple[float, float]:
    """Return the share of Young's modulus that is left, and the strain limit, for a kind of outcome."""
    if kind == YEAR and material.lasting is not None:
        return material.lasting.share, material.lasting.strain
    return 1.0, material.strain_limit
