"""Eyelets: a hole in the hub of every supported spiral, by which the piece hangs.

The simulation holds a hinged hub at its centre, and the hole is there: a cord or hook holds the piece where it is
simulated. Between the hole and the edge of the hub there is at least one diameter of material, as usual for pins in
sheets.
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
from ...spirals.curves.arcs import Curve
from ...spirals.design import SpiralDesign
from ...surface.checking.finding import with_count
from ..panels.labels import hub_circles

EDGE = 1.0  # minimum material around a hole in diameters, as handbooks require between a pin and the edge of a plate
ROUNDED = 1e-3  # tolerance on the room in a hub as a share of the hole, because the room is found by iteration


@dataclass(frozen=True, eq=False)
class Eyelet:
    """One hole.

    number : from 1, as on the assembly sheet
    quad, patch : where it is
    centre : metres, in the flat frame of its patch
    diameter, edge : of the hole, and minimum material around it, metres
    place : centre in the simulated shape, metres
    pull : force in N that holds the piece there; None if unknown
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
        """Name in texts, different from names of panels, seams and feet."""
        return f"o{self.number}"

    @property
    def hole(self) -> Curve:
        """Circle of two arcs, clockwise."""
        beside = np.array([0.5 * self.diameter, 0.0])
        return Curve(np.stack([self.centre - beside, self.centre + beside]), np.array([-1.0, -1.0]))

    @property
    def force(self) -> float | None:
        """Magnitude of the force in N, or None."""
        return None if self.pull is None else float(np.linalg.norm(self.pull))

    def stress(self, thickness: float) -> float | None:
        """Return the larger of bearing stress and shear stress of tear-out behind the pin, Pa; None if unknown."""
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
    """Make a hole in the hub of every supported spiral of a design whose hubs are in a pose.

    Parameters
    ----------
    supports : supported quads
    diameter : metres
    cut : kerf and mill, which bound the diameter
    pull : N, force that holds every hub

    Raises
    ------
    FlexMapsError : nothing is supported, or with the faces whose hubs are too small
    """
    if supports is None or not len(supports):
        raise FlexMapsError(
            "There are no supports to hang the piece by; choose supports, such as the spirals at its top, or choose no base"
        )
    least = max(cut.kerf_holes, cut.mill)
    if diameter <= least:
        raise FlexMapsError(
            f"Eyelets of {1e3 * diameter:g} mm are no larger than the cutter's width of {1e3 * least:g} mm; make them larger"
        )
    room = hub_circles(design.arms, design.roots)[supports]
    needed = (0.5 + EDGE) * diameter
    narrow = room < (1.0 - ROUNDED) * needed
    if narrow.any():
        raise FlexMapsError(
            f"The hubs of {with_count(int(narrow.sum()), 'supported spiral', 'supported spirals')} are too small for eyelets of {1e3 * diameter:g} mm with as much "
            f"material round them: they have room for {1e3 * room.min() / (0.5 + EDGE):.2g} mm; make the eyelets smaller or the "
            "largest width larger, and press Spirals again while eyelets are chosen, which makes these spirals as wide as possible",
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
    """Return the figures of report.json: places in the simulated shape, and the force on every eyelet."""
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


def warn_of_overload(eyelets: tuple[Eyelet, ...], thickness: float, material: Material) -> list[str]:
    """Return a warning if eyelets bear more than the strength of their material.

    Parameters
    ----------
    eyelets : with their forces
    thickness : of the sheet, metres
    material : with its strength
    """
    found = [(one.stress(thickness) or 0.0) / material.strength for one in eyelets]
    worst = int(np.argmax(found)) if found else 0
    if not found or found[worst] <= 1.0:
        return []
    one = eyelets[worst]
    return [
        f"{with_count(sum(share > 1.0 for share in found), 'eyelet bears', 'eyelets bear')} more than {material.name}: {one.name} {one.force:.3g} N, "
        f"{100.0 * found[worst]:.0f} % of what it can; hang the piece by more spirals, or make the eyelets larger"
    ]
