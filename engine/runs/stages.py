"""The table of the stages: the inputs, the outputs and the settings of each.

The main job, the scripts' functions, the command line, Blender's operators, the sidebar's states and the notes in a .blend
file are all derived from it. The functions of the stages are in ``steps``, the classes of the outputs in ``result``; this
module imports nothing heavy, so that the sidebar can be drawn without the numerics.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, fields, replace
from typing import Any

from ..params import Settings

# how an output came about; ``STORED`` where it was read from a .blend file that does not tell
TRACED, BY_HAND, CHOSEN, OPTIMISED, CURVED, STORED = "traced", "by hand", "chosen", "optimised", "curvature", "stored"


@dataclass(frozen=True)
class Stage:
    """One step of the main job. Inputs and outputs are named as the properties of ``Result``.

    name : as in the progress, the command line and ``Result.seconds``
    share : of the progress bar; 0 for quick stages
    needs : required inputs
    makes : outputs that it alone makes
    replaces : outputs of earlier stages in whose place it may put better ones of its own, with which later stages go on
    settings : what makes its outputs out of date: sections of the settings, "spiral!thickness!grain" for a section without two
        of its settings
    reads : further sections that it reads; its outputs stay valid when they change
    blocks : blocks that it writes in report.json and in the notes of a .blend file
    may_use : optional inputs
    asked : whether it runs only on request
    optional : whether sheets can be cut without it, so that a job goes on if it fails
    quick : whether it takes so little time that it runs as soon as its inputs exist, without a request
    done : state of the piece after it, for the message "Not optimised: ..." when an optional stage fails
    """

    name: str
    share: float
    needs: tuple[str, ...] = ("mesh",)
    makes: tuple[str, ...] = ()
    replaces: tuple[str, ...] = ()
    settings: tuple[str, ...] = ()
    reads: tuple[str, ...] = ()
    blocks: tuple[str, ...] = ()
    may_use: tuple[str, ...] = ()
    asked: bool = False
    optional: bool = False
    quick: bool = False
    done: str = ""

    @property
    def sections(self) -> set[str]:
        """Sections of which a change makes its outputs out of date, wholly or but for some settings."""
        return {section_of(entry)[0] for entry in self.settings}

    def readable(self, settings: Settings) -> Settings:
        """Return the settings with only those sections that its row lists; reading another one is an error of the program.

        Parameters
        ----------
        settings : all of them
        """
        listed = {*self.sections, *self.reads}
        closed: dict[str, Any] = {
            f.name: _Unlisted(self.name, f.name) for f in fields(settings) if f.name not in listed
        }
        return replace(settings, **closed)


class _Unlisted:
    """Stands for a section of the settings that a stage's row does not list."""

    stage = section = ""

    def __init__(self, stage: str, section: str):
        self.stage, self.section = stage, section

    def __getattr__(self, name: str) -> Any:
        raise AttributeError(f"The stage '{self.stage}' reads {self.section}.{name}, which its row does not list")


def section_of(entry: str) -> tuple[str, tuple[str, ...]]:
    """Split an entry of ``Stage.settings`` into the name of the section and the settings excluded from it."""
    section, *but = entry.split("!")
    return section, tuple(but)


def values_of(entries: Iterable[str], settings: Settings) -> dict[str, object]:
    """Return the values of entries of ``Stage.settings``, to be compared with later ones.

    Parameters
    ----------
    entries : the names
    settings : where the values are taken; a section that they do not have counts as None
    """
    found: dict[str, object] = {}
    for entry in entries:
        section, but = section_of(entry)
        block: Any = getattr(settings, section, None)
        if but:
            found[entry] = {f.name: getattr(block, f.name) for f in fields(block) if f.name not in but}
        else:
            found[entry] = block
    return found


# -- the table ---------------------------------------------------------------------------------------------------------

