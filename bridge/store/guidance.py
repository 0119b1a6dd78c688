"""Top part of the sidebar for an object: what the button *Next* does, one status line, and the notices.

    seen = guidance.read_guidance(obj, scene)
    seen.action.label   # "Next: Lay out the panels"
    seen.status.text    # "484 quads, spirals of 15 mm", at most 34 letters
    seen.notices        # worst first, each with its cures

The report and the command line use it too.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import bpy

from ...engine.figures import format_length
from ...engine.materials import OVERSTRAIN_SHARE
from . import dimensions, next_button, notices, objects, states, stored_report
from .finding_words import BREAKS, INFORMATION, STOPS, WORSE
from .flat_target import can_skip_simulation
from .i18n import interface, panels, quads, translate
from .next_button import NextAction
from .notice import Notice

MAX_LETTERS = 34  # most characters of the status line, in every language; more do not fit the sidebar
NEUTRAL, TICK, LOOK, STOPPED, REDO = "neutral", "tick", "look", "stopped", "redo"  # icons of the status line
CHANGED_PARTS = {
    "seams": "Seams changed",
    "shape": "Mesh changed",
    "design": "Spirals changed",
    states.FILES: "Files not found",
}
CHANGED_SETTING = "Settings changed"
# first stage that is out of date because an earlier stage ran again -> reason to show
RERUN_REASONS = {
    "layout": "New quads",
    "spirals": "New panels",
    "equilibrium": "New spirals",
    "optimise": "New spirals",
    "sheets": "New shape",
}
STEPS = ("layout", "spirals", "equilibrium", "optimise", "sheets")  # stages that *Next* runs, in order


@dataclass(frozen=True)
class Status:
    """Status line of at most ``MAX_LETTERS`` characters, and its icon."""

    text: str
    icon: str


@dataclass(frozen=True)
class Guidance:
    """Content of the sidebar's top part; ``action`` is None where the program cannot go on without the user."""

    action: NextAction | None
    status: Status
    notices: tuple[Notice, ...]

    @property
    def objections(self) -> tuple[Notice, ...]:
        """Return the notices that speak against cutting: all but the merely informative ones."""
        return tuple(notice for notice in self.notices if notice.severity != INFORMATION)

    @property
    def explanation(self) -> str:
        """Return the next action's tooltip, or why there is none."""
        if self.action is not None:
            return self.action.tooltip
        return next((notice.sentence for notice in self.notices), translate("There is nothing to make of it"))

    def findings(self) -> list[dict[str, Any]]:
        """Return all notices with their cures as plain values, for report.json and the command line."""
        return [notice.as_dict() for notice in self.notices]


def read_guidance(
    obj: bpy.types.Object, scene: bpy.types.Scene, stage_states: dict[str, states.StageState] | None = None
) -> Guidance:
    """Compute the next action, the status line and the notices of a usable object.

    Parameters
    ----------
    obj, scene : a mesh object and its scene
    stage_states : states of its stages from ``read_states``; None computes them
    """
    stage_states = states.read_states(obj, scene) if stage_states is None else stage_states
    all_notices = notices.list_notices(obj, scene, stage_states)
    act = next_button.next_action(obj, scene, stage_states, all_notices)
    return Guidance(act, _status(obj, scene, stage_states, all_notices), tuple(all_notices))


def _status(
    obj: bpy.types.Object, scene: bpy.types.Scene, stage_states: dict[str, states.StageState], all_notices: list[Notice]
) -> Status:
    stopped = next((notice for notice in all_notices if notice.severity == STOPS), None)
    if stopped is not None:
        return Status(_truncate(stopped.label), STOPPED)
    skipped = {"equilibrium", "optimise"} if can_skip_simulation(obj) else set()
    old = sum(stage_states[name].kind == states.STALE for name in STEPS if name not in skipped)
    if old:
        return Status(_truncate(_describe_change(stage_states, old)), REDO)
    serious = _serious(all_notices)
    if stage_states["sheets"].kind == states.DONE:
        if not serious:  # nothing above information
            return Status(interface("Files written, nothing against it"), TICK)
        many = interface("Files written. {} things to look at", len(serious))
        return Status(interface("Files written. 1 thing to look at") if len(serious) == 1 else many, LOOK)
    if stage_states["equilibrium"].kind == states.DONE:
        return _status_of_simulated(obj, all_notices)
    return Status(_truncate(_describe_progress(obj, scene, stage_states)), NEUTRAL)


def _serious(all_notices: list[Notice]) -> list[Notice]:
    """Return the notices that speak against cutting, without a notice about few quads that the user decided to keep."""
    return [one for one in all_notices if one.severity in {BREAKS, WORSE} and one.key != notices.FEW_QUADS]


def _status_of_simulated(obj: bpy.types.Object, all_notices: list[Notice]) -> Status:
    """Return the status of a piece that was simulated."""
    block, serious = stored_report.read(obj.data)["equilibrium"], _serious(all_notices)
    if any(notice.key == "equilibrium/strained" for notice in serious):
        share, allowed = (f"{100 * x:.0f}" for x in (block.get("strain_share_max", 0.0), OVERSTRAIN_SHARE))
        if share == allowed:
            return Status(_truncate(interface("Strained to a little over {} %", allowed)), LOOK)
        return Status(_truncate(interface("Strained to {} %, {} % allowed", share, allowed)), LOOK)
    if serious:  # the rows below describe them
        many = interface("{} things to look at", len(serious))
        return Status(interface("1 thing to look at") if len(serious) == 1 else many, LOOK)
    held = any(notice.key == "equilibrium/held" for notice in all_notices)
    return Status(interface("It fits while held, arms hold") if held else interface("It fits, and its arms hold"), TICK)


def _describe_progress(
    obj: bpy.types.Object, scene: bpy.types.Scene, stage_states: dict[str, states.StageState]
) -> str:
    """Describe the progress of a piece that is not simulated yet."""
    mesh = obj.data
    if stage_states["spirals"].kind == states.DONE:
        return (
            interface("Ready to cut: it is flat")
            if can_skip_simulation(obj)
            else interface("{} spiral" if len(mesh.polygons) == 1 else "{} spirals", len(mesh.polygons))
        )
    if stage_states["layout"].kind == states.DONE:
        return panels(stored_report.read(mesh)["layout"].get("patches", 1))
    count, size = len(mesh.polygons), max(dimensions.extents(obj)) * scene.unit_settings.scale_length
    wide = interface("{} wide", format_length(size))
    if objects.modifier_problem(obj):
        return interface("Apply the modifiers first")
    if len(mesh.loops) != 4 * count:
        return interface("{}, not all quads", wide)
    if notices.is_coarse(obj):
        return interface("{}, only {}", wide, quads(count))
    return interface("{} quads, spirals of {}", count, format_length(dimensions.quad_edge(obj, scene)))


def _describe_change(stage_states: dict[str, states.StageState], old: int) -> str:
    part = next((stage_states[name].changed_input for name in STEPS if stage_states[name].changed_input), None)
    first = next(name for name in STEPS if stage_states[name].kind == states.STALE)
    what = CHANGED_PARTS.get(part, CHANGED_SETTING) if part else RERUN_REASONS[first]
    return interface("{}: {} to redo", interface(what), interface("1 step") if old == 1 else interface("{} steps", old))


def _truncate(text: str) -> str:
    return text if len(text) <= MAX_LETTERS else text[: MAX_LETTERS - 1].rstrip() + "\N{HORIZONTAL ELLIPSIS}"
