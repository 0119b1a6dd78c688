"""Random loads on one spiral, and what is recorded of every equilibrium (FlexMaps section 6.2).

Every sample has a random generator of its own, counted by its number, so that it comes out the same wherever and in
whatever order it is computed.
"""

from __future__ import annotations

import hashlib
import json
import math
from dataclasses import asdict, dataclass
from functools import cache

import numpy as np
from scipy.spatial.transform import Rotation

from ..engine.arrays import Bool, Float, Int
from ..engine.errors import FlexMapsError
from .geometry import Spiral
from .solid import Fineness
from .statics import Model

VERSION = 1  # changes whenever the samples do
LAWS = ("strain", "newton")
POISSON = 0.3  # of FlexMaps section 6.2
YOUNGS = 2.6e9  # Pa, of FlexMaps section 6.2
SEED = 2018  # of all samples
LOADED = (1, 2, 3)  # the tips that are loaded; tip 0 is held


@dataclass(frozen=True)
class Subject:
    """One spiral of the database in metres, as it is cut: width, scale, thickness; twist in radians."""

    scale: float
    width: float
    twist: float
    thickness: float = 0.002
    poisson: float = POISSON
    youngs: float = YOUNGS

    @property
    def spiral(self) -> Spiral:
        return Spiral(round(self.scale / self.width, 12), round(self.thickness / self.width, 12), self.twist)


def subjects(slot: float = 0.0003) -> list[Subject]:
    """The 125 spirals: five scales, widths and twists, the twists spread to the largest that leaves the slot."""
    out = []
    for s in np.linspace(0.010, 0.030, 5):
        for w in np.linspace(0.001, 0.002, 5):
            largest = min(2.0 * math.pi, math.sqrt((0.25 * math.pi * s / (w + slot)) ** 2 - 1.0))
            out += [Subject(round(float(s), 6), round(float(w), 6), round(largest * k / 4.0, 9)) for k in range(5)]
    return out


def fineness_of(spiral: Spiral) -> Fineness:
    """The mesh for the nonlinear samples: finer across stout arms and where narrow slots make the hub bulge."""
    if spiral.scale < 7.4:
        return Fineness(across=4 if spiral.tip_gap < 0.4 else 2)
    return Fineness(across=2 if spiral.scale < 9.0 and spiral.tip_gap < 0.6 else 1)


@cache
def key(subject: Subject, law: str) -> str:
    """Name of a spiral under a load law: changes whenever geometry, discretisation, law or version changes."""
    if law not in LAWS:
        raise FlexMapsError(f"'{law}' is no load law; there are {', '.join(LAWS)}")
    what = {"subject": asdict(subject), "law": law, "version": VERSION, "seed": SEED}
    what["fineness"] = asdict(fineness_of(subject.spiral))
    return hashlib.sha256(json.dumps(what, sort_keys=True).encode()).hexdigest()[:20]


@dataclass(frozen=True, eq=False)
class Samples:
    """n samples, dimensionless: lengths in arm widths, forces in Young's modulus times squared arm width.

    wrenches : dead forces and moments at tips 1-3; centres and turns : positions and rotation vectors of tips 0-3 and the
    hub; strain : 99 % of the volume stays below it; displacement : the largest; clearance : smallest distance between
    neighbouring arms; iterations : Newton steps in all; steps : load steps
    """

    number: Int[np.ndarray, " samples"]
    wrenches: Float[np.ndarray, "samples 3 6"]
    centres: Float[np.ndarray, "samples 5 3"]
    turns: Float[np.ndarray, "samples 5 3"]
    energy: Float[np.ndarray, " samples"]
    strain: Float[np.ndarray, " samples"]
    displacement: Float[np.ndarray, " samples"]
    clearance: Float[np.ndarray, " samples"]
    iterations: Int[np.ndarray, " samples"]
    steps: Int[np.ndarray, " samples"]
    converged: Bool[np.ndarray, " samples"]

    @property
    def rotations(self) -> Float[np.ndarray, "samples 5 3 3"]:
        """The turns as matrices."""
        return Rotation.from_rotvec(self.turns.reshape(-1, 3)).as_matrix().reshape(-1, 5, 3, 3)

    def chosen(self, mask: Bool[np.ndarray, " samples"]) -> Samples:
        return Samples(**{name: value[mask] for name, value in vars(self).items()})

    @classmethod
    def joined(cls, parts: list[Samples]) -> Samples:
        return cls(**{name: np.concatenate([getattr(p, name) for p in parts]) for name in vars(parts[0])})


