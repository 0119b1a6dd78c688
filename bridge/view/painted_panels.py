"""The panels beside a model whose spirals are being painted: of one mesh the points move from stroke to stroke."""

from __future__ import annotations

import zlib
from typing import TYPE_CHECKING

import bpy
import numpy as np

from . import flat_panels

if TYPE_CHECKING:
    from ...engine.spirals.design import SpiralDesign

FACES = "flexmaps_faces"  # on the mesh: a checksum of the faces and of where the panels lie


class PaintedPanels:
    """Those of one design after the other.

    A mesh of so many faces is made before the first stroke, and used by nothing until then: making one of 100,000 takes Blender some 0.1 s.
    """

    def __init__(self, name: str, design: SpiralDesign):
        from ...engine.display.moving import MovingPanels

        self._moving = MovingPanels(design)
        self._prepare()
        self._made = self._make(name)

    def follow(self, design: SpiralDesign) -> None:
        """Compute those of this design; touches nothing of Blender's, so that it may be called beside the window's thread."""
        self._moving.follow(design)
        if self._corners is not self._moving.solid.corners:
            self._prepare()

    def _prepare(self) -> None:
        """Compute what a mesh of these faces is made of, but for Blender's part of it."""
        solid = self._moving.solid
        parts = (solid.corners, solid.sizes, self._moving.centres)
        self._corners = solid.corners
        self._faces = f"{zlib.crc32(b''.join(np.ascontiguousarray(x).tobytes() for x in parts)):08x}"
        self._drawing = flat_panels.PanelDrawing(
            self._moving.design, flat_panels.PLAIN, self._moving.centres, solid, []
        )
        _ = self._drawing.coloured

    def show(self, obj: bpy.types.Object, scene: bpy.types.Scene) -> None:
        """Let the panels beside the object be those of the latest design."""
        standing = flat_panels.panels_of(obj)
        if len(standing) == 1 and standing[0].data.get(FACES) == self._faces:
            self._move(standing[0].data)
            return
        mesh = self._waiting()
        if mesh is None or mesh[FACES] != self._faces:
            self.put_away()
            self._made = self._make(obj.name)
            mesh = self._waiting()
        assert mesh is not None
        self._move(mesh)
        self._drawing.stand(obj, scene, mesh)

    def put_away(self) -> None:
        """Remove the mesh if nothing uses it."""
        mesh = self._waiting()
        if mesh is not None:
            bpy.data.meshes.remove(mesh)

    def _waiting(self) -> bpy.types.Mesh | None:
        """The mesh that was made, while nothing uses it; an undo may have taken it, and what Python holds is nothing then."""
        return next((m for m in bpy.data.meshes if m.session_uid == self._made and not m.users), None)

    def _move(self, mesh: bpy.types.Mesh) -> None:
        points = np.ascontiguousarray(self._moving.solid.vertices, np.float32)
        mesh.attributes["position"].data.foreach_set("vector", points.ravel())
        mesh.update()

    def _make(self, name: str) -> int:
        """A mesh that nothing uses; Blender's id of it."""
        made = self._drawing.mesh(name)
        made[FACES] = self._faces
        return int(made.session_uid)
