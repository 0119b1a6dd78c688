"""Make the quads squarer."""

from __future__ import annotations

from typing import Any

import bpy

from ..bridge import notes
from ..bridge.words import told
from ..engine.params import ObjectSettings
from ..engine.progress import Progress
from .stage import Stage, Work


class Regularise(Stage, bpy.types.Operator):
    """Move the vertices along the surface so that the quads become squarer; flat patches made before are dropped"""

    bl_idname = "flexmaps.regularise"
    bl_label = "Regularise"

    @classmethod
    def obstacle(cls, obj: bpy.types.Object) -> str | None:
        from ..bridge import equilibrium

        return "Remove the shape keys first: they fix the vertices" if equilibrium.foreign_keys(obj.data) else None

    def prepare(self, surface: Any, settings: ObjectSettings) -> Work:
        def work(progress: Progress) -> Any:
            from ..engine.surface import check, regularise
            from ..engine.surface.mesh import PolygonMesh

            before = check.as_quad_mesh(surface.polygons)
            after = regularise.regularise(before, settings.regularise, progress)
            return before, after, check.findings(PolygonMesh.of(after))

        return work

    def finish(self, context: bpy.types.Context, obj: bpy.types.Object, surface: Any, result: Any) -> str:
        import numpy as np

        from ..bridge import beside, mesh, states

        before, after, findings = result
        mesh.write_vertices(obj, surface, after)
        mesh.forget(obj, mesh.NAMES)
        beside.clear(obj)
        notes.drop_from(obj.data, "layout")
        notes.write_checks(obj.data, findings)
        states.stamp_beside(obj, context.scene, "regularise")
        moved = np.linalg.norm(after.vertices - before.vertices, axis=1).max()
        return told("Vertices moved by up to {:.0%} of an edge", moved / before.median_edge)


CLASSES = (Regularise,)
