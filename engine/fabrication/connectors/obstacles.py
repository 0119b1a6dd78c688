"""Hubs and arms near the joints at cuts, which connectors must avoid: distances to them, and rays up to them."""

from __future__ import annotations

import numpy as np

from .joined_arms import to_points

_BUNDLES_AT_ONCE = 2500  # bundles of rays traced together; more take more memory


class Obstacles:
    """Hubs and pieces of arms in a common plane where panels do not overlap, with a search tree.

    Hubs count as pieces too.

    rings : (P, K) complex points of the pieces' outlines, metres
    arm : (P,) arm of each piece, 4 quad + side; -1 for hubs
    low, high : (P, 2) corners of the pieces' bounding boxes, metres
    """

    def __init__(self, rings: np.ndarray, arm: np.ndarray):
        import shapely

        self.rings, self.arm = rings, arm
        self.low, self.high = (
            np.stack([f(rings.real, axis=1), f(rings.imag, axis=1)], axis=1) for f in (np.min, np.max)
        )
        self.tree = shapely.STRtree(shapely.box(*self.low.T, *self.high.T))
        # polygons are made on first use: most are never needed
        self._shapes, self._is_made = np.empty(len(rings), dtype=object), np.zeros(len(rings), dtype=bool)

    def _polygons(self, pieces: np.ndarray) -> np.ndarray:
        """Return the polygons of some pieces, made on first use."""
        import shapely

        new = np.unique(pieces[~self._is_made[pieces]])
        self._shapes[new] = shapely.polygons(to_points(self.rings[new]))
        self._is_made[new] = True
        return self._shapes[pieces]

    def are_near(self, shapes: np.ndarray, ignored_arms: np.ndarray, distance: float) -> np.ndarray:
        """Return a mask (N,) of the polygons ``shapes`` that lie less than ``distance`` metres from a piece.

        ignored_arms : (N, 2) two arms for each polygon, whose pieces it may touch
        """
        import shapely

        bounds = shapely.bounds(shapes) + distance * np.array([-1.0, -1.0, 1.0, 1.0])
        shape, piece = self.tree.query(shapely.box(*bounds.T))
        other = (self.arm[piece][:, None] != ignored_arms[shape]).all(axis=1)
        shape, piece = shape[other], piece[other]
        shapely.prepare(shapes)
        found = np.zeros(len(shapes), dtype=bool)
        found[shape[shapely.dwithin(shapes[shape], self._polygons(piece), distance)]] = True
        return found

    def cast_rays(
        self, origin: np.ndarray, direction: np.ndarray, view: np.ndarray, ignored_arms: np.ndarray
    ) -> np.ndarray:
        """Return the distances (N, K) in metres along rays to the first piece; 0 for rays that start inside a piece.

        The K rays of a row share one search for nearby pieces, so their origins should be close together.

        origin, direction : (N, K) complex origins and unit directions of the rays
        view : (N,) distance up to which pieces are found; returned where a ray meets none, metres
        ignored_arms : (N, 2) two arms for each row, whose pieces its rays pass through
        """
        import shapely

        seen = np.repeat(view[:, None].astype(float), origin.shape[1], axis=1)
        for first in range(0, len(origin), _BUNDLES_AT_ONCE):
            part = slice(first, first + _BUNDLES_AT_ONCE)
            start, ends = origin[part], origin[part] + view[part, None] * direction[part]
            low = np.minimum(start.real, ends.real), np.minimum(start.imag, ends.imag)
            high = np.maximum(start.real, ends.real), np.maximum(start.imag, ends.imag)
            around = shapely.box(*(x.min(axis=1) for x in low), *(x.max(axis=1) for x in high))
            row, piece = self.tree.query(around)
            other = (self.arm[piece][:, None] != ignored_arms[part][row]).all(axis=1)
            row, piece = row[other], piece[other]
            meet = np.ones((len(row), origin.shape[1]), dtype=bool)
            for axis in range(2):
                meet &= (low[axis][row] <= self.high[piece, axis, None]) & (
                    high[axis][row] >= self.low[piece, axis, None]
                )
            pair, ray = np.nonzero(meet)
            row, piece = row[pair], piece[pair]
            ring = self.rings[piece]
            along, ahead = np.roll(ring, -1, axis=1) - ring, direction[part][row, ray, None]
            to = ring - start[row, ray, None]
            cross = (ahead.conj() * along).imag
            with np.errstate(divide="ignore", invalid="ignore"):
                far, share = (to.conj() * along).imag / cross, (to.conj() * ahead).imag / cross
            hit = (far >= 0.0) & (share >= 0.0) & (share < 1.0)
            nearest = np.where(hit, far, np.inf).min(axis=1)
            # the ray crosses an odd number of edges: its origin lies inside
            nearest[hit.sum(axis=1) % 2 == 1] = 0.0
            np.minimum.at(seen, (first + row, ray), nearest)
        return seen
