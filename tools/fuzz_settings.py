"""Fuzzing of settings and of the command line, each case generated from its number."""

from __future__ import annotations

import contextlib
import io
import random
from dataclasses import fields
from typing import Any

from flexmaps.command import arguments, sources
from flexmaps.engine.errors import FlexMapsError
from flexmaps.engine.params import SHOWN, ObjectSettings, sections, values_in_shown_units, with_values

ODD: tuple[Any, ...] = (
    "", " ", "nan", "inf", "-inf", "1e999", "-1e999", "1e-400", "1_0", "\uff11\uff10", "\u0661", "0x10", "1,5", "1/2", "2 mm", "true",
    "on", "no", "None", "x" * 10_000, "9" * 5_000, "9" * 20, "-0", "+5", "1e5", "\0", "\n", "\ud800", None, True, False, 0, -1, 1.5,
    10**400, float("nan"), float("inf"), [], {}, (), 1j, b"1", object(),
)  # fmt: skip
NAMES = [(section, f) for section, kind in sections(ObjectSettings).items() for f in fields(kind)]  # type: ignore[arg-type]


def _value(rng: random.Random, f: Any) -> Any:
    """A value for a setting: of its range, at its ends, or none at all."""
    meta = f.metadata
    if rng.random() < 0.4:
        return rng.choice(ODD)
    if meta["choices"]:
        return rng.choice([choice[0] for choice in meta["choices"]])
    if isinstance(f.default, bool | str):
        return rng.choice((True, False, "on", "off", "x"))
    factor = SHOWN[meta["unit"]][0]
    low, high = (-5.0 if meta[k] is None else meta[k] * factor for k in ("low", "high"))
    value = rng.choice((low, high, rng.uniform(low, high), low - abs(low) - 1e-9, high * 1.01))
    if isinstance(f.default, int) and rng.random() < 0.9:
        value = int(value)
    return rng.choice((value, str(value), f"{value:g}"))


def _case(number: int) -> tuple[dict[str, Any], list[str]]:
    """Settings as a script gives them, and words of a command line."""
    rng = random.Random(number)
    given: dict[str, Any] = {}
    for _ in range(rng.choice((1, 1, 2, 4))):
        section, f = rng.choice(NAMES)
        name = rng.choice(
            (f"{section}.{f.name}",) * 8 + (f.name, f"{section}.", f".{f.name}", f"{section}.{f.name}.x", "")
        )
        given[name] = _value(rng, f)
    words = [rng.choice(("run", "check", "layout", "export", "settings", "")), "shape:strip"]
    for _ in range(rng.choice((1, 2, 3))):
        section, f = rng.choice(NAMES)
        flag = f"--{f.name}".replace("_", "-")
        value = str(_value(rng, f)).encode("utf-8", "replace").decode()
        words += rng.choice((
            [flag, value], [f"--{section}{flag[1:]}", value], ["--set", f"{section}.{f.name}={value}"], ["--set", value],
            ["--edge", value], ["--height", value], ["--remesh", value], ["--supports", value], [flag], ["--out", value or "x"],
        ))  # fmt: skip
    return given, words


def play(number: int, whole: bool) -> str:
    """Both must be taken or refused in one line; what is taken can be shown and given back."""
    given, words = _case(number)
    outcome = "taken"
    try:
        made = with_values(ObjectSettings(), given)
        assert with_values(ObjectSettings(), _flat(made)).sheet.sheet_width > 0
    except FlexMapsError as error:
        assert str(error).strip()
        assert len(str(error)) < 1000
        assert "\n" not in str(error)
        outcome = "refused"
    told = io.StringIO()
    try:
        with contextlib.redirect_stderr(told), contextlib.redirect_stdout(told):
            args = arguments.make_parser().parse_args(words)
            if args.command != "settings":
                with_values(ObjectSettings(), sources.parse_settings(args))
    except FlexMapsError:
        return f"{outcome}, words refused"
    except SystemExit as end:
        assert end.code in (0, 2)
        return f"{outcome}, words refused"
    return f"{outcome}, words taken"


def _flat(settings: ObjectSettings) -> dict[str, Any]:
    return {
        f"{s}.{name}": value for s, block in values_in_shown_units(settings).items() for name, value in block.items()
    }


def described(number: int) -> str:
    """The settings and the words."""
    return repr(_case(number))[:3000]
