"""The table of the stages: the inputs, the outputs and the settings of each.

The main job, the scripts' functions, the command line, Blender's operators, the sidebar's states and the notes in a .blend
file are all derived from it. The functions of the road's stages are in ``steps``, the classes of their outputs in ``outputs``; those
of an extra's stages in its folder. This module imports nothing heavy, so that the sidebar can be drawn without the numerics.
"""

from __future__ import annotations

from collections.abc import Iterable

from ..extras import registry
from .stage import PHYSICS, SEARCH, Stage

# how an output came about; ``STORED`` where it was read from a .blend file that does not tell
TRACED, BY_HAND, CHOSEN, OPTIMISED, CURVED, STORED = "traced", "by hand", "chosen", "optimised", "curvature", "stored"


# -- the table ---------------------------------------------------------------------------------------------------------

# The outlines of spirals depend neither on the thickness of the sheet nor on its grain; only later stages do.
# The optimiser's own settings say how to search: its result stays valid when they change.
# A layout stays valid when the sheet, the spirals or the material change: "sheets" refuses panels that do not fit, and the others
# only decide between layouts that the limits allow.
# Arms are straight under feet and wide at eyelets. The sizes of feet and eyelets don't affect the spirals.
KIND_OF_BASE = "base!eyelet!base_height!foot_width!base_edge"
_EXTRA = registry.stages()
TABLE = (
    Stage("regularise", 0.15, replaces=("mesh",), settings=("regularise",)),
    Stage("trace", 0.05, makes=("layout",), settings=("layout",), blocks=("layout",)),
    Stage("merge", 0.35, ("layout",), makes=("merged",), settings=("layout",),
          reads=("spiral", "material", "simulate", "sheet", *SEARCH), blocks=("layout",)),
    Stage("split", 0.05, ("merged",), makes=("flat",), settings=("layout",), reads=("sheet",),
          blocks=("layout",)),
    *_EXTRA["choosing"],
    Stage("spirals", 0.1, ("flat",), makes=("design",),
          settings=("spiral!thickness!grain", KIND_OF_BASE), blocks=("spirals",)),
    Stage("optimise", 0.5, ("design",), makes=("optimisation",), replaces=("design",),
          settings=PHYSICS, reads=("optimise", "base"), blocks=("optimise",), asked=True, optional=True,
          done="optimised"),
    Stage("simulate", 0.1, ("design",), makes=("simulation",), may_use=("optimisation",),
          settings=PHYSICS, blocks=("equilibrium", "reach"), optional=True, done="simulated"),
    *_EXTRA["scanning"],
    *_EXTRA["structure"],
    Stage("sheets", 0.15, ("design",), makes=("sheets",), settings=("spiral", "sheet", "connect", "cut", "base"),
          reads=("layout", "material", "simulate"), may_use=("simulation",), blocks=("sheets",)),
    Stage("estimate", 0.0, ("sheets",), makes=("estimates",), may_use=("simulation",),
          settings=("material", "cost"), blocks=("sheets", "assembly"), quick=True),
)  # fmt: skip
STAGES = {stage.name: stage for stage in TABLE}
OF_EXTRAS = tuple(stage for stage in TABLE if stage.code)
# error messages for a missing input of a stage
MISSING = {
    "layout": "There are no panels yet; press Trace first",
    "merged": "There are no flat panels yet; press Merge or Flatten first",
    "flat": "There are no flat panels yet; press Merge or Flatten first",
    "design": "There are no spirals yet; press Spirals first",
    "optimisation": "Nothing was optimised yet; press Optimise first",
    "simulation": "There is no simulated shape yet; press Simulate first",
    "sheets": "There are no sheets yet; press Export sheets first",
    "estimates": "There are no sheets yet; press Export sheets first",
}
for _folder in _EXTRA:
    MISSING |= getattr(registry.load(_folder), "MISSING", {}) if registry.has(_folder) else {}


# -- derived from the table --------------------------------------------------------------------------------------------


def dependents(members: Iterable[str], *, may_use: bool = True) -> set[str]:
    """Return the outputs that may depend on some inputs or outputs, directly or not.

    Parameters
    ----------
    members : names as in ``Stage.needs``
    may_use : whether a stage's optional inputs count as well
    """
    found, given = set[str](), set(members)
    for stage in TABLE:
        if (given | found).intersection((*stage.needs, *(stage.may_use if may_use else ()))):
            found.update(stage.makes)
    return found


# -- blocks of report.json, which a .blend file stores as notes --------------------------------------------------------

BLOCKS = tuple(dict.fromkeys(block for stage in TABLE for block in stage.blocks))


def writers(block: str) -> tuple[Stage, ...]:
    """Return the stages that write a block."""
    return tuple(stage for stage in TABLE if block in stage.blocks)


def blocks_describing(members: Iterable[str]) -> set[str]:
    """Return the blocks of report.json that describe products of stages."""
    named = set(members)
    return {block for stage in TABLE if named.intersection(stage.makes) for block in stage.blocks}


def stale_blocks(block: str) -> set[str]:
    """Return the other blocks that become stale when a block is written anew."""
    members = {member for stage in writers(block) for member in stage.makes}
    return blocks_describing(dependents(members, may_use=False)) - {block}


def dependencies(members: Iterable[str]) -> set[str]:
    """Return some members and everything that they are made from."""
    found = set(members)
    for stage in reversed(TABLE):
        if found.intersection(stage.makes):
            found.update(stage.needs)
    return found
