"""Order in which panels are assembled: breadth first, so that every step joins one panel to the joined panels."""

from __future__ import annotations

from bisect import insort
from dataclasses import dataclass
from functools import lru_cache
from heapq import heappop, heappush

import numpy as np

from .layout import PatchLayout


@dataclass(frozen=True)
class SeamJoin:
    """A seam that is closed in a step of the assembly.

    seam : index in ``layout.seams``
    joints : number of joints along the seam
    panel, other : patches on both sides of the seam; ``panel`` is added in this step
    """

    seam: int
    joints: int
    panel: int
    other: int


@dataclass(frozen=True)
class AssemblyStep:
    """A step of the assembly: the added panel, the closed seams, and all panels joined afterwards (patch indices)."""

    panel: int
    joins: tuple[SeamJoin, ...]
    joined_panels: tuple[int, ...]


def assembly_steps(layout: PatchLayout) -> list[AssemblyStep]:
    """Return all steps of the assembly, one per patch, body by body, beginning at the largest patch of each body.

    The next panel is the panel with the fewest seams between it and the first panel; among equals, the panel with the
    most joints to the joined panels. Cuts inside a patch are closed when its panel is added.
    """
    sides = [tuple(layout.patch_of[layout.mesh.edge_quads[edges[0]]].tolist()) for edges in layout.seams]
    joints = [len(edges) for edges in layout.seams]
    areas = np.bincount(layout.patch_of, weights=layout.mesh.areas)
    seams_of: list[list[int]] = [[] for _ in layout.patches]
    for seam, ends in enumerate(sides):
        for patch in set(ends):
            seams_of[patch].append(seam)
    first = iter(sorted(range(len(areas)), key=lambda p: (-round(float(areas[p]), 12), p)))
    depth: dict[int, int] = {}
    there: list[int] = []
    # Candidates: smallest depth (number of seams from the first panel) of a joined neighbour, minus the number of joints
    # to joined panels, and patch. A panel may have several entries; its latest entry is its best.
    waiting: list[tuple[int, int, int]] = []
    known: dict[int, tuple[int, int]] = {}
    found: list[AssemblyStep] = []
    while len(depth) < len(layout.patches):
        while waiting and waiting[0][2] in depth:
            heappop(waiting)
        if waiting:
            nearest, _, here = heappop(waiting)
            depth[here] = 1 + nearest
        else:
            here = next(p for p in first if p not in depth)
            depth[here] = 0
        insort(there, here)
        closing = []
        for seam in seams_of[here]:
            one, two = sides[seam]
            other = one + two - here
            if other in depth:
                closing.append(seam)
            else:
                nearest, fewer = known.get(other, (depth[here], 0))
                known[other] = min(nearest, depth[here]), fewer - joints[seam]
                heappush(waiting, (*known[other], other))
        joins = tuple(
            SeamJoin(s, joints[s], here, sum(sides[s]) - here) for s in sorted(closing, key=lambda s: (-joints[s], s))
        )
        found.append(AssemblyStep(here, joins, tuple(there)))
    return found


@lru_cache(maxsize=4)
def panel_numbers(layout: PatchLayout) -> tuple[int, ...]:
    """Return the panel number of every patch, from 1 in the order of assembly."""
    numbers = [0] * len(layout.patches)
    for number, step in enumerate(assembly_steps(layout), start=1):
        numbers[step.panel] = number
    return tuple(numbers)
