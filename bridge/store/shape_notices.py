"""Notices about the simulated shape: its distance from the target, strains, slots, and other shapes at rest."""

from __future__ import annotations

from typing import Any

import bpy

from ...engine.extras import registry
from ...engine.figures import format_figure
from ...engine.materials import MATERIALS, OVERSTRAIN_SHARE, STRAIN_MARGIN
from ...engine.optimisation import remedies
from ...engine.simulation.visible import REMEDY_WORDS, VISIBLE_RMS_SHARE
from . import advice, cures, equilibrium
from .cures import Cure
from .finding_words import INFORMATION, LABELS, WORSE
from .i18n import interface, translate
from .notice import Notice

# code of a simulation's finding -> remedies to offer if the optimiser advises them, best first
REMEDIES = {
    "stays-flat": (remedies.CUT,),
    "far-from-target": (remedies.CUT, remedies.FINER, remedies.LARGER, remedies.THINNER),
    "strained": (remedies.LARGER, remedies.THINNER),
    "about-to-snap": (remedies.CUT,),
    "other-rest": (remedies.CUT,),
}
# codes of findings for which Optimise is offered even after an earlier optimisation
FIXED_BY_OPTIMISE = {"no-equilibrium", "knotted", "about-to-snap", "other-rest"}
# codes of findings of earlier versions: strains over the limit for years, beside that for days; strains at kinks, which
# solids have shown to be as sure as others
FORMER_CODES = {"strained-for-years", "kinked"}
# keys of notices about a poor match with the target
FAR_FROM_TARGET = ("equilibrium/match", "equilibrium/far-from-target")


def from_equilibrium(obj: bpy.types.Object, blocks: dict[str, Any]) -> list[Notice]:
    block = blocks.get("equilibrium", {})
    reach = blocks.get("reach", {})
    advised = advised_remedies(blocks)
    # offer no cut if trial searches showed that it does not help, or the extra that searches for cuts is not installed
    if remedies.CUT not in reach.get("prospects", advised) or not registry.has("choosing"):
        advised.pop(remedies.CUT, None)
    result = []
    result += [*_lasting_limit(obj, block), *(_held(obj) if block else ())]
    rows = equilibrium.merge_by_code(block.get("findings", ()))
    # offer the cures of excess strain first: they change the size, after which the piece is optimised anew anyway
    for row in sorted(rows, key=lambda row: row["code"] != "strained"):
        if row["code"] in FORMER_CODES:
            continue
        helping = REMEDIES.get(row["code"], ())
        key, ways = (
            f"equilibrium/{row['code']}",
            [cures.apply_remedy(name, advised[name]) for name in helping if name in advised],
        )
        words, kind = LABELS.get(row["code"], ("To look at", WORSE))
        if row["code"] == "stays-flat" and not _is_far(obj, blocks):
            kind = WORSE
        if row["code"] == "other-rest" and is_other_rest_near(obj, block):
            result.append(_near_rest(key, row, block))
            continue
        in_vain = row["code"] in FIXED_BY_OPTIMISE and has_optimised_in_vain(blocks)
        if (row["code"] in FIXED_BY_OPTIMISE and not in_vain) or (
            row["code"] == "slots-close" and "optimise" not in blocks
        ):
            ways.insert(0, Cure(interface("Optimise again"), "flexmaps.optimise"))
        if row["code"] == "far-from-target":
            nearer = cures.improve_match(obj.flexmaps.choose, blocks)
            ways = [*nearer, *(way for way in ways if way.idname not in {cure.idname for cure in nearer})]
            if not reach.get("prospects") and not obj.flexmaps.loads.supports:
                ways.append(cures.hold("lowest"))
        if row["code"] == "stays-flat" and not ways and not obj.flexmaps.loads.supports:
            ways.append(cures.hold("border"))
        if kind != INFORMATION:
            ways.append(cures.dismiss(key))
        count = len(row["faces"])
        sentence = equilibrium.describe_finding(row, block)
        if REMEDY_WORDS in sentence and remedies.CUT not in advised:
            sentence = _advise_supports(sentence, {cure.idname for cure in ways})
        if in_vain:
            sentence += " " + translate(
                "The last Optimise found nothing better, so hold it with supports (Rests, in Piece), or go on as it is."
            )
        result.append(Notice(key, interface(words, count), sentence, kind, tuple(row["faces"]), (), tuple(ways)))
    return result + _poor_match(obj, blocks, advised)


def _advise_supports(sentence: str, offered: set[str]) -> str:
    """Replace the remedies in the text about bodies that are far from the target: a cut does not help, supports may.

    Parameters
    ----------
    sentence : the text, one line a body; each line ends with the remedies, which begin with ``REMEDY_WORDS``
    offered : operators of the notice's buttons; the new text names the button that adds supports if it is among them
    """
    faults = " ".join(line.partition(REMEDY_WORDS)[0].strip() for line in sentence.splitlines())
    if "flexmaps.stand_on" in offered:
        return f"{faults} {translate('A cut through its middle would not bring it nearer, supports can: hold it with the button, or choose them yourself (Rests, in Piece).')}"
    return f"{faults} {translate('A cut through its middle would not bring it nearer; supports at more places may (Rests, in Piece).')}"


