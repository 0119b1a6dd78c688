"""Checks the shapes of arrays that the annotations of the engine promise, at every call that a test makes.

``Float[np.ndarray, "quads 4 3"]`` is a type for mypy alone: the program never evaluates it, and needs no jaxtyping. Here every
function, method and dataclass with such an annotation is replaced by one that checks what goes in and what comes out.
"""

from __future__ import annotations

import builtins
import functools
import importlib
import inspect
import sys
import types
import typing
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import is_dataclass
from pathlib import Path
from typing import Any

import jaxtyping
import numpy as np
from jaxtyping import AbstractArray, jaxtyped

KINDS = {name: getattr(jaxtyping, name) for name in ("Bool", "Complex", "Float", "Int", "Num", "Shaped")}
FEW = 4  # members of a long sequence that are looked at
ROOT = Path(__file__).resolve().parent.parent


_paused: list[bool] = []


@contextmanager
def paused() -> Iterator[None]:
    """Nothing is checked meanwhile: for what counts the program's own calls."""
    _paused.append(True)
    try:
        yield
    finally:
        _paused.pop()


class _Names(dict[str, Any]):
    """Names of an annotation: jaxtyping's, the module's own, and ``Any`` for what is imported for types alone."""

    def __missing__(self, name: str) -> Any:
        if name.startswith("__"):  # pytest asks for such a one in every frame of a traceback
            raise KeyError(name)
        return getattr(builtins, name, Any)


def watch(*folders: str) -> None:
    """Import the modules below these folders of the package, and check the shapes of everything in them from now on."""
    modules = []
    for folder in folders:
        for path in sorted((ROOT / folder).rglob("*.py")):
            parts = path.relative_to(ROOT).with_suffix("").parts
            if parts[-1] not in ("__init__", "worker", "build"):
                modules.append(importlib.import_module(".".join(("flexmaps", *parts))))
    replaced: dict[int, Callable[..., Any]] = {}
    for module in modules:
        for value in list(vars(module).values()):
            if getattr(value, "__module__", None) != module.__name__:
                continue
            if isinstance(value, types.FunctionType):
                replaced[id(value)] = _checked(value, vars(module))
            elif isinstance(value, type):
                _watch_class(value, vars(module))
    # also where other modules have imported a function by its name
    for module in list(sys.modules.values()):
        if getattr(module, "__name__", "").startswith("flexmaps"):
            for name, value in list(vars(module).items()):
                if isinstance(value, types.FunctionType) and id(value) in replaced:
                    setattr(module, name, replaced[id(value)])


def _watch_class(cls: type, names: Mapping[str, Any]) -> None:
    for name, value in list(vars(cls).items()):
        if isinstance(value, types.FunctionType) and name != "__init__":
            setattr(cls, name, _checked(value, names))
        elif isinstance(value, staticmethod | classmethod):
            setattr(cls, name, type(value)(_checked(value.__func__, names)))
        elif isinstance(value, property) and value.fget is not None:
            setattr(cls, name, property(_checked(value.fget, names), value.fset, value.fdel, value.__doc__))
        elif isinstance(value, functools.cached_property):
            value.func = _checked(value.func, names)
    hints = _hints(getattr(cls, "__annotations__", {}), names) if is_dataclass(cls) else {}
    if hints:
        plain = cls.__init__  # type: ignore[misc]
        fitting: set[tuple[Any, ...]] = set()

        @functools.wraps(plain)
        def init(self: Any, *args: Any, **kwargs: Any) -> None:
            plain(self, *args, **kwargs)
            if _paused:
                return
            kind = tuple([_kind(getattr(self, name)) for name in hints])
            if kind in fitting:
                return
            with jaxtyped("context"):
                for name, hint in hints.items():
                    _demand(getattr(self, name), hint, f"{cls.__module__}.{cls.__name__}.{name}")
            fitting.add(kind)

        cls.__init__ = init  # type: ignore[misc]


