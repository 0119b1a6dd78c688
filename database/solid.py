"""A structured solid mesh of one spiral: a square hub and four swept arms, in cubic hexahedra.

Every element has three local directions: 0 along the arm, 1 across it, 2 through the sheet, with four nodes each at the
Gauss-Lobatto points. Lengths are in arm widths; the sheet lies at |z| <= height / 2.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from ..engine.arrays import Complex, Float, Int
from ..engine.errors import FlexMapsError
from .geometry import HALF_WIDTH, QUARTER, Outline, Spiral, centre_line, edge, outline

LOBATTO = np.array([0.0, 0.5 - 0.1 * np.sqrt(5.0), 0.5 + 0.1 * np.sqrt(5.0), 1.0])  # nodes of a cubic element on [0, 1]
LOBATTO_WEIGHTS = np.array([1.0, 5.0, 5.0, 1.0]) / 12.0  # of the quadrature there
ARMS = 4  # of a spiral
# elements along an arm without load that stand for all of it: the hub's strains fade within some widths. Compliances of the
# loaded arm stay within 3e-6 of those of the whole spiral, of 27 over the table's region (9e-4 with 3)
STUB = 4


@dataclass(frozen=True)
class Fineness:
    """How fine a spiral is meshed.

    length : longest element along an arm, in arm widths
    turn : most radians that the centre line may turn within an element
    across, through : elements across the width of an arm and through the sheet
    root : share of ``length`` and ``turn`` that holds at the hub, where the stress concentrates
    """

    length: float = 2.5
    turn: float = 0.7
    across: int = 1
    through: int = 1
    root: float = 0.5


COARSE = Fineness()


@dataclass(frozen=True, eq=False)
class Solid:
    """A spiral as a solid.

    nodes : arm widths
    elements : nodes by local direction along, across, through
    tips : the nodes of the four tip faces
    tip_elements : the elements whose last face along is the tip face of arm k
    arm_of : 0-3, and -1 in the hub
    """

    spiral: Spiral
    fineness: Fineness
    nodes: Float[np.ndarray, "nodes 3"]
    elements: Int[np.ndarray, "elements 4 4 4"]
    tips: tuple[Int[np.ndarray, " face"], ...]
    tip_elements: Int[np.ndarray, "4 ends"]
    hub_elements: Int[np.ndarray, " hub"]
    arm_of: Int[np.ndarray, " elements"]

    @property
    def tip_centres(self) -> Float[np.ndarray, "4 3"]:
        """Arm widths: the middle of every tip face."""
        z = self.spiral.radius * QUARTER ** np.arange(ARMS)
        return np.column_stack([z.real, z.imag, np.zeros(ARMS)])


def _stations(spiral: Spiral, start: float, fineness: Fineness) -> Float[np.ndarray, " stations"]:
    """u of the element boundaries from ``start`` to the tip: even in length and turn together, finer at the hub."""
    u = np.linspace(start, 1.0, 400)
    _, tangent, speed = centre_line(spiral, u)
    turning = np.abs(np.gradient(np.unwrap(np.angle(tangent)), u)) if spiral.twist > 0 else np.zeros_like(u)
    travelled = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * np.diff(u))])
    grade = fineness.root + (1.0 - fineness.root) * np.minimum(travelled / fineness.length, 1.0)
    density = np.maximum(speed / fineness.length, turning / fineness.turn) / grade
    count = np.concatenate([[0.0], np.cumsum(0.5 * (density[1:] + density[:-1]) * np.diff(u))])
    pieces = max(2, int(np.ceil(count[-1])))
    return np.interp(np.linspace(0.0, count[-1], pieces + 1), count, u)


@dataclass(frozen=True, eq=False)
class _Rails:
    """The two sides of arm 0 as functions of u, continued around the fillets to the hub's corners."""

    shape: Outline

    @property
    def right_start(self) -> float:
        """u, continued below ``shape.right`` by the length of the half arc, of the hub's corner on the right."""
        return self.shape.right - self._arc(right=True)[0]

    @property
    def left_start(self) -> float:
        """u on the left edge where the arm's first section ends: across from the fillet on its right."""
        right = self.shape.right
        speed = float(centre_line(self.shape.spiral, right)[2])
        return right + min(0.3 / speed, 0.4 * (1.0 - right))

    def _arc(self, right: bool) -> tuple[float, float]:
        """Length of the half arc as a stretch of u, and the u where it ends."""
        shape = self.shape
        u = shape.right if right else shape.left
        points = (shape.right_arc if right else shape.left_arc)(np.linspace(0.0, 1.0, 9))
        return float(np.abs(np.diff(points)).sum() / centre_line(shape.spiral, u)[2]), u

    def left(self, u: np.ndarray) -> np.ndarray:
        length, end = self._arc(right=False)
        arc = self.shape.left_arc(np.clip(1.0 - (end - u) / length, 0.0, 1.0))
        return np.where(u >= end, edge(self.shape.spiral, np.maximum(u, end), HALF_WIDTH), arc)

    def right(self, u: np.ndarray) -> np.ndarray:
        length, end = self._arc(right=True)
        arc = self.shape.right_arc(np.clip(1.0 - (end - u) / length, 0.0, 1.0)) / QUARTER
        return np.where(u >= end, edge(self.shape.spiral, np.maximum(u, end), -HALF_WIDTH), arc)

    @property
    def corner_u(self) -> float:
        """u, continued below ``shape.left``, of the hub's corner on the left."""
        return self.shape.left - self._arc(right=False)[0]


