"""Optimise with moving flat shapes: what is written is what was simulated."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
import pytest
from flexmaps.bridge.store import attributes, mesh, settings, stored_report
from flexmaps.engine.materials import find_material
from flexmaps.engine.params import SimulateParams, SpiralParams
from flexmaps.engine.patches.flattening.flattening_report import layout_report
from flexmaps.engine.simulation.simulate import simulate
from flexmaps.engine.surface import shapes
from flexmaps.engine.surface.checking import check
from support.buttons import press


@pytest.mark.thorough
def test_flat_shapes_that_moved_are_written(add: Any) -> None:
    obj = add(shapes.make("dome", 0.03))
    press("merge")
    press("spirals")
    before = np.array(attributes.read(obj.data, "flexmaps_flat"))
    obj.flexmaps.optimise.iterations = 4
    obj.flexmaps.optimise.codesign = False
    press("optimise")
    assert np.array(attributes.read(obj.data, "flexmaps_flat")) == pytest.approx(before, abs=1e-4)
    obj.flexmaps.optimise.codesign = True
    press("optimise")
    after = np.array(attributes.read(obj.data, "flexmaps_flat"))
    assert np.abs(after - before).max() > 0.05  # millimetres
    found = stored_report.read(obj.data)
    surface = mesh.read_surface(obj, bpy.context.scene)
    flat = mesh.require_current_flat(surface, check.as_quad_mesh(surface.polygons))
    assert found["layout"]["energy_max"] == pytest.approx(layout_report(flat)["energy_max"], rel=1e-3)
    assert found["layout"]["energy_max"] < obj.flexmaps.optimise.distortion_limit
    # read back from the mesh, the piece takes the shape that the report tells
    design = mesh.read_design(surface, flat, settings.read(obj.flexmaps.spiral, SpiralParams))
    again = simulate(design, flat.layout.mesh, find_material(obj.flexmaps.material.material), SimulateParams())
    assert again.report()["laplacian_rmse_mm"] == pytest.approx(found["optimise"]["laplacian_rmse_mm"], rel=2e-3)
