"""Supports and loads of an assembly: held hubs, weight, point forces, springs to fixed places."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from operator import index

import numpy as np

from ..arrays import Bool, Float, Int
from ..errors import FlexMapsError
from ..surface.mesh import QuadMesh
from .assembly import Pose
from .rigid import RigidFreedom, movable_pieces

GRAVITY = 9.81  # gravitational acceleration, m / s^2
LOWEST = "lowest"
# Forces carry a piece away, or turn it, if they do work along a rigid motion that the supports allow. Work up to these
# shares of the largest possible work is treated as zero, for shifts and for turns. Larger values accept loads that do
# carry a piece away; smaller values refuse balanced loads because of rounding errors
CARRY_TOLERANCE, TURN_TOLERANCE = 1e-9, 1e-6
# ``LOWEST`` selects quads as supports up to this height above the lowest quad, in median edge lengths. Larger: more
# supports
GROUND_HEIGHT = 0.25


@dataclass(frozen=True, eq=False)
class Springs:
    """Springs from the centres of all n hubs to fixed places, equally stiff in all directions, without rest length.

    stiffness : of every spring, newtons per metre
    places : (n, 3) fixed ends of the springs, metres
    """

    stiffness: float
    places: Float[np.ndarray, "spirals 3"]

    def force(self, centres: Float[np.ndarray, "spirals 3"]) -> Float[np.ndarray, "spirals 3"]:
        """Return the springs' forces (n, 3) on the hubs, newtons; centres : (n, 3) of the hubs, metres."""
        return self.stiffness * (self.places - centres)

    def energy(self, centres: Float[np.ndarray, "spirals 3"]) -> float:
        """Return the energy of the springs, joules; centres : (n, 3) of the hubs, metres."""
        return 0.5 * self.stiffness * float(((self.places - centres) ** 2).sum())


@dataclass(frozen=True, eq=False)
class Loads:
    """Supports and forces of n spirals.

    fixed : (n, 6) mask of the increments of every hub (three shifts, three turns) that the supports hold
    force : (n, 3) forces on the hubs, in fixed directions, newtons
    springs : from the hubs to fixed places, or None
    """

    fixed: Bool[np.ndarray, "spirals 6"]
    force: Float[np.ndarray, "spirals 3"]
    springs: Springs | None = None

    @classmethod
    def for_spirals(
        cls,
        size: int,
        *,
        supports: Int[np.ndarray, " some"] | None = None,
        clamped: bool = True,
        force: Float[np.ndarray, "spirals 3"] | None = None,
        mass: Float[np.ndarray, " spirals"] | None = None,
    ) -> Loads:
        """Build the loads of ``size`` spirals.

        Parameters
        ----------
        supports : (k,) indices of the supported spirals; None for none
        clamped : the supports also hold rotations, not only positions
        force : (n, 3) forces on the hubs, newtons; default 0
        mass : (n,) masses of the spirals, kg, whose weight along -z is added to the forces; default 0

        Raises
        ------
        FlexMapsError : a support is not a spiral, or the forces are not numbers
        """
        held = np.asarray([] if supports is None else supports, dtype=np.int64)
        if supports is not None and not len(held):
            raise FlexMapsError("The group of the supports holds no spiral; put at least two corners of a quad into it")
        if len(held) and (held.min() < 0 or held.max() >= size):
            raise FlexMapsError(f"The supports name spiral {int(held.max())}, but there are only {size}")
        fixed = np.zeros((size, 6), dtype=bool)
        fixed[held, : 6 if clamped else 3] = True
        total = np.zeros((size, 3)) if force is None else np.array(force, dtype=float)
        if total.shape != (size, 3) or not np.isfinite(total).all():
            raise FlexMapsError("The forces must be three finite numbers for every spiral")
        if mass is not None:
            total[:, 2] -= GRAVITY * np.asarray(mass)
        return cls(fixed, total)

    def held_increments(self, pairs: np.ndarray, centres: np.ndarray) -> Bool[np.ndarray, "spirals 6"]:
        """Return the mask (n, 6) of the increments that are held constant during the search for an equilibrium.

        These are the increments that the supports hold. Where the supports let a connected piece move as a whole,
        enough increments of one of its hubs are added to prevent that (see ``rigid``).

        Parameters
        ----------
        pairs : (m, 2) indices of joined hubs
        centres : (n, 3) of the hubs, metres

        Raises
        ------
        FlexMapsError : forces would carry away or turn a piece; its ``faces`` are the spirals of this piece
        """
        held = self.fixed.copy()
        for free in movable_pieces(self.fixed, joints_between_hubs(pairs, len(held)), centres):
            work, most = free.work(centres, self.force)
            shifts = np.linalg.norm(free.motions[:, 3:], axis=1) == 0.0
            moving = np.abs(work) > np.where(shifts, CARRY_TOLERANCE, TURN_TOLERANCE) * most
            if moving.any():
                raise FlexMapsError(_describe_motion(free, bool(moving[shifts].any())), faces=free.members)
            held[free.hub, free.entries] = True
        return held

    def align(self, pose: Pose, pairs: np.ndarray, target: Pose) -> Pose:
        """Return ``pose`` with every connected piece moved rigidly to lie closest to the pose ``target``.

        A piece is moved only as far as its supports allow.

        Parameters
        ----------
        pose, target : poses of all hubs
        pairs : (m, 2) indices of joined hubs
        """
        for free in movable_pieces(self.fixed, joints_between_hubs(pairs, len(self.fixed)), pose.centres):
            pose = free.align(pose, target.centres)
        return pose

    def work(self, centres: np.ndarray) -> float:
        """Return the work of the forces minus the energy of the springs, joules.

        centres : (n, 3) of the hubs, metres. The work is measured from a pose with all hubs at the origin
        """
        work = float((self.force * centres).sum())
        return work if self.springs is None else work - self.springs.energy(centres)

    def total(self, centres: np.ndarray) -> Float[np.ndarray, "spirals 3"]:
        """Return the forces (n, 3) of loads and springs on the hubs, newtons; centres : (n, 3) of the hubs, metres."""
        return self.force if self.springs is None else self.force + self.springs.force(centres)


