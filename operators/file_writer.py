"""Base of the operators that write files: they ask before they overwrite the user's files."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import bpy

from ..bridge.store.i18n import translate
from ..bridge.store.paths import resolve_folder
from ..bridge.store.settings import is_relative_to_unsaved
from ..engine.errors import FlexMapsError
from ..engine.files import check_folder
from ..engine.own_files import Guard, UserFileError
from .stage import ImmediateOperator, ObjectOperator, error_message, idname_of

if TYPE_CHECKING:
    from ..engine.params import ObjectSettings


class FileWriter:
    """Base of operators that write files; list it as the first base. They call ``guard`` before the work begins."""

    overwrite: bpy.props.BoolProperty(  # type: ignore[valid-type]
        name="Overwrite",
        description="Also replace files that FlexMaps did not write, or that were changed since",
        default=False,
        options={"SKIP_SAVE"},
    )

    def guard(self, settings: ObjectSettings, present: Iterable[Path], root: Path | None = None) -> Guard:
        """Return a guard against overwriting the user's files, after a first check.

        Parameters
        ----------
        settings : settings of the object, whose remnant files are never overwritten
        present : existing files that the operator would overwrite
        root : folder of the files, or None

        Raises
        ------
        UserFileError where an existing file is the user's, unless ``overwrite`` is set; ``FlexMapsError`` where the
        folder takes no files.
        """
        from ..bridge.store.objects import list_open_files
        from ..engine.fabrication.nesting.remnants import SEPARATOR

        remnants = [path.strip() for path in settings.sheet.remnants.split(SEPARATOR) if path.strip()]
        made = Guard([*list_open_files(), *remnants], self.overwrite)
        made.check(present, root)
        if root is not None:
            check_folder(root)
        return made

    def _report_error(self, context: bpy.types.Context, error: Exception) -> set[str]:
        return self.ask_overwrite(error) if isinstance(error, UserFileError) else super()._report_error(context, error)  # type: ignore[misc]

    def ask_overwrite(self, error: UserFileError) -> set[str]:
        """Ask whether to overwrite the files, and if so, run the operator again; without a window, report an error."""
        if bpy.app.background or self.overwrite:
            self.report({"ERROR"}, str(error))  # type: ignore[attr-defined]
        else:
            bpy.ops.flexmaps.replace_files("INVOKE_DEFAULT", stage=self.bl_idname, text=str(error))  # type: ignore[attr-defined]
        return {"CANCELLED"}


class FolderWriter(FileWriter):
    """Base of operators that write into the object's export folder; if the .blend file is unsaved, they ask for one."""

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if bpy.app.background or not is_relative_to_unsaved(context.object.flexmaps.export.folder):
            return super().invoke(context, event)  # type: ignore[misc]
        bpy.ops.flexmaps.choose_folder("INVOKE_DEFAULT", stage=self.bl_idname)  # type: ignore[attr-defined]
        return {"CANCELLED"}

    def _store_failure(self, context: bpy.types.Context, obj: bpy.types.Object, error: FlexMapsError) -> None:
        """Store the failure, and whether another folder could help; *Next* then asks for a folder."""
        from ..bridge.store import failures
        from ..engine.files import FolderError

        failures.write(obj, context.scene, idname_of(self), error, folder=isinstance(error, FolderError))  # type: ignore[arg-type]


class FileDialogOperator:
    """Base of operators that open a file dialog first."""

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        context.window_manager.fileselect_add(self)  # type: ignore[arg-type]
        return {"RUNNING_MODAL"}


class ReplaceFiles(ImmediateOperator, bpy.types.Operator):
    """Write over files that FlexMaps did not write, or that were changed since"""

    bl_idname = "flexmaps.replace_files"
    bl_label = "Replace these files?"
    bl_options = {"INTERNAL"}

    stage: bpy.props.StringProperty(options={"SKIP_SAVE", "HIDDEN"})  # type: ignore[valid-type]
    text: bpy.props.StringProperty(options={"SKIP_SAVE", "HIDDEN"})  # type: ignore[valid-type]

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        manager: Any = context.window_manager
        title, yes = translate(self.bl_label), translate("Replace")
        return manager.invoke_confirm(self, event, title=title, message=self.text, confirm_text=yes, icon="WARNING")

    def run(self, context: bpy.types.Context) -> None:
        run_stage(self.stage, overwrite=True)


class ChooseFolder(FileDialogOperator, ImmediateOperator, ObjectOperator, bpy.types.Operator):
    """Choose where the files go, and write them there; it is the folder in Make from now on"""

    bl_idname = "flexmaps.choose_folder"
    bl_label = "Write the files here"

    directory: bpy.props.StringProperty(subtype="DIR_PATH", options={"SKIP_SAVE"})  # type: ignore[valid-type]
    filter_folder: bpy.props.BoolProperty(default=True, options={"SKIP_SAVE", "HIDDEN"})  # type: ignore[valid-type]
    stage: bpy.props.StringProperty(default="flexmaps.export", options={"SKIP_SAVE", "HIDDEN"})  # type: ignore[valid-type]

    def run(self, context: bpy.types.Context) -> None:
        context.object.flexmaps.export.folder = str(resolve_folder(self.directory))
        run_stage(self.stage)


def run_stage(stage: str, **options: Any) -> None:
    """Run a stage's operator; with a window, as a background job.

    Parameters
    ----------
    stage : idname of the operator
    options : properties of the operator

    Raises
    ------
    FlexMapsError with the error that the stage reports; a fault of the program stays a ``RuntimeError``.
    """
    name = stage.lower().replace("_ot_", ".").split(".")[-1]
    try:
        getattr(bpy.ops.flexmaps, name)("EXEC_DEFAULT" if bpy.app.background else "INVOKE_DEFAULT", **options)
    except RuntimeError as error:
        raise FlexMapsError(error_message(error)) from error


CLASSES = (ReplaceFiles, ChooseFolder)
