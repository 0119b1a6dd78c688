"""An object whose spirals are being painted: its design, what a stroke changes, and how it looks meanwhile.

Reading an object takes a while, so an easel stays from one stroke to the next, as long as the object holds what it was left with.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import bpy
import numpy as np

from ...engine import colours
from ...engine.arrays import Bool, Float
from ...engine.errors import FlexMapsError
from ...engine.params import ObjectSettings
from ..store import attributes, equilibrium, fields, notes, objects, settings, states
from ..store.checksums import Checksums
from .colouring import stiffness_legend, stiffness_share
from .live_shape import LiveShape, middle_edge

if TYPE_CHECKING:
    from ...engine.runs.result import Result
    from ...engine.spirals.design import SpiralDesign
    from ...engine.spirals.painting import Stroke

TOOL = "flexmaps.brush"  # the tool in Blender's toolbar
PALE = 0.5 + 0.5 * colours.MUCH  # the dark arms stand out from every colour of the scale
LIFT = 0.012  # how far the arms float above the faces, in edges
PROTECTED = np.array([0.55, 0.60, 0.68])  # sRGB of spirals that Optimise has to leave alone; by eye

_easels: list[Easel] = []


class Painting(LiveShape):
    """The surface coloured by stiffness, its arms in dark; protected spirals are grey."""

    def __init__(self, easel: Easel):
        super().__init__(easel.vertices, easel.quads)
        self._design, self._stiffness, self._range = easel.design, easel.stiffness, easel.range
        self._protected = easel.protected
        self.legend = stiffness_legend(*easel.range)
        if easel.protected.any():
            self.legend = replace(self.legend, title=f"{self.legend.title}; grey: protected")

    @property
    def colours(self) -> np.ndarray:
        share = stiffness_share(self._stiffness, *self._range)
        anchors = np.linspace(0.0, 1.0, len(PALE))
        rgb = np.stack([np.interp(share, anchors, PALE[:, k]) for k in range(3)], axis=1)
        return np.where(self._protected[:, None], PROTECTED, rgb)

    def bands(self, unit: float) -> tuple[np.ndarray, np.ndarray]:
        from ...engine.display import bands

        corners, normal = self.frame(unit)
        twist = self._design.twist
        wind = -twist if self._design.params.clockwise else twist
        found = bands.bands(corners, normal, self._design.width / unit, wind, LIFT * middle_edge(corners))
        return found[0].astype(np.float32), found[1].astype(np.int32)


class Easel:
    """One object on it.

    design : as it is painted by now; before : as the object holds it
    vertices, quads : as they are seen, metres and world axes; protected : (F,) bool; stiffness : (F,) N mm/rad
    """

    design: SpiralDesign
    before: SpiralDesign

    def __init__(self, obj: bpy.types.Object, scene: bpy.types.Scene):
        from ...engine.mechanics.arms.spiral_stiffness import stiffness
        from ...engine.runs import stages
        from ..store import mesh, snapshot

        self.uid = obj.session_uid
        self._used = settings.read(obj.flexmaps, ObjectSettings)
        self._surface = mesh.read_surface(obj, scene)
        taken = snapshot.take(obj, self._surface, self._used, loaded=False)
        missing = notes.missing(obj.data, "flat")
        if missing:
            raise FlexMapsError(missing)
        result: Result = taken.start(taken.result())
        stages.needed(result, "flat")
        assert result.design is not None
        self.design = self.before = result.design
        count = len(result.design.twist)
        self.protected = self._marked = np.isin(np.arange(count), [] if taken.protected is None else taken.protected)
        found = stiffness(self.design, self._used.material.chosen)
        self.stiffness = np.ones(count) if found is None else found
        self.range = float(self.stiffness.min()), float(self.stiffness.max())
        self._see(obj)
        self._sums = self._now(obj, scene)

    def _see(self, obj: bpy.types.Object) -> None:
        """Take the shape as it is seen now."""
        from ...engine.spirals.dab import Ground

        seen = equilibrium.shown_positions(obj.data).astype(float)
        frame = self._surface.to_metres
        self.vertices = seen @ frame[:3, :3].T + frame[:3, 3]
        self.quads = self._surface.polygons.corners.reshape(-1, 4)
        self.ground = Ground.of(self.vertices, self.quads)
        self.shape = Painting(self)

    def _now(self, obj: bpy.types.Object, scene: bpy.types.Scene) -> tuple[Any, ...]:
        sums = Checksums(obj, scene)
        marks = attributes.get(obj.data, fields.PROTECT)
        placed = tuple(x for row in obj.matrix_world for x in row)
        moved = tuple(key.value for key in equilibrium.keys_of(obj.data))
        names = ("design", "shape", "seams", "spiral", "material")
        return (*(sums[part] for part in names), b"" if marks is None else marks.tobytes(), placed, moved)

    def fresh(self, obj: bpy.types.Object, scene: bpy.types.Scene) -> bool:
        """Whether the object still holds what is on the easel."""
        return obj.session_uid == self.uid and obj.mode == "OBJECT" and self._now(obj, scene) == self._sums

    # -- painting ----------------------------------------------------------------------------------------------------

    def paint(self, brush: str, weight: Float[np.ndarray, " quads"], stroke: Stroke) -> None:
        """One dab; of the brush ``protect`` it marks, or unmarks, what is painted to a half at least."""
        if brush == "protect":
            self.protected = np.where(weight >= 0.5, not stroke.inverted, self.protected)
        else:
            self._paint(brush, weight, stroke)
        self.shape = Painting(self)

    def _paint(self, brush: str, weight: np.ndarray, stroke: Stroke) -> None:
        from ...engine.mechanics.arms.spiral_stiffness import renewed
        from ...engine.spirals.painting import painted

        old, self.design = self.design, painted(self.design, brush, weight, stroke, kept=np.flatnonzero(self.protected))
        changed = (old.width != self.design.width).any(axis=1) | (old.twist != self.design.twist)
        if changed.any():
            self.stiffness = renewed(self.stiffness, self.design, self._used.material.chosen, changed)
            low, high = self.range
            self.range = min(low, float(self.stiffness.min())), max(high, float(self.stiffness.max()))

    def revert(self) -> None:
        """Take back what was painted since the object was read or written."""
        from ...engine.mechanics.arms.spiral_stiffness import stiffness

        self.design, self.protected = self.before, self._marked
        found = stiffness(self.design, self._used.material.chosen)
        self.stiffness = self.stiffness if found is None else found
        self.shape = Painting(self)

    @property
    def changed(self) -> Bool[np.ndarray, " quads"]:
        """The spirals that are others than the object holds."""
        return (self.before.width != self.design.width).any(axis=1) | (self.before.twist != self.design.twist)

    def write(self, scene: bpy.types.Scene) -> None:
        """Give the object what was painted: its spirals are done then, and what was made from the former ones is out of date."""
        from ...engine.spirals.design import design_report
        from ..store import mesh
        from . import flat_panels, overlay

        obj = objects.find(self.uid)
        if self.changed.any():
            mesh.write_design(obj, self._surface, self.design)
            fields.write_stiffness(obj, self.stiffness)
            notes.write(obj.data, "spirals", design_report(self.design, measured=False))
            states.stamp(obj, scene)
            for _ in flat_panels.PanelDrawing.plain(self.design).show(obj, scene):
                pass
            overlay.renew(obj, "STIFFNESS")
        fields.protect(obj, np.flatnonzero(self.protected))
        self.before, self._marked = self.design, self.protected
        self._see(obj)
        self._sums = self._now(obj, scene)


# -- the easel that stands there ---------------------------------------------------------------------------------------


def of(obj: bpy.types.Object, scene: bpy.types.Scene) -> Easel:
    """The object's easel, set up anew where it holds something else by now. Raises ``FlexMapsError`` where it has no spirals."""
    if not (_easels and _easels[0].fresh(obj, scene)):
        _easels[:] = [Easel(obj, scene)]
    return _easels[0]


