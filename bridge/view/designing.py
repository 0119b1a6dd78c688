"""A design on its way to a better one: the assembled shape with its changing spirals, and how the match improves."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ...engine import colours
from .legend import Legend
from .live_shape import LiveShape, middle_edge

if TYPE_CHECKING:
    from ...engine.optimisation.optimise import Look
    from ...engine.params import SpiralParams

PALE = 0.5 + 0.5 * colours.MUCH  # the dark arms stand out from every colour of the scale
POINTS = 250_000  # so many at most for all arms together, so that large pieces move smoothly too
STEPS = (5, 18)  # least and most pieces of an arm
LIFT = 0.012  # how far the arms float above the faces, in edges


class Designing(LiveShape):
    """What there is to see after a step.

    history : (seconds, RMSE in metres) of this step and all before it
    """

    def __init__(self, look: Look, quads: np.ndarray, params: SpiralParams, history: tuple[tuple[float, float], ...]):
        super().__init__(look.vertices, quads)
        self.history = history
        self._width, self._twist = look.width, look.twist
        self._wind = -look.twist if params.clockwise else look.twist
        self._highest = params.twist_max
        high = f"{np.degrees(params.twist_max):.3g}\N{DEGREE SIGN}"
        title = f"Twist of the spirals; step {len(history) - 1}, RMSE {1e3 * look.rmse:.3g} mm"
        self.legend = Legend(title, "0\N{DEGREE SIGN}", high, PALE)

    @property
    def colours(self) -> np.ndarray:
        # on the scale of everything that the settings allow, so that a colour means the same in every step
        share = np.clip(self._twist / max(self._highest, 1e-9), 0.0, 1.0)
        anchors = np.linspace(0.0, 1.0, len(PALE))
        return np.stack([np.interp(share, anchors, PALE[:, k]) for k in range(3)], axis=1)

    def bands(self, unit: float) -> tuple[np.ndarray, np.ndarray]:
        """The arms as flat bands, (8 F (steps + 1), 3) and (8 F steps, 3): from the joints, wound to the centres.

        As in section 5 of the publication: the distance from the centre falls evenly while the angle grows; what blends
        neighbours at their joints is left out.
        """
        corners, normal = self.frame(unit)
        count = len(corners)
        steps = int(np.clip(POINTS // (8 * max(count, 1)) - 1, *STEPS))
        centre = corners.mean(axis=1)
        out = 0.5 * (corners + np.roll(corners, -1, axis=1)) - centre[:, None]  # (F, 4, 3)
        across = np.cross(normal[:, None], out)
        t = np.linspace(0.0, 1.0, steps + 1)[:, None]
        angle = self._wind[:, None, None, None] * t
        c, s = np.cos(angle), np.sin(angle)
        along = c * out[:, :, None] + s * across[:, :, None]  # (F, 4, steps + 1, 3)
        side = c * across[:, :, None] - s * out[:, :, None]
        line = (1.0 - t) * along
        tangent = -along + (1.0 - t) * self._wind[:, None, None, None] * side
        beside = np.cross(normal[:, None, None], tangent)
        beside /= np.maximum(np.linalg.norm(beside, axis=-1, keepdims=True), 1e-30)
        beside *= (0.5 / unit * self._width)[:, None, None, None]
        points = np.stack([line - beside, line + beside], axis=3)  # (F, 4, steps + 1, 2, 3)
        points += _warped(points.reshape(count, -1, 3), corners, out).reshape(points.shape)
        points += (centre + LIFT * middle_edge(corners) * normal)[:, None, None, None]
        first = np.arange(4 * count)[:, None] * 2 * (steps + 1) + 2 * np.arange(steps)
        one = np.stack([first, first + 1, first + 3], axis=-1)
        two = np.stack([first, first + 3, first + 2], axis=-1)
        return points.reshape(-1, 3).astype(np.float32), np.concatenate([one, two], axis=1).reshape(-1, 3).astype(
            np.int32
        )


def _warped(points: np.ndarray, corners: np.ndarray, out: np.ndarray) -> np.ndarray:
    """(F, N, 3) what brings points of the quads' mean planes, from the middles, onto the four triangles that are drawn."""
    one, two = out[:, 0], out[:, 1]  # to the middles of two sides; those of the others lie opposite
    a, b, c = ((x * y).sum(axis=1)[:, None] for x, y in ((one, one), (one, two), (two, two)))
    along, across = (np.einsum("fnk,fk->fn", points, x) for x in (one, two))
    scale = 1.0 / np.maximum(a * c - b * b, 1e-30)
    u, v = scale * (c * along - b * across), scale * (a * across - b * along)
    warp = 0.25 * (corners[:, 1] + corners[:, 3] - corners[:, 0] - corners[:, 2])
    share = np.minimum(np.abs(u), np.abs(v)) * np.sign(u * v)
    return share[..., None] * warp[:, None]