def _arm(rails: _Rails, fineness: Fineness) -> tuple[Complex[np.ndarray, "along 4"], Complex[np.ndarray, "along 4"]]:
    """Left and right sides of arm 0 at the nodes of its elements along."""
    middle = 0.5 * (rails.left_start + rails.right_start)
    skew = 0.5 * (rails.right_start - rails.left_start)
    # the first section is skewed; the skew fades as fast as both sides can still run outwards
    power = max(1.0, min(4.0, 0.6 * (1.0 - middle) / abs(skew)))
    stations = _stations(rails.shape.spiral, middle, fineness)
    u = stations[:-1, None] + np.diff(stations)[:, None] * LOBATTO
    lag = skew * ((1.0 - u) / (1.0 - middle)) ** power
    return rails.left(u - lag), rails.right(u + lag)


def _spoke(shape: Outline, t: np.ndarray) -> np.ndarray:
    """The line from the centre to the hub's corner; it bends so as to meet the fillet from inside, not aslant."""
    corner = shape.corner
    inwards = (shape.centre - corner) / abs(shape.centre - corner)
    arrival = abs(corner) * (0.5 * inwards + 0.5 * corner / abs(corner))
    return corner * (3 * t**2 - 2 * t**3) + corner * (t - 2 * t**2 + t**3) + arrival * (t**3 - t**2)


def _hub_quarter(rails: _Rails, n: int) -> Complex[np.ndarray, "quarter 4 4"]:
    """Nodes of the quarter of the hub that arm 0 leaves from.

    A Coons patch between the centre, the hub's corner on the right, the end of the arm's first section on the left,
    and the hub's corner on the left; direction 0 runs outwards, direction 1 counter-clockwise.
    """
    corner, right = rails.shape.corner, rails.shape.corner / QUARTER
    left = complex(rails.left(np.array(rails.left_start)))
    blocks = []
    for i in range(n):
        for j in range(n):
            x, y = ((i + LOBATTO) / n)[:, None], ((j + LOBATTO) / n)[None, :]
            top = rails.left(rails.corner_u + (rails.left_start - rails.corner_u) * x)
            inner, outer = _spoke(rails.shape, y), right * (1 - y) + left * y
            bilinear = (1 - y) * (right * x) + y * (corner * (1 - x) + left * x)
            blocks.append((1 - y) * _spoke(rails.shape, x) / QUARTER + y * top + (1 - x) * inner + x * outer - bilinear)
    return np.array(blocks)


