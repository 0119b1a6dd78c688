"""Settings of the load cases."""

from __future__ import annotations

from dataclasses import dataclass

from ...params.fields import Params, setting


@dataclass(frozen=True)
class StructureParams(Params):
    """Load cases that the piece must bear; ``cases`` explains their syntax."""

    cases: str = setting(
        "weight: weight",
        "Load cases",
        "NAME: KIND VALUE AXIS on GROUP times FACTOR, with semicolons between them; kinds: weight, point, line, pressure, wind, snow, move; "
        "N, N/m, N/m2, mm",
    )
    combinations: str = setting(
        "", "Combinations", "Sums of cases with factors, with semicolons between them: NAME = 1.35 weight + 1.5 snow"
    )
    factor_max: float = setting(
        10.0,
        "Largest factor",
        "A load counts as safe if the piece bears this many times its amount",
        low=1.0,
        high=1000.0,
    )
