"""Animate the assembly."""

from __future__ import annotations

from typing import TYPE_CHECKING

import bpy

from ..bridge.store.i18n import translate
from ..engine.errors import FlexMapsError
from ..engine.progress import Progress
from .continued_stage import Continuation, ContinuedStage

if TYPE_CHECKING:
    from ..bridge.store.snapshot import Snapshot
    from ..bridge.store.surface import ObjectSurface
    from ..engine.extras.film.assembly_film import Film
    from ..engine.mechanics.assembly import Pose
    from ..engine.params import ObjectSettings
    from ..engine.runs.result import Result

    # the film, the pose at its end, and the settings
    FinishedFilm = tuple[Film, Pose, ObjectSettings]


class Animate(ContinuedStage["FinishedFilm"], bpy.types.Operator):
    """Animate the assembly: the panels fly from the table to their places and are joined seam by seam, and what is joined rests in its simulated shape. Play it with the space bar"""

    bl_idname = "flexmaps.animate"
    bl_label = "Animate assembly"

    required_output = "simulation"

    def continuation(self, obj: bpy.types.Object, snapshot: Snapshot) -> Continuation[FinishedFilm]:
        from ..bridge.store import pose
        from ..bridge.view import preview
        from ..engine.runs import stages

        settings, stored = snapshot.settings, pose.read(obj, snapshot.surface.to_metres)
        if stored is None:
            raise FlexMapsError(stages.MISSING["simulation"])
        if settings.preview.colour != "MATERIAL":
            preview.quad_colours(obj, settings.preview.colour)

        def go_on(result: Result, progress: Progress) -> FinishedFilm:
            from ..engine.display import arrange
            from ..engine.display.panel_mesh import DETAILS
            from ..engine.extras.film import assembly_film
            from ..engine.extras.film.film_params import FilmParams
            from ..engine.runs.outputs import DesignVersion

            design = result.need(DesignVersion).design
            detail = DETAILS[settings.section(FilmParams).film_detail]
            table = arrange.places_before_assembly(design, stored)
            tips = preview.connector_tips(design, settings, progress.part(0.0, 0.2))
            rest = progress.part(0.2 if tips else 0.0, 1.0)
            material = settings.material.chosen
            made = assembly_film.make_film(design, stored, table, detail, material, settings.simulate, rest, tips)
            return made, stored, settings

        return go_on

    def finish(
        self, context: bpy.types.Context, obj: bpy.types.Object, surface: ObjectSurface, result: FinishedFilm
    ) -> str:
        from ..bridge.view import animation, collection, preview
        from ..engine.extras.film.film_params import FilmParams

        film, stored, settings = result
        colour, scene = settings.preview.colour, context.scene
        rgb = None if colour == "MATERIAL" else preview.quad_colours(obj, colour)
        place = preview.shift_beside(obj, scene, stored.centres.min(axis=0), stored.centres.max(axis=0))
        collection.clear(obj, (preview.KIND, preview.BASE))
        place *= settings.preview.place == "BESIDE"
        _, last = animation.show(obj, scene, film, settings.section(FilmParams).seconds, rgb, place)
        scene.frame_end = max(scene.frame_end, last)
        frames, skipped = last - scene.frame_start + 1, film.stages.skipped
        text = translate("{} panels in {} frames; play them with the space bar", len(film.tracks), frames)
        if not skipped:
            return text
        self.level = "WARNING"
        names = ", ".join(f"{panel}-{seam}" for panel, seam in skipped[:4]) + ", ..." * (len(skipped) > 4)
        blended = translate(
            "{} half-finished pieces (panel-seam {}) find no rest; blends stand in", len(skipped), names
        )
        return f"{text}. {blended}"


CLASSES = (Animate,)
