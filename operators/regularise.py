"""Move the vertices along the surface so that the quads become squarer."""

from __future__ import annotations

from typing import TYPE_CHECKING

import bpy

from ..bridge.store import stored_report
from ..bridge.store.i18n import translate
from ..engine.progress import Progress
from .continued_stage import Continuation, ContinuedStage

if TYPE_CHECKING:
    from ..bridge.store.snapshot import Snapshot
    from ..bridge.store.surface import ObjectSurface
    from ..engine.runs.result import Result
    from ..engine.surface.checking.check import Finding
    from ..engine.surface.mesh import QuadMesh

    # the quads before and after, and the findings about the latter
    MovedQuads = tuple[QuadMesh, QuadMesh, list[Finding]]


class Regularise(ContinuedStage["MovedQuads"], bpy.types.Operator):
    """Move the vertices along the surface so that the quads become squarer; flat panels made before are dropped"""

    bl_idname = "flexmaps.regularise"
    bl_label = "Regularise"

    @classmethod
    def obstacle(cls, obj: bpy.types.Object) -> str | None:
        from ..bridge.store import shape_keys

        return "Remove the shape keys first: they fix the vertices" if shape_keys.has_user_keys(obj.data) else None

    def continuation(self, obj: bpy.types.Object, snapshot: Snapshot) -> Continuation[MovedQuads]:
        def go_on(result: Result, progress: Progress) -> MovedQuads:
            from ..engine.runs import job
            from ..engine.surface.checking import check
            from ..engine.surface.mesh import PolygonMesh

            after = job.run_stages(result, snapshot.settings, ("regularise",), progress).mesh
            return result.mesh, after, check.all_findings(PolygonMesh.from_quads(after))

        return go_on

    def finish(
        self, context: bpy.types.Context, obj: bpy.types.Object, surface: ObjectSurface, result: MovedQuads
    ) -> str:
        import numpy as np

        from ..bridge.store import mesh, states
        from ..bridge.view import replacing

        before, after, findings = result
        if after is before:
            stored_report.write_checks(obj.data, findings)
            states.stamp_side_result(obj, context.scene, "regularise", self._settings_checksums)
            return translate("Nothing was moved: the quads cannot become squarer without taking room from a spiral")
        mesh.write_vertices(obj, surface, after)
        replacing.drop_results(obj, findings)
        states.stamp_side_result(obj, context.scene, "regularise", self._settings_checksums)
        moved = np.linalg.norm(after.vertices - before.vertices, axis=1).max()
        return translate("Vertices moved by up to {:.0%} of an edge", moved / before.median_edge)


CLASSES = (Regularise,)
