"""What is advised for an object, and what following it has brought; both in its notes, beside what limits the match."""

from __future__ import annotations

from typing import Any

import bpy

from ...engine.materials import STRAINED
from ...engine.optimisation import remedies
from ...engine.optimisation.remedies import FINER, LARGER, THINNER, Amounts
from . import notes
from .i18n import translate

BROUGHT = "brought"  # in the block "reach"
NEARER = 0.98  # share of the distance that may be left if it shall count as nearer; not measured
FIGURES = ("rms_percent", "strain_share_max", "slots_closed")  # of the block "equilibrium", before and after


def of(mesh: bpy.types.Mesh) -> Amounts:
    """What a button can do of the last advice, and how much of it; empty where there is none."""
    block = notes.read(mesh).get("reach")
    return {} if block is None else remedies.of_block(block)


def unadvised(mesh: bpy.types.Mesh, remedy: str) -> str | None:
    """Why a remedy is not to be pressed, as a sentence; None where it is advised."""
    if "reach" not in notes.read(mesh):
        return translate("It is not known yet what limits the match; press Simulate first")
    return None if remedy in of(mesh) else translate("The advice under Optimise is another one")


def compared(remedy: str, was: float, now: float, before: dict[str, Any], after: dict[str, Any]) -> dict[str, Any]:
    """The note of what a remedy has brought.

    was, now : what was changed, in the unit of its amount; before, after : blocks of the simulated shapes
    """
    pairs = {name: [before.get(name), after.get(name)] for name in FIGURES}
    return {"remedy": remedy, "was": was, "now": now, **pairs}


def helped(brought: dict[str, Any]) -> bool:
    """Whether the shape came clearly nearer, a strain beyond its limit fell, or fewer slots close than before."""
    far, near = brought["rms_percent"]
    strain, eased = brought["strain_share_max"]
    relieved = strain is not None and eased is not None and strain > STRAINED and eased < strain
    closed, left = _closed(brought)
    return bool(near < NEARER * far or relieved or left < closed)


def _closed(brought: dict[str, Any]) -> tuple[int, int]:
    """How many slots closed before and after; 0 and 0 where notes do not tell, as older ones."""
    before, after = brought.get("slots_closed") or (None, None)
    return (0, 0) if before is None or after is None else (before, after)


def said(brought: dict[str, Any]) -> str:
    """The same as a line for people, as far as it is known."""
    was, now = brought["was"], brought["now"]
    done = {
        LARGER: translate("{:.4g} times as large", now / was),
        THINNER: translate("Sheet of {:g} mm instead of {:g} mm", now, was),
        FINER: translate("{:.0f} quads instead of {:.0f}", now, was),
    }[brought["remedy"]]
    distance, strain, closed = brought["rms_percent"], brought["strain_share_max"], _closed(brought)
    if None in strain:
        line = translate("{}: RMS distance {:.2g} % to {:.2g} %", done, *distance)
    else:
        shares = (100 * share for share in strain)
        text = "{}: RMS distance {:.2g} % to {:.2g} %, strain {:.0f} % to {:.0f} % of its limit"
        line = translate(text, done, *distance, *shares)
    if closed[0] != closed[1]:
        line = translate("{}, closed slots {} to {}", line, *closed)
    return line if helped(brought) else f"{line}. {translate('It brought nothing; undo takes it back')}"
