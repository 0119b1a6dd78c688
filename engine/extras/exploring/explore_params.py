"""Settings of an exploration from the sidebar."""

from __future__ import annotations

from dataclasses import dataclass

from ...params.fields import Params, setting


@dataclass(frozen=True)
class ExploreParams(Params):
    """Variables and goals when the sidebar explores many candidates."""

    candidates: int = setting(32, "Candidates", "Largest number of candidates to try", low=1, high=10_000)
    ratio: float = setting(
        1.5,
        "Up to times",
        "Numbers are varied between their present value divided by this factor and multiplied by it",
        low=1.01,
        high=10.0,
    )
    vary_size: bool = setting(True, "Vary size", "Try the piece smaller and larger")
    vary_thickness: bool = setting(True, "Vary thickness", "Try other thicknesses of the sheet")
    vary_widths: bool = setting(False, "Vary width", "Try another largest width of the arms")
    vary_twist: bool = setting(False, "Vary twist", "Try another largest twist of the spirals")
    vary_material: bool = setting(False, "Vary material", "Try every material of the list")
    vary_arms: bool = setting(False, "Vary arms", "Try arms all alike, in pairs and each its own")
    vary_panels: bool = setting(
        False, "Vary panels", "Try fewer and larger, and more and smaller panels, by another distortion limit"
    )
    largest: float = setting(
        1.0,
        "Distance (%)",
        "RMS distance from the target that is wanted at most, in percent of its size",
        low=0.001,
        high=100.0,
    )
    sheets: int = setting(
        0, "Most sheets", "Number of sheets at hand; 0 allows as many as are needed", low=0, high=1000
    )
