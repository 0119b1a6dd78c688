"""Settings of the film of the assembly."""

from __future__ import annotations

from dataclasses import dataclass

from ...params.fields import Params, setting


@dataclass(frozen=True)
class FilmParams(Params):
    """Animation of the assembly."""

    seconds: float = setting(12.0, "Seconds", "Length of the animation", low=1.0, high=600.0)
    film_detail: str = setting(
        "COARSE",
        "Detail",
        "Detail of the spirals in the animation",
        choices=(
            ("COARSE", "Coarse", "Plays smoothly, also with thousands of spirals"),
            ("MEDIUM", "Medium", "Smooth from afar"),
            ("FINE", "Fine", "For close-ups"),
        ),
    )
