"""Checksums of the inputs of stages: the shape, the seams, the spirals, the pose, a section of the settings.

Every redraw computes them, so they must be fast: edits of a large mesh count only after the user leaves edit mode.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable

import bmesh
import bpy
import numpy as np

from ...engine.arrays import Float
from ...engine.runs.stage import section_of
from . import attributes, handles, pose, settings, vertex_positions
from .columns import column

# most edges of a mesh that is read from edit mode at every redraw (some ms); larger slows redraws, smaller misses edits
MAX_EDGES = 20_000


class Checksums:
    """Present checksums by name of the input, computed on demand unless ``precomputed`` holds them."""

    def __init__(self, obj: bpy.types.Object, scene: bpy.types.Scene, precomputed: dict[str, str] | None = None):
        self._obj, self._scene = obj, scene
        self._computed = dict(precomputed or {})
        self._frame = np.array(obj.matrix_world)[:3, :3] * scene.unit_settings.scale_length

    def __getitem__(self, part: str) -> str:
        if part not in self._computed:
            own: dict[str, Callable[[], bytes]] = {
                "shape": self._shape,
                "seams": self._seams,
                "design": lambda: self._values("width", "twist"),
                "pose": lambda: self._values(*pose.NAMES),
                "down": self._down,
            }
            data = own[part]() if part in own else self._settings(part)
            self._computed[part] = f"{zlib.crc32(data):08x}"
        return self._computed[part]

    def _shape(self) -> bytes:
        """Return vertices, faces, scale and mirroring as bytes; the object's position and rotation do not matter."""
        mesh = self._obj.data
        bm = self._bmesh()
        if bm is not None:
            bm.verts.index_update()
            positions = np.fromiter((x for v in bm.verts for x in v.co), np.float32, 3 * len(bm.verts))
            corners = np.fromiter((loop.vert.index for face in bm.faces for loop in face.loops), np.int32)
            faces = len(bm.faces)
        else:
            positions, corners = column(mesh.vertices, "co"), column(mesh.loops, "vertex_index")
            faces = len(mesh.polygons)
        mirrored = bool(np.linalg.det(self._frame) < 0)
        rest = f"{_format_matrix(self._frame.T @ self._frame)} {mirrored} {faces}"
        return positions.tobytes() + corners.tobytes() + rest.encode() + vertex_positions.user_keys_as_bytes(self._obj)

    def _bmesh(self) -> bmesh.types.BMesh | None:
        """Return the BMesh of edit mode; None in other modes, above ``MAX_EDGES`` edges, or for a key besides the basis.

        Stages read only the basis, which editing another shape key does not change.
        """
        mesh = self._obj.data
        if not mesh.is_editmode or len(mesh.edges) > MAX_EDGES or self._obj.active_shape_key_index > 0:
            return None
        bm = bmesh.from_edit_mesh(mesh)
        return bm if len(bm.edges) <= MAX_EDGES else None

    def _seams(self) -> bytes:
        mesh = self._obj.data
        bm = self._bmesh()
        if bm is not None:
            return np.fromiter((edge.seam for edge in bm.edges), bool, len(bm.edges)).tobytes()
        return column(mesh.edges, "use_seam").tobytes()

    def _values(self, *names: str) -> bytes:
        """Return the stored values of named attributes of faces and corners as bytes."""
        mesh = self._obj.data
        if not mesh.is_editmode:
            stored = (attributes.read_as_stored(mesh, attributes.PREFIX + name) for name in names)
            return b"".join(b"" if values is None else values.tobytes() for values in stored)
        bm = bmesh.from_edit_mesh(mesh)  # in edit mode only the BMesh holds attribute values
        faces = bm.faces
        data = b""
        for name in names:
            number, way = (
                layers.get(attributes.PREFIX + name) for layers in (faces.layers.float, faces.layers.float_vector)
            )
            corner = bm.loops.layers.float.get(attributes.PREFIX + name)
            if corner is not None:
                data += np.fromiter((loop[corner] for face in faces for loop in face.loops), np.float32).tobytes()
            elif number is not None:
                data += np.fromiter((face[number] for face in faces), np.float32, len(faces)).tobytes()
            elif way is not None:
                data += np.fromiter((x for face in faces for x in face[way]), np.float32, 3 * len(faces)).tobytes()
        return data

    def _down(self) -> bytes:
        """Return the object's axes, which weight and forces act along, as bytes; b"" without weight and forces."""
        own = getattr(self._obj, "flexmaps", None)
        if own is None or not (own.simulate.gravity or own.loads.force_x or own.loads.force_y or own.loads.force_z):
            return b""
        return _format_matrix(self._frame).encode()

    def _settings(self, name: str) -> bytes:
        own = getattr(self._obj, "flexmaps", None)  # None where the extension is not registered
        section, but = section_of(name)
        text = b"" if own is None else settings.format_changed(getattr(own, section), but).encode()
        return text + self._values(handles.HELD, handles.PULL) if section == "loads" else text


def _format_matrix(matrix: Float[np.ndarray, "rows columns"]) -> str:
    """Return a matrix as text, rounded to 4 digits of its largest entry."""
    size = max(float(np.abs(matrix).max()), 1e-30)
    return f"{size:.5g} {(np.round(matrix / size, 4) + 0.0).tolist()}"
