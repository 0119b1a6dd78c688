"""Width and twist of every spiral, from the curvature of the surface."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import bpy

from ..bridge.store import notes
from ..bridge.store.words import told
from ..engine.errors import FlexMapsError
from ..engine.params import ConnectorParams, ObjectSettings
from ..engine.progress import SILENT, Progress
from .job_stage import GoOn, JobStage

if TYPE_CHECKING:
    import numpy as np

    from ..bridge.store.stored import Taken
    from ..engine.display.solids import Solid
    from ..engine.fabrication.connectors.connect import Connections
    from ..engine.runs.result import Result
    from ..engine.spirals.arcs import Curve
    from ..engine.spirals.design import SpiralDesign


@dataclass(frozen=True, eq=False)
class Drawn:
    """The panels of a design, ready to be shown beside the model.

    look : the settings that their connectors were made with, or ``beside.PLAIN``
    centres : (N, 2) metres, where the origin of every panel lies; outlines : of every panel the outer one, then its holes
    """

    design: SpiralDesign
    look: str
    centres: np.ndarray
    shape: Solid
    outlines: list[tuple[Curve, ...]]

    @staticmethod
    def look_of(settings: ObjectSettings) -> str:
        """What the connectors hang on."""
        return f"{settings.connect}, mill {settings.cut.mill:g}"

    @classmethod
    def of(cls, design: SpiralDesign, settings: ObjectSettings, progress: Progress = SILENT) -> Drawn:
        """With connectors, as the sheets will have them; with plain ends where the settings allow no connectors."""
        from ..engine.display import solids
        from ..engine.fabrication.connectors import connect as connectors

        tolerance = max(settings.sheet.tolerance, solids.DRAWN)
        try:
            made = connectors.connect(design, settings.connect, tolerance, progress, settings.cut.mill)
        except FlexMapsError:  # Export says why
            made = connectors.connect(design, ConnectorParams(connector="none"), tolerance)
        return cls.made_of(design, made, settings)

    @classmethod
    def plain(cls, design: SpiralDesign) -> Drawn:
        """At once, without connectors and outlines; ``Export`` draws them true."""
        from ..bridge.view import beside
        from ..engine.display import arrange, solids

        centres = arrange.side_by_side(design.flat)
        return cls(design, beside.PLAIN, centres, solids.light(design, centres), [])

    @classmethod
    def made_of(cls, design: SpiralDesign, made: Connections, settings: ObjectSettings) -> Drawn:
        """With connectors that are there already."""
        from ..engine.display import arrange, solids

        centres = arrange.side_by_side(design.flat)
        shape = solids.light(design, centres, made.tips)
        return cls(design, cls.look_of(settings), centres, shape, [(o.outer, *o.holes) for o in made.outlines])

    def show(self, context: bpy.types.Context, surface: Any) -> Iterator[None]:
        from ..bridge.store.objects import find
        from ..bridge.view import beside

        obj = find(surface.uid)
        yield from beside.show_spirals(obj, context.scene, self.design, self.shape, self.outlines, self.centres)
        for panels in beside.panels_of(find(surface.uid)):
            panels[beside.LOOK] = self.look


class Spirals(JobStage, bpy.types.Operator):
    """Give every quad its spiral: the more the surface bends there, the softer. Draws the true panels beside the model"""

    bl_idname = "flexmaps.spirals"
    bl_label = "Spirals"
    needs = "flat"

    def going_on(self, obj: bpy.types.Object, taken: Taken) -> GoOn:
        settings = taken.settings

        def go_on(result: Result, progress: Progress) -> Any:
            from ..engine.runs import job
            from ..engine.spirals import design

            made = job.go_on(result, settings, ("spirals",), progress.part(0.0, 0.5)).design
            assert made is not None
            progress(0.5, "Drawing outlines")
            drawn = Drawn.of(made, settings, progress.part(0.5, 0.9))
            return drawn, design.design_report(made, progress.part(0.9, 1.0))

        return go_on

    def after(self, context: bpy.types.Context, surface: Any, result: Any) -> Iterator[None]:
        return result[0].show(context, surface)

    def finish(self, context: bpy.types.Context, obj: bpy.types.Object, surface: Any, result: Any) -> str:
        from ..bridge.store import mesh

        drawn, block = result
        mesh.write_design(obj, drawn.design)
        notes.write(obj.data, "spirals", block)
        low, _, high = block["twist_deg"]
        return told("{} spirals, twist {:.0f} to {:.0f}\N{DEGREE SIGN}", block["count"], low, high)


CLASSES = (Spirals,)
