"""The shape that the assembled piece takes by itself."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import bpy

from ..bridge import notes
from ..engine.errors import FlexMapsError
from ..engine.params import ObjectSettings
from ..engine.progress import Progress
from .stage import Stage, Work

if TYPE_CHECKING:
    from ..engine.mechanics.simulate import Simulation
    from ..engine.optimisation.reach import Reach


class Simulate(Stage, bpy.types.Operator):
    """Find the shape that the assembled panels take. The mesh gets it as a shape key, to slide to from the target"""

    bl_idname = "flexmaps.simulate"
    bl_label = "Simulate"

    @classmethod
    def obstacle(cls, obj: bpy.types.Object) -> str | None:
        return None if "spirals" in notes.read(obj.data) else "Press Spirals first"

    def prepare(self, surface: Any, settings: ObjectSettings) -> Work:
        from ..bridge import live, mesh, supports
        from ..bridge.objects import find

        obj = find(surface.uid)
        held = supports.supported(obj, surface, settings.loads)
        force = supports.force(obj, surface, settings.loads)
        material = settings.material.chosen

        def work(progress: Progress) -> tuple[Simulation, Reach]:
            from ..engine.mechanics import simulate
            from ..engine.optimisation import reach
            from ..engine.surface import check

            progress(0.0, "Reading the spirals")
            quads = check.as_quad_mesh(surface.polygons)
            design = mesh.design_of(surface, mesh.current_flat(surface, quads), settings.spiral)
            if design is None:
                raise FlexMapsError("There are no spirals yet; press Spirals first")
            moving = progress.showing(lambda vertices: live.Moving(vertices, quads.quads))
            found = simulate.simulate(
                design, quads, material, settings.simulate, supports=held, force=force, progress=moving
            )
            progress(0.99, "Looking for what limits the match")
            return found, reach.reach(found)

        return work

    def finish(self, context: bpy.types.Context, obj: bpy.types.Object, surface: Any, result: Any) -> str:
        from ..bridge import equilibrium

        found, limits = result
        equilibrium.write(obj, context.scene, surface, found, limits)
        text, warning = equilibrium.sentences(found.report())
        self.level = "WARNING" if warning else "INFO"
        return text


CLASSES = (Simulate,)
