"""The order in which the panels are joined: breadth first, so that every step adds one panel to what is there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..fabrication.labels import seam_name
from ..patches.layout import PatchLayout


@dataclass(frozen=True)
class Join:
    """One seam that is closed in a step.

    seam : its index in ``layout.seams``; name : its letters; joints : how many arms meet along it
    panel, other : the patches on its sides; ``panel`` is the one that the step adds
    """

    seam: int
    name: str
    joints: int
    panel: int
    other: int


@dataclass(frozen=True)
class Step:
    """One step: a panel (index of its patch), the seams that are closed, and the panels that are there afterwards."""

    panel: int
    joins: tuple[Join, ...]
    there: tuple[int, ...]


def steps(layout: PatchLayout) -> list[Step]:
    """All steps, one per patch, every body by itself from its largest patch on.

    Of the panels that can come next those nearest to the first one come first, and of these the one with the most joints to
    what is there. Cuts inside a patch, which join it to itself, are closed with it.
    """
    sides = np.array([_sides(layout, edges) for edges in layout.seams], dtype=np.int64).reshape(-1, 2)
    joints = np.array([len(edges) for edges in layout.seams], dtype=np.int64)
    areas = np.bincount(layout.patch_of, weights=layout.mesh.areas)
    depth: dict[int, int] = {}
    found: list[Step] = []
    while len(depth) < len(layout.patches):
        here = _next(sides, joints, depth)
        if here is None:
            here = max((p for p in range(len(areas)) if p not in depth), key=lambda p: (round(float(areas[p]), 12), -p))
            depth[here] = 0
        else:
            depth[here] = 1 + min(depth[q] for q in _beside(sides, here) if q in depth)
        there = set(depth)
        closing = [s for s, (a, b) in enumerate(sides.tolist()) if here in (a, b) and {a, b} <= there]
        joins = tuple(
            Join(s, seam_name(s), int(joints[s]), here, int(sides[s].sum() - here))
            for s in sorted(closing, key=lambda s: (-joints[s], s))
        )
        found.append(Step(here, joins, tuple(sorted(there))))
    return found


def _sides(layout: PatchLayout, edges: np.ndarray) -> list[int]:
    return layout.patch_of[layout.mesh.edge_quads[edges[0]]].tolist()


def _beside(sides: np.ndarray, patch: int) -> list[int]:
    touching = sides[(sides == patch).any(axis=1)]
    return [p for p in np.unique(touching).tolist() if p != patch]


def _next(sides: np.ndarray, joints: np.ndarray, depth: dict[int, int]) -> int | None:
    """The panel that comes next, ``None`` if no other one touches what is there."""
    waiting: dict[int, list[int]] = {}
    for (a, b), count in zip(sides.tolist(), joints.tolist(), strict=True):
        for one, two in ((a, b), (b, a)):
            if one not in depth and two in depth:
                entry = waiting.setdefault(one, [depth[two], 0])
                entry[0], entry[1] = min(entry[0], depth[two]), entry[1] + count
    return min(waiting, key=lambda p: (waiting[p][0], -waiting[p][1], p)) if waiting else None
