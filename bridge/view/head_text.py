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
from ..store.notices import Notice
from ..store.objects import CONVERTIBLE, other_users, usage_problem
from . import collection

if TYPE_CHECKING:
    from .progress import RunningJob

SIGNS = {NEUTRAL: "INFO", TICK: "CHECKMARK", LOOK: "ERROR", STOPPED: "CANCEL", REDO: "FILE_REFRESH"}
REMOVE = "flexmaps.remove_left_over"
WELCOME = "Welcome to FlexMaps"
ABOUT = "It turns a surface into flat panels that spring into its shape. Select a mesh, or press Next for an example."


@dataclass(frozen=True)
class Head:
    """Content of the head: the button *Next*, the status line with its icon, and either notices or a sentence.

    label : text of the button
    press, properties : operator that the button runs, and its properties; "" if the button is disabled
    icon, status : the status line
    about : sentence below the status line, shown if there are no notices
    alert : whether the status line is drawn red
    """

    label: str
    press: str
    icon: str
    status: str
    about: str = ""
    notices: tuple[Notice, ...] = ()
    properties: tuple[tuple[str, Any], ...] = ()
    alert: bool = False


def current(
    context: bpy.types.Context, problem: str, seen: Guidance | None, job: RunningJob | None, following: Any
) -> Head:
    """Return the present content of the head.

    Parameters
    ----------
    context : Blender's context
    problem : why the active object cannot be used; "" if it can
    seen : guidance for the active object; None if it cannot be used
    job : the running ``background.Job``, or None
    following : the ``live.ObjectWatcher`` of live mode, or None
    """
    if job is not None:
        return _running(job)
    if seen is None:
        return _nothing(context, problem)
    return _live(context, seen, following) or _idle(context, seen)


def _running(job: RunningJob) -> Head:
    name = bpy.app.translations.pgettext_iface(job.title, "Operator")
    label = interface("{}, {} %", name, f"{100 * job.fraction:.0f}")
    left = interface("About {} left", job.left) if job.left else interface("Begun")
    step = interface(job.text) if job.text else interface("starting")
    status = interface("Stopping") if job.stopping else left
    return Head(
        label, "", "SORTTIME", status, f"{step}. {interface('Esc or the cross stops; {}.', interface(job.on_stop))}"
    )


def _live(context: bpy.types.Context, seen: Guidance, following: Any) -> Head | None:
    """Return the head if live mode follows the active object, else None."""
    obj = context.object
    if following is None or obj is None or following.uid != obj.session_uid:
        return None
    label = seen.act.label if seen.act else interface("Next")
    press, shape = "flexmaps.next" if seen.act else "", following.shape
    if following.problem:
        return Head(label, press, "ERROR", interface("Live: stopped short"), interface(following.problem), alert=True)
    if shape is None or not following.resting:
        return Head(
            label, press, "SORTTIME", interface("Live: on its way"), interface("The shape follows what you change.")
        )
    if shape.snapped:
        jumped = interface("Jumped by up to {} mm", f"{shape.snapped:.0f}")
        return Head(
            label, press, "ERROR", jumped, interface("Spirals jumped to another shape. Undo brings the piece back.")
        )
    final = "" if following.final else interface("Press Simulate for the final shape and its figures.")
    return Head(label, press, "CHECKMARK", interface("Live: at rest"), final)


def _idle(context: bpy.types.Context, seen: Guidance) -> Head:
    obj = context.object
    notices = (*seen.notices, *around(context))
    act, (status, sign) = seen.act, (seen.status.text, seen.status.sign)
    about = act.tooltip if act else interface("Only you can mend this mesh. The rows tell where.")
    others = sum(other.type == "MESH" for other in context.selected_objects if other != obj)
    if others and not seen.open:
        status = interface("{} selected; works on the active one", others + 1)
    label = act.label if act else interface("Next")
    return Head(label, "flexmaps.next" if act else "", SIGNS[sign], status, about, notices, alert=sign == STOPPED)


def _nothing(context: bpy.types.Context, problem: str) -> Head:
    """Return the head if the active object cannot be used; ``problem`` says why."""
    obj = context.object
    if obj is None:
        label = interface("Next: {}", interface("Add an example"))
        return Head(label, "flexmaps.example", "INFO", interface(WELCOME), interface(ABOUT), around(context))
    sentence = interface(problem)
    if obj.type in CONVERTIBLE:
        label = interface("Next: {}", interface("Convert to a mesh"))
        return Head(label, "flexmaps.to_mesh", "INFO", interface("Not a mesh yet"), sentence)
    if obj.type == "MESH" and obj.library is None and obj.data.library is None:
        label = interface("Next: {}", interface("Object Mode"))
        return Head(
            label, "object.mode_set", "INFO", interface("In another mode"), sentence, properties=(("mode", "OBJECT"),)
        )
    return Head(interface("Next"), "", "INFO", interface("Nothing to work on"), sentence)


def around(context: bpy.types.Context) -> tuple[Notice, ...]:
    """Return notices of the kind "information" that do not come from the object's stages.

    They concern panels left over from deleted models, a mesh that several objects share, and results written by another
    version of FlexMaps.
    """
    obj, notices = context.object, []
    left = collection.left_over(context.scene)
    if left:
        names = ", ".join(f"'{one.get('flexmaps_owner')}'" for one in left[:2]) + ", ..." * (len(left) > 2)
        sentence = interface("{} was deleted, its panels are still there", names)
        notices.append(
            Notice("left", interface("Old panels"), sentence, INFORMATION, cures=(Cure(interface("Remove"), REMOVE),))
        )
    if usage_problem(obj) is not None:
        return tuple(notices)
    others, version = other_users(obj), stored_report.read_version(obj.data)
    if others:
        sentence = interface("The mesh is shared with {}: seams and results are common to all", others)
        notices.append(Notice("shared", interface("Shared mesh"), sentence, INFORMATION))
    changed = versions.changes_between(version)
    if versions.order(version) > versions.order(VERSION):
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