def _held(obj: bpy.types.Object) -> list[Notice]:
    """Report that a piece with supports, but without a base or eyelets, must be held at the supports by other means."""
    group = obj.flexmaps.loads.supports
    if not group or obj.flexmaps.base.base != "none":
        return []
    sentence = translate(
        "The piece has this shape only while it is held at the vertex group '{}': fix these spirals to a frame, a wall or a floor, or choose a base that is cut with it (Supports and forces, in Piece)",
        group,
    )
    return [Notice("equilibrium/held", interface("Needs to be held"), sentence, INFORMATION)]


def advised_remedies(blocks: dict[str, Any]) -> remedies.Amounts:
    """Return the remedies that the optimiser advises, except a remedy that was just applied and did not help."""
    reach = blocks.get("reach", {})
    advised = remedies.read_block({"advice": "", **reach})
    if (effect := reach.get(advice.EFFECT)) is not None and not advice.has_helped(effect):
        advised.pop(effect["remedy"], None)
    return advised


def has_optimised_in_vain(blocks: dict[str, Any]) -> bool:
    """Return whether the last *Optimise* ended by itself but came no nearer to the target: repeating it is useless.

    A block that is out of date, as after a brush, is not in ``blocks``.
    """
    block = blocks.get("optimise", {})
    if not block.get("finished", False) or "rms_percent_before" not in block:
        return False
    nearer = block["rms_percent"] < advice.NEARER_RATIO * block["rms_percent_before"]
    return block["iterations"] == 0 or not nearer


def is_other_rest_near(obj: bpy.types.Object, block: dict[str, Any]) -> bool:
    """Return whether the other shape at rest is also within the wanted match, and none of its arms is overstrained."""
    other = block.get("other_rest")
    if other is None or other.get("strain_share_max", 0.0) > OVERSTRAIN_SHARE:
        return False
    return bool(other["rms_percent"] <= remedies.wanted_percent(obj.flexmaps.choose))


def _near_rest(key: str, row: dict[str, Any], block: dict[str, Any]) -> Notice:
    """Return the notice that the piece has another shape at rest, which also matches the target."""
    sentence = translate(
        "The piece can also rest in another shape, {} % of its size from the target. That is within the wanted distance too, and arms hold there",
        format_figure(block["other_rest"]["rms_percent"]),
    )
    return Notice(key, interface(LABELS["rest-as-near"][0]), sentence, INFORMATION, tuple(row["faces"]))


def _is_far(obj: bpy.types.Object, blocks: dict[str, Any]) -> bool:
    """Return whether the RMS distance from the target exceeds the wanted (of several bodies: a visible) distance."""
    several = any(row["code"] == "several-bodies" for row in blocks.get("checks", [{"code": "several-bodies"}]))
    visible = 100.0 * VISIBLE_RMS_SHARE
    limit = visible if several else min(visible, remedies.wanted_percent(obj.flexmaps.choose))
    return bool(blocks.get("equilibrium", {}).get("rms_percent", 100.0) > limit)


def _poor_match(obj: bpy.types.Object, blocks: dict[str, Any], advised: dict[str, Any]) -> list[Notice]:
    """Report an RMS distance from the target above the wanted one, unless a finding reports it already."""
    block = blocks.get("equilibrium", {})
    percent, codes = block.get("rms_percent"), {row["code"] for row in block.get("findings", ())}
    covering = {"far-from-target", "no-equilibrium", "knotted", *(("stays-flat",) if _is_far(obj, blocks) else ())}
    choose = obj.flexmaps.choose
    if percent is None or percent <= remedies.wanted_percent(choose) or codes & covering:
        return []
    key, nearer = FAR_FROM_TARGET[0], cures.improve_match(obj.flexmaps.choose, blocks)
    others = [cures.apply_remedy(name, advised[name]) for name in (remedies.FINER, remedies.LARGER) if name in advised]
    ways = nearer if blocks.get("reach", {}).get("prospects") else [*nearer, *others]
    sentence = translate("The shape lies {} % of its size (RMS) from its target", format_figure(percent))
    words = interface("{} % from target", format_figure(percent))
    return [Notice(key, words, sentence, WORSE, cures=(*ways, cures.dismiss(key)))]


def _lasting_limit(obj: bpy.types.Object, block: dict[str, Any]) -> list[Notice]:
    """Report the size or sheet that a piece designed for days would need to last for years; information only."""
    share, settings = block.get("strain_share_max"), obj.flexmaps.material
    material = MATERIALS.get(settings.material)
    if share is None or settings.lasts == "years" or material is None or material.lasting is None:
        return []
    times = STRAIN_MARGIN * share * material.strain_limit / material.lasting.strain
    sheet = remedies.thinner_sheet(sheet_thickness(obj), times)
    if times <= 1.0:
        sentence = translate("It lasts for years too")
    elif sheet is None:
        sentence = translate("To last for years, make it {:.2g} times larger", times)
    else:
        millimetres = sheet * remedies.MILLIMETRES
        sentence = translate(
            "To last for years, make it {:.2g} times larger, or cut it from a sheet of {:g} mm", times, millimetres
        )
    return [Notice("equilibrium/years", interface("Made for days"), sentence, INFORMATION)]


def sheet_thickness(obj: bpy.types.Object) -> float:
    """Return the sheet's thickness in metres."""
    return float(obj.flexmaps.spiral.thickness) / remedies.MILLIMETRES
