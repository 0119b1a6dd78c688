"""Row of the table of stages, see ``stages``."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:  # the settings take the extras' sections, and the rows of their stages lie beside these
    from ..params import Settings

# sections of the settings that the shape at rest depends on
PHYSICS = ("spiral", "material", "simulate", "loads")
SEARCH = ("choose", "optimise")  # sections that say how to search, and what match is wanted


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
    code : for a stage of an extra the module with its ``run``, output, plots and notes of the report, as ``registry.load`` takes it
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
    code: str = ""

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
