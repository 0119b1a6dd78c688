"""Choose the action of the button *Next*: what an experienced user would do now. Fast enough for every redraw."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import bpy

from ...engine.figures import format_length
from . import dimensions, failures, modifiers, notices, objects, stored_report
from .cures import Cure
from .finding_words import BREAKS, INFORMATION, STOPS, WORSE
from .flat_target import can_skip_simulation
from .i18n import interface, translate
from .notice import Notice
from .notices import FEW_QUADS, FIXED_BY_REGULARISE
from .shape_notices import FAR_FROM_TARGET
from .states import DONE, STALE, TODO, StageState, is_side_result_current

FIT_STAGES = ("spirals", "equilibrium", "optimise")  # stages that *Make it fit* runs
CHOOSE, ROUND = "flexmaps.choose", "flexmaps.mend"  # operators of two cures: propose layouts, round folds
# cures of a poor match that *Next* may press: they change neither the surface nor supports nor size
LAYOUT_CURES = ("flexmaps.cut_there", CHOOSE)
# range of the ratio of quad edge to wanted edge in which *Next* does not scale the piece; wider scales less often
EDGE_RATIOS = 0.5, 2.0
# largest number of times *Next* proposes an enlargement: one may not suffice, as its factor is limited, but a driver
# that resets the scale must not make *Next* repeat for ever
MAX_ENLARGEMENTS = 3
MAX_LETTERS = 28  # most characters of a label, in every language; more do not fit the button


@dataclass(frozen=True)
class NextAction:
    """Action of one press of *Next*.

    idname, properties : the operator and its properties
    label : text on the button, such as "Next: 500 quads"
    tooltip : sentence that explains it
    section : section of the sidebar it belongs to: piece, layout, shape or make
    cure : the cure that it presses; None for a stage
    """

    idname: str
    label: str
    tooltip: str
    section: str
    properties: dict[str, Any] = field(default_factory=dict)
    cure: Cure | None = None


def next_idname(obj: bpy.types.Object, scene: bpy.types.Scene, stage_states: dict[str, StageState]) -> str:
    """Return the idname of the operator to press next; "" when the sheets are up to date."""
    action = next_action(obj, scene, stage_states, notices.list_notices(obj, scene, stage_states))
    return "" if action is None or action.idname == "wm.path_open" else action.idname


def next_action(
    obj: bpy.types.Object, scene: bpy.types.Scene, stage_states: dict[str, StageState], all_notices: Sequence[Notice]
) -> NextAction | None:
    """Return the next action; None where the program cannot go on without the user.

    Parameters
    ----------
    obj, scene : the mesh object and its scene
    stage_states : states of the stages
    all_notices : all notices
    """
    mesh = obj.data
    if objects.surface_problem(obj, scene) is not None:
        return None
    gone = next((notice for notice in all_notices if notice.key.startswith("loads/")), None)
    if gone is not None:
        return _cure_action(gone, gone.cures[0], "piece")
    if len(mesh.loops) != 4 * len(mesh.polygons):
        return _unless_failed(mesh, _remesh_action(obj, scene), all_notices)
    if objects.modifier_problem(obj):
        return _modifiers_action(obj)
    shared = next((notice for notice in all_notices if notice.key == notices.SHARED), None)
    if shared is not None and shared.severity == WORSE:  # a stage would delete another object's results
        return _cure_action(shared, shared.cures[0], "piece")
    if notices.is_coarse(obj) and not failures.is_dismissed(mesh, FEW_QUADS, _sentence(all_notices, FEW_QUADS)):
        if stage_states["layout"].kind == TODO:
            return _unless_failed(mesh, _remesh_action(obj, scene), all_notices)
    if stage_states["layout"].kind == STALE and stage_states["layout"].changed_input == "shape":
        scaling = _scale_action(obj, scene)
        if scaling is not None:
            return _unless_failed(mesh, scaling, all_notices)
    if stage_states["layout"].kind == TODO:
        preparing = _preparing_action(obj, scene, stage_states, all_notices)
        if preparing is not None:
            return _unless_failed(mesh, preparing, all_notices)
        if stage_states["checks"].kind == DONE and any(
            n.severity == STOPS and n.key.startswith("checks/") for n in all_notices
        ):
            return None
    return _unless_failed(mesh, _stage_action(obj, stage_states, all_notices), all_notices)


def _stage_action(
    obj: bpy.types.Object, stage_states: dict[str, StageState], all_notices: Sequence[Notice]
) -> NextAction:
    """Return the next stage or cure for a mesh of quads that is ready for a layout."""
    blocks = stored_report.read(obj.data)
    if stage_states["layout"].kind != DONE:
        if stage_states["layout"].changed_input == "seams" and "layout" in blocks:
            tooltip = translate("Flattens the panels whose seams were edited; the others stay as they are")
            return NextAction("flexmaps.update_from_seams", _label(interface("Update from seams")), tooltip, "layout")
        tried = any(notice.key == "failed/flexmaps.merge" for notice in all_notices)
        if stage_states["layout"].kind == TODO and notices.has_seams(obj.data) and not tried:
            tooltip = translate(
                "Takes the seams that are there as the borders of the panels; Lay out anew replaces them"
            )
            return NextAction("flexmaps.flatten", _label(interface("Use these seams")), tooltip, "layout")
        return _layout_action()
    if stage_states["spirals"].kind == TODO and blocks["layout"].get(stored_report.TRACED):
        return _layout_action()
    if stage_states["sheets"].kind == DONE:
        folder = bpy.path.abspath(obj.flexmaps.export.folder)
        tooltip = translate("Opens the folder with the files for the cutter")
        return NextAction("wm.path_open", interface("Open the folder"), tooltip, "make", {"filepath": folder})
    wanted = (
        ("spirals",) if can_skip_simulation(obj) or _is_failure_dismissed("flexmaps.fit", all_notices) else FIT_STAGES
    )
    if any(stage_states[stage].kind != DONE for stage in wanted):
        if larger := _enlarge_action(obj.data, all_notices):
            return larger
        if wanted == ("spirals",):
            tooltip = translate("Gives every quad its spiral")
            return NextAction("flexmaps.spirals", _label(interface("Cut the spirals")), tooltip, "shape")
        tooltip = translate("Gives every quad its spiral, and searches for those that spring into the shape")
        return NextAction("flexmaps.fit", _label(interface("Make it fit")), tooltip, "shape")
    return _repair_action(obj.data, all_notices) or _export_action()


def _enlarge_action(mesh: bpy.types.Mesh, all_notices: Sequence[Notice]) -> NextAction | None:
    """Return the action that enlarges a piece whose arms are likely to break.

    None where arms are not likely to break, the scale is locked, the user dismissed the notice, or *Next* enlarged the
    piece ``MAX_ENLARGEMENTS`` times.
    """
    small = (notice for notice in all_notices if notice.key == notices.TOO_SMALL and notice.severity == BREAKS)
    ways = ((notice, cure) for notice in small for cure in notice.cures if cure.idname != "flexmaps.let_go")
    pressed = failures.read_press_counts(mesh)
    return next(
        (_cure_action(notice, cure, "piece") for notice, cure in ways if pressed.get(cure.call, 0) < MAX_ENLARGEMENTS),
        None,
    )


def _modifiers_action(obj: bpy.types.Object) -> NextAction:
    """Return the action that makes a copy of the object with modifiers and a bending parent applied or left out."""
    without, parent = modifiers.list_ignored(obj), objects.bending_parent(obj)
    changing = [*modifiers.list_changing(obj), *filter(None, [parent])]
    tooltip = translate("Applies the modifiers to a copy, and hides this object: the layout lives in the mesh itself")
    if without:
        tooltip += f". {modifiers.describe_ignored(obj)}"
    one = interface("Leave out {}" if without else "Apply {}", changing[0].name)
    label = _label(one)
    if len(changing) > 1 or one not in label:
        label = _label(interface("Apply modifiers"))
    return NextAction("flexmaps.to_mesh", label, tooltip, "piece", {"keep": True})


def _layout_action() -> NextAction:
    tooltip = translate("Cuts the surface into panels that lie flat and fit the sheet")
    return NextAction("flexmaps.merge", _label(interface("Lay out the panels")), tooltip, "layout")


def _export_action() -> NextAction:
    tooltip = translate(
        "Lays the panels on sheets, writes the files for the cutter, and checks how hard the seams are to join"
    )
    return NextAction("flexmaps.export", _label(interface("Write the files")), tooltip, "make")


def _remesh_action(obj: bpy.types.Object, scene: bpy.types.Scene) -> NextAction:
    count, size = obj.flexmaps.remesh.quads, _better_size(obj, scene)
    if not size:
        tooltip = translate(
            "Makes about {} quads in the shape of this mesh, as a new object, and hides this one", count
        )
        return NextAction("flexmaps.quad_remesh", _label(interface("{} quads", count)), tooltip, "piece")
    length = format_length(1e-3 * size)
    tooltip = translate(
        "Makes about {} quads as a new object, {} large so that spirals can be cut, and hides this one", count, length
    )
    label = _label(interface("{} quads, {}", count, length))
    return NextAction("flexmaps.quad_remesh", label, tooltip, "piece", {"size": size})


def _better_size(obj: bpy.types.Object, scene: bpy.types.Scene) -> float:
    """Return the longest side in mm at which a remesh gives about the wanted quad edge; 0 if no scaling is needed."""
    if any(obj.lock_scale):
        return 0.0
    edge, wanted = dimensions.remeshed_edge(obj, scene), obj.flexmaps.remesh.edge * 1e-3
    if EDGE_RATIOS[0] * wanted <= edge <= EDGE_RATIOS[1] * wanted or edge <= 0:
        return 0.0
    size = 1e3 * scene.unit_settings.scale_length * max(dimensions.extents(obj)) * wanted / edge
    return float(f"{size:.2g}")


def _scale_action(obj: bpy.types.Object, scene: bpy.types.Scene) -> NextAction | None:
    """Return the action that scales an object to the wanted quad edge; None if its edge is close, or its scale locked."""
    edge, wanted = dimensions.quad_edge(obj, scene), obj.flexmaps.remesh.edge * 1e-3
    if not EDGE_RATIOS[0] * wanted <= edge <= EDGE_RATIOS[1] * wanted and edge > 0 and not any(obj.lock_scale):
        size = format_length(max(dimensions.extents(obj)) * scene.unit_settings.scale_length * wanted / edge)
        tooltip = translate("Scales the object to {}, which gives spirals of {}", size, format_length(wanted))
        return NextAction("flexmaps.set_size", _label(interface("Scale to {}", size)), tooltip, "piece")
    return None


def _preparing_action(
    obj: bpy.types.Object, scene: bpy.types.Scene, stage_states: dict[str, StageState], all_notices: Sequence[Notice]
) -> NextAction | None:
    """Return the next preparation of a quad mesh (scale, repair, make squarer); None if it is ready for a layout."""
    scaling = _scale_action(obj, scene)
    if scaling is not None:
        return scaling
    wrong = [notice for notice in all_notices if notice.severity == STOPS and notice.key.startswith("checks/")]
    ways = ((notice, cure) for notice in wrong for cure in _unpressed_cures(obj.data, notice))
    mending = next((_cure_action(notice, cure, "piece") for notice, cure in ways), None)
    if mending is not None:
        return mending
    poor = any(notice.key.partition("/")[2] in FIXED_BY_REGULARISE for notice in all_notices)
    if (
        poor
        and not is_side_result_current(obj, scene, "regularise")
        and not _is_failure_dismissed("flexmaps.regularise", all_notices)
    ):
        tooltip = translate("Moves the vertices along the surface so that the quads become squarer")
        return NextAction("flexmaps.regularise", _label(interface("Squarer quads")), tooltip, "piece")
    return None


def _unless_failed(mesh: bpy.types.Mesh, action: NextAction, all_notices: Sequence[Notice]) -> NextAction | None:
    """Return ``action``; if it failed before with the same input, the first cure not pressed yet, or None."""
    failed = next((notice for notice in all_notices if notice.key == f"failed/{action.idname}"), None)
    if failed is None:
        return action
    return next((_cure_action(failed, cure, action.section) for cure in _unpressed_cures(mesh, failed)), None)


def _repair_action(mesh: bpy.types.Mesh, all_notices: Sequence[Notice]) -> NextAction | None:
    """Return a cure of a notice that the piece would break, else another layout for a poor match.

    None where no such cure exists, all were pressed, or the user dismissed the notices.
    """
    breaking = [notice for notice in all_notices if notice.severity == BREAKS]
    missing = [notice for notice in all_notices if notice.severity == WORSE and notice.key in FAR_FROM_TARGET]
    ways = [
        (notice, cure)
        for notice in breaking
        for cure in _unpressed_cures(mesh, notice)
        if cure.idname != "flexmaps.let_go"
    ]
    ways += [(notice, cure) for notice in missing for cure in _other_layouts(_unpressed_cures(mesh, notice))]
    return next((_cure_action(notice, cure, "shape") for notice, cure in ways), None)


def _other_layouts(offered: Sequence[Cure]) -> list[Cure]:
    """Return the cures that change only the layout.

    *Propose layouts* is left out where rounding the folds ranks before it: rounding is then predicted to reach the
    wanted match, and no layout of a piece with sharp folds reached it.
    """
    names = [cure.idname for cure in offered]
    before = names[: names.index(CHOOSE)] if CHOOSE in names else []
    return [cure for cure in offered if cure.idname in LAYOUT_CURES and not (cure.idname == CHOOSE and ROUND in before)]


def _unpressed_cures(mesh: bpy.types.Mesh, notice: Notice) -> list[Cure]:
    """Return the cures that *Next* has not pressed yet, and always the cure that dismisses the notice."""
    tried = failures.read_press_counts(mesh)
    return [cure for cure in notice.cures if cure.call not in tried or cure.idname == "flexmaps.let_go"]


def _is_failure_dismissed(idname: str, all_notices: Sequence[Notice]) -> bool:
    """Return whether an operator failed and the user dismissed the notice about it."""
    return any(notice.key == f"failed/{idname}" and notice.severity == INFORMATION for notice in all_notices)


def _sentence(all_notices: Sequence[Notice], key: str) -> str:
    return next((notice.sentence for notice in all_notices if notice.key == key), "")


def _cure_action(notice: Notice, cure: Cure, section: str) -> NextAction:
    return NextAction(cure.idname, _label(cure.label), notice.sentence, section, cure.properties, cure)


def _label(words: str) -> str:
    """Return the label "Next: ...", or a truncated label without "Next:" where that is too long."""
    label = interface("Next: {}", words)
    return label if len(label) <= MAX_LETTERS else words[:MAX_LETTERS]
