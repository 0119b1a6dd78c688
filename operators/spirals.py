"""Width and twist of every spiral, from the curvature of the surface."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import bpy

from ..bridge import notes
from ..engine.params import ObjectSettings
from ..engine.progress import Progress
from .stage import Stage, Work

if TYPE_CHECKING:
    from ..engine.arcs import Curve
    from ..engine.design import SpiralDesign

DRAWN = 0.00005  # metres: how far the outlines that are drawn beside the model may stray from the true ones


class Spirals(Stage, bpy.types.Operator):
    """Give every quad its spiral: the more the surface bends there, the softer. Draws the true panels beside the model"""

    bl_idname = "flexmaps.spirals"
    bl_label = "Spirals"

    @classmethod
    def obstacle(cls, obj: bpy.types.Object) -> str | None:
        return None if "layout" in notes.read(obj.data) else "Merge or flatten first"

    def prepare(self, surface: Any, settings: ObjectSettings) -> Work:
        from ..bridge import mesh

        def work(progress: Progress) -> Any:
            from ..engine import check, curvature, design

            progress(0.0, "Measuring curvature")
            quads = check.as_quad_mesh(surface.polygons)
            flat = mesh.current_flat(surface, quads)
            made = design.from_curvature(flat, settings.spiral, curvature.rms_curvature(quads))
            progress(0.5, "Drawing outlines")
            return made, drawn(made, settings), design.design_report(made)

        return work

    def finish(self, context: bpy.types.Context, obj: bpy.types.Object, surface: Any, result: Any) -> str:
        from ..bridge import arrange, beside, mesh

        design, outlines, block = result
        mesh.write_design(obj, design)
        beside.show_spirals(obj, context.scene, design, outlines, arrange.side_by_side(design.flat))
        notes.write(obj.data, "spirals", block)
        low, _, high = block["twist_deg"]
        return f"{block['count']} spirals, twist {low:.0f} to {high:.0f}\N{DEGREE SIGN}"


def drawn(design: SpiralDesign, settings: ObjectSettings) -> list[tuple[Curve, ...]]:
    """The outlines of the panels as they are drawn beside the model: of every panel the outer one, then its holes."""
    tolerance = max(settings.sheet.tolerance, DRAWN)
    return [(o.outer, *o.holes) for o in design.outlines(tolerance)]


CLASSES = (Spirals,)
