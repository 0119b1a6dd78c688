"""Registry of the optional features (extras): one entry for each folder, with its operator and panel modules.

The main job, from mesh to cutting files, imports no extra. It asks this module which folders are present and loads
their modules by name; an extra's stages are listed in its ``__init__.py``. Removing a folder removes its stages,
buttons and commands; results already stored in a .blend file remain.
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
    """Entry of the registry.

    folder : name of the extra's folder in ``engine/extras``
    label : the feature in words, for the error message if the folder is missing
    job, kept : sections that the extra adds to ``Settings`` and to ``ObjectSettings``; section NAME is the class
        NameParams in the module NAME_params
    needs : folders of other extras without which this extra does not work
    operators, panels : modules in ``operators`` and ``panels`` that are not registered if the extra is missing
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
    """Return whether an extra's folder, and the folders of all extras that it needs, are present."""
    present = (Path(__file__).parent / folder / "__init__.py").is_file()
    return present and all(has(other) for other in _extra(folder).needs)


def need(folder: str) -> None:
    """Raise ``FlexMapsError`` if the folder of an extra, or of an extra that it needs, is missing."""
    if not has(folder):
        raise FlexMapsError(f"{_extra(folder).label} is not part of this copy of FlexMaps; install the whole extension")


def load(module: str) -> Any:
    """Import a module of an extra by its name below ``engine.extras``, such as "structure.cases"."""
    return import_module(f"{__package__}.{module}")


def missing_modules(kind: str) -> set[str]:
    """Return the operator or panel modules not to register, because their extra is missing.

    Parameters
    ----------
    kind : "operators" or "panels"
    """
    return {name for extra in REGISTRY if not has(extra.folder) for name in getattr(extra, kind)}


def sections(settings: str) -> dict[str, type]:
    """Return the settings sections that the present extras add: class by section name.

    Parameters
    ----------
    settings : "Settings" or "ObjectSettings"
    """
    kind = {"Settings": "job", "ObjectSettings": "kept"}[settings]
    present = [(extra.folder, name) for extra in REGISTRY if has(extra.folder) for name in getattr(extra, kind)]
    return {name: getattr(load(f"{folder}.{name}_params"), f"{name.title()}Params") for folder, name in present}


def stages() -> dict[str, tuple[Any, ...]]:
    """Return the stages of each extra by folder name; an empty tuple if the extra is missing or has no stage."""
    return {extra.folder: getattr(load(extra.folder), "STAGES", ()) if has(extra.folder) else () for extra in REGISTRY}
