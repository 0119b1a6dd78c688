"""Shape keys that a simulation writes on a mesh."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import bpy
import numpy as np

from ...engine.arrays import Float
from .columns import column

EQUILIBRIUM_KEY, OTHER_KEY = "FlexMaps equilibrium", "FlexMaps other shape"


def equilibrium_key(mesh: bpy.types.Mesh) -> bpy.types.ShapeKey | None:
    """Return the shape key of the equilibrium, if it exists."""
    keys = mesh.shape_keys
    return None if keys is None else keys.key_blocks.get(EQUILIBRIUM_KEY)


def simulated_keys(mesh: bpy.types.Mesh) -> list[bpy.types.ShapeKey]:
    """Return the shape keys that a simulation wrote: the equilibrium, then other shapes."""
    keys = mesh.shape_keys
    return (
        []
        if keys is None
        else [k for k in keys.key_blocks if k.name == EQUILIBRIUM_KEY or k.name.startswith(OTHER_KEY)]
    )


def has_user_keys(mesh: bpy.types.Mesh) -> bool:
    """Return whether the user has shape keys besides the basis and FlexMaps' own."""
    keys = mesh.shape_keys
    return keys is not None and len(keys.key_blocks) - len(simulated_keys(mesh)) > 1


def simulated_positions(mesh: bpy.types.Mesh) -> Float[np.ndarray, "vertices 3"]:
    """Return the vertices moved only by FlexMaps' shape keys, not by the user's, in the object's own frame."""
    basis = column(mesh.vertices, "co")
    positions = basis.copy()
    for key in simulated_keys(mesh):
        if not key.mute and key.value and len(key.data) == len(mesh.vertices):
            positions += np.float32(key.value) * (column(key.data, "co") - basis)
    return positions


@contextmanager
def blend_shown(obj: bpy.types.Object, share: float) -> Iterator[None]:
    """Context manager: show the object's target (``share`` 0), its simulated shape (1), or a blend of both."""
    before = [(key.name, key.value, key.mute) for key in simulated_keys(obj.data)]
    for key in simulated_keys(obj.data):
        key.value, key.mute = (share if key.name == EQUILIBRIUM_KEY else 0.0), False
    try:
        yield
    finally:
        for name, value, mute in before:
            key = obj.data.shape_keys.key_blocks[name]
            key.value, key.mute = value, mute