def _plan(
    spiral: Spiral, fineness: Fineness, whole: int | None
) -> tuple[Complex[np.ndarray, "plan 4 4"], Int[np.ndarray, " plan"]]:
    """Nodes of the plan's elements, along by across, and the arm of each, -1 for the hub; ``whole`` as in ``make_solid``."""
    rails = _Rails(outline(spiral))
    left, right = _arm(rails, fineness)
    n = fineness.across
    shares = [(k + LOBATTO) / n for k in range(n)]
    arm = np.concatenate([right[:, :, None] * (1.0 - share) + left[:, :, None] * share for share in shares])
    hub = _hub_quarter(rails, n)
    stub = arm.reshape(n, -1, 4, 4)[:, :STUB].reshape(-1, 4, 4)
    arms = [arm if whole in (None, k) else stub for k in range(ARMS)]
    turned = [part * QUARTER**k for parts in (arms, ARMS * [hub]) for k, part in enumerate(parts)]
    owner = np.concatenate([np.repeat(np.arange(ARMS), [len(a) for a in arms]), np.full(ARMS * n * n, -1)])
    return np.concatenate(turned), owner


def make_solid(spiral: Spiral, fineness: Fineness = COARSE, whole: int | None = None) -> Solid:
    """Mesh a spiral; raises FlexMapsError where it cannot be cut or its mesh would fold over.

    whole : the only arm that is meshed to its end, ``STUB`` elements of the others; all four if None
    """
    plan, arm_of_plan = _plan(spiral, fineness, whole)
    _refuse_folds(spiral, plan)
    levels = np.unique(((np.arange(fineness.through)[:, None] + LOBATTO) / fineness.through).round(14))
    flat = plan.ravel()
    tree = cKDTree(np.column_stack([flat.real, flat.imag]))
    pairs = tree.query_pairs(1e-9, output_type="ndarray")
    label = np.arange(len(flat))
    # coincident points come in small groups: the smallest index of a pair wins, twice for chains
    for _ in range(3):
        np.minimum.at(label, pairs[:, 1], label[pairs[:, 0]])
        np.minimum.at(label, pairs[:, 0], label[pairs[:, 1]])
    kept, number = np.unique(label, return_inverse=True)
    number = number.reshape(plan.shape)
    depth = len(levels)
    z = spiral.height * (levels - 0.5)
    points = np.column_stack(
        [np.repeat(flat[kept].real, depth), np.repeat(flat[kept].imag, depth), np.tile(z, len(kept))]
    )
    layers = [number[..., None] * depth + 3 * k + np.arange(4) for k in range(fineness.through)]
    elements = np.stack(layers, axis=1).reshape(-1, 4, 4, 4)
    arm_of = np.repeat(arm_of_plan, fineness.through)
    tips, tip_elements = [], []
    for k in range(ARMS):
        last = np.flatnonzero(arm_of_plan == k).reshape(fineness.across, -1)[:, -1]
        own = (last[:, None] * fineness.through + np.arange(fineness.through)).ravel()
        tip_elements.append(own)
        tips.append(np.unique(elements[own][:, 3]))
    return Solid(
        spiral, fineness, points, elements, tuple(tips), np.array(tip_elements), np.flatnonzero(arm_of < 0), arm_of
    )


def _refuse_folds(spiral: Spiral, plan: Complex[np.ndarray, "plan 4 4"]) -> None:
    """Raise FlexMapsError if an element of the plan is folded: its Jacobian must be positive at every node."""
    d = derivative_matrix()
    along = np.einsum("mi,pij->pmj", d, plan)
    across = np.einsum("mj,pij->pim", d, plan)
    jacobian = (np.conj(along) * across).imag
    if jacobian.min() <= 0:
        raise FlexMapsError(
            f"A spiral with s/w = {spiral.scale:.3g} and twist {np.degrees(spiral.twist):.0f} degrees cannot be meshed; "
            "use less twist or a smaller width"
        )


def derivative_matrix() -> Float[np.ndarray, "4 4"]:
    """Derivative of the Lagrange polynomial of Gauss-Lobatto node j at node i, on [0, 1]."""
    return lagrange(LOBATTO)[1]


def lagrange(x: Float[np.ndarray, " points"]) -> tuple[Float[np.ndarray, "points 4"], Float[np.ndarray, "points 4"]]:
    """Values and derivatives at x of the cubic Lagrange polynomials on the Gauss-Lobatto points of [0, 1]."""
    powers = np.linalg.inv(np.vander(LOBATTO, 4, increasing=True))
    x = np.asarray(x, dtype=float)
    values = np.vander(x, 4, increasing=True)
    slopes = np.column_stack([np.zeros_like(x), np.ones_like(x), 2 * x, 3 * x**2])
    return values @ powers, slopes @ powers