class Sampler:
    """Draws and solves the samples of one spiral under one law."""

    def __init__(self, subject: Subject, law: str):
        self.subject, self.law, self.key = subject, law, key(subject, law)
        self.model = Model(subject.spiral, subject.poisson, fineness_of(subject.spiral))
        self._unit: np.ndarray | None = None

    def wrenches(self, number: int) -> Float[np.ndarray, "4 6"]:
        """Loads of one sample at tips 0 to 3; tip 0 carries none."""
        words = [int(self.key[i : i + 10], 16) for i in (0, 10)]
        rng = np.random.Generator(np.random.Philox(key=words, counter=[number, 0, 0, 0]))
        out = np.zeros((4, 6))
        if self.law == "newton":
            force = _directions(rng) * rng.uniform(1.0, 5.0, 3)[:, None]
            out[1:, :3] = force / (self.subject.youngs * self.subject.width**2)
            return out
        lever = self.subject.spiral.scale
        out[1:, :3] = _directions(rng) * rng.uniform(0.1, 1.0, 3)[:, None]
        out[1:, 3:] = _directions(rng) * rng.uniform(0.0, 0.3, 3)[:, None] * lever
        reach, strain = rng.uniform(0.02, 0.5) * lever, rng.uniform(0.001, 0.015)
        motion = self._linear(out)
        size = np.linalg.norm(motion, axis=1).max()
        tiny = 1e-7 / size
        peak = self.model.elements.peak_strain(motion * tiny) / tiny
        return out * min(reach / size, strain / peak)

    def _linear(self, wrenches: Float[np.ndarray, "4 6"]) -> Float[np.ndarray, "nodes 3"]:
        """Displacement in the linear limit."""
        if self._unit is None:
            model = self.model
            nodal = np.zeros((len(model.solid.nodes), 3, 18))
            for k in LOADED:
                nodal[model.tips[k].nodes, :, 6 * (k - 1) : 6 * k] = model.tips[k].spread
            self._unit = model.expand(model.rest.solve(model.reduce(nodal)))
        return self._unit @ wrenches[1:].ravel()

    def sample(self, number: int) -> dict[str, np.ndarray | float | int | bool]:
        """One row of ``Samples``."""
        wrenches = self.wrenches(number)
        found = self.model.solve(self.model.loads(wrenches))
        row: dict = {"number": number, "wrenches": wrenches[1:], "iterations": found.iterations, "steps": found.steps}
        row["converged"] = found.converged
        if not found.converged:
            nothing = dict.fromkeys(("energy", "strain", "displacement", "clearance"), np.nan)
            return {**row, **nothing, "centres": np.full((5, 3), np.nan), "turns": np.full((5, 3), np.nan)}
        centres, rotations = self.model.frames(found.displacement)
        return {
            **row,
            "centres": centres,
            "turns": Rotation.from_matrix(rotations).as_rotvec(),
            "energy": found.energy,
            "strain": self.model.elements.peak_strain(found.displacement),
            "displacement": float(np.linalg.norm(found.displacement, axis=1).max()),
            "clearance": self.model.clearance(found.displacement),
        }

    def samples(self, numbers: range) -> Samples:
        rows = [self.sample(n) for n in numbers]
        return Samples(**{name: np.array([row[name] for row in rows]) for name in Samples.__dataclass_fields__})


def _directions(rng: np.random.Generator) -> Float[np.ndarray, "3 3"]:
    """Three unit vectors, evenly distributed over the sphere."""
    v = rng.normal(size=(3, 3))
    return v / np.linalg.norm(v, axis=1, keepdims=True)
