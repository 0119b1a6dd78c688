"""All settings in one dataclass, and functions that set them to values from users."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import Field, dataclass, field, fields, replace
from numbers import Integral
from os import PathLike
from typing import Any, TypeVar

from ..errors import FlexMapsError
from ..extras import registry
from .fields import SHOWN, Params, describe_numbers, is_number, quote, refuse_if_above
from .physics import LoadParams, MaterialParams, OptimiseParams, SimulateParams
from .pictures import PageParams, PreviewParams, RenderParams
from .production import BaseParams, CostParams, CutParams, ExportParams, SheetParams
from .spiral_params import ConnectorParams, SpiralParams
from .surface_params import ChooseParams, LayoutParams, RegulariseParams, RemeshParams

P = TypeVar("P", bound=Params)


def _with_extras(cls: type) -> type:
    """Add the extras' sections as fields to ``Settings`` or ``ObjectSettings``, before it becomes a dataclass."""
    for name, kind in registry.sections(cls.__name__).items():
        cls.__annotations__[name] = kind
        setattr(cls, name, field(default_factory=kind))
    return cls


@dataclass(frozen=True)
@_with_extras
class Settings:
    """All settings of the main job, by section; the extras in ``engine/extras`` add sections of their own."""

    regularise: RegulariseParams = field(default_factory=RegulariseParams)
    layout: LayoutParams = field(default_factory=LayoutParams)
    choose: ChooseParams = field(default_factory=ChooseParams)
    spiral: SpiralParams = field(default_factory=SpiralParams)
    connect: ConnectorParams = field(default_factory=ConnectorParams)
    cut: CutParams = field(default_factory=CutParams)
    sheet: SheetParams = field(default_factory=SheetParams)
    base: BaseParams = field(default_factory=BaseParams)
    cost: CostParams = field(default_factory=CostParams)
    material: MaterialParams = field(default_factory=MaterialParams)
    simulate: SimulateParams = field(default_factory=SimulateParams)
    optimise: OptimiseParams = field(default_factory=OptimiseParams)

    def section(self, kind: type[P]) -> P:
        """Return the section of a class; type checkers do not know sections of extras as attributes."""
        return next(block for f in fields(self) if isinstance(block := getattr(self, f.name), kind))


# pairs of settings of different sections: the first must not be larger than the second; and the advice in the error
# message if it is
ORDERED_ACROSS_SECTIONS = (
    ("cut.kerf_outline", "sheet.spacing", "the panels lie too close together for the cutter; make the spacing larger"),
    ("cut.mill", "sheet.spacing", "the panels lie too close together for the mill; make the spacing larger"),
    ("cut.kerf_outline", "spiral.slot_min", "the cutter leaves no such slot; make the smallest slot at least as wide"),
    ("cut.kerf_holes", "spiral.slot_min", "the cutter leaves no such slot; make the smallest slot at least as wide"),
    ("cut.mill", "spiral.slot_min", "the mill does not fit into such a slot; make the smallest slot at least as wide"),
)


def refuse_crossed(blocks: Mapping[str, Params], sections: Collection[str]) -> None:
    """Raise FlexMapsError if two settings of different sections violate ``ORDERED_ACROSS_SECTIONS``.

    Parameters
    ----------
    blocks : settings by section
    sections : names of the sections to check; pairs without a setting in these are ignored
    """
    for low, high, remedy in ORDERED_ACROSS_SECTIONS:
        (block, name), (other, limit) = low.split("."), high.split(".")
        if {block, other} <= blocks.keys() and not {block, other}.isdisjoint(sections):
            refuse_if_above(blocks[block], name, blocks[other], limit, remedy)


@dataclass(frozen=True)
@_with_extras
class ObjectSettings(Settings):
    """All settings that are stored with an object in Blender."""

    loads: LoadParams = field(default_factory=LoadParams)
    remesh: RemeshParams = field(default_factory=RemeshParams)
    export: ExportParams = field(default_factory=ExportParams)
    preview: PreviewParams = field(default_factory=PreviewParams)
    render: RenderParams = field(default_factory=RenderParams)
    page: PageParams = field(default_factory=PageParams)


S = TypeVar("S", bound=Settings)


