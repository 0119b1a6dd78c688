"""The assemblies on which the coarse models are compared with full solids: spirals, supports, loads.

All spirals have a scale of 20 mm and are cut from 2 mm of a material with E = 2.6 GPa and a Poisson's ratio of 0.3.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from functools import cached_property

import numpy as np
from scipy.spatial.transform import Rotation

from ..engine.arrays import Float, Int
from .assemblies import ARMS, Plan, box, direction, dome, grid
from .assembly_solid import joint_turn
from .geometry import Spiral
from .solid import COARSE, Fineness

SCALE, THICKNESS, YOUNGS, POISSON = 0.020, 0.002, 2.6e9, 0.3  # m, m, Pa and none, of all cases
# the mesh on which the stiffness table is made; assemblies of more than a few spirals take ``COARSE``
FINE = Fineness(length=2.5, turn=0.7, across=2, through=1, root=0.4)


@dataclass(frozen=True)
class Design:
    """One kind of spiral: width in metres, twist in degrees."""

    width: float
    twist: float

    @property
    def spiral(self) -> Spiral:
        return Spiral(round(SCALE / self.width, 12), round(THICKNESS / self.width, 12), math.radians(self.twist))


@dataclass(frozen=True)
class Held:
    """A hub that is held: shift (m) and turn (rotation vector, rad) from its place at rest; ``shift`` None leaves it free to shift."""

    spiral: int
    turn: tuple[float, float, float] = (0.0, 0.0, 0.0)
    shift: tuple[float, float, float] | None = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Loading:
    """One state of a case: held hubs (none for a free body) and dead forces (N) on hubs."""

    name: str
    held: tuple[Held, ...] = ()
    forces: tuple[tuple[int, tuple[float, float, float]], ...] = ()


@dataclass(frozen=True)
class Case:
    """An assembly with the states in which it is solved.

    name : of its file; shape : "grid", "dome" or "box"; size : columns and rows of a grid, or spirals along the side of a
    square patch; designs : one, or two that alternate like the fields of a chess board; fine : the finer mesh
    """

    name: str
    shape: str
    size: tuple[int, int]
    designs: tuple[Design, ...]
    loadings: tuple[Loading, ...]
    fine: bool = False

    @property
    def fineness(self) -> Fineness:
        return FINE if self.fine else COARSE

    @cached_property
    def plan(self) -> Plan:
        return {"grid": lambda: grid(*self.size), "dome": lambda: dome(self.size[0]), "box": lambda: box(self.size[0])}[
            self.shape
        ]()

    @cached_property
    def of(self) -> Int[np.ndarray, " spirals"]:
        """The design of every spiral."""
        return self.plan.cells.sum(axis=1) % len(self.designs)

    def identity(self) -> dict:
        """What the results depend on, for their file's header."""
        return {**asdict(self), "fineness": asdict(self.fineness), "scale": SCALE, "thickness": THICKNESS}

    @cached_property
    def rest(self) -> tuple[Float[np.ndarray, "spirals 3"], Float[np.ndarray, "spirals 3 3"]]:
        """Places (metres) and rotations of the hubs while no arm is bent, except at the seams of a dome or a box.

        Tips of unlike twists lean differently, so that neighbours turn in the plane against each other.
        """
        lean = np.array([math.atan(math.radians(d.twist)) for d in self.designs])
        angle = lean - lean.mean()
        plane = Rotation.from_rotvec(angle[self.of][:, None] * [0.0, 0.0, 1.0]).as_matrix()
        step = 0.5 * SCALE * np.exp(1j * angle).sum() * (2.0 / len(self.designs))
        place = (self.plan.cells @ [1.0, 1j]) * step
        flat = np.column_stack([place.real, place.imag, np.zeros(len(place))])
        if self.shape == "grid":
            return flat, plane
        frames, origins = _faces(self.shape, self.size[0])
        patch = self.plan.patch
        return origins[patch] + np.einsum("nij,nj->ni", frames[patch], flat), frames[patch] @ plane

    def joints(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """pairs (m, 2), lever (m, 2, 3) metres and axes (m, 2, 3, 3) as ``engine.mechanics.assembly.Assembly`` wants them."""
        plan, spirals = self.plan, [d.spiral for d in self.designs]
        lever, axes = np.zeros((len(plan.pairs), 2, 3)), np.zeros((len(plan.pairs), 2, 3, 3))
        lever[..., :2] = 0.5 * SCALE * direction(plan.arms)
        for e, ((a, b), (k, l)) in enumerate(zip(plan.pairs, plan.arms)):
            out = np.append(direction(k), 0.0)
            axes[e, 0] = np.column_stack([out, np.cross([0.0, 0.0, 1.0], out), [0.0, 0.0, 1.0]])
            axes[e, 1] = joint_turn(spirals[self.of[a]], k, spirals[self.of[b]], l) @ axes[e, 0]
        return plan.pairs, lever, axes


def _faces(shape: str, n: int) -> tuple[Float[np.ndarray, "patches 3 3"], Float[np.ndarray, "patches 3"]]:
    """Frames of the patches as faces of a cube, and the places of their first spirals, in metres."""
    x, y, z = np.eye(3)
    if shape == "dome":
        # the corner of the cube is every patch's north-west; patch p's north side is patch p + 1's west side
        edges = [x, z, y]
        columns = [(edges[p], -edges[p - 1]) for p in range(3)]
        corners = [-n * north for _, north in columns]
    else:
        outward = [np.append(direction(k), 0.0) for k in range(ARMS)]
        # the south side of a wall runs against the floor's side, so it begins where that ends
        columns = [(x, y)] + [(-np.cross(z, out), z) for out in outward]
        corners = [np.zeros(3)] + [0.5 * n * (x + y + out + np.cross(z, out)) for out in outward]
    frames = np.array([np.column_stack([east, north, np.cross(east, north)]) for east, north in columns])
    middles = [corner + 0.5 * (east + north) for corner, (east, north) in zip(corners, columns)]
    return frames, SCALE * np.array(middles)


# per twist in degrees, what share of the forces bends the spirals about as far
SOFTNESS = {0.0: 1.0, 180.0: 0.4, 300.0: 0.25}
WIDTH, STOUT = 0.0015, 0.002  # metres, of the arms
HOME = Held(0)  # the first hub, held where it lies


def cases() -> list[Case]:
    """All cases, the small ones first."""
    out = []
    for twist, share in SOFTNESS.items():
        chosen, name = (Design(WIDTH, twist),), f"{twist:03.0f}"
        out += [
            Case(f"pair-{name}", "grid", (2, 1), chosen, _of_pair(share), fine=True),
            Case(f"grid3-{name}", "grid", (3, 3), chosen, _of_patch(3, share), fine=True),
            Case(f"grid6-{name}", "grid", (6, 6), chosen, _of_patch(6, 0.4 * share)),
            Case(f"dome-{name}", "dome", (3, 3), chosen, (Loading("free"),)),
        ]
        if twist:
            out.append(Case(f"box-{name}", "box", (3, 3), chosen, (Loading("free"),)))
    for first, second in ((0.0, 180.0), (90.0, 300.0)):
        both, name = (Design(WIDTH, first), Design(WIDTH, second)), f"{first:03.0f}-{second:03.0f}"
        out += [
            Case(f"pair-{name}", "grid", (2, 1), both, _of_pair(0.4), fine=True),
            Case(f"grid3-{name}", "grid", (3, 3), both, _of_patch(3, 0.4), fine=True),
        ]
    for twist in (0.0, 150.0):
        chosen, name = (Design(STOUT, twist),), f"stout-{twist:03.0f}"
        out.append(Case(f"grid3-{name}", "grid", (3, 3), chosen, _of_patch(3, 0.8 if twist else 1.5), fine=True))
        out.append(Case(f"dome-{name}", "dome", (3, 3), chosen, (Loading("free"),), fine=True))
    return sorted(out, key=lambda case: case.plan.count)


def _of_pair(share: float) -> tuple[Loading, ...]:
    """The second of two spirals pulled or turned, the first one clamped."""
    forces = {"up": (0.0, 0.0, 5.0), "aside": (0.0, 4.0, 0.0), "apart": (12.0, 0.0, 0.0)}
    turns = {"bend": (0.0, -0.6, 0.0), "sway": (0.0, 0.0, 0.6), "twist": (0.6, 0.0, 0.0), "all": (0.5, -0.7, 0.5)}
    out = [Loading(name, (HOME,), (_pull(1, *(share * f for f in force)),)) for name, force in forces.items()]
    out += [Loading(name, (HOME, Held(1, turn, None))) for name, turn in turns.items()]
    mixed = _pull(1, 1.0 * share, -1.0 * share, 2.0 * share)
    return (*out, Loading("mixed", (HOME, Held(1, (0.3, -0.3, 0.2), None)), (mixed,)))


def _of_patch(n: int, share: float) -> tuple[Loading, ...]:
    """A square patch of n x n spirals: clamped at a corner or a side, or free, and pulled at corners or the other side."""
    east, north, far = n - 1, n * (n - 1), n * n - 1
    up = 2.0 * share
    side = tuple(Held(n * row) for row in range(n))
    lift = tuple(_pull(n * row + east, 0.0, 0.0, up) for row in range(n))
    saddle = ((0, up), (east, -up), (far, up), (north, -up))
    return (
        Loading("corner", (HOME,), (_pull(far, 0.0, 0.0, up),)),
        Loading("wring", side, (_pull(east, 0.0, 0.0, 2.0 * up), _pull(far, 0.0, 0.0, -2.0 * up))),
        Loading("cantilever", side, lift),
        Loading("saddle", (), tuple(_pull(spiral, 0.0, 0.0, 2.0 * force) for spiral, force in saddle)),
        Loading("mixed", (HOME,), (_pull(far, 2.0 * up, -1.0 * up, up), _pull(east, 0.0, up, -0.5 * up))),
    )


def _pull(spiral: int, *force: float) -> tuple[int, tuple[float, float, float]]:
    return spiral, (force[0], force[1], force[2])
