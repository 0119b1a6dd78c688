"""The panels beside a model that is being painted: one mesh whose vertices move with every stroke."""

from __future__ import annotations

import zlib
from typing import TYPE_CHECKING

import bpy
import numpy as np

from . import flat_panels

if TYPE_CHECKING:
    from ...engine.spirals.design import SpiralDesign

FACES_KEY = "flexmaps_faces"  # custom property of the mesh: checksum of the faces and the panels' positions


class PaintedPanels:
    """Draws the panels of a design that changes from stroke to stroke.

    A mesh is made in advance, before the first stroke, because making one of 100,000 faces takes about 0.1 s.
    """

    def __init__(self, name: str, design: SpiralDesign):
        from ...engine.display.moving_panels import MovingPanels

        self._moving = MovingPanels(design)
        self._prepare()
        self._spare_uid = self._make_mesh(name)

    def update(self, design: SpiralDesign) -> None:
        """Compute the panels of the changed design; touches no Blender data, so it may run in a thread."""
        self._moving.follow(design)
        if self._corners is not self._moving.solid.corners:
            self._prepare()

    def _prepare(self) -> None:
        """Compute checksum and colours for a mesh with the present faces."""
        solid = self._moving.solid
        parts = (solid.corners, solid.sizes, self._moving.centres)
        self._corners = solid.corners
        self._faces = f"{zlib.crc32(b''.join(np.ascontiguousarray(x).tobytes() for x in parts)):08x}"
        self._drawing = flat_panels.PanelDrawing(
            self._moving.design, flat_panels.NO_CONNECTORS, self._moving.centres, solid, []
        )
        _ = self._drawing.colour_arrays

    def show(self, obj: bpy.types.Object, scene: bpy.types.Scene) -> None:
        """Show the panels of the latest design beside the object; move the vertices of the shown mesh if possible."""
        standing = flat_panels.panels_of(obj)
        if len(standing) == 1 and standing[0].data.get(FACES_KEY) == self._faces:
            self._move_vertices(standing[0].data)
            return
        mesh = self._spare_mesh()
        if mesh is None or mesh[FACES_KEY] != self._faces:
            self.discard()
            self._spare_uid = self._make_mesh(obj.name)
            mesh = self._spare_mesh()
        assert mesh is not None
        self._move_vertices(mesh)
        self._drawing.place_mesh(obj, scene, mesh)

    def discard(self) -> None:
        """Remove the mesh made in advance if nothing uses it."""
        mesh = self._spare_mesh()
        if mesh is not None:
            bpy.data.meshes.remove(mesh)

    def _spare_mesh(self) -> bpy.types.Mesh | None:
        """Return the mesh made in advance, or None if it is in use or gone.

        It is found by its session id, because an undo invalidates Python's references.
        """
        return next((m for m in bpy.data.meshes if m.session_uid == self._spare_uid and not m.users), None)

    def _move_vertices(self, mesh: bpy.types.Mesh) -> None:
        points = np.ascontiguousarray(self._moving.solid.vertices, np.float32)
        mesh.attributes["position"].data.foreach_set("vector", points.ravel())
        mesh.update()

    def _make_mesh(self, name: str) -> int:
        """Make a mesh in advance, and return its session id."""
        made = self._drawing.make_mesh(name)
        made[FACES_KEY] = self._faces
        return int(made.session_uid)
