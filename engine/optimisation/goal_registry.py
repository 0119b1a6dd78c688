"""Find the goals: additional terms of the objective, one in each module of the folder ``goals`` (docs/extend.md)."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from importlib import import_module
from pkgutil import iter_modules
from typing import Any

from .terms import Term

Maker = Callable[[Any], Term | None]


def goals_of(point: Any) -> tuple[Term, ...]:
    """Return the goals at a ``DesignPoint``; leave out goals that do not apply to its problem."""
    return tuple(term for make in makers() if (term := make(point)) is not None)


@cache
def makers() -> tuple[Maker, ...]:
    """Return the function ``goal`` of every module of the folder, in the order of their names."""
    folder = import_module(f"{__package__}.goals")
    names = sorted(module.name for module in iter_modules(folder.__path__))
    return tuple(import_module(f"{folder.__name__}.{name}").goal for name in names)
