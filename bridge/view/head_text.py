"""Content of the tab's head: for a running job, for live mode, for a mesh, and without a usable mesh."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import bpy

from ...engine import VERSION, versions
from ..store import stored_report
from ..store.cures import Cure
from ..store.finding_words import INFORMATION
from ..store.guidance import LOOK, NEUTRAL, REDO, STOPPED, TICK, Guidance
from ..store.i18n import interface
from ..store.next_button import MAX_LETTERS
from ..store.notice import Notice
from ..store.objects import CONVERTIBLE, count_hidden, drawn_model, usage_problem
from . import collection
from .progress import progress_to_show

if TYPE_CHECKING:
    from .progress import RunningJob

SIGNS = {NEUTRAL: "INFO", TICK: "CHECKMARK", LOOK: "ERROR", STOPPED: "CANCEL", REDO: "FILE_REFRESH"}
REMOVE_LEFT_OVER = "flexmaps.remove_left_over"
WELCOME = "Welcome to FlexMaps"
ABOUT = "It turns a surface into flat panels that spring into its shape. Select a mesh, or press Next for an example."


@dataclass(frozen=True)
class HeadContent:
    """Content of the head: the button *Next*, the status line with its icon, and either notices or a sentence.

    label : text of the button
    operator, properties : operator that the button runs, and its properties; "" if the button is disabled
    icon, status : the status line
    hint : sentence below the status line, shown if there are no notices
    alert : whether the status line is drawn red
    """

    label: str
    operator: str
    icon: str
    status: str
    hint: str = ""
    notices: tuple[Notice, ...] = ()
    properties: tuple[tuple[str, Any], ...] = ()
    alert: bool = False


def head_content(
    context: bpy.types.Context, problem: str, guidance: Guidance | None, job: RunningJob | None, watcher: Any
) -> HeadContent:
    """Return the present content of the head.

    Parameters
    ----------
    context : Blender's context
    problem : why the active object cannot be used; "" if it can
    guidance : guidance for the active object; None if it cannot be used
    job : the running ``background.Job``, or None
    watcher : the ``live.ObjectWatcher`` of live mode, or None
    """
    if job is not None:
        return _job_head(job)
    if guidance is None:
        return _unusable_head(context, problem)
    return _live_head(context, guidance, watcher) or _idle_head(context, guidance)


def _job_head(job: RunningJob) -> HeadContent:
    name = bpy.app.translations.pgettext_iface(job.title, "Operator")
    fraction, text = progress_to_show(job)
    label = interface("{}, {} %", name, f"{100 * fraction:.0f}")
    left = interface("About {} left", job.time_left) if job.time_left else interface("Begun")
    step = interface(text) if text else interface("Starting")
    status = interface("Stopping") if job.is_stopping else left
    return HeadContent(
        label, "", "SORTTIME", status, f"{step}. {interface('Esc or the cross stops; {}.', interface(job.on_stop))}"
    )


def _live_head(context: bpy.types.Context, guidance: Guidance, watcher: Any) -> HeadContent | None:
    """Return the head if live mode follows the active object, else None."""
    obj = context.object
    if watcher is None or obj is None or watcher.uid != obj.session_uid:
        return None
    label = guidance.action.label if guidance.action else interface("Next")
    press, shape = "flexmaps.next" if guidance.action else "", watcher.shape
    if watcher.problem:
        return HeadContent(
            label, press, "ERROR", interface("Live: stopped short"), interface(watcher.problem), alert=True
        )
    if shape is None or not watcher.is_resting:
        return HeadContent(
            label, press, "SORTTIME", interface("Live: on its way"), interface("The shape follows what you change.")
        )
    if shape.snapped:
        jumped = interface("Jumped by up to {} mm", f"{shape.snapped:.0f}")
        return HeadContent(
            label, press, "ERROR", jumped, interface("Spirals jumped to another shape. Undo brings the piece back.")
        )
    final = "" if watcher.is_final else interface("Press Simulate for the final shape and its figures.")
    return HeadContent(label, press, "CHECKMARK", interface("Live: at rest"), final)


def _idle_head(context: bpy.types.Context, guidance: Guidance) -> HeadContent:
    notices = (*guidance.notices, *general_notices(context))
    act, (status, sign) = guidance.action, (guidance.status.text, guidance.status.icon)
    label = act.label if act else interface("Next")
    return HeadContent(
        label, "flexmaps.next" if act else "", SIGNS[sign], status, guidance.explanation, notices, alert=sign == STOPPED
    )


def _unusable_head(context: bpy.types.Context, problem: str) -> HeadContent:
    """Return the head if the active object cannot be used; ``problem`` says why."""
    obj = context.object
    if obj is None:
        label = interface("Next: {}", interface("Add an example"))
        return HeadContent(
            label, "flexmaps.example", "INFO", interface(WELCOME), interface(ABOUT), general_notices(context)
        )
    sentence = interface(problem)
    model = drawn_model(obj)
    if model is not None:
        label = interface("Next: {}", interface("Select '{}'", model.name))
        if len(label) > MAX_LETTERS:
            label = interface("Next: {}", interface("Select the model"))
        return HeadContent(label, "flexmaps.select_model", "INFO", interface("Drawn by FlexMaps"), sentence)
    if obj.type in CONVERTIBLE:
        label = interface("Next: {}", interface("Convert to a mesh"))
        return HeadContent(
            label, "flexmaps.to_mesh", "INFO", interface("Not a mesh yet"), sentence, properties=(("keep", True),)
        )
    if obj.type == "MESH" and obj.library is None and obj.data.library is None:
        label = interface("Next: {}", interface("Object Mode"))
        return HeadContent(
            label, "object.mode_set", "INFO", interface("In another mode"), sentence, properties=(("mode", "OBJECT"),)
        )
    return HeadContent(interface("Next"), "", "INFO", interface("Nothing to work on"), sentence)


def general_notices(context: bpy.types.Context) -> tuple[Notice, ...]:
    """Return notices of the kind "information" that do not come from the object's stages.

    They concern panels left over from deleted models, further selected meshes, hidden faces, and results that another
    version of FlexMaps wrote.
    """
    obj, notices = context.object, []
    left = collection.find_orphans(context.scene)
    if left:
        names = ", ".join(f"'{one.get('flexmaps_owner')}'" for one in left[:2]) + ", ..." * (len(left) > 2)
        sentence = interface("{} was deleted, its panels are still there", names)
        notices.append(
            Notice(
                "left",
                interface("Old panels"),
                sentence,
                INFORMATION,
                cures=(Cure(interface("Remove"), REMOVE_LEFT_OVER),),
            )
        )
    if usage_problem(obj) is not None:
        return tuple(notices)
    meshes = sum(other.type == "MESH" for other in context.selected_objects if other != obj) + 1
    if meshes > 1:
        sentence = interface("{} meshes are selected; Next works on the active one, '{}'", meshes, obj.name)
        notices.append(Notice("selected", interface("Only the active mesh"), sentence, INFORMATION))
    hidden = count_hidden(obj.data)
    if hidden:
        sentence = interface(
            "Hidden faces belong to the surface, as in Blender's exports: {} of {}; delete those that are not wanted",
            hidden,
            len(obj.data.polygons),
        )
        label = interface("{} hidden face" if hidden == 1 else "{} hidden faces", hidden)
        notices.append(Notice("hidden", label, sentence, INFORMATION))
    version = stored_report.read_version(obj.data)
    changed = versions.changes_between(version)
    if versions.version_key(version) > versions.version_key(VERSION):
        sentence = interface(
            "Made with FlexMaps {}, which is newer than this {}: what is new there is not read", version, VERSION
        )
        notices.append(Notice("version", interface("Made with {}", version), sentence, INFORMATION))
    elif changed:
        sentence = " ".join(
            (interface("Made with FlexMaps {}; since then:", version), *(f"{interface(text)}." for text in changed))
        )
        notices.append(Notice("version", interface("Made with {}", version), sentence, INFORMATION))
    return tuple(notices)
