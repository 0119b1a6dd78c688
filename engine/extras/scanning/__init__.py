"""Compare a scan of the built piece with its predicted shape."""

from ...runs.stage import Stage

STAGES = (
    Stage("compare", 0.1, makes=("scan",), may_use=("simulation",), blocks=("scan",), asked=True, optional=True,
          done="compared with its scan", code="scanning.scan_stage"),
)  # fmt: skip
