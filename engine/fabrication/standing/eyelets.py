"""Eyelets: a hole in the hub of every supported spiral, by which the piece hangs.

The hole is at the centre of the hub, where the simulation supports a hinged hub, so a cord or hook holds the piece at
the same point as in the simulation. Between the hole and the edge of the hub there is at least one diameter of
material, as usual for pins in sheets.
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
from ..panels.labels import free_hub_radii

# minimum width of the material around a hole, in diameters of the hole. Handbooks require 1 between the hole of a pin
# and an edge; larger is stronger and needs larger hubs
EDGE_RATIO = 1.0
# share by which the free radius of a hub may fall short of what the hole needs, because hubs are sized iteratively
RADIUS_TOLERANCE = 1e-3


@dataclass(frozen=True, eq=False)
class Eyelet:
    """A hole in a hub, by which the piece hangs.

    number : from 1, as on the assembly sheet
    quad, patch : indices of the quad and the patch in which it lies
    centre : centre of the hole in the patch's frame, metres
    diameter, edge_width : diameter of the hole, and minimum width of the material around it, metres
    place : centre of the hole in the simulated shape, metres
    support_force : force vector in N that holds the piece at the hole; None if unknown
    """

    number: int
    quad: int
    patch: int
    centre: Float[np.ndarray, " 2"]
    diameter: float
    edge_width: float
    place: Float[np.ndarray, " 3"]
    support_force: Float[np.ndarray, " 3"] | None = None

    @property
    def name(self) -> str:
        """Name of the eyelet in texts, different from all names of panels, seams and feet."""
        return f"o{self.number}"

    @property
    def hole(self) -> Curve:
        """The hole in the patch's frame: a circle of two arcs, clockwise."""
        beside = np.array([0.5 * self.diameter, 0.0])
        return Curve(np.stack([self.centre - beside, self.centre + beside]), np.array([-1.0, -1.0]))

    @property
    def force_magnitude(self) -> float | None:
        """Magnitude of ``support_force`` in N; None if unknown."""
        return None if self.support_force is None else float(np.linalg.norm(self.support_force))

    def stress(self, thickness: float) -> float | None:
        """Return the larger of the bearing stress and the tear-out shear stress at the pin, Pa; None if unknown."""
        if self.force_magnitude is None:
            return None
        return self.force_magnitude / thickness * max(1.0 / self.diameter, 1.0 / (2.0 * self.edge_width))


def make_eyelets(
    design: SpiralDesign,
    pose: Pose,
    supports: Int[np.ndarray, " held"] | None,
    diameter: float,
    cut: CutParams,
    support_forces: Float[np.ndarray, "quads 3"] | None = None,
) -> tuple[Eyelet, ...]:
    """Make a hole in the hub of every supported spiral of a design.

    Parameters
    ----------
    design : the spirals
    pose : simulated positions of the hubs
    supports : supported quads
    diameter : diameter of the holes, metres
    cut : kerf and mill, which bound the diameter from below
    support_forces : force in N that holds every hub

    Raises
    ------
    FlexMapsError : nothing is supported, the holes are narrower than the cutter, or hubs are too small (with faces)
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
    room = free_hub_radii(design.arms, design.roots)[supports]
    needed = (0.5 + EDGE_RATIO) * diameter
    narrow = room < (1.0 - RADIUS_TOLERANCE) * needed
    if narrow.any():
        raise FlexMapsError(
            f"The hubs of {with_count(int(narrow.sum()), 'supported spiral', 'supported spirals')} are too small for eyelets of {1e3 * diameter:g} mm with as much "
            f"material round them: they have room for {1e3 * room.min() / (0.5 + EDGE_RATIO):.2g} mm; make the eyelets smaller or the "
            "largest width larger, and press Spirals again while eyelets are chosen, which makes these spirals as wide as possible",
            faces=supports[narrow],
        )
    patch, centre = design.flat.layout.patch_of[supports], design.arms.centre[supports]
    return tuple(
        Eyelet(
            n + 1, f, int(patch[n]), centre[n], diameter, float(room[n]) - 0.5 * diameter, pose.centres[f],
            None if support_forces is None else support_forces[f],
        )
        for n, f in enumerate(supports.tolist())
    )  # fmt: skip


def eyelets_report(eyelets: tuple[Eyelet, ...]) -> dict[str, Any]:
    """Return the eyelets' figures for report.json: places in the simulated shape, and forces if they are known."""
    found: dict[str, Any] = {
        "eyelets": len(eyelets),
        "eyelet_mm": round(1e3 * eyelets[0].diameter, 3),
        "edge_mm": round(1e3 * min(one.edge_width for one in eyelets), 3),
        "faces": [one.quad for one in eyelets],
        "places_mm": [[round(1e3 * float(x), 2) for x in one.place] for one in eyelets],
    }
    if eyelets[0].support_force is not None:
        found["forces_N"] = [
            [float(f"{x:.4g}") for x in one.support_force] for one in eyelets if one.support_force is not None
        ]
    return found


def warn_of_overload(eyelets: tuple[Eyelet, ...], thickness: float, material: Material) -> list[str]:
    """Return a warning if the stress at eyelets exceeds the strength of their material.

    Parameters
    ----------
    eyelets : the eyelets; those without a force are ignored
    thickness : thickness of the sheet, metres
    material : material of the sheet
    """
    found = [(one.stress(thickness) or 0.0) / material.strength for one in eyelets]
    worst = int(np.argmax(found)) if found else 0
    if not found or found[worst] <= 1.0:
        return []
    one = eyelets[worst]
    return [
        f"{with_count(sum(share > 1.0 for share in found), 'eyelet bears', 'eyelets bear')} more than {material.name}: {one.name} {one.force_magnitude:.3g} N, "
        f"{100.0 * found[worst]:.0f} % of what it can; hang the piece by more spirals, or make the eyelets larger"
    ]
