"""Paint session: state of an object whose spirals are painted with the brush (design, changes by a stroke, picture).

Reading an object takes a while, so its session is kept between strokes as long as the object is unchanged.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import bpy
import numpy as np

from ...engine import colours
from ...engine.arrays import Bool, Float
from ...engine.errors import FlexMapsError
from ...engine.params import ObjectSettings
from ..store import attributes, equilibrium, fields, objects, settings, states, stored_report, vertex_positions
from ..store.checksums import Checksums
from .colouring import stiffness_legend, stiffness_share
from .live_shape import LIFT, LiveShape, median_edge

if TYPE_CHECKING:
    from ...engine.spirals.brush_weights import PaintSurface
    from ...engine.spirals.design import SpiralDesign
    from ...engine.spirals.painting import Stroke
    from ..store.snapshot import Snapshot
    from ..store.surface import ObjectSurface

TOOL_ID = "flexmaps.brush"  # id of the tool in Blender's toolbar
PROTECTED = np.array([0.55, 0.60, 0.68])  # sRGB of protected spirals, a grey that is not on the colour scale; by eye
# Designs whose stiffness is kept for undo (Blender's default: 32 steps). Larger: more memory; smaller: slower long undos
UNDO_STEPS = 64

_sessions: list[PaintSession] = []


class PaintedShape(LiveShape):
    """Picture of the painted surface: coloured by stiffness, arms dark, protected spirals grey.

    Parameters
    ----------
    session, vertices : the painted object, and its vertices to draw, metres and world axes
    previous : earlier picture of the same vertices; only the arms of changed spirals are recomputed
    """

    def __init__(
        self, session: PaintSession, vertices: Float[np.ndarray, "vertices 3"], previous: PaintedShape | None = None
    ):
        super().__init__(vertices, session.quads)
        self._design, self._stiffness, self._range = session.design, session.stiffness, session.stiffness_range
        self._protected = session.protected
        self._former = previous if previous is not None and previous.is_prepared else None
        self.legend = stiffness_legend(*session.stiffness_range)
        if session.protected.any():
            self.legend = replace(self.legend, title=f"{self.legend.title}; grey: protected")

    @property
    def colours(self) -> np.ndarray:
        share = stiffness_share(self._stiffness, *self._range)
        rgb = colours.interpolate_scale(share, colours.mix_with_white(colours.QUANTITY_SCALE))
        return np.where(self._protected[:, None], PROTECTED, rgb)

    def bands(self, unit: float) -> tuple[np.ndarray, np.ndarray]:
        from ...engine.display import bands

        former, self._former = self._former, None
        corners, normal = self.corners_and_normals(unit)
        lift, design = LIFT * median_edge(corners), self._design
        wind = -design.twist if design.params.clockwise else design.twist
        known = None if former is None else former.prepared_bands
        if former is None or known is None:
            arrays = bands.make_bands(corners, normal, design.width / unit, wind, lift)
            return arrays[0].astype(np.float32), arrays[1].astype(np.int32)
        changed = np.flatnonzero(design.changed_spirals(former._design))
        points = known[0].reshape(len(corners), -1, 3).copy()
        pieces = points.shape[1] // 8 - 1
        part = corners[changed], normal[changed], design.width[changed] / unit, wind[changed], lift, pieces
        points[changed] = bands.make_bands(*part)[0].reshape(len(changed), *points.shape[1:])
        return points.reshape(-1, 3), known[1]


@dataclass(frozen=True, eq=False)
class VisibleSurface:
    """An object's surface in one shape: vertices (metres, world axes), the surface for the brush, and the picture."""

    vertices: Float[np.ndarray, "vertices 3"]
    brush_surface: PaintSurface
    shape: PaintedShape

    @classmethod
    def from_session(cls, session: PaintSession, vertices: Float[np.ndarray, "vertices 3"]) -> VisibleSurface:
        from ...engine.spirals.brush_weights import PaintSurface

        return cls(vertices, PaintSurface.from_mesh(vertices, session.quads), PaintedShape(session, vertices))


