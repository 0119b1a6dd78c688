"""Registry of the extras: a line for each folder, with the modules of operators and panels that work with it alone.

The road from mesh to files imports no extra. It asks here which folders are present, and loads their modules by name; an
extra's stages are in its ``__init__.py``. Taking out a folder takes out its stages, its buttons and its commands; results
in a .blend file stay there.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

from ..errors import FlexMapsError


@dataclass(frozen=True)
class Extra:
    """Line of the registry.

    folder : its folder, below this one
    label : its subject, for the message where the folder is missing
    job, kept : its sections of ``Settings`` and of ``ObjectSettings``; each is the class in its module NAME_params
    needs : folders of other extras without which it does not work
    operators, panels : modules of the folders ``operators`` and ``panels``, which are not registered where it is missing
    """

    folder: str
    label: str
    needs: tuple[str, ...] = ()
    job: tuple[str, ...] = ()
    kept: tuple[str, ...] = ()
    operators: tuple[str, ...] = ()
    panels: tuple[str, ...] = ()


REGISTRY = (
    Extra("choosing", "Comparing layouts", operators=("choose",)),
    Extra("scanning", "Comparing with a scan", operators=("compare",), panels=("built",)),
    Extra("structure", "Checking loads", job=("structure",), operators=("structure",), panels=("loads",)),
    Extra(
        "exploring", "Exploring", needs=("choosing",), kept=("explore",), operators=("explore",), panels=("candidates",)
    ),
    Extra("live", "Live mode", operators=("live",)),
    Extra("film", "The film of the assembly", kept=("film",), operators=("animate",)),
    Extra("assembly_sheet", "The assembly sheet"),
    Extra("together", "Cutting several pieces together", operators=("together",)),
    Extra("calibrating", "Calibrating", operators=("calibrate",)),
)


def _extra(folder: str) -> Extra:
    return next(extra for extra in REGISTRY if extra.folder == folder)


@cache
def has(folder: str) -> bool:
    """Return whether the folder of an extra is present, and those that it needs."""
    present = (Path(__file__).parent / folder / "__init__.py").is_file()
    return present and all(has(other) for other in _extra(folder).needs)


def need(folder: str) -> None:
    """Raise ``FlexMapsError`` where the folder of an extra is missing."""
    if not has(folder):
        raise FlexMapsError(f"{_extra(folder).label} is not part of this copy of FlexMaps; install the whole extension")


def load(module: str) -> Any:
    """Return a module of an extra, named from here on, such as "structure.cases"."""
    return import_module(f"{__package__}.{module}")


def missing_modules(kind: str) -> set[str]:
    """Return the modules that are not to be registered.

    Parameters
    ----------
    kind : "operators" or "panels"
    """
    return {name for extra in REGISTRY if not has(extra.folder) for name in getattr(extra, kind)}


def sections(settings: str) -> dict[str, type]:
    """Return the classes of the extras' sections by name.

    Parameters
    ----------
    settings : "Settings" or "ObjectSettings"
    """
    kind = {"Settings": "job", "ObjectSettings": "kept"}[settings]
    present = [(extra.folder, name) for extra in REGISTRY if has(extra.folder) for name in getattr(extra, kind)]
    return {name: getattr(load(f"{folder}.{name}_params"), f"{name.title()}Params") for folder, name in present}


def stages() -> dict[str, tuple[Any, ...]]:
    """Return the rows of the table of stages by extra; an extra that is missing, or has no stage, has none."""
    return {extra.folder: getattr(load(extra.folder), "STAGES", ()) if has(extra.folder) else () for extra in REGISTRY}
