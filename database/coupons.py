"""The strip and the spirals of the calibration sheet as solids, to check the formulas that their measurements are read by.

As they are held on the bench: every node of the clamped faces stays where it is, the strip is loaded over its end's face and by its
own weight, the spiral over its hub. Young's modulus is 1 and lengths are in widths, as everywhere in here.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..engine.arrays import Float, Int
from ..engine.extras.calibrating.bending import fillet_radius
from ..engine.extras.calibrating.coupons import GRAVITY, Coupons, SpiralCoupon
from ..engine.linalg import SparseCholesky, SparsityPattern
from .elastic import Elements, lower_entries
from .geometry import Spiral
from .solid import LOBATTO, Fineness, make_solid
from .statics import Model

FINE = Fineness(length=1.5, turn=0.4)  # half of the usual lengths changes the sag of a spiral by 2 in 1,000


@dataclass(frozen=True, eq=False)
class _Nodes:
    """What ``Model`` asks of a solid when it solves."""

    nodes: Float[np.ndarray, "nodes 3"]


class Held(Model):
    """A solid some of whose nodes stay where they are."""

    def __init__(self, nodes: np.ndarray, elements: np.ndarray, poisson: float, held: Int[np.ndarray, " held"]):
        self.solid = _Nodes(nodes)  # type: ignore[assignment]
        self.elements = Elements(nodes, elements, poisson)
        self._free = np.setdiff1d(np.arange(3 * len(nodes)), (3 * held[:, None] + np.arange(3)).ravel())
        self.size = len(self._free)
        number = np.full(3 * len(nodes), self.size)
        number[self._free] = np.arange(self.size)
        # what is held gets a number that is none, and its entries are left out
        rows, cols = lower_entries(number[3 * self.elements.index[..., None] + np.arange(3)])
        self._kept = (rows < self.size) & (cols < self.size)
        self.pattern = SparsityPattern(rows[self._kept], cols[self._kept], self.size)
        self.cholesky = SparseCholesky(self.pattern)

    def expand(self, q: Float[np.ndarray, " size *columns"]) -> Float[np.ndarray, "nodes 3 *columns"]:
        full = np.zeros((3 * len(self.solid.nodes), *q.shape[1:]))
        full[self._free] = q
        return full.reshape(len(self.solid.nodes), 3, *q.shape[1:])

    def reduce(self, nodal: Float[np.ndarray, "nodes 3 *columns"]) -> Float[np.ndarray, " size *columns"]:
        return nodal.reshape(3 * len(self.solid.nodes), *nodal.shape[2:])[self._free]

    def stiffness(self, f: np.ndarray, stress: np.ndarray) -> Float[np.ndarray, " entries"]:
        return self.pattern.sum(self.elements.tangents(f, stress).ravel()[self._kept])


def strip_sag(made: Coupons, youngs: float, load: float, pieces: int = 16) -> float:
    """Metres that the strip's end sinks as ``load`` kg is hung on it, by the solid; as ``bending.strip_sag``."""
    unit = made.strip_width
    long, high = made.strip_length / unit, made.thickness / unit
    axes = [np.unique(np.concatenate([(k + LOBATTO) / n for k in range(n)]).round(14)) for n in (pieces, 2, 1)]
    x, y, z = np.meshgrid(axes[0] * long, axes[1] - 0.5, (axes[2] - 0.5) * high, indexing="ij")
    nodes = np.stack([x, y, z], axis=-1).reshape(-1, 3)
    number = np.arange(len(nodes)).reshape(x.shape)
    elements = np.array([number[3 * i : 3 * i + 4, 3 * j : 3 * j + 4, :] for i in range(pieces) for j in range(2)])
    model = Held(nodes, elements, made.poisson, number[0].ravel())
    own = np.zeros(len(nodes))
    np.add.at(own, model.elements.index, model.elements.node_volumes)
    end = number[-1].ravel()
    face = own[end] / own[end].sum()
    weight = made.density * GRAVITY * unit / youngs * own  # of the nodes, in E w^2
    forces = np.zeros((2, len(nodes), 3))
    forces[:, :, 2] = -weight
    forces[1, end, 2] -= load * GRAVITY / (youngs * unit**2) * face
    before, after = (float(face @ model.solve(force).displacement[end, 2]) for force in forces)
    return (before - after) * unit


def spiral_sag(made: Coupons, one: SpiralCoupon, youngs: float, load: float, fineness: Fineness = FINE) -> float:
    """Metres that a spiral's hub sinks under ``load`` kg, all nodes of its arms' ends held, by the solid."""
    unit = one.width
    solid = make_solid(
        Spiral(one.scale / unit, made.thickness / unit, one.twist, fillet_radius(made, one.width) / unit), fineness
    )
    model = Held(solid.nodes, solid.elements, made.poisson, np.unique(np.concatenate(solid.tips)))
    own = np.zeros(len(solid.nodes))
    np.add.at(own, model.elements.index[solid.hub_elements], model.elements.node_volumes[solid.hub_elements])
    share = own / own.sum()
    forces = np.zeros_like(solid.nodes)
    forces[:, 2] = -load * GRAVITY / (youngs * unit**2) * share
    found = model.solve(forces)
    return -float(share @ found.displacement[:, 2]) * unit
