"""Class of a row in the table of stages, see ``stages``."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:  # a circular import at run time: the settings import the extras, whose stages import this module
    from ..params import Settings

# sections of the settings that determine the simulated shape
PHYSICS = ("spiral", "material", "simulate", "loads")
SEARCH = ("choose", "optimise")  # sections with the goal and the effort of a search


@dataclass(frozen=True)
class Stage:
    """One step of the main job. Inputs and outputs are named like the properties of ``Result``.

    name : name in progress reports, on the command line and in ``Result.seconds``
    share : fraction of the progress bar; 0 for quick stages
    needs : required inputs; may_use : optional inputs
    makes : outputs that only this stage makes
    replaces : outputs of earlier stages that this stage may replace by better ones for the later stages
    settings : sections of the settings whose change makes the stage's outputs out of date; "spiral!thickness!grain"
        stands for the section "spiral" except for the settings ``thickness`` and ``grain``
    reads : further sections that the stage reads; its outputs stay valid when these change
    blocks : blocks that the stage writes in report.json and in the notes of a .blend file
    asked : whether the stage runs only on request
    optional : whether sheets can be cut without the stage, so that a job goes on if it fails
    quick : whether the stage is so fast that it runs without a request, as soon as its inputs exist
    done : participle for the message when an optional stage fails, such as "optimised" for "Not optimised: ..."
    code : for a stage of an extra, the name (for ``registry.load``) of the module with the stage's ``run``, output,
        plots and report notes; "" for other stages
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
        """Names of the sections in ``settings``, with or without excluded settings."""
        return {section_of(entry)[0] for entry in self.settings}

    def readable(self, settings: Settings) -> Settings:
        """Return settings with only the sections that this row lists; reading another section raises AttributeError.

        settings : all settings
        """
        listed = {*self.sections, *self.reads}
        closed: dict[str, Any] = {
            f.name: _Unlisted(self.name, f.name) for f in fields(settings) if f.name not in listed
        }
        return replace(settings, **closed)


class _Unlisted:
    """Placeholder for a section that a stage's row does not list; every access raises AttributeError."""

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
    """Return the values of the settings in entries of ``Stage.settings``, for comparison with later values.

    Parameters
    ----------
    entries : as in ``Stage.settings``
    settings : present settings; the value of a section that they lack is None
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
