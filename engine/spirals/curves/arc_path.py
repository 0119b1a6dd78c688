"""Curves of straight segments and circular arcs, built point by point."""

from __future__ import annotations

import numpy as np


class ArcPath:
    """Builder of a curve of straight segments and arcs from complex points; consecutive equal points are merged."""

    def __init__(self, start: complex):
        self.points, self.bulges = [complex(start)], [0.0]

    def add_segment(self, place: complex, bulge: float = 0.0) -> None:
        """Add a straight segment or an arc to a point.

        Parameters
        ----------
        place : end of the segment, as a complex number
        bulge : tangent of a quarter of the arc's angle, positive where it turns left; 0 for a straight segment
        """
        if abs(place - self.points[-1]) < 1e-9:
            return
        self.bulges[-1] = float(bulge)
        self.points.append(complex(place))
        self.bulges.append(0.0)

    def arrays(self) -> tuple[np.ndarray, np.ndarray]:
        """Return points (n, 2) and bulges (n,)."""
        points = np.array(self.points)
        return np.stack([points.real, points.imag], axis=1), np.array(self.bulges)
