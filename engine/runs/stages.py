"""Table of the stages of the main job, with the inputs, outputs and settings of each.

The job, the functions for scripts, the command line, Blender's operators, the sidebar's states and the notes in a
.blend file are derived from this table. The functions of the stages are in ``steps``, the classes of their outputs in
``outputs``; an extra's folder holds both for its stages. This module imports no numerics, so that the sidebar draws
fast.
"""

from __future__ import annotations

from collections.abc import Iterable

from ..extras import registry
from .stage import PHYSICS, SEARCH, Stage

# origins of layouts and spirals, see ``outputs``; ``STORED``: from a .blend file that does not record the origin
TRACED, BY_HAND, CHOSEN, OPTIMISED, CURVED, STORED = "traced", "by hand", "chosen", "optimised", "curvature", "stored"


# -- the table ---------------------------------------------------------------------------------------------------------

# Why some settings do not make an output out of date:
# - The outlines of spirals depend neither on the sheet's thickness nor on its grain; only later stages do.
# - The optimiser's own settings control the search; its result stays valid when they change.
# - A layout stays valid when sheet, spirals or material change: these only decide between permitted layouts, and the
#   stage "sheets" refuses panels that do not fit.
# - Arms are straight under feet and wide at eyelets, but the sizes of feet and eyelets don't affect the spirals.
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
# error message for each input that a stage needs and that is missing
MISSING = {
    "layout": "There are no panels yet; press Trace first",
    "merged": "There are no flat panels yet; press Lay out the panels or Flatten first",
    "flat": "There are no flat panels yet; press Lay out the panels or Flatten first",
    "design": "There are no spirals yet; press Spirals first",
    "optimisation": "Nothing was optimised yet; press Optimise first",
    "simulation": "There is no simulated shape yet; press Simulate first",
    "sheets": "There are no sheets yet; press Write the files first",
    "estimates": "There are no sheets yet; press Write the files first",
}
for _folder in _EXTRA:
    MISSING |= getattr(registry.load(_folder), "MISSING", {}) if registry.has(_folder) else {}


# -- derived from the table --------------------------------------------------------------------------------------------


def dependents(members: Iterable[str], *, may_use: bool = True) -> set[str]:
    """Return the names of all outputs that depend, directly or indirectly, on some inputs or outputs.

    Parameters
    ----------
    members : names of these inputs and outputs, as in ``Stage.needs``
    may_use : whether a stage's optional inputs count as well
    """
    found, given = set[str](), set(members)
    for stage in TABLE:
        if (given | found).intersection((*stage.needs, *(stage.may_use if may_use else ()))):
            found.update(stage.makes)
    return found


# -- blocks of report.json, which a .blend file stores as notes --------------------------------------------------------

BLOCKS = tuple(dict.fromkeys(block for stage in TABLE for block in stage.blocks))


def stages_writing(block: str) -> tuple[Stage, ...]:
    """Return the stages that write a block of report.json."""
    return tuple(stage for stage in TABLE if block in stage.blocks)


def blocks_describing(members: Iterable[str]) -> set[str]:
    """Return the blocks of report.json that describe some outputs; members : names of the outputs."""
    named = set(members)
    return {block for stage in TABLE if named.intersection(stage.makes) for block in stage.blocks}


def stale_blocks(block: str) -> set[str]:
    """Return the other blocks of report.json that become out of date when a block is written anew."""
    members = {member for stage in stages_writing(block) for member in stage.makes}
    return blocks_describing(dependents(members, may_use=False)) - {block}


def dependencies(members: Iterable[str]) -> set[str]:
    """Return the names of some outputs and of all inputs and outputs that they are made from."""
    found = set(members)
    for stage in reversed(TABLE):
        if found.intersection(stage.makes):
            found.update(stage.needs)
    return found
