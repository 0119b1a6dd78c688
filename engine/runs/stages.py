"""The table of the stages: the inputs, the products and the settings of each.

The main job, the scripts' functions, the command line, Blender's operators, the sidebar's states and the notes in a .blend
file are all derived from it. To find what a change makes stale, follow the table downwards: the product of a stage depends
on the members that it ``needs``, and on everything that these were made from. The functions of the stages are in ``steps``;
this module imports nothing heavy, so that the sidebar can be drawn without the numerics.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from ..errors import FlexMapsError
from ..params import Settings

if TYPE_CHECKING:
    from .result import Result


@dataclass(frozen=True)
class Stage:
    """One step of the main job. Inputs and products are named as the members of ``Result``.

    name : as in the progress, the command line and ``Result.seconds``
    share : of the progress bar; 0 for quick stages
    needs : required inputs
    makes : products
    improves : inputs that it replaces by better ones, with which later stages go on
    settings : sections of the settings that it depends on; "spiral!thickness!grain" is a section without two of its settings
    blocks : blocks that it writes in report.json and in the notes of a .blend file
    may_use : optional inputs
    asked : whether it runs only on request
    optional : whether sheets can be cut without it, so that a job goes on if it fails
    quick : whether it takes so little time that it runs as soon as its inputs exist, without a request
    keeps : whether it may leave the members that it improves unchanged; its step then decides whether products of them are dropped
    done : state of the piece after it, for the message "Not optimised: ..." when an optional stage fails
    """

    name: str
    share: float
    needs: tuple[str, ...] = ("mesh",)
    makes: tuple[str, ...] = ()
    improves: tuple[str, ...] = ()
    settings: tuple[str, ...] = ()
    blocks: tuple[str, ...] = ()
    may_use: tuple[str, ...] = ()
    asked: bool = False
    optional: bool = False
    quick: bool = False
    keeps: bool = False
    done: str = ""

    @property
    def sections(self) -> set[str]:
        """Names of the sections of the settings that the stage depends on, wholly or in part."""
        return {section_of(named)[0] for named in self.settings}


def section_of(named: str) -> tuple[str, tuple[str, ...]]:
    """Split an entry of ``Stage.settings`` into the name of the section and the settings excluded from it."""
    section, *but = named.split("!")
    return section, tuple(but)


# -- the table ---------------------------------------------------------------------------------------------------------

# The outlines of spirals depend neither on the thickness of the sheet nor on its grain; only later stages do.
# The optimiser's own settings say how to search. They are left out, since its result stays valid when they change.
# Arms are straight under feet and wide at eyelets. The sizes of feet and eyelets don't affect the spirals.
KIND_OF_BASE = "base!eyelet!base_height!foot_width!base_edge"
PHYSICS = ("spiral", "material", "simulate", "loads")
TABLE = (
    Stage("regularise", 0.15, improves=("mesh",), settings=("regularise",)),
    Stage("trace", 0.05, makes=("layout",), settings=("layout",), blocks=("layout",)),
    Stage("merge", 0.35, ("layout",), makes=("flat",), settings=("layout",), blocks=("layout",)),
    Stage("split", 0.05, ("flat",), improves=("flat",), settings=("layout",), blocks=("layout",)),
    Stage("choose", 1.0, ("flat",), makes=("choice",), improves=("flat",), settings=("layout", "sheet", *PHYSICS),
          blocks=("choose",), asked=True, optional=True, keeps=True, done="chosen"),
    Stage("spirals", 0.1, ("flat",), makes=("design",), improves=("flat",),
          settings=("spiral!thickness!grain", KIND_OF_BASE), blocks=("spirals",)),
    Stage("optimise", 0.5, ("design",), makes=("optimisation",), improves=("flat", "design"),
          settings=PHYSICS, blocks=("optimise",), asked=True, optional=True, done="optimised"),
    Stage("simulate", 0.1, ("design",), makes=("simulation", "limits"), may_use=("optimisation",),
          settings=PHYSICS, blocks=("equilibrium", "reach"), optional=True, done="simulated"),
    Stage("compare", 0.1, makes=("scan",), may_use=("simulation",), blocks=("scan",), asked=True, optional=True,
          done="compared with its scan"),
    Stage("structure", 0.3, ("simulation",), makes=("structure",), settings=(*PHYSICS, "structure", "connect", "cut"),
          blocks=("structure",), asked=True, optional=True, done="examined under its loads"),
    Stage("sheets", 0.15, ("design",), makes=("sheets",), settings=("spiral", "sheet", "connect", "cut", "base"),
          blocks=("sheets",)),
    Stage("estimate", 0.0, ("sheets",), makes=("estimates", "assembly"), may_use=("simulation",),
          settings=("material", "cost"), blocks=("sheets", "assembly"), quick=True),
)  # fmt: skip
STAGES = {stage.name: stage for stage in TABLE}
# error messages for a missing input of a stage
MISSING = {
    "layout": "There are no panels yet; press Trace first",
    "flat": "There are no flat panels yet; press Merge or Flatten first",
    "choice": "No layouts were compared yet; press Choose first",
    "design": "There are no spirals yet; press Spirals first",
    "optimisation": "Nothing was optimised yet; press Optimise first",
    "simulation": "There is no simulated shape yet; press Simulate first",
    "structure": "Nothing was examined under loads yet; press Check structure first",
    "sheets": "There are no sheets yet; press Export sheets first",
}


# -- derived from the table --------------------------------------------------------------------------------------------


def needed(result: Result, member: str) -> Any:
    """Return a member of a result. Raises ``FlexMapsError`` with the reason if it is None."""
    value = getattr(result, member)
    if value is None:
        raise result.lost.get(member, FlexMapsError(MISSING[member]))
    return value


def missing(result: Result, member: str) -> tuple[str, ...]:
    """Return the names of the stages to run, in order, to get a member of the result; empty if it exists.

    Stages that make something else and only improve the member on the way are left out. Raises ``FlexMapsError`` if the member
    was lost (``Result.lost``).
    """
    if getattr(result, member) is not None:
        return ()
    if member in result.lost:
        raise result.lost[member]
    makers = [
        stage
        for stage in TABLE
        if not stage.asked and (member in stage.makes or (member in stage.improves and not stage.makes))
    ]
    before = [name for stage in makers for need in stage.needs if need != member for name in missing(result, need)]
    wanted = {*before, *(stage.name for stage in makers)}
    return tuple(stage.name for stage in TABLE if stage.name in wanted)


def made_from(members: Iterable[str], after: str = "", *, may_use: bool = True) -> set[str]:
    """Return the members that depend on some members, directly or not.

    Parameters
    ----------
    members : names of members of ``Result``
    after : count only stages after this stage of the table
    may_use : whether a stage's optional inputs count as well
    """
    found, given = set[str](), set(members)
    first = 0 if not after else 1 + TABLE.index(STAGES[after])
    for stage in TABLE[first:]:
        if (given | found).intersection((*stage.needs, *(stage.may_use if may_use else ()))):
            found.update(stage.makes)
    return found


def without(result: Result, members: Iterable[str]) -> Result:
    """Return the result without some members and everything made from them, also records of failed attempts to make them.

    Parameters
    ----------
    result : products of the stages
    members : names of members of ``Result`` to drop
    """
    gone = set(members)
    gone |= made_from(gone)
    if "simulation" in gone and result.sheets is not None and result.sheets.base is not None:
        gone |= {"sheets"} | made_from({"sheets"})  # the base on the sheets fits the simulated shape
    nothing: dict[str, Any] = dict.fromkeys(gone)
    undone = {name: why for name, why in result.undone.items() if not gone.intersection(STAGES[name].makes)}
    lost = {member: why for member, why in result.lost.items() if member not in gone}
    return replace(result, **nothing, undone=undone, lost=lost)


def begun(result: Result, stage: Stage) -> Result:
    """Prepare a result for a stage: drop the stage's former products and everything made from them.

    Parameters
    ----------
    result : products of the stages
    stage : that is to run
    """
    written = stage.makes if stage.keeps else (*stage.makes, *stage.improves)
    kept = {member: getattr(result, member) for member in stage.improves}
    return replace(without(result, {*stage.makes, *made_from(written, stage.name)}), **kept)


def concerned(sections: Iterable[str]) -> set[str]:
    """Return the members made by the stages that depend on some sections of the settings, named as in ``Stage.settings``."""
    named = set(sections)
    return {member for stage in TABLE if named.intersection(stage.settings) for member in stage.makes}


def outdated(result: Result, old: Settings, new: Settings) -> Result:
    """Drop the members that a change of settings makes stale; spirals that stay get the new settings.

    Parameters
    ----------
    result : products of the stages
    old, new : settings before and after the change
    """
    sections = {section for stage in TABLE for section in stage.settings}
    left = without(result, concerned(section for section in sections if _differs(section, old, new)))
    if left.design is not None and new.spiral != old.spiral:
        left = replace(left, design=replace(left.design, params=new.spiral))
    return left


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


def _differs(named: str, old: Settings, new: Settings) -> bool:
    name, but = section_of(named)
    before, now = getattr(old, name, None), getattr(new, name, None)
    if but and before is not None and now is not None:
        now = replace(now, **{one: getattr(before, one) for one in but})
    return bool(before != now)
