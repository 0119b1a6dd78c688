"""Better spirals: those whose assembly comes closest to the target."""

from __future__ import annotations

import time
from contextlib import suppress
from typing import TYPE_CHECKING, Any

import bpy

from ..bridge import notes
from ..engine.errors import Cancelled
from ..engine.params import ObjectSettings
from ..engine.progress import Progress
from .spirals import drawn
from .stage import Stage, Work

if TYPE_CHECKING:
    from ..bridge.designing import Designing
    from ..engine.optimise import Look


class Optimise(Stage, bpy.types.Operator):
    """Change width and twist of every spiral until the assembled panels take the target's shape as well as they can. Begins with the spirals that are there; press again to go on"""

    bl_idname = "flexmaps.optimise"
    bl_label = "Optimise"
    on_stop = "the best spirals so far are kept"

    @classmethod
    def obstacle(cls, obj: bpy.types.Object) -> str | None:
        from ..bridge import attributes

        blocks = notes.read(obj.data)
        if "layout" not in blocks:
            return "Merge or flatten first"
        if "spirals" in blocks or attributes.has(obj, "flexmaps_last_width"):
            return None
        return "Press Spirals first"

    def prepare(self, surface: Any, settings: ObjectSettings) -> Work:
        from ..bridge import designing, mesh, supports
        from ..bridge.objects import find

        obj = find(surface.uid)
        held = supports.supported(obj, surface, settings.loads)
        force = supports.force(obj, surface, settings.loads)
        material = settings.material.chosen
        block = notes.read(obj.data).get("spirals")

        def work(progress: Progress) -> Any:
            from ..engine import check, design, optimise, reach

            progress(0.0, "Reading the spirals")
            quads = check.as_quad_mesh(surface.polygons)
            start = mesh.start_of(surface, mesh.current_flat(surface, quads), settings.spiral, block)
            began, history = time.perf_counter(), list[tuple[float, float]]()

            def seen(look: Look) -> Designing:
                history.append((time.perf_counter() - began, look.rmse))
                return designing.Designing(look, quads.quads, settings.spiral, tuple(history))

            found = optimise.optimise(
                start,
                quads,
                material,
                settings.optimise,
                settings.simulate,
                supports=held,
                force=force,
                progress=progress.part(0.0, 0.95).showing(seen),
            )
            with suppress(Cancelled):  # stopped or not, there is a result to keep
                progress(0.95, "Drawing outlines")
            return found, reach.reach(found), drawn(found.design, settings), design.design_report(found.design)

        return work

    def finish(self, context: bpy.types.Context, obj: bpy.types.Object, surface: Any, result: Any) -> str:
        from ..bridge import arrange, beside, equilibrium, mesh

        found, limits, outlines, block = result
        mesh.write_design(obj, found.design)
        notes.write(obj.data, "spirals", block)
        equilibrium.write(obj, context.scene, surface, found.after, limits)
        report = found.report()
        notes.write(obj.data, "optimise", report | equilibrium.mark(obj, context.scene))
        beside.show_spirals(obj, context.scene, found.design, outlines, arrange.side_by_side(found.design.flat))
        self.level = "INFO" if equilibrium.sound(found.after.report()) else "WARNING"
        return (
            f"{'' if found.finished else 'Stopped; the best so far is kept. '}RMSE "
            f"{report['laplacian_rmse_mm_before']:.3g} to {report['laplacian_rmse_mm']:.3g} mm "
            f"in {report['iterations']} steps"
        )


CLASSES = (Optimise,)
