"""Align a 3D scan of the built piece with the predicted shape, and measure the distance."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import bpy

from ..bridge.store import stored_report
from ..bridge.store.i18n import translate
from ..engine.errors import FlexMapsError
from ..engine.progress import Progress
from .continued_stage import Continuation, ContinuedStage
from .file_writer import FileDialogOperator, run_stage
from .stage import ImmediateOperator

if TYPE_CHECKING:
    from ..bridge.store.snapshot import Snapshot
    from ..bridge.store.surface import ObjectSurface
    from ..engine.runs.result import Result


class ScanProperties:
    """Properties of the comparison: the scan's file, its unit, and whether its pose is arbitrary."""

    filepath: bpy.props.StringProperty(  # type: ignore[valid-type]
        name="Scan", description="Points or a mesh of the built piece", subtype="FILE_PATH", options={"SKIP_SAVE"}
    )
    filter_glob: bpy.props.StringProperty(  # type: ignore[valid-type]
        default="*.ply;*.obj;*.stl;*.off", options={"HIDDEN"}
    )
    unit: bpy.props.EnumProperty(  # type: ignore[valid-type]
        name="Unit",
        description="Unit of the numbers in the scan's file",
        items=[
            ("GUESS", "Guess", "Metres or millimetres, whichever comes nearer the piece's size"),
            ("mm", "Millimetres", ""),
            ("cm", "Centimetres", ""),
            ("m", "Metres", ""),
            ("in", "Inches", ""),
        ],
        default="GUESS",
    )
    anywhere: bpy.props.BoolProperty(  # type: ignore[valid-type]
        name="Any pose",
        description="The scan may lie and be turned in any way; off, where it is turned by 30 degrees at most, is quicker and surer",
        default=True,
    )


class Compare(ScanProperties, ContinuedStage["Result"], bpy.types.Operator):
    """Lay a scan of the built piece over the simulated shape and show how far it is from it"""

    bl_idname = "flexmaps.compare"
    bl_label = "Compare with a scan"
    reads_loads = True

    def continuation(self, obj: bpy.types.Object, snapshot: Snapshot) -> Continuation[Result]:
        from ..bridge.store import equilibrium
        from ..engine.extras.scanning import scan_reader

        path = _resolve_scan(self.filepath)
        unit, anywhere = "" if self.unit == "GUESS" else self.unit, self.anywhere
        rest = equilibrium.read_rest_pose(obj, bpy.context.scene, snapshot.surface)

        def go_on(result: Result, progress: Progress) -> Result:
            from ..engine.runs import job

            progress(0.0, "Reading the scan")
            scan = scan_reader.read_scan(path, unit, anywhere)
            return job.run_stages(result.with_user(rest=rest, scanned=scan), snapshot.settings, ("compare",), progress)

        return go_on

    def finish(self, context: bpy.types.Context, obj: bpy.types.Object, surface: ObjectSurface, result: Result) -> str:
        from ..bridge.store import scans
        from ..bridge.view import scan_points
        from ..engine.runs import report

        scans.write(obj, result.scan, scan_points.show_points(obj, context.scene, result.scan))
        blocks = report.report_blocks(result, ("scan",))
        stored_report.write_all(obj.data, blocks)
        return scans.describe_result(blocks["scan"])

    overlay_kind = "SCAN"


class CompareFile(ScanProperties, FileDialogOperator, ImmediateOperator, bpy.types.Operator):
    """Choose the file of a scan of the built piece, and compare it with the simulated shape"""

    bl_idname = "flexmaps.compare_file"
    bl_label = "Compare with a scan"
    bl_options = {"REGISTER"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return Compare.poll(context)

    def run(self, context: bpy.types.Context) -> None:
        _resolve_scan(self.filepath)
        run_stage(Compare.bl_idname, filepath=self.filepath, unit=self.unit, anywhere=self.anywhere)


def _resolve_scan(filepath: str) -> Path:
    """Return the absolute path of a scan's file.

    Raises
    ------
    FlexMapsError : no file is chosen, or it does not exist
    """
    if not filepath:
        raise FlexMapsError(translate("Choose the file of a scan"))
    path = Path(bpy.path.abspath(filepath))
    if not path.is_file():
        raise FlexMapsError(translate("There is no file {}; choose a scan", filepath))
    return path


CLASSES = (Compare, CompareFile)
