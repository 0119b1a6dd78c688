"""Gizmos of the handles: marks on spirals that are held in place, pulled by a force, or have a drag target."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import bpy
import numpy as np
from mathutils import Matrix, Vector

from ..store import handles
from ..store.objects import usage_problem
from . import picking

# largest number of gizmos of each kind; more show every handle of a piece held along its whole border, and slow drawing
# down; chosen by eye
MAX_GIZMOS = 200
# sRGB of held spirals, forces and drag targets ("wish"), distinct in Blender's light and dark theme; chosen by eye
COLOURS = {"held": (0.95, 0.35, 0.30), "pull": (0.25, 0.65, 0.95), "wish": (0.45, 0.80, 0.35)}


class HandleGizmoMixin:
    """Mixin of a gizmo group: a ring for each held spiral, an arrow for a force, an arrow with a box for a drag target.

    shape_of : function that returns the live shape of an object, or None if no live shape is drawn
    """

    gizmos: Any
    shape_of: Callable[[bpy.types.Object], Any]

    def setup(self, context: bpy.types.Context) -> None:
        self._existing: list[tuple[str, int]] = []

    def refresh(self, context: bpy.types.Context) -> None:
        """Make the gizmos anew if the set of handles has changed."""
        wanted = [(kind, quad) for kind, quad, _, _ in _handles(context, self.shape_of)]
        if wanted == getattr(self, "_existing", []):
            return
        self.gizmos.clear()
        for kind, quad in wanted:
            one = self.gizmos.new("GIZMO_GT_move_3d" if kind == "held" else "GIZMO_GT_arrow_3d")
            one.color, one.color_highlight = COLOURS[kind], (1.0, 1.0, 1.0)
            one.alpha, one.alpha_highlight = 0.9, 1.0
            one.use_draw_modal = True
            if kind == "held":
                one.draw_options = {"FILL", "ALIGN_VIEW"}
                one.scale_basis = 0.08
                action = one.target_set_operator("flexmaps.drag_spiral")
                action.quad, action.kind, action.tap = quad, "PULL", True
            else:
                one.draw_style = "NORMAL" if kind == "pull" else "BOX"
                one.use_draw_scale = False
                action = one.target_set_operator("flexmaps.drag_spiral")
                action.quad, action.kind = quad, kind.upper()
        self._existing = wanted

    def draw_prepare(self, context: bpy.types.Context) -> None:
        """Move the gizmos to the handles' present positions, which change with a live piece even without an event."""
        self.refresh(context)
        if not self._existing:
            return
        # scale arrows by the median edge, which sets the size of their heads; lengths are divided by it
        edge = picking.median_edge(context.object)
        for one, (kind, _, place, way) in zip(self.gizmos, _handles(context, self.shape_of), strict=False):
            one.matrix_basis = _gizmo_matrix(place, way, 1.0 if kind == "held" else edge)
            if kind != "held":
                one.length = max(way.length / edge, 1e-3)


def _handles(
    context: bpy.types.Context, shape_of: Callable[[bpy.types.Object], Any]
) -> list[tuple[str, int, Any, Any]]:
    """Return kind, quad, position and vector of every handle, in the scene's units and world axes."""
    obj = context.object
    if usage_problem(obj) is not None or not any(
        handles.PREFIXED[name] in obj.data.attributes for name in handles.NAMES
    ):
        return []
    points, quads = picking.visible_surface(obj, shape_of(obj))
    if not len(quads):
        return []
    result: list[tuple[str, int, Any, Any]] = []
    matrix = np.array(obj.matrix_world)[:3, :3]
    for name in handles.NAMES:
        values = handles.read(obj, name)
        if len(values) != len(quads):
            continue
        for quad in np.flatnonzero(values if name == handles.HELD else values.any(axis=1))[:MAX_GIZMOS].tolist():
            position = points[quads[quad]].mean(axis=0)
            vector = np.zeros(3)
            if name == handles.PULL:
                vector = picking.median_edge(obj) * values[quad]
            elif name == handles.WISH:
                # from the quad's present centre to its target centre plus the offset of the drag target
                vector = picking.target_vertices(obj)[quads[quad]].mean(axis=0) + matrix @ values[quad] - position
            result.append((name, quad, Vector(position), Vector(vector)))
    return result


def _gizmo_matrix(position: Vector, vector: Vector, size: float) -> Matrix:
    turn = vector.to_track_quat("Z", "Y").to_matrix().to_4x4() if vector.length else Matrix.Identity(4)
    return Matrix.Translation(position) @ turn @ Matrix.Scale(size, 4)
