"""Single arms of designs: the compliance of the arm that is cut against that of the elastic model.

What an arm stores under a wrench depends on its own width and twist, on the widths of its neighbours, which put its root, on the
fillets, and on the arm beyond the joint, which bends and widens its end.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ..engine.arrays import Float
from ..engine.mechanics.arms.model import ArmModel
from ..engine.mechanics.assembly import Pose, assembly_from_design
from ..engine.spirals.design import SpiralDesign
from .design_mesh import UNIT
from .design_solid import DesignSolid, Loaded
from .solid import LOBATTO_WEIGHTS
from .statics import Group
from .validation_cases import MATERIAL, USUAL, WIDE, Resolution, cells, sheet

WRENCHES = 1000  # random ones, on which the energies of an arm are compared
LEVER = 0.005  # metres: the moments of a wrench are those of its forces at this distance, half an arm's length


def solid_compliances(design: SpiralDesign, resolution: Resolution = USUAL) -> Float[np.ndarray, "joints 2 6 6"]:
    """SI: motion of every arm's end at a joint against its hub per wrench there, in the linear limit of the arms that are cut.

    Axes along the radius to the joint, to the left of it in the sheet, normal to the sheet; shifts first, turns last.
    """
    count = len(design.twist)
    solid = DesignSolid(design, MATERIAL.poisson, list(range(count)), resolution, joined=False)
    rest = Pose(np.zeros((count, 3)), np.tile(np.eye(3), (count, 1, 1)))
    still = np.zeros_like(solid.mesh.nodes)
    problem = Loaded(solid, *solid.constraints(rest.centres, rest.rotations), still)
    problem.factor(problem.expand(problem.start(solid.mesh.nodes.copy())), 0.0, 0.0)
    pulls = np.zeros((solid.size, *solid.pairs.shape, 6))
    own = solid.mesh.numbering.hub_size + np.arange(solid.tips.size).reshape(solid.tips.shape)
    weights = _face(resolution.across)
    for e, j in np.ndindex(solid.pairs.shape):
        spiral, arm, out = solid.pairs[e, j], solid.sides[e, j], solid.lever[e, j] / np.linalg.norm(solid.lever[e, j])
        face = Group.of(solid.mesh.nodes[spiral], solid.tips[arm], weights)
        axes = np.column_stack([out, [-out[1], out[0], 0.0], [0.0, 0.0, 1.0]])
        dofs = 3 * solid.number[spiral, own[arm]][:, None] + np.arange(3)
        pulls[dofs, e, j] = face.spread @ np.kron(np.eye(2), axes)
    rows = pulls.reshape(solid.size, -1)
    moved = solid.cholesky.solve(np.column_stack([rows, problem.functionals]))
    free, held = np.split(moved, [rows.shape[1]], axis=1)
    free -= held @ np.linalg.solve(problem.functionals.T @ held, problem.functionals.T @ free)
    found = np.einsum("sejk,sejl->ejkl", pulls, free.reshape(pulls.shape))
    motion, wrench = np.repeat([UNIT, 1.0], 3), MATERIAL.youngs * np.repeat([UNIT**2, UNIT**3], 3)
    return found * motion[:, None] / wrench


def _face(across: int) -> Float[np.ndarray, " face"]:
    """Share of an arm's end that every node stands for."""
    out = np.zeros(3 * across + 1)
    for j in range(across):
        out[3 * j : 3 * j + 4] += LOBATTO_WEIGHTS / across
    return np.outer(out, LOBATTO_WEIGHTS).ravel()


def model_compliances(design: SpiralDesign) -> Float[np.ndarray, "joints 2 6 6"]:
    """The same of the default elastic model."""
    return ArmModel.from_assembly(assembly_from_design(design), MATERIAL, curving=False, slopes=False).compliance.values


def excess(solid: np.ndarray, model: np.ndarray) -> Float[np.ndarray, "joints 2 wrenches"]:
    """By what share of the model's energy the solid's is larger, under random wrenches."""
    wrenches = np.random.default_rng(0).normal(size=(WRENCHES, 6)) * np.repeat([1.0, LEVER], 3)
    stored = [np.einsum("wk,ejkl,wl->ejw", wrenches, one, wrenches) for one in (solid, model)]
    return stored[0] / stored[1] - 1.0


def designs() -> dict[str, tuple[SpiralDesign, Resolution]]:
    """Pieces whose arms are compared: neighbours all alike but for the widths within a spiral, then unlike neighbours."""
    out = {}
    for twist in (0.0, 90.0, 200.0, 300.0):
        for name, width in (
            ("1111", [1, 1, 1, 1]),
            ("2222", [2, 2, 2, 2]),
            ("1212", [1, 2, 1, 2]),
            ("2211", [2, 2, 1, 1]),
        ):
            out[f"{name} {twist:.0f}"] = (
                sheet(2, 2, np.tile(np.array(width, dtype=float), (4, 1)), twist),
                WIDE if twist > 200.0 else USUAL,
            )
    chess = cells(2, 2).sum(axis=1) % 2
    out["widths 1 and 2, 180"] = sheet(2, 2, 1.0 + chess, 180.0), USUAL
    out["twists 0 and 330"] = sheet(2, 2, 1.5, 330.0 * chess), USUAL
    out["2, 0 beside 1, 330"] = sheet(2, 2, 2.0 - chess, 330.0 * chess), USUAL
    out["oblong"] = sheet(2, 2, 1.2, 110.0, sides=(0.024, 0.016), angle=75.0), USUAL
    return out


def compare_arms() -> list[dict[str, Any]]:
    """One row for every kind of arm of every design: percent of energy, median and the middle nine tenths."""
    rows = []
    for name, (design, resolution) in designs().items():
        parts, shown = assembly_from_design(design), set()
        share = 100.0 * excess(solid_compliances(design, resolution), model_compliances(design))
        for e, j in np.ndindex(parts.pairs.shape):
            spiral, side = parts.pairs[e, j], parts.sides[e, j]
            # its own width and those of the arms before and after it, in millimetres
            widths = tuple((1e3 * np.roll(design.width[spiral], 1 - side)[[1, 0, 2]]).round(6).tolist())
            radius, twist = round(1e3 * parts.radius[e, j], 6), round(np.degrees(design.twist[spiral]), 6)
            if (widths, radius, twist) in shown:
                continue
            shown.add((widths, radius, twist))
            low, middle, high = np.percentile(share[e, j], [5, 50, 95])
            named = {"design": name, "widths_mm": widths, "twist_deg": twist, "radius_mm": radius}
            rows.append({**named, "median": middle, "low": low, "high": high})
    return rows


def line(row: dict[str, Any]) -> str:
    """One row of ``compare_arms`` for people."""
    return (
        f"{row['design']:20s} arm of {row['widths_mm'][0]:g} mm between {row['widths_mm'][1]:g} and {row['widths_mm'][2]:g}, twist "
        f"{row['twist_deg']:3.0f}, radius {row['radius_mm']:4.1f} mm: energy of the solid {row['median']:+5.1f} % ({row['low']:+.1f}, {row['high']:+.1f})"
    )