def _checked(function: Callable[..., Any], names: Mapping[str, Any]) -> Callable[..., Any]:
    """The function with its shapes checked; itself where it promises none."""
    hints = _hints(getattr(function, "__annotations__", {}), names)
    if not hints:
        return function
    result = None if inspect.isgeneratorfunction(function) else hints.pop("return", None)
    order = function.__code__.co_varnames[: function.__code__.co_argcount]
    who = f"{function.__module__}.{function.__qualname__}"
    fitting: set[tuple[Any, ...]] = set()

    @functools.wraps(function)
    def checked(*args: Any, **kwargs: Any) -> Any:
        if _paused:
            return function(*args, **kwargs)
        given = {**dict(zip(order, args)), **kwargs}
        kind = tuple([_kind(given.get(name, ...)) for name in hints])
        if kind not in fitting:
            with jaxtyped("context"):
                _demand_arguments(given, hints, who)
            fitting.add(kind)
        value = function(*args, **kwargs)
        if result is not None and (whole := (*kind, _kind(value))) not in fitting:
            with jaxtyped("context"):  # sizes agree with those of the arguments
                _demand_arguments(given, hints, who)
                _demand(value, result, f"{who}: what it returns")
            fitting.add(whole)
        return value

    return checked


def _kind(value: Any) -> Any:
    """All that the check of a value looks at: what was found to fit once need not be looked at again."""
    if isinstance(value, np.ndarray):
        return value.shape, value.dtype.char
    if isinstance(value, tuple):
        return (tuple, *map(_kind, value))
    if isinstance(value, list):
        return (list, *map(_kind, value[:FEW]))
    return type(value)


def _demand_arguments(given: Mapping[str, Any], hints: Mapping[str, Any], who: str) -> None:
    for name, hint in hints.items():
        if name in given:
            _demand(given[name], hint, f"{who}: {name}")


def _hints(annotations: Mapping[str, Any], names: Mapping[str, Any]) -> dict[str, Any]:
    """The annotations that promise a shape, evaluated."""
    known = _Names(vars(typing) | dict(names) | KINDS)
    return {
        name: eval(text, {}, known)
        for name, text in annotations.items()
        if isinstance(text, str) and any(kind + "[" in text for kind in KINDS)
    }


def _demand(value: Any, hint: Any, what: str) -> None:
    if not _fits(value, hint):
        raise TypeError(f"{what} should be {_told(hint)} and is {_seen(value)}")


def _fits(value: Any, hint: Any) -> bool:
    origin, members = typing.get_origin(hint), typing.get_args(hint)
    if isinstance(hint, type) and issubclass(hint, AbstractArray):
        return isinstance(value, hint)
    if origin in (typing.Union, types.UnionType):
        return any(_fits(value, member) for member in members)
    if origin is tuple and isinstance(value, tuple):
        if members[-1] is Ellipsis:
            return all(_fits(one, members[0]) for one in value[:FEW])
        return len(value) == len(members) and all(map(_fits, value, members))
    if isinstance(origin, type) and len(members) == 1 and isinstance(value, list | tuple):
        return all(_fits(one, members[0]) for one in value[:FEW])
    if hint is type(None):
        return value is None
    return not isinstance(value, np.ndarray) or hint is Any or hint is np.ndarray or isinstance(hint, typing.TypeVar)


def _told(hint: Any) -> str:
    return " or ".join(_parts(hint))


def _parts(hint: Any) -> Iterator[str]:
    if typing.get_origin(hint) in (typing.Union, types.UnionType):
        for member in typing.get_args(hint):
            yield from _parts(member)
    else:
        yield getattr(hint, "__name__", str(hint))


def _seen(value: Any) -> str:
    if isinstance(value, np.ndarray):
        return f"an array of {value.dtype} and shape {value.shape}"
    if isinstance(value, tuple):
        return f"({', '.join(map(_seen, value))})"
    return type(value).__name__
