"""The simulated pose of the hubs, stored as face attributes; the preview of the assembled piece is built from it.

 flexmaps_hub                     face   the hub's centre, in the object's own frame
 flexmaps_hub_x, flexmaps_hub_y   face   the flat patch's x and y axis, turned with the hub; in the object's own frame

In the object's frame, the pose moves and turns with the object.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import bpy
import numpy as np

from ...engine.arrays import Float
from . import attributes

if TYPE_CHECKING:
    from ...engine.mechanics.assembly import Pose

NAMES = ("hub", "hub_x", "hub_y")


def write(obj: bpy.types.Object, to_metres: Float[np.ndarray, "4 4"], pose: Pose) -> None:
    """Store a pose.

    Parameters
    ----------
    obj : the mesh object
    to_metres : matrix from the object's frame to metres in world axes, the pose's frame
    pose : centres and rotations of the hubs
    """
    inverse = np.linalg.inv(to_metres)
    linear = inverse[:3, :3].T
    ways = (pose.centres @ linear + inverse[:3, 3], pose.rotations[:, :, 0] @ linear, pose.rotations[:, :, 1] @ linear)
    for name, values in zip(NAMES, ways, strict=True):
        attributes.write(obj, attributes.PREFIX + name, "FACE", "FLOAT_VECTOR", values)


def read(obj: bpy.types.Object, to_metres: Float[np.ndarray, "4 4"]) -> Pose | None:
    """Return the stored pose in metres and world axes, moved with the object; None if missing or damaged.

    Parameters
    ----------
    obj : the mesh object
    to_metres : matrix from the object's frame to metres
    """
    from ...engine.mechanics.assembly import Pose

    with attributes.readable_mesh(obj) as mesh:
        stored = [attributes.read(mesh, attributes.PREFIX + name) for name in NAMES]
        count = len(mesh.polygons)
    if any(values is None or values.shape != (count, 3) for values in stored):
        return None
    centre, x, y = (np.asarray(values, dtype=float) @ to_metres[:3, :3].T for values in stored)
    normal = np.cross(x, y)
    squares = np.linalg.norm(normal, axis=1) > 0.1 * np.linalg.norm(x, axis=1) * np.linalg.norm(y, axis=1)
    if not squares.all() or (count > 1 and not np.ptp(centre, axis=0).any()):
        return None  # damaged
    # take the nearest rotation matrix, because float32 has rounded the axes
    u, _, vt = np.linalg.svd(np.stack([x, y, normal / np.linalg.norm(normal, axis=1, keepdims=True)], axis=2))
    return Pose(centre + to_metres[:3, 3], u @ vt)


def clear(obj: bpy.types.Object) -> None:
    """Remove the stored pose, because it is out of date."""
    for name in NAMES:
        attributes.remove(obj, attributes.PREFIX + name)
