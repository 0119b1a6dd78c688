"""Predict how hard every seam is to assemble: how well its two sides fit, and the load on its joints.

Flattening makes the two sides of a seam slightly different in length; to join them, one side is stretched and the other
compressed. Module ``joints`` computes the load on joints in equilibrium.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..patches.joining import panel_numbers
from ..patches.layout import PatchLayout
from ..simulation.simulate import Simulation
from ..spirals.design import SpiralDesign
from . import joints
from .connectors.connect import Connections
from .panels.labels import panel_name, seam_name

# A seam whose forces are unknown counts as hard to join if the two sides of one of its edges differ in length by more
# than this share of their mean. At 0.05, two joints 20 mm apart are misaligned by 1 mm, the width of a thin arm. Larger
# values report fewer seams as hard
MAX_STRETCH = 0.05
# A seam counts as hard to join if the force at one of its joints exceeds this many newtons: a third of an adult's pinch
# strength. Larger values report fewer seams as hard
MAX_HAND_FORCE = 20.0
# A seam counts as hard to join if the stress in the neck of one of its joints exceeds this share of the material's
# strength. Larger values report fewer seams as hard
MAX_LOAD = 1.0


@dataclass(frozen=True)
class SeamCheck:
    """Prediction for one seam.

    name : letters of the seam
    panels : numbers of the panels on the seam's two sides, equal for a cut within a panel
    joints : number of joints along the seam
    lengths : lengths of the seam's two flat sides, metres
    stretch : largest difference in length between the two sides of an edge, as a share of their mean
    force, moment : largest force and largest moment at the seam's joints in equilibrium, N and N m
    load : largest stress in the neck of a joint (module ``joints``), as a share of the material's strength
    difficulties : reasons why the seam is hard to join: "force", "load", or "stretch" if the forces are unknown

    force, moment and load are None if the forces in equilibrium are unknown, see ``check_assembly``.
    """

    name: str
    panels: tuple[int, int]
    joints: int
    lengths: tuple[float, float]
    stretch: float
    force: float | None
    moment: float | None
    load: float | None
    difficulties: tuple[str, ...]

    @property
    def mismatch(self) -> float:
        """Difference between the total lengths of the seam's two sides, as a share of their mean."""
        return 2.0 * abs(self.lengths[0] - self.lengths[1]) / sum(self.lengths)


@dataclass(frozen=True)
class AssemblyCheck:
    """Predictions for all seams, in the order of ``layout.seams``."""

    seams: tuple[SeamCheck, ...]

    @property
    def warnings(self) -> tuple[str, ...]:
        """One sentence for the user per reason why seams are hard to join: which seams, the reason and a remedy."""
        limits = (
            ("stretch", f"the two sides of an edge differ by more than {100 * MAX_STRETCH:g} %",
             "pull the shorter side along as you join them"),
            ("force", f"a joint pulls with more than {MAX_HAND_FORCE:g} N", "a thinner sheet or thinner arms help"),
            ("load", "a connector would be strained beyond what the material bears",
             "a thinner sheet, a larger object or another material help"),
        )  # fmt: skip
        found = []
        for kind, what, helps in limits:
            names = [s.name for s in self.seams if kind in s.difficulties]
            if names:
                some = ", ".join(names[:8]) + (", ..." if len(names) > 8 else "")
                found.append(f"Hard to assemble, {len(names)} of {len(self.seams)} seams ({some}): {what}; {helps}")
        return tuple(found)

    def report(self) -> dict[str, Any]:
        """Return the ``assembly`` block of report.json."""
        loads = [s for s in self.seams if s.force is not None]
        block: dict[str, Any] = {
            "mismatch_max": round(max((s.mismatch for s in self.seams), default=0.0), 5),
            "stretch_max": round(max((s.stretch for s in self.seams), default=0.0), 5),
        }
        if loads:
            block |= {f"{key}_max": max(_load_report(s)[key] for s in loads) for key in _load_report(loads[0])}
        hard = {"hard": sum(bool(s.difficulties) for s in self.seams), "warnings": list(self.warnings)}
        return block | hard | {"seams": [_seam_report(s) for s in self.seams]}


def _seam_report(seam: SeamCheck) -> dict[str, Any]:
    """Return the entry of one seam in the report."""
    return {
        "seam": seam.name,
        "panels": [panel_name(p) for p in seam.panels],
        "joints": seam.joints,
        "lengths_mm": [round(x * 1e3, 3) for x in seam.lengths],
        "mismatch": round(seam.mismatch, 5),
        "stretch": round(seam.stretch, 5),
        **_load_report(seam),
        "hard": list(seam.difficulties),
    }


