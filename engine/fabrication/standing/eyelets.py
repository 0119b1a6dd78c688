"""Eyelets: a hole in the hub of every supported spiral, by which the piece hangs.

The simulation holds a hinged hub at its centre, so that is where the hole is: a cord or a hook in it holds the piece where it is
simulated. Between the hole and the edge of the hub there is at least one diameter of material, as is usual for pins in sheets.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ...arrays import Float, Int
from ...errors import FlexMapsError
from ...materials import Material
from ...mechanics.assembly import Pose
from ...params import CutParams
from ...spirals.arcs import Curve
from ...spirals.design import SpiralDesign
from ...surface.checking.finding import counted
from ..panels.labels import hub_circles

EDGE = (
    1.0  # diameters of material round a hole at the least: what handbooks ask for between a pin and the edge of a plate
)
ROUNDED = 1e-3  # share of the hole by which the room of a hub may be smaller, for it is found by iteration


@dataclass(frozen=True, eq=False)
class Eyelet:
    """One hole.

    number : from 1 on, as the assembly sheet has it; quad, patch : where it is
    centre : metres, in the flat frame of its patch; diameter, edge : metres, of the hole and of the material round it
    place : metres, of its middle in the simulated shape
    pull : newtons with which the piece is held there; None where that is not known
    """

    number: int
    quad: int
    patch: int
    centre: Float[np.ndarray, " 2"]
    diameter: float
    edge: float
    place: Float[np.ndarray, " 3"]
    pull: Float[np.ndarray, " 3"] | None = None

    @property
    def name(self) -> str:
        """What it is called in words: no panel, seam or foot is called so."""
        return f"o{self.number}"

    @property
    def hole(self) -> Curve:
        """Two halves of a circle, clockwise."""
        beside = np.array([0.5 * self.diameter, 0.0])
        return Curve(np.stack([self.centre - beside, self.centre + beside]), np.array([-1.0, -1.0]))

    @property
    def force(self) -> float | None:
        """Newtons."""
        return None if self.pull is None else float(np.linalg.norm(self.pull))

    def stress(self, thickness: float) -> float | None:
        """Pa, the larger one of the bearing stress behind the pin and the shear of the two planes in which it would tear out."""
        if self.force is None:
            return None
        return self.force / thickness * max(1.0 / self.diameter, 1.0 / (2.0 * self.edge))


def make_eyelets(
    design: SpiralDesign,
    pose: Pose,
    supports: Int[np.ndarray, " held"] | None,
    diameter: float,
    cut: CutParams,
    pull: Float[np.ndarray, "quads 3"] | None = None,
) -> tuple[Eyelet, ...]:
    """A hole in the hub of every supported spiral of a design whose hubs stand in a pose.

    diameter : metres; pull : newtons with which every hub is held. Raises ``FlexMapsError`` with the faces whose hubs are too small.
    """
    if supports is None or not len(supports):
        raise FlexMapsError(
            "A piece hangs by what is supported, and nothing is; name supports, such as the spirals at its top, or choose no base"
        )
    least = max(cut.kerf_holes, cut.mill)
    if diameter <= least:
        raise FlexMapsError(
            f"Eyelets of {1e3 * diameter:g} mm are no larger than what the cutter takes away, {1e3 * least:g} mm; make them larger"
        )
    room = hub_circles(design.arms, design.roots)[supports]
    needed = (0.5 + EDGE) * diameter
    narrow = room < (1.0 - ROUNDED) * needed
    if narrow.any():
        raise FlexMapsError(
            f"The hubs of {counted(int(narrow.sum()), 'supported spiral', 'supported spirals')} are too small for eyelets of {1e3 * diameter:g} mm with as much "
            f"material round them: they have room for {1e3 * room.min() / (0.5 + EDGE):.2g} mm; make the eyelets smaller or the "
            "largest width larger, and press Spirals again while they are chosen, which makes these spirals as wide as may be",
            faces=supports[narrow],
        )
    patch, centre = design.flat.layout.patch_of[supports], design.arms.centre[supports]
    return tuple(
        Eyelet(
            n + 1, f, int(patch[n]), centre[n], diameter, float(room[n]) - 0.5 * diameter, pose.centres[f],
            None if pull is None else pull[f],
        )
        for n, f in enumerate(supports.tolist())
    )  # fmt: skip


def eyelets_report(eyelets: tuple[Eyelet, ...]) -> dict[str, Any]:
    """The figures of report.json: places in the simulated shape, and what every eyelet bears."""
    found: dict[str, Any] = {
        "eyelets": len(eyelets),
        "eyelet_mm": round(1e3 * eyelets[0].diameter, 3),
        "edge_mm": round(1e3 * min(one.edge for one in eyelets), 3),
        "faces": [one.quad for one in eyelets],
        "places_mm": [[round(1e3 * float(x), 2) for x in one.place] for one in eyelets],
    }
    if eyelets[0].pull is not None:
        found["forces_N"] = [[float(f"{x:.4g}") for x in one.pull] for one in eyelets if one.pull is not None]
    return found


def overloaded(eyelets: tuple[Eyelet, ...], thickness: float, material: Material) -> list[str]:
    """A warning where eyelets bear more than their material."""
    found = [(one.stress(thickness) or 0.0) / material.strength for one in eyelets]
    worst = int(np.argmax(found)) if found else 0
    if not found or found[worst] <= 1.0:
        return []
    one = eyelets[worst]
    return [
        f"{counted(sum(share > 1.0 for share in found), 'eyelet bears', 'eyelets bear')} more than {material.name}: {one.name} {one.force:.3g} N, "
        f"{100.0 * found[worst]:.0f} % of what it can; hang the piece by more spirals, or make the eyelets larger"
    ]
