"""What holds an assembly and what pulls at it: supports, weight, point loads."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from ..errors import FlexMapsError
from ..surface.mesh import QuadMesh

GRAVITY = 9.81  # m / s^2
LOWEST = "lowest"
GROUND = 0.25  # so far above the lowest quad, in median edges, another one still stands on the ground


@dataclass(frozen=True, eq=False)
class Loads:
    """Supports and forces of n spirals.

    fixed : (n, 6) bool, the shifts (3) and turns (3) of every hub that are held
    force : (n, 3) newtons on the hubs, of fixed direction
    """

    fixed: np.ndarray
    force: np.ndarray

    @classmethod
    def of(
        cls,
        size: int,
        *,
        supports: np.ndarray | None = None,
        clamped: bool = True,
        force: np.ndarray | None = None,
        mass: np.ndarray | None = None,
    ) -> Loads:
        """Loads of ``size`` spirals: those in ``supports`` (k,) int are held, their directions too if ``clamped``.

        force : (n, 3) N; mass : (n,) kg, pulled downwards along z if given. Raises FlexMapsError if a support is no spiral.
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

    def held(self, pairs: np.ndarray, centres: np.ndarray) -> np.ndarray:
        """(n, 6) bool: what is fixed while the equilibrium is sought.

        Every piece without supports is held at its middle spiral, which only fixes where it floats. Raises FlexMapsError
        with the faces of such a piece if forces would carry it away or turn it.
        """
        n = len(self.fixed)
        count, piece = connected_components(
            coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(n, n)), directed=False
        )
        held = self.fixed.copy()
        floating = np.bincount(piece, weights=self.fixed[:, 0], minlength=count) == 0
        for k in np.flatnonzero(floating):
            members = np.flatnonzero(piece == k)
            reach = centres[members] - centres[members].mean(axis=0)
            pull, turn = self.force[members].sum(axis=0), np.cross(reach, self.force[members]).sum(axis=0)
            each = np.linalg.norm(self.force[members], axis=1)
            carried = np.linalg.norm(pull) > 1e-9 * each.sum()
            if carried or np.linalg.norm(turn) > 1e-6 * (each * np.linalg.norm(reach, axis=1)).sum():
                raise FlexMapsError(
                    f"Weight or forces {'carry away' if carried else 'turn'} a piece of {len(members)} spirals that nothing "
                    "holds; name supports there or take the forces away",
                    faces=members,
                )
            middle = centres[members].mean(axis=0)
            held[members[np.argmin(np.linalg.norm(centres[members] - middle, axis=1))]] = True
        return held

    def work(self, centres: np.ndarray) -> float:
        """Joules: what the forces do up to here, against the origin."""
        return float((self.force * centres).sum())


def standing(mesh: QuadMesh, which: str | Sequence[int]) -> np.ndarray:
    """(k,) int: the quads that ``which`` names: ``LOWEST``, numbers, or a text such as "1,2,3".

    The lowest ones have two corners, if not more, at the height of the lowest such quad. Raises FlexMapsError where it names no quad of the mesh.
    """
    if isinstance(which, str) and which.strip() == LOWEST:
        second = np.sort(mesh.vertices[mesh.quads, 2], axis=1)[:, 1]
        return np.flatnonzero(second <= second.min() + GROUND * mesh.median_edge)
    try:
        numbers = np.array([int(x) for x in (which.split(",") if isinstance(which, str) else which)], dtype=np.int64)
    except (TypeError, ValueError):
        raise FlexMapsError(
            f"Supports '{which}': give numbers of quads with commas between them, or '{LOWEST}'"
        ) from None
    wrong = numbers[(numbers < 0) | (numbers >= len(mesh.quads))]
    if len(wrong) or not len(numbers):
        name = f"quad {wrong[0]}" if len(wrong) else "no quad"
        raise FlexMapsError(f"The supports name {name}; the quads are numbered from 0 to {len(mesh.quads) - 1}")
    return np.unique(numbers)
