"""Flexibility of the pieces of arms, with constant strain in every piece (Castigliano's beam, as in ``beams``)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...arrays import Float
from ...materials import Orthotropy
from ..vectors import skew
from .beams import SHEAR_FACTOR, torsion_constant
from .grain import SectionFlexibility

# number of pieces of an arm, with constant strain in each; more are slower and more exact (error of the positions 3e-4
# of the length of an edge of the mesh)
STATIONS = 16
POISSON = 0.35  # Poisson's ratio where no material is given; its effect on positions is small


@dataclass(frozen=True)
class Grain:
    """The grain of a sheet.

    known : moduli of the sheet, Pa
    angle : from the x axes of the flat frames to the grain, radians
    unit : Young's modulus, Pa, by which the moduli are divided to compute flexibilities
    """

    known: Orthotropy
    angle: float
    unit: float

    def yields(
        self, tangent: np.ndarray, width: np.ndarray, height: float
    ) -> tuple[Float[np.ndarray, "arms stations 3 3"], Float[np.ndarray, "arms stations 3 3"]]:
        """Return the flexibilities of pieces per length of arm, for moduli divided by ``unit``.

        Parameters
        ----------
        tangent : (A, S, 3) unit tangents of the pieces, in the flat frame
        width, height : (A, S) widths of the pieces and thickness of the sheet, metres

        Returns
        -------
        (A, S, 3, 3) and (A, S, 3, 3) : bend per moment, and stretch and shear per force. Axes of the matrices: along
            the arm, across it in the sheet, normal to the sheet
        """
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
    """Return how S pieces of each of A arms deform under a wrench at the arm's tip, for a Young's modulus of 1 Pa.

    Parameters
    ----------
    lever : (A, S, 3) vectors from the pieces to the tip, in the flat frame, metres
    tangent : (A, S, 3) unit tangents of the pieces, towards the tip
    length, width : (A, S) of the pieces, metres
    height, poisson : thickness of the sheet, metres, and Poisson's ratio
    grain : None for sheets without a grain

    Returns
    -------
    (A, S, 6, 6) : rows: bend of the piece (3, rad), its stretch and shear (3, metres); columns: force (3) and moment
        (3) at the tip; all in the flat frame
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
