"""Choose which values colour the quads of the model."""

from __future__ import annotations

import bpy

from ..bridge.store.i18n import button_name, translate
from ..bridge.view import colouring
from ..engine.errors import FlexMapsError
from .stage import ImmediateOperator, ObjectOperator

BUTTON_OF_KIND = {
    "WIDTH": "Spirals",
    "ANISOTROPY": "Spirals",
    "STIFFNESS": "Spirals",
    "TWIST": "Spirals",
    "SCAN": "Compare with a scan",
}  # kind of overlay -> button that computes its values


class Overlay(ImmediateOperator, ObjectOperator, bpy.types.Operator):
    """Colour the quads by a number; press again to take the colours away. Trace and Merge show their panels, unless the colours were taken away"""

    bl_idname = "flexmaps.overlay"
    bl_label = "Overlay"

    kind: bpy.props.EnumProperty(  # type: ignore[valid-type]
        name="Kind", items=colouring.OVERLAY_ITEMS, default="ENERGY"
    )

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if self.kind == context.window_manager.flexmaps_overlay:  # pressing the same kind again switches it off
            self.kind = "NONE"
        return self.execute(context)

    def run(self, context: bpy.types.Context) -> None:
        from ..bridge.view import overlay

        if self.kind != "NONE" and not colouring.store_colours(context.object, self.kind, recompute=True):
            stage = (
                "Simulate"
                if self.kind in colouring.SIMULATED_KINDS
                else BUTTON_OF_KIND.get(self.kind, "Lay out the panels")
            )
            raise FlexMapsError(translate("There is nothing to show yet; press {} first", button_name(stage)))
        overlay.choose_kind(self.kind)


def shape_to_draw() -> object:
    """Return what to draw over the 3D view: the running job's shape, the live simulation, or the painted spirals."""
    from ..bridge.hosts import background, live
    from ..bridge.view import paint_session

    if background.current_job() is not None:
        return background.latest_result()
    following = live.shown_picture()
    return paint_session.shape_to_draw() if following is None else following


def register() -> None:
    from ..bridge.view import overlay

    overlay.register(shape_to_draw)


def unregister() -> None:
    from ..bridge.view import overlay

    overlay.unregister()


CLASSES = (Overlay,)
