"""The one table of the stages: what each goes on from, what it makes, and which settings concern it.

The main job, the scripts' functions, the command line, Blender's operators, the sidebar's states and the notes in a .blend
file all follow from it. What a change makes out of date is found by following the table downwards: a stage's result
depends on what it ``needs``, and so on whatever that was made from. ``steps`` has what each stage does; this page imports
nothing heavy, so that a sidebar can be drawn without the numerics.
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
    """One step of the main job; all names are those of members of ``Result``.

    name : as progress, command line and ``Result.seconds`` have it
    share : of the progress bar; 0 for a quick one
    needs : what it goes on from; may_use : what it looks at where it is there
    makes : what it makes; improves : what it was given and gives back better, so that later stages begin with that
    settings : sections of the settings that its result depends on; "spiral!thickness!grain" is a section but for some settings
    blocks : what it tells of itself in report.json and in the notes of a .blend file
    asked : it runs only if it is asked for; optional : sheets can be cut without it, so that its failure does not end a job
    quick : it takes so little time that it is done whenever it can be; nobody asks for it by name
    keeps : it may leave what it improves as it was; its step then keeps what was made from that, and drops it otherwise
    done : what a piece is after it, for what is told where an optional one fails
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
        """The sections of the settings that concern it, wholly or but for some settings."""
        return {section_of(named)[0] for named in self.settings}


def section_of(named: str) -> tuple[str, tuple[str, ...]]:
    """A section of the settings as ``Stage.settings`` names it, and the settings that are left out of it."""
    section, *but = named.split("!")
    return section, tuple(but)


# -- the table ---------------------------------------------------------------------------------------------------------

# Every spiral knows the thickness of its sheet and its grain, but no line of its outline depends on them: they concern what
# comes after.
# What the optimiser's own settings say is how to search; a result stays true whatever they become.
# Under feet arms are straight, at eyelets they are wide; how large either is does not matter to the spirals.
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
# why a stage cannot go on, where what it needs is not there
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


# -- what follows from it ----------------------------------------------------------------------------------------------


def needed(result: Result, member: str) -> Any:
    """A member of a result that has to be there. Raises ``FlexMapsError`` with the reason why it is not."""
    value = getattr(result, member)
    if value is None:
        raise result.lost.get(member, FlexMapsError(MISSING[member]))
    return value


def missing(result: Result, member: str) -> tuple[str, ...]:
    """The stages that have to run, in their order, until a member of the result is there.

    A stage that makes something else, and improves the member on the way, is not one of them. Raises ``FlexMapsError`` where it was there, but cannot be used any more.
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
    """The members that are made from some of these, directly or not, by the stages that come ``after`` one of the table.

    may_use : whether what only looked at them counts too
    """
    found, given = set[str](), set(members)
    first = 0 if not after else 1 + TABLE.index(STAGES[after])
    for stage in TABLE[first:]:
        if (given | found).intersection((*stage.needs, *(stage.may_use if may_use else ()))):
            found.update(stage.makes)
    return found


def without(result: Result, members: Iterable[str]) -> Result:
    """The result without some of its members and all that was made from them, or that could not be."""
    gone = set(members)
    gone |= made_from(gone)
    if "simulation" in gone and result.sheets is not None and result.sheets.base is not None:
        gone |= {"sheets"} | made_from({"sheets"})  # a base stands under the simulated shape
    nothing: dict[str, Any] = dict.fromkeys(gone)
    undone = {name: why for name, why in result.undone.items() if not gone.intersection(STAGES[name].makes)}
    lost = {member: why for member, why in result.lost.items() if member not in gone}
    return replace(result, **nothing, undone=undone, lost=lost)


def begun(result: Result, stage: Stage) -> Result:
    """The result as a stage finds it that runs now: without what it makes itself, and what was made from that."""
    written = stage.makes if stage.keeps else (*stage.makes, *stage.improves)
    kept = {member: getattr(result, member) for member in stage.improves}
    return replace(without(result, {*stage.makes, *made_from(written, stage.name)}), **kept)


def concerned(sections: Iterable[str]) -> set[str]:
    """The members that are made by stages which some sections of the settings concern, as ``Stage.settings`` names them."""
    named = set(sections)
    return {member for stage in TABLE if named.intersection(stage.settings) for member in stage.makes}


def outdated(result: Result, old: Settings, new: Settings) -> Result:
    """The result without what a change of settings makes out of date; the spirals that stay are told of the change."""
    sections = {section for stage in TABLE for section in stage.settings}
    left = without(result, concerned(section for section in sections if _differs(section, old, new)))
    if left.design is not None and new.spiral != old.spiral:
        left = replace(left, design=replace(left.design, params=new.spiral))
    return left


# -- the same of the blocks of report.json, which a .blend file keeps as notes -----------------------------------------

BLOCKS = tuple(dict.fromkeys(block for stage in TABLE for block in stage.blocks))


def writers(block: str) -> tuple[Stage, ...]:
    """The stages that write a block."""
    return tuple(stage for stage in TABLE if block in stage.blocks)


def blocks_of(members: Iterable[str]) -> set[str]:
    """The blocks that tell of some members."""
    named = set(members)
    return {block for stage in TABLE if named.intersection(stage.makes) for block in stage.blocks}


def blocks_after(block: str) -> set[str]:
    """The blocks that a new one makes out of date, itself left out."""
    members = {member for stage in writers(block) for member in stage.makes}
    return blocks_of(made_from(members, may_use=False)) - {block}


def ingredients(members: Iterable[str]) -> set[str]:
    """These members, and all that they are made from."""
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
