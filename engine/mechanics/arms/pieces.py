"""Flexibility of the pieces of arms, one constant strain each (Castigliano's beam, as in ``beams``)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...arrays import Float
from ...materials import Orthotropy
from ..vectors import skew
from .beams import SHEAR_FACTOR, torsion_constant
from .grain import SectionFlexibility

# Pieces of an arm, each with one constant strain; more are slower. On a dome, a saddle and a torus, positions differ by 3e-4
# of an edge from the result of 64 pieces, with 8 pieces by 1e-3.
STATIONS = 16
POISSON = 0.35  # without a material; 0.25 and 0.45 move positions by 8e-4 of an edge, on a dome and a torus


@dataclass(frozen=True)
class Grain:
    """The grain of a sheet.

    known : moduli, Pa; angle : radians from the x axes of the flat frames; unit : Pa, the result is for moduli divided
        by it
    """

    known: Orthotropy
    angle: float
    unit: float

    def yields(
        self, tangent: np.ndarray, width: np.ndarray, height: float
    ) -> tuple[Float[np.ndarray, "arms stations 3 3"], Float[np.ndarray, "arms stations 3 3"]]:
        """Flexibilities (A, S, 3, 3) per length: turn per moment, and stretch and shear per force; axes along the arm,
        across, normal."""
        found = SectionFlexibility.evaluate(
            self.known, self.angle - np.arctan2(tangent[..., 1], tangent[..., 0]), width, height
        )
        turn, stretch = np.zeros((*width.shape, 3, 3)), np.zeros((*width.shape, 3, 3))
        for out, diagonal, mixed in (
            (turn, (found.twist, found.lift, found.bend), found.coupled),
            (stretch, (found.stretch, found.slide, found.rise), found.mixed),
        ):
            for k, part in enumerate(diagonal):
                out[..., k, k] = self.unit * part[0]
            out[..., 0, 1] = out[..., 1, 0] = self.unit * mixed[0]
        return turn, stretch


def piece_flexibilities(
    lever: Float[np.ndarray, "arms stations 3"],
    tangent: np.ndarray,
    length: np.ndarray,
    width: np.ndarray,
    height: float,
    poisson: float,
    grain: Grain | None = None,
) -> Float[np.ndarray, "arms stations 6 6"]:
    """(A, S, 6, 6) bend and stretch of pieces per force and moment at the tip, all in the flat frame.

    lever : (A, S, 3) metres, from the piece to the tip; tangent : (A, S, 3); length, width : (A, S) metres; height :
        metres
    grain : of sheets with a grain
    """
    normal = np.broadcast_to([0.0, 0.0, 1.0], tangent.shape)
    aside = np.cross(normal, tangent)
    frame = np.stack([tangent, aside, normal], axis=-1)
    shear = 0.5 / (1.0 + poisson)
    area = width * height
    twisting = shear * torsion_constant(height / width)[0] * width**4
    bending = np.stack([twisting, width * height**3 / 12.0, height * width**3 / 12.0], axis=-1)
    sliding = np.stack([area, shear * area / SHEAR_FACTOR, shear * area / SHEAR_FACTOR], axis=-1)
    back = np.swapaxes(frame, -1, -2)
    if grain is None:
        bend = (frame * (length[..., None] / bending)[..., None, :]) @ back
        slide = (frame * (length[..., None] / sliding)[..., None, :]) @ back
    else:
        bend, slide = (frame @ (length[..., None, None] * part) @ back for part in grain.yields(tangent, width, height))
    out = np.zeros((*length.shape, 6, 6))
    out[..., :3, :3] = bend @ skew(lever)
    out[..., :3, 3:] = bend
    out[..., 3:, :3] = slide
    return out