def with_values(settings: S, values: Mapping[str, Any]) -> S:
    """Return settings with some values changed.

    Parameters
    ----------
    settings : the present settings
    values : new values by "section.name", in shown units (millimetres, degrees), as numbers or as text

    Raises
    ------
    FlexMapsError : there is no such setting, or it cannot have the value
    """
    blocks: dict[str, dict[str, Any]] = {}
    for key, value in values.items():
        section, _, name = key.partition(".")
        block = getattr(settings, section, None)
        if not isinstance(block, Params):
            names = ", ".join(f.name for f in fields(settings))
            raise FlexMapsError(
                f"There is no setting {quote(key)}; give it as section.name, with one of the sections {names}"
            )
        known = {f.name: f for f in fields(block)}  # type: ignore[arg-type]
        if name in block.WERE:
            instead = {} if _parse_switch(name, value) else block.WERE[name]
            blocks.setdefault(section, {}).update(instead)
            continue
        if name in block.GONE:
            continue
        if name not in known:
            raise FlexMapsError(f"There is no setting {quote(key)}; the settings of {section} are {', '.join(known)}")
        blocks.setdefault(section, {})[name] = _from_shown(known[name], value)
    made = {section: _replace_values(section, getattr(settings, section), given) for section, given in blocks.items()}
    return replace(settings, **made)


def goal_values(*, goal: str | None = None, panels: Any = None, match: Any = None) -> dict[str, Any]:
    """Return values for ``with_values`` that set the goal of a layout.

    Parameters
    ----------
    goal : value of ``ChooseParams.goal``; None for "panels" or "match", whichever argument is given
    panels : largest number of panels
    match : wanted RMS distance from the target, in percent of the size
    """
    named = goal or ("panels" if panels is not None else "match" if match is not None else None)
    values = {"choose.goal": named, "choose.panels": panels, "choose.match": match}
    return {name: value for name, value in values.items() if value is not None}


def _replace_values(section: str, block: Any, given: dict[str, Any]) -> Any:
    """Replace values in a section of the settings; error messages name the section."""
    try:
        return replace(block, **given)
    except FlexMapsError as error:
        raise FlexMapsError(f"In the settings of {section}: {error}") from None


def values_in_shown_units(settings: Settings) -> dict[str, dict[str, Any]]:
    """Return all settings in shown units, by section and name."""
    return {
        block.name: {
            f.name: _as_shown(f, getattr(getattr(settings, block.name), f.name))
            for f in fields(getattr(settings, block.name))
        }
        for block in fields(settings)
    }


def sections(kind: type) -> dict[str, type[Params]]:
    """Return the classes of the sections of ``Settings`` or ``ObjectSettings``, by section name."""
    return {block.name: block.default_factory for block in fields(kind)}  # type: ignore[misc]


def every_setting(kind: type) -> Iterator[tuple[str, Field]]:
    """Yield all settings of ``Settings`` or ``ObjectSettings``, each as "section.name" with its field."""
    for name, section in sections(kind).items():
        yield from ((f"{name}.{f.name}", f) for f in fields(section))  # type: ignore[arg-type]


def _as_shown(f: Field, value: Any) -> Any:
    """Convert a field's SI value to its shown unit, without the digits of rounding errors."""
    return float(f"{value * SHOWN[f.metadata['unit']][0]:.9g}") if isinstance(value, float) else value


ON_OFF_WORDS = {"true": True, "yes": True, "on": True, "1": True, "false": False, "no": False, "off": False, "0": False}


def _parse_switch(label: str, value: Any) -> bool:
    """Convert a user's value of a switch, such as "on" or 0, to True or False."""
    if not isinstance(value, bool | str | Integral) or str(value).lower() not in ON_OFF_WORDS:
        raise FlexMapsError(f"{label} {quote(value)}: give on or off")
    return ON_OFF_WORDS[str(value).lower()]


def _from_shown(f: Field, value: Any) -> Any:
    """Convert a user's value of a field, a number or text in its shown unit, to SI units."""
    default, label = f.default, f.metadata["label"]
    if isinstance(default, str):
        return str(value) if isinstance(value, PathLike) else value
    if isinstance(default, bool):
        return _parse_switch(label, value)
    number = value
    # ``float`` also accepts digits of other scripts and underscores between digits
    if isinstance(value, str) and value.isascii() and "_" not in value:
        try:
            number = float(value)
        except ValueError:
            number = None
    if not is_number(number):
        raise FlexMapsError(f"{label} {quote(value)}: give {describe_numbers(f)}")
    if not isinstance(default, int):
        return float(number) / SHOWN[f.metadata["unit"]][0]
    if number != int(number):
        raise FlexMapsError(f"{label} {quote(value)}: give {describe_numbers(f)}")
    return int(number)