@bpy.app.handlers.persistent
def forget(*_: object) -> None:
    """Put it away, such as before another file is opened."""
    _easels.clear()


def active(context: bpy.types.Context) -> bool:
    """Whether the brush is the tool of the 3D view in object mode."""
    tool = context.workspace.tools.from_space_view3d_mode("OBJECT") if context.workspace is not None else None
    return tool is not None and tool.idname == TOOL


def shown() -> Painting | None:
    """What is drawn over the 3D view while the brush is the tool; None where the easel holds something else than the active object."""
    context = bpy.context
    obj = context.object
    if not _easels or obj is None or obj.type != "MESH" or not active(context) or not obj.visible_get():
        return None
    with suppress(FlexMapsError, ReferenceError):
        if _busy or _easels[0].fresh(obj, context.scene):
            return _easels[0].shape
    return None


@bpy.app.handlers.persistent
def renew(*_: object) -> None:
    """After an undo or redo the object holds other spirals: take them a moment later, when Blender is done with its step."""
    if _easels and not bpy.app.timers.is_registered(_renew):
        bpy.app.timers.register(_renew, first_interval=0.0)


def _renew() -> None:
    context = bpy.context
    obj = context.object
    if _easels and obj is not None and obj.session_uid == _easels[0].uid and active(context):
        with suppress(FlexMapsError):
            of(obj, context.scene)


_busy: list[bool] = []  # not empty during a stroke, when nothing else can change the object


def stroke_begins() -> None:
    _busy[:] = [True]


def stroke_ends() -> None:
    _busy.clear()