def _load_report(seam: SeamCheck) -> dict[str, float]:
    """Return force, moment and load of a seam in the report's units; empty if they are unknown."""
    if seam.force is None or seam.moment is None or seam.load is None:
        return {}
    return {"force_n": round(seam.force, 4), "moment_n_mm": round(seam.moment * 1e3, 4), "load": round(seam.load, 4)}


def check_assembly(
    design: SpiralDesign, connections: Connections | None = None, simulation: Simulation | None = None
) -> AssemblyCheck:
    """Predict how hard every seam of a design is to assemble.

    The force that a joint carries in equilibrium is also the force needed to close this joint when all others are
    closed, so it measures how hard the seam is to join. Forces are known only if the simulation used the arm model, and
    its equilibrium has converged and is probably not a false minimum of the energy (``Simulation.is_locked``). Where
    they are unknown, the difference in length between the two sides of the seam's edges is used instead.

    Parameters
    ----------
    design : spirals and flat patches
    connections : connectors, for the width of their necks; None if all arms have plain ends
    simulation : equilibrium, for forces and moments; None if they are unknown
    """
    layout = design.flat.layout
    numbers, lengths = panel_numbers(layout), _lengths(design)
    forces = None if simulation is None else _forces(design, connections, simulation)
    found = []
    for number, edges in enumerate(layout.seams):
        sides, quads = lengths[number], layout.mesh.edge_quads[edges[0]]
        stretch = float((2.0 * np.abs(sides[:, 0] - sides[:, 1]) / sides.sum(axis=1)).max())
        force, moment, load = (None,) * 3 if forces is None else (float(x) for x in forces[edges].max(axis=0))
        hard = {
            "stretch": force is None and stretch > MAX_STRETCH,
            "force": force is not None and force > MAX_HAND_FORCE,
            "load": load is not None and load > MAX_LOAD,
        }
        one, two = (numbers[p] for p in layout.patch_of[quads].tolist())
        whole = float(sides[:, 0].sum()), float(sides[:, 1].sum())
        reasons = tuple(kind for kind, is_so in hard.items() if is_so)
        found.append(SeamCheck(seam_name(number), (one, two), len(edges), whole, stretch, force, moment, load, reasons))
    return AssemblyCheck(tuple(found))


def _lengths(design: SpiralDesign) -> list[np.ndarray]:
    """Return for every seam the flat lengths (N, 2) in metres of its N edges, one column for each side of the seam.

    The first column belongs to the side of the seam where the first quad of its first edge lies.
    """
    layout = design.flat.layout
    mesh, corners = layout.mesh, design.flat.corners
    sides = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)
    found = []
    for edges in layout.seams:
        pair, side = mesh.edge_quads[edges], mesh.edge_sides[edges]
        length = sides[pair, side]
        found.append(np.where(_has_swapped_quads(layout, edges)[:, None], length[:, ::-1], length))
    return found


def _has_swapped_quads(layout: PatchLayout, edges: np.ndarray) -> np.ndarray:
    """Return a mask (N,) of a seam's edges whose first quad lies across the seam from the first quad of the first edge.

    All quads on the same side of a seam traverse its edges in the same direction, which tells the sides apart.
    """
    mesh = layout.mesh
    quad, side = mesh.edge_quads[edges, 0], mesh.edge_sides[edges, 0]
    start, end = mesh.quads[quad, side].tolist(), mesh.quads[quad, (side + 1) % 4].tolist()
    turned = [False]
    for k in range(1, len(edges)):
        # two consecutive edges are traversed in the same direction if one ends where the other starts
        same = end[k - 1] == start[k] or start[k - 1] == end[k]
        turned.append(turned[-1] if same else not turned[-1])
    return np.array(turned)


def _forces(design: SpiralDesign, connections: Connections | None, simulation: Simulation) -> np.ndarray | None:
    """Return (E, 3) for every mesh edge: force (N), moment (N m), stress in the neck as a share of the strength.

    Border edges have 0. Return None if the equilibrium has not converged, if it is probably a false minimum
    (``Simulation.is_locked``), or if the elastic model does not compute forces at joints.
    """
    model, rest = simulation.model, simulation.equilibrium
    if not rest.converged or simulation.is_locked:
        return None
    wrenches = model.wrenches(model.start(rest.pose))
    if wrenches is None:
        return None
    mesh, material, thickness = design.flat.layout.mesh, simulation.material, design.params.thickness
    wrench = np.zeros((len(mesh.edges), 6))
    wrench[~mesh.border] = wrenches[: model.assembly.n_inner_joints]
    force, moment = np.linalg.norm(wrench[:, :3], axis=1), np.linalg.norm(wrench[:, 3:], axis=1)
    stress = joints.list_necks(design, connections).stresses(wrench, thickness)
    return np.column_stack([force, moment, stress / material.strength])
