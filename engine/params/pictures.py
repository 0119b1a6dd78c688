"""Settings of pictures, animations and the page of the report."""

from __future__ import annotations

import math
from dataclasses import dataclass

from .fields import Params, setting


@dataclass(frozen=True)
class PreviewParams(Params):
    """Preview of the assembled piece with its true spirals."""

    detail: str = setting(
        "MEDIUM",
        "Detail",
        "Detail of the spirals",
        choices=(
            ("LINES", "Lines", "Wires along the arms; the lightest"),
            ("COARSE", "Coarse", "True arms and hubs in few pieces; for thousands of spirals"),
            ("MEDIUM", "Medium", "True arms and hubs; smooth from afar"),
            ("FINE", "Fine", "True arms and hubs with their inner corners; for close-ups"),
        ),
    )
    colour: str = setting(
        "PATCH",
        "Colour",
        "Quantity that the colours of the spirals show",
        choices=(
            ("PATCH", "Panels", "One colour per panel"),
            ("STRAIN_ENERGY", "Energy", "Elastic energy in every spiral"),
            (
                "SAFETY",
                "Safety",
                "Largest strain on the surface of every spiral's arms, without fillets, against what the material bears",
            ),
            ("DISTANCE", "Distance", "Distance of every spiral from the target"),
            ("MATERIAL", "Material", "The look of the chosen material"),
        ),
    )
    joined: bool = setting(
        False,
        "With connectors",
        "Draw the connectors along the seams in their true shape, in the animation and in pictures too; takes longer",
    )
    place: str = setting(
        "BESIDE",
        "Place",
        "Place of the assembled piece",
        choices=(
            ("BESIDE", "Beside", "To the left of the model"),
            ("ON", "On it", "At the place of the model, to compare both; hide the model to see the whole piece"),
        ),
    )


@dataclass(frozen=True)
class RenderParams(Params):
    """Picture of the target, the assembled piece and its flat panels."""

    finish: str = setting(
        "PATCH",
        "Finish",
        "Look of the pieces",
        choices=(
            ("PATCH", "Panels", "One colour per panel, so that panels and piece can be compared"),
            ("SHEET", "The sheet's material", "The material that is chosen for the sheet"),
            ("pom", "Delrin", "White, a little translucent"),
            ("birch", "Birch plywood", "Light wood, its grain along the panels"),
            ("acrylic", "Acrylic", "Clear red"),
            ("pla", "PLA, printed", "Blue, with fine strands"),
            ("DISTANCE", "Distance", "Distance of every spiral from the target"),
            ("STRAIN_ENERGY", "Energy", "Elastic energy in every spiral"),
            (
                "SAFETY",
                "Safety",
                "Largest strain on the surface of every spiral's arms, without fillets, against what the material bears",
            ),
        ),
    )
    target: bool = setting(True, "Target", "Show the surface that is to be made")
    assembled: bool = setting(True, "Assembled", "Show the assembled piece with its true spirals")
    panels: bool = setting(True, "Panels", "Show the flat panels")
    azimuth: float = setting(
        math.radians(25.0),
        "View from",
        "Direction of the camera: 0 is in front, a positive angle to the right",
        low=-2 * math.pi,
        high=2 * math.pi,
        unit="rad",
    )
    elevation: float = setting(
        math.radians(32.0),
        "View from above",
        "Angle by which the camera looks down",
        low=0.0,
        high=math.pi / 2,
        unit="rad",
    )
    pixels_x: int = setting(1920, "Width", "Pixels across", low=16, high=16384)
    pixels_y: int = setting(0, "Height", "Pixels down; 0: as many as the pieces need", low=0, high=16384)
    samples: int = setting(24, "Samples", "Rays per pixel: more are smoother and slower", low=1, high=4096)
    film: bool = setting(
        False,
        "Animation",
        "Render the frames of the assembly's animation instead: PNG files, or a film if the file ends in .mp4",
    )
    file: str = setting("//flexmaps-render.png", "File", "File of the picture; // is the folder of the .blend file")


@dataclass(frozen=True)
class PageParams(Params):
    """Web page of the report."""

    viewer: bool = setting(
        True,
        "3D view",
        "Hold the piece in 3D on the report's page, and write share.html, the piece alone to send to somebody",
    )
    coming: str = setting(
        "RESTING",
        "Assembly",
        "Animation of how the panels come together in the 3D view",
        choices=(
            (
                "RESTING",
                "Simulated",
                "Through the shapes in which half-finished pieces rest, as in the animation; takes longer",
            ),
            ("AT_ONCE", "Quick", "Every panel takes its final shape as it comes"),
        ),
    )
