"""Test cases of live mode: domes, tori and surfaces of the zoo with any number of spirals, and changes of all kinds."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from flexmaps.engine.extras.live.live_input import LiveInput
from flexmaps.engine.params import LayoutParams, MaterialParams, SimulateParams, SpiralParams
from flexmaps.engine.patches.flattening import flatten
from flexmaps.engine.patches.flattening.flatten import FlatPatches
from flexmaps.engine.patches.tracing import trace
from flexmaps.engine.spirals import fabricable
from flexmaps.engine.spirals.design import SpiralDesign
from flexmaps.engine.surface.curvature import rms_curvature
from flexmaps.engine.surface.mesh import QuadMesh
from harness import EDGE


def design_of_mesh(mesh: QuadMesh, border: str = "stubs") -> tuple[FlatPatches, SpiralDesign]:
    """Traced patches with the curvature's spirals, as they are first made of any surface."""
    mesh = mesh.with_vertices(mesh.vertices * (EDGE / mesh.median_edge))
    flat = flatten.flatten(trace.trace_layout(mesh, LayoutParams()), LayoutParams())
    return flat, fabricable.design_from_curvature(flat, SpiralParams(border=border), rms_curvature(mesh))


def live_input(made: SpiralDesign, **others: Any) -> LiveInput:
    """Return the inputs of a live piece for a design."""
    flat, mesh = made.flat, made.flat.layout.mesh
    sizes = np.full(len(mesh.quads), 4)
    cut = flat.layout.cut
    rest = (made.params, LayoutParams(), MaterialParams().chosen, SimulateParams())
    found = LiveInput(
        mesh.vertices, mesh.quads.ravel(), sizes, cut, cut, flat.corners, flat.energy, made.width, made.twist, *rest
    )
    return replace(found, **others)


def stroke(given: LiveInput, rng: np.random.Generator, share: float = 0.05) -> LiveInput:
    """Softer or stiffer spirals about some place: a share of all of them, the nearest ones."""
    middles = given.vertices[given.corners.reshape(-1, 4)].mean(axis=1)
    place = middles[rng.integers(len(middles))]
    near = np.argsort(np.linalg.norm(middles - place, axis=1))[: max(1, round(share * len(middles)))]
    width, twist = given.width.copy(), given.twist.copy()
    # back and forth, so that many strokes do not end at a bound
    least, most = given.spiral.width_min, given.spiral.width_max
    thinner = width[near].mean() > 0.5 * (least + most)
    width[near] = np.clip(width[near] * (0.8 if thinner else 1.25), least, most)
    twist[near] = np.clip(twist[near] * (1.2 if thinner else 0.8), 0.0, given.spiral.twist_max)
    return replace(given, width=width, twist=twist)
