"""The assembly as an animation."""

from __future__ import annotations

from typing import Any

import bpy

from ..bridge import notes
from ..bridge.words import told
from ..engine.errors import FlexMapsError
from ..engine.params import ObjectSettings
from ..engine.progress import Progress
from .stage import Stage, Work


class Animate(Stage, bpy.types.Operator):
    """Animate the assembly: the panels fly from the table to their places and are joined seam by seam, and what is joined rests in its simulated shape. Play it with the space bar"""

    bl_idname = "flexmaps.animate"
    bl_label = "Animate assembly"

    @classmethod
    def obstacle(cls, obj: bpy.types.Object) -> str | None:
        blocks = notes.read(obj.data)
        return None if "equilibrium" in blocks else "Press Simulate or Optimise first"

    def prepare(self, surface: Any, settings: ObjectSettings) -> Work:
        from ..bridge import animation, mesh, pose, preview
        from ..bridge.objects import find

        obj = find(surface.uid)
        found = pose.read(obj, surface.to_metres)
        if found is None:
            raise FlexMapsError("There is no simulated shape yet; press Simulate first")
        if settings.preview.colour != "MATERIAL":
            preview.quad_colours(obj, settings.preview.colour)
        material = settings.material.chosen

        def work(progress: Progress) -> Any:
            from ..engine.assembling import assembly_film
            from ..engine.fabrication.panel_mesh import DETAILS
            from ..engine.surface import check

            progress(0.0, "Reading the spirals")
            design = mesh.design_of(
                surface, mesh.current_flat(surface, check.as_quad_mesh(surface.polygons)), settings.spiral
            )
            if design is None:
                raise FlexMapsError("There are no spirals yet; press Spirals first")
            detail = DETAILS[settings.film.film_detail]
            table = animation.on_table(design, found)
            tips = preview.tips_of(design, settings, progress.part(0.0, 0.2))
            rest = progress.part(0.2 if tips else 0.0, 1.0)
            made = assembly_film.film(design, found, table, detail, material, settings.simulate, rest, tips)
            return made, found, settings

        return work

    def finish(self, context: bpy.types.Context, obj: bpy.types.Object, surface: Any, result: Any) -> str:
        from ..bridge import animation, beside, preview

        film, found, settings = result
        colour, scene = settings.preview.colour, context.scene
        rgb = None if colour == "MATERIAL" else preview.quad_colours(obj, colour)
        place = preview.shift(obj, scene, found.centres.min(axis=0), found.centres.max(axis=0))
        beside.clear(obj, (preview.KIND,))
        _, last = animation.show(
            obj, scene, film, settings.film.seconds, rgb, place * (settings.preview.place == "BESIDE")
        )
        scene.frame_end = max(scene.frame_end, last)
        frames, skipped = last - scene.frame_start + 1, film.stages.skipped
        text = told("{} panels in {} frames; play them with the space bar", len(film.tracks), frames)
        if not skipped:
            return text
        self.level = "WARNING"
        names = ", ".join(f"{panel}-{seam}" for panel, seam in skipped[:4]) + ", ..." * (len(skipped) > 4)
        blended = told("{} half-finished pieces (panel-seam {}) find no rest; blends stand in", len(skipped), names)
        return f"{text}. {blended}"


CLASSES = (Animate,)
