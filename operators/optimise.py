"""Better spirals: those whose assembly comes closest to the target."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import bpy

from ..bridge import notes
from ..bridge.words import told
from ..engine.errors import Cancelled
from ..engine.params import ObjectSettings
from ..engine.progress import Progress
from .spirals import Drawn
from .stage import Stage, Work

if TYPE_CHECKING:
    from ..bridge.live import Moving
    from ..engine.optimisation.optimise import Look
    from ..engine.optimisation.reach import Reach


class Optimise(Stage, bpy.types.Operator):
    """Change width and twist of every spiral until the assembled panels take the target's shape as well as they can. Begins with the spirals that are there; press again to go on"""

    bl_idname = "flexmaps.optimise"
    bl_label = "Optimise"
    on_stop = "the best so far is kept"

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
        unit = bpy.context.scene.unit_settings.scale_length

        def work(progress: Progress) -> Any:
            from ..engine.optimisation import optimise, reach
            from ..engine.patches import flatten
            from ..engine.spirals import design
            from ..engine.surface import check

            progress(0.0, "Reading the spirals")
            quads = check.as_quad_mesh(surface.polygons)
            start = mesh.start_of(surface, mesh.current_flat(surface, quads), settings.spiral, block)
            began, history = time.perf_counter(), list[tuple[float, float]]()

            def seen(look: Look) -> Moving:
                history.append((time.perf_counter() - began, look.rmse))
                return designing.Designing(look, quads.quads, settings.spiral, tuple(history)).prepared(unit)

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
            limits: Reach | None = None
            try:
                progress(0.95, "Drawing outlines")
                panels = Drawn.of(found.design, settings, progress.part(0.95, 0.98))
                spirals = design.design_report(found.design, progress.part(0.98, 1.0))
                progress(1.0, "Looking for what limits the match")
                limits = reach.reach(found)
            except Cancelled:  # there is a result to keep, but nobody wants to wait until all is known of it
                panels, spirals = Drawn.plain(found.design), design.design_report(found.design, measured=False)
            flat = found.design.flat
            layout = None if flat is start.flat else flatten.layout_report(flat)
            return panels, found.after, found.report(), limits, spirals, layout

        return work

    def after(self, context: bpy.types.Context, surface: Any, result: Any) -> Iterator[None]:
        return result[0].show(context, surface)

    def finish(self, context: bpy.types.Context, obj: bpy.types.Object, surface: Any, result: Any) -> str:
        from ..bridge import equilibrium, mesh

        panels, simulation, report, limits, block, layout = result
        if layout is not None:  # the flat shapes moved too
            mesh.write_flat(obj, surface, panels.design.flat, panels.centres)
            notes.write(obj.data, "layout", notes.read(obj.data).get("layout", {}) | layout)
        mesh.write_design(obj, panels.design)
        notes.write(obj.data, "spirals", block)
        equilibrium.write(obj, context.scene, surface, simulation, limits)
        notes.write(obj.data, "optimise", report)
        text, warning = equilibrium.sentences(simulation.report())
        self.level = "WARNING" if warning else "INFO"
        better = report["laplacian_rmse_mm_before"], report["laplacian_rmse_mm"], report["iterations"]
        lines = [
            *([] if report["finished"] else [told("Stopped; the best so far is kept")]),
            told("RMSE {:.3g} to {:.3g} mm in {} steps", *better),
            *([text] if warning else []),
        ]
        return ". ".join(lines)


CLASSES = (Optimise,)
