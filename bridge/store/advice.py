"""The optimiser's advice for an object and the effect of following it, stored in the report block "reach"."""

from __future__ import annotations

from typing import Any

import bpy

from ...engine.figures import format_figure
from ...engine.materials import OVERSTRAIN_SHARE
from ...engine.optimisation import remedies
from ...engine.optimisation.remedies import FINER, LARGER, THINNER, Amounts
from . import stored_report
from .i18n import translate

EFFECT = "brought"  # key in the report block "reach": effect of the last applied remedy
# ratio of the RMS distances after and before up to which the shape counts as nearer; repeated searches of a piece
# differ by up to 3 %, so larger would take chance for success
NEARER_RATIO = 0.97
FIGURES = ("rms_percent", "strain_share_max", "slots_closed")  # keys of "equilibrium" to compare before and after


def read_advice(mesh: bpy.types.Mesh) -> Amounts:
    """Return remedy -> amount for the last advice's remedies that a button can apply; empty without advice."""
    block = stored_report.read(mesh).get("reach")
    return {} if block is None else remedies.read_block(block)


def refusal(mesh: bpy.types.Mesh, remedy: str) -> str | None:
    """Return a sentence that says why a remedy cannot be applied; None where it is advised.

    Parameters
    ----------
    mesh : Blender's mesh, which stores the report
    remedy : name of the remedy
    """
    if "reach" not in stored_report.read(mesh):
        return translate("It is not known yet what limits the match; press Simulate first")
    return (
        None
        if remedy in read_advice(mesh)
        else translate("This advice is out of date; see the present advice under Optimise")
    )


def effect_of(
    remedy: str, old_value: float, new_value: float, before: dict[str, Any], after: dict[str, Any]
) -> dict[str, Any]:
    """Return the effect of a remedy, to be stored in the report.

    Parameters
    ----------
    remedy : the remedy that was applied
    old_value, new_value : the changed quantity before and after, in the unit of the remedy's amount
    before, after : report blocks "equilibrium" before and after the remedy
    """
    pairs = {name: [before.get(name), after.get(name)] for name in FIGURES}
    return {"remedy": remedy, "was": old_value, "now": new_value, **pairs}


def has_helped(effect: dict[str, Any]) -> bool:
    """Return whether the shape came clearly nearer, an excessive strain fell, or fewer slots close."""
    far, near = effect["rms_percent"]
    strain, eased = effect["strain_share_max"]
    relieved = strain is not None and eased is not None and strain > OVERSTRAIN_SHARE and eased < strain
    closed, left = _closed_slots(effect)
    return bool(near < NEARER_RATIO * far or relieved or left < closed)


def _closed_slots(effect: dict[str, Any]) -> tuple[int, int]:
    """Return the number of closed slots before and after; (0, 0) where an older version stored none."""
    before, after = effect.get("slots_closed") or (None, None)
    return (0, 0) if before is None or after is None else (before, after)


def describe_effect(effect: dict[str, Any]) -> str:
    """Return a line about a remedy's effect for the user."""
    was, now = effect["was"], effect["now"]
    done = {
        LARGER: translate("{:.4g} times as large", now / was),
        THINNER: translate("Sheet of {:g} mm instead of {:g} mm", now, was),
        FINER: translate("{:.0f} quads instead of {:.0f}", now, was),
    }[effect["remedy"]]
    distance = [format_figure(percent) for percent in effect["rms_percent"]]
    strain, closed = effect["strain_share_max"], _closed_slots(effect)
    if None in strain:
        line = translate("{}: RMS distance {} % to {} %", done, *distance)
    else:
        shares = (100 * share for share in strain)
        text = "{}: RMS distance {} % to {} %, strain {:.0f} % to {:.0f} % of its limit"
        line = translate(text, done, *distance, *shares)
    if closed[0] != closed[1]:
        line = translate("{}, closed slots {} to {}", line, *closed)
    return line if has_helped(effect) else f"{line}. {translate('It did not help; undo takes it back')}"
