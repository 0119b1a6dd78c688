"""Compare layouts by the shape that their assembled panels take."""

from ...runs.stage import PHYSICS, SEARCH, Stage

STAGES = (
    Stage("choose", 1.0, ("flat",), makes=("choice",), replaces=("flat",), settings=("layout", "sheet", *PHYSICS),
          reads=SEARCH, blocks=("choose",), asked=True, optional=True, done="chosen", code="choosing.choice_stage"),
)  # fmt: skip
MISSING = {"choice": "No layouts were compared yet; press Choose first"}
