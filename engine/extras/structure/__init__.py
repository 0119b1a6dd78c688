"""Load analysis: load cases, deflection, utilisation of arms and joints, and the load at which a piece snaps."""

from ...runs.stage import PHYSICS, Stage

STAGES = (
    Stage("structure", 0.3, ("simulation",), makes=("structure",), settings=(*PHYSICS, "structure", "connect", "cut"),
          reads=("sheet",), blocks=("structure",), asked=True, optional=True, done="examined under its loads",
          code="structure.load_stage"),
)  # fmt: skip
MISSING = {"structure": "Nothing was examined under loads yet; press Check structure first"}