def joints_between_hubs(pairs: Int[np.ndarray, "joints 2"], size: int) -> Int[np.ndarray, "_ 2"]:
    """Return those of the joints' pairs that join two hubs, without the pairs that contain a node of the rim.

    Parameters
    ----------
    pairs : (m, 2) indices of joined bodies: hubs, then nodes
    size : number of hubs
    """
    return pairs[(pairs < size).all(axis=1)]


def _describe_motion(free: RigidFreedom, carried: bool) -> str:
    """Return the message to users about forces that move a piece as a whole.

    free : the motions that the supports of the piece allow; carried : the forces shift the piece; else they turn it
    """
    size = len(free.members)
    if free.is_unsupported:
        return (
            f"Weight or forces {'carry away' if carried else 'turn'} a piece of {size} spirals that nothing holds; "
            "name supports there or take the forces away"
        )
    where = "one hinge" if len(free.motions) == 3 else "hinges in a line"
    return (
        f"Weight or forces swing a piece of {size} spirals about its supports, which are {where}; clamp them, name "
        "supports that do not lie in a line, or take the forces away"
    )


def parse_supports(mesh: QuadMesh, which: str | Sequence[int]) -> Int[np.ndarray, " some"]:
    """Return the indices of the quads that a text or a list names as supports.

    The text ``LOWEST`` names the quads with at least two corners near the ground. The height of a quad is that of its
    second lowest corner; quads up to ``GROUND_HEIGHT`` above the smallest height are selected.

    Parameters
    ----------
    mesh : the quads
    which : ``LOWEST``, a list of quad numbers, or a text such as "1,2,3"

    Raises
    ------
    FlexMapsError : ``which`` is empty, contains anything but numbers, or names a quad that the mesh does not have
    """
    if isinstance(which, str) and which.strip() == LOWEST:
        second = np.sort(mesh.vertices[mesh.quads, 2], axis=1)[:, 1]
        return np.flatnonzero(second <= second.min() + GROUND_HEIGHT * mesh.median_edge)
    words = which.split(",") if isinstance(which, str) else list(which)
    try:
        numbers = [_parse_number(word) for word in words]
    except (TypeError, ValueError):
        raise FlexMapsError(
            f"Supports '{which!s:.60}': give numbers of quads with commas between them, or '{LOWEST}'"
        ) from None
    wrong = [number for number in numbers if not 0 <= number < len(mesh.quads)]
    if wrong or not numbers:
        fault = f"Quad {wrong[0]!s:.24} cannot be a support" if wrong else "The list of supports is empty"
        raise FlexMapsError(f"{fault}; give numbers of quads from 0 to {len(mesh.quads) - 1}")
    return np.unique(np.array(numbers, dtype=np.int64))


def _parse_number(word: str | int) -> int:
    """Parse a whole number in the digits 0 to 9, with or without a sign.

    Raises ValueError for other text, TypeError for other types than text and whole numbers.
    """
    if not isinstance(word, str):
        return index(word)
    if not re.fullmatch(r"\s*[+-]?[0-9]+\s*", word):
        raise ValueError(word)
    return int(word)