# The outlines of spirals depend neither on the thickness of the sheet nor on its grain; only later stages do.
# The optimiser's own settings say how to search: its result stays valid when they change.
# A layout stays valid when the sheet, the spirals or the material change: "sheets" refuses panels that do not fit, and the others
# only decide between layouts that the limits allow.
# Arms are straight under feet and wide at eyelets. The sizes of feet and eyelets don't affect the spirals.
KIND_OF_BASE = "base!eyelet!base_height!foot_width!base_edge"
PHYSICS = ("spiral", "material", "simulate", "loads")
SEARCH = ("choose", "optimise")
TABLE = (
    Stage("regularise", 0.15, replaces=("mesh",), settings=("regularise",)),
    Stage("trace", 0.05, makes=("layout",), settings=("layout",), blocks=("layout",)),
    Stage("merge", 0.35, ("layout",), makes=("merged",), settings=("layout",),
          reads=("spiral", "material", "simulate", "sheet", *SEARCH), blocks=("layout",)),
    Stage("split", 0.05, ("merged",), makes=("flat",), settings=("layout",), reads=("sheet",),
          blocks=("layout",)),
    Stage("choose", 1.0, ("flat",), makes=("choice",), replaces=("flat",), settings=("layout", "sheet", *PHYSICS),
          reads=SEARCH, blocks=("choose",), asked=True, optional=True, done="chosen"),
    Stage("spirals", 0.1, ("flat",), makes=("design",),
          settings=("spiral!thickness!grain", KIND_OF_BASE), blocks=("spirals",)),
    Stage("optimise", 0.5, ("design",), makes=("optimisation",), replaces=("design",),
          settings=PHYSICS, reads=("optimise", "base"), blocks=("optimise",), asked=True, optional=True,
          done="optimised"),
    Stage("simulate", 0.1, ("design",), makes=("simulation",), may_use=("optimisation",),
          settings=PHYSICS, blocks=("equilibrium", "reach"), optional=True, done="simulated"),
    Stage("compare", 0.1, makes=("scan",), may_use=("simulation",), blocks=("scan",), asked=True, optional=True,
          done="compared with its scan"),
    Stage("structure", 0.3, ("simulation",), makes=("structure",), settings=(*PHYSICS, "structure", "connect", "cut"),
          reads=("sheet",), blocks=("structure",), asked=True, optional=True, done="examined under its loads"),
    Stage("sheets", 0.15, ("design",), makes=("sheets",), settings=("spiral", "sheet", "connect", "cut", "base"),
          reads=("layout", "material", "simulate"), may_use=("simulation",), blocks=("sheets",)),
    Stage("estimate", 0.0, ("sheets",), makes=("estimates",), may_use=("simulation",),
          settings=("material", "cost"), blocks=("sheets", "assembly"), quick=True),
)  # fmt: skip
STAGES = {stage.name: stage for stage in TABLE}
# error messages for a missing input of a stage
MISSING = {
    "layout": "There are no panels yet; press Trace first",
    "merged": "There are no flat panels yet; press Merge or Flatten first",
    "flat": "There are no flat panels yet; press Merge or Flatten first",
    "choice": "No layouts were compared yet; press Choose first",
    "design": "There are no spirals yet; press Spirals first",
    "optimisation": "Nothing was optimised yet; press Optimise first",
    "simulation": "There is no simulated shape yet; press Simulate first",
    "structure": "Nothing was examined under loads yet; press Check structure first",
    "sheets": "There are no sheets yet; press Export sheets first",
    "estimates": "There are no sheets yet; press Export sheets first",
}


# -- derived from the table --------------------------------------------------------------------------------------------


def made_from(members: Iterable[str], after: str = "", *, may_use: bool = True) -> set[str]:
    """Return the outputs that may depend on some inputs or outputs, directly or not.

    Parameters
    ----------
    members : names as in ``Stage.needs``
    after : count only stages after this stage of the table
    may_use : whether a stage's optional inputs count as well
    """
    found, given = set[str](), set(members)
    first = 0 if not after else 1 + TABLE.index(STAGES[after])
    for stage in TABLE[first:]:
        if (given | found).intersection((*stage.needs, *(stage.may_use if may_use else ()))):
            found.update(stage.makes)
    return found


# -- blocks of report.json, which a .blend file stores as notes --------------------------------------------------------

BLOCKS = tuple(dict.fromkeys(block for stage in TABLE for block in stage.blocks))


def writers(block: str) -> tuple[Stage, ...]:
    """Return the stages that write a block."""
    return tuple(stage for stage in TABLE if block in stage.blocks)


def blocks_of(members: Iterable[str]) -> set[str]:
    """Return the blocks that describe some members."""
    named = set(members)
    return {block for stage in TABLE if named.intersection(stage.makes) for block in stage.blocks}


def blocks_after(block: str) -> set[str]:
    """Return the other blocks that become stale when a block is written anew."""
    members = {member for stage in writers(block) for member in stage.makes}
    return blocks_of(made_from(members, may_use=False)) - {block}


def ingredients(members: Iterable[str]) -> set[str]:
    """Return some members and everything that they are made from."""
    found = set(members)
    for stage in reversed(TABLE):
        if found.intersection(stage.makes):
            found.update(stage.needs)
    return found