class PaintSession:
    """One object being painted.

    design : the painted spirals
    stored_design : the spirals stored in the object
    vertices, quads : the surface as it is seen, metres and world axes
    protected : whether each spiral is protected from the brush and the optimisation (F,)
    stiffness : stiffness of each spiral (F,), N mm/rad
    stiffness_range : smallest and largest stiffness seen so far, the ends of the colour scale
    """

    design: SpiralDesign
    stored_design: SpiralDesign
    shape: PaintedShape

    def __init__(self, obj: bpy.types.Object, scene: bpy.types.Scene):
        from ...engine.mechanics.arms.spiral_stiffness import spiral_stiffness
        from ...engine.runs.outputs import DesignVersion, FinalLayout
        from ..store import mesh
        from .painted_panels import PaintedPanels

        self.uid = obj.session_uid
        self._settings = settings.read(obj.flexmaps, ObjectSettings)
        self._surface = mesh.read_surface(obj, scene)
        taken = self._take_snapshot(obj, self._surface)
        result = taken.to_result()
        result.need(FinalLayout)
        self._reset(taken.with_start(result).need(DesignVersion).design, taken)
        measured = spiral_stiffness(self.design, self._settings.material.chosen)
        self.stiffness = np.ones(len(self.design.twist)) if measured is None else measured
        self.stiffness_range = float(self.stiffness.min()), float(self.stiffness.max())
        self._panels = PaintedPanels(obj.name, self.design)
        self._prepared_design: SpiralDesign | None = None  # the design for which ``prepare_write`` has run
        self._unit = scene.unit_settings.scale_length
        self.quads = self._surface.polygons.corners.reshape(-1, 4)
        self._set_visible_surface(
            VisibleSurface.from_session(self, self._to_world(vertex_positions.read_displayed(obj)))
        )
        self._stiffness_by_design: dict[object, np.ndarray] = {}
        self._store_checksums(self._compute_checksums(obj, scene))

    def _take_snapshot(self, obj: bpy.types.Object, surface: ObjectSurface) -> Snapshot:
        from ..store import snapshot

        missing = stored_report.missing_result(obj.data, "flat")
        if missing:
            raise FlexMapsError(missing)
        return snapshot.take_snapshot(obj, surface, self._settings, with_loads=False)

    def _reset(self, design: SpiralDesign, snapshot: Snapshot) -> None:
        """Reset the painted spirals and the protected ones to the object's stored state."""
        self.design = self.stored_design = design
        self.protected = np.zeros(len(design.twist), bool)
        self.protected[[] if snapshot.protected_quads is None else snapshot.protected_quads] = True
        self._stored_protected = self.protected

    def try_update(self, obj: bpy.types.Object, scene: bpy.types.Scene) -> bool:
        """Adopt the object's stored spirals and protection if they changed, such as by an undo.

        Return False if anything else has changed, so that a new session is needed. This is quick enough for the main
        thread, unlike making a new session.
        """
        from ...engine.spirals.fabricable import unfabricable_quads
        from ..store import mesh

        if obj.session_uid != self.uid or obj.mode != "OBJECT":
            return False
        now = self._compute_checksums(obj, scene)
        changed = {name for name in now if now[name] != self._sums[name]}
        if not changed <= {"design", "protected", "moved"}:
            return False
        if not changed:
            return True
        surface = mesh.read_surface(obj, scene)
        flat = [[one.values.get(name) for name in mesh.FLAT_NAMES] for one in (surface, self._surface)]
        if any(a is None or b is None or not np.array_equal(a, b) for a, b in zip(*flat, strict=True)):
            return False
        old, design = self.design, mesh.read_design(surface, self.design.flat, self.design.params)
        known = self._stiffness_by_design.get(now["design"])
        if (
            design is None
            or len(surface.invalid_faces)
            or (known is None and len(unfabricable_quads(design, design.changed_spirals(old))))
        ):
            return False
        taken, self._surface = self._take_snapshot(obj, surface), surface
        self._reset(replace(design, is_painted=bool((taken.spirals_block or {}).get("painted"))), taken)
        stored = surface.values.get("stiffness")  # up to date if present: any other change of design removes it
        if known is not None:
            self.stiffness = known
        elif stored is not None:
            self.stiffness = stored.astype(float)
        else:
            self._update_stiffness(old)
        moved = self._visible_surface_at(vertex_positions.read_displayed(obj))
        if moved is None:
            self.shape = PaintedShape(self, self.vertices, self.shape)
        else:
            self._set_visible_surface(moved)
        self._store_checksums(now)
        return True

    def _store_checksums(self, sums: dict[str, object]) -> None:
        """Store the object's checksums, and its spirals' stiffness so that undo and redo need not recompute it."""
        self._sums = sums
        self._stiffness_by_design.pop(sums["design"], None)
        self._stiffness_by_design[sums["design"]] = self.stiffness
        if len(self._stiffness_by_design) > UNDO_STEPS:
            del self._stiffness_by_design[next(iter(self._stiffness_by_design))]

    def _to_world(self, positions: Float[np.ndarray, "vertices 3"]) -> Float[np.ndarray, "vertices 3"]:
        """Convert positions in the object's frame to metres and world axes."""
        frame = self._surface.to_metres
        return positions.astype(float) @ frame[:3, :3].T + frame[:3, 3]

    def _visible_surface_at(self, positions: Float[np.ndarray, "vertices 3"]) -> VisibleSurface | None:
        """Return the surface with vertices at these positions (object's frame); None if they have not moved."""
        vertices = self._to_world(positions)
        return None if np.array_equal(vertices, self.vertices) else VisibleSurface.from_session(self, vertices)

    def _set_visible_surface(self, surface: VisibleSurface) -> None:
        self.vertices, self.brush_surface, self.shape = surface.vertices, surface.brush_surface, surface.shape

    def _compute_checksums(self, obj: bpy.types.Object, scene: bpy.types.Scene) -> dict[str, object]:
        sums = Checksums(obj, scene)
        marks = attributes.read(obj.data, fields.PROTECT)
        moved = tuple(key.value for key in equilibrium.simulated_keys(obj.data))
        names = ("design", "shape", "seams", "spiral", "material")
        own: dict[str, object] = {"protected": b"" if marks is None else marks.tobytes(), "moved": moved}
        placed = (*(x for row in obj.matrix_world for x in row), scene.unit_settings.scale_length)
        return {part: sums[part] for part in names} | own | {"placed": placed}

    def is_current(self, obj: bpy.types.Object, scene: bpy.types.Scene) -> bool:
        """Return whether the object is unchanged since it was read or written."""
        return (
            obj.session_uid == self.uid and obj.mode == "OBJECT" and self._compute_checksums(obj, scene) == self._sums
        )

    # -- painting ----------------------------------------------------------------------------------------------------

    def paint(self, brush: str, weight: Float[np.ndarray, " quads"], stroke: Stroke) -> None:
        """Apply one dab, or several merged dabs.

        Parameters
        ----------
        brush : name of the brush; "protect" protects spirals of weight 0.5 or more, or unprotects them if inverted
        weight : weights on the quads (F,), from 0 to 1
        stroke : options of the brush
        """
        if brush == "protect":
            self.protected = np.where(weight >= 0.5, not stroke.is_inverted, self.protected)
        else:
            self._paint_design(brush, weight, stroke)
        shape = PaintedShape(self, self.vertices, self.shape)
        shape.prepare(self._unit)  # compute the arrays here, because this method may run in a thread
        self.shape = shape

    def _paint_design(self, brush: str, weight: np.ndarray, stroke: Stroke) -> None:
        from ...engine.spirals.painting import paint_spirals

        old, self.design = (
            self.design,
            paint_spirals(self.design, brush, weight, stroke, fixed=np.flatnonzero(self.protected)),
        )
        self._update_stiffness(old)

    def _update_stiffness(self, old: SpiralDesign) -> None:
        from ...engine.mechanics.arms.spiral_stiffness import update_stiffness

        changed = self.design.changed_spirals(old)
        if changed.any():
            self.stiffness = update_stiffness(self.stiffness, self.design, self._settings.material.chosen, changed)
            low, high = self.stiffness_range
            self.stiffness_range = min(low, float(self.stiffness.min())), max(high, float(self.stiffness.max()))

    def revert(self) -> None:
        """Discard the painting since the object was last read or written."""
        old, self.design, self.protected = self.design, self.stored_design, self._stored_protected
        self._update_stiffness(old)
        self.shape = PaintedShape(self, self.vertices, self.shape)

    @property
    def changed_spirals(self) -> Bool[np.ndarray, " quads"]:
        """Return a mask of the spirals that differ from the object's stored spirals."""
        return self.design.changed_spirals(self.stored_design)

    @property
    def is_prepared(self) -> bool:
        """Return whether ``prepare_write`` has run for the present design."""
        return self._prepared_design is self.design or self.design is self.stored_design

    def prepare_write(self) -> None:
        """Compute everything that ``write`` needs; touches no Blender data, so it may run in a thread."""
        from ...engine.spirals.design_report import design_report

        if not self.is_prepared:
            self._block = design_report(self.design, with_slot=False)
            self._panels.update(self.design)
            # writing changed spirals removes the simulated shape, so that the object shows the target again
            self._target = self._visible_surface_at(self._surface.positions)
            if self._target is not None:
                self._target.shape.prepare(self._unit)
            self._prepared_design = self.design

    def write(self, scene: bpy.types.Scene) -> None:
        """Write the painted spirals and the protection into the object; results of the old spirals go out of date."""
        from ..store import mesh
        from . import overlay

        obj = objects.find_by_uid(self.uid)
        if self.changed_spirals.any():
            self.prepare_write()
            mesh.write_design(obj, self._surface, self.design)
            fields.write_stiffness(obj, self.stiffness)
            stored_report.write(obj.data, "spirals", self._block)
            states.stamp(obj, scene)
            self._panels.show(obj, scene)
            overlay.update_after_stage(obj, "STIFFNESS")
            if self._target is not None:
                self._set_visible_surface(self._target)
        if (self._stored_protected != self.protected).any():
            fields.write_protected(obj, np.flatnonzero(self.protected))
        self.stored_design, self._stored_protected = self.design, self.protected
        self._store_checksums(self._compute_checksums(obj, scene))

    def discard(self) -> None:
        self._panels.discard()


