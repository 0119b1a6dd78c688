"""An arch that is to be simulated, and what is read of it."""

from __future__ import annotations

from typing import Any

import numpy as np
from flexmaps.bridge.store import equilibrium
from flexmaps.engine.surface.mesh import QuadMesh

from .buttons import press

LENGTH, WIDTH, EDGE = 8, 3, 0.02


def arch() -> QuadMesh:
    """A third of a tube, its ends at the lowest z: it unrolls into one flat panel."""
    u, v = np.meshgrid(np.arange(LENGTH + 1), np.arange(WIDTH + 1), indexing="ij")
    index = np.arange(u.size).reshape(u.shape)
    quads = np.stack([index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]], axis=-1).reshape(-1, 4)
    radius = LENGTH * EDGE / (2 * np.pi / 3)
    angle = (u.ravel() / LENGTH - 0.5) * 2 * np.pi / 3
    return QuadMesh(np.stack([radius * np.sin(angle), EDGE * v.ravel(), radius * np.cos(angle)], axis=1), quads)


def spiralled(add: Any) -> Any:
    """An arch with its spirals, ready to be simulated."""
    obj = add(arch())
    obj.flexmaps.material.material = "vero"
    press("flatten")
    press("spirals")
    return obj


def group(obj: Any, name: str, vertices: Any) -> None:
    obj.vertex_groups.new(name=name).add([int(v) for v in vertices], 1.0, "REPLACE")


def ends(obj: Any) -> np.ndarray:
    """Vertices of the border at both ends: two corners of every quad there."""
    low = np.array([v.co.z for v in obj.data.vertices])
    return np.flatnonzero(low < low.min() + 1e-5)


def key_of(obj: Any, name: str = equilibrium.EQUILIBRIUM_KEY) -> np.ndarray:
    """(V, 3) a shape key, in the object's frame."""
    block = obj.data.shape_keys.key_blocks[name]
    found = np.empty(3 * len(block.data), np.float32)
    block.data.foreach_get("co", found)
    return found.reshape(-1, 3).astype(float)


def basis(obj: Any) -> np.ndarray:
    return np.array([v.co[:] for v in obj.data.vertices])


def planar(points: np.ndarray) -> float:
    """How far points stray from their best plane."""
    return float(np.linalg.svd(points - points.mean(axis=0))[1][2] / np.sqrt(len(points)))
