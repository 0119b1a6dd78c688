"""Settings of the spirals and of the connectors that join their panels."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ..errors import FlexMapsError
from ..tolerances import SINGLE_TOL
from .fields import Params, setting


@dataclass(frozen=True)
class SpiralParams(Params):
    """Range of spirals that can be cut (FlexMaps section 5)."""

    ORDERED = (("width_min", "width_max"), ("twist_min", "twist_max"))

    thickness: float = setting(
        0.002,
        "Thickness",
        "Thickness of the sheet: arms of a thicker one are stiffer and strained more where they bend",
        low=0.0001,
        high=0.05,
        unit="m",
    )
    width_min: float = setting(
        0.001,
        "Smallest width",
        "Width of the thinnest arm: thinner arms bend into tighter curves and break more easily",
        low=0.0002,
        high=0.1,
        unit="m",
    )
    width_max: float = setting(
        0.002,
        "Largest width",
        "Width of the thickest arm: a wider one keeps flat places stiffer",
        low=0.0002,
        high=0.1,
        unit="m",
    )
    twist_min: float = setting(
        0.0, "Smallest twist", "Winding angle of the stiffest spiral", low=0.0, high=4 * math.pi, unit="rad"
    )
    twist_max: float = setting(
        2 * math.pi,
        "Largest twist",
        "Winding angle of the softest spiral, where it can be cut: more lets the piece bend into tighter curves, with more and longer cuts",
        low=0.0,
        high=4 * math.pi,
        unit="rad",
    )
    slot_min: float = setting(
        0.0003,
        "Smallest slot",
        "Narrowest gap between two arms that can be cut: a wider one leaves less room to wind, so that spirals stay stiffer",
        low=0.0,
        high=0.01,
        unit="m",
    )
    slot_seam: float = setting(
        0.0012,
        "Slot at seams",
        "Narrowest gap beside arms that meet across a cut, if these are too short to place the connector farther along them; at most half of the gap between straight arms",
        low=0.0,
        high=0.02,
        unit="m",
    )
    blend: float = setting(
        0.15, "Blend", "Share of an arm's end over which two neighbours merge smoothly", low=0.01, high=0.5
    )
    fillet: float = setting(
        0.00015,
        "Fillet",
        "Radius of the inside corners at the hub; at least half of the kerf, and of the smallest slot if the slot is to be that wide at its root too",
        low=0.0,
        high=0.005,
        unit="m",
    )
    curvature_top: float = setting(
        98.0,
        "Curvature top",
        "Percentile of the curvature that gets the softest spirals; 100 takes the very largest",
        low=50.0,
        high=100.0,
    )
    clockwise: bool = setting(False, "Clockwise", "Wind the spirals the other way round")
    grain: float = setting(
        0.0,
        "Grain",
        "Direction of the sheet's grain in every panel, from its longer side, counter-clockwise as seen from outside; for sheets that "
        "are stiffer along it, and for panels that are laid along the grain",
        low=-0.5 * math.pi,
        high=0.5 * math.pi,
        unit="rad",
    )
    border: str = setting(
        "stubs",
        "Border",
        "Treatment of the arms that end at an open border, where there is no other arm to join",
        choices=(  # .blend files store the number of the choice, so the order must not change
            ("stubs", "Stubs", "They are cut as all others, and end in the air"),
            ("left_out", "Plain", "They are not cut; their hubs have a round end in their place"),
            ("rim", "Rim", "A strip along the border joins their tips, with holes for a cord or rivets"),
        ),
    )
    rim_width: float = setting(
        0.005,
        "Rim width",
        "Width of the strip along an open border; at least twice its holes",
        low=0.0005,
        high=0.1,
        unit="m",
    )
    rim_hole: float = setting(
        0.002,
        "Rim holes",
        "Diameter of the holes in the rim, for a cord or rivets; 0 for none",
        low=0.0,
        high=0.05,
        unit="m",
    )
    rim_spacing: float = setting(
        0.01,
        "Hole spacing",
        "About how far apart the holes of the rim are; they are spread evenly between two arms",
        low=0.001,
        high=1.0,
        unit="m",
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.border != "rim" or self.rim_hole == 0.0:
            return
        if self.rim_width < 2.0 * self.rim_hole * (1.0 - SINGLE_TOL):
            raise FlexMapsError(
                f"A rim of {self.rim_width * 1e3:g} mm is too narrow for holes of {self.rim_hole * 1e3:g} mm; make it at least twice as wide as "
                "its holes, or the holes smaller"
            )
        if self.rim_spacing < 2.0 * self.rim_hole * (1.0 - SINGLE_TOL):
            raise FlexMapsError(
                f"Holes of {self.rim_hole * 1e3:g} mm cannot be {self.rim_spacing * 1e3:g} mm apart; make the hole spacing at least twice their diameter"
            )


@dataclass(frozen=True)
class ConnectorParams(Params):
    """Connectors of panels, where two arms meet across a cut (FlexMaps section 8)."""

    connector: str = setting(
        "dovetail",
        "Connectors",
        "Kind of the connectors that join two arms across a cut",
        choices=(
            ("none", "None", "Plain ends"),
            ("dovetail", "Dovetails", "A head on one panel snaps into a socket of the other"),
            ("key", "Keys", "Both panels have sockets; a small loose key holds them and can be taken out again"),
            ("tab", "Tabs", "Widened plain ends, to be glued"),
        ),
    )
    clearance: float = setting(
        0.00005,
        "Clearance",
        "Free gap all round between the finished parts of a joint: about 0.05 mm for a laser, 0.1 mm for a 3D printer; the kerf comes on top of it",
        low=0.0,
        high=0.001,
        unit="m",
    )
    neck: float = setting(
        1.0,
        "Neck",
        "Width of a connector's neck as a share of the width of its arm; 1 is as strong in tension as the arm",
        low=0.5,
        high=2.0,
    )
    thinnest: float = setting(
        0.0008,
        "Thinnest part",
        "No neck and no wall of a connector is thinner; sheets of 2 mm need about 0.8 mm",
        low=0.0002,
        high=0.02,
        unit="m",
    )
    rounding: float = setting(
        0.0002,
        "Rounding",
        "Radius of a connector's corners; at least half of the kerf of a laser",
        low=0.00005,
        high=0.005,
        unit="m",
    )