# -- the current session -----------------------------------------------------------------------------------------------


def get_session(obj: bpy.types.Object, scene: bpy.types.Scene) -> PaintSession:
    """Return the object's session; make a new one if the object has changed.

    Parameters
    ----------
    obj : object with flat patches
    scene : its scene

    Raises
    ------
    FlexMapsError : the object cannot be used, or nothing was laid out yet
    """
    if not (_sessions and _sessions[0].try_update(obj, scene)):
        discard_session()
        _sessions[:] = [PaintSession(obj, scene)]
    return _sessions[0]


@bpy.app.handlers.persistent
def discard_session(*_: object) -> None:
    """Delete the session, for example before another file is opened."""
    while _sessions:
        _sessions.pop().discard()


def is_brush_active(context: bpy.types.Context) -> bool:
    """Return whether the brush is the active tool of the 3D view in object mode."""
    tool = context.workspace.tools.from_space_view3d_mode("OBJECT") if context.workspace is not None else None
    return tool is not None and tool.idname == TOOL_ID


def shape_to_draw() -> PaintedShape | None:
    """Return the picture to draw over the 3D view.

    Return None if the brush is not the active tool, or the active object is not the session's or has changed.
    """
    context = bpy.context
    obj = context.object
    if not _sessions or obj is None or obj.type != "MESH" or not is_brush_active(context) or not obj.visible_get():
        return None
    with suppress(FlexMapsError, ReferenceError):
        if _in_stroke or _sessions[0].is_current(obj, context.scene):
            return _sessions[0].shape
    return None


@bpy.app.handlers.persistent
def schedule_update(*_: object) -> None:
    """Handle undo and redo: update the session from the object as soon as Blender has finished the step."""
    if _sessions and not bpy.app.timers.is_registered(_update_session):
        bpy.app.timers.register(_update_session, first_interval=0.0)


def _update_session() -> None:
    context = bpy.context
    obj = context.object
    if _sessions and obj is not None and obj.session_uid == _sessions[0].uid and is_brush_active(context):
        with suppress(FlexMapsError):
            get_session(obj, context.scene)


_in_stroke: list[bool] = []  # not empty during a stroke, while nothing else can change the object


def begin_stroke() -> None:
    _in_stroke[:] = [True]


def end_stroke() -> None:
    _in_stroke.clear()
