"""A bowl that is to be optimised, and what is read of it."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
from flexmaps.bridge.store import mesh, settings, stored_report
from flexmaps.engine.params import SpiralParams
from flexmaps.engine.surface.checking import check
from flexmaps.engine.surface.mesh import QuadMesh

from .buttons import press

QUADS, EDGE = 45, 0.02


def bowl(*, closed: bool = False) -> QuadMesh:
    """A cube without its bottom, or whole, blown up to a ball, three by three quads a side: five patches, or six."""
    steps = np.tan(np.linspace(-np.pi / 4, np.pi / 4, 4))
    u, v = (x.ravel() for x in np.meshgrid(steps, steps, indexing="ij"))
    index = np.arange(16).reshape(4, 4)
    face = np.stack([index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]], axis=-1).reshape(-1, 4)
    points, quads = [], []
    for axis, sign in ((0, 1), (0, -1), (1, 1), (1, -1), (2, 1), (2, -1))[: 6 if closed else 5]:
        quads.append((face if sign > 0 else face[:, ::-1]) + 16 * len(points))
        points.append(np.roll(np.stack([np.full(16, sign), u, v], axis=1), axis, axis=1))
    every, same = np.unique(np.round(np.concatenate(points), 9), axis=0, return_inverse=True)
    ball = QuadMesh(every / np.linalg.norm(every, axis=1, keepdims=True), same.ravel()[np.concatenate(quads)])
    return ball.with_vertices(ball.vertices * (EDGE / ball.median_edge))


def spiralled(add: Any) -> Any:
    """A bowl with its spirals, ready to be optimised in a few steps, which do not move the flat shapes."""
    obj = add(bowl())
    obj.flexmaps.optimise.iterations, obj.flexmaps.optimise.codesign = 8, False
    press("trace")
    press("spirals")
    return obj


def block(obj: Any, name: str = "optimise") -> dict[str, Any]:
    found: dict[str, Any] = stored_report.read(obj.data)[name]
    return found


def design(obj: Any) -> Any:
    """The spirals as the mesh holds them, read anew."""
    surface = mesh.read_surface(obj, bpy.context.scene)
    flat = mesh.require_current_flat(surface, check.as_quad_mesh(surface.polygons))
    return mesh.read_design(surface, flat, settings.read(obj.flexmaps.spiral, SpiralParams))
