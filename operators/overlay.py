"""Colours on the model: which number they show."""

from __future__ import annotations

from typing import Any

import bpy

from ..bridge.hosts import preload
from ..bridge.store.i18n import button_name, translate
from .live import drawn
from .stage import OnObject

STAGES = {
    "WIDTH": "Spirals",
    "ANISOTROPY": "Spirals",
    "STIFFNESS": "Spirals",
    "TWIST": "Spirals",
    "SCAN": "Compare with a scan",
}  # what to press first


class Overlay(OnObject, bpy.types.Operator):
    """Colour the quads by a number; press again to take the colours away. Trace and Merge show their patches, unless the colours were taken away"""

    bl_idname = "flexmaps.overlay"
    bl_label = "Overlay"
    bl_options = {"REGISTER", "UNDO"}

    kind: bpy.props.EnumProperty(  # type: ignore[valid-type]
        name="Kind",
        items=[
            ("NONE", "None", "No colours"),
            ("ENERGY", "E", "Distortion of every quad when it is flattened"),
            ("SQUARE", "Esq", "How far every quad is from a square"),
            ("PATCH", "Patches", "One colour per patch"),
            ("WIDTH", "Width", "Mean width of the spirals' arms"),
            (
                "ANISOTROPY",
                "Anisotropy",
                "How unlike the two pairs of opposite arms are; the bars are as long as each pair is wide",
            ),
            ("STIFFNESS", "Stiffness", "How stiff the arms of the spirals are against bending, in the mean"),
            ("TWIST", "Twist", "Twist of the spirals"),
            ("DISTANCE", "Distance", "How far the simulated shape is from the target"),
            ("STRAIN_ENERGY", "Energy", "Elastic energy in every spiral of the simulated shape"),
            ("REACH", "Limits", "What keeps every spiral from bending as the target does"),
            (
                "SAFETY",
                "Safety",
                "Largest strain on the surface of every spiral's arms, without fillets, against what the material bears",
            ),
            ("SCAN", "Scan", "How far the built piece, scanned, is from the simulated shape"),
            ("SLOT", "Slots", "Narrowest slot beside the arms of every spiral in the simulated shape"),
            (
                "UTILISATION",
                "Utilisation",
                "The most that the arms of every spiral carry under the load cases, against what they bear",
            ),
        ],
        default="ENERGY",
    )

    def invoke(self, context: bpy.types.Context, event: Any) -> set[str]:
        if self.kind == context.window_manager.flexmaps_overlay:  # the button that is pressed in
            self.kind = "NONE"
        return self.execute(context)

    def execute(self, context: bpy.types.Context) -> set[str]:
        preload.wait()
        from ..bridge.view import colouring, overlay

        if self.kind != "NONE" and not colouring.store(context.object, self.kind, afresh=True):
            stage = "Simulate" if self.kind in colouring.SIMULATED else STAGES.get(self.kind, "Merge")
            self.report({"ERROR"}, translate("There is nothing to show yet; press {} first", button_name(stage)))
            return {"CANCELLED"}
        overlay.switch(self.kind)
        return {"FINISHED"}


def register() -> None:
    from ..bridge.view import overlay

    overlay.register(drawn)


def unregister() -> None:
    from ..bridge.view import overlay

    overlay.unregister()


CLASSES = (Overlay,)
