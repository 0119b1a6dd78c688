"""Order cuts such that the cutter travels little between them, by the nearest-neighbour heuristic."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...arrays import Float, Int
from ...progress import SILENT, Progress
from ...spirals.curves.arcs import Curve

ORDERING = "the order of the cuts"
# number of nearest nodes that are queried to find the next cut; as long as all of them belong to finished cuts, the
# query is repeated with four times as many. A larger number needs fewer but slower queries
_NEIGHBOURS = 32


@dataclass(frozen=True, eq=False)
class CutGroup:
    """A cut of one or more curves in fixed order, such as the parts of an outline between holding tabs.

    group : number, such as that of a panel; cuts with the same number are made directly one after the other
    is_reversible : whether a single open curve may also be cut from its other end
    """

    curves: tuple[Curve, ...]
    group: int
    is_reversible: bool = False

    @property
    def start_nodes(self) -> Float[np.ndarray, "nodes 2"]:
        """Points (n, 2), metres, at which the cut may begin."""
        first, last = self.curves[0], self.curves[-1]
        if first.closed:
            return first.points
        return np.stack([first.points[0], last.points[-1]]) if self.is_reversible else first.points[:1]

    def starting_at(self, node: int) -> tuple[Curve, ...]:
        """Return the curves, reversed or with nodes renumbered such that cutting begins at ``start_nodes[node]``."""
        first = self.curves[0]
        if first.closed:
            return (Curve(np.roll(first.points, -node, axis=0), np.roll(first.bulge, -node)),)
        return (first.reversed(),) if node else self.curves


class _Tour:
    """Tour of the cutter: the order of the cuts, and the node at which each begins."""

    def __init__(self, cuts: Sequence[CutGroup], begin: complex, progress: Progress):
        self.cuts, self.begin = cuts, begin
        self.nodes = [c.start_nodes @ np.array([1.0, 1.0j]) for c in progress.each(cuts, ORDERING)]
        # used for open cuts only: a closed cut ends at the node where it begins
        self.end_points = [complex(*c.curves[-1].points[-1]) for c in cuts]
        self.is_closed = np.array([c.curves[0].closed for c in cuts])
        self.order: Int[np.ndarray, " cuts"] = np.arange(len(cuts))
        self.node = np.zeros(len(cuts), dtype=int)

    def starts_and_ends(self, which: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the complex points at which the cuts with indices ``which`` start and end."""
        start = np.array([self.nodes[i][self.node[i]] for i in which.tolist()])
        far = [
            self.nodes[i][1 - self.node[i]] if self.cuts[i].is_reversible else self.end_points[i]
            for i in which.tolist()
        ]
        return start, np.where(self.is_closed[which], start, far)

    def order_by_nearest(self, progress: Progress) -> None:
        """Order the cuts: after each, go to the nearest remaining cut of the same group, or else of any group."""
        from scipy.spatial import cKDTree

        points = np.concatenate(self.nodes)
        owner = np.repeat(np.arange(len(self.cuts)), [len(n) for n in self.nodes])
        place = np.concatenate([np.arange(len(n)) for n in self.nodes])
        group = np.unique([c.group for c in self.cuts], return_inverse=True)[1]
        by_group = np.argsort(group[owner], kind="stable")
        first = np.searchsorted(group[owner][by_group], np.arange(group.max() + 2))
        left, here, order = np.ones(len(self.cuts), dtype=bool), self.begin, []
        alive, now = np.arange(len(points)), -1
        tree = cKDTree(np.column_stack([points.real, points.imag]))
        for _ in progress.each(self.cuts, ORDERING):
            own = by_group[first[now] : first[now + 1]] if now >= 0 else alive[:0]
            own = own[left[owner[own]]]
            if len(own):
                found = int(own[np.argmin(np.abs(points[own] - here))])
            else:
                # rebuild the tree when most nodes belong to finished cuts
                if left[owner[alive]].sum() < 0.5 * len(alive):
                    alive = alive[left[owner[alive]]]
                    tree = cKDTree(np.column_stack([points[alive].real, points[alive].imag]))
                found, count = -1, _NEIGHBOURS
                while found < 0:
                    near = np.atleast_1d(tree.query([here.real, here.imag], min(count, len(alive)))[1])
                    free = alive[near][left[owner[alive[near]]]]
                    found, count = int(free[0]) if len(free) else -1, 4 * count
            cut = int(owner[found])
            self.node[cut], left[cut], now = place[found], False, int(group[cut])
            order.append(cut)
            here = complex(self.starts_and_ends(np.array([cut]))[1][0])
        self.order = np.array(order)

    def choose_start_nodes(self, progress: Progress) -> None:
        """Begin every closed cut at the node with the least travel from the previous cut and to the next."""
        start, end = self.starts_and_ends(self.order)
        for k in progress.each(range(len(self.order)), ORDERING):
            i = int(self.order[k])
            if not self.is_closed[i]:
                continue
            before = end[k - 1] if k else self.begin
            way = np.abs(self.nodes[i] - before)
            if k + 1 < len(self.order):
                way = way + np.abs(self.nodes[i] - start[k + 1])
            self.node[i] = int(np.argmin(way))
            start[k] = end[k] = self.nodes[i][self.node[i]]


def order_cuts(
    cuts: Sequence[CutGroup], begin: complex = 0.0, progress: Progress = SILENT
) -> tuple[tuple[Curve, ...], complex]:
    """Return the curves of some cuts in an order with little travel, and the point at which the last curve ends.

    Points are x + iy in metres.

    Parameters
    ----------
    cuts : cuts to order
    begin : point at which the cutter starts
    progress : called with the fraction done; may cancel
    """
    if not cuts:
        return (), begin
    tour = _Tour(cuts, begin, progress.part(0.0, 0.1))
    tour.order_by_nearest(progress.part(0.1, 0.8))
    tour.choose_start_nodes(progress.part(0.8, 1.0))
    ordered = progress.part(1.0, 1.0).each(tour.order.tolist(), ORDERING)
    curves = tuple(c for i in ordered for c in cuts[i].starting_at(int(tour.node[i])))
    return curves, complex(tour.starts_and_ends(tour.order[-1:])[1][0])
