"""Settings of the surface: its quads, its layout of panels, and the searches for a layout and for other settings."""

from __future__ import annotations

from dataclasses import dataclass

from .fields import Params, setting


@dataclass(frozen=True)
class RemeshParams(Params):
    """Quad remeshing of any mesh in Blender, and the size of the piece."""

    quads: int = setting(
        500,
        "Quads",
        "About how many quads, and so spirals, the new mesh gets: more follow small features and take longer; at the same size, each has less room",
        low=50,
        high=100_000,
    )
    smooth: bool = setting(True, "Smooth normals", "Follow the smooth shape rather than every small dent")
    crumbs: float = setting(
        0.1,
        "Left out at most",
        "Largest share of the area in bodies too small for this many quads that is left out; where it is more, the remesh stops",
        low=0.0,
        high=1.0,
    )
    edge: float = setting(
        0.02,
        "Quad edge",
        "Median edge of the quads when the piece is cut, which sets its size: 20 mm are comfortable, 10 mm the least",
        low=0.001,
        high=1.0,
        unit="m",
    )


@dataclass(frozen=True)
class RegulariseParams(Params):
    """Regularisation, which makes the quads squarer before they are flattened (Pietroni et al. 2015)."""

    iterations: int = setting(
        60,
        "Iterations",
        "Rounds of fitting squares and averaging them: more make the quads squarer and take longer",
        low=0,
        high=1000,
    )
    boundary: bool = setting(True, "Keep the border", "Move border vertices only along the border of an open surface")


@dataclass(frozen=True)
class LayoutParams(Params):
    """Limits of the size and shape of panels (FlexMaps section 4)."""

    distortion_limit: float = setting(
        0.035,
        "Distortion limit",
        "Largest distortion (ARAP energy) of a quad as a panel is laid flat: more gives fewer panels, which match the surface less well",
        low=0.001,
        high=1.0,
    )
    compactness_limit: float = setting(
        5.0,
        "Compactness limit",
        "Largest perimeter / sqrt(area) of a panel; a square has 4. Where the surface itself is narrow, its border hardly counts",
        low=3.6,
        high=50.0,
    )
    neck_min: int = setting(
        2,
        "Smallest neck",
        "Fewest quads across the narrowest place between two cuts of a panel: more gives sturdier panels, and more of them",
        low=1,
        high=10,
    )
    patch_min: int = setting(
        6,
        "Smallest panel",
        "Fewest quads in a panel, where the surface allows: more leaves no small panels to join by hand",
        low=1,
        high=1000,
    )
    symmetric: bool = setting(
        True, "Keep symmetry", "Give a symmetric surface symmetric quads and a symmetric layout where possible"
    )
    seamless: bool = setting(
        False,
        "One panel without a cut",
        "Leave a curved surface in one panel where it lies flat in one. Without supports such a panel stays flat: "
        "nothing makes it leave the plane",
    )


@dataclass(frozen=True)
class ChooseParams(Params):
    """Goal of the choice among layouts, which are compared by the simulated shapes of their pieces."""

    goal: str = setting(
        "match",
        "Goal",
        "What the proposed layouts are chosen by",
        choices=(
            ("match", "Match", "Fewest joints with the target reached within Match"),
            ("panels", "Panels", "Nearest to the target with at most this many panels"),
            ("least", "Least work", "Fewest joints without being farther from the target than the present layout"),
        ),
    )
    match: float = setting(
        1.0,
        "Match (%)",
        "RMS distance from the target that the assembled piece may keep, in percent of its size. Where few panels are not expected to come as near, Merge tries up to twice as many",
        low=0.001,
        high=100.0,
    )
    panels: int = setting(4, "Panels", "Most panels that the layout may have", low=1, high=1000)
    near: bool = setting(
        False,
        "Only changes",
        "Try only further cuts in the present layout, no other layouts: some ten seconds in place of a minute",
    )
